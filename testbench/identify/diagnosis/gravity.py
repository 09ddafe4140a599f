"""Gravity from another side than the arm's folder has it: a base that hangs, stands on a wall or is tilted.

A hung weight pulls along -z of the folder's world. If the base is mounted otherwise, it pulls along a unit
vector g of these axes. Deflections are linear in the force. So g follows by least squares from the
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
from testbench.identify.absolute.evidence import first_fit
from testbench.identify.absolute.state import ArmState, nominal_state, torque_scale
from testbench.identify.diagnosis.kinematics import FreeParameters, Issue, Observations, fit
from testbench.identify.metric import Prior, PriorScaling, scale_by_prior
from testbench.identify.registered import RegisteredDataset
from testbench.identify.registration import Frame
from testbench.identify.rows import single_readings
from testbench.model.kinematics import body_pose
from testbench.model.load import displacement, own_weight, read_weights
from testbench.model.structure import joints_only
from testbench.model.vjm import Vjm, chain, rotation

DOWN = np.array([0.0, 0.0, -1.0])
VERTICAL_ANGLE = np.deg2rad(1.0)  #: Angle of a force against the vertical up to which it is a weight [rad].
#: Greatest tilt of a tracker that is levelled by its feet, and of a floor [rad].
LEVEL_ANGLE = np.deg2rad(3.0)
MIN_TILT = np.deg2rad(5.0)  #: Angle of g from -z, by deflections, from which a mounting is examined [rad].
SNAP_ANGLE = np.deg2rad(22.0)  #: Angle up to which g is that of a ceiling, a wall or a level tracker [rad].
REVERSED_ANGLE = np.deg2rad(120.0)  #: Angle from which weights seem to pull upwards [rad].
FAR_ANGLE, MIN_EXPLAINED = np.deg2rad(45.0), 0.7
"""Angle of g [rad], and share of the typical deflection that it explains, from which it is certain."""
MIN_READINGS = 6  #: Least readings that determine the three numbers of a direction.
ROUNDS = 5  #: Weightings of the least squares.
ROUNDING = 1e-9  #: Rounding error of a rotation matrix [1].


def with_gravity_along(data: Dataset, g: Array) -> Dataset:
    """Rotate all wrenches from gravity along -z to gravity along g.

    Args:
        data: The runs, with loads stated for gravity along -z.
        g: Direction of gravity in the folder's world, a unit vector, (3,) [1].
    """
    return replace(data, wrench=(data.wrench.reshape(-1, 2, 3) @ rotation_from_down(g).T).reshape(-1, 6))


def with_base_rotated(vjm: Vjm, g: Array) -> Vjm:
    """Rotate the arm's base so that gravity along g becomes gravity along -z.

    Args:
        vjm: The arm as its folder has it.
        g: Direction of gravity in the folder's world, a unit vector, (3,) [1].

    Returns:
        The arm as it is mounted.
    """
    turn = np.eye(4)
    turn[:3, :3] = rotation_from_down(g).T
    return replace(vjm, base=turn @ vjm.base)


def rotation_from_down(g: Array) -> Array:
    """Compute the smallest rotation from -z to the unit vector g, (3, 3); half a turn about x for +z."""
    axis = np.cross(DOWN, g)
    size = float(np.linalg.norm(axis))
    angle = float(np.arctan2(size, DOWN @ g))
    return rotation(axis / size if size > ROUNDING else np.eye(3)[0], angle)


def angle(a: Array, b: Array) -> float:
    """Compute the angle between two vectors, atan2(|a x b|, a . b).

    Args:
        a: A vector, (3,).
        b: Another, (3,), in any unit.

    Returns:
        The angle, 0 to pi [rad].
    """
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def gravity_by_tracker(registered: RegisteredDataset) -> Array | None:
    """Find gravity in the folder's world, a unit vector, (3,), from a tracker that stands level.

    It is None without a registration, or when stations disagree.
    """
    if registered.frame != "tracker" or registered.registration is None:
        return None
    return mean_gravity(registered.registration.frames.values())


def mean_gravity(frames: Iterable[Frame]) -> Array | None:
    """Average the direction of gravity, (3,) [1], over frames of trackers that stand level.

    Gravity along -z of a frame with rotation R is R^T (0, 0, -1) in the base's world. The result is None when
    one frame differs from the mean by LEVEL_ANGLE or more.
    """
    directions = np.array([DOWN @ frame.rotation for frame in frames])
    mean = directions.mean(axis=0) / np.linalg.norm(directions.mean(axis=0))
    return mean if max(angle(direction, mean) for direction in directions) < LEVEL_ANGLE else None


@dataclass(frozen=True)
class GravityDirection:
    """Hold the direction of gravity, as found from the loads and from a level tracker."""

    g: Array  #: Gravity in the folder's world, a unit vector, (3,) [1].
    level: Array | None = None  #: Gravity by the z axis of a level tracker, (3,) [1]; None if unknown.
    explained: float = 0.0  #: Share of the typical deflection that the prior explains with this gravity [1].

    @property
    def confirmed_by_level(self) -> bool:
        """Tell whether a level tracker has gravity within SNAP_ANGLE of this direction."""
        return self.level is not None and bool(angle(self.level, self.g) < SNAP_ANGLE)

    @property
    def is_certain(self) -> bool:
        """Tell whether gravity is beyond FAR_ANGLE from -z and explains over MIN_EXPLAINED of the sag.

        No other mistake does both.
        """
        return angle(self.g, DOWN) > FAR_ANGLE and self.explained > MIN_EXPLAINED


def weights_only(data: Dataset) -> bool:
    """Tell whether there are loads and all are weights: forces within VERTICAL_ANGLE of -z."""
    force = data.wrench[:, :3]
    pushed = force.any(axis=1)
    return bool(pushed.any()) and all(angle(vector, DOWN) <= VERTICAL_ANGLE for vector in force[pushed])


def suspected_gravity(
    vjm: Vjm, scaling: PriorScaling, data: Dataset, level: Array | None
) -> GravityDirection | None:
    """Find another direction of gravity than that of the arm's folder, if the deflections show one.

    The direction is the least-squares x / |x| of d = x_1 d_1 + x_2 d_2 + x_3 d_3, with d_k the deflections
    under gravity along axis k. A level tracker near it takes precedence.

    Args:
        vjm: The arm's virtual joint model.
        scaling: Prior of its compliances.
        data: Loaded runs.
        level: Gravity in the folder's world if the tracker stands level, a unit vector, (3,) [1]; None if
            unknown.

    Returns:
        The direction of gravity. None when it is as in the folder, when a load is no weight, or when there
        are fewer than MIN_READINGS readings.
    """
    if not weights_only(data) or np.count_nonzero(data.seen) < MIN_READINGS:
        return None
    g, explained = _by_deflections(vjm, scaling, data)
    if level is not None and angle(level, DOWN) < LEVEL_ANGLE:
        return None  # it stands upright, whatever else is wrong
    if level is not None and angle(level, g) < min(SNAP_ANGLE, angle(g, DOWN)):
        return GravityDirection(snap_direction(level, LEVEL_ANGLE), level, explained)
    return (
        None
        if angle(g, DOWN) < MIN_TILT
        else GravityDirection(snap_direction(g, SNAP_ANGLE), level, explained)
    )


def snap_direction(g: Array, angle_limit: float) -> Array:
    """Replace a direction by the nearest one of a ceiling or a wall, if that is near.

    Args:
        g: Direction of gravity, a unit vector, (3,) [1].
        angle_limit: Angle from which the direction is kept as it is [rad].

    Returns:
        The nearest of +z, +-x and +-y, or g, (3,) [1].
    """
    nearest = min((*np.eye(3), *-np.eye(3)[:2]), key=lambda side: angle(g, side))
    return nearest if angle(g, nearest) < angle_limit else g


def _by_deflections(vjm: Vjm, scaling: PriorScaling, data: Dataset) -> tuple[Array, float]:
    """Fit the direction of gravity, (3,), by robust least squares, and the share that it explains [1]."""
    pi = scaling.L @ scaling.expected
    read = [single_readings(vjm, scaling.structure, with_gravity_along(data, e)) for e in np.eye(3)]
    A, y = np.stack([(readings.A @ pi).ravel() for readings in read], axis=1), read[0].y.ravel()
    weight = np.ones(len(y))
    for _ in range(ROUNDS):
        x = np.linalg.lstsq(A * weight[:, None], y * weight)[0]
        off = np.linalg.norm((y - A @ x).reshape(-1, 3), axis=1)
        weight = np.repeat(1 / np.sqrt(1 + np.square(off / max(float(np.median(off)), 1e-12))), 3)
    typical = float(np.median(np.linalg.norm(y.reshape(-1, 3), axis=1)))
    explained = 1 - float(np.median(off)) / max(typical, 1e-12)
    return np.asarray(x / max(float(np.linalg.norm(x)), 1e-300)), explained


def mounting(vjm: Vjm, pull: GravityDirection, nats: float | None = None) -> Issue:
    """Report a base that is mounted so that gravity has the direction of the pull.

    Args:
        vjm: The arm as its folder has it.
        pull: Direction of gravity.
        nats: Nats that the readings gain by it; None if they were not compared.

    Returns:
        The issue. Its size, (7,) [1], holds gravity in the base's axes, then a quaternion (w, x, y, z): the
        orientation of the base's body in its parent that rigid.xml needs.

    Raises:
        InputError: When rigid.xml cannot be read.
    """
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    arm, root = vjm.arm, read_mjcf(vjm.arm.mjcf_path)
    base_pose = body_pose(arm, find_body(arm.mjcf_path, root, arm.links[0].name), angle_unit(root))
    stands = base_pose @ np.linalg.inv(vjm.base) @ with_base_rotated(vjm, pull.g).base
    turn = Rotation.from_matrix(stands[:3, :3]).as_quat(scalar_first=True)
    turn = turn * np.sign(turn[np.abs(turn) > ROUNDING][0])
    size = np.concatenate([pull.g @ vjm.base[:3, :3], turn])
    return Issue("mounting", (arm.links[0].name,), size, {"level": pull.confirmed_by_level}, nats)


MAX_ROWS = 150  #: Rows of a series, evenly out of more, that are fitted.
MIN_CARRYING_COMPLIANCE = 0.05
"""Compliance over the folder's below which the fit would make a joint that carries weight negative."""
CARRYING_SHARE = 0.05  #: Typical torque of a joint over the largest from which it carries weight.
MAX_SCATTER = 5e-3  #: Scatter, over the reach, above which more than the mounting is wrong [1].
MIN_HANGING_NATS, FITTING_SHARE = 8.0, 0.8
"""Log-likelihood from which an arm hangs [nats]; share of the readings, the nearest, that count [1]."""
PROBE_TILT = np.deg2rad(15.0)  #: Tilt at which the scatter is probed for where it is least [rad].
MIN_MOUNTING_NATS, MIN_MOUNTING_NATS_LEVELLED = 20.0, 7.0
"""Log-likelihood that a mounting has to gain, and the same where a level tracker agrees [nats]."""
#: Ratio of scatter to that with the folder's mounting, above which no mounting is reported [1].
MAX_SCATTER_RATIO = 0.9


