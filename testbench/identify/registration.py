"""Registration: frames and targets of readings together, the arm rigid, by Gauss-Newton from a closed form.

It minimises

    sum_rk rho(|W_rk (p_rk - R_s (R_r m_k + p_r) - t_s)|) + sum_k rho(|m_k - nominal_k| / NOMINAL_DEVIATION)

with Huber's rho and the weight W_rk^-2 = C_rk + s^2 I. C_rk is the reading's covariance. s is the noise that
the residuals show beyond it: the arm's geometric errors and its own sag. It is estimated with the rest.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from testbench.data.dataset import Series
from testbench.errors import Array, BenchError, Mask
from testbench.identify.closed_form import (
    MIN_POINTS,
    FrameLayout,
    MeanReadings,
    base_points,
    frame_and_target_names,
    initial_layouts,
    mean_readings,
    residuals,
)
from testbench.identify.robust_loss import FRAMES
from testbench.model.vjm import Vjm, rotation_matrices, skew, tool_pose

MIN_JOINT_MOTION = 1e-3
"""Motion of a joint below which it counts as still [rad, m]."""
MIN_POSES = 6
"""Fewest poses that determine one frame and one target without a nominal position."""
NOMINAL_DEVIATION = 0.02
"""Standard deviation of a nominal target position along each axis [m]."""
ASSUMED_NOISE = 1e-3
"""Noise by geometric errors if the readings do not determine it [m]."""
MIN_SPARE_EQUATIONS = 6
"""Fewest degrees of freedom that determine the noise."""
STEP_TOLERANCE = 1e-9
"""Gauss-Newton step at which the fit has converged [m, rad]."""
MAX_STEPS = 200
SETTLED_STEP, MAX_UNWEIGHTED_STEPS = 1e-4, 60
"""After a step below SETTLED_STEP [m, rad], or so many, wild readings are dropped and the noise is estimated
too.

Before, residuals are those of the start: they would let nominal targets and wild readings win.
"""
WILD_RATIO = 10.0
"""Length of a residual over the median, or over ASSUMED_NOISE if that is more, beyond which it is dropped."""
NOISE_TOLERANCE = 1e-6  #: Relative change of the noise that ends the search.
OPEN_STATUS, DIVERGED = "open", "no convergence"  #: Ends of a search that found nothing.
#: Least eigenvalue of the scaled information; below it a direction is not seen at all.
MIN_INFORMATION = 1e-11


@dataclass(frozen=True)
class Frame:
    """Hold the pose of the arm's base in a tracker's frame: reading = rotation @ x + translation."""

    rotation: Array  #: Tracker from base, (3, 3).
    translation: Array  #: Origin of the base in the tracker's frame, (3,) [m].
    #: Covariance of a small rotation about the base's axes, R exp(phi), and of the translation, (6, 6)
    #: [rad, m]; zero for a frame that was given.
    covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))

    def of(self, pose: Array) -> "Frame":
        """Return the frame that takes the place of the base.

        Args:
            pose: Pose of the new frame's origin in base axes, (4, 4) [m].

        Returns:
            The frame, with its covariance.
        """
        turn, place = pose[:3, :3], pose[:3, 3]
        J = np.eye(6)
        J[:3, :3], J[3:, :3] = turn.T, -self.rotation @ skew(place)
        there = self.rotation @ place + self.translation
        return Frame(self.rotation @ turn, there, J @ self.covariance @ J.T)

    @property
    def rotation_vector(self) -> Array:
        """Return the rotation as a vector, (3,) [rad]."""
        from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

        return np.asarray(Rotation.from_matrix(self.rotation).as_rotvec())

    @property
    def angle(self) -> float:
        """Return the size of the rotation [rad]."""
        return float(np.linalg.norm(self.rotation_vector))

    @property
    def deviation(self) -> float:
        """Return the largest standard deviation of the rotation about any axis [rad]."""
        return largest_deviation(self.covariance[:3, :3])


@dataclass(frozen=True)
class Registration:
    """Hold the frames and targets that were fitted to readings, with their covariance."""

    names: tuple[str, ...]  #: Names of the frames.
    markers: tuple[str, ...]  #: Names of the targets.
    nominal: Array  #: Nominal target positions, (m, 3) [m]; NaN for a target without one.
    layout: FrameLayout  #: Frames and targets in order.
    free: Mask  #: Frames that were not given, (frames,).
    covariance: Array  #: Of rotation and translation of every frame not given, then of all targets [rad, m].
    distance: Array  #: Distance of every reading, averaged per pose, from the fitted arm, (n,) [m].
    noise: float  #: s: standard deviation along an axis beyond the tracker's [m].
    downweighted: int  #: Number of outliers, with less than full robust weight.

    @property
    def frames(self) -> dict[str, Frame]:
        """Return the frames by name."""
        C = np.zeros((len(self.names), 6, 6))
        for at, k in enumerate(np.flatnonzero(self.free)):
            C[k] = self.covariance[6 * at : 6 * at + 6, 6 * at : 6 * at + 6]
        every = map(Frame, self.layout.rotation, self.layout.translation, C)
        return dict(zip(self.names, every, strict=True))

    @property
    def targets(self) -> Array:
        """Return the positions of the targets in the tool's frame, (m, 3) [m]."""
        return self.layout.targets

    @property
    def target_deviations(self) -> Array:
        """Return the standard deviation of every target along the tool's axes, (m, 3) [m]."""
        own = np.diag(self.covariance)[len(self.covariance) - self.targets.size :]
        return np.asarray(np.sqrt(own).reshape(-1, 3))

    @property
    def rms(self) -> float:
        """Return the RMS distance of readings from the registered model [m]."""
        return float(np.sqrt(np.mean(self.distance**2)))

    @property
    def typical(self) -> float:
        """Return the median distance of readings from the registered model [m]."""
        return float(np.median(self.distance))


