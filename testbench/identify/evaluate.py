"""Predict deflections of a dataset with an estimate, and score their errors."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Dataset
from testbench.display import Displayed
from testbench.errors import Array, BenchError, check_array, check_type
from testbench.identify.estimate import Estimate
from testbench.identify.fold import BLOCK_RUNS
from testbench.model.laws import for_load_history, model_for
from testbench.model.vjm import Vjm, chain, generalised_load, marker_points, translation_rows


@dataclass(frozen=True, repr=False)
class DeflectionErrors(Displayed):
    """Hold the distance errors of predicted deflections over a set of runs."""

    rms: float  #: Root mean square of the distance error over all points [m].
    p95: float  #: 95th percentile of the distance error [m].
    max: float  #: Largest distance error [m].
    #: 95th percentile of the error over the measured deflection of its point [1]; None where no point moved.
    p95_relative: float | None
    #: Largest error over the measured deflection of its point [1]; None where no point moved.
    max_relative: float | None

    def about(self) -> dict[str, object]:
        """Summarise the errors in millimetres and per cent."""
        lengths = {"rms_mm": self.rms, "p95_mm": self.p95, "max_mm": self.max}
        shares = {"p95_percent": self.p95_relative, "max_percent": self.max_relative}
        return {name: f"{1e3 * value:.4g}" for name, value in lengths.items()} | {
            name: None if value is None else f"{100 * value:.3g}" for name, value in shares.items()
        }


def deflections(vjm: Vjm, estimate: Estimate, data: Dataset) -> Array:
    """Predict the deflections of a dataset's markers, dp = J_p C_theta J_F^T w, Eq. (11).

    Args:
        vjm: The arm's virtual joint model.
        estimate: The identified compliances.
        data: Gives poses, loads and markers; its readings are not used.

    Returns:
        Deflection of every marker in every run in base axes, (runs, m, 3) [m].

    Raises:
        BenchError: When an argument has another type.
    """
    check_type(vjm, Vjm, "vjm")
    check_type(estimate, Estimate, "estimate")
    check_type(data, Dataset, "data")
    return np.asarray(all_deflections(vjm, [estimate], data)[0])


def all_deflections(vjm: Vjm, estimates: Sequence[Estimate], data: Dataset) -> Array:
    """Predict the deflections of a dataset's markers by several models at once, block by block of runs.

    Args:
        vjm: The arm's virtual joint model.
        estimates: The models.
        data: Gives poses, loads and markers; its readings are not used.

    Returns:
        J_p C_theta J_F^T w in base axes, (models, runs, m, 3) [m].
    """
    points, found = marker_points(vjm, data.markers), []
    vjm = model_for(vjm, max((estimate.structure for estimate in estimates), key=lambda s: s.n_theta))
    for first in range(0, data.runs, BLOCK_RUNS):  # so that memory does not grow with the runs
        runs = slice(first, first + BLOCK_RUNS)
        where = chain(for_load_history(vjm, data.taken_off, runs), data.q[runs])
        load = generalised_load(where, data.wrench[runs], data.point[runs])
        rows = translation_rows(where, points)
        turns = [estimate.C_theta @ load[: len(estimate.C_theta)] for estimate in estimates]
        moved = [np.einsum("ptr,tr->rp", rows[:, : len(own)], own) for own in turns]
        found.append(np.array(moved).reshape(len(moved), -1, len(points), 3))
    return np.concatenate(found, axis=1)


def score(predicted: Array, reference: Array) -> DeflectionErrors:
    """Score predicted deflections against measured or true ones.

    Args:
        predicted: Such as `deflections` returns, (runs, m, 3) [m].
        reference: Such as `Dataset.deflection`, (runs, m, 3) [m]; index both with `Dataset.seen` where
            targets were lost.

    Returns:
        Root mean square, 95th percentile and largest distance error, absolute and relative.

    Raises:
        BenchError: When the shapes differ, or a number is not finite.
    """
    for name, values in (("predicted", predicted), ("reference", reference)):
        check_array(values, (None,) * np.ndim(values), f"{name} [m]")
    if np.shape(predicted) != np.shape(reference):
        raise BenchError(f"score: expected equal shapes, got {np.shape(predicted)} and {np.shape(reference)}")
    error = np.linalg.norm(predicted - reference, axis=-1).ravel()
    size = np.linalg.norm(reference, axis=-1).ravel()
    share = error[size > 0] / size[size > 0]
    return DeflectionErrors(
        rms=float(np.sqrt(np.mean(error**2))),
        p95=float(np.percentile(error, 95)),
        max=float(error.max()),
        p95_relative=float(np.percentile(share, 95)) if share.size else None,
        max_relative=float(share.max()) if share.size else None,
    )
