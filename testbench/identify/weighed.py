"""Readings as rows of Eq. (13), weighted: of whole runs, to be boiled down, or one by one, to be left out."""

import math
from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Dataset, Ids, Mask, turn
from testbench.errors import Array, BenchError
from testbench.model.structure import Structure
from testbench.model.vjm import (
    Vjm,
    chain,
    generalised_load,
    observation,
    rotation_observation,
    skew,
    twist_rows,
)

LARGEST = 1e9
"""Largest reading, load or coordinate that can be meant [m, N, N m]; squares of more may overflow."""
MOST_READINGS = 5000
"""Most readings that fit into one program: about ten seconds and some hundred megabytes for 153 unknowns."""


@dataclass(frozen=True)
class Weighed:
    """Readings of some runs in standard deviations sqrt(2) sigma, at most six a run."""

    J: Array  #: Readings per unit of each virtual joint, (k, n_theta, runs).
    u: Array  #: Load of each virtual joint, (n_theta, runs) [N, N m].
    z: Array  #: Readings, (k, runs).
    rest: Array  #: Squared length of what of them no rigid tool can make, (runs,).
    equations: Ids  #: Scalar equations behind them, (runs,).


def weigh(vjm: Vjm, data: Dataset, runs: Ids, *, rotation: bool) -> Weighed:
    """The readings of some runs, positions or rotations.

    In the tool's axes the readings of a run are a constant matrix times the twist of the tool. Its QR leaves
    at most six equations a run, however many markers there are; what no rigid tool can do goes to the rest.
    """
    where = chain(vjm, data.q[runs])
    u, twist = generalised_load(where, data.wrench[runs], data.point[runs]), twist_rows(where)
    if rotation:
        assert data.rotation_before is not None
        assert data.rotation_after is not None
        motion, sigma = np.eye(6)[3:], data.sigma_rotation
        y = turn(data.rotation_before[runs], data.rotation_after[runs])[:, None]
    else:
        motion, sigma = marker_motion(marker_points(vjm, data.markers)), data.sigma
        y = data.after[runs] - data.before[runs]
    assert sigma is not None
    own = None if data.precision is None or rotation else data.precision[runs]
    if own is None:
        weight = 1 / (math.sqrt(2) * sigma)
        Q, G = np.linalg.qr(motion)
        J = (weight * G @ twist.reshape(6, -1)).reshape(-1, *twist.shape[1:])
        read = weight * (y @ where.rotation).reshape(len(y), -1).T
        z = Q.T @ read
        unmade, equations = read - Q @ z, np.full(len(y), 3 * y.shape[1])
    else:
        G, z, unmade = _weighted(own, where.rotation, motion, y)
        J = np.einsum("rkx,xtr->ktr", G, twist, optimize=True)
        equations = 3 * own.any(axis=(2, 3)).sum(axis=1)
    return Weighed(J, u, z, (unmade**2).sum(axis=0), equations)


def _weighted(precision: Array, rotation: Array, motion: Array, y: Array) -> tuple[Array, Array, Array]:
    """Readings with a covariance each: QR of every run's own weighted motion of the markers.

    Of inverse covariances, (runs, m, 3, 3), rotations from the tool, (runs, 3, 3), the motion of the markers,
    (3 m, 6), and deflections, (runs, m, 3): triangular factors, (runs, k, 6), the readings in their
    coordinates, (k, runs), and what of them no rigid tool can make, (3 m, runs).
    """
    runs, m = precision.shape[:2]
    values, V = np.linalg.eigh(precision)
    root = np.sqrt(np.maximum(values, 0))[..., None] * V.swapaxes(2, 3)  # root^T root = precision
    inside = root @ rotation[:, None] @ motion.reshape(m, 3, 6)
    Q, G = np.linalg.qr(inside.reshape(runs, 3 * m, 6))
    readings = (root @ y[..., None]).reshape(runs, 3 * m, 1)
    z = Q.swapaxes(1, 2) @ readings
    return G, z[..., 0].T, (readings - Q @ z)[..., 0].T