def register(
    vjm: Vjm, series: Sequence[Series], nominal: Mapping[str, Array], given: Mapping[str, Frame] | None = None
) -> Registration:
    """Find the frames and targets of series of one mount, with a rigid arm without errors.

    It refines every start of the closed form by Gauss-Newton, and returns the one with the least median
    residual.

    Mathematics: `abs-5`.

    Args:
        vjm: The arm's virtual joint model.
        series: The readings, such as one series per station.
        nominal: Expected targets in the tool's frame by name, (3,) [m] each; any of them may be absent.
        given: Frames that are known, by name; the others are found.

    Returns:
        Frames, targets, their covariance, and the residuals.

    Raises:
        BenchError: When the readings do not determine a frame or target, or no search converges.
    """
    frames, targets = frame_and_target_names(series)
    # What is known: nominal targets and given frames.
    expected = np.array([nominal.get(name, np.full(3, np.nan)) for name in targets])
    known = FrameLayout(np.full((len(frames), 3, 3), np.nan), np.full((len(frames), 3), np.nan), expected)
    for name, frame in (given or {}).items():
        if name not in frames:
            raise BenchError(f"frame of {name}: the readings are of {', '.join(frames)}")
        known.rotation[frames.index(name)] = frame.rotation
        known.translation[frames.index(name)] = frame.translation
    readings, free = mean_readings(vjm, series), np.isnan(known.translation[:, 0])
    # Refine every start in closed form; the smallest residual wins.
    none = np.zeros(0)
    tried = [
        _refined(readings, Registration(frames, targets, expected, start, free, none, none, ASSUMED_NOISE, 0))
        for start in initial_layouts(readings, known)
    ]
    solved = [one for one in tried if isinstance(one, Registration)]
    if not solved:
        raise BenchError(f"registration: {_unsolved(vjm, series, tried)}")
    return min(solved, key=lambda registration: registration.typical)


def largest_deviation(covariance: Array) -> float:
    """Compute the largest standard deviation along any direction.

    Args:
        covariance: Covariance, (n, n).

    Returns:
        Root of its largest eigenvalue.
    """
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0)))


def arm_reach(vjm: Vjm, q: Array) -> float:
    """Compute the median distance of the tool from the arm's base.

    Args:
        vjm: The arm's virtual joint model.
        q: Joint angles, (poses, n) [rad, m].

    Returns:
        Median distance [m].
    """
    return float(np.median(np.linalg.norm(tool_pose(vjm, q)[0] - vjm.base[:3, 3], axis=1)))


def moving_joints(vjm: Vjm, series: Sequence[Series]) -> list[str]:
    """List the joints that move in the readings, by more than `MIN_JOINT_MOTION`.

    Args:
        vjm: The arm's virtual joint model.
        series: The readings.

    Returns:
        Names of the joints, in order.
    """
    sizes = np.ptp(np.concatenate([one.q for one in series]), axis=0)
    return [joint.name for joint, size in zip(vjm.arm.joints, sizes, strict=True) if size > MIN_JOINT_MOTION]


def _unsolved(vjm: Vjm, series: Sequence[Series], tried: Sequence[object]) -> str:
    """Explain why the registration failed, and what would help."""
    if DIVERGED in tried:
        return f"{DIVERGED}; a wrong unit, order of joints or sign of an angle?"
    for one in series:
        if one.seen.sum() < MIN_POINTS:
            return f"{one.frame} read {one.seen.sum()} targets; expected at least {MIN_POINTS}"
    poses = len(np.unique(np.concatenate([one.q for one in series]), axis=0))
    return (
        f"{poses} poses, in which {', '.join(moving_joints(vjm, series)) or 'no joint'} turns, leave a "
        f"frame or a "
        f"target open; expected at least {MIN_POSES} poses that turn three joints, or nominal "
        f"positions of all "
        "targets"
    )


