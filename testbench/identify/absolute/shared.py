"""Frames and mounts that several series share: targets by name, lost where a series does not have them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbench.data.series import Series
from testbench.errors import Array, BenchError
from testbench.identify.absolute.align import FAR, align, reach
from testbench.identify.absolute.scatter import residuals
from testbench.identify.absolute.state import Mount, State


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


def aligned(state: State, series: tuple[Series, ...]) -> State:
    """The state with a frame and a mount for every series; those that it has are kept.

    Raises:
        BenchError: When a series has too few rows, or does not fit the arm.
    """
    frames, mounts = dict(state.frames), dict(state.mounts)
    for one in sorted(series, key=lambda one: not one.turned.any()):  # who reads orientations knows the mount
        known = mounts.get(one.target)
        if one.frame in frames and known is not None and set(one.markers) <= set(known.markers):
            continue
        frame, mount = align(state, read_only(one))
        frames.setdefault(one.frame, frame)
        mounts[one.target] = mount if known is None else _joined(known, mount)
    found = replace(state, frames=frames, mounts=mounts)
    _check_shared(found, series)
    return replace(found, mounts={**mounts, **{one.target: found.mount(one) for one in series}})


def _check_shared(state: State, series: tuple[Series, ...]) -> None:
    """Refuse a series that does not fit the frame or mount that it shares with another, by BenchError."""
    for one in series:
        others = [other for other in series if other is not one]
        what = [f"frame {one.frame!r}"] * any(other.frame == one.frame for other in others)
        what += [f"mount {one.target!r}"] * any(other.target == one.target for other in others)
        if not what:
            continue
        off = far_off(state, one)
        if off:
            raise BenchError(
                f"{one.name}: three quarters of it are {1e3 * off:.3g} mm or more from the "
                f"{' and the '.join(what)} that it shares; did the tracker or the target move between series?"
            )


def far_off(state: State, series: Series) -> float:
    """How far three quarters of a series are from its frame and mount at least [m]; 0 where these may be its.

    Those of a quarter are where something moved in mid-series.
    """
    left = np.linalg.norm(residuals(state, series)[: len(series.markers)], axis=1).T[series.seen]
    off = float(np.percentile(left, 25)) if len(left) else 0.0
    return off if off > 2 * FAR * reach(state.vjm, series) else 0.0


def _joined(known: Mount, more: Mount) -> Mount:
    """A mount with the targets that another reading of it has beside."""
    new = [k for k, name in enumerate(more.markers) if name not in known.markers]
    markers = (*known.markers, *(more.markers[k] for k in new))
    return replace(known, points=np.concatenate([known.points, more.points[new]]), markers=markers)
