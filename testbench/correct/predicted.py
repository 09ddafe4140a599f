"""Prediction of poses of the loaded tool with 95 % intervals, and stiffness of the loaded tool.

`predict` evaluates an identified model, by the equilibrium behind Eq. (7) or by the linear model of Eq. (6).
A predicted position is linear in small errors of the unknowns, with a Jacobian such as Eq. (12). With it the
model's posterior gives intervals. Errors common to two poses cancel in the difference of their positions.

`load_extent` compares loads with those under which the model was identified. `stiffness` computes the
compliance of Eq. (7) in every direction, with its ellipsoid. `process_wrench` converts forces along the feed
of a tool, across it and along the spindle to loads of `predict` and `compensate`.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.correct.newton import EquilibriumPoses, equilibrium, pose_slices
from testbench.data.dataset import concatenate_rows, select_evenly, select_rows
from testbench.display import Displayed, span
from testbench.errors import Array, BenchError, Ids, Mask, check_array, check_items, check_type
from testbench.identify.absolute.state import ArmState
from testbench.identify.equations import jacobian, undeflected_arm
from testbench.identify.posterior import (
    CONFIDENCE,
    SECOND_ORDER_FACTOR,
    ArmModel,
    conditional_covariance,
    student_quantile,
)
from testbench.model.kinematics import joint_error_basis
from testbench.model.laws import tangent_C_theta
from testbench.model.load import (
    Load,
    first_order_deflection,
    geometric_stiffness,
    loaded_compliance,
    own_weight_load,
    resultant_wrench,
    sum_generalised_loads,
)
from testbench.model.vjm import (
    evaluate_chain,
    rigid_motion_matrix,
    rotation_matrices,
    rotation_vectors_between,
    tool_poses,
)

# --- Intervals of predicted positions and deflections, and the parameters that widen them most --------------

MAX_SAMPLED_POSES = 60  #: Largest number of poses, evenly spaced, that `largest_uncertainty` evaluates.
#: Least share of the variance for `largest_uncertainty` to name a link, a joint or another cause [1].
MIN_VARIANCE_SHARE = 0.5
MIN_SHARE_OVER_SECOND = 1.2  #: Least ratio of this share to the second largest one [1].


@dataclass(frozen=True)
class LoadedPoses:
    """Hold poses of the arm and the loads that act in them."""

    q: Array  #: Joints as commanded, (poses, n) [rad, m].
    loads: Sequence[Load] = ()  #: Loads that act together, besides own weight.
    #: Whether deflections by own weight count too, if the model has compliances only: they are then measured
    #: from the nominal rigid arm.
    with_own_weight: bool = False
    equilibrium: EquilibriumPoses | None = None  #: Equilibrium under these loads; None if not solved yet.

    def __post_init__(self) -> None:
        """Repeat every load to one row per pose; BenchError where it has another number of rows."""
        object.__setattr__(self, "loads", [load.for_poses(len(self.q)) for load in self.loads])

    def select(self, poses: slice | Ids) -> "LoadedPoses":
        """Select some of the poses with their loads and equilibrium.

        Args:
            poses: Indices of the poses, (k,), or a slice.
        """
        known = None if self.equilibrium is None else select_rows(self.equilibrium, poses)
        return LoadedPoses(
            self.q[poses], [load.select(poses) for load in self.loads], self.with_own_weight, known
        )

    def is_unloaded_state_of(self, other: "LoadedPoses") -> bool:
        """Tell whether these poses have the joints of other poses, but carry no load.

        Args:
            other: The other poses.

        Returns:
            True if no load acts here and the joints are equal.
        """
        return not (self.loads or self.with_own_weight) and np.array_equal(self.q, other.q)

    def solve_equilibrium(self, state: ArmState) -> EquilibriumPoses:
        """Return the static equilibrium under these loads; solve it unless it is known.

        Args:
            state: The identified arm.

        Raises:
            NoEquilibrium: When the arm cannot carry the loads; the message names the pose.
        """
        return self.equilibrium or equilibrium(state, self.q, self.loads)


def motion_half_widths(
    model: ArmModel, end_poses: LoadedPoses, start_poses: LoadedPoses | None, points: Array
) -> Array:
    """Compute half widths of 95 % intervals of motions of the tool from start to end poses, or of positions.

    Mathematics: `int-8`.

    Args:
        model: Identified model of the arm.
        end_poses: Poses at the end of the motion.
        start_poses: Poses at its start, as many; None for positions in the world, by an absolute model.
        points: Points in the tool's frame, (k, 3) [m].

    Returns:
        Half widths along world x, y, z, (poses, k, 3) [m]; infinite where the data do not determine a motion.

    Raises:
        BenchError: When positions are requested of a model of compliances only.
        NoEquilibrium: When the arm cannot carry a load; the message names the pose.
    """
    if start_poses is None and not model.is_absolute:
        raise BenchError(
            "intervals of positions need a model of absolute readings; this one predicts deflections only"
        )
    scatter, widths = _scatter(model), []
    for batch in pose_slices(len(end_poses.q)):
        before = None if start_poses is None else start_poses.select(batch)
        # half widths by the posterior, then the error of a linear model, or the scatter of positions
        rows = motion_jacobian(model, end_poses.select(batch), before, points)
        half = model.posterior.half_widths(rows.reshape(-1, rows.shape[-1])).reshape(rows.shape[:3])
        if not model.is_absolute:
            loaded_poses = end_poses.select(batch)
            free = (
                before
                if before is not None and before.is_unloaded_state_of(loaded_poses)
                else LoadedPoses(loaded_poses.q)
            )
            half = np.hypot(half, linear_model_error(model, loaded_poses, free, points))
        elif start_poses is None:
            half = np.hypot(half, scatter)
        widths.append(half)
    return np.concatenate(widths)


def _scatter(model: ArmModel) -> float:
    """Compute the half width of the 95 % interval of position errors that a model leaves unexplained [m]."""
    return student_quantile(math.inf, (1 + CONFIDENCE) / 2) * model.position_scatter


def relative_half_widths(model: ArmModel, poses: LoadedPoses, point: Array) -> Array:
    """Compute half widths of 95 % intervals of positions relative to each other, not to the base.

    A tracker reads positions in its own frame, not in the arm's base. So a model is more accurate between
    poses than against the base. The rigid motion that fits the errors of all poses best is removed here, as a
    work frame that is measured with the tool removes it.

    Mathematics: `int-9`.

    Args:
        model: Absolute model of the arm.
        poses: At least 3 poses, not all with the tool in one place.
        point: Point in the tool's frame, (3,) [m].

    Returns:
        Half widths along world x, y, z, (poses, 3) [m].

    Raises:
        NoEquilibrium: When the arm cannot carry a load; the message names the pose.
    """
    rows = motion_jacobian(model, poses, None, point[None])[:, 0]
    x = poses.solve_equilibrium(model.state).position_of(point)
    x = x - x.mean(axis=0)
    # F: motions of the points by a translation and a small rotation of the frame
    F = rigid_motion_matrix(x)
    # Jacobian without the motions that the best rigid motion explains
    A = rows.reshape(len(F), -1)
    A = A - F @ np.linalg.lstsq(F, A)[0]
    half = model.posterior.half_widths(A).reshape(x.shape)
    return np.asarray(np.hypot(half, _scatter(model)))


def motion_jacobian(
    model: ArmModel, end_poses: LoadedPoses, start_poses: LoadedPoses | None, points: Array
) -> Array:
    """Compute the derivatives of motions of the tool, or of its positions, by the c uncertain unknowns.

    Mathematics: `cor-8`.

    Args:
        model: Identified model of the arm.
        end_poses: Poses at the end of the motion.
        start_poses: Poses at its start; None for positions.
        points: Points in the tool's frame, (k, 3) [m].

    Returns:
        Change of x, y, z of every point, world axes, (poses, k, 3, c) [m per unit of the unknown].

    Raises:
        NoEquilibrium: When the arm cannot carry a load; the message names the pose.
    """
    rows = _rows(model, end_poses, points)
    # at the start the nominal rigid arm without loads depends on no unknown
    if start_poses is None or not (model.is_absolute or start_poses.loads or start_poses.with_own_weight):
        return rows
    return rows - _rows(model, start_poses, points)


def _rows(model: ArmModel, poses: LoadedPoses, points: Array) -> Array:
    """Compute positions per unit of every uncertain unknown, (poses, k, 3, c).

    An absolute model uses the deflected arm. A model of compliances alone uses the undeflected arm without
    own weight, as Eq. (12) identified it: deflections would add a little of unobservable directions to every
    prediction, which would make its interval infinite. `linear_model_error` covers the difference.
    """
    state, at_rest = model.state, undeflected_arm(model.vjm, poses.q, poses.loads)
    if model.is_absolute:
        theta = poses.solve_equilibrium(state).theta
        where = evaluate_chain(model.vjm, poses.q, theta)
        at_rest = replace(
            at_rest, theta=theta, chain=where, generalised_loads=sum_generalised_loads(where, poses.loads)
        )
    if model.is_absolute or poses.with_own_weight:
        at_rest = replace(
            at_rest,
            generalised_loads=own_weight_load(at_rest.chain, state.body_masses) + at_rest.generalised_loads,
        )
    phi = joint_error_basis(
        state.error_terms,
        model.arm,
        poses.q,
        at_rest.generalised_loads[model.vjm.joint_spring_slice],
        state.torque_scale,
    )
    A = jacobian(model.unknowns, replace(at_rest, error_basis=phi), points, with_orientation=False)
    return A[:, :, model.uncertain_columns].transpose(3, 0, 1, 2)


def linear_model_error(
    model: ArmModel, poses: LoadedPoses, unloaded_poses: LoadedPoses, points: Array
) -> Array:
    """Compute the difference between the deflections by the equilibrium and by the linear model of Eq. (12).

    Compliances are identified by the linear model, so that its error distorts them.

    Mathematics: `int-7`.

    Args:
        model: Identified model of the arm.
        poses: Loaded poses.
        unloaded_poses: The same poses without loads.
        points: Points in the tool's frame, (k, 3) [m].

    Returns:
        Absolute differences along world x, y, z, (poses, k, 3) [m].

    Raises:
        NoEquilibrium: When the arm cannot carry a load; the message names the pose.
    """
    state, loads = model.state, poses.loads
    where, after = evaluate_chain(model.vjm, poses.q), poses.solve_equilibrium(state)
    u = sum_generalised_loads(where, loads)
    if poses.with_own_weight:
        position, rotation = tool_poses(model.vjm, poses.q)
        u = u + own_weight_load(where, state.body_masses)
    else:
        before = unloaded_poses.solve_equilibrium(state)
        position, rotation = before.position, before.rotation
    bent = np.einsum("rxy,py->rpx", after.rotation - rotation, points) + (after.position - position)[:, None]
    return np.asarray(np.abs(bent - first_order_deflection(where, (state.C_theta @ u).T, points)))


@dataclass(frozen=True)
class LargestUncertainty:
    """Hold the link, joint or other cause that contributes most to the uncertainty of predictions."""

    name: str  #: Name of a link or joint, "geometry" or "joint errors".
    #: Share of the variance that exact knowledge of it would remove [1]; if intervals are infinite, share of
    #: them that it would make finite.
    variance_share: float
    is_joint: bool  #: Whether it is the compliance of a joint.


def largest_uncertainty(
    model: ArmModel, q: Array, loads: Sequence[Load], point: Array, of_positions: bool
) -> LargestUncertainty | None:
    """Find the link, joint or other cause whose exact knowledge would reduce the uncertainty most.

    If intervals are infinite, it is the cause whose knowledge would make most of them finite.

    Args:
        model: Identified model of the arm.
        q: Joints as commanded, (poses, n) [rad, m].
        loads: Loads besides own weight, each the same in all poses or with one row per pose.
        point: Point in the tool's frame, (3,) [m].
        of_positions: Whether to consider the uncertainty of positions, not of deflections by the loads.

    Returns:
        The cause; None where no single one reaches `MIN_VARIANCE_SHARE` and `MIN_SHARE_OVER_SECOND`.

    Raises:
        NoEquilibrium: When the arm cannot carry a load; the message names the pose.
    """
    sample = select_evenly(np.arange(len(q)), MAX_SAMPLED_POSES)
    end = LoadedPoses(q, loads, with_own_weight=of_positions).select(sample)
    rows = motion_jacobian(model, end, None if of_positions else LoadedPoses(q[sample]), point[None])
    rows = rows.reshape(-1, rows.shape[-1])
    unseen = np.isinf(model.posterior.standard_deviations(rows))
    shares = _bounded_shares(model, rows[unseen]) if unseen.any() else _variance_shares(model, rows)
    (best, share), (_, second) = sorted(((k, s) for k, s in shares.items()), key=lambda entry: -entry[1])[:2]
    if share < MIN_VARIANCE_SHARE or share < MIN_SHARE_OVER_SECOND * second:
        return None
    return LargestUncertainty(best, share, best in [joint.name for joint in model.arm.joints])


def _variance_shares(model: ArmModel, rows: Array) -> dict[str, float]:
    """Compute the share of the variance of functionals, (k, c), that vanishes if a group is known exactly."""
    k, size = len(rows), np.linalg.norm(model.posterior.covariance_root, axis=0)
    K = model.posterior.covariance(np.vstack([rows, np.diag(1 / np.where(size > 0, size, 1))]))
    whole, every = float(np.trace(K[:k, :k])), np.arange(k)
    return {
        name: (whole - float(np.trace(conditional_covariance(K, every, k + columns)))) / (whole or 1.0)
        for name, columns in _parts(model)
        if len(columns)
    }


def _bounded_shares(model: ArmModel, rows: Array) -> dict[str, float]:
    """Compute the share of unbounded functionals, (k, c), that are bounded if a group is known exactly."""
    shares = {}
    for name, columns in _parts(model):
        rest = rows.copy()
        rest[:, columns] = 0
        shares[name] = float(np.isfinite(model.posterior.standard_deviations(rest)).mean())
    return shares


def _parts(model: ArmModel) -> Iterator[tuple[str, Ids]]:
    """Yield names and columns of groups of uncertain unknowns: links, joints, geometry, errors."""
    unknowns, structure = model.unknowns, model.structure
    for key, name in (("geometry", "geometry"), ("errors", "joint errors")):
        inside = np.arange(unknowns.size)[unknowns.columns(key)]
        yield name, np.flatnonzero(np.isin(model.uncertain_columns, inside))
    first, links = unknowns.first_columns["elastic"], [link.name for link in model.arm.links]
    joints = [joint.name for joint in model.arm.joints]
    laws = model.vjm.joint_laws
    of_laws = [] if laws is None else [joints[k] for k in laws.joint_indices]  # they count as their joint's
    names = [*np.repeat(links, 6), *joints, *of_laws]
    owner = np.array(names)[structure.rows]
    for name in dict.fromkeys(owner.tolist()):
        inside = first + np.flatnonzero(owner == name)
        yield name, np.flatnonzero(np.isin(model.uncertain_columns, inside))


# --- Prediction of the loaded tool, with 95 % intervals -----------------------------------------------------


@dataclass(frozen=True, repr=False)
class Prediction(Displayed):
    """Hold predicted deflections and positions of the tool's origin and m further points, with intervals.

    Deflections are those by the loads; own weight acts both with and without them.
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

    def summary(self) -> dict[str, object]:
        """Summarise the prediction: numbers of poses and points, deflections of the tool's origin."""
        return {
            "poses": len(self.deflection),
            "points": self.deflection.shape[1],
            "deflection_mm": span(1e3 * self.deflection_length[:, 0]),
            "half_width_mm": span(1e3 * self.largest_half_width[:, 0]),
        }

    @cached_property
    def deflection_length(self) -> Array:
        """Compute the length of every deflection, (poses, 1 + m) [m]."""
        return np.asarray(np.linalg.norm(self.deflection, axis=2))

    @cached_property
    def largest_half_width(self) -> Array:
        """Return the largest of the three half widths of every deflection, (poses, 1 + m) [m]."""
        return np.asarray(self.half_width.max(axis=2))


