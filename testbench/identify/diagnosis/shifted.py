"""Readings that slipped against their poses from some row on, as where a cell of a table was deleted."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Ids
from testbench.errors import Array
from testbench.identify.diagnosis.place import Fit, Free, Seen, away, fit, losses, residuals
from testbench.model.vjm import chain

ENOUGH = 300  #: Rows that tell frame and targets, or whether anything slipped.
LEAST = 12  #: Rows of a sound beginning, and of what slipped.


@dataclass(frozen=True)
class Slip:
    """From a row on all readings belong to another pose."""

    first: int  #: That row, counted from 0.
    shift: int  #: 1 for the pose before, -1 for the one after.
    q: Array  #: The joint angles that the readings belong to, (poses, n) [rad, m].
    was: float  #: Median distance from the arm of the readings from there on [m].
    now: float  #: The same in the angles that they belong to [m].


def slipped(seen: Seen, free: Free, far: float, better: float) -> Slip | None:
    """Where readings begin to be those of the pose before or after, while the rows before are sound.

    Args:
        seen: The readings, in the order of the file.
        free: What is free.
        far: Distance from which a reading does not fit [m].
        better: What a reading has to gain [nats].
    """
    head = _head(seen, free, far)
    if head is None or _many(seen, head, far, np.arange(len(seen.q))[-ENOUGH:]) < LEAST:
        return None
    own = losses(residuals(seen, chain(seen.vjm, seen.q), head), seen.scale).sum(axis=1)
    cost, first, shift, q = min(_tried(seen, head, own, better), key=lambda one: one[0])
    while first > 1 and _many(seen, head, far, np.array([first - 1])):
        first -= 1  # the row that was deleted has no pose at all
    if own.sum() - cost <= better * seen.there[first:].sum():
        return None
    slip = Slip(first, shift, q, *(_typical(seen, head, angles, first) for angles in (seen.q, q)))
    return slip if slip.now < far else None


def _tried(seen: Seen, head: Fit, own: Array, better: float) -> Iterator[tuple[float, int, int, Array]]:
    """What all readings cost if they slipped one way from the row that is best [nats], the row, the way."""
    rows = np.arange(len(seen.q))[:, None]
    for shift in (1, -1):
        q = np.roll(seen.q, shift, axis=0)
        other = losses(residuals(seen, chain(seen.vjm, q), head), seen.scale).sum(axis=1)
        cost = np.cumsum(own - other)[:-LEAST] + other.sum()
        alike = cost < cost.min() + better * seen.there.shape[1]  # a row that was inserted fits either way
        first = 1 + int(np.flatnonzero(alike)[-1])
        yield float(cost.min()), first, shift, np.where(rows < first, seen.q, q)


def _head(seen: Seen, free: Free, far: float) -> Fit | None:
    """Frame and targets by a beginning of the rows, the longest that fits; None if none does."""
    rows = len(seen.q) // 2
    while rows >= LEAST:
        some = np.unique(np.linspace(0, rows - 1, min(ENOUGH, rows)).astype(int))
        one = _rows(seen, some)
        if not one.there.any():
            return None
        found = fit(one, free)
        if np.median(away(one, found)) < far:
            return found
        rows //= 2
    return None


def _rows(seen: Seen, some: Ids) -> Seen:
    return replace(seen, q=seen.q[some], read=seen.read[some], there=seen.there[some])


def _many(seen: Seen, head: Fit, far: float, rows: Ids) -> int:
    """How many of some rows do not fit."""
    one = _rows(seen, rows)
    return int((np.linalg.norm(residuals(one, chain(one.vjm, one.q), head), axis=2) > far).any(axis=1).sum())


def _typical(seen: Seen, found: Fit, q: Array, first: int) -> float:
    """Median distance of readings from a row on [m]; 0 without any."""
    size = np.linalg.norm(residuals(seen, chain(seen.vjm, q), found)[first:], axis=2)[seen.there[first:]]
    return float(np.median(size)) if len(size) else 0.0
