"""Joints of the drawn arm along a path of the tool: continuous, within limits, with least motion."""

from dataclasses import replace

import numpy as np

from testbench.correct.reach import Reached, reach, turn_between
from testbench.data.dataset import Ids
from testbench.errors import Array, BenchError, check_array
from testbench.model.vjm import Vjm

STRIDE, TURN = 0.1, 0.2
"""Way from one support of a path to the next, over the arm's reach [1], and the turn that is as far [rad]."""
APART = 0.5  #: Motion of a joint from one support to the next beyond which one between them is solved first.
STEADY = 0.1  #: Motion between two points that needs no second look, beyond what their supports say.
REPEATS = 16  #: Times that the rest of a path is done again.
SEEDS = 256  #: Configurations that the first point is looked for from.
TRIED = 8  #: Configurations of the first point along which the path is tried.
CLEAR = 0.05  #: Room to the limits that the first point should have [rad, m].


def joints_along(
    vjm: Vjm, position: Array, rotation: Array, *, start: Array | None = None, point: Array | None = None
) -> Reached:
    """Joints that put a point of the tool where it should be, along a path.

    Supports are solved one after the other, each from the last one, and all points between them at once.
    Points that cannot be reached are left as near as the configuration of their neighbours leads.

    Args:
        vjm: The arm as drawn.
        position: Of the point, world, (points, 3) [m].
        rotation: World from tool, (points, 3, 3).
        start: Joints near the first point, (n,), or near every point, (points, n) [rad, m]. Without any,
            configurations are tried, the nearest to zero first, until the whole path is reached.
        point: In the tool's frame, (3,) or (points, 3) [m]; its origin if not given.

    Returns:
        The joints, (points, n) [rad, m], and how far the tool stays away where it cannot reach.
    """
    position = check_array(position, (None, 3), "position [m]")
    rotation = check_array(rotation, (len(position), 3, 3), "rotation")
    if point is not None:
        position = position - np.matvec(rotation, point)
    if start is not None and np.ndim(start) > 1:
        near = check_array(start, (len(position), vjm.arm.n_joints), "start [rad, m]")
        return reach(vjm, position, rotation, near)
    best: Reached | None = None
    for q in _first(vjm, position[:1], rotation[:1], start):
        found = _track(vjm, position, rotation, q)
        if best is None or found.there.sum() > best.there.sum():
            best = found
        if best.there.all():
            break
    if best is None:
        raise BenchError("position [m]: expected at least one point")
    return best


def _first(vjm: Vjm, position: Array, rotation: Array, start: Array | None) -> Array:
    """Joints of the first point, the best first, (tries, n) [rad, m]."""
    arm, (lower, upper) = vjm.arm, vjm.arm.limits
    if start is not None:
        start = check_array(start, (arm.n_joints,), "start [rad, m]")
        own = reach(vjm, position, rotation, start[None])
        if own.there.all():
            return own.q
    near = np.clip(0.0 if start is None else start, lower, upper)
    seeds = np.random.default_rng(0).uniform(lower, upper, (SEEDS, arm.n_joints))
    many = reach(vjm, np.tile(position, (SEEDS, 1)), np.tile(rotation, (SEEDS, 1, 1)), seeds)
    if not many.there.any():
        return many.q[[np.argmin(many.distance + vjm.reach * many.angle)]]
    q = _unwound(vjm, many.q[many.there], near)
    away = np.linalg.norm(q - near, axis=1)
    tight = np.minimum(q - lower, upper - q).min(axis=1) < CLEAR
    order = np.lexsort((away, tight))
    kept: list[Array] = []
    for own_q in q[order]:
        if len(kept) < (TRIED if start is None else 1) and all(np.abs(own_q - k).max() > CLEAR for k in kept):
            kept.append(own_q)
    return np.array(kept)


def _unwound(vjm: Vjm, q: Array, near: Array) -> Array:
    """The same with whole turns taken out of hinges, as far as limits let them come near."""
    lower, upper = vjm.arm.limits
    hinges = np.array([not joint.prismatic for joint in vjm.arm.joints])
    other = q - 2 * np.pi * np.round((q - near) / (2 * np.pi)) * hinges
    return np.where((other >= lower) & (other <= upper), other, q)


