"""Robust identification: Huber's loss on the length of every reading's residual; wild readings are rejected.

A reading is the deflection of one marker in one run, or the rotation of the tool in one run: three numbers
y_i in units of sqrt(2) sigma. A model is fitted, readings are weighed by the pull of their residuals, and so
on, until nothing moves: then it is least in

    sum_i h(|A_i x - y_i|) + 1/2 |B x - c|^2

with h Huber's loss (`robust_loss`) and the rows B, c of the prior, as every fit lowers a bound from above.

That finds the outliers: readings with a residual beyond REJECTION_THRESHOLD. The estimate is the plain one
from the rest. Huber's own model was worse, as a wild reading goes on pulling: with a fifth of the readings
off by 1 mm it cost 20 to 25 % of RMS over the workspace, the rejection 2 to 5 % (KR 500, MGCO68 and MGCO56
with a prior, median of 20 seeds). It was better only for errors as small as 0.3 mm, four standard deviations,
of which the rejection sees half.

Three markers on a rigid tool have nine numbers for six: a run by itself notices an error of one marker within
their plane, not always whose it is, and none across the plane. Other runs and the prior tell the rest.
"""

import time
from dataclasses import replace

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError, Mask
from testbench.identify.estimate import TOOL_MARKER, Constraint, Estimate, Penalty, Rejected
from testbench.identify.least_squares import minimum_norm
from testbench.identify.metric import Case, WeightedPrior, scale_by_prior
from testbench.identify.prior import Strength, cad_prior
from testbench.identify.regression import Regression, regression_of, term_from_triangle, triangular_factor
from testbench.identify.robust_loss import PAIRS
from testbench.identify.solve import solve, solve_with_prior
from testbench.identify.weighed import WeightedReadings, single_readings
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

REJECTION_THRESHOLD, LINE_THRESHOLD = 4.033, 3.291
"""Length beyond which a reading is rejected: the 99.9 % quantile of a normal 3-vector, and of one number.

At 99 % every third campaign of 45 sound readings would lose one, and gain nothing for it.
"""
MAX_REWEIGHTINGS, CONVERGED_CHANGE = 200, 1e-6
"""Most reweightings, and the change of a residual after which they end [1]."""
WEAK_UNCERTAINTY = 10.0
"""Relative uncertainty of the CAD compliances while outliers of GCO without a prior are searched."""
NO_OUTLIERS = "sigma too small, or wrong structure, load, unit or frame"


def without_outliers(
    vjm: Vjm,
    data: Dataset,
    regression: Regression,
    constraint: Constraint,
    held: WeightedPrior | Penalty | None,
) -> Estimate:
    """Reject outliers by Huber's loss, and fit the remaining readings by the plain method.

    GCO requires symmetric blocks.

    Args:
        vjm: The arm's virtual joint model.
        data: The runs.
        regression: All readings, reduced.
        constraint: "none" for least squares, "psd" for GCO.
        held: The prior, or the trace term of GCO without one.

    Returns:
        The estimate; F_M, its floor and the rank refer to the readings that are kept.

    Raises:
        BenchError: If the dataset is too large, or too few readings remain.
    """
    readings = single_readings(vjm, regression.structure, data)
    start = time.perf_counter()
    belief = held if isinstance(held, WeightedPrior) else None
    length, status = reject_iteratively(vjm, readings, regression, constraint, belief)
    limit = np.where(readings.numbers == 1, LINE_THRESHOLD, REJECTION_THRESHOLD)
    seconds, keep = time.perf_counter() - start, length <= limit
    left, equations = int(keep.sum()), int(readings.numbers[keep].sum())
    if not left or equations < regression.rank:  # fewer equations than directions that all readings see
        raise BenchError(
            f"{len(keep) - left} of {len(keep)} readings rejected, beyond {REJECTION_THRESHOLD} "
            f"standard deviations; "
            f"{equations} equations left for {regression.rank} directions: {NO_OUTLIERS}"
        )
    if not keep.all():
        regression = _accepted(regression.structure, readings, keep, np.ones(len(keep)))
    plain = solve(regression, constraint, held)
    return replace(
        plain,
        method=f"{plain.method}, Huber loss",
        status=plain.status if status == "solved" else f"{status} (search for outliers)",
        solver_seconds=plain.solver_seconds + seconds,
        rejected=_rejected(data, readings, keep, plain.pi),
        lost_runs=tuple(data.run[np.setdiff1d(readings.run, readings.run[keep])].tolist()),
    )


def reject_iteratively(
    vjm: Vjm,
    readings: WeightedReadings,
    regression: Regression,
    constraint: Constraint,
    belief: WeightedPrior | None,
) -> tuple[Array, str]:
    """Minimise Huber's loss by reweighting, and return the residuals.

    Without a prior, GCO uses the compliances of the arm's folder with a relative uncertainty of
    `WEAK_UNCERTAINTY`.

    Mathematics: `est-16`.

    Args:
        vjm: The arm's virtual joint model.
        readings: Readings one by one.
        regression: All readings, reduced.
        constraint: "none" for least squares, "psd" for GCO.
        belief: The prior; None for none.

    Returns:
        Length of every residual in standard deviations, (readings,) [1], and the status, "solved" if good.
    """
    s = regression.structure
    if constraint == "psd" and belief is None:
        belief = WeightedPrior(scale_by_prior(cad_prior(vjm.arm), vjm, s), Strength(WEAK_UNCERTAINTY))
    every = np.ones(len(readings.y), dtype=bool)
    length, status = np.zeros(len(every)), "solved"
    for _ in range(MAX_REWEIGHTINGS):
        weighted = _accepted(s, readings, every, np.sqrt(PAIRS.influence(length)))
        if belief is None:
            pi = minimum_norm(weighted).pi
        else:
            prior_solution = solve_with_prior(constraint, Case(weighted, belief))
            pi, status = prior_solution.pi, prior_solution.status
        before, length = length, np.linalg.norm(readings.y - readings.A @ pi, axis=1)
        if np.abs(length - before).max() < CONVERGED_CHANGE:
            return length, status
    return length, status


def _accepted(structure: Structure, readings: WeightedReadings, keep: Mask, weight: Array) -> Regression:
    """The regression of these readings alone, weighted; a term that lost all of its own is left out."""
    rows, terms = weight[:, None, None] * np.concatenate([readings.A, readings.y[..., None]], axis=2), []
    for kind in (readings.marker >= 0, readings.marker < 0):
        some = keep & kind
        if some.any():
            equations = int(readings.numbers[some].sum())
            T = triangular_factor(rows[some].reshape(-1, rows.shape[2])) / np.sqrt(equations / 3)
            terms.append(term_from_triangle(T, 0.0, equations))
    return regression_of(structure, tuple(terms))


def _rejected(data: Dataset, readings: WeightedReadings, keep: Mask, pi: Array) -> tuple[Rejected, ...]:
    """The readings left out, with their distance from the estimate that does without them."""
    length = np.linalg.norm(readings.y - readings.A @ pi, axis=1)
    names = (*data.markers, TOOL_MARKER)
    return tuple(
        Rejected(
            run=int(data.run[readings.run[i]]),
            marker=names[readings.marker[i]],
            residual=float(length[i] * readings.unit[i]),
            sigmas=float(length[i]),
        )
        for i in np.flatnonzero(~keep)
    )
