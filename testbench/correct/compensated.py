"""Compensation of a program, and inverse kinematics of the rigid arm along a path of the tool.

`compensate` is the last step of the flow: model, programmed joints and loads in, joints to command out. They
are within the limits, with the remaining error and its interval. A point that cannot be corrected keeps its
programmed joints and has a reason.

`joints_along_path` converts a Cartesian program to joints for `compensate`. `solve_inverse_kinematics` puts
the tool into all poses at once by damped Newton steps within limits. A path has knots: points about
`KNOT_DISTANCE` apart. All knots are solved at once; then every knot is solved again from the joints of the
knot before it, until none changes. The result is the same as solving one after the other, because only knots
after a change are solved again. The points between start from joints interpolated between their knots.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import NoneType
from typing import Literal

import numpy as np

from testbench.arm.folder import Arm
from testbench.correct.newton import (
    Aim,
    InverseStaticsProblem,
    InverseStaticsSolution,
    JointMeaning,
    Target,
    assign_rows,
    equilibrium,
    programmed_target,
    replace_rows,
    solve_inverse_statics,
)
from testbench.correct.predicted import LoadedPoses, motion_half_widths
from testbench.data.dataset import concatenate_rows, select_rows
from testbench.display import Displayed, span
from testbench.errors import Array, BenchError, Ids, Mask, check_array, check_items, check_type
from testbench.identify.posterior import ArmModel
from testbench.model.load import Load
from testbench.model.vjm import Vjm, rotation_vectors_between, tool_pose_and_jacobian
from testbench.plant.site import Site, find_collisions

# --- Inverse kinematics of the rigid arm along a path of the tool: continuous joints within limits ----------

POSE_TOLERANCE = 1e-9  #: Distance and angle to its pose within which the tool has reached it [m, rad].
CONVERGED_ERROR = (
    1e-12  #: Error, rotation times lever included, below which a pose takes no further step [m].
)
ROTATION_LEVER = 0.25  #: Radius that turns an angle of orientation into a length, over the arm's reach [1].
INITIAL_DAMPING = (
    1e-2  #: Damping of the first step over the squared error [1]: it fades as the tool comes near.
)
MIN_DAMPING = 1e-14  #: Damping that stays, over the square of the lever [1].
MAX_JOINT_STEP = 0.5  #: Largest motion of a joint in one step [rad, m].
MIN_STEP_GAIN, MAX_STALLED_STEPS = 1e-4, 4
"""Relative gain below which a step counts as stalled [1], and stalled steps in a row that end a pose."""
MAX_STEPS = 60  #: Most steps.


@dataclass(frozen=True)
class InverseKinematics:
    """Hold joints, and the remaining distance of the tool from its poses."""

    q: Array  #: Joints within the limits, (poses, n) [rad, m].
    distance_error: Array  #: Distance of the tool from its target, (poses,) [m].
    angle_error: Array  #: Angle between the tool's orientation and its target, (poses,) [rad].

    @property
    def converged(self) -> Mask:
        """Tell which poses are reached within `POSE_TOLERANCE`, (poses,)."""
        return np.asarray((self.distance_error <= POSE_TOLERANCE) & (self.angle_error <= POSE_TOLERANCE))


def solve_inverse_kinematics(vjm: Vjm, target: Target, start: Array) -> InverseKinematics:
    """Find joints near others that put the tool's origin into poses; where none do, as near as these lead.

    It minimises the squared error by damped least squares, d = J^T (J J^T + weight 1)^-1 e, whose motion is
    short. A joint at its limit whose step would leave it stays there.

    Mathematics: `cor-9`.

    Args:
        vjm: Kinematics of the rigid arm.
        target: Poses of the tool's origin.
        start: Joints to start from, (poses, n) [rad, m].

    Returns:
        Joints within the limits, and the remaining distance and angle.
    """
    lever = ROTATION_LEVER * vjm.reach
    q = vjm.arm.clip_to_limits(start)
    e, J = _error(vjm, lever, q, target)
    cost = _square(e)
    damping = np.full(len(q), INITIAL_DAMPING)
    dull = np.zeros(len(q), dtype=int)
    for _ in range(MAX_STEPS):
        active = np.flatnonzero((cost > CONVERGED_ERROR**2) & (dull < MAX_STALLED_STEPS))
        if not len(active):
            break
        # Levenberg's damping, in proportion to the squared error
        weight = damping[active] * cost[active] + MIN_DAMPING * lever**2
        trial = vjm.arm.clip_to_limits(
            q[active] + _step(J[active], e[active], weight, q[active], vjm.arm.limits)
        )
        e_trial, J_trial = _error(vjm, lever, trial, select_rows(target, active))
        gain = 1 - _square(e_trial) / cost[active]
        # accept steps that come nearer: less damping after a gain, more after none (Levenberg-Marquardt)
        better = gain > 0
        taken = active[better]
        q[taken] = trial[better]
        e[taken] = e_trial[better]
        J[taken] = J_trial[better]
        cost[taken] = _square(e[taken])
        damping[active] *= np.where(better, 0.2, 10.0)
        dull[active] = np.where(gain > MIN_STEP_GAIN, 0, dull[active] + 1)
    return InverseKinematics(q, np.linalg.norm(e[:, :3], axis=1), np.linalg.norm(e[:, 3:], axis=1) / lever)


def _square(e: Array) -> Array:
    return np.asarray((e * e).sum(axis=1))


def _error(vjm: Vjm, lever: float, q: Array, target: Target) -> tuple[Array, Array]:
    """Compute the pose's error, rotation times lever, (poses, 6) [m], and its Jacobian, (poses, 6, n)."""
    p, R, J = tool_pose_and_jacobian(vjm, q)
    J[:, 3:] *= lever
    if vjm.arm.dependence_matrix is not None:  # joints that follow others have no column of their own
        J = J @ vjm.arm.dependence_matrix
    return np.hstack([target.position - p, lever * rotation_vectors_between(R, target.rotation)]), J


