"""Estimators and intervals beside ours: fillings of what data do not see, ridge, clipping, and the bootstrap.

What data do not see is filled in the metric of a prior by least trace or a log determinant. That prior is
Stein's divergence from what was expected: D(X, s) = tr(X) / s - log det(X / s) - n is zero at X = s and grows
without bound as X becomes singular: every compliance stays positive definite. Near X = s it is
|X / s - 1|^2 / 2, so that D / u^2 is the Gaussian penalty of relative uncertainty u there. The log
determinant is the barrier of interior points, which minimise chi^2 / 2 + D / u^2.

Ridge regression and clipping hold least squares down without a cone.

The parametric bootstrap refits new readings from the fitted model.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError
from testbench.identify import cone
from testbench.identify.cone import nearest_psd
from testbench.identify.conic import (
    EXACT_FIT_SHARE,
    norm_constraints,
    scaled_gco_program,
    solve_gco,
    solve_gco_by_clarabel,
)
from testbench.identify.estimate import Estimate, make_estimate, sensitivity_units
from testbench.identify.interior import BlockProgram, solve_program
from testbench.identify.method import least_squares
from testbench.identify.posterior import Intervals, posterior_of_estimate
from testbench.identify.prior import (
    PriorScaling,
    PriorUncertainty,
    WeightedPrior,
    rows_in_prior_units,
)
from testbench.identify.regression import (
    RANK_TOLERANCE,
    Regression,
    ResidualTerm,
    f_m,
    reduce,
    reduce_by_group,
)
from testbench.identify.solve import minimum_norm, solve_with_prior
from testbench.identify.trace import Fold, cross_validation_groups, folds
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

# --- Estimators beside ours ---------------------------------------------------------------------------------

UNCERTAINTIES = (0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.3, 2.0)
"""Relative uncertainties of a prior that cross-validation tries [1]."""
LEFT = 1e-10  #: Distance from the optimum up to which it is solved, over the cost of no model.
SLACK = 1e-2  #: Share by which F_M may exceed its optimum while the trace is made least.


def gco_stein(regression: Regression, scaling: PriorScaling, uncertainty: PriorUncertainty) -> Estimate:
    """Identify by GCO with the log-determinant prior; the common scale is that of the Gaussian fit.

    Args:
        regression: The reduced dataset.
        scaling: Units of the prior.
        uncertainty: Uncertainty of the prior.

    Returns:
        The estimate.
    """
    weighted_prior = WeightedPrior(scaling, uncertainty)
    pi, left = _minimum(regression, weighted_prior)
    estimate = make_estimate(regression, pi, method="GCO with log-det prior", constraint="psd")
    status = "solved" if left <= LEFT else f"not solved: {left:.1g}"
    return replace(estimate, weighted_prior=weighted_prior, status=status)


def stein_parameters(regression: Regression, weighted_prior: WeightedPrior) -> Array:
    """Compute the parameters that `gco_stein` finds.

    Args:
        regression: The reduced dataset.
        weighted_prior: The prior with its uncertainty.

    Returns:
        Parameters, (n,) [m/N, rad/(N m), rad/N].
    """
    return _minimum(regression, weighted_prior)[0]


def _minimum(regression: Regression, weighted_prior: WeightedPrior) -> tuple[Array, float]:
    """Parameters, (n,), and how far they are from the optimum, over the cost of no model."""
    scaling, n = weighted_prior.scaling, regression.structure.n_parameters
    e, (A, y) = scaling.expected_x, rows_in_prior_units(regression, scaling)
    gaussian = solve_with_prior("psd", regression, weighted_prior).x
    scale = max(1e-6, float(gaussian @ e / (e @ e)))
    # X in units of the scale, the cost in those of what the readings span
    T: Array = np.asarray(np.linalg.qr(np.c_[scale * A, y], mode="r"))[:n]
    size = float(T[:, n] @ T[:, n])
    R, z = T[None, :, :n] / math.sqrt(size), T[None, :, n] / math.sqrt(size)
    weight = 1 / (size * weighted_prior.uncertainty.relative**2)
    program = BlockProgram(
        R, z, np.zeros(1), weight * e, scaling.block_orders, sum_of_squares=True, barrier_weight=weight
    )
    iterate = solve_program(program)
    return np.asarray(scale * scaling.L @ iterate.x), iterate.distance_from_optimum(program)


def gco_least_trace(regression: Regression, scaling: PriorScaling) -> Estimate:
    """Identify by GCO without a prior: of models that fit as well as the best the one of least trace.

    The prior's compliances are a metric here and nothing more: the trace counts every compliance in units of
    what was expected. As well means an F_M within `SLACK` of the optimum, which itself may only be approached
    as unseen compliance grows without end.

    Args:
        regression: The reduced dataset.
        scaling: Units of the prior.

    Returns:
        The estimate.
    """
    best = solve_gco(regression).f_m
    n, count = scaling.structure.n_parameters, len(regression.terms)
    allowed = (1 + SLACK) * max(best, EXACT_FIT_SHARE * f_m(regression, np.zeros(n)))
    total = cone.ConeConstraint("nonnegative", np.r_[np.ones(count), np.zeros(n)][None], np.array([1.0]))
    parts = [(term.R @ scaling.L, term.z, math.sqrt(term.unexplained)) for term in regression.terms]
    norms = norm_constraints(*(np.array(part) / allowed for part in zip(*parts, strict=True)))
    solution = cone.solve(
        cone.ConeProgram(
            cost=np.r_[np.zeros(count), scaling.expected_x],
            constraints=(
                total,
                *norms,
                *cone.psd_constraints(scaling.block_orders, np.eye(n, count + n, count)),
            ),
        )
    )
    estimate = make_estimate(
        regression,
        scaling.L @ cone.clip_negative_eigenvalues(solution.unknowns[count:], scaling.block_orders),
        method="GCO, least trace in the metric",
        constraint="psd",
        advice=(
            f"free directions: least trace in the metric of {scaling.prior_name}, "
            f"F_M within {100 * SLACK:g} %",
        ),
    )
    return replace(estimate, status=solution.status, solver_seconds=solution.seconds)


def every_fold(vjm: Vjm, structure: Structure, data: Dataset) -> list[Fold]:
    """Make the folds of the runs with a reading.

    Args:
        vjm: Kinematics of the arm.
        structure: The unknowns.
        data: Measured runs.

    Returns:
        The folds.
    """
    [parts] = reduce_by_group(vjm, [structure], data, cross_validation_groups(data))
    return folds(parts)


def choose_strength(
    held: Sequence[Fold], scaling: PriorScaling, fit: Callable[[Regression, WeightedPrior], Array]
) -> PriorUncertainty:
    """Choose the uncertainty of a prior that predicts held-out poses best.

    Args:
        held: The folds.
        scaling: Units of the prior.
        fit: Function of a reduced dataset and its prior to the parameters, (n,).

    Returns:
        The strength, its scale left to the data.
    """

    def error(uncertainty: PriorUncertainty) -> float:
        weighted_prior = WeightedPrior(scaling, uncertainty)
        return float(
            np.mean(
                [f_m(fold.held_out_regression, fit(fold.fitted_regression, weighted_prior)) for fold in held]
            )
        )

    return min(map(PriorUncertainty, UNCERTAINTIES), key=error)


UNSEEN = 1e-9  #: Length of a column over the longest one below which no reading sees it.
RIDGES = np.geomspace(1e-9, 1, 60)  #: Tried, over the largest eigenvalue.


def ridge(vjm: Vjm, structure: Structure, data: Dataset) -> Estimate:
    """Identify by ridge regression in columns of length one, its size by generalised cross-validation.

    Golub, Heath, Wahba 1979, "Generalized cross-validation as a method for choosing a good ridge parameter".

    Args:
        vjm: Kinematics of the arm.
        structure: The unknowns.
        data: Measured runs.

    Returns:
        The estimate.
    """
    regression = reduce(vjm, structure, data)
    A, y = regression.weighted_equations
    scale = np.linalg.norm(A, axis=0)
    scale[scale < UNSEEN * scale.max()] = np.inf  # what no reading sees is zero
    U, s, Vt = np.linalg.svd(A / scale, full_matrices=False)
    z = U.T @ y
    rest = y @ y - z @ z + sum(term.n_equations / 3 * term.unexplained for term in regression.terms)

    def score(size: float) -> float:
        left = size / (s**2 + size)
        return float(((left * z) @ (left * z) + rest) / (regression.n_equations - (1 - left).sum()) ** 2)

    size = min(RIDGES * s[0] ** 2, key=score)
    pi = Vt.T @ (s / (s**2 + size) * z) / scale
    return replace(make_estimate(regression, pi, method="ridge", constraint="ridge"), status="solved")


def clipped(vjm: Vjm, structure: Structure, data: Dataset) -> Estimate:
    """Identify by least squares, negative eigenvalues of every block set to zero afterwards.

    Args:
        vjm: Kinematics of the arm.
        structure: The unknowns.
        data: Measured runs.

    Returns:
        The estimate.
    """
    plain = least_squares(vjm, structure, data)
    C = plain.C_theta.copy()
    for block in structure.blocks:
        C[np.ix_(block, block)] = nearest_psd(C[np.ix_(block, block)])
    pi, regression = structure.parameters_of(C), plain.regression
    return replace(
        make_estimate(regression, pi, method="clipped least squares", constraint="clipped"), status="solved"
    )


# --- Intervals beside ours: the bootstrap ------------------------------------------------------------------


def bootstrap(
    estimate: Estimate, functionals: Array, confidence: float, *, draws: int, rng: np.random.Generator
) -> Intervals:
    """Compute basic bootstrap intervals of functionals a . pi: errors of refits, turned round.

    A refit errs about the fit as the fit errs about the truth, so the truth lies at the prediction LESS such
    an error. Where the cone binds it pushes both errors the same way, and the basic interval takes the push
    back; a percentile interval would add it a second time. Order statistics k and draws + 1 - k with k =
    (draws + 1) (1 - confidence) / 2 make it exact for least squares; 39 draws are the least for 95 %. Where a
    functional is not seen the refits fill it as the fit, made without a prior, did, which proves nothing: the
    interval is infinite.

    Args:
        estimate: The estimate.
        functionals: Deflections asked for, (k, n).
        confidence: Probability of the interval [1].
        draws: Number of refits.
        rng: Source of randomness.

    Returns:
        The intervals.

    Raises:
        BenchError: When there are too few draws for the confidence.
    """
    tail = (1 - confidence) / 2
    k = int((draws + 1) * tail * (1 + 1e-12))
    if k < 1:
        least = math.ceil(1 / tail - 1e-9) - 1
        raise BenchError(f"draws: expected at least {least} for {100 * confidence:g} %, got {draws}")
    centre, linear = functionals @ estimate.pi, posterior_of_estimate(estimate)
    again = resampler(estimate.regression)
    refits = _refits([again(estimate.pi, rng) for _ in range(draws)], estimate)
    errors = refits @ functionals.T - centre
    errors.sort(axis=0)
    unseen = np.where(np.isinf(linear.standard_deviations(functionals)), np.inf, 0.0)
    lower, upper = centre - errors[-k] - unseen, centre - errors[k - 1] + unseen
    return Intervals(centre, lower, upper, confidence, linear.on_cone_boundary)


def _refits(regressions: Sequence[Regression], estimate: Estimate) -> Array:
    """Parameters, (datasets, n), of datasets that differ from an estimate's in their readings alone."""
    if estimate.penalty is not None:
        penalty = estimate.penalty
        split_regressions = [penalty.in_split_parameters(regression) for regression in regressions]
        return np.array(
            [
                penalty.pi_per_split_parameter @ solve_gco_by_clarabel(r, scaled_gco_program(r, penalty)).pi
                for r in split_regressions
            ]
        )
    return np.array([minimum_norm(r).pi for r in regressions])


