"""Targets of a mount that several series share: each by its name, lost where a series does not have it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbench.data.series import Series
from testbench.errors import Array


def alike(series: Sequence[Series]) -> tuple[tuple[Series, ...], tuple[str, ...]]:
    """Series of one mount with the same targets in the same order, and notes on those that no one read."""
    names: dict[str, dict[str, bool]] = {}
    for one in series:
        own = names.setdefault(one.target, {})
        for name, seen in zip(one.markers, _seen(one), strict=True):
            own[name] = own.get(name, False) or seen
    found, notes = [], []
    for one in series:
        own = names[one.target]
        lost = [name for name in one.markers if not own[name]]
        read = any(own.values())
        if lost and read:
            notes.append(f"{one.name}: {', '.join(lost)} was never read and is left out")
        found.append(with_targets(one, tuple(name for name, seen in own.items() if seen or not read)))
    return tuple(found), tuple(notes)


def read_only(series: Series) -> Series:
    """A series without the targets that it never read; as it is where it read none."""
    names = tuple(name for name, on in zip(series.markers, _seen(series), strict=True) if on)
    return with_targets(series, names) if names else series


def with_targets(series: Series, markers: tuple[str, ...]) -> Series:
    """A series with these targets in this order, lost where it has none of the name."""
    if markers == series.markers:
        return series
    there = [k for k, name in enumerate(markers) if name in series.markers]
    own = [series.markers.index(markers[k]) for k in there]
    position = np.zeros((series.rows, len(markers), 3))
    precision = np.zeros((series.rows, len(markers), 3, 3))
    position[:, there], precision[:, there] = series.position[:, own], _precision(series)[:, own]
    whole = series.precision is None and len(there) == len(markers)
    return replace(series, markers=markers, position=position, precision=None if whole else precision)


def _seen(series: Series) -> list[bool]:
    """Which targets were ever read, (m,)."""
    return [bool(own.any()) for own in series.seen.T]


def _precision(series: Series) -> Array:
    """Of every position, (rows, m, 3, 3) [1/m^2]."""
    if series.precision is not None:
        return series.precision
    return np.broadcast_to(np.eye(3) / series.sigma**2, (*series.position.shape[:2], 3, 3))
