"""Single mistakes that move readings against the arm's kinematics: a frame, a unit, a joint, a target."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, permutations

import numpy as np

from testbench.identify.doubts.geometry import Free, Rigid, Seen, losses
from testbench.model.vjm import tool_points

UNITS = {
    1e-3: "1000 times too large: millimetres read as metres?",
    1e-2: "100 times too large: centimetres read as metres?",
    0.1: "10 times too large: millimetres read as centimetres?",
    0.0254: "39.4 times too large: inches read as metres?",
    1 / 25.4: "25.4 times too large: millimetres read as inches?",
    10.0: "10 times too small: centimetres read as millimetres?",
    25.4: "25.4 times too small: inches read as millimetres?",
    1e3: "1000 times too small: metres read as millimetres?",
}
"""What is to be multiplied with, and what that means."""
FEW = 4  #: Targets up to which every order of their names is tried; of more, one exchange of two.
CHOICE = 2  #: Free numbers that a choice among many counts as.


@dataclass(frozen=True)
class Mistake:
    """One mistake."""

    name: str  #: A word for programs.
    words: str  #: What it is.
    seen: Seen  #: The readings with what can be mended at once.
    free: Free  #: What is found by a fit.
    numbers: int = 0  #: What the choice counts as, beside what is free.


def mistakes(seen: Seen, free: Free, frame: Rigid) -> Iterator[Mistake]:
    """All single mistakes that are tried, beside what is free anyway.

    Args:
        seen: The readings.
        free: What is free anyway.
        frame: In which they fit best without a mistake.
    """
    if not free.frame:
        yield Mistake("frame", "", seen, replace(free, frame=True))
    if not free.targets:
        yield Mistake("targets", "", seen, replace(free, targets=True))
    left = replace(free, frame=True, mirrored=True)
    yield Mistake("mirrored", "lie in a left-handed frame: the sign of an axis?", seen, left)
    for factor, words in UNITS.items():
        yield Mistake("unit", f"are {words}", replace(seen, read=factor * seen.read), free, CHOICE)
    turning = np.array([not joint.prismatic for joint in seen.vjm.arm.joints])
    for factor, words in ((np.rad2deg(1), "radians, not degrees"), (np.deg2rad(1), "degrees, not radians")):
        q = np.where(turning, factor * seen.q, seen.q)
        yield Mistake("angle_unit", f"fit if joint angles are {words}", replace(seen, q=q), free, CHOICE)
    for shift, words in ((1, "before"), (-1, "after")):
        words = f"are those of the pose {words}"
        yield Mistake("order", words, replace(seen, q=np.roll(seen.q, shift, axis=0)), free, CHOICE)
    for k in range(1, len(seen.vjm.arm.links) - 1):
        yield Mistake("link", seen.vjm.arm.links[k].name, seen, replace(free, link=k))
    yield from _markers(seen, free, frame)
    yield from _joints(seen, free)


def exchanges(seen: Seen, frame: Rigid) -> Iterator[list[int]]:
    """Other orders of the targets: all of a few; of more the exchange of two that fits best in a frame."""
    m = len(seen.markers)
    if m <= FEW:
        yield from (list(order) for order in list(permutations(range(m)))[1:])
        return
    places = frame.of(tool_points(seen.vjm, seen.q, seen.markers))
    pairs = np.empty((m, m))  # of a place and the target that was read there
    for k in range(m):
        off = np.where(seen.there[..., None], places[:, [k]] - seen.read, 0)
        pairs[k] = losses(off, seen.scale).sum(axis=0)
    own = np.diag(pairs)
    change = pairs + pairs.T - own - own[:, None]
    change[np.diag_indices(m)] = np.inf
    i, j = divmod(int(change.argmin()), m)
    yield [j if k == i else i if k == j else k for k in range(m)]


def _markers(seen: Seen, free: Free, frame: Rigid) -> Iterator[Mistake]:
    for order in exchanges(seen, frame):
        own = replace(seen, read=seen.read[:, order], there=seen.there[:, order])
        wrong = [seen.names[k] for k, other in enumerate(order) if k != other]
        words = f"of {', '.join(wrong)} have each other's names"
        yield Mistake("markers", words, own, free, CHOICE)


def _joints(seen: Seen, free: Free) -> Iterator[Mistake]:
    joints = seen.vjm.arm.joints
    for k, joint in enumerate(joints):
        q = seen.q.copy()
        q[:, k] *= -1
        words = f"fit if {joint.name} has the other sign"
        yield Mistake("joint_sign", words, replace(seen, q=q), free, CHOICE)
        yield Mistake("joint_zero", joint.name, seen, replace(free, joint=k), 1)
    for i, j in combinations(range(len(joints)), 2):
        order = list(range(len(joints)))
        order[i], order[j] = j, i
        words = f"fit if {joints[i].name} and {joints[j].name} are exchanged"
        yield Mistake("joint_order", words, replace(seen, q=seen.q[:, order]), free, CHOICE)
