"""Rows of tables about datasets and fits, units in their names, for Parquet, report.json and views."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.model.structure import Constraint
from testbench.runs.spread import Number, Share, Spread

if TYPE_CHECKING:
    from testbench.identify.estimate import DeflectionErrors

MM, UM = 1e3, 1e6


def rms(vectors: Array) -> float:
    """Compute the root mean square of the lengths of vectors, (..., 3)."""
    return float(np.sqrt(np.square(vectors).sum(axis=-1).mean()))


def rounded(values: Array, digits: int = 5) -> list[float]:
    """Round numbers to significant digits.

    Args:
        values: The numbers, of any shape.
        digits: Number of digits.

    Returns:
        The rounded numbers, in one list.
    """
    return [float(f"{x:.{digits}g}") for x in np.ravel(values).tolist()]


@dataclass(frozen=True)
class DatasetRow:
    """Hold what a dataset holds: counts, and the least and largest deflection of a marker."""

    runs: int
    points: int
    deflection_min_mm: Number
    deflection_max_mm: Number
    sigma_um: float


def dataset_row(data: Dataset) -> DatasetRow:
    """Count what a dataset holds."""
    size = MM * np.linalg.norm(data.deflection, axis=-1)
    return DatasetRow(data.n_runs, data.n_points, float(size.min()), float(size.max()), UM * data.sigma)


@dataclass(frozen=True)
class ErrorRow:
    """Hold distance errors of predicted deflections; relative ones are shares of a point's own deflection."""

    rms_mm: Number
    p95_mm: Number
    max_mm: Number
    p95_relative_percent: Number
    max_relative_percent: Number


@dataclass(frozen=True, kw_only=True)
class FitRow:
    """Hold what a method found, without its errors; nothing of a user's estimator that failed."""

    name: str  #: Of the model.
    structure: str  #: Name of its structure.
    method: str = "own estimator"  #: How it was identified, in words.
    constraint: Constraint = "own"  #: What was asked of the blocks.
    prior: bool  #: Whether a prior fills what the data cannot see.
    status: str  #: "solved", or why not.
    parameters: int  #: Unknowns.
    rank: int | Spread | None = None  #: Directions of them that the data see.
    unique: Share = False  #: Whether they see all.
    conservative: Share = False  #: Whether every block is symmetric and positive semi-definite.
    min_eigenvalue: Number = None  #: Smallest eigenvalue of a block [m/N, rad/(N m)].
    f_m: Number = None  #: Cost of Eq. (19).
    f_m_floor: Number = None  #: What noise alone leaves of it.
    #: Bound of F_M + trace term above its least value: how well the program is solved; None where none is.
    duality_gap: Number = None
    f_m_excess_bound: Number = None  #: Bound of F_M above its least value: what the trace weight costs.
    trace_bounds_rad_per_Nm: tuple[Number, ...] | None = None  #: Traces within which the bounds hold.
    held_by_trace_weight: Share = False  #: Whether only the trace weight holds unseen compliance.
    trace_weight_Nm_per_rad: Number = None  #: Of GCO without a prior, learnt unless it was given.
    total_trace_rad_per_Nm: Number = None  #: Of all blocks, in scaled units.
    solve_seconds: Number = None  #: Wall time of the estimator.
    advice: tuple[str, ...] = ()  #: What the estimate says of itself.


NO_ERRORS = ErrorRow(None, None, None, None, None)  #: Of an estimator that failed.
FAILED = "failed: "  #: Begins the status of one.


def error_row(score: "DeflectionErrors") -> ErrorRow:
    """Convert errors to millimetres and per cent."""
    return ErrorRow(
        rms_mm=MM * score.rms,
        p95_mm=MM * score.p95,
        max_mm=MM * score.max,
        p95_relative_percent=None if score.p95_relative is None else 100 * score.p95_relative,
        max_relative_percent=None if score.max_relative is None else 100 * score.max_relative,
    )
