"""Prediction: poses of the tool under its loads, with 95 % intervals; and the stiffness of the loaded tool.

`predict` evaluates an identified model, by the equilibrium behind Eq. (7) or by the linear model of Eq. (6).
`load_extent` compares loads with those under which the model was identified. `stiffness` computes the
compliance of Eq. (7) in every direction, with its ellipsoid. `process_wrench` converts forces that follow the
path of a tool, along the feed, across it and along the spindle, to loads of `predict` and `compensate`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.correct.newton import batches, equilibrium
from testbench.correct.uncertainty import LoadedPoses, curvature, half_widths
from testbench.data.dataset import join_rows
from testbench.display import Displayed, span
from testbench.errors import Array, BenchError, Mask, check_array, check_items, check_type
from testbench.identify.absolute.state import ArmState
from testbench.identify.posterior import CURVATURE_COUNT, ArmModel
from testbench.model.laws import tangent
from testbench.model.load import (
    Load,
    displacement,
    geometric_stiffness,
    loaded_compliance,
    on_joints,
    resultant,
)
from testbench.model.vjm import chain, rotation_matrices, rotation_vectors_between, tool_pose

# --- Prediction: poses of the tool under its loads, with 95 % intervals -------------------------------------


@dataclass(frozen=True, repr=False)
class Prediction(Displayed):
    """Hold deflections and positions of points of the tool, its origin first, with intervals.

    Own weight acts both with and without loads.
    """

    deflection: Array  #: Loaded minus unloaded position, world axes, (poses, 1 + m, 3) [m].
    #: Half widths of its 95 % intervals, (poses, 1 + m, 3) [m]; infinite where unobservable.
    half_width: Array
    rotation_vector: Array  #: Rotation vector from unloaded to loaded tool, world axes, (poses, 3) [rad].
    position: Array  #: Loaded position, world, (poses, 1 + m, 3) [m]; on nominal geometry if not absolute.
    #: Half widths of its 95 % intervals, (poses, 1 + m, 3) [m]; infinite for a model of deflections alone.
    position_half_width: Array
    rotation: Array  #: Orientation of the loaded tool, world from tool, (poses, 3, 3) [1].
    #: Distance between the loaded tool's origin by Eq. (6) and by Eq. (7), (poses,) [m].
    linearisation_error: Array
    theta: Array  #: Virtual joints of the loaded arm at its equilibrium, (poses, n_theta) [m, rad].

    def about(self) -> dict[str, object]:
        """Summarise the prediction: numbers of poses and points, deflections of the tool's origin."""
        return {
            "poses": len(self.deflection),
            "points": self.deflection.shape[1],
            "deflection_mm": span(1e3 * self.size[:, 0]),
            "half_width_mm": span(1e3 * self.widest[:, 0]),
        }

    @cached_property
    def size(self) -> Array:
        """Compute the lengths of the deflections, (poses, 1 + m) [m]."""
        return np.asarray(np.linalg.norm(self.deflection, axis=2))

    @cached_property
    def widest(self) -> Array:
        """Return the largest half width over the three axes of every point, (poses, 1 + m) [m]."""
        return np.asarray(self.half_width.max(axis=2))


def predict(
    model: ArmModel,
    q: Array,
    loads: Sequence[Load] = (),
    *,
    points: Array | None = None,
    linear: bool = False,
) -> Prediction:
    """Predict where loads bring the tool: by the equilibrium behind Eq. (7), or by Eq. (6).

    Args:
        model: Identified model, of deflections alone or absolute, such as `load_model` reads.
        q: Joints as commanded, (poses, n) [rad, m].
        loads: Loads besides own weight, each the same in all poses or with one row per pose.
        points: Points in the tool's frame, (m, 3) [m]; None for the arm's markers.
        linear: Whether to use Eq. (6), the compliance of the unloaded arm.

    Returns:
        Deflections of the tool's origin and the points, their 95 % intervals, and where the tool is.

    Raises:
        NoEquilibrium: When the arm cannot carry the loads; the message names the pose.
        BenchError: When an argument has another type or shape, is not finite, or joints are not in radians.
    """
    check_type(model, ArmModel, "model")
    check_items(loads, Load, "loads")
    q = model.arm.check_positions(q)
    points = model.vjm.markers if points is None else check_array(points, (None, 3), "points [m]")
    points = np.vstack([np.zeros(3), points])
    every = LoadedPoses(q, loads)
    return join_rows([_predict(model, every.select(batch), points, linear) for batch in batches(len(q))])