def predict(
    model: ArmModel,
    q: Array,
    loads: Sequence[Load] = (),
    *,
    points: Array | None = None,
    linear: bool = False,
) -> Prediction:
    """Predict deflections and positions of the loaded tool, by the equilibrium behind Eq. (7) or by Eq. (6).

    Args:
        model: Identified model, of deflections alone or absolute, such as `load_model` reads.
        q: Joints as commanded, (poses, n) [rad, m].
        loads: Loads besides own weight, each the same in all poses or with one row per pose.
        points: Points in the tool's frame, (m, 3) [m]; None for the arm's markers.
        linear: Whether to use Eq. (6), the compliance of the unloaded arm.

    Returns:
        Deflections and positions of the tool's origin and the points, with 95 % intervals.

    Raises:
        NoEquilibrium: When the arm cannot carry the loads; the message names the pose.
        BenchError: When an argument has another type or shape, is not finite, or joints are not in radians.
    """
    check_type(model, ArmModel, "model")
    check_items(loads, Load, "loads")
    q = model.arm.check_joint_positions(q)
    points = model.vjm.markers if points is None else check_array(points, (None, 3), "points [m]")
    points = np.vstack([np.zeros(3), points])
    every = LoadedPoses(q, loads)
    return concatenate_rows(
        [_predict(model, every.select(batch), points, linear) for batch in pose_slices(len(q))]
    )