def _step(J: Array, e: Array, weight: Array, q: Array, limits: Array) -> Array:
    """Compute the damped step without blocked joints, each at most `MAX_JOINT_STEP`, (poses, n) [rad, m]."""
    step = _damped(J, e, weight)
    # a joint at its limit that would leave it is held, and the others take the step
    blocked = ((q <= limits[0]) & (step < 0)) | ((q >= limits[1]) & (step > 0))
    at_limit = np.flatnonzero(blocked.any(axis=1))
    if len(at_limit):
        step[at_limit] = _damped(J[at_limit] * ~blocked[at_limit][:, None], e[at_limit], weight[at_limit])
    size = np.abs(step).max(axis=1, keepdims=True)
    return np.asarray(step * np.minimum(1, MAX_JOINT_STEP / np.maximum(size, MAX_JOINT_STEP)))


def _damped(J: Array, e: Array, weight: Array) -> Array:
    """Solve the damped least squares J^T (J J^T + weight)^-1 e, (poses, n)."""
    A = J @ J.swapaxes(1, 2)
    A[:, range(6), range(6)] += weight[:, None]
    return np.asarray((J.swapaxes(1, 2) @ np.linalg.solve(A, e[..., None]))[..., 0])


KNOT_DISTANCE, KNOT_ROTATION = 0.1, 0.2
"""Distance between supports of a path over the arm's reach [1], and the rotation that counts as far [rad]."""
MAX_CONTINUOUS_MOTION, MAX_MOTION_PER_KNOT_DISTANCE = 0.1, 3.0
"""Motion between two points that is no jump: this one [rad, m] beyond twice that of the joints interpolated
between supports, which counts up to `MAX_MOTION_PER_KNOT_DISTANCE` per stride [rad, m]."""
MAX_JUMP_REPAIRS = 4  #: Most repairs of a path.
N_START_CONFIGURATIONS = 256  #: Random configurations from which the first point is solved.
MAX_TRIED_CONFIGURATIONS = 8  #: Configurations of the first point with which the path is tried.
MAX_TRIAL_POINTS = 400  #: Most points of the path that such a trial uses.
LIMIT_CLEARANCE = 0.05
"""Distance to the limits that the first point should keep, and between configurations to try [rad, m]."""
SAME_CONFIGURATION_TOLERANCE = 0.05  #: Largest difference of joints that count as one configuration [rad, m].
#: Motion of a joint between two supports from which one is added between them [rad, m].
MAX_JOINT_MOTION_BETWEEN_KNOTS = 0.5
#: Share of its error to which an unreached pose must come for new joints to replace it [1].
MAX_REMAINING_ERROR_SHARE = 0.9
MAX_KNOT_ROUNDS = 20  #: Most rounds that add supports: more than the points between two supports allow.


