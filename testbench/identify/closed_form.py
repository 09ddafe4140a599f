"""Pose of the base in a tracker's frame, and targets on the tool, in closed form.

A reading of target k in pose r in frame s, the arm rigid, is

    p_rk = R_s (R_r m_k + p_r) + t_s.

The tool's pose R_r, p_r follows from the arm; R_s, t_s and the target m_k are unknown. With R_s^T and R_s^T
t_s as unknowns it is linear. If m_k is roughly known, Kabsch's rotation between two sets of points needs
fewer poses.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Series
from testbench.errors import Array, Ids
from testbench.model.vjm import Vjm, tool_pose

MIN_POINTS = 3
"""Fewest points that determine a frame, if they are not on a line."""
#: Readings that are used, drawn at random where there are more: noise is not what limits a frame.
MAX_READINGS = 3000
BLIND_DIRECTION = 1e-6
"""Least singular value of the linear form over its largest, below which it is not used [1]."""


@dataclass(frozen=True)
class MeanReadings:
    """Hold readings of targets, one per target, pose and frame: the mean of repeated ones.

    The arm's geometry changes a reading equally in every row of a pose: further rows carry no information on
    it.
    """

    frame: Ids  #: Index of the frame, (n,).
    target: Ids  #: Index of the target, (n,).
    y: Array  #: Position, the frame's axes, (n, 3) [m].
    covariance: Array  #: Of its noise, the frame's axes, (n, 3, 3) [m^2].
    rotation: Array  #: Tool's orientation by the arm's kinematics, (n, 3, 3).
    position: Array  #: Tool's position by the arm's kinematics, (n, 3) [m].


@dataclass(frozen=True)
class FrameLayout:
    """Hold frames and targets; NaN where one is not known yet."""

    rotation: Array  #: R_s, frame from base, (frames, 3, 3).
    translation: Array  #: t_s, base in the frame, (frames, 3) [m].
    targets: Array  #: m_k in the tool's frame, (targets, 3) [m].

    @property
    def complete(self) -> bool:
        """Tell whether all frames and targets are known."""
        return all(np.isfinite(part).all() for part in vars(self).values())


def mean_readings(vjm: Vjm, series: Sequence[Series]) -> MeanReadings:
    """Average repeated readings of one target in one pose and frame; at most `MAX_READINGS` of them are kept.

    Args:
        vjm: The arm's virtual joint model.
        series: Readings of one mount.

    Returns:
        The means, with the tool's pose by the arm's kinematics.
    """
    frames, targets = frame_and_target_names(series)
    parts = [_means(one, frames.index(one.frame), targets) for one in series]
    frame, target, q, y, C = (np.concatenate(part) for part in zip(*parts, strict=True))
    some = np.sort(np.random.Generator(np.random.Philox(0)).permutation(len(q))[:MAX_READINGS])
    position, rotation = tool_pose(vjm, q[some])
    return MeanReadings(frame[some], target[some], y[some], C[some], rotation, position)


def frame_and_target_names(series: Sequence[Series]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """List the names of all frames and of all targets, in order.

    Args:
        series: The readings.

    Returns:
        Names of the frames, and of the targets.
    """
    targets = (name for one in series for name in one.markers)
    return tuple(dict.fromkeys(one.frame for one in series)), tuple(dict.fromkeys(targets))


def _means(series: Series, frame: int, targets: tuple[str, ...]) -> tuple[Array, ...]:
    """Frame, target, joints, position and covariance of every mean of a series."""
    row, column = np.nonzero(series.seen)
    target = np.array([targets.index(name) for name in series.markers])[column]
    keys = np.column_stack([series.q[row], target])
    _, first, group = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    count = np.bincount(group.ravel())[:, None]
    y, C = np.zeros((len(first), 3)), np.zeros((len(first), 3, 3))
    np.add.at(y, group.ravel(), series.position[row, column])
    own = series.sigma**2 * np.eye(3)
    np.add.at(
        C, group.ravel(), own if series.precision is None else np.linalg.inv(series.precision[row, column])
    )
    ids = np.full(len(first), frame)
    return ids, target[first], series.q[row[first]], y / count, C / count[..., None] ** 2


def initial_layouts(readings: MeanReadings, known: FrameLayout) -> Iterator[FrameLayout]:
    """Yield complete sets of frames and targets as starts of the refinement.

    Args:
        readings: The readings.
        known: Frames and targets; NaN where unknown.

    Yields:
        A start from the known targets, and one from the linear form without them.
    """
    for targets in (known.targets, _hand_eye(readings, len(known.targets))):
        layout = _complete(readings, replace(known, targets=targets))
        if layout.complete:
            yield layout


def _hand_eye(readings: MeanReadings, targets: int) -> Array:
    """Targets by the linear form in the frame with most readings, (targets, 3) [m]; NaN for all others.

    Its equations are R_s^T p_rk - R_s^T t_s - R_r m_k = p_r.
    """
    found = np.full((targets, 3), np.nan)
    own = readings.frame == np.bincount(readings.frame).argmax()
    read, at = np.unique(readings.target[own], return_inverse=True)
    R, at, n = readings.rotation[own], at.ravel(), np.arange(own.sum())
    A = np.zeros((len(n), 3, 12 + 3 * len(read)))
    for axis in range(3):
        A[:, axis, 3 * axis : 3 * axis + 3] = readings.y[own]
        A[:, axis, 9 + axis] = -1
        A[n, :, 12 + 3 * at + axis] = -R[:, :, axis]
    x, _, rank, _ = np.linalg.lstsq(
        A.reshape(3 * len(n), -1), readings.position[own].ravel(), rcond=BLIND_DIRECTION
    )
    if rank == A.shape[2]:
        found[read] = x[12:].reshape(-1, 3)
    return found


def _complete(readings: MeanReadings, layout: FrameLayout) -> FrameLayout:
    """Frames by the known targets and targets by the known frames, in turn, until neither finds more."""
    rotation, translation, targets = (part.copy() for part in vars(layout).values())
    while True:
        missing = np.isnan(translation).sum() + np.isnan(targets).sum()
        for s in np.flatnonzero(np.isnan(translation[:, 0])):
            use = (readings.frame == s) & np.isfinite(targets[readings.target, 0])
            if use.sum() >= MIN_POINTS:
                rotation[s], translation[s] = kabsch(base_points(readings, targets)[use], readings.y[use])
        for k in np.flatnonzero(np.isnan(targets[:, 0])):
            use = (readings.target == k) & np.isfinite(translation[readings.frame, 0])
            if use.any():
                at = readings.frame[use]
                base = np.vecmat(readings.y[use] - translation[at], rotation[at])
                targets[k] = np.median(
                    np.vecmat(base - readings.position[use], readings.rotation[use]), axis=0
                )
        if missing == np.isnan(translation).sum() + np.isnan(targets).sum():
            return FrameLayout(rotation, translation, targets)


def base_points(readings: MeanReadings, targets: Array) -> Array:
    """Compute the targets in base axes, R_r m_k + p_r.

    Args:
        readings: The readings.
        targets: Targets in the tool's frame, (targets, 3) [m].

    Returns:
        Target of every reading, (n, 3) [m].
    """
    return np.asarray(readings.position + np.matvec(readings.rotation, targets[readings.target]))


def residuals(readings: MeanReadings, layout: FrameLayout) -> Array:
    """Compute readings minus model, p_rk - R_s (R_r m_k + p_r) - t_s, in the frame's axes.

    Args:
        readings: The readings.
        layout: Frames and targets.

    Returns:
        (n, 3) [m].
    """
    x = np.matvec(layout.rotation[readings.frame], base_points(readings, layout.targets))
    return np.asarray(readings.y - x - layout.translation[readings.frame])


def kabsch(points: Array, read: Array, *, mirrored: bool = False) -> tuple[Array, Array]:
    """Find the rotation and translation that take points to readings with least squares.

    Mathematics: `abs-6`.

    Args:
        points: Points, (n, 3) [m].
        read: Their readings, (n, 3) [m].
        mirrored: Whether the determinant is -1 (Kabsch 1976; Arun, Huang, Blostein 1987; Umeyama 1991).

    Returns:
        Rotation, (3, 3) [1], and translation, (3,) [m].
    """
    centre, seen = points.mean(axis=0), read.mean(axis=0)
    R = nearest_rotation((read - seen).T @ (points - centre), mirrored=mirrored)
    return R, seen - R @ centre


def nearest_rotation(M: Array, *, mirrored: bool = False) -> Array:
    """Find the rotation R with the largest trace of R^T M.

    Args:
        M: Any matrix, (3, 3).
        mirrored: Whether the determinant is -1.

    Returns:
        R, (3, 3) [1].
    """
    U, _, Vt = np.linalg.svd(M)
    sign = (-1 if mirrored else 1) * np.sign(np.linalg.det(U @ Vt))
    return np.asarray(U @ np.diag([1, 1, sign]) @ Vt)