def _predict(model: ArmModel, loaded: LoadedPoses, points: Array, linear: bool) -> Prediction:
    """Predict a batch of poses."""
    before, after = equilibrium(model.state, loaded.q), loaded.solve_equilibrium(model.state)
    loaded, free = replace(loaded, equilibrium=after), LoadedPoses(loaded.q, equilibrium=before)
    half = motion_half_widths(model, loaded, free, points)
    turn, straight = rotation_vectors_between(before.rotation, after.rotation), _linear(model, loaded, points)
    deflection = after.positions_of(points) - before.positions_of(points)
    apart = np.linalg.norm(deflection[:, 0] - straight[0][:, 0], axis=1)
    start = before.positions_of(points)
    rotation = after.rotation
    if linear:
        # Eq. (6) omits second-order deflections: they count once for an absolute model, SECOND_ORDER_FACTOR
        # times for a model of deflections, whose half width has them once already
        curved = linear_model_error(model, loaded, free, points)
        half = np.hypot(half, curved * (1.0 if model.is_absolute else np.sqrt(SECOND_ORDER_FACTOR**2 - 1)))
        deflection, turn = straight
        rotation = rotation_matrices(turn) @ before.rotation
    known = (
        motion_half_widths(model, loaded, None, points) if model.is_absolute else np.full(half.shape, np.inf)
    )
    return Prediction(deflection, half, turn, start + deflection, known, rotation, apart, after.theta)


