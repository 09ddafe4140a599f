"""Compensation of a program, and inverse kinematics of the rigid arm along a path of the tool.

`compensate` is the last step of the work flow: from a model, programmed joints and loads it computes the
joints to command, within their limits, with the remaining error and its interval. A point that cannot be
corrected keeps its programmed joints and has a reason.

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
from testbench.model.vjm import Vjm, evaluate_chain, rotation_vectors_between
from testbench.plant.rigid_cell import RigidCell, find_collisions

# --- Inverse kinematics of the rigid arm along a path of the tool: continuous joints within limits ----------

POSE_TOLERANCE = 1e-9  #: Distance and angle to its target within which a pose counts as reached [m, rad].
#: Error below which a pose is not improved further, rotation times lever included [m].
CONVERGED_ERROR = 1e-12
ROTATION_LEVER = 0.25  #: Radius that converts an angle of orientation to a length, over the arm's reach [1].
INITIAL_DAMPING = 1e-2  #: Damping of the first step over the squared error of the pose [1].
MIN_DAMPING = 1e-14  #: Damping that remains at zero error, over the square of the lever [1].
MAX_JOINT_STEP = 0.5  #: Largest motion of a joint in one step [rad, m].
MIN_STEP_GAIN, MAX_STALLED_STEPS = 1e-4, 4
"""Relative gain below which a step counts as stalled [1], and number of stalled steps in a row at which the
search ends for a pose."""
MAX_STEPS = 60  #: Largest number of steps per pose.


@dataclass(frozen=True)
class InverseKinematics:
    """Hold a solution of inverse kinematics: joints, and the remaining error of the tool's pose."""

    q: Array  #: Joints within the limits, (poses, n) [rad, m].
    distance_error: Array  #: Distance between the tool's origin and its target, (poses,) [m].
    angle_error: Array  #: Angle between the tool's orientation and its target, (poses,) [rad].

    @property
    def converged(self) -> Mask:
        """Tell which poses are reached within `POSE_TOLERANCE`, (poses,)."""
        return np.asarray((self.distance_error <= POSE_TOLERANCE) & (self.angle_error <= POSE_TOLERANCE))


def solve_inverse_kinematics(vjm: Vjm, target: Target, start: Array) -> InverseKinematics:
    """Solve the inverse kinematics of the rigid arm within joint limits, from given start joints.

    It minimises the squared error of the pose by damped Newton steps d = J^T (J J^T + k 1)^-1 e, with the
    error e, its Jacobian J and the damping k. A joint at its limit does not move beyond it. Where no joints
    reach a pose, the last step is returned.

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
        # damping in proportion to the squared error (Levenberg)
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
    """Compute squared lengths of the rows of e, (poses,)."""
    return np.asarray((e * e).sum(axis=1))


def _error(vjm: Vjm, lever: float, q: Array, target: Target) -> tuple[Array, Array]:
    """Compute the pose's error, rotation times lever, (poses, 6) [m], and its Jacobian, (poses, 6, n)."""
    chain = evaluate_chain(vjm, q)
    p, R = chain.tool_position, chain.tool_rotation
    J = chain.J_theta[:, vjm.joint_spring_slice].transpose(2, 0, 1).copy()
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
"""Distance of the tool between knots of a path over the arm's reach [1], and its rotation that counts as much
[rad]."""
MAX_CONTINUOUS_MOTION, MAX_MOTION_PER_KNOT_DISTANCE = 0.1, 3.0
"""Limits of a joint's motion between neighbouring points [rad, m]; a larger motion is a jump. It may exceed
twice the motion of joints interpolated between knots by the first number. Of twice that motion, at most the
second number per `KNOT_DISTANCE` counts."""
MAX_JUMP_REPAIRS = 4  #: Largest number of repairs of jumps in a path.
N_START_CONFIGURATIONS = 256  #: Number of random start joints from which the first point is solved.
MAX_TRIED_CONFIGURATIONS = 8  #: Largest number of solutions of the first point that are tried.
MAX_TRIAL_POINTS = 400  #: Largest number of points of the path in such a trial.
LIMIT_CLEARANCE = 0.05
"""Distance to joint limits that the first point should keep, and least distance between two solutions of the
first point that are tried [rad, m]."""
SAME_CONFIGURATION_TOLERANCE = 0.05  #: Largest joint difference of one and the same configuration [rad, m].
#: Motion of a joint between two knots above which a knot is added between them [rad, m].
MAX_JOINT_MOTION_BETWEEN_KNOTS = 0.5
#: Remaining error over the present one below which new joints of an unreached pose are accepted [1].
MAX_REMAINING_ERROR_SHARE = 0.9
MAX_KNOT_ROUNDS = 20  #: Largest number of rounds that add knots; paths need fewer.


