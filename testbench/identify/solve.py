"""Solve least squares or GCO on weighted equations, with a prior or without; reject outliers.

Every method (`Method`) ends in `solve`. With a prior both minimise chi^2 + |x - s e|^2 / u^2: x are the
compliances in units of the prior, e their expectation and u its relative uncertainty; GCO keeps every block
positive semi-definite. The data determine the common scale s, so that a prior of wrong scale costs nothing.

`minimum_norm` is weighted least squares, Eq. (14)-(15), solved without the information matrix.
`conservative_least_squares` chooses unobservable directions so that its result is conservative.

`without_outliers` is the robust loss. A reading is the deflection of one marker in one run, or the rotation
of the tool in one run: three numbers y_i in units of sqrt(2) sigma. Readings are weighted by their residuals
and fitted again, until nothing changes. This minimises

    sum_i h(|A_i x - y_i|) + 1/2 |B x - c|^2

with Huber's loss h and the equations B x = c of the prior. Readings with a residual beyond REJECTED_RESIDUAL
are outliers, and the plain method fits the others. The fit by Huber's loss itself was worse, because gross
errors keep their influence: with a fifth of the readings off by 1 mm it raised the RMS error over the
workspace by 20 to 25 %, rejection by 2 to 5 % (KR 500, MGCO68 and MGCO56 with a prior, median of 20 seeds).
It was better only for errors as small as 0.3 mm, four standard deviations, half of which rejection misses.

Three markers on a rigid tool give nine numbers for six unknowns. So one run detects an error of a marker
within the plane of the markers, not always of which one, and none across this plane. Other runs and the prior
detect the others.
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
    clip_negative_eigenvalues,
    solve_gco,
    svecs_per_parameter,
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

    The norm is that of pi in units in which each column of the observation matrix has length one.

    Mathematics: `est-1`.

    Args:
        regression: The weighted equations.

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


EQUAL_FIT_TOLERANCE = 1e-7
"""Excess of F_M over that of least squares that counts as an equal fit, over F_M [1].

Rounding errors of the solver are negative eigenvalues; setting them to zero changes F_M a little.
"""
EIGENVALUE_SHIFT_TOLERANCE = 1e-8
"""Least shift of all eigenvalues that proves that no model of equal fit is conservative, in units in which
the data are of order one [1]; smaller shifts are rounding of the solver."""
ZERO_ENTRY_TOLERANCE = 1e-12
"""Size below which an entry of an unobservable unit vector counts as zero [1]."""
NO_CONSERVATIVE_FIT = "no conservative model fits as well as least squares"
COMPLETED_METHOD_NAME = "least squares, conservative of equal fit"
"""Name of the method in an estimate of `conservative_least_squares` that is conservative."""


@dataclass(frozen=True)
class EqualFits:
    """Hold all parameters pi that fit as well as least squares: pi = u * (x + N w) for any vector w.

    u are units of the parameters, x is one solution in these units, and N spans the unobservable directions.
    """

    parameter_units: Array  #: Units u of all parameters, (n,) [m/N, rad/(N m), rad/N].
    minimum_norm_solution: Array  #: Least squares x of minimum norm, in these units, (n,) [1].
    null_space: Array  #: Basis N of the r unobservable directions, orthonormal as matrices, (n, r) [1].


def conservative_least_squares(regression: Regression) -> Estimate:
    """Solve least squares, and move along unobservable directions to the nearest conservative model.

    With all equal fits x + N w of `EqualFits`, it minimises |w| subject to every block being positive
    semi-definite. If no w satisfies this, it returns the solution of minimum norm, and the status says so.

    Mathematics: `est-2`.

    Args:
        regression: The weighted equations.

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
    # Second-order cone: the shortest w; PSD cones: every block of x + N w.
    free = equal_fits(regression, plain.pi)
    shortest = cone.norm_constraint(
        0, np.eye(free.null_space.shape[1] + 1)[1:], np.zeros(free.null_space.shape[1])
    )
    solution = cone.solve(_equal_fit_program(regression.structure, free, np.zeros(len(plain.pi)), shortest))
    if solution.status != "solved":
        why = (
            NO_CONSERVATIVE_FIT
            if _least_eigenvalue_shift(regression.structure, free) > EIGENVALUE_SHIFT_TOLERANCE
            else solution.failure
        )
        return replace(plain, status=why, solver_seconds=solution.seconds)
    # Remove the solver's last digits, then check that the fit did not change by more than rounding.
    pi = free.parameter_units * clip_negative_eigenvalues(
        regression.structure, free.minimum_norm_solution + free.null_space @ solution.unknowns[1:]
    )
    estimate = make_estimate(regression, pi, method=COMPLETED_METHOD_NAME, constraint="free")
    allowed = EQUAL_FIT_TOLERANCE * plain.f_m + EXACT_FIT_SHARE * f_m(regression, np.zeros(len(pi)))
    good = estimate.conservative and estimate.f_m <= plain.f_m + allowed
    if not good:
        estimate = replace(plain, status=f"{solution.failure}, and the solution is not exact enough")
    return replace(estimate, status="solved" if good else estimate.status, solver_seconds=solution.seconds)