def _linear(model: ArmModel, stand: LoadedPoses, points: Array) -> tuple[Array, Array]:
    """Compute deflections and rotations of the tool to first order, Eq. (6), at the undeflected arm."""
    state = model.state
    where = evaluate_chain(model.vjm, stand.q, np.tile(state.theta_0, (len(stand.q), 1)))
    theta = (state.C_theta @ sum_generalised_loads(where, stand.loads)).T
    return first_order_deflection(where, theta, points), np.einsum("xtr,rt->rx", where.J_theta[3:], theta)


@dataclass(frozen=True)
class LoadExtent:
    """Hold the largest loads of some poses, and their ratios to those under which a model was identified."""

    force: float  #: Largest resultant force in a pose [N].
    moment: float  #: Largest resultant moment about the tool's origin in a pose [N m].
    force_ratio: float | None  #: Force over the largest one in the model's data [1]; None if unknown.
    moment_ratio: float | None  #: Moment over the largest one in the model's data [1]; None if unknown.
    payload_ratio: float | None  #: Largest force over the weight of the rated payload [1]; None if unknown.


def load_extent(model: ArmModel, q: Array, loads: Sequence[Load]) -> LoadExtent:
    """Compute the largest resultant force and moment over some poses, and compare them with a model's data.

    Mathematics: `cor-7`.

    Args:
        model: Identified model of the arm, with the largest loads of its data where these are known.
        q: Actuated joints, (poses, n) [rad, m].
        loads: Loads that act together, each the same in all poses or with one row per pose.

    Returns:
        Largest loads and their ratios; a ratio is None where either load is unknown or zero.

    Raises:
        BenchError: When q has another shape or is not finite, or a load has rows for another number of poses.
    """
    total = resultant_wrench(tool_poses(model.vjm, q)[1], loads)
    largest = [float(np.linalg.norm(x, axis=1).max(initial=0)) for x in np.hsplit(total, 2)]
    known = (model.origin.largest_force, model.origin.largest_moment)
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

