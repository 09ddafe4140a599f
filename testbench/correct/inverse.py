"""Joints of the drawn arm along a path of the tool: continuous, within limits, with least motion.

`reach` puts the tool into poses by damped Newton within limits, all poses at once. Supports of a path are
guessed at once, then every one is found again from its left neighbour, until none changes: the same joints as
one by one, for only those behind a change are open. The points between start from their supports' joints.
"""

import math
from dataclasses import dataclass

import numpy as np

from testbench.correct.newton import Target
from testbench.correct.rest import replaced
from testbench.data.dataset import in_order, joined
from testbench.errors import Array, BenchError, Ids, Mask, check_array
from testbench.model.tool_motion import tool_motion, turn_between
from testbench.model.vjm import Vjm

THERE = 1e-9  #: A tool this close to its pose has reached it [m, rad].
TINY = 1e-12  #: Error at which a pose is left alone [m].
LEVER = 0.25  #: Radius at which a wrong orientation counts, over the arm's reach [1].
DAMPING = 1e-2  #: Of the first step, over the squared error: it fades as the tool comes near [1].
FLOOR = 1e-14  #: Damping that stays, over the square of the lever [1].
LARGEST = 0.5  #: Largest motion of a joint in one step [rad, m].
STALLED, PATIENCE = 1e-4, 4
"""Relative gain of a step that leads nowhere [1], and how many of these it takes to give a pose up."""
MOST = 60  #: Steps.


@dataclass(frozen=True)
class Reached:
    """Joints, and how far the tool stays away."""

    q: Array  #: Within the limits, (poses, n) [rad, m].
    distance: Array  #: From the tool to where it should be, (poses,) [m].
    angle: Array  #: Between its orientation and what it should be, (poses,) [rad].

    @property
    def there(self) -> Mask:
        """Which poses are reached, (poses,)."""
        return np.asarray((self.distance <= THERE) & (self.angle <= THERE))


def reach(vjm: Vjm, target: Target, start: Array) -> Reached:
    """Joints near others that put the tool's origin into poses; where none do, as near as these lead.

    Damped least squares with least motion. A joint at its limit that would go on stays there.

    Args:
        vjm: The arm as drawn.
        target: Poses of the tool's origin.
        start: Joints to start from, (poses, n) [rad, m].
    """
    lever = LEVER * vjm.reach
    q = vjm.arm.within(start)
    e, J = _error(vjm, lever, q, target)
    cost, damping, dull = _square(e), np.full(len(q), DAMPING), np.zeros(len(q), dtype=int)
    for _ in range(MOST):
        some = np.flatnonzero((cost > TINY**2) & (dull < PATIENCE))
        if not len(some):
            break
        weight = damping[some] * cost[some] + FLOOR * lever**2
        trial = vjm.arm.within(q[some] + _step(J[some], e[some], weight, q[some], vjm.arm.limits))
        e_trial, J_trial = _error(vjm, lever, trial, in_order(target, some))
        gain = 1 - _square(e_trial) / cost[some]
        better = gain > 0
        taken = some[better]
        q[taken], e[taken], J[taken] = trial[better], e_trial[better], J_trial[better]
        cost[taken] = _square(e[taken])
        damping[some] *= np.where(better, 0.2, 10.0)
        dull[some] = np.where(gain > STALLED, 0, dull[some] + 1)
    return Reached(q, np.linalg.norm(e[:, :3], axis=1), np.linalg.norm(e[:, 3:], axis=1) / lever)


def _square(e: Array) -> Array:
    return np.asarray((e * e).sum(axis=1))


def _error(vjm: Vjm, lever: float, q: Array, target: Target) -> tuple[Array, Array]:
    """What is left to the pose, (poses, 6) [m], and how the joints take it away, (poses, 6, n)."""
    p, R, J = tool_motion(vjm, q)
    J[:, 3:] *= lever
    if vjm.arm.moves is not None:  # joints that follow others have no column of their own
        J = J @ vjm.arm.moves
    return np.hstack([target.position - p, lever * turn_between(R, target.rotation)]), J


