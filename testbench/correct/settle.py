"""Poses that are solved each from the one before, yet many at a time.

q_j is what `reach` makes of q_{j-1}. All are guessed at once, then every one is found again from its left
neighbour, until none changes: the same joints as one by one, for only the points behind a change are open.
"""

import numpy as np

from testbench.correct.batches import at, joined, replaced
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
    while len(open_):
        own, old = reach(vjm, at(target, open_), found.q[open_ - 1]), at(found, open_)
        moved = np.abs(own.q - old.q).max(axis=1) > SAME
        nearer = own.distance + own.angle * vjm.reach < CLOSER * (old.distance + old.angle * vjm.reach)
        change = np.where(own.there, moved | ~old.there, nearer & ~old.there)
        found = replaced(found, open_[change], at(own, np.flatnonzero(change)))
        following = open_[change] + 1
        following = following[following < len(free)]
        open_ = following[free[following]]
    return found


def supported(vjm: Vjm, target: Target, places: Ids, first: Array) -> tuple[Ids, Array]:
    """Supports of a path, more where joints turn fast, and their joints, (supports,) and (supports, n).

    Args:
        vjm: The arm as drawn.
        target: Of the tool's origin, the path.
        places: Which points are supports, (k,).
        first: Joints near the first point, (n,) [rad, m].
    """
    found = reach(vjm, at(target, places), np.tile(first, (len(places), 1)))
    open_ = np.arange(1, len(places))
    for _ in range(HALVINGS):
        found = settle(vjm, at(target, places), found, open_, np.ones(len(places), dtype=bool))
        far = np.abs(np.diff(found.q, axis=0)).max(axis=1, initial=0) > APART
        wide = np.flatnonzero(far & found.there[1:] & found.there[:-1] & (np.diff(places) > 1))
        if not len(wide):
            break
        between = (places[wide] + places[wide + 1]) // 2
        own = reach(vjm, at(target, between), found.q[wide])
        order = np.argsort(np.concatenate([places, between]))
        places = np.concatenate([places, between])[order]
        found = at(joined([found, own]), order)
        open_ = np.flatnonzero(np.isin(places, between)) + 1
    return places, found.q