def joints_along_path(
    vjm: Vjm, position: Array, rotation: Array, *, start: Array | None = None, point: Array | None = None
) -> InverseKinematics:
    """Find joints that keep a point of the tool on a path, continuous from point to point.

    Supports are solved one after the other, each from the last one, and all points between them at once.
    Points that cannot be reached are left as near as the configuration of their neighbours leads.

    Args:
        vjm: Kinematics of the rigid arm.
        position: Positions of the point, world, (points, 3) [m].
        rotation: Orientations, world from tool, (points, 3, 3) [1].
        start: Joints near the first point, (n,), or near every point, (points, n) [rad, m]. None tries
            configurations, the nearest to zero first, until one reaches the whole path.
        point: The point in the tool's frame, (3,) or (points, 3) [m]; None for its origin.

    Returns:
        Joints, (points, n) [rad, m], and the remaining distance where the tool cannot reach.

    Raises:
        BenchError: When an array has another shape or is not finite, or there is no point.
    """
    position = check_array(position, (None, 3), "position [m]")
    rotation = check_array(rotation, (len(position), 3, 3), "rotation")
    if point is not None:
        position = position - np.matvec(rotation, point)
    target = Target(position, rotation)
    if start is not None and np.ndim(start) > 1:
        near = check_array(start, (len(position), vjm.arm.n_joints), "start [rad, m]")
        return solve_inverse_kinematics(vjm, target, near)
    if not len(position):
        raise BenchError("position [m]: expected at least one point")
    tries = _start_configurations(vjm, select_rows(target, slice(1)), start)
    return _follow_path(vjm, target, _best_start(vjm, target, tries))


def _best_start(vjm: Vjm, target: Target, tries: Array) -> Array:
    """Choose the first of some start configurations from which most of the path is reached, (n,) [rad, m]."""
    if len(tries) == 1:
        return np.asarray(tries[0])
    sample = np.arange(0, len(target.position), math.ceil(len(target.position) / MAX_TRIAL_POINTS))
    counts: list[int] = []
    for q in tries:
        counts.append(int(_follow_once(vjm, select_rows(target, sample), q)[0].converged.sum()))
        if counts[-1] == len(sample):
            break
    return np.asarray(tries[int(np.argmax(counts))])


def _start_configurations(vjm: Vjm, target: Target, start: Array | None) -> Array:
    """Find joints of the first point, the best first, (tries, n) [rad, m]."""
    arm, (lower, upper) = vjm.arm, vjm.arm.limits
    if start is not None:
        start = check_array(start, (arm.n_joints,), "start [rad, m]")
        reached = solve_inverse_kinematics(vjm, target, start[None])
        if reached.converged.all():
            return reached.q
    # Else from many random configurations, nearest to the start or to zero.
    near = arm.clip_to_limits(np.zeros(arm.n_joints) if start is None else start)
    seeds = arm.draw_poses(np.random.default_rng(0), N_START_CONFIGURATIONS)
    many = solve_inverse_kinematics(
        vjm, select_rows(target, np.zeros(N_START_CONFIGURATIONS, dtype=int)), seeds
    )
    if not many.converged.any():
        return many.q[[np.argmin(many.distance_error + vjm.reach * many.angle_error)]]
    # Away from the limits first, then the nearest.
    q = _unwind(vjm, many.q[many.converged], near)
    away = np.linalg.norm(q - near, axis=1)
    tight = np.minimum(q - lower, upper - q).min(axis=1) < LIMIT_CLEARANCE
    order = np.lexsort((away, tight))
    kept: list[Array] = []
    for own_q in q[order]:
        if len(kept) < (MAX_TRIED_CONFIGURATIONS if start is None else 1) and all(
            np.abs(own_q - k).max() > LIMIT_CLEARANCE for k in kept
        ):
            kept.append(own_q)
    return np.array(kept)


