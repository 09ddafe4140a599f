"""Registration: tracker frames and targets on the tool, fitted to readings by Gauss-Newton.

The arm is taken as rigid. A reading of target k in pose r and tracker frame s is

    p_rk = R_s (R_r m_k + p_r) + t_s.

The arm's kinematics give the pose R_r, p_r of the tool; R_s, t_s and the target m_k are unknown. With R_s^T
and R_s^T t_s as unknowns the equation is linear: its solution is one start. If m_k is roughly known, Kabsch's
rotation between two sets of points is another, which needs fewer poses. The refinement minimises

    sum_rk rho(|W_rk (p_rk - R_s (R_r m_k + p_r) - t_s)|) + sum_k rho(|m_k - nominal_k| /
    NOMINAL_TARGET_DEVIATION)

with Huber's rho and the weight W_rk^-2 = C_rk + s^2 I. C_rk is the reading's covariance. s is the noise that
the residuals show in addition, from geometric errors and sag of the arm; it is estimated with the unknowns.

`HuberLoss` is the robust loss of pairs, registrations and calibrations. The residual of a reading has three
components. Beyond a threshold of its length, in standard deviations, the influence of the reading is constant
(Huber): its equations are multiplied by the root of the weight. The noise is estimated by Huber's proposal 2.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from testbench.data.dataset import Series
from testbench.errors import Array, BenchError, Ids, Mask
from testbench.model.vjm import Vjm, rotation_matrices, skew, tool_poses

# --- Pose of the base in a tracker's frame, and targets on the tool, in closed form -------------------------

MIN_FRAME_POINTS = 3
"""Fewest points, not on a line, that determine a frame."""
#: Most mean readings that a registration uses, drawn at random: noise does not limit the accuracy of a frame.
MAX_REGISTERED_READINGS = 3000
MIN_SINGULAR_VALUE = 1e-6
"""Least singular value of the linear start's matrix over its largest, if the start is used [1]."""


@dataclass(frozen=True)
class MeanReadings:
    """Hold n mean readings: one per target, pose and tracker frame, the mean of repeated readings.

    Geometric errors of the arm change all repeated readings equally: repeats do not average them.
    """

    frame_index: Ids  #: Index of every reading's frame, (n,).
    target_index: Ids  #: Index of every reading's target, (n,).
    position: Array  #: Measured positions in the frame's axes, (n, 3) [m].
    covariance: Array  #: Covariance of the noise of every mean reading in the frame's axes, (n, 3, 3) [m^2].
    tool_rotation: Array  #: Orientation of the tool in base axes, by the arm's kinematics, (n, 3, 3).
    tool_position: Array  #: Position of the tool in base axes, by the arm's kinematics, (n, 3) [m].


@dataclass(frozen=True)
class FramesAndTargets:
    """Hold the poses of the arm's base in tracker frames, and the targets on the tool; NaN where unknown."""

    rotation: Array  #: R_s: rotation from base axes to the axes of every frame, (frames, 3, 3).
    translation: Array  #: t_s: origin of the base in every frame, (frames, 3) [m].
    targets: Array  #: m_k: positions of the targets in the tool's frame, (targets, 3) [m].

    @property
    def is_complete(self) -> bool:
        """Tell whether all frames and targets are known, none NaN."""
        return all(np.isfinite(part).all() for part in vars(self).values())


def mean_readings(vjm: Vjm, series: Sequence[Series]) -> MeanReadings:
    """Average the repeated readings of every target in every pose and tracker frame.

    At most `MAX_REGISTERED_READINGS` of the means are kept, drawn at random.

    Args:
        vjm: The arm's virtual joint model.
        series: Readings of targets that stay at the same places on the tool.

    Returns:
        The means, with the pose of the tool by the arm's kinematics.
    """
    frames, targets = frame_and_target_names(series)
    parts = [_means(readings, frames.index(readings.frame), targets) for readings in series]
    frame, target, q, y, C = (np.concatenate(part) for part in zip(*parts, strict=True))
    kept = np.sort(np.random.Generator(np.random.Philox(0)).permutation(len(q))[:MAX_REGISTERED_READINGS])
    position, rotation = tool_poses(vjm, q[kept])
    return MeanReadings(frame[kept], target[kept], y[kept], C[kept], rotation, position)