def joints_along_path(
    vjm: Vjm, position: Array, rotation: Array, *, start: Array | None = None, point: Array | None = None
) -> InverseKinematics:
    """Find joints of the rigid arm that move a point of the tool along a path without jumps.

    Knots, some of the points, are solved one after the other, each from the joints of the knot before; all
    points between knots are then solved at once. A point that cannot be reached gets the nearest joints that
    were found.

    Args:
        vjm: Kinematics of the rigid arm.
        position: Positions of the point, world, (points, 3) [m].
        rotation: Orientations, world from tool, (points, 3, 3) [1].
        start: Joints near the first point, (n,), or near every point, (points, n) [rad, m]. With None several
            solutions of the first point are tried, the nearest to zero first, until one reaches all points.
        point: The point in the tool's frame, (3,) or (points, 3) [m]; None for its origin.

    Returns:
        Joints within the limits, (points, n) [rad, m], and the remaining distance and angle of every point.

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
    """Choose the start joints, (n,) [rad, m], from which most points of the path are reached."""
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
    """Find joints that reach the first point, (tries, n) [rad, m], the best first."""
    arm, (lower, upper) = vjm.arm, vjm.arm.limits
    if start is not None:
        start = check_array(start, (arm.n_joints,), "start [rad, m]")
        reached = solve_inverse_kinematics(vjm, target, start[None])
        if reached.converged.all():
            return reached.q
    # Otherwise solve it from many random joints, and prefer solutions near the start or zero.
    near = arm.clip_to_limits(np.zeros(arm.n_joints) if start is None else start)
    many = _from_random_starts(vjm, target)
    if not many.converged.any():
        return many.q[[np.argmin(many.distance_error + vjm.reach * many.angle_error)]]
    # First those with clearance to the limits, then by distance.
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


def _from_random_starts(vjm: Vjm, target: Target) -> InverseKinematics:
    """Solve one pose from many random joints."""
    every = select_rows(target, np.zeros(N_START_CONFIGURATIONS, dtype=int))
    seeds = vjm.arm.draw_poses(np.random.default_rng(0), N_START_CONFIGURATIONS)
    return solve_inverse_kinematics(vjm, every, seeds)


def configurations(vjm: Vjm, position: Array, rotation: Array) -> Array:
    """Find all joints that put the tool's origin into a pose, with hinges turned by 360 degrees too.

    Args:
        vjm: Kinematics of the rigid arm.
        position: Position, world, (3,) [m].
        rotation: Orientation, world from tool, (3, 3) [1].

    Returns:
        Different solutions within the limits, (solutions, n) [rad, m].
    """
    lower, upper = vjm.arm.limits
    many = _from_random_starts(vjm, Target(position[None], rotation[None]))
    turns = [(-1, 0, 1) if full else (0,) for full in vjm.arm.full_turn_joints]
    shifts = 2 * np.pi * np.array([*itertools.product(*turns)], dtype=float)
    q = (many.q[many.converged][:, None] + shifts).reshape(-1, len(lower))
    q = q[((q >= lower) & (q <= upper)).all(axis=1)]
    _, first = np.unique(np.round(q / SAME_CONFIGURATION_TOLERANCE), axis=0, return_index=True)
    return np.asarray(q[first])


def _unwind(vjm: Vjm, q: Array, near: Array) -> Array:
    """Turn hinges by multiples of 360 degrees to the nearest of given joints, within the limits."""
    lower, upper = vjm.arm.limits
    other = q - 2 * np.pi * np.round((q - near) / (2 * np.pi)) * vjm.arm.full_turn_joints
    return np.where((other >= lower) & (other <= upper), other, q)


def _follow_path(vjm: Vjm, target: Target, first: Array) -> InverseKinematics:
    """Find joints along a path from joints near its first point, and repair jumps.

    Where branches of the inverse kinematics nearly meet, a knot may be on another branch than the points
    before it. Then the points after the jump are solved again from these points. If that reaches fewer
    points, the points before the jump are solved again, backwards from the knot.
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
    """Find joints along a path without repairs, and the indices of points after which they jump, (jumps,)."""
    turn = np.linalg.norm(rotation_vectors_between(target.rotation[:-1], target.rotation[1:]), axis=1)
    step = np.linalg.norm(np.diff(target.position, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(step / (KNOT_DISTANCE * vjm.reach) + turn / KNOT_ROTATION + 1e-9)])
    places, q = _path_knots(vjm, target, _first_knots(way), first)
    start = np.stack([np.interp(way, way[places], joint) for joint in q.T], axis=1)
    # a motion far larger than the interpolated one is a jump to another branch
    steady = MAX_CONTINUOUS_MOTION + np.minimum(
        2 * np.abs(np.diff(start, axis=0)), MAX_MOTION_PER_KNOT_DISTANCE * np.diff(way)[:, None]
    )
    reached = _retry_unreached(vjm, target, solve_inverse_kinematics(vjm, target, start))
    jumps = (np.abs(np.diff(reached.q, axis=0)) > steady).any(axis=1)
    return reached, np.flatnonzero(jumps & reached.converged[1:] & reached.converged[:-1])