def configurations(vjm: Vjm, position: Array, rotation: Array) -> Array:
    """Find all joints that put the tool's origin into a pose, whole turns of hinges included.

    Args:
        vjm: Kinematics of the rigid arm.
        position: Position, world, (3,) [m].
        rotation: Orientation, world from tool, (3, 3) [1].

    Returns:
        Joints within the limits, (configurations, n) [rad, m].
    """
    seeds, (lower, upper) = (
        vjm.arm.draw_poses(np.random.default_rng(0), N_START_CONFIGURATIONS),
        vjm.arm.limits,
    )
    target = Target(
        np.tile(position, (N_START_CONFIGURATIONS, 1)), np.tile(rotation, (N_START_CONFIGURATIONS, 1, 1))
    )
    many = solve_inverse_kinematics(vjm, target, seeds)
    turns = [(-1, 0, 1) if full else (0,) for full in vjm.arm.full_turn_joints]
    shifts = 2 * np.pi * np.array([*itertools.product(*turns)], dtype=float)
    q = (many.q[many.converged][:, None] + shifts).reshape(-1, len(lower))
    q = q[((q >= lower) & (q <= upper)).all(axis=1)]
    _, first = np.unique(np.round(q / SAME_CONFIGURATION_TOLERANCE), axis=0, return_index=True)
    return np.asarray(q[first])


def _unwind(vjm: Vjm, q: Array, near: Array) -> Array:
    """Take whole turns out of hinges, as far as the limits let them come nearer to given joints."""
    lower, upper = vjm.arm.limits
    other = q - 2 * np.pi * np.round((q - near) / (2 * np.pi)) * vjm.arm.full_turn_joints
    return np.where((other >= lower) & (other <= upper), other, q)


def _follow_path(vjm: Vjm, target: Target, first: Array) -> InverseKinematics:
    """Follow a path from joints near its first point, and repair jumps.

    Where branches of the inverse kinematics nearly meet, a support may lie on another branch than the points
    before it. Then the rest is solved again from these points. If that leads nowhere, the points before are
    solved again, backwards from the support.
    """
    reached, rough = _follow_once(vjm, target, first)
    tried = -1
    for _ in range(MAX_JUMP_REPAIRS):
        i = next((i for i in rough.tolist() if i > tried), None)
        if i is None:
            break
        tried, after = i, np.arange(i, len(target.position))
        # forwards: the rest of the path from the joints before the jump
        rest, more = _follow_once(vjm, select_rows(target, after), reached.q[i])
        if rest.converged.sum() >= reached.converged[after].sum() and 0 not in more:
            reached, rough = replace_rows(reached, after, rest), i + more
            continue
        # backwards: from the joints behind the jump to where both branches meet
        before = np.arange(i + 1, -1, -1)
        back, _ = _follow_once(vjm, select_rows(target, before), reached.q[i + 1])
        gap = np.abs(back.q[::-1][1:] - reached.q[: i + 1]).max(axis=1)
        meet = int(np.argmin(gap)) + 1
        between = np.arange(meet, i + 2)
        if (
            gap[meet - 1] < MAX_CONTINUOUS_MOTION
            and back.converged[: len(between)].sum() >= reached.converged[between].sum()
        ):
            reached = replace_rows(reached, between, select_rows(back, i + 1 - between))
    return reached