SAME_POINT_DISTANCE = 1e-7  #: Distance up to which two points of a path count as one [m].
#: Least length of a sum of two unit vectors, or of a product of feed and spindle, that has a direction [1].
MIN_DIRECTION_LENGTH = 1e-3


def process_wrench(
    force_components: Array, position: Array, spindle_axis: Array, point_names: Sequence[str] | None = None
) -> Array:
    """Compute process wrenches on the tool, such as of milling, from forces along feed, across and axial.

    f = f_feed t + f_cross (s x t) / norm(s x t) + f_axial s, with the tangent t of the path and the spindle
    s. For a viewer who looks along -s, a positive cross force points to the left of the feed. A resistance to
    the feed is negative; so is the thrust on a drill whose s points into the work.

    Mathematics: `cor-6`.

    Args:
        force_components: Forces along the feed, across it, and along the spindle, (points, 3) [N].
        position: Points of the path, world, (points, 3) [m].
        spindle_axis: Unit vector along the spindle, world, (points, 3) [1].
        point_names: Names of the points, for error messages; None for their numbers.

    Returns:
        Force and zero moment, world axes, (points, 6) [N, N m].

    Raises:
        BenchError: When an array has another shape or is not finite; or at the first point with a force along
            or across a feed that the path does not define.
    """
    force_components = check_array(force_components, (None, 3), "forces along feed, across, axial [N]")
    position = check_array(position, (len(force_components), 3), "position [m]")
    spindle_axis = check_array(spindle_axis, (len(force_components), 3), "spindle_axis [1]")
    feed = path_tangents(position, np.asarray(force_components[:, :2].any(axis=1)))
    # Axes at every point: feed, across, spindle.
    across = np.cross(spindle_axis, feed)
    sine = np.linalg.norm(across, axis=1)
    there = sine > MIN_DIRECTION_LENGTH
    across[there] /= sine[there, None]
    untold = (
        ("feed", ~feed.any(axis=1), "the path stands still or turns back"),
        ("cross", ~there, "the path stands still, turns back or runs along the spindle"),
    )
    # A force along a direction that is not defined is refused.
    for k, (name, lost, why) in enumerate(untold):
        bad = np.flatnonzero(lost & (force_components[:, k] != 0))
        if len(bad):
            place = point_names[bad[0]] if point_names else f"point {bad[0] + 1}"
            raise BenchError(f"{place}: no direction for its {name} force: {why}")
    f = force_components
    force = f[:, :1] * feed + f[:, 1:2] * across + f[:, 2:] * spindle_axis
    return np.hstack([force, np.zeros_like(force)])


