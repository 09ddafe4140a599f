"""Readings of pairs one by one, weighted, to be left out; and what can be reduced at all."""

import math
from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Dataset, Ids, Mask
from testbench.errors import Array, BenchError
from testbench.identify.absolute.unknowns import compliances
from testbench.identify.rows import pair_rows, straight
from testbench.model.load import Load
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

LARGEST = 1e9
"""Largest reading, load or coordinate that can be meant [m, N, N m]; squares of more may overflow."""
MOST_READINGS = 5000
"""Most readings that fit into one program: about ten seconds and some hundred megabytes for 153 unknowns."""


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
    each = len(data.markers) + (data.sigma_rotation is not None)
    if data.runs * each > MOST_READINGS:
        raise BenchError(f"robust fit: expected at most {MOST_READINGS} readings, got {data.runs * each}")
    told = straight(vjm, data.q, [Load(data.wrench, data.point)])
    rows, kinds = pair_rows(compliances(vjm, structure), told, data, np.arange(data.runs))
    used = (kinds >= 0).T.ravel()
    A = rows.transpose(3, 0, 1, 2).reshape(-1, 3, structure.n + 1)[used]
    unit, marker = np.linalg.det(_roots(data)) ** (-1 / 3), np.arange(each)
    if data.sigma_rotation is not None:
        unit = np.c_[unit, np.full(data.runs, math.sqrt(2) * data.sigma_rotation)]
        marker[-1] = -1
    return Readings(
        A=A[:, :, :-1],
        y=A[:, :, -1],
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