def _follow_once(vjm: Vjm, target: Target, first: Array) -> tuple[InverseKinematics, Ids]:
    """Find joints along a path once, and the points, (jumps,), behind which they jump."""
    turn = np.linalg.norm(rotation_vectors_between(target.rotation[:-1], target.rotation[1:]), axis=1)
    step = np.linalg.norm(np.diff(target.position, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(step / (KNOT_DISTANCE * vjm.reach) + turn / KNOT_ROTATION + 1e-9)])
    places, q = path_knots(vjm, target, _support_places(way), first)
    start = np.stack([np.interp(way, way[places], joint) for joint in q.T], axis=1)
    # a motion well beyond the interpolated one is a jump to another branch
    steady = MAX_CONTINUOUS_MOTION + np.minimum(
        2 * np.abs(np.diff(start, axis=0)), MAX_MOTION_PER_KNOT_DISTANCE * np.diff(way)[:, None]
    )
    reached = _retry_unreached(vjm, target, solve_inverse_kinematics(vjm, target, start))
    jumps = (np.abs(np.diff(reached.q, axis=0)) > steady).any(axis=1)
    return reached, np.flatnonzero(jumps & reached.converged[1:] & reached.converged[:-1])


def _support_places(way: Array) -> Ids:
    """Select points about one stride apart along the way, the first and the last one among them."""
    places = [0]
    while places[-1] < len(way) - 1:
        places.append(max(places[-1] + 1, int(np.searchsorted(way, way[places[-1]] + 1, side="right")) - 1))
    return np.array(places)


def _retry_unreached(vjm: Vjm, target: Target, reached: InverseKinematics) -> InverseKinematics:
    """Try unreached points once more from the nearest points that were reached."""
    there = np.flatnonzero(reached.converged)
    lost = np.flatnonzero(~reached.converged)
    if not len(there) or not len(lost):
        return reached
    right = np.minimum(np.searchsorted(there, lost), len(there) - 1)
    left = np.maximum(right - 1, 0)
    nearer = np.where(np.abs(there[left] - lost) < np.abs(there[right] - lost), left, right)
    other = solve_inverse_kinematics(vjm, select_rows(target, lost), reached.q[there[nearer]])
    return replace_rows(reached, lost[other.converged], select_rows(other, np.flatnonzero(other.converged)))


def solve_from_predecessors(
    vjm: Vjm, target: Target, guess: InverseKinematics, unsolved: Ids
) -> InverseKinematics:
    """Solve poses again, each from the one before, until none changes; a reached pose stays reached.

    Args:
        vjm: Kinematics of the rigid arm.
        target: Poses of the tool's origin.
        guess: A guess of every pose.
        unsolved: Indices of the poses to solve first, (k,), the first pose not among them.

    Returns:
        Joints and remaining errors of all poses.
    """
    while len(unsolved):
        # solve from the left neighbour; where that changes a pose, the pose behind it is open again
        reached, old = (
            solve_inverse_kinematics(vjm, select_rows(target, unsolved), guess.q[unsolved - 1]),
            select_rows(guess, unsolved),
        )
        moved = np.abs(reached.q - old.q).max(axis=1) > SAME_CONFIGURATION_TOLERANCE
        nearer = reached.distance_error + reached.angle_error * vjm.reach < MAX_REMAINING_ERROR_SHARE * (
            old.distance_error + old.angle_error * vjm.reach
        )
        change = np.where(reached.converged, moved | ~old.converged, nearer & ~old.converged)
        guess = replace_rows(guess, unsolved[change], select_rows(reached, np.flatnonzero(change)))
        unsolved = unsolved[change] + 1
        unsolved = unsolved[unsolved < len(guess.q)]
    return guess


def path_knots(vjm: Vjm, target: Target, indices: Ids, first: Array) -> tuple[Ids, Array]:
    """Choose support points of a path, and find their joints; more points are chosen where joints turn fast.

    Args:
        vjm: Kinematics of the rigid arm.
        target: Poses of the tool's origin along the path.
        indices: Indices of the first supports, (k,).
        first: Joints near the first point, (n,) [rad, m].

    Returns:
        Indices of all supports, (supports,), and their joints, (supports, n) [rad, m].
    """
    supports = solve_inverse_kinematics(vjm, select_rows(target, indices), np.tile(first, (len(indices), 1)))
    open_ = np.arange(1, len(indices))
    for _ in range(MAX_KNOT_ROUNDS):
        # the supports so far, each from the one before
        supports = solve_from_predecessors(vjm, select_rows(target, indices), supports, open_)
        far = np.abs(np.diff(supports.q, axis=0)).max(axis=1, initial=0) > MAX_JOINT_MOTION_BETWEEN_KNOTS
        wide = np.flatnonzero(far & supports.converged[1:] & supports.converged[:-1] & (np.diff(indices) > 1))
        if not len(wide):
            break
        # halfway between supports whose joints are far apart a new one is added
        between = (indices[wide] + indices[wide + 1]) // 2
        reached = solve_inverse_kinematics(vjm, select_rows(target, between), supports.q[wide])
        order = np.argsort(np.concatenate([indices, between]))
        indices = np.concatenate([indices, between])[order]
        supports = select_rows(concatenate_rows([supports, reached]), order)
        open_ = np.flatnonzero(np.isin(indices, between)) + 1
    return indices, supports.q


