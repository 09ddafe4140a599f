"""Solve least squares or GCO on a reduced dataset, with a prior or without; reject outliers.

Every method (`Method`) ends in `solve`. With a prior both minimise chi^2 + |x - s e|^2 / u^2 in units of the
prior: x is the compliance over its expectation, e that expectation and u its relative uncertainty; GCO keeps
every block positive semi-definite. The data determine the common scale s, so that a CAD model which is wrong
by one factor costs nothing.

`minimum_norm` is weighted least squares, Eq. (14)-(15), from the reduced rows, without the information
matrix. `complete_conservatively` chooses unobservable directions so that its result is conservative.

`without_outliers` is the robust loss. A reading is the deflection of one marker in one run, or the rotation
of the tool in one run: three numbers y_i in units of sqrt(2) sigma. Readings are weighted by their residuals
and fitted again, until nothing changes. This minimises

    sum_i h(|A_i x - y_i|) + 1/2 |B x - c|^2

with Huber's loss h and the rows B, c of the prior. Readings with a residual beyond REJECTED_RESIDUAL are
outliers, and the plain method fits the rest. Huber's own fit was worse, because a wild reading keeps its
influence: with a fifth of the readings off by 1 mm it raised the RMS error over the workspace by 20 to 25 %,
rejection by 2 to 5 % (KR 500, MGCO68 and MGCO56 with a prior, median of 20 seeds). It was better only for
errors as small as 0.3 mm, four standard deviations, of which rejection finds half.

Three markers on a rigid tool have nine numbers for six unknowns. So a run alone detects an error of one
marker within their plane, not always of which one, and none across the plane. Other runs and the prior show
the rest.
"""

import math
import time
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError, Mask
from testbench.identify import cone
from testbench.identify.conic import (
    EXACT_FIT_SHARE,
    block_parameters,
    clip_negative_eigenvalues,
    solve_gco,
)
from testbench.identify.equations import WeightedReadings, weighted_readings
from testbench.identify.estimate import (
    ORIENTATION_READING,
    Constraint,
    Estimate,
    RejectedReading,
    TracePenalty,
    make_estimate,
    sensitivity_units,
)
from testbench.identify.interior import least_squares_on_cone
from testbench.identify.observability import null_space
from testbench.identify.prior import (
    PriorUncertainty,
    RegressionWithPrior,
    WeightedPrior,
    cad_prior,
    rows_with_prior,
    scale_by_prior,
)
from testbench.identify.registration import PAIR_LOSS
from testbench.identify.regression import (
    RANK_TOLERANCE,
    Regression,
    check_symmetric,
    f_m,
    regression_from_terms,
    term_from_triangle,
    triangular_factor,
)
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

# --- Weighted least squares ---------------------------------------------------------------------------------


def minimum_norm(regression: Regression) -> Estimate:
    """Solve weighted least squares, Eq. (14)-(15), with minimum norm along unobservable directions.

    Positions and rotations are weighted by 1 / (sqrt(2) sigma). The norm is that of pi in units in which each
    column of the observation matrix has length one.

    Mathematics: `est-1`.

    Args:
        regression: The reduced dataset.

    Returns:
        The estimate; it need not be conservative.
    """
    # F_M weights a term by 1/sqrt(N); Eq. (14) sums squares over all equations equally.
    rows = np.vstack([np.sqrt(term.n_equations) * np.c_[term.R, term.z] for term in regression.terms])
    A = rows[:, :-1]
    y = rows[:, -1]
    seen = regression.column_norms > 0
    scale, pi = np.linalg.norm(A[:, seen], axis=0), np.zeros(regression.structure.n_parameters)
    # SVD of the scaled columns; singular values below RANK_TOLERANCE are structural zeros.
    pi[seen] = np.linalg.lstsq(A[:, seen] / scale, y, rcond=RANK_TOLERANCE)[0] / scale
    estimate = make_estimate(regression, pi, method="least squares", constraint="none")
    return replace(estimate, status="solved")


EQUAL_FIT = 1e-7
"""Relative excess of F_M over least squares that still counts as an equal fit [1].

The model's negative eigenvalues, the solver's last digits, are set to zero, which changes F_M a little.
"""
PROVEN_DISTANCE = 1e-8
"""Shift of all eigenvalues, in units where the data are of order one, that proves that no model of equal fit
is conservative [1]; smaller ones are the solver's rounding."""
ZERO_ENTRY = 1e-12
"""Entry of an unobservable direction of length one below which it counts as zero [1]."""
NO_CONSERVATIVE_FIT = "no conservative model fits as well as least squares"
COMPLETED_METHOD = "least squares, conservative of equal fit"
"""Method name of an estimate for which a conservative model of equal fit exists."""