def path_tangents(position: Array, has_force: Mask) -> Array:
    """Compute the unit tangent of a path at every point; zero where the path stands still or turns back.

    The tangent bisects the segments before and after a point; points in one place have one tangent. If one of
    these segments has a force at both ends and the other has not, only the former counts, so that approach
    and retract do not change the tangent.

    Args:
        position: Points of the path, (points, 3) [m].
        has_force: Whether a force acts at a point, (points,).

    Returns:
        Unit tangents, (points, 3) [1].
    """
    step = np.diff(position, axis=0)
    length = np.linalg.norm(step, axis=1)
    moves = length > SAME_POINT_DISTANCE
    group = np.concatenate([[0], np.cumsum(moves)])
    cut = np.bincount(group, has_force) > 0
    unit = step[moves] / length[moves, None]
    inside = _mean_directions(unit * (cut[:-1] & cut[1:])[:, None])
    tangent = np.where(inside.any(axis=1, keepdims=True), inside, _mean_directions(unit))
    return np.asarray(tangent[group])


def _mean_directions(unit: Array) -> Array:
    """Compute unit vectors that bisect consecutive ones, (points, 3); zero where these are opposite."""
    sums = np.zeros((len(unit) + 1, 3))
    sums[:-1] += unit
    sums[1:] += unit
    size = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.asarray(np.divide(sums, size, out=np.zeros_like(sums), where=size > MIN_DIRECTION_LENGTH))