def _first_knots(way: Array) -> Ids:
    """Select points about one unit of `way` apart, the first and the last among them."""
    places = [0]
    while places[-1] < len(way) - 1:
        places.append(max(places[-1] + 1, int(np.searchsorted(way, way[places[-1]] + 1, side="right")) - 1))
    return np.array(places)


def _retry_unreached(vjm: Vjm, target: Target, reached: InverseKinematics) -> InverseKinematics:
    """Solve unreached points once more, each from the joints of the nearest reached point."""
    there = np.flatnonzero(reached.converged)
    lost = np.flatnonzero(~reached.converged)
    if not len(there) or not len(lost):
        return reached
    right = np.minimum(np.searchsorted(there, lost), len(there) - 1)
    left = np.maximum(right - 1, 0)
    nearer = np.where(np.abs(there[left] - lost) < np.abs(there[right] - lost), left, right)
    other = solve_inverse_kinematics(vjm, select_rows(target, lost), reached.q[there[nearer]])
    return replace_rows(reached, lost[other.converged], select_rows(other, np.flatnonzero(other.converged)))


def _solve_from_predecessors(
    vjm: Vjm, target: Target, guess: InverseKinematics, unsolved: Ids
) -> InverseKinematics:
    """Solve some poses of a path, (k,) without pose 0, from the pose before, until no pose changes.

    A pose that was reached before is still reached.
    """
    while len(unsolved):
        # solve from the pose before; where that changes a pose, the pose after it must be solved again
        reached = solve_inverse_kinematics(vjm, select_rows(target, unsolved), guess.q[unsolved - 1])
        old = select_rows(guess, unsolved)
        moved = np.abs(reached.q - old.q).max(axis=1) > SAME_CONFIGURATION_TOLERANCE
        nearer = reached.distance_error + reached.angle_error * vjm.reach < MAX_REMAINING_ERROR_SHARE * (
            old.distance_error + old.angle_error * vjm.reach
        )
        change = np.where(reached.converged, moved | ~old.converged, nearer & ~old.converged)
        guess = replace_rows(guess, unsolved[change], select_rows(reached, np.flatnonzero(change)))
        unsolved = unsolved[change] + 1
        unsolved = unsolved[unsolved < len(guess.q)]
    return guess


def _path_knots(vjm: Vjm, target: Target, indices: Ids, first: Array) -> tuple[Ids, Array]:
    """Solve knots one after the other, and add knots where joints move far between two of them.

    Returns indices of all knots, (knots,), and their joints, (knots, n) [rad, m].
    """
    knots = solve_inverse_kinematics(vjm, select_rows(target, indices), np.tile(first, (len(indices), 1)))
    open_ = np.arange(1, len(indices))
    for _ in range(MAX_KNOT_ROUNDS):
        # solve the knots so far, each from the one before
        knots = _solve_from_predecessors(vjm, select_rows(target, indices), knots, open_)
        far = np.abs(np.diff(knots.q, axis=0)).max(axis=1, initial=0) > MAX_JOINT_MOTION_BETWEEN_KNOTS
        wide = np.flatnonzero(far & knots.converged[1:] & knots.converged[:-1] & (np.diff(indices) > 1))
        if not len(wide):
            break
        # halfway between knots whose joints are far apart a new one is added
        between = (indices[wide] + indices[wide + 1]) // 2
        reached = solve_inverse_kinematics(vjm, select_rows(target, between), knots.q[wide])
        order = np.argsort(np.concatenate([indices, between]))
        indices = np.concatenate([indices, between])[order]
        knots = select_rows(concatenate_rows([knots, reached]), order)
        open_ = np.flatnonzero(np.isin(indices, between)) + 1
    return indices, knots.q


# --- Compensation of a program ------------------------------------------------------------------------------

RefusalReason = Literal["reach", "equilibrium", "limit", "collision"]
"""Reasons why a point is not corrected: out of reach, no equilibrium, a joint limit, or a new collision."""


@dataclass(frozen=True)
class Refusal:
    """Hold the reason why a point of a program is not corrected."""

    reason: RefusalReason  #: Kind of the reason.
    #: Name of the joint beyond its limit, or names of the two parts that would collide; else empty.
    involved_names: tuple[str, ...] = ()
    excess: float = 0.0  #: Remaining distance [m] if out of reach, or distance beyond the limit [rad, m].


