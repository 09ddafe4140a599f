"""Static equilibrium of the loaded arm, and inverse statics: joints that put the loaded tool on its target.

`solve_inverse_statics` is Newton's method for two unknowns together: the virtual joints theta move towards
their equilibrium, and the commanded joints q towards the target. Every step evaluates the deflected arm once.
It predicts by J_theta how the new theta moves the tool, and moves q by the remaining error. The neglected
terms are a hundredth on heavy arms, so five steps reach 1e-10 m. All steps use the operator (the inverse
Jacobian) of the first step. So which directions are damped depends on the start of a point alone, and
corrections of neighbours on a path are near each other. Steps have bounded length, and are halved if they do
not converge. Points that still have not converged get a new operator in every step.

A step corrects position first, then as much of the rotation as is requested. With d the motion of the joints,
J_p and J_r the rows of the Jacobian for position and rotation, b_p and b_r the errors, and Z a basis of the
motions that leave the position unchanged:

    d = J_p^+ b_p + Z z,    z of least norm(J_r Z z - (b_r - J_r J_p^+ b_p))

So the position is reached in any pose in which it can be reached at all. Near a singular pose of the wrist a
rotation takes large joint motions. There every direction z of small singular value s is damped: s / (s^2 +
l^2) replaces 1 / s, with l growing smoothly from zero at s = MIN_SINGULAR_VALUE (Nakamura & Hanafusa 1986);
the remaining rotation is reported. If joints are redundant, d is the shortest motion.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from testbench.data.dataset import Rows, concatenate_rows, row_arrays, select_rows
from testbench.errors import Array, BenchError, Ids, Mask, check_array
from testbench.identify.absolute.state import (
    ArmState,
    generalised_loads_at,
    joint_equilibrium,
    theta_without_springs,
)
from testbench.model.load import Load
from testbench.model.vjm import (
    ChainState,
    cross,
    evaluate_chain,
    rotation_vectors_between,
    rotation_vectors_between_axes,
    tool_poses,
    transform_tool_points,
)
from testbench.progress import stepwise

POSES_PER_BATCH = 512  #: Number of poses that are computed at once: fast in numpy, small in memory.


def pose_slices(n_poses: int) -> Iterator[slice]:
    """Split the indices 0 to n_poses - 1 into slices of at most `POSES_PER_BATCH`, and report progress.

    For no pose it yields one empty slice.
    """
    return stepwise(
        [slice(k, k + POSES_PER_BATCH) for k in range(0, max(n_poses, 1), POSES_PER_BATCH)], "solving poses"
    )


def assign_rows(rows: Rows, indices: Ids, new_rows: Rows) -> None:
    """Overwrite some rows of all arrays of a dataclass, in place.

    Args:
        rows: Dataclass of arrays with one row per pose.
        indices: Indices of the rows to overwrite, (k,).
        new_rows: Dataclass of the same type with k rows.
    """
    for name, values in row_arrays(rows).items():
        values[indices] = row_arrays(new_rows)[name]


def replace_rows(rows: Rows, indices: Ids, new_rows: Rows) -> Rows:
    """Return a copy of a dataclass of arrays with some rows overwritten.

    Args:
        rows: Dataclass of arrays with one row per pose; it is not changed.
        indices: Indices of the rows to overwrite, (k,).
        new_rows: Dataclass of the same type with k rows.
    """
    copied = concatenate_rows([rows])
    assign_rows(copied, indices, new_rows)
    return copied


@dataclass(frozen=True)
class EquilibriumPoses:
    """Hold the static equilibrium of the arm in some poses: virtual joints, and pose of the tool."""

    theta: Array  #: Virtual joints, (poses, n_theta) [m, rad].
    position: Array  #: Position of the tool's origin, world, (poses, 3) [m].
    rotation: Array  #: Orientation, world from tool, (poses, 3, 3) [1].

    def position_of(self, point: Array) -> Array:
        """Compute the world position of one point of the tool in every pose.

        Args:
            point: Point in the tool's frame, (3,), or one per pose, (poses, 3) [m].

        Returns:
            World positions, (poses, 3) [m].
        """
        return np.asarray(self.position + np.matvec(self.rotation, point))

    def positions_of(self, points: Array) -> Array:
        """Compute the world positions of k points of the tool in every pose.

        Args:
            points: Points in the tool's frame, (k, 3) [m].

        Returns:
            World positions, (poses, k, 3) [m].
        """
        return transform_tool_points((self.position, self.rotation), points)


def equilibrium(state: ArmState, q: Array, loads: Sequence[Load] = ()) -> EquilibriumPoses:
    """Solve the static equilibrium of the arm under own weight and loads, in every pose.

    theta = theta_0 + C_theta u(q, theta, loads) + Phi(q) n, with u the generalised loads at theta, geometric
    errors theta_0 and joint errors Phi n.

    Mathematics: `loaded-1`.

    Args:
        state: The identified arm.
        q: Joints as commanded, (poses, n) [rad, m].
        loads: Loads besides own weight, each the same in all poses or with one row per pose.

    Returns:
        Virtual joints and the tool's pose.

    Raises:
        NoEquilibrium: When the arm cannot carry the loads; the message names the pose.
        BenchError: When q has another shape or is not finite, or a load has rows for another number of poses.
    """
    q = check_array(q, (None, state.vjm.arm.n_joints), "q [rad, m]")
    loads = [load.for_poses(len(q)) for load in loads]
    parts = (
        joint_equilibrium(state, q[batch], [load.select(batch) for load in loads])
        for batch in pose_slices(len(q))
    )
    return concatenate_rows(
        [EquilibriumPoses(part.theta, part.chain.tool_position, part.chain.tool_rotation) for part in parts]
    )


CorrectedPart = Literal["pose", "axis", "position"]
"""Part of the tool's pose to correct: all of it, all but its rotation about the spindle, or its position."""
MIN_SINGULAR_VALUE = 0.05
"""Singular value of the Jacobian of rotations below which they are damped [rad/rad].

There a rotation of one milliradian moves the joints by 20 mrad, more than a degree.
"""
#: Singular value of J_p over its largest below which the tool counts as unable to move in a direction [1].
TRANSLATION_RANK_TOLERANCE = 1e-7