@dataclass(frozen=True, repr=False)
class Stiffness(Displayed):
    """Hold the stiffness of the loaded tool against a small further force at its origin."""

    #: Compliance C of Eq. (7), twist = C @ wrench, world axes, (poses, 6, 6) [m/N, rad/N, rad/(N m)].
    compliance: Array
    #: Displacements by a unit force along each principal axis, the largest first, (poses, 3) [m/N],
    #: which are the semi-axes of the ellipsoid of displacements by unit forces.
    displacement_per_force: Array
    principal_axes: Array  #: Directions of the semi-axes as columns, world axes, (poses, 3, 3) [1].

    def summary(self) -> dict[str, object]:
        """Summarise the stiffness: number of poses, ranges of the least and largest principal stiffness."""
        ends = {
            "softest_N_per_um": self.principal_stiffness[:, 0],
            "stiffest_N_per_um": self.principal_stiffness[:, -1],
        }
        return {
            "poses": len(self.displacement_per_force),
            **{name: span(1e-6 * values) for name, values in ends.items()},
        }

    @cached_property
    def principal_stiffness(self) -> Array:
        """Compute the three principal stiffnesses, the softest first, (poses, 3) [N/m]; infinite if rigid."""
        with np.errstate(divide="ignore"):
            return np.asarray(1 / self.displacement_per_force)

    @cached_property
    def softest_direction(self) -> Array:
        """Return the unit vector of the softest direction, world axes, (poses, 3) [1].

        Its sign makes the largest component positive.
        """
        axis = self.principal_axes[:, :, 0]
        largest = np.take_along_axis(axis, np.abs(axis).argmax(axis=1)[:, None], axis=1)
        return np.asarray(axis * np.where(largest < 0, -1.0, 1.0))


def stiffness(model: ArmModel, q: Array, loads: Sequence[Load] = (), theta: Array | None = None) -> Stiffness:
    """Compute the compliance of the loaded tool, Eq. (7), and its principal stiffnesses in translation.

    The geometric stiffness K_w contains the loads but not own weight, which changes a compliance by less than
    a hundredth on a KR 500.

    Mathematics: `loaded-6`.

    Args:
        model: Identified model of the arm.
        q: Joints as commanded, (poses, n) [rad, m].
        loads: Loads besides own weight, each the same in all poses or with one row per pose.
        theta: Virtual joints under these loads, (poses, n_theta) [m, rad]; None to solve them.

    Returns:
        Compliance at the tool's origin, with its principal axes of translation.

    Raises:
        NoEquilibrium: When there is no equilibrium, or the load is exactly a buckling load.
        BenchError: When an argument has another type or shape, joints are not in radians, or a load has rows
            for another number of poses.
    """
    check_type(model, ArmModel, "model")
    check_items(loads, Load, "loads")
    q = model.arm.check_joint_positions(q)
    every = LoadedPoses(q, loads)
    theta = equilibrium(model.state, q, every.loads).theta if theta is None else theta
    return concatenate_rows(
        [_stiffness(model.state, every.select(batch), theta[batch]) for batch in pose_slices(len(q))]
    )


def _stiffness(state: ArmState, poses: LoadedPoses, theta: Array) -> Stiffness:
    vjm, n = state.vjm, state.vjm.arm.n_theta
    lawful = evaluate_chain(vjm, poses.q, theta)
    where = replace(lawful, J_theta=lawful.J_theta[:, :n], joint_laws=None)
    # K_w of all loads together, and the tangent compliance of the springs, laws included
    K_w = np.zeros((len(poses.q), n, n))
    for load in poses.loads:
        K_w += geometric_stiffness(where, load.wrench, load.point)
    C = tangent_C_theta(vjm, state.C_theta, lawful, sum_generalised_loads(where, poses.loads))
    compliance = loaded_compliance(where.J_theta.transpose(2, 0, 1), C, K_w)
    axes, give, _ = np.linalg.svd(compliance[:, :3, :3])
    return Stiffness(compliance, give, axes)


def compliance_half_widths(model: ArmModel, q: Array, tool_stiffness: Stiffness, force: float) -> Array:
    """Compute half widths of 95 % intervals of the displacement by a force along each principal axis.

    Args:
        model: Identified model of the arm.
        q: Joints as commanded, (poses, n) [rad, m].
        tool_stiffness: Stiffness of the tool in these poses.
        force: Magnitude of the force [N].

    Returns:
        Largest half width over world x, y, z, per principal axis, (poses, 3) [m]; infinite where the data do
        not determine the compliance.

    Raises:
        NoEquilibrium: When the arm has no equilibrium under the force.
    """
    widths, origin = np.empty((len(q), 3)), np.zeros(3)
    for batch in pose_slices(len(q)):
        free = LoadedPoses(q[batch], equilibrium=equilibrium(model.state, q[batch]))
        for k in range(3):
            push = force * tool_stiffness.principal_axes[batch, :, k]
            pushed = LoadedPoses(q[batch], [Load(np.hstack([push, 0 * push]), origin)])
            widths[batch, k] = motion_half_widths(model, pushed, free, origin[None])[:, 0].max(axis=1)
    return widths