def equal_fits(regression: Regression, pi: Array) -> EqualFits:
    """Compute the set of all parameters with the F_M of given ones, in the units of `sensitivity_units`.

    Args:
        regression: The weighted equations.
        pi: Parameters of least squares, (n,) [m/N, rad/(N m), rad/N].

    Returns:
        The affine set, with a basis of the directions along which F_M does not change.
    """
    s = regression.structure
    unit = sensitivity_units(regression, f_m(regression, np.zeros(s.n_parameters)) or 1.0)
    # A parameter that fills two entries counts twice.
    length = np.where(s.fills_two_entries, math.sqrt(2), 1.0)
    unseen = null_space(np.vstack([term.R for term in regression.terms]))
    N = np.linalg.qr((length / unit)[:, None] * unseen)[0]
    N[np.abs(N) < ZERO_ENTRY_TOLERANCE] = 0
    return EqualFits(unit, pi / unit, N / length[:, None])


def _least_eigenvalue_shift(structure: Structure, equal_fits: EqualFits) -> float:
    """Bound the least t >= -1 for which some x + N w + t 1 is positive semi-definite from below [1].

    Above 0 it proves that no model of equal fit is conservative.
    """
    identity = np.where(structure.rows == structure.columns, 1.0, 0.0)
    first = np.eye(1, 1 + equal_fits.null_space.shape[1])
    return cone.solve(
        _equal_fit_program(
            structure, equal_fits, identity, cone.ConeConstraint("nonnegative", -first, np.ones(1))
        )
    ).lower_bound


def _equal_fit_program(
    s: Structure, equal_fits: EqualFits, shift_direction: Array, first: cone.ConeConstraint
) -> cone.ConeProgram:
    """Make the program min t over (t, w) with x + N w + t B in the cone, B the `shift_direction`."""
    svecs = svecs_per_parameter(s)
    conservative = cone.psd_constraints(
        s.block_orders,
        svecs @ np.c_[shift_direction, equal_fits.null_space],
        svecs @ equal_fits.minimum_norm_solution,
    )
    cost = np.r_[1.0, np.zeros(equal_fits.null_space.shape[1])]
    return cone.ConeProgram(cost, (first, *conservative))


# --- Solve least squares or GCO on weighted equations, with a prior or without ------------------------------

OPTIMALITY_TOLERANCE = 1e-8
"""Largest proven excess of the cost (chi^2 + penalty) / 2 over its least value with which an answer counts as
optimal [1]. It is then within sqrt(2 OPTIMALITY_TOLERANCE) = 1.4e-4 standard deviations of the optimum."""
COST_ROUNDING = 1e-12
"""Further excess that is allowed, over the cost [1]: rounding of large costs in float64."""
METHOD_NAMES: dict[Constraint, str] = {"none": "least squares with prior", "psd": "GCO with prior"}
"""Names of the methods with a prior, for reports, by constraint."""


