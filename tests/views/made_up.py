"""Rows of trials with made-up numbers, no two alike, so that one exchanged for another shows."""

import functools
import types
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from numpy.random import Generator

from testbench.runs.spread import Spread

COUNT = 3
"""Entries of tuples of any length."""
LEAST, MOST = 10.0, 100.0
"""Numbers between: two digits in every format, narrow enough for a terminal."""


def of_one_trial(kind, rng, /, **fixed):
    """A row of one trial with made-up fields, nested ones too.

    Args:
        kind: The dataclass.
        rng: Source of the numbers.
        fixed: Fields that are given, such as lists whose length or names matter.
    """
    makers = _makers(kind)
    unknown = fixed.keys() - makers.keys()
    assert not unknown, unknown
    return kind(**{name: fixed[name] if name in fixed else make(rng) for name, make in makers.items()})


@functools.cache
def _makers(kind):
    """What makes each field of a dataclass up from rng, by name."""
    hints = get_type_hints(kind)
    return {f.name: _maker(hints[f.name], f.name) for f in fields(kind)}


def _number(rng):
    return float(LEAST * (MOST / LEAST) ** rng.uniform())


def _count(rng):
    return round(_number(rng))


def _maker(kind: Any, name: str) -> Callable[[Generator], Any]:
    """What makes a value of a type up from rng."""
    origin, args = get_origin(kind), get_args(kind)
    if origin is Literal:
        return lambda rng: args[rng.integers(len(args))]
    if origin in (Union, types.UnionType):  # a number that could be spread, or a share, is one trial's
        alone = {bool, float} == set(args) or next(a for a in args if a is not type(None))
        if Spread in args:
            return _count if int in args else _number
        return _truth if alone is True else _maker(alone, name)
    if origin is tuple:
        makers = [_maker(a, name) for a in (args[:1] * COUNT if args[-1] is Ellipsis else args)]
        return lambda rng: tuple(make(rng) for make in makers)
    return _plain(kind, name)


def _plain(kind, name):
    if is_dataclass(kind) and kind is not Spread:
        return lambda rng: of_one_trial(kind, rng)
    if kind is str:
        return lambda rng: f"{name.replace('_', ' ')} {_word(rng)}"
    made = {
        Spread: _number,
        bool: _truth,
        int: lambda rng: int(rng.integers(2, 10_000)),
        float: _number,
        type(None): lambda rng: None,
    }
    assert kind in made, f"{name}: nothing made up for {kind}"
    return made[kind]


def _truth(rng):
    return bool(rng.integers(2))


def _word(rng):
    return "".join(chr(ord("a") + k) for k in rng.integers(26, size=6))