# --- Compensation of a program ------------------------------------------------------------------------------

RefusalReason = Literal["reach", "equilibrium", "limit", "collision"]
"""Reasons to refuse a point: out of reach, no equilibrium, beyond a joint's limit, or a new collision."""


@dataclass(frozen=True)
class Refusal:
    """State why a point cannot be corrected."""

    reason: RefusalReason  #: The reason.
    involved_names: tuple[
        str, ...
    ] = ()  #: The joint that would pass its limit, or the two parts that would collide.
    excess: float = 0.0  #: Remaining distance [m], or how far beyond the limit [rad, m].


@dataclass(frozen=True, repr=False)
class Compensated(Displayed):
    """Hold the joints that bring the loaded tool to the poses of the program, and the errors."""

    q: Array  #: Joints to command, those of the program at refused points, (points, n) [rad, m].
    programmed_q: Array  #: Joints of the program, (points, n) [rad, m].
    target: Target  #: Poses of the program.
    error_before: Array  #: Predicted minus programmed position without correction, world, (points, 3) [m].
    error_after: Array  #: Predicted minus programmed position with it, world, (points, 3) [m].
    rotation_error: Array  #: Remaining rotation, a rotation vector, world, (points, 3) [rad].
    error_half_width: (
        Array  #: Half width of the error's 95 % interval, world, (points, 3) [m]; infinite if unseen.
    )
    at_limit: Mask  #: Joints that a limit stops, (points, n).
    refusals: tuple[Refusal | None, ...]  #: Why a point is refused; None for a corrected one.
    joint_meaning: JointMeaning  #: Meaning that the program's joints were given.

    def summary(self) -> dict[str, object]:
        """Summarise the correction: points, refused points, and errors of position before and after."""
        sizes = (1e3 * np.linalg.norm(error, axis=1) for error in (self.error_before, self.error_after))
        return {
            "points": len(self.q),
            "refused": int((~self.corrected).sum()),
            **dict(zip(("before_mm", "after_mm"), map(span, sizes), strict=True)),
        }

    @property
    def corrected(self) -> Mask:
        """Tell which points are corrected, (points,)."""
        return np.array([reason is None for reason in self.refusals], dtype=bool)


def compensate(
    model: ArmModel,
    q: Array,
    loads: Sequence[Load],
    aim: Aim | None = None,
    site: Site | None = None,
) -> Compensated:
    """Find joints that bring the loaded tool to the poses of a program.

    Args:
        model: Identified model of the arm, such as `load_model` reads.
        q: Joints of the program, (points, n) [rad, m].
        loads: Loads at the points, each the same at all or with one row per point.
        aim: Tool point, the part of its pose to correct, and the meaning of the program's joints; None for
            the whole pose of the tool's origin.
        site: Surroundings of the arm, for collisions; None leaves collisions unchecked.

    Returns:
        Corrected joints inside the limits, remaining errors and their intervals.

    Raises:
        BenchError: When types or shapes do not fit, joints are not in radians, or there is no point.
        NoEquilibrium: When the arm cannot carry a load; the message names the pose.
    """
    check_type(model, ArmModel, "model")
    check_items(loads, Load, "loads")
    check_type(aim, (Aim, NoneType), "aim")
    q = model.arm.check_joint_positions(q)
    if not len(q):
        raise BenchError("q [rad, m]: expected at least one point")
    aim, loads = aim or Aim(), [load.for_poses(len(q)) for load in loads]
    point = np.array(aim.tool_point)
    meant: JointMeaning = aim.joint_meaning or ("drawn" if model.is_absolute else "unloaded")
    # the target of the program, and how far the uncorrected tool is from it
    target = programmed_target(model.state, q, meant, point)
    before = equilibrium(model.state, q, loads).position_of(point) - target.position
    solution, held = solve_within_limits(model, q, loads, target, aim)
    refused = _refused(model.arm, solution, q, site)
    bad = np.array([reason is not None for reason in refused], dtype=bool)
    # refused points keep their joints, and their error before correction
    left = np.where(bad[:, None], before, -solution.position_error)
    corrected = np.where(bad[:, None], q, solution.q)
    acts = np.asarray(before.any(axis=1))
    corrected = np.where(acts[:, None], corrected, q)  # where nothing acts, as it was to the last digit
    # interval of the error: of a position, or of the motion from the programmed to the corrected pose
    start = None if model.is_absolute and meant == "drawn" else LoadedPoses(q)
    end = LoadedPoses(corrected, loads, with_own_weight=meant == "drawn")
    half = motion_half_widths(model, end, start, point[None])[:, 0]
    return Compensated(
        corrected, q, target, before, left, solution.rotation_error, half, held, tuple(refused), meant
    )