def _predict(model: ArmModel, loaded: LoadedPoses, points: Array, linear: bool) -> Prediction:
    """Predict a few poses, as `predict`."""
    before, after = equilibrium(model.state, loaded.q), loaded.rest_poses(model.state)
    loaded, free = replace(loaded, equilibrium=after), LoadedPoses(loaded.q, equilibrium=before)
    half = half_widths(model, loaded, free, points)
    turn, straight = rotation_vectors_between(before.rotation, after.rotation), _linear(model, loaded, points)
    deflection = after.points(points) - before.points(points)
    apart = np.linalg.norm(deflection[:, 0] - straight[0][:, 0], axis=1)
    start = before.points(points)
    rotation = after.rotation
    if linear:
        # Eq. (6) is off by its curvature: once for an absolute model, CURVATURE_COUNT times for one of
        # deflections, whose half width has it once already
        curved = curvature(model, loaded, free, points)
        half = np.hypot(half, curved * (1.0 if model.absolute else np.sqrt(CURVATURE_COUNT**2 - 1)))
        deflection, turn = straight
        rotation = rotation_matrices(turn) @ before.rotation
    known = half_widths(model, loaded, None, points) if model.absolute else np.full(half.shape, np.inf)
    return Prediction(deflection, half, turn, start + deflection, known, rotation, apart, after.theta)


def _linear(model: ArmModel, stand: LoadedPoses, points: Array) -> tuple[Array, Array]:
    """Compute deflections and rotations to first order, Eq. (6), of the arm that no load has deflected."""
    state = model.state
    where = chain(model.vjm, stand.q, np.tile(state.theta_0, (len(stand.q), 1)))
    theta = (state.C_theta @ on_joints(where, stand.loads)).T
    return displacement(where, theta, points), np.einsum("xtr,rt->rx", where.J_theta[3:], theta)


@dataclass(frozen=True)
class LoadExtent:
    """Hold the largest loads of some poses, and their ratios to those of the model's data."""

    force: float  #: Largest force in a pose, all loads together [N].
    moment: float  #: Largest moment about the tool's origin [N m].
    force_ratio: float | None  #: Largest force over that of the model's data [1]; None if unknown.
    moment_ratio: float | None  #: Largest moment over that of the model's data [1]; None if unknown.
    payload_ratio: float | None  #: Largest force over the weight of the rated payload [1]; None if unknown.


def load_extent(model: ArmModel, q: Array, loads: Sequence[Load]) -> LoadExtent:
    """Compute the largest force and moment over some poses, and their ratios to those of the model's data.

    Mathematics: `cor-7`.

    Args:
        model: The model, with the largest loads of its data where these are known.
        q: Actuated joints, (poses, n) [rad, m].
        loads: Loads that act together, each the same in all poses or with one row per pose.

    Returns:
        Sizes and ratios; a ratio is None where the data's load is unknown or there is no load.

    Raises:
        BenchError: When q has another shape or is not finite, or a load has rows for another number of poses.
    """
    total = resultant(tool_pose(model.vjm, q)[1], loads)
    largest = [float(np.linalg.norm(x, axis=1).max(initial=0)) for x in np.hsplit(total, 2)]
    known = (model.about.force, model.about.moment)
    ratios = [_over(value, most) for value, most in zip(largest, known, strict=True)]
    payload = model.arm.payload
    of_payload = largest[0] / (GRAVITY * payload) if payload else None
    return LoadExtent(largest[0], largest[1], ratios[0], ratios[1], of_payload)


def _over(value: float, reference: float | None) -> float | None:
    """Divide by a known number; infinite where it is zero, None where either number is unknown."""
    if reference is None or not value:
        return None
    return value / reference if reference else math.inf


# --- Stiffness of the loaded tool in every direction: the compliance of Eq. (7) and its ellipsoid -----------

SAME_POINT = 1e-7  #: Distance of points that count as one [m]: the tool waits there.
#: Length of a sum of unit vectors, or sine of feed and spindle, that defines no direction [1].
MIN_DIRECTION_LENGTH = 1e-3