@dataclass(frozen=True, repr=False)
class Compensated(Displayed):
    """Hold a corrected program: joints that bring the loaded tool to the programmed poses, and its errors.

    Errors are predicted minus programmed position of the tool point.
    """

    q: Array  #: Joints to command, those of the program at refused points, (points, n) [rad, m].
    programmed_q: Array  #: Joints of the program, (points, n) [rad, m].
    target: Target  #: Programmed poses of the tool point.
    error_before: Array  #: Position error of the tool point without correction, world, (points, 3) [m].
    error_after: Array  #: Position error of the tool point with correction, world, (points, 3) [m].
    #: Remaining rotation to the programmed orientation, rotation vectors, world, (points, 3) [rad].
    rotation_error: Array
    #: Half width of the 95 % interval of `error_after`, world, (points, 3) [m]; infinite if unobservable.
    error_half_width: Array
    at_limit: Mask  #: Whether a joint is fixed at its limit, (points, n).
    refusals: tuple[Refusal | None, ...]  #: Why a point is not corrected; None for a corrected one.
    joint_meaning: JointMeaning  #: Meaning of the program's joints that the correction used.

    def summary(self) -> dict[str, object]:
        """Summarise the correction: numbers of points and refused points, errors before and after it."""
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
    rigid_cell: RigidCell | None = None,
) -> Compensated:
    """Correct a program: find joints that bring the loaded tool to the programmed poses, within the limits.

    Args:
        model: Identified model of the arm, such as `load_model` reads.
        q: Joints of the program, (points, n) [rad, m].
        loads: Loads at the points, each the same at all or with one row per point.
        aim: Tool point, the part of its pose to correct, and the meaning of the program's joints; None for
            the whole pose of the tool's origin.
        rigid_cell: The arm with its surroundings, to check collisions; None for no check.

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
    # programmed poses of the tool point, and the error without correction
    target = programmed_target(model.state, q, meant, point)
    before = equilibrium(model.state, q, loads).position_of(point) - target.position
    solution, held = _solve_within_limits(model, q, loads, target, aim)
    refused = _refused(model.arm, solution, q, rigid_cell)
    bad = np.array([reason is not None for reason in refused], dtype=bool)
    # refused points keep their joints and their error before correction
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


def _solve_within_limits(
    model: ArmModel, q: Array, loads: Sequence[Load], target: Target, aim: Aim
) -> tuple[InverseStaticsSolution, Mask]:
    """Solve the inverse statics of all points; return also which joints are fixed at a limit, (points, n).

    A joint that would exceed its limit is fixed at it, and the point is solved again with the other joints,
    until no joint exceeds its limit.
    """
    arm, (lower, upper) = model.arm, model.arm.limits
    free_joints = True if arm.dependence_matrix is None else arm.dependence_matrix.any(axis=0)
    points = InverseStaticsProblem(model.state, q, loads, target, aim, np.ones(q.shape))
    corrected = solve_inverse_statics(points)
    for _ in range(arm.n_joints):
        beyond = ((corrected.q < lower) | (corrected.q > upper)) & (points.joint_is_free > 0) & free_joints
        passed = np.flatnonzero(beyond.any(axis=1) & corrected.solved)
        if not len(passed):
            break
        # fix the joints that exceed a limit at it, and solve these points again
        free = points.joint_is_free * ~(beyond & corrected.solved[:, None])
        start = arm.with_dependent_joints(
            np.where(free > 0, points.start, np.clip(corrected.q, lower, upper))
        )
        points = replace(points, start=start, joint_is_free=free)
        assign_rows(corrected, passed, solve_inverse_statics(points.select(passed)))
    return corrected, points.joint_is_free == 0


def _refused(
    arm: Arm, corrected: InverseStaticsSolution, q: Array, rigid_cell: RigidCell | None
) -> list[Refusal | None]:
    """Find why a point is not corrected: reach, equilibrium, a limit, or a new collision; None if it is."""
    lower, upper = arm.limits
    reasons: list[Refusal | None] = [None] * len(q)
    for k in np.flatnonzero(~corrected.solved):
        away = float(np.linalg.norm(corrected.position_error[k]))
        reasons[k] = Refusal("reach", excess=away) if np.isfinite(away) else Refusal("equilibrium")
    for k, j in np.argwhere((corrected.q < lower - 1e-12) | (corrected.q > upper + 1e-12)):
        beyond = float(max(lower[j] - corrected.q[k, j], corrected.q[k, j] - upper[j]))
        reasons[k] = reasons[k] or Refusal("limit", (arm.joints[j].name,), beyond)
    if rigid_cell is not None:
        good = np.flatnonzero([reason is None for reason in reasons])
        for k, pair in zip(good, find_collisions(rigid_cell, corrected.q[good]), strict=True):
            if pair and find_collisions(rigid_cell, q[k : k + 1])[0] != pair:
                reasons[k] = Refusal("collision", pair)
    return reasons