def check_runs(vjm: Vjm, data: Dataset) -> None:
    """Refuse by BenchError what cannot be reduced: no reading, another arm, or numbers that are too large."""
    if data.runs == 0:
        raise BenchError("dataset: expected at least one run, got none")
    if not data.seen.any():
        raise BenchError(f"dataset: expected readings, every target was lost in all of {data.runs} runs")
    for name in ("before", "after", "wrench", "point"):
        values = getattr(data, name)
        largest = max(values.max(), -values.min())  # np.abs would copy the dataset
        if largest > LARGEST:
            raise BenchError(f"{name}: expected SI numbers up to {LARGEST:g}, got {largest:g}: too large")
    if data.q.shape[1] != vjm.arm.n_joints:
        raise BenchError(f"q: expected {vjm.arm.n_joints} joints, got {data.q.shape[1]}")


def marker_motion(points: Array) -> Array:
    """How markers at (m, 3) [m] move per unit twist of the tool, all in the tool's frame, (3 m, 6) [1, m]."""
    turns = np.array([skew(point).T for point in points])
    return np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns], axis=2).reshape(-1, 6)


def marker_points(vjm: Vjm, names: tuple[str, ...]) -> Array:
    """Positions of these markers in the tool's frame, (m, 3) [m]; BenchError when the arm lacks one."""
    have = vjm.arm.markers
    for name in names:
        if name not in have:
            raise BenchError(f"no marker {name!r} in {vjm.arm.name}; markers are {', '.join(have)}")
    return vjm.markers[[have.index(name) for name in names]]


@dataclass(frozen=True)
class Readings:
    """Rows of Eq. (13), reading by reading, in standard deviations."""

    A: Array  #: Observation matrices, (readings, 3, n).
    y: Array  #: Measured, (readings, 3) [1].
    unit: Array  #: Standard deviation of each, sqrt(2) sigma where all axes are alike, (readings,) [m, rad].
    run: Ids  #: Index of its run in the dataset, (readings,).
    marker: Ids  #: Index of its marker, -1 for the orientation, (readings,).


def one_by_one(vjm: Vjm, structure: Structure, data: Dataset) -> Readings:
    """A dataset of at most MOST_READINGS (BenchError) reading by reading; `reduce` has checked it."""
    points = marker_points(vjm, data.markers)
    args = (chain(vjm, data.q), structure, data.wrench, data.point)
    turned = data.sigma_rotation is not None
    each = len(points) + turned
    if data.runs * each > MOST_READINGS:
        raise BenchError(f"robust fit: expected at most {MOST_READINGS} readings, got {data.runs * each}")
    root = _roots(data)
    A = root @ observation(*args, points)
    unit, marker = np.linalg.det(root) ** (-1 / 3), np.arange(each)
    if data.sigma_rotation is not None:
        turn = math.sqrt(2) * data.sigma_rotation
        A = np.concatenate([A, rotation_observation(*args) / turn], axis=1)
        unit, marker[-1] = np.c_[unit, np.full(data.runs, turn)], -1
    used = _used(data)
    return Readings(
        A=A.reshape(-1, 3, structure.n)[used],
        y=white(data, data.deflection, data.rotation if turned else None),
        unit=unit.ravel()[used],
        run=np.repeat(np.arange(data.runs), each)[used],
        marker=np.tile(marker, data.runs)[used],
    )


def white(data: Dataset, moved: Array, turned: Array | None = None) -> Array:
    """Moves of the markers and turns of the tool as readings of a dataset, in standard deviations.

    Args:
        data: Says what was read, and how well.
        moved: (runs, m, 3) [m].
        turned: (runs, 3) [rad]; of no effect where positions alone are read.

    Returns:
        One row a reading, (readings, 3), in the order of `one_by_one`.
    """
    y = (_roots(data) @ moved[..., None])[..., 0]
    if data.sigma_rotation is not None and turned is not None:
        y = np.concatenate([y, turned[:, None] / (math.sqrt(2) * data.sigma_rotation)], axis=1)
    return np.asarray(y.reshape(-1, 3)[_used(data)])


def _used(data: Dataset) -> Mask:
    """Which readings there are, (runs * readings a run,)."""
    whole = np.ones((data.runs, int(data.sigma_rotation is not None)), dtype=bool)
    return np.concatenate([data.seen, whole], axis=1).ravel()


def _roots(data: Dataset) -> Array:
    """Roots of the inverse covariance of every deflection, (runs, m, 3, 3) [1/m]; one where it was lost."""
    if data.precision is None:
        one = np.eye(3) / (math.sqrt(2) * data.sigma)
        return np.broadcast_to(one, (data.runs, len(data.markers), 3, 3))
    safe = np.where(data.seen[..., None, None], data.precision, np.eye(3))
    return np.asarray(np.linalg.cholesky(safe).swapaxes(2, 3))
