"""Made-up reports: every field filled, every number distinct, so that one exchanged for another shows."""

import functools
import types
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

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
    hints = _hints(kind)
    unknown = set(fixed) - set(hints)
    assert not unknown, unknown
    values = {
        f.name: fixed[f.name] if f.name in fixed else _value(hints[f.name], f.name, rng) for f in fields(kind)
    }
    return kind(**values)


_hints = functools.cache(get_type_hints)


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
    shares = [n for n, hint in _hints(kind).items() if set(get_args(hint)) == {bool, float}]
    held = {name: bool(rng.integers(2)) for name in shares}
    return single(fill(kind, rng, **{**held, **fixed}))


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


def _value(kind: Any, name: str, rng) -> Any:
    origin, args = get_origin(kind), get_args(kind)
    if origin is Literal:
        return args[rng.integers(len(args))]
    if origin in (Union, types.UnionType):
        return _one_of(args, name, rng)
    if origin is tuple:
        several = args[:1] * COUNT if args[-1] is Ellipsis else args
        return tuple(_value(a, name, rng) for a in several)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return {_value(args[0], name, rng): _value(args[1], name, rng) for _ in range(COUNT)}
    if isinstance(origin, type) and issubclass(origin, Sequence):
        return [_value(args[0], name, rng) for _ in range(COUNT)]
    return _plain(kind, name, rng)


def _one_of(args, name, rng):
    if Spread in args:
        return spread(rng)
    if set(args) == {bool, float}:
        return float(rng.uniform(0.1, 0.9))  # a share of trials
    return _value(next(a for a in args if a is not type(None)), name, rng)


def _plain(kind, name, rng):
    if kind is Spread:
        return spread(rng)
    if is_dataclass(kind):
        return fill(kind, rng)
    if kind is bool:
        return bool(rng.integers(2))
    if kind is int:
        return int(rng.integers(2, 10_000))
    if kind is float:
        return _number(rng)
    if kind is type(None):
        return None
    if kind in (str, object):
        return f"{name.replace('_', ' ')} {_word(rng)}"
    raise AssertionError(f"{name}: nothing made up for {kind}")


def _word(rng):
    return "".join(rng.choice(list("abcdefghijklmnopqrstuvwxyz"), 6))
