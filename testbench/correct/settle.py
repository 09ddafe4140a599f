"""Poses that are solved each from the one before, yet many at a time.

q_j is what `reach` makes of q_{j-1}. All are guessed at once, then every one is found again from its left
neighbour, until none changes: the same joints as one by one, for only the points behind a change are open.
"""

import numpy as np

from testbench.correct.newton import Target
from testbench.correct.reach import Reached, reach
from testbench.data.dataset import Ids, Mask
from testbench.errors import Array
from testbench.model.vjm import Vjm

SAME = 0.05  #: Joints that differ by less are one configuration [rad, m].
APART = 0.5  #: Motion of a joint from one support to the next beyond which one is put between them [rad, m].
CLOSER = 0.9  #: What a pose out of reach must come closer for another configuration to count [1].
HALVINGS = 20  #: More than any program's points between two supports have.


def settle(vjm: Vjm, target: Target, found: Reached, open_: Ids, free: Mask) -> Reached:
    """Joints of poses such that each follows from the one before.

    Args:
        vjm: The arm as drawn.
        target: Of the tool's origin, the poses.
        found: A guess of each.
        open_: Which are looked at first, (k,), not the first pose.
        free: Which may change, (poses,). One that was reached stays so.
    """
    found = found.at(np.arange(len(found.q)))
    while len(open_):
        own, old = reach(vjm, target.of(open_), found.q[open_ - 1]), found.at(open_)
        moved = np.abs(own.q - old.q).max(axis=1) > SAME
        nearer = own.distance + own.angle * vjm.reach < CLOSER * (old.distance + old.angle * vjm.reach)
        change = np.where(own.there, moved | ~old.there, nearer & ~old.there)
        found = replaced(found, own.at(np.flatnonzero(change)), open_[change])
        following = open_[change] + 1
        following = following[following < len(free)]
        open_ = following[free[following]]
    return found


def supported(vjm: Vjm, target: Target, at: Ids, first: Array) -> tuple[Ids, Array]:
    """Supports of a path, more where joints turn fast, and their joints, (supports,) and (supports, n).

    Args:
        vjm: The arm as drawn.
        target: Of the tool's origin, the path.
        at: Which points are supports, (k,).
        first: Joints near the first point, (n,) [rad, m].
    """
    found = reach(vjm, target.of(at), np.tile(first, (len(at), 1)))
    open_ = np.arange(1, len(at))
    for _ in range(HALVINGS):
        found = settle(vjm, target.of(at), found, open_, np.ones(len(at), dtype=bool))
        far = np.abs(np.diff(found.q, axis=0)).max(axis=1, initial=0) > APART
        wide = np.flatnonzero(far & found.there[1:] & found.there[:-1] & (np.diff(at) > 1))
        if not len(wide):
            break
        between = (at[wide] + at[wide + 1]) // 2
        own = reach(vjm, target.of(between), found.q[wide])
        order = np.argsort(np.concatenate([at, between]))
        at = np.concatenate([at, between])[order]
        found = _joined(found, own).at(order)
        open_ = np.flatnonzero(np.isin(at, between)) + 1
    return at, found.q


def replaced(found: Reached, other: Reached, where: Ids) -> Reached:
    """Some poses, (k,), replaced by others."""
    q, distance, angle = found.q.copy(), found.distance.copy(), found.angle.copy()
    q[where], distance[where], angle[where] = other.q, other.distance, other.angle
    return Reached(q, distance, angle)


def _joined(found: Reached, other: Reached) -> Reached:
    return Reached(
        np.concatenate([found.q, other.q]),
        np.concatenate([found.distance, other.distance]),
        np.concatenate([found.angle, other.angle]),
    )