def newton_operator(J: Array, corrected_part: CorrectedPart, spindle_axis: Array) -> Array:
    """Compute the inverse Jacobian G of a Newton step d = G b, which corrects position first, then rotation.

    Mathematics: `cor-4`, `cor-5`.

    Args:
        J: Jacobian of the actuated joints at the tool point, translation first, world axes, (points, 6, n)
            [m/rad, rad/rad].
        corrected_part: Part of the pose to correct.
        spindle_axis: Unit vector of the spindle, world axes, (points, 3) [1].

    Returns:
        G, from errors b of the pose to motions d of the joints, (points, n, 6) [rad/m, rad/rad]. Its columns
        of rotation are zero for "position" and for arms of at most three joints.
    """
    # position: pseudo-inverse J_p^+ without directions in which the tool cannot move
    U, s, Vt = np.linalg.svd(J[:, :3])
    r = s.shape[1]
    keep = s > TRANSLATION_RANK_TOLERANCE * s[:, :1]
    inverse = np.where(keep, 1 / np.where(keep, s, 1), 0)
    position = (Vt[:, :r].swapaxes(1, 2) * inverse[:, None]) @ U[:, :, :r].swapaxes(1, 2)
    G = np.zeros((len(J), J.shape[2], 6))
    G[:, :, :3] = position
    if corrected_part == "position" or r == J.shape[2]:
        return G
    # rotation in the null space Z of J_p; without the component about the spindle where that is free
    Z, turns = Vt[:, r:].swapaxes(1, 2), J[:, 3:]
    if corrected_part == "axis":
        turns = turns - spindle_axis[:, :, None] * (spindle_axis[:, None] @ turns)
    # z of least |J_r Z z - (b_r - J_r J_p^+ b_p)|, damped, as columns of G for b_p and b_r
    turning = Z @ _damped(turns @ Z)
    G[:, :, :3] -= turning @ (turns @ position)
    G[:, :, 3:] = turning
    if corrected_part == "axis":
        G[:, :, 3:] -= (turning @ spindle_axis[:, :, None]) @ spindle_axis[:, None]
    return G


def _damped(B: Array) -> Array:
    """Compute pseudo-inverses, (points, k, 3), of matrices, (points, 3, k), damped where nearly singular."""
    U, s, Vt = np.linalg.svd(B, full_matrices=False)
    scarce = np.maximum(0, 1 - s / MIN_SINGULAR_VALUE)
    gain = s / np.maximum(s**2 + (MIN_SINGULAR_VALUE * scarce) ** 2, np.finfo(float).tiny)
    return np.asarray((Vt.swapaxes(1, 2) * gain[:, None]) @ U.swapaxes(1, 2))