def _track(vjm: Vjm, position: Array, rotation: Array, first: Array) -> Reached:
    """Joints along a path from those near its first point on.

    Where branches nearly meet, a support may lie on another branch than the points before it. Then the rest
    is done again from these points; if that leads nowhere, the points before are, from the support back.
    """
    found, rough = _pass(vjm, position, rotation, first)
    tried = -1
    for _ in range(REPEATS):
        i = next((i for i in rough.tolist() if i > tried), None)
        if i is None:
            break
        tried, after = i, np.arange(i, len(position))
        rest, more = _pass(vjm, position[after], rotation[after], found.q[i])
        if rest.there.sum() >= found.there[after].sum() and 0 not in more:
            found, rough = _with(found, rest, after, after - i), i + more
            continue
        before = np.arange(i + 1, -1, -1)
        back, _ = _pass(vjm, position[before], rotation[before], found.q[i + 1])
        gap = np.abs(back.q[::-1][1:] - found.q[: i + 1]).max(axis=1)
        meet = int(np.argmin(gap)) + 1
        own = np.arange(meet, i + 2)
        if gap[meet - 1] < STEADY and back.there[: len(own)].sum() >= found.there[own].sum():
            found = _with(found, back, own, i + 1 - own)
    return found


def _pass(vjm: Vjm, position: Array, rotation: Array, first: Array) -> tuple[Reached, Ids]:
    """Joints along a path, and the points, (jumps,), behind which they jump."""
    turn = np.linalg.norm(turn_between(rotation[:-1], rotation[1:]), axis=1)
    step = np.linalg.norm(np.diff(position, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(step / (STRIDE * vjm.reach) + turn / TURN + 1e-9)])
    at, q = _supports(vjm, position, rotation, way, first)
    start = np.stack([np.interp(way, way[at], own) for own in q.T], axis=1)
    steady = np.abs(np.diff(start, axis=0)) * 2 + STEADY
    found = _again(vjm, position, rotation, reach(vjm, position, rotation, start))

    def rough() -> Ids:
        return np.flatnonzero((np.abs(np.diff(found.q, axis=0)) > steady).any(axis=1))

    for k in np.unique(np.searchsorted(at, rough(), side="right") - 1).tolist():
        found = _one_by_one(vjm, position, rotation, found, np.arange(at[k] + 1, at[k + 1]))
    return found, rough()


def _supports(vjm: Vjm, position: Array, rotation: Array, way: Array, first: Array) -> tuple[Ids, Array]:
    """Points that are solved one after the other, and their joints, (supports, n) [rad, m]."""

    def solve(j: int, q: Array) -> Reached:
        return reach(vjm, position[[j]], rotation[[j]], q[None])

    at, i, last = [0], 0, len(way) - 1
    joints = [solve(0, first).q[0]]
    while i < last:
        j = max(i + 1, int(np.searchsorted(way, way[i] + 1, side="right")) - 1)
        found, halved = solve(j, joints[-1]), False
        while j > i + 1 and not (halved and not found.there[0]):
            if found.there[0] and np.abs(found.q[0] - joints[-1]).max() <= APART:
                break
            j, halved = (i + j) // 2, True
            found = solve(j, joints[-1])
        at.append(j)
        joints.append(found.q[0])
        i = j
    return np.array(at), np.array(joints)


def _again(vjm: Vjm, position: Array, rotation: Array, found: Reached) -> Reached:
    """What was not reached, tried once more from the nearest points that were."""
    there = np.flatnonzero(found.there)
    lost = np.flatnonzero(~found.there)
    if not len(there) or not len(lost):
        return found
    right = np.minimum(np.searchsorted(there, lost), len(there) - 1)
    left = np.maximum(right - 1, 0)
    nearer = np.where(np.abs(there[left] - lost) < np.abs(there[right] - lost), left, right)
    other = reach(vjm, position[lost], rotation[lost], found.q[there[nearer]])
    return _with(found, other, lost[other.there], np.flatnonzero(other.there))


def _one_by_one(vjm: Vjm, position: Array, rotation: Array, found: Reached, points: Ids) -> Reached:
    """Some points, each from the one before."""
    for i in points.tolist():
        own = reach(vjm, position[[i]], rotation[[i]], found.q[[i - 1]])
        if own.there[0]:
            found = _with(found, own, np.array([i]), np.array([0]))
    return found


def _with(found: Reached, other: Reached, where: Ids, which: Ids) -> Reached:
    """Some points replaced by others."""
    parts = {name: getattr(found, name).copy() for name in Reached.__match_args__}
    for name, values in parts.items():
        values[where] = getattr(other, name)[which]
    return replace(found, **parts)
