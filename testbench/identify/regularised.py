"""Least squares and GCO with the same prior: the likelihood times a Gaussian around what was expected.

Both minimise chi^2 + |x - s e|^2 / u^2 in the metric of the prior, x the compliance in units of what was
expected, e its expectation, u the relative uncertainty; GCO keeps every block positive semi-definite. The
scale s common to all compliances is left to the data: a CAD model that is wrong by one factor costs nothing.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from testbench.errors import Array
from testbench.identify import cone
from testbench.identify.conic import EXACT, f_m_norms, optimum
from testbench.identify.estimate import Constraint, Estimate, make_estimate
from testbench.identify.least_squares import minimum_norm
from testbench.identify.metric import Belief, Metric, with_prior_rows
from testbench.identify.prior import Strength
from testbench.identify.regression import Regression, f_m

SLACK = 1e-2  #: Share by which F_M may exceed its optimum while the trace is made least.


def least_squares_with(regression: Regression, metric: Metric, strength: Strength) -> Estimate:
    """Weighted least squares with a prior; not conservative where the data pull it out of the cone."""
    M, r = with_prior_rows(regression, metric, strength)
    pi = metric.L @ np.linalg.lstsq(M, r, rcond=None)[0]
    belief = Belief(metric, strength)
    estimate = make_estimate(regression, pi, method="least squares with prior", advice=(words(belief),))
    return replace(estimate, status="solved", belief=belief)


def gco_with(regression: Regression, metric: Metric, strength: Strength) -> Estimate:
    """GCO with a prior: the conservative model of greatest posterior density, a conic program."""
    M, r = with_prior_rows(regression, metric, strength)
    n = metric.structure.n
    R: Array = np.asarray(np.linalg.qr(np.c_[M, r], mode="r"))
    unit = max(1.0, abs(R[n, n]))
    residual = np.c_[np.zeros(n + 1), R[:, :n] / unit]
    solution = cone.solve(
        cone.Problem(
            cost=np.r_[1.0, np.zeros(n)],
            blocks=(cone.free_block(0, 1), *cone.psd_blocks(1, metric.sizes)),
            rows=(cone.norm_below(0, residual, R[:, n] / unit),),
        )
    )
    return conic_estimate(regression, Belief(metric, strength), solution, solution.x[1:], "GCO with prior")


def gco_least_trace(regression: Regression, metric: Metric) -> Estimate:
    """GCO without a prior: of the models that fit as well as the best, the one of least trace of X.

    The prior's compliances are a metric here and nothing more: the trace counts every compliance in units of
    what was expected. As well means an F_M within `SLACK` of the optimum, which itself may only be approached
    as unseen compliance grows without end.
    """
    best = optimum(regression).f_m
    n, count = metric.structure.n, len(regression.terms)
    allowed = (1 + SLACK) * max(best, EXACT * f_m(regression, np.zeros(n)))
    total = cone.Rows("nonnegative", np.r_[np.ones(count), np.zeros(n)][None], np.array([1.0]))
    norms = f_m_norms(regression.terms, [term.R @ metric.L / allowed for term in regression.terms], allowed)
    solution = cone.solve(
        cone.Problem(
            cost=np.r_[np.zeros(count), metric.expected],
            blocks=(cone.free_block(0, count), *cone.psd_blocks(count, metric.sizes)),
            rows=(total, *norms),
        )
    )
    estimate = make_estimate(
        regression,
        metric.L @ metric.project(solution.x[count:]),
        method="GCO, least trace in the metric",
        constraint="psd",
        advice=(
            f"free directions: least trace in the metric of {metric.prior}, F_M within {100 * SLACK:g} %",
        ),
    )
    return replace(estimate, status=solution.status, solver_seconds=solution.seconds)


def conic_estimate(
    regression: Regression, belief: Belief, solution: cone.Solution, x: Array, method: str
) -> Estimate:
    """The conservative estimate of x, the solver's last digits outside the cone cut off."""
    pi = belief.metric.L @ belief.metric.project(x)
    estimate = make_estimate(regression, pi, method=method, constraint="psd", advice=(words(belief),))
    return replace(estimate, belief=belief, status=solution.status, solver_seconds=solution.seconds)


def words(belief: Belief) -> str:
    """Which prior filled what the data cannot see."""
    strength = belief.strength
    scale = (
        "its scale left to the data"
        if np.isinf(strength.scale_uncertainty)
        else f"its scale known to {100 * strength.scale_uncertainty:g} %"
    )
    return f"prior: {belief.metric.prior}, uncertainty {100 * strength.uncertainty:.3g} %, {scale}"


WITH_PRIOR: dict[Constraint, Callable[[Regression, Metric, Strength], Estimate]] = {
    "none": least_squares_with,
    "psd": gco_with,
}


def fit_reduced(regression: Regression, constraint: Constraint, belief: Belief | None = None) -> Estimate:
    """Least squares or GCO of a reduced dataset; GCO refuses by BenchError what is not symmetric."""
    if belief is None:
        return optimum(regression) if constraint == "psd" else minimum_norm(regression)
    return WITH_PRIOR[constraint](regression, belief.metric, belief.strength)