JointMeaning = Literal["unloaded", "drawn"]
"""Pose that programmed joints stand for: "unloaded", that of the arm under own weight alone, as taught; or
"drawn", that of the nominal rigid arm."""
CONVERGENCE_TOLERANCE = 1e-10  #: Largest error of position and equilibrium of a solved point [m, rad].
MAX_STEPS = 60  #: Largest number of steps.
#: Number of steps after which steps are halved; after twice as many they are quartered.
STEPS_BEFORE_HALVING = 10
CONVERGED_JOINT_MOTION = 1e-9  #: Motion of all joints in a step below which a solved point is final [rad, m].
MAX_JOINT_MOTION_PER_STEP = 0.1  #: Largest motion of a joint in one step [rad, m].
MAX_TOOL_POINT_COORDINATE, UNIT_VECTOR_TOLERANCE = 10.0, 1e-6
"""Largest coordinate of a tool point in the tool's frame that is accepted [m], and error of a unit vector's
length [1]."""
DEFAULT_SPINDLE_AXIS = (1.0, 0.0, 0.0)  #: Default axis of the spindle in the tool's frame [1].


@dataclass(frozen=True)
class Target:
    """Hold target poses of a point of the tool."""

    position: Array  #: Positions of the tool point, world, (points, 3) [m].
    rotation: Array  #: Orientations, world from tool, (points, 3, 3) [1].


@dataclass(frozen=True)
class Aim:
    """Hold what `compensate` corrects: which part of the tool's pose, and at which point of the tool."""

    corrected_part: CorrectedPart = "pose"  #: Part of the pose to correct.
    #: Pose that programmed joints stand for; None is "drawn" for an absolute model, "unloaded" for any other.
    joint_meaning: JointMeaning | None = None
    tool_point: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: Point in the tool's frame, (3,) [m].
    #: Unit vector along the spindle in the tool's frame, (3,) [1].
    spindle_axis: tuple[float, float, float] = DEFAULT_SPINDLE_AXIS

    def __post_init__(self) -> None:
        """Check words, shapes, size of the tool point and length of the spindle axis; else BenchError."""
        if self.corrected_part not in get_args(CorrectedPart):
            known = " or ".join(get_args(CorrectedPart))
            raise BenchError(f"aim.corrected_part: expected {known}, got {self.corrected_part!r}")
        if self.joint_meaning not in (None, *get_args(JointMeaning)):
            known = " or ".join(get_args(JointMeaning))
            raise BenchError(f"aim.joint_meaning: expected {known} or None, got {self.joint_meaning!r}")
        point = check_array(self.tool_point, (3,), "aim.tool_point [m]")
        spindle = check_array(self.spindle_axis, (3,), "aim.spindle_axis [1]")
        if (
            np.abs(point).max() > MAX_TOOL_POINT_COORDINATE
            or abs(np.linalg.norm(spindle) - 1) > UNIT_VECTOR_TOLERANCE
        ):
            problem = f"a tool point within {MAX_TOOL_POINT_COORDINATE:g} m and a spindle axis of length 1"
            raise BenchError(f"aim: expected {problem}, got {self.tool_point} and {self.spindle_axis}")


def programmed_target(state: ArmState, q: Array, joint_meaning: JointMeaning, tool_point: Array) -> Target:
    """Compute the poses that a tool point shall reach, from the joints of a program.

    Mathematics: `cor-2`.

    Args:
        state: The identified arm.
        q: Joints of the program, (points, n) [rad, m].
        joint_meaning: "unloaded" for the pose under own weight alone: only deflections by loads are then
            corrected. "drawn" for the pose of the nominal rigid arm: geometry, joint errors and own weight
            are then corrected too.
        tool_point: Tool point in the tool's frame, (3,) [m].

    Returns:
        Poses of the tool point.

    Raises:
        NoEquilibrium: When the unloaded arm has no equilibrium; the message names the pose.
    """
    if joint_meaning == "drawn":
        position, rotation = tool_poses(state.vjm, q)
        return Target(position + rotation @ tool_point, rotation)
    rest_poses = equilibrium(state, q)
    return Target(rest_poses.position_of(tool_point), rest_poses.rotation)


