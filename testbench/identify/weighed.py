"""Readings as rows of Eq. (13), weighted: what a run says of the unknowns, before it is boiled down."""

import math
from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Dataset, Ids, turn
from testbench.errors import Array, BenchError
from testbench.model.vjm import Vjm, chain, generalised_load, skew, twist_rows

LARGEST = 1e9
"""Largest reading, load or coordinate that can be meant [m, N, N m]; squares of more may overflow."""


@dataclass(frozen=True)
class Weighed:
    """Readings of some runs over sqrt(2) sigma sqrt(N), at most six a run."""

    J: Array  #: Readings per unit of each virtual joint, (k, n_theta, runs).
    u: Array  #: Load of each virtual joint, (n_theta, runs) [N, N m].
    z: Array  #: Readings, (k, runs).
    unmade: Array  #: What of them no rigid tool can make, (3 m, runs).


def equations_of(data: Dataset, *, rotation: bool) -> Ids:
    """Scalar equations of every run, (runs,)."""
    return np.full(data.runs, 3) if rotation else 3 * data.seen.sum(axis=1)


def weigh(vjm: Vjm, data: Dataset, runs: slice, equations: int, *, rotation: bool) -> Weighed:
    """The readings of some runs, positions or rotations, out of so many equations.

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
    if data.precision is None or rotation:
        weight = 1 / (math.sqrt(2) * sigma * math.sqrt(equations / 3))
        Q, G = np.linalg.qr(motion)
        J = (weight * G @ twist.reshape(6, -1)).reshape(-1, *twist.shape[1:])
        read = weight * (y @ where.rotation).reshape(len(y), -1).T
        z = Q.T @ read
        unmade = read - Q @ z
    else:
        own, z, unmade = _weighted(data.precision[runs] / (equations / 3), where.rotation, motion, y)
        J = np.einsum("rkx,xtr->ktr", own, twist, optimize=True)
    return Weighed(J, u, z, unmade)


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