def frame_and_target_names(series: Sequence[Series]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """List the names of the tracker frames and of the targets of some series, each once, in order."""
    targets = (name for readings in series for name in readings.markers)
    return tuple(dict.fromkeys(readings.frame for readings in series)), tuple(dict.fromkeys(targets))


def _means(series: Series, frame: int, targets: tuple[str, ...]) -> tuple[Array, ...]:
    """Compute frame, target, joints, position and covariance of every mean reading of a series."""
    row, column = np.nonzero(series.is_measured)
    target = np.array([targets.index(name) for name in series.markers])[column]
    keys = np.column_stack([series.q[row], target])
    _, first, group = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    count = np.bincount(group.ravel())[:, None]
    y, C = np.zeros((len(first), 3)), np.zeros((len(first), 3, 3))
    np.add.at(y, group.ravel(), series.position[row, column])
    covariance = series.sigma**2 * np.eye(3)
    np.add.at(
        C,
        group.ravel(),
        covariance if series.precision is None else np.linalg.inv(series.precision[row, column]),
    )
    ids = np.full(len(first), frame)
    return ids, target[first], series.q[row[first]], y / count, C / count[..., None] ** 2


def initial_estimates(readings: MeanReadings, known: FramesAndTargets) -> Iterator[FramesAndTargets]:
    """Yield estimates of all frames and targets in closed form, to start the refinement from.

    Args:
        readings: Mean readings of the targets.
        known: Frames and nominal targets that are known; NaN elsewhere.

    Yields:
        An estimate from the nominal targets, and one from linear equations without them; an estimate that
        leaves a frame or target unknown is left out.
    """
    for targets in (known.targets, _targets_by_hand_eye(readings, len(known.targets))):
        layout = _complete_layout(readings, replace(known, targets=targets))
        if layout.is_complete:
            yield layout


def _targets_by_hand_eye(readings: MeanReadings, targets: int) -> Array:
    """Solve the linear form for the targets in the frame with most readings, (targets, 3) [m].

    A target that this frame did not read is NaN.
    """
    positions = np.full((targets, 3), np.nan)
    in_frame = readings.frame_index == np.bincount(readings.frame_index).argmax()
    read, at = np.unique(readings.target_index[in_frame], return_inverse=True)
    R = readings.tool_rotation[in_frame]
    at = at.ravel()
    n = np.arange(in_frame.sum())
    A = np.zeros((len(n), 3, 12 + 3 * len(read)))
    for axis in range(3):
        A[:, axis, 3 * axis : 3 * axis + 3] = readings.position[in_frame]
        A[:, axis, 9 + axis] = -1
        A[n, :, 12 + 3 * at + axis] = -R[:, :, axis]
    x, _, rank, _ = np.linalg.lstsq(
        A.reshape(3 * len(n), -1), readings.tool_position[in_frame].ravel(), rcond=MIN_SINGULAR_VALUE
    )
    if rank == A.shape[2]:
        positions[read] = x[12:].reshape(-1, 3)
    return positions


def _complete_layout(readings: MeanReadings, layout: FramesAndTargets) -> FramesAndTargets:
    """Find frames from known targets and targets from known frames, in turn, until neither finds more."""
    rotation, translation, targets = (part.copy() for part in vars(layout).values())
    while True:
        missing = np.isnan(translation).sum() + np.isnan(targets).sum()
        for s in np.flatnonzero(np.isnan(translation[:, 0])):
            use = (readings.frame_index == s) & np.isfinite(targets[readings.target_index, 0])
            if use.sum() >= MIN_FRAME_POINTS:
                rotation[s], translation[s] = kabsch(
                    targets_in_base(readings, targets)[use], readings.position[use]
                )
        for k in np.flatnonzero(np.isnan(targets[:, 0])):
            use = (readings.target_index == k) & np.isfinite(translation[readings.frame_index, 0])
            if use.any():
                at = readings.frame_index[use]
                base = np.vecmat(readings.position[use] - translation[at], rotation[at])
                targets[k] = np.median(
                    np.vecmat(base - readings.tool_position[use], readings.tool_rotation[use]), axis=0
                )
        if missing == np.isnan(translation).sum() + np.isnan(targets).sum():
            return FramesAndTargets(rotation, translation, targets)


def targets_in_base(readings: MeanReadings, targets: Array) -> Array:
    """Compute the position of every reading's target on the rigid arm in base axes, R_r m_k + p_r.

    Args:
        readings: Mean readings with the poses R_r, p_r of the tool.
        targets: Positions m_k of the targets in the tool's frame, (targets, 3) [m].

    Returns:
        Positions in base axes, (n, 3) [m].
    """
    return np.asarray(
        readings.tool_position + np.matvec(readings.tool_rotation, targets[readings.target_index])
    )


def registration_residuals(readings: MeanReadings, frames_and_targets: FramesAndTargets) -> Array:
    """Compute the residuals of readings, p_rk - R_s (R_r m_k + p_r) - t_s, in the axes of their frames.

    Args:
        readings: Mean readings p_rk with the poses R_r, p_r of the tool.
        frames_and_targets: Frames R_s, t_s and targets m_k.

    Returns:
        Residuals, (n, 3) [m].
    """
    x = np.matvec(
        frames_and_targets.rotation[readings.frame_index],
        targets_in_base(readings, frames_and_targets.targets),
    )
    return np.asarray(readings.position - x - frames_and_targets.translation[readings.frame_index])


def kabsch(points: Array, readings: Array, *, mirrored: bool = False) -> tuple[Array, Array]:
    """Find R and t that minimise the sum of |R x + t - y|^2 over pairs of points x and readings y.

    Kabsch 1976; Arun, Huang, Blostein 1987; Umeyama 1991.

    Mathematics: `abs-6`.

    Args:
        points: Points x, (n, 3) [m].
        readings: Readings y of the points in another frame, (n, 3) [m].
        mirrored: Whether R is a rotation with a reflection, of determinant -1.

    Returns:
        Rotation R, (3, 3) [1], and translation t, (3,) [m].
    """
    centre, seen = points.mean(axis=0), readings.mean(axis=0)
    R = nearest_rotation((readings - seen).T @ (points - centre), mirrored=mirrored)
    return R, seen - R @ centre


def nearest_rotation(M: Array, *, mirrored: bool = False) -> Array:
    """Find the rotation R with the largest trace of R^T M.

    Args:
        M: Any matrix, (3, 3).
        mirrored: Whether R is a rotation with a reflection, of determinant -1.

    Returns:
        R, (3, 3) [1].
    """
    U, _, Vt = np.linalg.svd(M)
    sign = (-1 if mirrored else 1) * np.sign(np.linalg.det(U @ Vt))
    return np.asarray(U @ np.diag([1, 1, sign]) @ Vt)


# --- Robust loss for pairs, frames and calibrations: weights of readings, and noise beyond the stated one ---

NOISE_ROOT_TOLERANCE = 2.0**-60
"""Error of the estimated noise, over ten times the largest residual [1]."""


@dataclass(frozen=True)
class HuberLoss:
    """Define Huber's loss of a residual of length r: r^2 / 2 up to a threshold, linear beyond."""

    threshold: float  #: Length beyond which a reading has less than full weight, in standard deviations [1].
    normal_mean_square: float  #: Mean of min(|z|, threshold)^2 of standard normal 3-vectors z [1].

    def weight(self, length: Array) -> Array:
        """Compute the robust weight of a reading, min(1, threshold / length).

        Mathematics: `est-16`.

        Args:
            length: Length of the residual in standard deviations, (...) [1].

        Returns:
            Weight from 0 to 1, (...) [1].
        """
        return np.asarray(np.minimum(1.0, self.threshold / np.maximum(length, self.threshold)))

    def extra_noise(self, residual: Array, variance: Array, dof_ratio: float) -> float:
        """Estimate the noise S that the residuals show in addition to the stated variances.

        Mathematics: `est-17`.

        Args:
            residual: Residuals of n readings along axes in which their k components are independent, (n, k)
                [m, rad].
            variance: Stated variances along these axes, (n, k) [m^2, rad^2].
            dof_ratio: Degrees of freedom over number of equations [1].

        Returns:
            Standard deviation S along every axis [m, rad]; 0 if the stated variances explain the residuals.
        """
        from scipy.optimize import brentq  # here: it takes long to import, and few runs need it

        squares = np.square(residual)

        def clipped_square_excess(s: float) -> float:
            length = (squares / (variance + s**2)).sum(axis=1)
            return float(np.minimum(length, self.threshold**2).mean()) - self.normal_mean_square * dof_ratio

        high = 10 * float(np.sqrt(squares.max(initial=0.0)))
        if not len(residual) or clipped_square_excess(0.0) <= 0:
            return 0.0
        return (
            high
            if clipped_square_excess(high) > 0
            else float(brentq(clipped_square_excess, 0.0, high, xtol=NOISE_ROOT_TOLERANCE * high))
        )


PAIR_LOSS = HuberLoss(1.628, 1.928)
"""Loss of pairs of readings in the search for outliers: means of normal 3-vectors keep 95 % efficiency, as
single numbers do with a threshold of 1.345."""
FRAME_LOSS = HuberLoss(3.0, 2.936)
"""Loss of a registration: 3 % of normally distributed readings have less than full weight. With a threshold
of 3.5, errors of frame and targets are 1 to 4 % larger if 5 % of the readings are off by 5 mm (median of 100
draws)."""
READING_LOSS = HuberLoss(3.5, 2.986)
"""Loss of a calibration: 0.7 % of normally distributed readings have less than full weight."""
SQUARED_LOSS = HuberLoss(1e300, 3.0)
"""Loss of least squares: full weight for all readings."""


# --- Registration -------------------------------------------------------------------------------------------

MIN_JOINT_MOTION = 1e-3
"""Range of a joint over all poses below which the joint does not move [rad, m]."""
MIN_REGISTRATION_POSES = 6
"""Fewest poses that determine a frame and a target whose nominal position is unknown."""
NOMINAL_TARGET_DEVIATION = 0.02
"""Standard deviation of a nominal target position along each axis [m]."""
ASSUMED_NOISE = 1e-3
"""Noise s from geometric errors of the arm along an axis, if the readings do not determine it [m]."""
MIN_DEGREES_OF_FREEDOM = 6
"""Fewest degrees of freedom that determine the noise s."""
STEP_TOLERANCE = 1e-9
"""Largest component of a Gauss-Newton step at which the fit has converged [m, rad]."""
MAX_GAUSS_NEWTON_STEPS = 200
DROP_OUTLIERS_STEP, MAX_UNWEIGHTED_STEPS = 1e-4, 60
"""Size of a Gauss-Newton step [m, rad], and number of steps, after which outliers are dropped and the noise s
is estimated. Before, residuals are those of a poor start, and large ones are not outliers."""
OUTLIER_RATIO = 10.0
"""Length of a residual over the median, or over ASSUMED_NOISE if that is more, beyond which the reading is
dropped [1]."""
NOISE_TOLERANCE = 1e-6  #: Relative change of the noise s at which the fit has converged [1].
UNDETERMINED, DIVERGED = "undetermined", "no convergence"  #: Reasons why a start leads to no registration.
#: Least eigenvalue of the information matrix, scaled to unit diagonal, of a determined direction [1].
MIN_INFORMATION = 1e-11


@dataclass(frozen=True)
class Frame:
    """Hold the pose of the arm's base in a tracker's frame: reading = rotation @ x + translation."""

    rotation: Array  #: Rotation from base axes to the tracker's axes, (3, 3).
    translation: Array  #: Origin of the base in the tracker's frame, (3,) [m].
    #: Covariance of a small rotation phi about the base's axes, rotation @ exp(phi), and of the translation,
    #: (6, 6) [rad, m]; zero for a frame that was given.
    covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    #: Constant that an instrument adds to every distance from its fixed point [m].
    distance_offset: float = 0.0

    def with_base_at(self, pose: Array) -> "Frame":
        """Compute the pose of another base frame in the tracker's frame, with its covariance.

        Args:
            pose: Pose of the other base frame in the present one, homogeneous matrix, (4, 4) [1, m].
        """
        turn, place = pose[:3, :3], pose[:3, 3]
        J = np.eye(6)
        J[:3, :3], J[3:, :3] = turn.T, -self.rotation @ skew(place)
        there = self.rotation @ place + self.translation
        return Frame(self.rotation @ turn, there, J @ self.covariance @ J.T)

    @property
    def rotation_vector(self) -> Array:
        """Compute the rotation from base axes to the tracker's axes as axis times angle, (3,) [rad]."""
        from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

        return np.asarray(Rotation.from_matrix(self.rotation).as_rotvec())

    @property
    def rotation_angle(self) -> float:
        """Compute the angle of the rotation from base axes to the tracker's axes, 0 to pi [rad]."""
        return float(np.linalg.norm(self.rotation_vector))

    @property
    def rotation_deviation(self) -> float:
        """Compute the standard deviation of `rotation` about the axis where it is largest [rad]."""
        return largest_deviation(self.covariance[:3, :3])


@dataclass(frozen=True)
class Registration:
    """Hold tracker frames and targets on the tool that were fitted to readings, with their covariance."""

    frame_names: tuple[str, ...]  #: Names of the tracker frames.
    target_names: tuple[str, ...]  #: Names of the targets, m of them.
    #: Nominal positions of the targets in the tool's frame, (m, 3) [m]; NaN for a target without one.
    nominal_targets: Array
    frames_and_targets: FramesAndTargets  #: All frames and targets, in order of the names.
    is_fitted_frame: Mask  #: Which frames were fitted and not given, (frames,).
    #: Covariance of all fitted frames (small rotation, translation), then of the targets, (k, k) [rad, m].
    covariance: Array
    distances: Array  #: Distance between every mean reading and the fitted position, (n,) [m].
    noise: float  #: s: standard deviation of the readings along an axis beyond the tracker's [m].
    n_downweighted: int  #: Number of mean readings with less than full robust weight.

    @property
    def frames(self) -> dict[str, Frame]:
        """Return the poses of the arm's base in the tracker frames, with covariance, by the frame's name."""
        C = np.zeros((len(self.frame_names), 6, 6))
        for at, k in enumerate(np.flatnonzero(self.is_fitted_frame)):
            C[k] = self.covariance[6 * at : 6 * at + 6, 6 * at : 6 * at + 6]
        every = map(Frame, self.frames_and_targets.rotation, self.frames_and_targets.translation, C)
        return dict(zip(self.frame_names, every, strict=True))

    @property
    def targets(self) -> Array:
        """Return the positions of the targets in the tool's frame, (m, 3) [m]."""
        return self.frames_and_targets.targets

    @property
    def target_deviations(self) -> Array:
        """Return the standard deviations of the fitted target positions along the tool's axes, (m, 3) [m]."""
        variances = np.diag(self.covariance)[len(self.covariance) - self.targets.size :]
        return np.asarray(np.sqrt(variances).reshape(-1, 3))

    @property
    def rms_distance(self) -> float:
        """Compute the RMS distance between mean readings and the positions that the fit predicts [m]."""
        return float(np.sqrt(np.mean(self.distances**2)))

    @property
    def median_distance(self) -> float:
        """Compute the median distance between mean readings and the positions that the fit predicts [m]."""
        return float(np.median(self.distances))


def register(
    vjm: Vjm,
    series: Sequence[Series],
    nominal_targets: Mapping[str, Array],
    known_frames: Mapping[str, Frame] | None = None,
) -> Registration:
    """Fit tracker frames and targets on the tool to readings, with the arm taken as rigid and exact.

    Gauss-Newton refines every start in closed form; the fit with the least median residual is returned.

    Mathematics: `abs-5`.

    Args:
        vjm: The arm's virtual joint model.
        series: Readings of targets that stay at the same places on the tool, such as one series per tracker.
        nominal_targets: Nominal positions of targets in the tool's frame by name, (3,) [m] each; any of them
            may be absent.
        known_frames: Tracker frames that are known, by name; the others are fitted.

    Raises:
        BenchError: When the readings do not determine a frame or target, or no fit converges.
    """
    frames, targets = frame_and_target_names(series)
    # What is known: nominal targets and given frames.
    expected = np.array([nominal_targets.get(name, np.full(3, np.nan)) for name in targets])
    known = FramesAndTargets(
        np.full((len(frames), 3, 3), np.nan), np.full((len(frames), 3), np.nan), expected
    )
    for name, frame in (known_frames or {}).items():
        if name not in frames:
            raise BenchError(f"frame of {name}: the readings are of {', '.join(frames)}")
        known.rotation[frames.index(name)] = frame.rotation
        known.translation[frames.index(name)] = frame.translation
    readings, free = mean_readings(vjm, series), np.isnan(known.translation[:, 0])
    # Refine every start in closed form; the smallest residual wins.
    none = np.zeros(0)
    tried = [
        _gauss_newton(
            readings, Registration(frames, targets, expected, start, free, none, none, ASSUMED_NOISE, 0)
        )
        for start in initial_estimates(readings, known)
    ]
    solved = [result for result in tried if isinstance(result, Registration)]
    if not solved:
        raise BenchError(f"registration: {_unsolved(vjm, series, tried)}")
    return min(solved, key=lambda registration: registration.median_distance)


def largest_deviation(covariance: Array) -> float:
    """Compute the standard deviation along the direction where a covariance, (n, n), is largest."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0)))


def median_tool_distance(vjm: Vjm, q: Array) -> float:
    """Compute the median distance of the tool from the arm's base over some poses.

    Args:
        vjm: The arm's virtual joint model.
        q: Actuated joints, (poses, n) [rad, m].

    Returns:
        Median distance [m].
    """
    return float(np.median(np.linalg.norm(tool_poses(vjm, q)[0] - vjm.base_pose[:3, 3], axis=1)))


def moving_joints(vjm: Vjm, series: Sequence[Series]) -> list[str]:
    """List the joints that move by more than `MIN_JOINT_MOTION` over all poses of some readings.

    Args:
        vjm: The arm's virtual joint model.
        series: The readings.

    Returns:
        Names of the joints, in order of the chain.
    """
    sizes = np.ptp(np.concatenate([readings.q for readings in series]), axis=0)
    return [joint.name for joint, size in zip(vjm.arm.joints, sizes, strict=True) if size > MIN_JOINT_MOTION]


def _unsolved(vjm: Vjm, series: Sequence[Series], tried: Sequence[object]) -> str:
    """Explain why the registration failed, and suggest a remedy."""
    if DIVERGED in tried:
        return f"{DIVERGED}; is a unit, the order of joints or the sign of an angle wrong?"
    for readings in series:
        if readings.is_measured.sum() < MIN_FRAME_POINTS:
            n_read = readings.is_measured.sum()
            return f"{readings.frame} read {n_read} targets; expected at least {MIN_FRAME_POINTS}"
    poses = len(np.unique(np.concatenate([readings.q for readings in series]), axis=0))
    return (
        f"{poses} poses, in which {', '.join(moving_joints(vjm, series)) or 'no joint'} turns, do not "
        f"determine a frame or target; expected at least {MIN_REGISTRATION_POSES} poses that turn "
        f"three joints, or nominal positions of all targets"
    )


def _gauss_newton(readings: MeanReadings, start: Registration) -> Registration | str:
    """Fit by Gauss-Newton from a start; returns `UNDETERMINED` or `DIVERGED` if there is no fit."""
    layout = start.frames_and_targets
    free = start.is_fitted_frame
    noise = start.noise
    kept = None
    values, V = np.linalg.eigh(readings.covariance)
    for k in range(MAX_GAUSS_NEWTON_STEPS):
        e, J = registration_residuals(readings, layout), _jacobian(readings, layout, free)
        # Whiten residuals by W = (C + s^2 I)^-1/2, in the principal axes of C.
        root = V.swapaxes(1, 2) / np.sqrt(values + noise**2)[..., None]
        u = np.matvec(root, e)
        # Huber's weights; readings that were dropped as outliers have weight zero.
        pull = FRAME_LOSS.weight(np.linalg.norm(u, axis=1)) * (True if kept is None else kept)
        # Normal equations, with the nominal targets as further rows.
        A = (root @ J).reshape(-1, J.shape[2])
        weighted = np.repeat(pull, 3)[:, None] * A
        information, held = weighted.T @ A, _nominal_rows(start.nominal_targets - layout.targets, A.shape[1])
        P = _inverse(information + np.diag(held[0]))
        if P is None:
            return UNDETERMINED
        step, before = P @ (weighted.T @ u.ravel() + held[0] * held[1]), noise
        layout = _moved(layout, free, step)
        if kept is None and (np.abs(step).max() < DROP_OUTLIERS_STEP or k == MAX_UNWEIGHTED_STEPS):
            length = np.linalg.norm(e, axis=1)
            kept = np.asarray(length <= OUTLIER_RATIO * max(float(np.median(length)), ASSUMED_NOISE))
        if kept is not None:
            # Noise s beyond the tracker's, from residuals and remaining degrees of freedom.
            spare = 3 * kept.sum() - float(np.sum(P * information))
            along = np.einsum("nxk,nx->nk", V, e)[kept]
            noise = (
                FRAME_LOSS.extra_noise(along, values[kept], spare / along.size)
                if spare >= MIN_DEGREES_OF_FREEDOM
                else ASSUMED_NOISE
            )
            if np.abs(step).max() < STEP_TOLERANCE and abs(noise - before) <= NOISE_TOLERANCE * noise:
                distance, wild = np.linalg.norm(e, axis=1), int((pull < 1).sum())
                return replace(
                    start,
                    frames_and_targets=layout,
                    covariance=P,
                    distances=distance,
                    noise=noise,
                    n_downweighted=wild,
                )
    return DIVERGED


def _nominal_rows(off: Array, size: int) -> tuple[Array, Array]:
    """Compute weights and distances of the nominal targets, zero for frames and new targets.

    The loss is Huber's here too: a nominal position beyond its threshold is wrong, not imprecise.
    """
    length = np.linalg.norm(off, axis=1, keepdims=True) / NOMINAL_TARGET_DEVIATION
    weight, frames = (
        np.where(np.isfinite(off), FRAME_LOSS.weight(length), 0) / NOMINAL_TARGET_DEVIATION**2,
        (size - off.size, 0),
    )
    return np.pad(weight.ravel(), frames), np.pad(np.nan_to_num(off).ravel(), frames)


def _jacobian(readings: MeanReadings, layout: FramesAndTargets, free: Mask) -> Array:
    """Compute derivatives of readings by rotations and shifts of fitted frames and by targets, (n, 3, k)."""
    R, n = layout.rotation[readings.frame_index], np.arange(len(readings.frame_index))
    J = np.zeros((len(n), 3, 6 * len(free) + layout.targets.size))
    turned = R @ skew(targets_in_base(readings, layout.targets)).swapaxes(1, 2)
    for axis in range(3):
        J[n, :, 6 * readings.frame_index + axis] = turned[:, :, axis]
        J[n, axis, 6 * readings.frame_index + 3 + axis] = 1.0
        J[n, :, 6 * len(free) + 3 * readings.target_index + axis] = (R @ readings.tool_rotation)[:, :, axis]
    return J[:, :, np.concatenate([np.repeat(free, 6), np.ones(layout.targets.size, dtype=bool)])]


def _moved(layout: FramesAndTargets, free: Mask, step: Array) -> FramesAndTargets:
    """Apply a step of the free unknowns: turn frames about their own axes, shift frames and targets."""
    frames, targets = np.split(step, [6 * free.sum()])
    rotation, translation = layout.rotation.copy(), layout.translation.copy()
    rotation[free] = rotation[free] @ rotation_matrices(frames.reshape(-1, 6)[:, :3])
    translation[free] += frames.reshape(-1, 6)[:, 3:]
    return FramesAndTargets(rotation, translation, layout.targets + targets.reshape(-1, 3))


def _inverse(information: Array) -> Array | None:
    """Compute the covariance of the unknowns; None if one of their directions is not observed."""
    size = np.sqrt(np.diag(information))
    if not size.all():
        return None
    values, V = np.linalg.eigh(information / np.outer(size, size))
    return None if values[0] < MIN_INFORMATION else np.asarray((V / values) @ V.T / np.outer(size, size))
