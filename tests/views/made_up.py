"""Made-up reports: every field filled, every number distinct, so that one exchanged for another shows."""

import functools
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from numpy.random import Generator

from testbench.trials.spread import Spread

COUNT = 3
"""Entries of lists and mappings of any length."""
LEAST, MOST = 10.0, 100.0
"""Numbers between: two digits in every format, narrow enough for a terminal."""


def fill(kind, rng, /, **fixed):
    """A dataclass with made-up fields, nested ones too; a number over trials is a Spread.

    Args:
        kind: The dataclass.
        rng: Source of the numbers.
        fixed: Fields that are given, such as lists whose length or names matter.
    """
    return _filled(kind, rng, fixed, one=False)


def _filled(kind, rng, fixed, one):
    makers = _makers(kind, one)
    unknown = fixed.keys() - makers.keys()
    assert not unknown, unknown
    return kind(**{name: fixed[name] if name in fixed else make(rng) for name, make in makers.items()})


@functools.cache
def _makers(kind, one):
    """What makes each field of a dataclass up from rng, by name; of one trial there are no spreads."""
    hints = get_type_hints(kind)
    return {f.name: _maker(hints[f.name], f.name, one) for f in fields(kind)}


def filled(kind, rng, rows, /, **fixed):
    """One dataclass a row: what a row gives is fixed, the rest made up.

    Args:
        kind: The dataclass.
        rng: Source of the numbers.
        rows: Fixed fields of each, by name.
        fixed: Fixed fields of all.
    """
    return [fill(kind, rng, **fixed, **row) for row in rows]


def of_one_trial(kind, rng, /, **fixed):
    """A row of one trial: its numbers have no spread, its shares are truth values."""
    return _filled(kind, rng, {name: single(value) for name, value in fixed.items()}, one=True)


def spread(rng):
    """Three distinct numbers, in order."""
    low, middle, high = sorted(_number(rng) for _ in range(3))
    return Spread(median=middle, p05=low, p95=high)


def around(value):
    """A number over trials with a given median."""
    return Spread(median=value, p05=0.53 * value, p95=1.71 * value)


def single(value):
    """The same report of one trial: medians in place of spreads."""
    if isinstance(value, Spread):
        return value.median
    if is_dataclass(value):
        return replace(value, **{f.name: single(getattr(value, f.name)) for f in fields(value)})
    if isinstance(value, Mapping):
        return {key: single(v) for key, v in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(single(v) for v in value)
    return value


def _number(rng):
    return float(LEAST * (MOST / LEAST) ** rng.uniform())


def _maker(kind: Any, name: str, one: bool) -> Callable[[Generator], Any]:
    """What makes a value of a type up from rng."""
    origin, args = get_origin(kind), get_args(kind)
    if origin is Literal:
        return lambda rng: args[rng.integers(len(args))]
    if origin in (Union, types.UnionType):
        return _one_of(args, name, one)
    if origin is tuple:
        several = args[:1] * COUNT if args[-1] is Ellipsis else args
        makers = [_maker(a, name, one) for a in several]
        return lambda rng: tuple(make(rng) for make in makers)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        key, value = (_maker(a, name, one) for a in args)
        return lambda rng: {key(rng): value(rng) for _ in range(COUNT)}
    if isinstance(origin, type) and issubclass(origin, Sequence):
        make = _maker(args[0], name, one)
        return lambda rng: [make(rng) for _ in range(COUNT)]
    return _plain(kind, name, one)


def _one_of(args, name, one):
    if Spread in args:
        return _number if one else spread
    if set(args) == {bool, float}:  # a share of trials
        return _truth if one else lambda rng: float(rng.uniform(0.1, 0.9))
    return _maker(next(a for a in args if a is not type(None)), name, one)


def _plain(kind, name, one):
    if is_dataclass(kind) and kind is not Spread:
        return lambda rng: _filled(kind, rng, {}, one)
    if kind in (str, object):
        return lambda rng: f"{name.replace('_', ' ')} {_word(rng)}"
    made = {
        Spread: _number if one else spread,
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
