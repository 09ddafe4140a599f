"""Mistakes in loads, or between the two readings: each a change of the data set of a size that is fitted."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from testbench.data.dataset import Dataset, Mask, read_by
from testbench.errors import Array
from testbench.identify.doubts.loads import Change, Fitted, Size, of_columns, sized
from testbench.identify.registered import station, unloaded

FORCE, POINT, SHIFT, FACTOR = 0.1, 0.1, 1e-3, 0.3
"""Sizes that are expected of a constant force over the largest, of a load point's error [m], of a tracker's
move [m, rad] and of a wrong load [1]."""
BUMP = 3e-3  #: The same of a target that was touched, or of a reading of another one [m].
LEAST_OF_LEVEL = 3  #: Runs of a load below which it is no level.
SAME = 0.02  #: Share by which loads of one level may differ.


@dataclass(frozen=True)
class Suspect:
    """A mistake, and how much likelier it makes the readings."""

    name: str  #: A word for programs.
    where: str  #: Run, target or level.
    size: Size
    unit: float  #: Of the size, in SI.
    mend: Change | None = None  #: Mends it in all runs; None for a mistake of single runs.


def suspects(fitted: Fitted) -> Iterator[Suspect]:
    """Every mistake whose size enters linearly."""
    data = fitted.data
    force = float(np.linalg.norm(data.wrench[:, :3], axis=1).max())
    if force > 0:
        push = _force(FORCE * force)
        yield Suspect("force_offset", "", sized(fitted, push, 3), FORCE * force, push)
    yield Suspect("load_point", "", sized(fitted, _point, 3), POINT, _point)
    for name in (station(one.frame) for one in unloaded(data)):
        where = "" if data.station is None else f"station {name}"
        move = _station(data, name)
        yield Suspect("tracker_moved", where, sized(fitted, move, 6), SHIFT, move)
    groups = levels(data)
    if len(groups) > 1:
        for mask in groups:
            load = np.linalg.norm(data.wrench[mask, :3], axis=1).mean()
            weigh = _factor(mask)
            yield Suspect("level", f"{load:.4g} N", sized(fitted, weigh, 1), FACTOR, weigh)
    yield from _single(fitted)


def levels(data: Dataset) -> list[Mask]:
    """Runs of one size of force each, sizes that occur often enough; none where a load is of no such size."""
    force = np.linalg.norm(data.wrench[:, :3], axis=1)
    found: list[Mask] = []
    left = np.ones(len(force), dtype=bool)
    while left.any():
        own = left & (np.abs(force - force[left].max()) <= SAME * force.max())
        found.append(own)
        left &= ~own
    often = all(own.sum() >= LEAST_OF_LEVEL for own in found)
    return found if often and force.min() > 0 else []


def _force(size: float) -> Change:
    def change(data: Dataset, b: Array) -> Dataset:
        wrench = data.wrench.copy()
        wrench[:, :3] += size * b
        return replace(data, wrench=wrench)

    return change


def _point(data: Dataset, b: Array) -> Dataset:
    return replace(data, point=data.point + POINT * b)


def _station(data: Dataset, name: int) -> Change:
    own = read_by(data, name)
    centre = data.after[data.seen].mean(axis=0)

    def change(data: Dataset, b: Array) -> Dataset:
        moved = SHIFT * (b[:3] + np.cross(b[3:], data.after - centre))
        return replace(data, after=np.where(own[:, None, None], data.after - moved, data.after))

    return change


def _factor(mask: Mask) -> Change:
    def change(data: Dataset, b: Array) -> Dataset:
        wrench = data.wrench.copy()
        wrench[mask] *= 1 + FACTOR * b[0]
        return replace(data, wrench=wrench)

    return change


def _single(fitted: Fitted) -> Iterator[Suspect]:
    """Single runs with another load, single runs and single readings that are of anything."""
    read, data = fitted.read, fitted.data
    expected = (read.A @ fitted.pi).ravel()
    size = BUMP / np.repeat(read.unit, 3)
    ends = np.searchsorted(read.run, np.arange(data.runs + 1))
    for r, (first, end) in enumerate(pairwise(ends)):
        if first == end:
            continue
        name, own = str(data.run[r]), slice(3 * first, 3 * end)
        load = of_columns(fitted, FACTOR * expected[own, None], own)
        yield Suspect("run_load", name, load, FACTOR)
        yield Suspect("run", name, of_columns(fitted, np.diag(size[own]), own), BUMP)
        for k in range(first, end):
            one, target = slice(3 * k, 3 * k + 3), read.marker[k]
            label = f"{name} {data.markers[target]}" if target >= 0 else f"{name} the tool's turn"
            yield Suspect("reading", label, of_columns(fitted, np.diag(size[one]), one), BUMP)