def _refined(readings: MeanReadings, start: Registration) -> Registration | str:
    """Take Gauss-Newton steps from a start; returns `OPEN_STATUS` if a direction is undetermined."""
    layout, free, noise, kept = start.layout, start.free, start.noise, None
    values, V = np.linalg.eigh(readings.covariance)
    for k in range(MAX_STEPS):
        e, J = residuals(readings, layout), _jacobian(readings, layout, free)
        # Whiten residuals by W = (C + s^2 I)^-1/2, in the principal axes of C.
        root = V.swapaxes(1, 2) / np.sqrt(values + noise**2)[..., None]
        u = np.matvec(root, e)
        # Huber's weights; readings that were dropped as wild have weight zero.
        pull = FRAMES.influence(np.linalg.norm(u, axis=1)) * (True if kept is None else kept)
        # Normal equations, with the nominal targets as further rows.
        A = (root @ J).reshape(-1, J.shape[2])
        weighted = np.repeat(pull, 3)[:, None] * A
        information, held = weighted.T @ A, _held(start.nominal - layout.targets, A.shape[1])
        P = _inverse(information + np.diag(held[0]))
        if P is None:
            return OPEN_STATUS
        step, before = P @ (weighted.T @ u.ravel() + held[0] * held[1]), noise
        layout = _moved(layout, free, step)
        if kept is None and (np.abs(step).max() < SETTLED_STEP or k == MAX_UNWEIGHTED_STEPS):
            length = np.linalg.norm(e, axis=1)
            kept = np.asarray(length <= WILD_RATIO * max(float(np.median(length)), ASSUMED_NOISE))
        if kept is not None:
            # Noise s beyond the tracker's, from residuals and remaining degrees of freedom.
            spare = 3 * kept.sum() - float(np.sum(P * information))
            along = np.einsum("nxk,nx->nk", V, e)[kept]
            noise = (
                FRAMES.scatter(along, values[kept], spare / along.size)
                if spare >= MIN_SPARE_EQUATIONS
                else ASSUMED_NOISE
            )
            if np.abs(step).max() < STEP_TOLERANCE and abs(noise - before) <= NOISE_TOLERANCE * noise:
                distance, wild = np.linalg.norm(e, axis=1), int((pull < 1).sum())
                return replace(
                    start, layout=layout, covariance=P, distance=distance, noise=noise, downweighted=wild
                )
    return DIVERGED


def _held(off: Array, size: int) -> tuple[Array, Array]:
    """Compute weights and distances of the nominal targets, zero for frames and new targets.

    The loss is Huber's here too: a nominal position beyond the bend is wrong, not imprecise.
    """
    length = np.linalg.norm(off, axis=1, keepdims=True) / NOMINAL_DEVIATION
    weight, frames = (
        np.where(np.isfinite(off), FRAMES.influence(length), 0) / NOMINAL_DEVIATION**2,
        (size - off.size, 0),
    )
    return np.pad(weight.ravel(), frames), np.pad(np.nan_to_num(off).ravel(), frames)


def _jacobian(readings: MeanReadings, layout: FrameLayout, free: Mask) -> Array:
    """Change of modelled readings with turn and shift of free frames and with targets, (n, 3, k)."""
    R, n = layout.rotation[readings.frame], np.arange(len(readings.frame))
    J = np.zeros((len(n), 3, 6 * len(free) + layout.targets.size))
    turned = R @ skew(base_points(readings, layout.targets)).swapaxes(1, 2)
    for axis in range(3):
        J[n, :, 6 * readings.frame + axis] = turned[:, :, axis]
        J[n, axis, 6 * readings.frame + 3 + axis] = 1.0
        J[n, :, 6 * len(free) + 3 * readings.target + axis] = (R @ readings.rotation)[:, :, axis]
    return J[:, :, np.concatenate([np.repeat(free, 6), np.ones(layout.targets.size, dtype=bool)])]


def _moved(layout: FrameLayout, free: Mask, step: Array) -> FrameLayout:
    """Frames turned about their own axes and shifted, targets shifted, by a step of the free unknowns."""
    frames, targets = np.split(step, [6 * free.sum()])
    rotation, translation = layout.rotation.copy(), layout.translation.copy()
    rotation[free] = rotation[free] @ rotation_matrices(frames.reshape(-1, 6)[:, :3])
    translation[free] += frames.reshape(-1, 6)[:, 3:]
    return FrameLayout(rotation, translation, layout.targets + targets.reshape(-1, 3))


def _inverse(information: Array) -> Array | None:
    """Covariance of the unknowns; None where one of their directions is not seen."""
    size = np.sqrt(np.diag(information))
    if not size.all():
        return None
    values, V = np.linalg.eigh(information / np.outer(size, size))
    return None if values[0] < MIN_INFORMATION else np.asarray((V / values) @ V.T / np.outer(size, size))
