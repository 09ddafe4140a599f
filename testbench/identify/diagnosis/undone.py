"""Single mistakes that move readings against the kinematics: each is undone, fitted again and weighed."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain, permutations
from typing import Literal

import numpy as np

from testbench.errors import Array
from testbench.identify.diagnosis.finding import Finding
from testbench.identify.diagnosis.joint_columns import couplings, orders
from testbench.identify.diagnosis.place import (
    PENALTY,
    STILL,
    Fit,
    Free,
    Seen,
    away,
    fit,
    losses,
)
from testbench.identify.diagnosis.shifted import slipped
from testbench.identify.registration import Frame
from testbench.model.vjm import tool_points

PRECISE = 1.5e-3  #: How far targets of a sound arm lie from its kinematics, over its reach [1].
UNITS = (1e-3, 1e-2, 0.1, 0.0254, 1 / 25.4, 10.0, 25.4, 1e3)
"""What positions may have to be multiplied with: millimetres, centimetres or inches, read as others."""
TURNS = (np.pi / 2, -np.pi / 2, np.pi)  #: Zeros of a hinge that another convention of its angle has [rad].
FEW = 4  #: Targets up to which every order of their names is tried; of more, one exchange of two.
HALF, MOST = 0.5, 0.95
"""Shares of the readings whose distance is told: of most where half fit in spite of a mistake."""
CHOICE = 2  #: Free numbers that a choice among many counts as.
BETTER, LEAST = 0.3, 20.0
"""Nats a reading, and in all, by which a mistake has to make the readings likelier to be a doubt."""
LOOSE, SHARE = ("targets", "link"), 0.9
"""Mistakes of many numbers, and the share of their gain from which others are preferred to them."""
TURN, SHIFT, TARGET = np.deg2rad(0.3), 15e-3, 25e-3
"""Least turn of a frame [rad], least shift of it or of a link, and least way of a target [m], of a doubt."""
ZERO, LAST = (np.deg2rad(0.5), 5e-3), 4.0
"""Least error of a joint's zero that is one [rad, m], and of the last joint's over it: targets may be off."""
LOST = 8.0  #: Median distance over a sound one from which readings do not fit the arm at all.


@dataclass(frozen=True)
class Hypothesis:
    """One mistake, undone as far as it can be at once."""

    kind: str
    seen: Seen  #: The readings without it.
    free: Free  #: What is found by a fit.
    where: tuple[str, ...] = ()
    size: float = 0.0  #: What was multiplied or added.
    numbers: int = 0  #: What the choice counts as, beside what is free.


def hypotheses(seen: Seen, free: Free, frame: Frame) -> Iterator[Hypothesis]:
    """All single mistakes that are tried, beside what is free anyway.

    Args:
        seen: The readings.
        free: What is free anyway.
        frame: In which they fit best without a mistake.
    """
    arm = seen.vjm.arm
    if not free.frame:
        yield Hypothesis("frame", seen, replace(free, frame=True))
    if not free.targets:
        yield Hypothesis("targets", seen, replace(free, targets=True))
    yield Hypothesis("mirrored", seen, replace(free, frame=True, mirrored=True))
    for k, link in enumerate(arm.links[1:-1], start=1):
        yield Hypothesis("link", seen, replace(free, theta=(6 * k, 6 * k + 1, 6 * k + 2)), (link.name,))
    for k, joint in enumerate(arm.joints):
        own = replace(free, theta=(6 * len(arm.links) + k,))
        yield Hypothesis("joint_zero", seen, own, (joint.name,), numbers=1)
    for order in () if free.lost else exchanges(seen, frame):
        wrong = tuple(seen.names[k] for k, other in enumerate(order) if k != other)
        other = replace(seen, read=seen.read[:, order], there=seen.there[:, order])
        yield Hypothesis("markers", other, free, wrong, numbers=CHOICE)
    for factor in UNITS:
        yield Hypothesis("unit", replace(seen, read=factor * seen.read), free, (), factor, CHOICE)
    if slip := slipped(seen, free, LOST * seen.scale, BETTER):
        first = str(seen.runs[slip.first])
        yield Hypothesis("order", replace(seen, q=slip.q), free, (first,), slip.shift, CHOICE + 1)
    # a turned wrist is as well one of another sign: that is likelier
    for kind, where, size, q in _joints(seen):
        numbers = CHOICE + (kind == "joint_zero")
        yield Hypothesis(kind, replace(seen, q=q), free, where, size, numbers)


def _joints(seen: Seen) -> Iterator[tuple[str, tuple[str, ...], float, Array]]:
    """Other joint angles: the kind of mistake, its joints, its size and the angles without it."""
    joints, q = seen.vjm.arm.joints, seen.q
    names, n = [joint.name for joint in joints], len(joints)
    hinge = np.array([not joint.prismatic for joint in joints], dtype=bool)
    for factor in (np.rad2deg(1), np.deg2rad(1)):
        yield "angle_unit", (), factor, np.where(hinge, factor * q, q)
    for shift in (1, -1):
        yield "order", (), shift, np.roll(q, shift, axis=0)
    for k, unit in enumerate(np.eye(n)):
        yield "joint_sign", (names[k],), -1.0, q * (1 - 2 * unit)
        for turn in TURNS if hinge[k] else ():
            yield "joint_zero", (names[k],), turn, q + turn * unit


def _columns(seen: Seen, free: Free) -> Iterator[Hypothesis]:
    """Joints in another order in the file, or that count another joint too."""
    names = [joint.name for joint in seen.vjm.arm.joints]
    for where, q in couplings(seen):
        yield Hypothesis("joint_coupling", replace(seen, q=q), free, where, numbers=CHOICE)
    for order in orders(seen, free):
        where = tuple(names[k] for k in np.argsort(order))
        yield Hypothesis("joint_order", replace(seen, q=seen.q[:, order]), free, where, numbers=CHOICE)


def exchanges(seen: Seen, frame: Frame) -> Iterator[list[int]]:
    """Other orders of the targets: all of a few; of more the exchange of two that fits best in a frame."""
    m = len(seen.markers)
    if m <= FEW:
        yield from (list(order) for order in list(permutations(range(m)))[1:])
        return
    x = tool_points(seen.vjm, seen.q, seen.markers) @ frame.rotation.T + frame.translation
    pairs = np.empty((m, m))  # of a place and the target that was read there
    for k in range(m):
        pairs[k] = losses(np.where(seen.there[..., None], x[:, [k]] - seen.read, 0), seen.scale).sum(axis=0)
    own = np.diag(pairs)
    change = pairs + pairs.T - own - own[:, None]
    change[np.diag_indices(m)] = np.inf
    i, j = divmod(int(change.argmin()), m)
    yield [j if k == i else i if k == j else k for k in range(m)]


What = Literal["unloaded", "loaded", "all"]
"""Which readings are looked at."""


def placed(
    seen: Seen, free: Free, what: What = "unloaded", more: Iterable[Hypothesis] = ()
) -> tuple[Finding | None, Fit]:
    """Look for the mistake that explains readings best.

    Args:
        seen: The readings.
        free: What is free anyway, in a frame that is not the arm's.
        what: Which readings these are.
        more: What is tried beside.

    Returns:
        The mistake, if one explains them, and the readings with it undone, or as they are.
    """
    start = fit(seen, free)
    typical = _typical(seen, start)
    unfit = Finding("kinematics", (what,), beside={"now": typical}) if typical > LOST * seen.scale else None
    needed = max(LEAST, BETTER * seen.there.sum())
    if start.loss <= needed:  # no mistake saves more than the loss
        return unfit, start
    every = chain(hypotheses(seen, free, start.frame), _columns(seen, free), more)
    tried = [(own, fit(own.seen, own.free)) for own in every]
    gains = [start.cost - found.cost - PENALTY * own.numbers for own, found in tried]
    needed = max(needed, SHARE * float(max(gains)))
    good = [
        (float(gain), own, found)
        for gain, (own, found) in zip(gains, tried, strict=True)
        if gain > needed and _large(own, found)
    ]
    if not good:
        return unfit, start
    gain, best, found = max(good, key=lambda x: (x[1].kind not in LOOSE, x[0]))
    if _typical(best.seen, found) > LOST * seen.scale:
        return unfit, start
    share = HALF if _typical(best.seen, found) < HALF * typical else MOST
    beside = {"was": _typical(seen, start, share), "now": _typical(best.seen, found, share), "share": share}
    where = best.where
    if best.kind == "targets":
        where = (seen.names[int(np.argmax(np.linalg.norm(found.markers - seen.markers, axis=1)))],)
    return Finding(best.kind, (what, *where), _size(best, found), beside, gain), found


def _typical(seen: Seen, own: Fit, share: float = HALF) -> float:
    """Distance below which that share of the readings lies [m]."""
    return float(np.quantile(away(seen, own), share))


def _size(own: Hypothesis, found: Fit) -> Array:
    """How large a mistake is, SI: turn and shift of a frame, way of a target or link, else one number."""
    if own.kind == "frame":
        return np.concatenate([found.frame.rotation_vector, found.frame.translation])
    if own.kind == "targets":
        off = found.markers - own.seen.markers
        return np.asarray(off[np.argmax(np.linalg.norm(off, axis=1))])
    if own.kind == "link":
        beam = own.seen.vjm.arm.links[own.free.theta[0] // 6].frame
        return np.asarray(beam @ found.theta[list(own.free.theta)])
    return np.array([own.size + found.theta.sum()])


def _large(own: Hypothesis, found: Fit) -> bool:
    """Whether a mistake is larger than those of sound arms."""
    size = _size(own, found)
    if own.kind == "frame":
        return bool(np.linalg.norm(size[:3]) > TURN or np.linalg.norm(size[3:]) > SHIFT)
    least = {"targets": TARGET, "link": SHIFT}.get(own.kind, 0.0)
    if own.kind == "joint_zero":
        joints = own.seen.vjm.arm.joints
        k = [joint.name for joint in joints].index(own.where[0])
        least = (LAST if k == len(joints) - 1 else 1.0) * ZERO[joints[k].prismatic]
    return not least or bool(np.linalg.norm(size) > least)


APART = 8.0  #: Distance of a reading over a sound one from which it is wrong by itself.


def apart(seen: Seen, own: Fit) -> Iterator[tuple[int, Finding]]:
    """Single poses, and single readings, that lie off while most do not; with their pose."""
    off = np.linalg.norm(own.residual, axis=2)
    for row in np.flatnonzero((off > APART * seen.scale).any(axis=1)).tolist():
        run, typical = str(seen.runs[row]), float(np.median(off[row][seen.there[row]]))
        if typical > APART / 2 * seen.scale:
            where, size = _why(seen, own, row)
            found = Finding("pose", (run, *where), np.array([size]), {"off": typical})
        else:
            k = int(np.argmax(off[row]))
            found = Finding("reading", (run, seen.names[k]), beside={"off": float(off[row, k])})
        yield int(seen.poses[row]), found


def _why(seen: Seen, own: Fit, row: int) -> tuple[tuple[str, ...], float]:
    """Targets of a pose that may have each other's names, or a joint that may stand farther, and how far."""
    read = (seen.read[[row]] - own.frame.translation) @ own.frame.rotation
    one = replace(seen, q=seen.q[[row]], markers=own.markers, read=read, there=seen.there[[row]])
    tried = [
        (found.loss, hypothesis, found)
        for hypothesis in hypotheses(one, Free(), STILL)
        if hypothesis.kind == "markers" or (hypothesis.kind == "joint_zero" and hypothesis.free.theta)
        for found in (fit(hypothesis.seen, hypothesis.free),)
    ]
    fits = [x for x in tried if _typical(x[1].seen, x[2]) < APART * seen.scale]
    if not fits:
        return (), 0.0
    _, best, found = min(fits, key=lambda x: (x[1].kind != "markers", x[0]))
    return (best.kind, *best.where), float(found.theta.sum())