@dataclass(frozen=True)
class EqualFits:
    """Hold all parameters that fit as well as least squares: X = x + N w, with any w."""

    unit: Array  #: pi = unit * X, (n,) [m/N, rad/(N m), rad/N].
    x: Array  #: The solution of minimum norm, (n,) [1].
    N: Array  #: Unobservable directions, orthonormal as matrices, (n, n - r) [1].


def complete_conservatively(regression: Regression) -> Estimate:
    """Solve least squares, then choose its unobservable directions so that the model is conservative.

    It minimises |w| subject to X_0 + N w positive semi-definite in every block. If no w does that, it returns
    the solution of minimum norm, and the status says so.

    Mathematics: `est-2`.

    Args:
        regression: The reduced dataset.

    Returns:
        The estimate; its status is "solved" only if it is conservative and fits as well as least squares.

    Raises:
        BenchError: When the structure is not symmetric.
    """
    check_symmetric(regression.structure)
    plain = replace(minimum_norm(regression), constraint="free")
    if plain.conservative:
        return plain
    if regression.rank == regression.structure.n_parameters:
        return replace(plain, status=f"{NO_CONSERVATIVE_FIT}: the data determine all unknowns")
    # Second-order cone: the shortest w; PSD cones: every block of X_0 + N w.
    free = equal_fits(regression, plain.pi)
    shortest = cone.norm_constraint(0, np.eye(free.N.shape[1] + 1)[1:], np.zeros(free.N.shape[1]))
    solution = cone.solve(
        _equal_fit_program(regression.structure, free, np.zeros(len(plain.pi)), (shortest,))
    )
    if solution.status != "solved":
        why = (
            NO_CONSERVATIVE_FIT
            if least_eigenvalue_shift(regression.structure, free) > PROVEN_DISTANCE
            else solution.failure
        )
        return replace(plain, status=why, solver_seconds=solution.seconds)
    # Remove the solver's last digits, then check that the fit did not change by more than rounding.
    pi = free.unit * clip_negative_eigenvalues(regression.structure, free.x + free.N @ solution.x[1:])
    estimate = make_estimate(regression, pi, method=COMPLETED_METHOD, constraint="free")
    allowed = EQUAL_FIT * plain.f_m + EXACT_FIT_SHARE * f_m(regression, np.zeros(len(pi)))
    good = estimate.conservative and estimate.f_m <= plain.f_m + allowed
    if not good:
        estimate = replace(plain, status=f"{solution.failure}, and the solution is not exact enough")
    return replace(estimate, status="solved" if good else estimate.status, solver_seconds=solution.seconds)


def equal_fits(regression: Regression, pi: Array) -> EqualFits:
    """Compute the directions along which F_M does not change, in units of sensitivity.

    Args:
        regression: The reduced dataset.
        pi: Parameters of least squares, (n,) [m/N, rad/(N m), rad/N].

    Returns:
        The affine set X_0 + N w of equal fit.
    """
    s = regression.structure
    unit = sensitivity_units(regression, f_m(regression, np.zeros(s.n_parameters)) or 1.0)
    # A parameter that fills two entries counts twice.
    length = np.where(s.fills_two_entries, math.sqrt(2), 1.0)
    unseen = null_space(np.vstack([term.R for term in regression.terms]))
    N = np.linalg.qr((length / unit)[:, None] * unseen)[0]
    N[np.abs(N) < ZERO_ENTRY] = 0
    return EqualFits(unit, pi / unit, N / length[:, None])


def least_eigenvalue_shift(structure: Structure, equal_fits: EqualFits) -> float:
    """Compute a lower bound of the least t >= -1 for which some X_0 + N w + t 1 is positive semi-definite.

    Args:
        structure: The unknowns.
        equal_fits: The affine set of equal fit.

    Returns:
        The bound, in units where the data are of order one [1]; above 0 no conservative model fits equally.
    """
    identity = np.where(structure.rows == structure.columns, 1.0, 0.0)
    first = np.eye(1, 1 + equal_fits.N.shape[1])
    return cone.solve(
        _equal_fit_program(
            structure, equal_fits, identity, (cone.ConeConstraint("nonnegative", -first, np.ones(1)),)
        )
    ).lower_bound


