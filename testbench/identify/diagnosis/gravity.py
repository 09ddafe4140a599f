"""Gravity in another direction than the nominal one: a base that hangs, stands on a wall or is tilted.

A hung weight pulls along -z of the nominal world frame. If the base is mounted otherwise, it pulls along a
unit vector g of these axes. Deflections are linear in the force. So g follows by least squares from the
deflections d_k that the expected compliances have under the same force along x, y and z:

    d = x_1 d_1 + x_2 d_2 + x_3 d_3,    g = x / |x|

Deflections alone cannot distinguish a hanging arm from exchanged readings before and after. A tracker that
stands level can: its z against the registered base. Without one, own weight can: it has already bent the arm
towards g in the unloaded readings.

Absolute readings show the direction of the arm's own weight (`mounting_by_own_weight`). With gravity from the
wrong side, joint springs would have to be negative to fit. They are held at zero, and explain none of the
sag. With gravity from the right side they explain it, and the readings scatter less about the arm. A few
directions are tried: that of a level tracker, a ceiling, four walls, and the tilt of least scatter.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain as joined

import numpy as np

from testbench.arm.mjcf import angle_unit, find_body, read_mjcf
from testbench.data.dataset import Dataset, Series, evenly_spaced, select_rows
from testbench.errors import Array, BenchError, InputError
from testbench.identify.absolute.align import align_all
from testbench.identify.absolute.evidence import fit_geometry_and_springs
from testbench.identify.absolute.state import ArmState, nominal_state, torque_scale
from testbench.identify.base_frame import RegisteredDataset
from testbench.identify.diagnosis.kinematics import Issue, Observations, fit_kinematics
from testbench.identify.equations import weighted_readings
from testbench.identify.prior import Prior, PriorScaling, scale_by_prior
from testbench.identify.registration import Frame
from testbench.model.kinematics import body_pose
from testbench.model.load import first_order_deflection, own_weight_load, read_body_masses
from testbench.model.structure import joints_only
from testbench.model.vjm import Vjm, evaluate_chain, rotation_matrices

DOWN = np.array([0.0, 0.0, -1.0])
MAX_WEIGHT_ANGLE = np.deg2rad(1.0)  #: Largest angle between a weight and the vertical [rad].
#: Largest tilt of a floor, and of a tracker that is levelled by its feet [rad].
MAX_LEVEL_TILT = np.deg2rad(3.0)
MIN_TILT = np.deg2rad(5.0)  #: Least angle between -z and g by deflections of a wrong mounting [rad].
#: Largest angle from g to the direction of a ceiling, a wall or a level tracker that replaces it [rad].
SNAP_ANGLE = np.deg2rad(22.0)
MIN_REVERSED_ANGLE = np.deg2rad(120.0)  #: Angle from which weights seem to pull upwards [rad].
MIN_CERTAIN_ANGLE, MIN_EXPLAINED_SHARE = np.deg2rad(45.0), 0.7
"""Angle of g from -z [rad], and share of the typical deflection that it explains [1], above which g is
certain."""
MIN_GRAVITY_READINGS = 6  #: Fewest readings from which a direction of gravity is estimated.
N_REWEIGHTINGS = 5  #: Reweighted solutions of the robust least squares.
ROUNDING_ERROR = 1e-9  #: Rounding error of a rotation matrix [1].


def with_gravity_along(data: Dataset, g: Array) -> Dataset:
    """Rotate the wrenches of all runs from gravity along -z to gravity along g.

    Args:
        data: The runs, with wrenches stated for gravity along -z.
        g: Direction of gravity in the nominal world frame, a unit vector, (3,) [1].
    """
    return replace(data, wrench=(data.wrench.reshape(-1, 2, 3) @ rotation_from_down(g).T).reshape(-1, 6))


def with_base_rotated(vjm: Vjm, g: Array) -> Vjm:
    """Rotate the arm's base so that gravity along g becomes gravity along -z.

    Args:
        vjm: Nominal model of the arm.
        g: Direction of gravity in the nominal world frame, a unit vector, (3,) [1].

    Returns:
        The arm as it is mounted.
    """
    turn = np.eye(4)
    turn[:3, :3] = rotation_from_down(g).T
    return replace(vjm, base_pose=turn @ vjm.base_pose)


def rotation_from_down(g: Array) -> Array:
    """Compute the smallest rotation from -z to the unit vector g, (3, 3); half a turn about x for +z."""
    axis = np.cross(DOWN, g)
    size = float(np.linalg.norm(axis))
    unit = axis / size if size > ROUNDING_ERROR else np.eye(3)[0]
    return rotation_matrices(angle_between(DOWN, g) * unit)


def angle_between(a: Array, b: Array) -> float:
    """Compute the angle between two vectors, atan2(|a x b|, a . b).

    Args:
        a: A vector, (3,).
        b: Another, (3,), in any unit.

    Returns:
        The angle, 0 to pi [rad].
    """
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def gravity_by_tracker(registered_runs: RegisteredDataset) -> Array | None:
    """Find gravity in the nominal world frame, a unit vector, (3,), from a tracker that stands level.

    The result is None without a registration, or when stations disagree.
    """
    if registered_runs.frame != "tracker" or registered_runs.registration is None:
        return None
    return mean_gravity(registered_runs.registration.frames.values())


def mean_gravity(frames: Iterable[Frame]) -> Array | None:
    """Average the direction of gravity, (3,) [1], over the frames of trackers that stand level.

    Gravity along -z of a frame with rotation R is R^T (0, 0, -1) in the nominal world frame. The result is
    None when one frame differs from the mean by MAX_LEVEL_TILT or more.
    """
    directions = np.array([DOWN @ frame.rotation for frame in frames])
    mean = directions.mean(axis=0) / np.linalg.norm(directions.mean(axis=0))
    return mean if max(angle_between(direction, mean) for direction in directions) < MAX_LEVEL_TILT else None


@dataclass(frozen=True)
class GravityDirection:
    """Hold an estimated direction of gravity, and the evidence for it."""

    g: Array  #: Gravity in the nominal world frame, a unit vector, (3,) [1].
    #: Gravity by the z axis of a level tracker, (3,) [1]; None if unknown.
    tracker_gravity: Array | None = None
    #: Share of the typical deflection that the prior explains with this gravity [1].
    explained_deflection_share: float = 0.0

    @property
    def confirmed_by_tracker(self) -> bool:
        """Tell whether a level tracker shows gravity within SNAP_ANGLE of the estimated direction."""
        return self.tracker_gravity is not None and bool(
            angle_between(self.tracker_gravity, self.g) < SNAP_ANGLE
        )

    @property
    def is_certain(self) -> bool:
        """Tell whether only a wrong mounting of the base explains the estimated direction of gravity.

        Its angle from -z is above MIN_CERTAIN_ANGLE, and it explains over MIN_EXPLAINED_SHARE of the typical
        deflection.
        """
        return (
            angle_between(self.g, DOWN) > MIN_CERTAIN_ANGLE
            and self.explained_deflection_share > MIN_EXPLAINED_SHARE
        )


def loads_are_weights(data: Dataset) -> bool:
    """Tell whether some runs have loads and all forces are weights, within MAX_WEIGHT_ANGLE of -z."""
    force = data.wrench[:, :3]
    pushed = force.any(axis=1)
    return bool(pushed.any()) and all(
        angle_between(vector, DOWN) <= MAX_WEIGHT_ANGLE for vector in force[pushed]
    )


def suspected_gravity(
    vjm: Vjm, compliance_prior: PriorScaling, data: Dataset, tracker_gravity: Array | None
) -> GravityDirection | None:
    """Find a direction of gravity other than the nominal one, if the deflections show one.

    The direction is the least-squares x / |x| of d = x_1 d_1 + x_2 d_2 + x_3 d_3, with d_k the deflections
    under gravity along axis k. If a level tracker is near this direction, its direction is used.

    Args:
        vjm: The arm's virtual joint model.
        compliance_prior: Prior of its compliances.
        data: Loaded runs.
        tracker_gravity: Gravity in the nominal world frame by a level tracker, a unit vector, (3,) [1]; None
            if unknown.

    Returns:
        The direction of gravity. None when it is nominal, when a load is no weight, or when there are fewer
        than MIN_GRAVITY_READINGS readings.
    """
    if not loads_are_weights(data) or np.count_nonzero(data.is_measured) < MIN_GRAVITY_READINGS:
        return None
    g, explained_share = _by_deflections(vjm, compliance_prior, data)
    if tracker_gravity is not None and angle_between(tracker_gravity, DOWN) < MAX_LEVEL_TILT:
        return None  # the base stands upright, whatever else is wrong
    if tracker_gravity is not None and angle_between(tracker_gravity, g) < min(
        SNAP_ANGLE, angle_between(g, DOWN)
    ):
        return GravityDirection(
            snap_direction(tracker_gravity, MAX_LEVEL_TILT), tracker_gravity, explained_share
        )
    if angle_between(g, DOWN) < MIN_TILT:
        return None
    return GravityDirection(snap_direction(g, SNAP_ANGLE), tracker_gravity, explained_share)


def snap_direction(g: Array, angle_limit: float) -> Array:
    """Replace a direction of gravity by the nearest one of a ceiling or a wall, if that is near.

    Args:
        g: Direction of gravity, a unit vector, (3,) [1].
        angle_limit: Largest angle to the nearest one [rad]; beyond it the direction is kept.

    Returns:
        The nearest of +z, +-x and +-y, or g, (3,) [1].
    """
    nearest = min((*np.eye(3), *-np.eye(3)[:2]), key=lambda side: angle_between(g, side))
    return nearest if angle_between(g, nearest) < angle_limit else g


def _by_deflections(vjm: Vjm, compliance_prior: PriorScaling, data: Dataset) -> tuple[Array, float]:
    """Fit the direction of gravity, (3,), by robust least squares, and the share that it explains [1]."""
    pi, structure = compliance_prior.L @ compliance_prior.expected_x, compliance_prior.structure
    read = [weighted_readings(vjm, structure, with_gravity_along(data, e)) for e in np.eye(3)]
    A, y = np.stack([(readings.A @ pi).ravel() for readings in read], axis=1), read[0].y.ravel()
    weight = np.ones(len(y))
    for _ in range(N_REWEIGHTINGS):
        x = np.linalg.lstsq(A * weight[:, None], y * weight)[0]
        off = np.linalg.norm((y - A @ x).reshape(-1, 3), axis=1)
        weight = np.repeat(1 / np.sqrt(1 + np.square(off / max(float(np.median(off)), 1e-12))), 3)
    typical = float(np.median(np.linalg.norm(y.reshape(-1, 3), axis=1)))
    explained_share = 1 - float(np.median(off)) / max(typical, 1e-12)
    return np.asarray(x / max(float(np.linalg.norm(x)), 1e-300)), explained_share


def mounting_issue(vjm: Vjm, gravity: GravityDirection, log_likelihood_gain: float | None = None) -> Issue:
    """Make the issue of a base that is mounted so that gravity has another direction than the nominal one.

    Args:
        vjm: Nominal model of the arm.
        gravity: Estimated direction of gravity.
        log_likelihood_gain: Gain over the nominal direction [nats]; None if they were not compared.

    Returns:
        The issue. Its size, (7,) [1], holds gravity in the base's axes, then a quaternion (w, x, y, z): the
        orientation of the base's body in its parent that rigid.xml needs.

    Raises:
        InputError: When rigid.xml cannot be read.
    """
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    arm, root = vjm.arm, read_mjcf(vjm.arm.mjcf_path)
    base_pose = body_pose(arm, find_body(arm.mjcf_path, root, arm.links[0].name), angle_unit(root))
    stands = base_pose @ np.linalg.inv(vjm.base_pose) @ with_base_rotated(vjm, gravity.g).base_pose
    turn = Rotation.from_matrix(stands[:3, :3]).as_quat(scalar_first=True)
    turn = turn * np.sign(turn[np.abs(turn) > ROUNDING_ERROR][0])
    size = np.concatenate([gravity.g @ vjm.base_pose[:3, :3], turn])
    details = {"tracker_agrees": gravity.confirmed_by_tracker}
    return Issue("mounting", (arm.links[0].name,), size, details, log_likelihood_gain)


MAX_ROWS_PER_SERIES = 150  #: Most rows of a series that are fitted, evenly spaced.
MIN_COMPLIANCE_RATIO = 0.05
"""Fitted over nominal compliance below which a joint that carries weight is held at the bound of zero [1]."""
#: Typical torque of a joint that carries weight, over the largest torque of all joints, at least [1].
MIN_TORQUE_RATIO = 0.05
MAX_SCATTER_OVER_REACH = 5e-3  #: Scatter, over the reach, above which more than the mounting is wrong [1].
MIN_HANGING_GAIN, NEAREST_SHARE = 8.0, 0.8
"""Least log-likelihood gain of a hanging arm [nats]; share of the readings that count, the nearest [1]."""
#: Tilts at which the scatter is computed to find the tilt of least scatter [rad].
PROBE_TILT = np.deg2rad(15.0)
MIN_MOUNTING_GAIN, MIN_MOUNTING_GAIN_BY_TRACKER = 20.0, 7.0
"""Least log-likelihood gain of another mounting, and the same if a level tracker agrees [nats]."""
#: Scatter over that with the nominal mounting, above which no mounting is reported [1].
MAX_MOUNTING_SCATTER_RATIO = 0.9


def mounting_by_own_weight(state: ArmState, series: Sequence[Series], prior: Prior) -> Issue | None:
    """Find another mounting of the base under which gravity explains absolute readings much better.

    With the scatter s of the readings in n poses, a mounting has the log-likelihood gain
    3 n log(s_nominal / s_mounting).

    Args:
        state: The arm as calibrated with the nominal mounting.
        series: The readings of the calibration.
        prior: Nominal prior of the compliances.

    Returns:
        The issue; None when the nominal mounting explains the readings as well, or when they scatter too
        much to tell.
    """
    tracker_gravity = mean_gravity(state.frames.values())
    turned = tracker_gravity is not None and angle_between(tracker_gravity, DOWN) > MAX_LEVEL_TILT
    if not turned and not _springs_at_zero(state):
        return None
    # How well gravity along -z explains the readings.
    series = [
        select_rows(readings, evenly_spaced(readings.n_rows, MAX_ROWS_PER_SERIES)) for readings in series
    ]
    poses = sum(len(np.unique(readings.pose_id)) for readings in series)
    nominal_scatter = _scatter(state, series, prior, DOWN)
    if nominal_scatter > MAX_SCATTER_OVER_REACH * state.vjm.reach:
        return None
    # Other directions: first the one in which trackers stand level, then walls, ceiling and tilts.
    first = (
        [snap_direction(tracker_gravity, MAX_LEVEL_TILT)] if tracker_gravity is not None and turned else []
    )
    others = (
        joined((*np.eye(3), *-np.eye(3)[:2]), _tilts(state, series, prior, nominal_scatter))
        if _springs_at_zero(state)
        else ()
    )
    for directions, least in ((first, MIN_MOUNTING_GAIN_BY_TRACKER), (others, MIN_MOUNTING_GAIN)):
        tried = [(_scatter(state, series, prior, g), g) for g in directions]
        scatter, g = min(tried, key=lambda trial: trial[0], default=(np.inf, DOWN))
        gain = 3 * poses * float(np.log(nominal_scatter / scatter)) if np.isfinite(scatter) else 0.0
        if scatter < MAX_MOUNTING_SCATTER_RATIO * nominal_scatter and gain > least:
            return mounting_issue(state.vjm, GravityDirection(g, tracker_gravity), gain)
    return None


def _springs_at_zero(state: ArmState) -> bool:
    """Tell whether the compliances of joints that carry weight are held at zero."""
    compliance, joints = np.diag(state.C_theta)[state.vjm.joint_spring_slice], state.vjm.arm.joints
    nominal = np.array([joint.compliance for joint in joints])
    carries = state.torque_scale > MIN_TORQUE_RATIO * state.torque_scale.max(initial=0)
    return bool((carries & (compliance < MIN_COMPLIANCE_RATIO * nominal)).any())


def _scatter(state: ArmState, series: Sequence[Series], prior: Prior, g: Array) -> float:
    """Measure the scatter of readings about the arm with gravity along g, (3,) [m]; infinite if none fits."""
    vjm, every = with_base_rotated(state.vjm, g), tuple(series)
    bare = nominal_state(vjm, state.body_masses, torque_scale(vjm, state.body_masses, every))
    try:
        noise = fit_geometry_and_springs(
            align_all(bare, every), every, scale_by_prior(prior, vjm, joints_only(vjm.arm))
        )[1]
    except BenchError:
        return float("inf")
    return float(
        np.hypot(
            noise.position_model_error, np.mean([readings.sigma for readings in series]) * noise.factor[0]
        )
    )


def _tilts(
    state: ArmState, series: Sequence[Series], prior: Prior, nominal_scatter: float
) -> Iterator[Array]:
    """Yield the tilt of least variance, by a parabola through probes about both level axes."""
    slope, bend = np.zeros(2), np.zeros(2)
    for k in range(2):
        low, high = (
            _scatter(state, series, prior, _tilted_gravity(s * PROBE_TILT * np.eye(2)[k])) for s in (-1, 1)
        )
        slope[k], bend[k] = (high**2 - low**2) / 2, (high**2 + low**2) / 2 - nominal_scatter**2
    if np.isfinite(slope).all() and (bend > 0).all():
        yield _tilted_gravity(-PROBE_TILT * slope / (2 * bend))


def _tilted_gravity(by: Array) -> Array:
    """Compute gravity in the axes of a base tilted by angles about its x and y, (2,) [rad]."""
    size = float(np.linalg.norm(by))
    return np.array([*(np.sin(size) * by / max(size, 1e-12)), -np.cos(size)])


def bends_like_hanging_arm(unloaded: Observations, loaded: Observations, C_theta: Array) -> bool:
    """Tell whether own weight bends the arm in its unloaded readings like a hanging arm, not an upright one.

    This matters when targets move against stated weights. Three mistakes do that: the arm hangs, readings
    before and after are exchanged, or the force has the other sign. With RMS distances s of the nearest
    NEAREST_SHARE of the readings in n poses, a hanging arm has the log-likelihood gain
    3 n log(s_upright / s_hanging); s_upright is the smaller one of the unloaded and the loaded readings.

    Args:
        unloaded: Unloaded readings.
        loaded: Loaded readings.
        C_theta: Expected compliances, scaled to the readings, (n_theta, n_theta) [m/N, rad/(N m)].

    Returns:
        Whether this gain exceeds MIN_HANGING_GAIN; False when the nominal model has no masses.
    """
    vjm = unloaded.vjm
    try:
        weights = read_body_masses(vjm.arm)
    except InputError:  # its weight is unknown
        return False
    left = []
    for observations, g in ((unloaded, -DOWN), (loaded, DOWN), (unloaded, DOWN)):
        turned = with_base_rotated(vjm, g)
        where = evaluate_chain(turned, observations.q)
        theta = (C_theta @ own_weight_load(where, weights)).T
        sag = first_order_deflection(where, theta, observations.markers) @ rotation_from_down(g).T
        bare = replace(observations, position=observations.position - sag)
        bare = bare.with_free(frame=True, targets=True)
        off = np.sort(fit_kinematics(bare).distances(observations))
        left.append(float(np.sqrt(np.square(off[: int(np.ceil(NEAREST_SHARE * len(off)))]).mean())))
    hung, *upright = left
    poses = len(np.unique(unloaded.q, axis=0))  # all that is read in one shares its errors of geometry
    return 3 * poses * float(np.log(min(upright) / max(hung, 1e-12))) > MIN_HANGING_GAIN