def mounting_by_own_weight(state: ArmState, series: Sequence[Series], prior: Prior) -> Issue | None:
    """Find a base mounting under which gravity explains absolute readings much better.

    With scatter s of the readings in n poses, a mounting gains 3 n log(s_folder / s_mounting) nats.

    Args:
        state: The arm as calibrated with the mounting of its folder.
        series: The readings of the calibration.
        prior: Prior of the compliances, from the folder.

    Returns:
        The mounting; None when the one of the folder explains the readings as well, or when they scatter too
        much to tell.
    """
    level = mean_gravity(state.frames.values())
    turned = level is not None and angle(level, DOWN) > LEVEL_ANGLE
    if not turned and not _springs_at_zero(state):
        return None
    # How well gravity along -z explains the readings.
    series = [select_rows(readings, evenly_spaced(readings.rows, MAX_ROWS)) for readings in series]
    poses = sum(len(np.unique(readings.pose)) for readings in series)
    folder_scatter = _scatter(state, series, prior, DOWN)
    if folder_scatter > MAX_SCATTER * state.vjm.reach:
        return None
    # Other directions: first the one in which trackers stand level, then walls, ceiling and tilts.
    first = [snap_direction(level, LEVEL_ANGLE)] if level is not None and turned else []
    others = (
        joined((*np.eye(3), *-np.eye(3)[:2]), _tilts(state, series, prior, folder_scatter))
        if _springs_at_zero(state)
        else ()
    )
    for directions, least in ((first, MIN_MOUNTING_NATS_LEVELLED), (others, MIN_MOUNTING_NATS)):
        tried = [(_scatter(state, series, prior, g), g) for g in directions]
        scatter, g = min(tried, key=lambda trial: trial[0], default=(np.inf, DOWN))
        nats = 3 * poses * float(np.log(folder_scatter / scatter)) if np.isfinite(scatter) else 0.0
        if scatter < MAX_SCATTER_RATIO * folder_scatter and nats > least:
            return mounting(state.vjm, GravityDirection(g, level), nats)
    return None