def _step(J: Array, e: Array, weight: Array, q: Array, limits: Array) -> Array:
    """Least motion of the joints that takes most of the error away, (poses, n) [rad, m]."""
    step = _damped(J, e, weight)
    blocked = ((q <= limits[0]) & (step < 0)) | ((q >= limits[1]) & (step > 0))
    some = np.flatnonzero(blocked.any(axis=1))
    if len(some):
        step[some] = _damped(J[some] * ~blocked[some][:, None], e[some], weight[some])
    size = np.abs(step).max(axis=1, keepdims=True)
    return np.asarray(step * np.minimum(1, LARGEST / np.maximum(size, LARGEST)))


def _damped(J: Array, e: Array, weight: Array) -> Array:
    """J^T (J J^T + weight)^-1 e, (poses, n)."""
    A = J @ J.swapaxes(1, 2)
    A[:, range(6), range(6)] += weight[:, None]
    return np.asarray((J.swapaxes(1, 2) @ np.linalg.solve(A, e[..., None]))[..., 0])


STRIDE, TURN = 0.1, 0.2
"""Way from one support of a path to the next, over the arm's reach [1], and the turn that is as far [rad]."""
STEADY, FASTEST = 0.1, 3.0
"""Motion between two points that needs no second look, beyond what their supports say [rad, m], a stride."""
REPEATS = 4  #: Times that a part of a path is done again.
SEEDS = 256  #: Configurations that the first point is looked for from.
TRIED = 8  #: Configurations of the first point that are tried,
SAMPLE = 400  #: and at most so many points of the path with each.
CLEAR = 0.05  #: Room to the limits that the first point should have [rad, m].
SAME = 0.05  #: Joints that differ by less are one configuration [rad, m].
APART = 0.5  #: Motion of a joint from one support to the next beyond which one is put between them [rad, m].
CLOSER = 0.9  #: What a pose out of reach must come closer for another configuration to count [1].
HALVINGS = 20  #: More than any program's points between two supports have.


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
    target = Target(position, rotation)
    if start is not None and np.ndim(start) > 1:
        near = check_array(start, (len(position), vjm.arm.n_joints), "start [rad, m]")
        return reach(vjm, target, near)
    if not len(position):
        raise BenchError("position [m]: expected at least one point")
    tries = _first(vjm, in_order(target, slice(1)), start)
    return _track(vjm, target, _chosen(vjm, target, tries))


def _chosen(vjm: Vjm, target: Target, tries: Array) -> Array:
    """The first of some joints of the first point from which most of the path is reached, (n,) [rad, m]."""
    if len(tries) == 1:
        return np.asarray(tries[0])
    some = np.arange(0, len(target.position), math.ceil(len(target.position) / SAMPLE))
    counts: list[int] = []
    for q in tries:
        counts.append(int(_pass(vjm, in_order(target, some), q)[0].there.sum()))
        if counts[-1] == len(some):
            break
    return np.asarray(tries[int(np.argmax(counts))])


def _first(vjm: Vjm, target: Target, start: Array | None) -> Array:
    """Joints of the first point, the best first, (tries, n) [rad, m]."""
    arm, (lower, upper) = vjm.arm, vjm.arm.limits
    if start is not None:
        start = check_array(start, (arm.n_joints,), "start [rad, m]")
        own = reach(vjm, target, start[None])
        if own.there.all():
            return own.q
    near = arm.within(np.zeros(arm.n_joints) if start is None else start)
    seeds = arm.drawn(np.random.default_rng(0), SEEDS)
    many = reach(vjm, in_order(target, np.zeros(SEEDS, dtype=int)), seeds)
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
    other = q - 2 * np.pi * np.round((q - near) / (2 * np.pi)) * vjm.arm.turns
    return np.where((other >= lower) & (other <= upper), other, q)


def _track(vjm: Vjm, target: Target, first: Array) -> Reached:
    """Joints along a path from those near its first point on.

    Where branches nearly meet, a support may lie on another branch than the points before it. Then the rest
    is done again from these points; if that leads nowhere, the points before are, from the support back.
    """
    found, rough = _pass(vjm, target, first)
    tried = -1
    for _ in range(REPEATS):
        i = next((i for i in rough.tolist() if i > tried), None)
        if i is None:
            break
        tried, after = i, np.arange(i, len(target.position))
        rest, more = _pass(vjm, in_order(target, after), found.q[i])
        if rest.there.sum() >= found.there[after].sum() and 0 not in more:
            found, rough = replaced(found, after, rest), i + more
            continue
        before = np.arange(i + 1, -1, -1)
        back, _ = _pass(vjm, in_order(target, before), found.q[i + 1])
        gap = np.abs(back.q[::-1][1:] - found.q[: i + 1]).max(axis=1)
        meet = int(np.argmin(gap)) + 1
        own = np.arange(meet, i + 2)
        if gap[meet - 1] < STEADY and back.there[: len(own)].sum() >= found.there[own].sum():
            found = replaced(found, own, in_order(back, i + 1 - own))
    return found