def process_wrench(
    along: Array, position: Array, spindle: Array, names: Sequence[str] | None = None
) -> Array:
    """Compute the force of a process on the tool at every point of a path; its moment is zero.

    f = f_feed t + f_cross (s x t) / norm(s x t) + f_axial s, with the tangent t of the path and the spindle
    s. Seen against s, a positive cross force points to the left of the feed. Resistance to the feed is
    negative; so is the thrust of a drill whose s points into the work.

    Mathematics: `cor-6`.

    Args:
        along: Forces along the feed, across it, and along the spindle, (points, 3) [N].
        position: Points of the path, world, (points, 3) [m].
        spindle: Unit vector of the spindle's axis, world, (points, 3) [1].
        names: Names of the points for messages, or None.

    Returns:
        Force and zero moment, world axes, (points, 6) [N, N m].

    Raises:
        BenchError: When an array has another shape or is not finite; or at the first point with a force along
            or across a feed that the path does not define.
    """
    along = check_array(along, (None, 3), "forces along feed, across, axial [N]")
    position = check_array(position, (len(along), 3), "position [m]")
    spindle = check_array(spindle, (len(along), 3), "spindle [1]")
    feed = tangents(position, np.asarray(along[:, :2].any(axis=1)))
    # Axes at every point: feed, across, spindle.
    across = np.cross(spindle, feed)
    sine = np.linalg.norm(across, axis=1)
    there = sine > MIN_DIRECTION_LENGTH
    across[there] /= sine[there, None]
    untold = (
        ("feed", ~feed.any(axis=1), "the path stands still or turns back"),
        ("cross", ~there, "the path stands still, turns back or runs along the spindle"),
    )
    # A force along a direction that is not defined is refused.
    for k, (name, lost, why) in enumerate(untold):
        bad = np.flatnonzero(lost & (along[:, k] != 0))
        if len(bad):
            place = names[bad[0]] if names else f"point {bad[0] + 1}"
            raise BenchError(f"{place}: no direction for its {name} force: {why}")
    force = along[:, :1] * feed + along[:, 1:2] * across + along[:, 2:] * spindle
    return np.hstack([force, np.zeros_like(force)])


def tangents(position: Array, acts: Mask) -> Array:
    """Compute the unit tangent of a path at every point; zero where the path defines none.

    The tangent is halfway between the directions to and from a point. Where the tool waits, the nearest
    points that differ count. A cut ends where its force does: path segments that lead into it and out of it
    do not count there.

    Args:
        position: Points of the path, (points, 3) [m].
        acts: Points at which a force acts, (points,).

    Returns:
        Unit tangents, (points, 3) [1].
    """
    step = np.diff(position, axis=0)
    length = np.linalg.norm(step, axis=1)
    moves = length > SAME_POINT
    group = np.concatenate([[0], np.cumsum(moves)])
    cut = np.bincount(group, acts) > 0
    unit = step[moves] / length[moves, None]
    inside = _mean_directions(unit * (cut[:-1] & cut[1:])[:, None])
    tangent = np.where(inside.any(axis=1, keepdims=True), inside, _mean_directions(unit))
    return np.asarray(tangent[group])


def _mean_directions(unit: Array) -> Array:
    """Compute directions between those before and behind, (points, 3); zero where opposite or missing."""
    sums = np.zeros((len(unit) + 1, 3))
    sums[:-1] += unit
    sums[1:] += unit
    size = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.asarray(np.divide(sums, size, out=np.zeros_like(sums), where=size > MIN_DIRECTION_LENGTH))