def _springs_at_zero(state: ArmState) -> bool:
    """Tell whether springs of joints that carry weight are held at zero."""
    compliance, joints = np.diag(state.C_theta)[state.vjm.joint_slice], state.vjm.arm.joints
    folder = np.array([joint.compliance for joint in joints])
    carries = state.torque_scale > CARRYING_SHARE * state.torque_scale.max(initial=0)
    return bool((carries & (compliance < MIN_CARRYING_COMPLIANCE * folder)).any())


def _scatter(state: ArmState, series: Sequence[Series], prior: Prior, g: Array) -> float:
    """Measure the scatter of readings about the arm with gravity along g, (3,) [m]; infinite if none fits."""
    vjm, every = with_base_rotated(state.vjm, g), tuple(series)
    bare = nominal_state(vjm, state.weights, torque_scale(vjm, state.weights, every))
    try:
        noise = first_fit(align_all(bare, every), every, scale_by_prior(prior, vjm, joints_only(vjm.arm)))[1]
    except BenchError:
        return float("inf")
    return float(
        np.hypot(
            noise.position_model_error, np.mean([readings.sigma for readings in series]) * noise.factor[0]
        )
    )


def _tilts(state: ArmState, series: Sequence[Series], prior: Prior, folder_scatter: float) -> Iterator[Array]:
    """Yield the tilt of least variance, by a parabola through probes about both level axes."""
    slope, bend = np.zeros(2), np.zeros(2)
    for k in range(2):
        low, high = (
            _scatter(state, series, prior, _tilted_gravity(s * PROBE_TILT * np.eye(2)[k])) for s in (-1, 1)
        )
        slope[k], bend[k] = (high**2 - low**2) / 2, (high**2 + low**2) / 2 - folder_scatter**2
    if np.isfinite(slope).all() and (bend > 0).all():
        yield _tilted_gravity(-PROBE_TILT * slope / (2 * bend))