def _equal_fit_program(
    s: Structure, equal_fits: EqualFits, shift_direction: Array, rows: tuple[cone.ConeConstraint, ...]
) -> cone.ConeProgram:
    """Make the program min t over (t, w) with X_0 + N w + t B in the cone, B the `shift_direction`."""
    for block in s.blocks:
        entries, svec = block_parameters(s, block)
        A = -svec @ np.c_[shift_direction, equal_fits.N][entries]
        rows += (cone.ConeConstraint("psd", A, svec @ equal_fits.x[entries]),)
    cost = np.r_[1.0, np.zeros(equal_fits.N.shape[1])]
    return cone.ConeProgram(cost, (cone.free_block(0, len(cost)),), rows)


# --- Solve least squares or GCO on a reduced dataset, with a prior or without -------------------------------

OPTIMALITY_TOLERANCE = 1e-8
"""Proven distance from the least value of (chi^2 + penalty) / 2 up to which an answer counts as optimal [1].

Then it lies within sqrt(2 OPTIMALITY_TOLERANCE) = 1.4e-4 standard deviations of the optimum in every
direction.
"""
COST_ROUNDING = 1e-12
"""Further allowance as a share of the cost [1]: rounding of large misfits in float64."""
METHOD_NAMES: dict[Constraint, str] = {"none": "least squares with prior", "psd": "GCO with prior"}


def solve(
    regression: Regression,
    constraint: Constraint,
    prior_or_penalty: WeightedPrior | TracePenalty | None = None,
) -> Estimate:
    """Solve least squares or GCO on weighted equations, with a prior or without.

    Mathematics: `prior-4`.

    Args:
        regression: The reduced dataset: F_M of n parameters, as triangular factors.
        constraint: "none" for least squares, "psd" for GCO, "free" for least squares made conservative along
            its unobservable directions, which takes no prior.
        prior_or_penalty: The prior with its uncertainty, or the trace term of GCO without a prior; None for
            neither, as in the paper.

    Returns:
        The estimate; its status says whether it is proven to be the optimum.

    Raises:
        BenchError: When GCO gets a structure that is not symmetric.
    """
    if not isinstance(prior_or_penalty, WeightedPrior):
        if constraint == "psd":
            return solve_gco(regression, prior_or_penalty)
        return (complete_conservatively if constraint == "free" else minimum_norm)(regression)
    # With a prior: minimise chi^2 and penalty in units of the prior, then map x back to pi.
    prior_solution = solve_with_prior(constraint, RegressionWithPrior(regression, prior_or_penalty))
    estimate = make_estimate(
        regression, prior_solution.pi, method=METHOD_NAMES[constraint], constraint=constraint
    )
    return replace(
        estimate,
        weighted_prior=prior_or_penalty,
        status=prior_solution.status,
        solver_seconds=prior_solution.seconds,
    )


@dataclass(frozen=True)
class PriorSolution:
    """Hold the parameters that a solver found, and how it ended."""

    pi: Array  #: Parameters, (n,) [m/N, rad/(N m), rad/N].
    seconds: float  #: Time inside the solver [s].
    status: str  #: "solved", or the failure.
    #: Whether Newton's method or our interior-point method found it; else LAPACK or Clarabel.
    by_our_solver: bool


def solve_with_prior(constraint: Constraint, case: RegressionWithPrior) -> PriorSolution:
    """Minimise |A pi - y|^2 + |B x - c|^2, with pi = L x in units of the prior.

    Args:
        constraint: "none" for least squares, "psd" for GCO.
        case: The weighted equations (A, y) and the prior (B, c).

    Returns:
        The answer of Newton's or our interior-point method if it is proven optimal; else that of
        `solve_by_reference`.
    """
    start, scaling = time.perf_counter(), case.prior.scaling
    M, r = rows_with_prior(case.regression, scaling, case.prior.uncertainty)
    x = certified_solution(M, r, scaling.block_orders if constraint == "psd" else ())
    if x is None:
        return solve_by_reference(constraint, case)
    return PriorSolution(scaling.L @ x, time.perf_counter() - start, "solved", by_our_solver=True)