@dataclass(frozen=True, repr=False)
class Stiffness(Displayed):
    """Hold how the loaded tool yields to a small further force at its origin."""

    #: Compliance C of Eq. (7), twist = C @ wrench, world axes, (poses, 6, 6) [m/N, rad/N, rad/(N m)].
    compliance: Array
    #: Semi-axes of the ellipsoid over which a unit force moves the tool, the longest first, (poses, 3) [m/N].
    displacement_per_force: Array
    axes: Array  #: Directions of the semi-axes as columns, world axes, (poses, 3, 3) [1].

    def about(self) -> dict[str, object]:
        """Summarise the stiffness: number of poses, least and largest principal stiffness."""
        ends = {"softest_N_per_um": self.principal[:, 0], "stiffest_N_per_um": self.principal[:, -1]}
        return {
            "poses": len(self.displacement_per_force),
            **{name: span(1e-6 * values) for name, values in ends.items()},
        }

    @cached_property
    def principal(self) -> Array:
        """Compute the principal stiffnesses, softest first, (poses, 3) [N/m]; infinite along a rigid axis."""
        with np.errstate(divide="ignore"):
            return np.asarray(1 / self.displacement_per_force)

    @cached_property
    def softest(self) -> Array:
        """Return the unit vector of the softest direction, its largest component positive, (poses, 3) [1]."""
        axis = self.axes[:, :, 0]
        largest = np.take_along_axis(axis, np.abs(axis).argmax(axis=1)[:, None], axis=1)
        return np.asarray(axis * np.where(largest < 0, -1.0, 1.0))


def stiffness(model: ArmModel, q: Array, loads: Sequence[Load] = (), theta: Array | None = None) -> Stiffness:
    """Compute the tangent compliance at the loaded equilibrium, Eq. (7), and its ellipsoid of translations.

    K_w contains only the loads. The term of the arm's own weight, which turns with the arm too, is left out:
    on a KR 500 it changes a compliance by less than a hundredth.

    Mathematics: `loaded-6`.

    Args:
        model: Identified model of the arm.
        q: Joints as commanded, (poses, n) [rad, m].
        loads: Loads besides own weight, each the same in all poses or with one row per pose.
        theta: Virtual joints under these loads, (poses, n_theta) [m, rad], if they are known; None to solve
            them.

    Returns:
        Compliance at the tool's origin, and the ellipsoid of its translations.

    Raises:
        NoEquilibrium: When there is no equilibrium, or the load is exactly a buckling load.
        BenchError: When an argument has another type or shape, joints are not in radians, or a load has rows
            for another number of poses.
    """
    check_type(model, ArmModel, "model")
    check_items(loads, Load, "loads")
    q = model.arm.check_positions(q)
    every = LoadedPoses(q, loads)
    theta = equilibrium(model.state, q, every.loads).theta if theta is None else theta
    return join_rows(
        [_stiffness(model.state, every.select(batch), theta[batch]) for batch in batches(len(q))]
    )


def _stiffness(state: ArmState, poses: LoadedPoses, theta: Array) -> Stiffness:
    vjm, n = state.vjm, state.vjm.arm.n_theta
    lawful = chain(vjm, poses.q, theta)
    where = replace(lawful, J_theta=lawful.J_theta[:, :n], laws=None)
    # K_w of all loads together, and the tangent compliance of the springs, laws included
    K_w = np.zeros((len(poses.q), n, n))
    for load in poses.loads:
        K_w += geometric_stiffness(where, load.wrench, load.point)
    C = tangent(vjm, state.C_theta, lawful, on_joints(where, poses.loads))
    compliance = loaded_compliance(where.J_theta.transpose(2, 0, 1), C, K_w)
    axes, give, _ = np.linalg.svd(compliance[:, :3, :3])
    return Stiffness(compliance, give, axes)


def compliance_half_widths(model: ArmModel, q: Array, tool: Stiffness, force: float) -> Array:
    """Compute half widths of the 95 % interval of how far a force along each principal axis moves the tool.

    Args:
        model: Identified model of the arm.
        q: Joints as commanded, (poses, n) [rad, m].
        tool: Stiffness of the tool in these poses.
        force: Size of the force [N].

    Returns:
        Largest half width over world x, y, z, per principal axis, (poses, 3) [m]; infinite where the data
        have not shown the compliance.

    Raises:
        NoEquilibrium: When the arm has no equilibrium under the force.
    """
    widths, origin = np.empty((len(q), 3)), np.zeros(3)
    for batch in batches(len(q)):
        free = LoadedPoses(q[batch], equilibrium=equilibrium(model.state, q[batch]))
        for k in range(3):
            push = force * tool.axes[batch, :, k]
            pushed = LoadedPoses(q[batch], [Load(np.hstack([push, 0 * push]), origin)])
            widths[batch, k] = half_widths(model, pushed, free, origin[None])[:, 0].max(axis=1)
    return widths
