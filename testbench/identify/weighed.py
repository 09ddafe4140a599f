"""Readings of pairs one by one, weighted, so that single ones can be left out; and limits of datasets."""

from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError, Ids
from testbench.identify.absolute.unknowns import compliance_unknowns
from testbench.identify.lines import resolve_lines
from testbench.identify.rows import nominal_chain, pair_rows, whiten
from testbench.model.laws import model_for
from testbench.model.load import Load
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

MAX_READING = 1e9
"""Largest reading, load or coordinate [m, N, N m]: squares of larger ones may overflow."""
MAX_READINGS = 5000
"""Most readings in one program: about ten seconds and some hundred megabytes for 153 unknowns."""


def check_runs(vjm: Vjm, data: Dataset) -> None:
    """Refuse runs that cannot be reduced: none, no reading, another arm, or numbers that are too large.

    Args:
        vjm: The arm's virtual joint model.
        data: The runs.

    Raises:
        BenchError: When the dataset is one of these.
    """
    if data.runs == 0:
        raise BenchError("dataset: expected at least one run, got none")
    if not data.seen.any():
        raise BenchError(f"dataset: expected readings, every target was lost in all of {data.runs} runs")
    for name in ("before", "after", "wrench", "point"):
        values = getattr(data, name)
        largest = max(values.max(), -values.min())  # np.abs would copy the dataset
        if largest > MAX_READING:
            raise BenchError(f"{name}: expected SI numbers up to {MAX_READING:g}, got {largest:g}: too large")
    if data.q.shape[1] != vjm.arm.n_joints:
        raise BenchError(f"q: expected {vjm.arm.n_joints} joints, got {data.q.shape[1]}")


@dataclass(frozen=True)
class WeightedReadings:
    """Hold rows of Eq. (13), reading by reading, in standard deviations."""

    A: Array  #: Observation matrices, (readings, 3, n).
    y: Array  #: Measured, (readings, 3) [1].
    unit: Array  #: Standard deviation of each, sqrt(2) sigma if all axes are equal, (readings,) [m, rad].
    numbers: Ids  #: How many numbers each has: 3, or 1 along a line, (readings,).
    run: Ids  #: Index of its run in the dataset, (readings,).
    marker: Ids  #: Index of its marker, -1 for the orientation, (readings,).


def single_readings(vjm: Vjm, structure: Structure, data: Dataset) -> WeightedReadings:
    """Compute the weighted equations (13) reading by reading; `reduce` has checked the dataset.

    Args:
        vjm: The arm's virtual joint model.
        structure: The unknowns, n of them.
        data: The runs.

    Returns:
        Rows, readings and their units.

    Raises:
        BenchError: When there are more than `MAX_READINGS` readings.
    """
    each = len(data.markers) + (data.sigma_rotation is not None)
    if data.runs * each > MAX_READINGS:
        raise BenchError(f"robust fit: expected at most {MAX_READINGS} readings, got {data.runs * each}")
    data = resolve_lines(vjm, data)
    vjm = model_for(vjm, structure)
    # Rows of every reading, whitened, without lost ones.
    equilibrium = nominal_chain(vjm, data.q, [Load(data.wrench, data.point)])
    rows, kinds = pair_rows(compliance_unknowns(vjm, structure), equilibrium, data, np.arange(data.runs))
    A, marker = each_reading(rows, kinds), np.arange(each)
    one = np.tile(np.eye(3)[None, :, :, None], (each, 1, 1, data.runs))
    root = each_reading(one, whiten(one, data, np.arange(data.runs)))
    marker[len(data.markers) :] = -1
    used = (kinds >= 0).T.ravel()
    lines = np.zeros((data.runs, each), dtype=bool)
    lines[:, : len(data.markers)] = data.lines
    lines = lines.ravel()[used]
    # Size of a standard deviation: of a position the geometric mean of its axes.
    size = np.abs(np.linalg.det(np.where(lines[:, None, None], np.eye(3), root))) ** (-1 / 3)
    return WeightedReadings(
        A=A[:, :, :-1],
        y=A[:, :, -1],
        unit=np.where(lines, 1 / np.where(lines, np.linalg.norm(root[:, 0], axis=1), 1.0), size),
        numbers=np.where(lines, 1, 3),
        run=np.repeat(np.arange(data.runs), each)[used],
        marker=np.tile(marker, data.runs)[used],
    )


def each_reading(rows: Array, kinds: Ids) -> Array:
    """Select the rows of readings that were not lost.

    Args:
        rows: Rows, (s, 3, c, runs).
        kinds: Kind of every reading, (s, runs); -1 for lost ones.

    Returns:
        Rows reading by reading, (readings, 3, c).
    """
    return np.asarray(rows.transpose(3, 0, 1, 2).reshape(-1, *rows.shape[1:3])[(kinds >= 0).T.ravel()])