def _pass(vjm: Vjm, target: Target, first: Array) -> tuple[Reached, Ids]:
    """Joints along a path, and the points, (jumps,), behind which they jump."""
    turn = np.linalg.norm(turn_between(target.rotation[:-1], target.rotation[1:]), axis=1)
    step = np.linalg.norm(np.diff(target.position, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(step / (STRIDE * vjm.reach) + turn / TURN + 1e-9)])
    places, q = supported(vjm, target, _strides(way), first)
    start = np.stack([np.interp(way, way[places], own) for own in q.T], axis=1)
    steady = STEADY + np.minimum(2 * np.abs(np.diff(start, axis=0)), FASTEST * np.diff(way)[:, None])
    found = _again(vjm, target, reach(vjm, target, start))
    jumps = (np.abs(np.diff(found.q, axis=0)) > steady).any(axis=1)
    return found, np.flatnonzero(jumps & found.there[1:] & found.there[:-1])


def _strides(way: Array) -> Ids:
    """Points about one apart along the way, with the first and the last one."""
    found = [0]
    while found[-1] < len(way) - 1:
        found.append(max(found[-1] + 1, int(np.searchsorted(way, way[found[-1]] + 1, side="right")) - 1))
    return np.array(found)


def _again(vjm: Vjm, target: Target, found: Reached) -> Reached:
    """What was not reached, tried once more from the nearest points that were."""
    there = np.flatnonzero(found.there)
    lost = np.flatnonzero(~found.there)
    if not len(there) or not len(lost):
        return found
    right = np.minimum(np.searchsorted(there, lost), len(there) - 1)
    left = np.maximum(right - 1, 0)
    nearer = np.where(np.abs(there[left] - lost) < np.abs(there[right] - lost), left, right)
    other = reach(vjm, in_order(target, lost), found.q[there[nearer]])
    return replaced(found, lost[other.there], in_order(other, np.flatnonzero(other.there)))


def settle(vjm: Vjm, target: Target, found: Reached, open_: Ids) -> Reached:
    """Joints of poses such that each follows from the one before; one that was reached stays so.

    Args:
        vjm: The arm as drawn.
        target: Of the tool's origin, the poses.
        found: A guess of each.
        open_: Which are looked at first, (k,), not the first pose.
    """
    while len(open_):
        own, old = reach(vjm, in_order(target, open_), found.q[open_ - 1]), in_order(found, open_)
        moved = np.abs(own.q - old.q).max(axis=1) > SAME
        nearer = own.distance + own.angle * vjm.reach < CLOSER * (old.distance + old.angle * vjm.reach)
        change = np.where(own.there, moved | ~old.there, nearer & ~old.there)
        found = replaced(found, open_[change], in_order(own, np.flatnonzero(change)))
        open_ = open_[change] + 1
        open_ = open_[open_ < len(found.q)]
    return found


def supported(vjm: Vjm, target: Target, places: Ids, first: Array) -> tuple[Ids, Array]:
    """Supports of a path, more where joints turn fast, and their joints, (supports,) and (supports, n).

    Args:
        vjm: The arm as drawn.
        target: Of the tool's origin, the path.
        places: Which points are supports, (k,).
        first: Joints near the first point, (n,) [rad, m].
    """
    found = reach(vjm, in_order(target, places), np.tile(first, (len(places), 1)))
    open_ = np.arange(1, len(places))
    for _ in range(HALVINGS):
        found = settle(vjm, in_order(target, places), found, open_)
        far = np.abs(np.diff(found.q, axis=0)).max(axis=1, initial=0) > APART
        wide = np.flatnonzero(far & found.there[1:] & found.there[:-1] & (np.diff(places) > 1))
        if not len(wide):
            break
        between = (places[wide] + places[wide + 1]) // 2
        own = reach(vjm, in_order(target, between), found.q[wide])
        order = np.argsort(np.concatenate([places, between]))
        places = np.concatenate([places, between])[order]
        found = in_order(joined([found, own]), order)
        open_ = np.flatnonzero(np.isin(places, between)) + 1
    return places, found.q
