"""A dataset reading by reading: what may be left out one by one."""

import math
from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Dataset, Mask
from testbench.errors import Array, BenchError
from testbench.identify.regression import Ids, Regression, Term, regression_of
from testbench.identify.weighed import marker_points
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm, chain, observation, rotation_observation

MOST_READINGS = 5000
"""Most readings that fit into one program: about ten seconds and some hundred megabytes for 153 unknowns."""


@dataclass(frozen=True)
class Readings:
    """Rows of Eq. (13), reading by reading, in standard deviations."""

    A: Array  #: Observation matrices, (readings, 3, n).
    y: Array  #: Measured, (readings, 3) [1].
    unit: Array  #: Standard deviation of each, sqrt(2) sigma where all axes are alike, (readings,) [m, rad].
    run: Ids  #: Index of its run in the dataset, (readings,).
    marker: Ids  #: Index of its marker, -1 for the orientation, (readings,).


def weigh(vjm: Vjm, structure: Structure, data: Dataset) -> Readings:
    """A dataset of at most MOST_READINGS (BenchError) reading by reading; `reduce` has checked it."""
    points = marker_points(vjm, data.markers)
    args = (chain(vjm, data.q), structure, data.wrench, data.point)
    turned = data.sigma_rotation is not None
    each = len(points) + turned
    if data.runs * each > MOST_READINGS:
        raise BenchError(f"robust fit: expected at most {MOST_READINGS} readings, got {data.runs * each}")
    root = _roots(data)
    A, y = root @ observation(*args, points), (root @ data.deflection[..., None])[..., 0]
    unit, marker = np.linalg.det(root) ** (-1 / 3), np.arange(each)
    seen = data.seen
    if data.sigma_rotation is not None:
        turn = math.sqrt(2) * data.sigma_rotation
        A = np.concatenate([A, rotation_observation(*args) / turn], axis=1)
        y = np.concatenate([y, data.rotation[:, None] / turn], axis=1)
        unit = np.c_[unit, np.full(data.runs, turn)]
        seen, marker[-1] = np.c_[seen, np.ones(data.runs, dtype=bool)], -1
    used = seen.ravel()
    return Readings(
        A=A.reshape(-1, 3, structure.n)[used],
        y=y.reshape(-1, 3)[used],
        unit=unit.ravel()[used],
        run=np.repeat(np.arange(data.runs), each)[used],
        marker=np.tile(marker, data.runs)[used],
    )


def _roots(data: Dataset) -> Array:
    """Roots of the inverse covariance of every deflection, (runs, m, 3, 3) [1/m]; one where it was lost."""
    if data.precision is None:
        one = np.eye(3) / (math.sqrt(2) * data.sigma)
        return np.broadcast_to(one, (data.runs, len(data.markers), 3, 3))
    safe = np.where(data.seen[..., None, None], data.precision, np.eye(3))
    return np.asarray(np.linalg.cholesky(safe).swapaxes(2, 3))


def accepted(regression: Regression, readings: Readings, keep: Mask) -> Regression:
    """The regression of these readings alone; a term that lost all of its own is left out."""
    kinds = readings.marker >= 0, readings.marker < 0
    terms = tuple(_term(readings, keep & kind) for kind in kinds if (keep & kind).any())
    return regression_of(regression.structure, terms)


def _term(readings: Readings, keep: Mask) -> Term:
    """Triangular factor of some readings' rows over sqrt(N), as in F_M, Eq. (19)."""
    rows = np.concatenate([readings.A[keep], readings.y[keep, :, None]], axis=2) / math.sqrt(keep.sum())
    n = rows.shape[2] - 1
    T = np.zeros((n + 1, n + 1))
    R = np.linalg.qr(rows.reshape(-1, n + 1), mode="r")
    T[: len(R)] = R
    return Term(R=T[:n, :n], z=T[:n, n], rest=float(T[n, n] ** 2), equations=3 * int(keep.sum()))
