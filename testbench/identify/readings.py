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
        One row a reading, (readings, 3), in the order of `weigh`.
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
