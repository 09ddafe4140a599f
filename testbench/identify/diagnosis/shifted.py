"""Readings that slipped against their poses from some row on, as where a cell of a table was deleted."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from testbench.errors import Array, Ids
from testbench.identify.diagnosis.place import Fit, Free, Seen, fit, losses, residuals
from testbench.model.vjm import chain

ENOUGH = 300  #: Rows that tell frame and targets, or whether anything slipped.
LEAST = 3  #: Rows of half a file, and of what slipped.


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
    head = _half(seen, free, slice(len(seen.q) // 2))
    if head is None or _many(seen, head, far, np.arange(len(seen.q))[-ENOUGH:]) < LEAST:
        return None
    _, gain, first, shift, found = min(_tried(seen, free, head, better), key=lambda one: one[0])
    while first > 1 and _many(seen, found, far, np.array([first - 1])):
        first -= 1  # the row that was deleted has no pose at all
    if gain <= better * seen.there[first:].sum() or _typical(seen, found, seen.q, slice(first)) > far:
        return None
    rest, q = slice(first, None), np.roll(seen.q, shift, axis=0)
    q[:first] = seen.q[:first]
    slip = Slip(first, shift, q, *(_typical(seen, found, angles, rest) for angles in (seen.q, q)))
    return slip if slip.now < far else None


def _tried(seen: Seen, free: Free, head: Fit, better: float) -> Iterator[tuple[float, float, int, int, Fit]]:
    """What all readings cost if they slipped one way from the row that is best, and what that gains [nats].

    With them the row, the way and the fit: of the first half, all sound, or of the second, all slipped.
    """
    own_chain = chain(seen.vjm, seen.q)
    for shift in (1, -1):
        moved = replace(seen, q=np.roll(seen.q, shift, axis=0))
        moved_chain = chain(seen.vjm, moved.q)
        for found in (head, _half(moved, free, slice(len(seen.q) // 2, None)) or head):
            own, other = (
                losses(residuals(seen, where, found), seen.scale).sum(axis=1)
                for where in (own_chain, moved_chain)
            )
            cost = np.cumsum(own - other)[:-LEAST] + other.sum()
            alike = cost < cost.min() + better * seen.there.shape[1]  # an inserted row fits either way
            first = 1 + int(np.flatnonzero(alike)[-1])
            yield float(cost.min()), float(own.sum() - cost.min()), first, shift, found


def _half(seen: Seen, free: Free, half: slice) -> Fit | None:
    """Frame and targets by half of the rows; None where there are too few."""
    rows = np.arange(len(seen.q))[half]
    some = np.unique(rows[np.linspace(0, len(rows) - 1, min(ENOUGH, len(rows))).astype(int)])
    one = _rows(seen, some)
    return fit(one, free) if len(rows) >= LEAST and one.there.any() else None


def _rows(seen: Seen, some: Ids) -> Seen:
    return replace(seen, q=seen.q[some], read=seen.read[some], there=seen.there[some])


def _many(seen: Seen, head: Fit, far: float, rows: Ids) -> int:
    """How many of some rows do not fit."""
    one = _rows(seen, rows)
    return int((np.linalg.norm(residuals(one, chain(one.vjm, one.q), head), axis=2) > far).any(axis=1).sum())


def _typical(seen: Seen, found: Fit, q: Array, part: slice) -> float:
    """Median distance of readings in some rows [m]; 0 without any."""
    size = np.linalg.norm(residuals(seen, chain(seen.vjm, q), found)[part], axis=2)[seen.there[part]]
    return float(np.median(size)) if len(size) else 0.0
