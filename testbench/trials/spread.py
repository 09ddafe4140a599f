"""Rows of many trials as medians with their spread: the one place where trials become a summary."""

import math
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import TypeVar

import numpy as np

from testbench.errors import Array

SAME = 1e-6  #: Share of an error within which two models are the same.
T = TypeVar("T")
K = TypeVar("K", bound=Hashable)


@dataclass(frozen=True)
class Spread:
    """A number over several trials."""

    median: float  #: The middle of them.
    p05: float  #: 5th percentile.
    p95: float  #: 95th percentile.


Number = float | Spread | None
"""A number of one trial, its spread over several, or None where there is none."""
Count = int | Spread | None  #: The same of an integer.
Share = bool | float  #: Whether something holds, or the share of trials in which it does.


def spread(values: Sequence[float] | Array) -> Spread:
    """Median, 5th and 95th percentile of at least one number; NaN where one of them is."""
    ordered = np.sort(np.asarray(values, dtype=float))
    if math.isnan(ordered[-1]):
        return Spread(math.nan, math.nan, math.nan)
    return Spread(*(_quantile(ordered, share) for share in (0.5, 0.05, 0.95)))


def _quantile(ordered: Array, share: float) -> float:
    """To the bit np.quantile of sorted numbers, without its checks: a summary asks ten thousand times."""
    place = (len(ordered) - 1) * share
    k = int(place)
    low, high = float(ordered[k]), float(ordered[min(k + 1, len(ordered) - 1)])
    t = place - k
    return low + (high - low) * t if t < 0.5 else high - (high - low) * (1 - t)


def wins(ours: Sequence[float] | Array, theirs: Sequence[float] | Array) -> int:
    """In how many trials ours is the smaller by more than a solver's last digits."""
    return int(np.count_nonzero(np.asarray(ours) < (1 - SAME) * np.asarray(theirs)))


def middle(value: Number) -> float:
    """The number, or its median over trials; NaN where there is none."""
    if isinstance(value, Spread):
        return value.median
    return math.nan if value is None else float(value)


def ends(value: Number) -> tuple[float, float]:
    """5th and 95th percentile; twice the number where it has no spread."""
    return (value.p05, value.p95) if isinstance(value, Spread) else (middle(value), middle(value))


def triple(value: Number) -> tuple[float, float, float]:
    """Median, 5th and 95th percentile; three times the number where it has no spread."""
    return (middle(value), *ends(value))


def merge(values: Sequence[T]) -> T:
    """Records of several trials, all of one type, as one: every number becomes its median and spread.

    A truth value becomes the share of trials in which it holds; what is the same in all trials stays;
    different words are listed, of tuples of words each one once.
    """
    return _merge(list(values))  # type: ignore[return-value]  # a dataclass's fields are Numbers


def _merge(values: list[object]) -> object:
    first = values[0]
    if is_dataclass(first) and not isinstance(first, type):
        return type(first)(**{f.name: _merge([getattr(v, f.name) for v in values]) for f in fields(first)})
    if isinstance(first, dict):
        return {key: _merge([v[key] for v in values if isinstance(v, dict)]) for key in first}
    if all(v == first for v in values):
        return first
    if all(isinstance(v, bool) for v in values):
        return sum(map(bool, values)) / len(values)
    if all(isinstance(v, int | float) for v in values):
        return spread([float(v) for v in values if isinstance(v, int | float)])
    texts = [v for v in values if isinstance(v, tuple) and all(isinstance(text, str) for text in v)]
    if len(texts) == len(values):
        return tuple(dict.fromkeys(text for own in texts for text in own))
    rows = [v for v in values if isinstance(v, list | tuple)]
    if len(rows) == len(values) and len({len(row) for row in rows}) == 1:
        return [_merge(list(column)) for column in zip(*rows, strict=True)]
    return " | ".join(sorted({str(v) for v in values}))


def grouped(rows: Iterable[T], key: Callable[[T], K]) -> dict[K, list[T]]:
    """Rows of any number of trials by group, groups in the order in which they first appear."""
    found: dict[K, list[T]] = {}
    for row in rows:
        found.setdefault(key(row), []).append(row)
    return found