def _tilted_gravity(by: Array) -> Array:
    """Compute gravity in the axes of a base tilted by angles about its x and y, (2,) [rad]."""
    size = float(np.linalg.norm(by))
    return np.array([*(np.sin(size) * by / max(size, 1e-12)), -np.cos(size)])


def sags_like_hanging(before: Observations, after: Observations, C_theta: Array) -> bool:
    """Tell whether the unloaded readings sag as those of a hanging arm, not as those of an upright one.

    Call it when targets move against stated weights. Three mistakes do that: the arm hangs, readings before
    and after are exchanged, or the force has the other sign. With RMS distances s of the
    nearest FITTING_SHARE of the readings in n poses, hanging gains 3 n log(s_upright / s_hanging) nats;
    s_upright is the smaller one of both readings.

    Args:
        before: Unloaded readings, as in the file.
        after: Loaded readings.
        C_theta: Expected compliances, scaled to the readings, (n_theta, n_theta) [m/N, rad/(N m)].

    Returns:
        Whether hanging gains more than MIN_HANGING_NATS nats; False when the folder has no masses.
    """
    vjm = before.vjm
    try:
        weights = read_weights(vjm.arm)
    except InputError:  # its weight is unknown
        return False
    left = []
    for observations, g in ((before, -DOWN), (after, DOWN), (before, DOWN)):
        turned = with_base_rotated(vjm, g)
        where = chain(turned, observations.q)
        theta = (C_theta @ own_weight(where, weights)).T
        sag = displacement(where, theta, observations.markers) @ rotation_from_down(g).T
        bare = replace(
            observations, position=observations.position - sag, free=FreeParameters(frame=True, targets=True)
        )
        off = np.sort(fit(bare).distances(observations))
        left.append(float(np.sqrt(np.square(off[: int(np.ceil(FITTING_SHARE * len(off)))]).mean())))
    hung, *upright = left
    poses = len(np.unique(before.q, axis=0))  # all that is read in one shares its errors of geometry
    return 3 * poses * float(np.log(min(upright) / max(hung, 1e-12))) > MIN_HANGING_NATS