@dataclass(frozen=True)
class InverseStaticsSolution:
    """Hold a solution of inverse statics: joints to command, and the errors that remain."""

    q: Array  #: Joints to command, (points, n) [rad, m].
    position_error: Array  #: Target minus predicted position of the tool point, world, (points, 3) [m].
    #: Remaining rotation of the tool, or of its spindle's axis: rotation vectors, world, (points, 3) [rad].
    rotation_error: Array
    #: Largest distance of a virtual joint from its equilibrium, (points,) [m, rad].
    equilibrium_residual: Array

    @property
    def solved(self) -> Mask:
        """Tell which points reach position and equilibrium within `CONVERGENCE_TOLERANCE`, (points,).

        A remaining rotation does not count.
        """
        far = np.maximum(np.linalg.norm(self.position_error, axis=1), self.equilibrium_residual)
        return np.asarray(far <= CONVERGENCE_TOLERANCE)


@dataclass(frozen=True)
class InverseStaticsProblem:
    """Hold a problem of inverse statics: find joints that put the loaded tool on its targets."""

    state: ArmState  #: The identified arm.
    start: Array  #: Joints to start from, (points, n) [rad, m].
    loads: Sequence[Load]  #: Loads that act together, each with one row per point.
    target: Target  #: Target poses of the tool point.
    aim: Aim  #: Tool point, and the part of its pose to correct.
    joint_is_free: Array  #: 1 for a joint that may move, 0 for a fixed one, (points, n) [1].

    def select(self, points: slice | Ids) -> "InverseStaticsProblem":
        """Select some of the points with their loads and targets.

        Args:
            points: Indices of the points, (k,), or a slice.
        """
        loads, target = [load.select(points) for load in self.loads], select_rows(self.target, points)
        return replace(
            self,
            start=self.start[points],
            loads=loads,
            target=target,
            joint_is_free=self.joint_is_free[points],
        )


@dataclass(frozen=True)
class _Errors:
    """Hold how far points are from their targets and from equilibrium."""

    chain: ChainState  #: Tool and Jacobian of the deflected arm.
    position_error: Array  #: Target minus predicted position, (points, 3) [m].
    rotation_error: Array  #: Remaining rotation, (points, 3) [rad].
    spring_error: Array  #: Equilibrium of theta under its loads minus theta, (points, n_theta) [m, rad].


def _errors(points: InverseStaticsProblem, q: Array, theta: Array) -> _Errors:
    """Compute the errors of all points at joints q, (points, n), and virtual joints theta."""
    state = points.state
    where = evaluate_chain(state.vjm, q, theta)
    u = generalised_loads_at(state, where, points.loads)
    springs = theta_without_springs(state, q, points.loads) + (state.C_theta @ u).T - theta
    position = where.tool_position + where.tool_rotation @ np.array(points.aim.tool_point)
    turned = _rotation_error(points, where.tool_rotation)
    return _Errors(where, points.target.position - position, turned, springs)


def _rotation_error(points: InverseStaticsProblem, rotation: Array) -> Array:
    """Compute the remaining rotation; where the spindle may turn about itself, that of its axis alone."""
    if points.aim.corrected_part != "axis":
        return rotation_vectors_between(rotation, points.target.rotation)
    spindle = np.array(points.aim.spindle_axis)
    return rotation_vectors_between_axes(rotation @ spindle, points.target.rotation @ spindle)


def solve_inverse_statics(problem: InverseStaticsProblem) -> InverseStaticsSolution:
    """Find joints that put the loaded tool on its targets, without regard to joint limits.

    Most points converge in five steps with the inverse Jacobian of the first step. Points that do not
    converge are solved with a new inverse Jacobian in every step, and then for their position alone: where
    the arm is stretched, the rotation may prevent the position.

    Mathematics: `cor-1`, `cor-3`.

    Args:
        problem: Start, loads, targets and joints that may move.

    Returns:
        The joints and the remaining errors; `InverseStaticsSolution.solved` tells which points are reached.
    """
    corrected = _in_batches(problem, renewed=False)
    alone = replace(problem.aim, corrected_part="position")
    # unsolved points: with a renewed operator, then position alone, with the first and a renewed operator
    for aim, renewed in ((problem.aim, True), (alone, False), (alone, True)):
        bad = np.flatnonzero(~corrected.solved)
        if len(bad):
            again = _in_batches(replace(problem.select(bad), aim=aim), renewed=renewed)
            better = np.flatnonzero(again.solved)
            assign_rows(corrected, bad[better], select_rows(again, better))
    return corrected