def solve(
    regression: Regression,
    constraint: Constraint,
    prior_or_penalty: WeightedPrior | TracePenalty | None = None,
) -> Estimate:
    """Solve least squares or GCO on weighted equations, with a prior or without.

    Mathematics: `prior-4`.

    Args:
        regression: The weighted equations.
        constraint: "none" for least squares, "psd" for GCO, "free" for least squares made conservative along
            its unobservable directions, which takes no prior.
        prior_or_penalty: The prior with its uncertainty, or the trace term of GCO without a prior; None for
            neither, as in the paper.

    Returns:
        The estimate; its status says whether it is proven to be the optimum.

    Raises:
        BenchError: When the constraint is "psd" and the structure is not symmetric.
    """
    if not isinstance(prior_or_penalty, WeightedPrior):
        if constraint == "psd":
            return solve_gco(regression, prior_or_penalty)
        return (conservative_least_squares if constraint == "free" else minimum_norm)(regression)
    # With a prior: minimise chi^2 and penalty in units of the prior, then map x back to pi.
    fit = solve_with_prior(constraint, regression, prior_or_penalty)
    estimate = make_estimate(
        regression,
        prior_or_penalty.scaling.L @ fit.x,
        method=METHOD_NAMES[constraint],
        constraint=constraint,
    )
    return replace(
        estimate,
        weighted_prior=prior_or_penalty,
        status=fit.status,
        solver_seconds=fit.seconds,
    )


@dataclass(frozen=True)
class ConeFit:
    """Hold the solution of a least-squares problem over positive semi-definite blocks, and its status."""

    x: Array  #: Solution, svec of the blocks, (n,).
    seconds: float  #: Time inside the solver [s].
    status: str  #: "solved", or the failure as a sentence.
    #: Whether Newton's method or the interior-point method solved it; else LAPACK or Clarabel.
    by_our_solver: bool


def solve_with_prior(
    constraint: Constraint, regression: Regression, weighted_prior: WeightedPrior
) -> ConeFit:
    """Minimise |A pi - y|^2 + |B x - c|^2, where pi = L x and x is in units of the prior.

    Args:
        constraint: "none" for least squares, "psd" for GCO.
        regression: The weighted equations A pi = y.
        weighted_prior: The prior of pi, with the equations B x = c.

    Returns:
        The solution x and the status of the solver.
    """
    scaling = weighted_prior.scaling
    M, r = rows_with_prior(regression, scaling, weighted_prior.uncertainty)
    return fit_on_cone(M, r, scaling.block_orders if constraint == "psd" else ())


def fit_on_cone(M: Array, r: Array, block_orders: tuple[int, ...]) -> ConeFit:
    """Minimise |M x - r| over x with positive semi-definite blocks, by our own method.

    Newton's method solves least squares, an interior-point method GCO. If the answer is not proven to be
    within `OPTIMALITY_TOLERANCE` of the optimum, `fit_on_cone_by_library` solves the problem again.

    Args:
        M: Weighted equations of data and prior, (rows, n) [1].
        r: Their right-hand side, (rows,) [1].
        block_orders: Orders of the blocks whose svec is x; () for no constraint.

    Returns:
        The solution and the status of the solver.
    """
    start = time.perf_counter()
    x, gap = least_squares_on_cone(M, r, block_orders)
    cost = float(np.sum((M @ x - r) ** 2)) / 2
    if gap <= OPTIMALITY_TOLERANCE + COST_ROUNDING * cost:
        return ConeFit(x, time.perf_counter() - start, "solved", by_our_solver=True)
    return fit_on_cone_by_library(M, r, block_orders)


def fit_on_cone_by_library(M: Array, r: Array, block_orders: tuple[int, ...]) -> ConeFit:
    """Minimise |M x - r| over x with positive semi-definite blocks, by LAPACK without blocks, or by Clarabel.

    Args:
        M: Weighted equations of data and prior, (rows, n) [1].
        r: Their right-hand side, (rows,) [1].
        block_orders: Orders of the blocks whose svec is x; () for no constraint.

    Returns:
        The solution and the status of the solver.
    """
    start, n = time.perf_counter(), M.shape[1]
    if not block_orders:
        x: Array = np.asarray(np.linalg.lstsq(M, r, rcond=None)[0])
        return ConeFit(x, time.perf_counter() - start, "solved", by_our_solver=False)
    # The unknowns are |M x - r| over its least value without the constraint, then x.
    R: Array = np.asarray(np.linalg.qr(np.c_[M, r], mode="r"))
    unit = max(1.0, abs(R[-1, n]))
    residual = np.c_[np.zeros(len(R)), R[:, :n] / unit]
    solution = cone.solve(
        cone.ConeProgram(
            cost=np.r_[1.0, np.zeros(n)],
            constraints=(
                cone.norm_constraint(0, residual, R[:, n] / unit),
                *cone.psd_constraints(block_orders, np.eye(n, n + 1, 1)),
            ),
        )
    )
    x = cone.clip_negative_eigenvalues(solution.unknowns[1:], block_orders)
    return ConeFit(x, solution.seconds, solution.status, by_our_solver=False)