def certified_solution(M: Array, r: Array, sizes: tuple[int, ...]) -> Array | None:
    """Minimise |M x - r| over x by Newton's method, and return the optimum only with its proof.

    Args:
        M: Rows of data and prior in standard deviations, (rows, n) [1].
        r: Their right-hand side, (rows,) [1].
        sizes: Orders of the blocks of which x is the svec, all positive semi-definite; () for no constraint.

    Returns:
        x, (n,) [1]; None where the duality gap exceeds `OPTIMALITY_TOLERANCE`.
    """
    x, gap = least_squares_on_cone(M, r, sizes)
    cost = float(np.sum((M @ x - r) ** 2)) / 2
    return x if gap <= OPTIMALITY_TOLERANCE + COST_ROUNDING * cost else None


def solve_by_reference(constraint: Constraint, case: RegressionWithPrior) -> PriorSolution:
    """Solve the same problem by an independent solver: LAPACK for least squares, Clarabel for GCO.

    Args:
        constraint: "none" for least squares, "psd" for GCO.
        case: The weighted equations and the prior.

    Returns:
        The answer, its status as the solver reports it.
    """
    start, scaling = time.perf_counter(), case.prior.scaling
    M, r = rows_with_prior(case.regression, scaling, case.prior.uncertainty)
    if constraint == "none":
        pi = scaling.L @ np.linalg.lstsq(M, r, rcond=None)[0]
        return PriorSolution(pi, time.perf_counter() - start, "solved", by_our_solver=False)
    solution = solve_by_clarabel(M, r, scaling.block_orders)
    return PriorSolution(
        scaling.L @ scaling.clip_negative_eigenvalues(solution.x[1:]),
        solution.seconds,
        solution.status,
        by_our_solver=False,
    )


def solve_by_clarabel(M: Array, r: Array, sizes: tuple[int, ...]) -> cone.Solution:
    """Minimise t subject to |M x - r| <= t, blocks of x positive semi-definite, by Clarabel.

    Args:
        M: Rows of data and prior in standard deviations, (rows, n) [1].
        r: Their right-hand side, (rows,) [1].
        sizes: Orders of the blocks of which x is the svec.

    Returns:
        The solution; its unknowns are t in units of the residual, then x.
    """
    n = M.shape[1]
    R: Array = np.asarray(np.linalg.qr(np.c_[M, r], mode="r"))
    unit = max(1.0, abs(R[-1, n]))
    residual = np.c_[np.zeros(len(R)), R[:, :n] / unit]
    return cone.solve(
        cone.ConeProgram(
            cost=np.r_[1.0, np.zeros(n)],
            blocks=(cone.free_block(0, 1), *cone.psd_blocks(1, sizes)),
            constraints=(cone.norm_constraint(0, residual, R[:, n] / unit),),
        )
    )


# --- Robust identification ----------------------------------------------------------------------------------

REJECTED_RESIDUAL, REJECTED_LINE_RESIDUAL = 4.033, 3.291
"""Length beyond which a reading is rejected: the 99.9 % quantile of a normal 3-vector, and of one number.

At 99 % every third campaign of 45 sound readings would lose one, and gain nothing for it.
"""
MAX_REWEIGHTINGS, CONVERGED_CHANGE = 200, 1e-6
"""Most reweightings, and the change of a residual after which they end [1]."""
WEAK_PRIOR_UNCERTAINTY = 10.0
"""Relative uncertainty of the CAD compliances while outliers of GCO without a prior are searched."""
TOO_MANY_OUTLIERS_CAUSE = "sigma too small, or wrong structure, load, unit or frame"