def _in_batches(points: InverseStaticsProblem, *, renewed: bool) -> InverseStaticsSolution:
    """Solve points in batches."""
    slices = pose_slices(len(points.start))
    return concatenate_rows([_solve_batch(points.select(part), renewed=renewed) for part in slices])


def _solve_batch(points: InverseStaticsProblem, *, renewed: bool) -> InverseStaticsSolution:
    """Take at most `MAX_STEPS` Newton steps, with the operator of the start or renewed in every step."""
    runs = len(points.start)
    q, theta = points.start.copy(), theta_without_springs(points.state, points.start, points.loads)
    corrected = InverseStaticsSolution(q, np.zeros((runs, 3)), np.zeros((runs, 3)), np.zeros(runs))
    moving = np.arange(runs)
    now = points
    moves = points.state.vjm.arm.dependence_matrix
    G, J = np.zeros((runs, q.shape[1], 6)), np.zeros((runs, 6, q.shape[1]))
    for step in range(MAX_STEPS):
        # errors of position, rotation and equilibrium at the present q and theta
        off = _errors(now, q[moving], theta[moving])
        corrected.position_error[moving] = off.position_error
        corrected.rotation_error[moving] = off.rotation_error
        corrected.equilibrium_residual[moving] = np.abs(off.spring_error).max(axis=1)
        # the operator of this step; a fixed joint has no column
        if step == 0 or renewed:
            J = _jacobian(now.aim, off.chain, now.state.vjm.joint_spring_slice)
            J = (J if moves is None else J @ moves) * now.joint_is_free[:, None]
            G = newton_operator(
                J, now.aim.corrected_part, now.target.rotation @ np.array(now.aim.spindle_axis)
            )
        # q by the operator, theta to its springs' equilibrium; points that stand still or diverge drop out
        move = _joint_step(now, off, q[moving], G, J) / 2 ** min(2, step // STEPS_BEFORE_HALVING)
        still = corrected.solved[moving] & (np.abs(move).max(axis=1) <= CONVERGED_JOINT_MOTION)
        go = np.flatnonzero(~still & np.isfinite(off.position_error).all(axis=1))
        if not len(go):
            return corrected
        q[moving[go]] += move[go]
        theta[moving[go]] += off.spring_error[go]
        if len(go) < len(moving):
            moving = moving[go]
            now = now.select(go)
            G = G[go]
            J = J[go]
    return corrected


def _jacobian(aim: Aim, chain: ChainState, columns: slice) -> Array:
    """Compute the Jacobian of some virtual joints at the tool point, translation first, (points, 6, k)."""
    v, omega = chain.J_theta[:3, columns], chain.J_theta[3:, columns]
    arm = (chain.tool_rotation @ np.array(aim.tool_point)).T[:, None]
    return np.ascontiguousarray(np.concatenate([v + cross(omega, arm), omega]).transpose(2, 0, 1))


def _joint_step(points: InverseStaticsProblem, errors: _Errors, q: Array, G: Array, J: Array) -> Array:
    """Compute the step of the joints, (points, n), for the errors that remain at the new equilibrium."""
    # the errors that remain at the equilibrium of theta, to first order
    arm = (errors.chain.tool_rotation @ np.array(points.aim.tool_point)).T
    v, omega = np.einsum("xtr,rt->xr", errors.chain.J_theta, errors.spring_error).reshape(2, 3, -1)
    left = np.hstack([errors.position_error - (v + cross(omega, arm)).T, errors.rotation_error - omega.T])
    # the whole motion from the start solves the start's linear equations: q = start + G (errors + J gone)
    gone = q - points.start
    move = np.matvec(G, left + np.matvec(J, gone)) - gone
    if points.state.vjm.arm.dependence_matrix is not None:  # joints that follow others move as these do
        move = np.matvec(points.state.vjm.arm.dependence_matrix, move)
    return np.asarray(
        move
        * np.minimum(1, MAX_JOINT_MOTION_PER_STEP / np.maximum(np.abs(move).max(axis=1), 1e-300))[:, None]
    )