def resampler(regression: Regression) -> Callable[[Array, np.random.Generator], Regression]:
    """Draw reduced datasets, at parameters, (n,), in the same poses under the same loads.

    The rows are divided by sqrt(2) sigma sqrt(N): each orthonormal coordinate in the range of R has noise of
    deviation 1 / sqrt(N), and the rest is chi squared of all other equations over N.
    """
    unit = sensitivity_units(regression)
    spans = [_range(term.R * unit) for term in regression.terms]

    def draw(pi: Array, rng: np.random.Generator) -> Regression:
        terms = [_new_readings(term, pi, U, rng) for term, U in zip(regression.terms, spans, strict=True)]
        return replace(regression, terms=tuple(terms))

    return draw


def _new_readings(term: ResidualTerm, pi: Array, U: Array, rng: np.random.Generator) -> ResidualTerm:
    N, spare = term.n_equations / 3, term.n_equations - U.shape[1]
    z = term.R @ pi + U @ rng.standard_normal(U.shape[1]) / math.sqrt(N)
    return replace(term, z=z, unexplained=float(rng.chisquare(spare)) / N if spare else 0.0)


def _range(R: Array) -> Array:
    """Orthonormal basis of the columns, (n, r)."""
    U, s, _ = np.linalg.svd(R)
    return np.asarray(U[:, : int((s > RANK_TOLERANCE * s[0]).sum())])