def without_outliers(
    vjm: Vjm,
    data: Dataset,
    regression: Regression,
    constraint: Constraint,
    prior_or_penalty: WeightedPrior | TracePenalty | None,
) -> Estimate:
    """Reject outliers by Huber's loss, and fit the remaining readings by the plain method.

    GCO requires symmetric blocks.

    Args:
        vjm: The arm's virtual joint model.
        data: The runs.
        regression: All readings, reduced.
        constraint: "none" for least squares, "psd" for GCO.
        prior_or_penalty: The prior, or the trace term of GCO without one.

    Returns:
        The estimate; F_M, its floor and the rank refer to the readings that are kept.

    Raises:
        BenchError: If the dataset is too large, or too few readings remain.
    """
    readings = weighted_readings(vjm, regression.structure, data)
    start = time.perf_counter()
    weighted_prior = prior_or_penalty if isinstance(prior_or_penalty, WeightedPrior) else None
    length, status = robust_residuals(vjm, readings, regression, constraint, weighted_prior)
    limit = np.where(readings.n_components == 1, REJECTED_LINE_RESIDUAL, REJECTED_RESIDUAL)
    seconds, keep = time.perf_counter() - start, length <= limit
    left, equations = int(keep.sum()), int(readings.n_components[keep].sum())
    if not left or equations < regression.rank:  # fewer equations than directions that all readings see
        raise BenchError(
            f"{len(keep) - left} of {len(keep)} readings rejected, beyond {REJECTED_RESIDUAL} "
            f"standard deviations; "
            f"{equations} equations left for {regression.rank} directions: {TOO_MANY_OUTLIERS_CAUSE}"
        )
    if not keep.all():
        regression = _accepted(regression.structure, readings, keep, np.ones(len(keep)))
    plain = solve(regression, constraint, prior_or_penalty)
    return replace(
        plain,
        method=f"{plain.method}, Huber loss",
        status=plain.status if status == "solved" else f"{status} (search for outliers)",
        solver_seconds=plain.solver_seconds + seconds,
        rejected=_rejected(data, readings, keep, plain.pi),
        rejected_runs=tuple(data.run[np.setdiff1d(readings.run_index, readings.run_index[keep])].tolist()),
    )


def robust_residuals(
    vjm: Vjm,
    readings: WeightedReadings,
    regression: Regression,
    constraint: Constraint,
    weighted_prior: WeightedPrior | None,
) -> tuple[Array, str]:
    """Fit all readings by Huber's loss, by iterative reweighting, and return their residuals.

    Without a prior, GCO uses the compliances of the arm's folder with a relative uncertainty of
    `WEAK_PRIOR_UNCERTAINTY`.

    Mathematics: `est-16`.

    Args:
        vjm: The arm's virtual joint model.
        readings: The weighted equations, reading by reading.
        regression: The same equations, reduced.
        constraint: "none" for least squares, "psd" for GCO.
        weighted_prior: The prior; None for none.

    Returns:
        Length of every residual in standard deviations, (readings,) [1], and the status, "solved" if good.
    """
    s = regression.structure
    if constraint == "psd" and weighted_prior is None:
        weighted_prior = WeightedPrior(
            scale_by_prior(cad_prior(vjm.arm), vjm, s), PriorUncertainty(WEAK_PRIOR_UNCERTAINTY)
        )
    every = np.ones(len(readings.y), dtype=bool)
    length, status = np.zeros(len(every)), "solved"
    for _ in range(MAX_REWEIGHTINGS):
        weighted = _accepted(s, readings, every, np.sqrt(PAIR_LOSS.weight(length)))
        if weighted_prior is None:
            pi = minimum_norm(weighted).pi
        else:
            prior_solution = solve_with_prior(constraint, RegressionWithPrior(weighted, weighted_prior))
            pi, status = prior_solution.pi, prior_solution.status
        before, length = length, np.linalg.norm(readings.y - readings.A @ pi, axis=1)
        if np.abs(length - before).max() < CONVERGED_CHANGE:
            return length, status
    return length, status


def _accepted(structure: Structure, readings: WeightedReadings, keep: Mask, weight: Array) -> Regression:
    """Select the equations of some readings; a term without any reading is left out."""
    rows, terms = weight[:, None, None] * np.concatenate([readings.A, readings.y[..., None]], axis=2), []
    for kind in (readings.marker_index >= 0, readings.marker_index < 0):
        of_kind = keep & kind
        if of_kind.any():
            equations = int(readings.n_components[of_kind].sum())
            T = triangular_factor(rows[of_kind].reshape(-1, rows.shape[2])) / np.sqrt(equations / 3)
            terms.append(term_from_triangle(T, 0.0, equations))
    return regression_from_terms(structure, tuple(terms))


def _rejected(
    data: Dataset, readings: WeightedReadings, keep: Mask, pi: Array
) -> tuple[RejectedReading, ...]:
    """List the readings that were left out, with their distance from the estimate without them."""
    length = np.linalg.norm(readings.y - readings.A @ pi, axis=1)
    names = (*data.markers, ORIENTATION_READING)
    return tuple(
        RejectedReading(
            run=int(data.run[readings.run_index[i]]),
            marker=names[readings.marker_index[i]],
            residual=float(length[i] * readings.deviation[i]),
            residual_over_sigma=float(length[i]),
        )
        for i in np.flatnonzero(~keep)
    )