# --- Robust identification ----------------------------------------------------------------------------------

REJECTED_RESIDUAL, REJECTED_LINE_RESIDUAL = 4.033, 3.291
"""Residual over its standard deviation beyond which a reading is rejected: of three numbers, and of one [1].

They are 99.9 % quantiles of normal residuals. At 99 % every third campaign of 45 good readings would lose
one of them.
"""
MAX_REWEIGHTINGS, CONVERGED_CHANGE = 200, 1e-6
"""Largest number of reweightings, and the change of all residuals below which they end [1]."""
WEAK_PRIOR_UNCERTAINTY = 10.0
"""Relative uncertainty of nominal compliances in the search for outliers of GCO without a prior [1]."""
TOO_MANY_OUTLIERS_CAUSE = "sigma too small, or wrong structure, load, unit or frame"
"""End of the error message when too few readings remain."""


def without_outliers(
    vjm: Vjm,
    data: Dataset,
    regression: Regression,
    constraint: Constraint,
    prior_or_penalty: WeightedPrior | TracePenalty | None,
) -> Estimate:
    """Find outliers by Huber's loss, and solve least squares or GCO without them.

    Args:
        vjm: The arm's virtual joint model.
        data: The dataset.
        regression: The weighted equations of all its readings.
        constraint: "none" for least squares, "psd" for GCO, which needs symmetric blocks.
        prior_or_penalty: The prior, or the trace term of GCO without a prior.

    Returns:
        The estimate; F_M, its floor and the rank are those of the readings without outliers.

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
        rejected_readings=_rejected(data, readings, keep, plain.pi),
        rejected_runs=tuple(data.run_id[np.setdiff1d(readings.run_index, readings.run_index[keep])].tolist()),
    )


def robust_residuals(
    vjm: Vjm,
    readings: WeightedReadings,
    regression: Regression,
    constraint: Constraint,
    weighted_prior: WeightedPrior | None,
) -> tuple[Array, str]:
    """Compute residuals of a fit by Huber's loss, which is iteratively reweighted least squares.

    Without a prior, GCO uses nominal compliances with a relative uncertainty of `WEAK_PRIOR_UNCERTAINTY`.

    Mathematics: `est-16`.

    Args:
        vjm: The arm's virtual joint model.
        readings: The weighted equations, reading by reading.
        regression: The same equations, reduced to triangular factors.
        constraint: "none" for least squares, "psd" for GCO.
        weighted_prior: The prior; None for none.

    Returns:
        Length of every residual over its standard deviation, (readings,) [1], and the status of the last fit,
        "solved" if it is optimal.
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
            fit = solve_with_prior(constraint, weighted, weighted_prior)
            pi, status = weighted_prior.scaling.L @ fit.x, fit.status
        before, length = length, np.linalg.norm(readings.y - readings.A @ pi, axis=1)
        if np.abs(length - before).max() < CONVERGED_CHANGE:
            return length, status
    return length, status


def _accepted(structure: Structure, readings: WeightedReadings, keep: Mask, weight: Array) -> Regression:
    """Reduce the equations of some readings, each times its weight; a term without readings is left out."""
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
    """List the rejected readings, with their residuals at the parameters that were fitted without them."""
    length = np.linalg.norm(readings.y - readings.A @ pi, axis=1)
    names = (*data.markers, ORIENTATION_READING)
    return tuple(
        RejectedReading(
            run=int(data.run_id[readings.run_index[i]]),
            marker=names[readings.marker_index[i]],
            residual=float(length[i] * readings.standard_deviation[i]),
            residual_over_sigma=float(length[i]),
        )
        for i in np.flatnonzero(~keep)
    )