def solve_within_limits(
    model: ArmModel, q: Array, loads: Sequence[Load], target: Target, aim: Aim
) -> tuple[InverseStaticsSolution, Mask]:
    """Solve all points as `solve_inverse_statics` does, with joints kept inside their limits.

    A joint that would pass its limit is held there, and the points are solved again with the other joints,
    until no further joint passes its limit.

    Args:
        model: Identified model of the arm.
        q: Joints to start from, (points, n) [rad, m].
        loads: Loads at the points, each with one row per point.
        target: Where the tool point has to be.
        aim: Tool point and the part of its pose to correct.

    Returns:
        The solution, and which joints a limit at_limit, (points, n).
    """
    arm, (lower, upper) = model.arm, model.arm.limits
    free_joints = True if arm.dependence_matrix is None else arm.dependence_matrix.any(axis=0)
    points = InverseStaticsProblem(model.state, q, loads, target, aim, np.ones(q.shape))
    corrected = solve_inverse_statics(points)
    for _ in range(arm.n_joints):
        beyond = ((corrected.q < lower) | (corrected.q > upper)) & (points.may_move > 0) & free_joints
        passed = np.flatnonzero(beyond.any(axis=1) & corrected.solved)
        if not len(passed):
            break
        # hold the joints that passed a limit there, and solve these points again
        free = points.may_move * ~(beyond & corrected.solved[:, None])
        start = arm.with_dependent_joints(
            np.where(free > 0, points.start, np.clip(corrected.q, lower, upper))
        )
        points = replace(points, start=start, may_move=free)
        assign_rows(corrected, passed, solve_inverse_statics(points.select(passed)))
    return corrected, points.may_move == 0


def _refused(
    arm: Arm, corrected: InverseStaticsSolution, q: Array, site: Site | None
) -> list[Refusal | None]:
    """Find why points cannot be corrected: reach, equilibrium, a limit, or a collision that is new."""
    lower, upper = arm.limits
    reasons: list[Refusal | None] = [None] * len(q)
    for k in np.flatnonzero(~corrected.solved):
        away = float(np.linalg.norm(corrected.position_error[k]))
        reasons[k] = Refusal("reach", excess=away) if np.isfinite(away) else Refusal("equilibrium")
    for k, j in np.argwhere((corrected.q < lower - 1e-12) | (corrected.q > upper + 1e-12)):
        beyond = float(max(lower[j] - corrected.q[k, j], corrected.q[k, j] - upper[j]))
        reasons[k] = reasons[k] or Refusal("limit", (arm.joints[j].name,), beyond)
    if site is not None:
        good = np.flatnonzero([reason is None for reason in reasons])
        for k, pair in zip(good, find_collisions(site, corrected.q[good]), strict=True):
            if pair and find_collisions(site, q[k : k + 1])[0] != pair:
                reasons[k] = Refusal("collision", pair)
    return reasons
