"""Solve least squares or GCO on a reduced dataset, with a prior or without.

With a prior both minimise chi^2 + |x - s e|^2 / u^2 in the metric of the prior. There x is the compliance in
units of its expectation, e that expectation and u the relative uncertainty; GCO keeps every block positive
semi-definite. The data determine the common scale s: a CAD model that is wrong by one factor costs nothing.
Every method (`Method`) ends here.
"""

import time
from dataclasses import dataclass, replace

import numpy as np

from testbench.errors import Array
from testbench.identify import cone
from testbench.identify.conic import solve_gco
from testbench.identify.estimate import Constraint, Estimate, Penalty, make_estimate
from testbench.identify.interior import least_squares
from testbench.identify.least_squares import complete_conservatively, minimum_norm
from testbench.identify.metric import Case, WeightedPrior, with_prior_rows
from testbench.identify.regression import Regression

OPTIMALITY_TOLERANCE = 1e-8
"""Proven distance from the least value of (chi^2 + penalty) / 2 up to which an answer counts as optimal [1].

Then it lies within sqrt(2 OPTIMALITY_TOLERANCE) = 1.4e-4 standard deviations of the optimum in every
direction.
"""
ROUNDING_SHARE = 1e-12
"""Further allowance as a share of the cost [1]: rounding of large misfits in float64."""
METHODS: dict[Constraint, str] = {"none": "least squares with prior", "psd": "GCO with prior"}


def solve(
    regression: Regression, constraint: Constraint, belief: WeightedPrior | Penalty | None = None
) -> Estimate:
    """Solve least squares or GCO on weighted equations, with a prior or without.

    Mathematics: `prior-4`.

    Args:
        regression: The reduced dataset: F_M of n parameters, as triangular factors.
        constraint: "none" for least squares, "psd" for GCO, "free" for least squares made conservative along
            its unobservable directions, which takes no prior.
        belief: The prior with its strength, or the trace term of GCO without a prior; None for neither, as in
            the paper.

    Returns:
        The estimate; its status says whether it is proven to be the optimum.

    Raises:
        BenchError: When GCO gets a structure that is not symmetric.
    """
    if not isinstance(belief, WeightedPrior):
        if constraint == "psd":
            return solve_gco(regression, belief)
        return (complete_conservatively if constraint == "free" else minimum_norm)(regression)
    # With a prior: minimise chi^2 and penalty in the metric of the prior, then map x back to pi.
    prior_solution = solve_with_prior(constraint, Case(regression, belief))
    estimate = make_estimate(regression, prior_solution.pi, method=METHODS[constraint], constraint=constraint)
    return replace(
        estimate, weighted_prior=belief, status=prior_solution.status, solver_seconds=prior_solution.seconds
    )


@dataclass(frozen=True)
class PriorSolution:
    """Hold the parameters that a solver found, and how it ended."""

    pi: Array  #: Parameters, (n,) [m/N, rad/(N m), rad/N].
    seconds: float  #: Time inside the solver [s].
    status: str  #: "solved", or what went wrong.
    #: Whether Newton's method or our interior-point method found it; else LAPACK or Clarabel.
    by_our_solver: bool


def solve_with_prior(constraint: Constraint, case: Case) -> PriorSolution:
    """Minimise |A pi - y|^2 + |B x - c|^2, pi = L x, in the metric of a prior.

    Args:
        constraint: "none" for least squares, "psd" for GCO.
        case: The weighted equations (A, y) and the prior (B, c).

    Returns:
        The answer of Newton's or our interior-point method if it is proven optimal; else that of
        `solve_by_reference`.
    """
    start, metric = time.perf_counter(), case.belief.scaling
    M, r = with_prior_rows(case.regression, metric, case.belief.strength)
    x = certified_solution(M, r, metric.sizes if constraint == "psd" else ())
    if x is None:
        return solve_by_reference(constraint, case)
    return PriorSolution(metric.L @ x, time.perf_counter() - start, "solved", by_our_solver=True)


def certified_solution(M: Array, r: Array, sizes: tuple[int, ...]) -> Array | None:
    """Minimise |M x - r| over x by Newton's method, and return the optimum only with its proof.

    Args:
        M: Rows of data and prior in standard deviations, (rows, n) [1].
        r: Their right-hand side, (rows,) [1].
        sizes: Orders of the blocks of which x is the svec, all positive semi-definite; () for no constraint.

    Returns:
        x, (n,) [1]; None where the duality gap exceeds `OPTIMALITY_TOLERANCE`.
    """
    x, gap = least_squares(M, r, sizes)
    cost = float(np.sum((M @ x - r) ** 2)) / 2
    return x if gap <= OPTIMALITY_TOLERANCE + ROUNDING_SHARE * cost else None


def solve_by_reference(constraint: Constraint, case: Case) -> PriorSolution:
    """Solve the same problem by an independent solver: LAPACK for least squares, Clarabel for GCO.

    Args:
        constraint: "none" for least squares, "psd" for GCO.
        case: The weighted equations and the prior.

    Returns:
        The answer, its status as the solver reports it.
    """
    start, metric = time.perf_counter(), case.belief.scaling
    M, r = with_prior_rows(case.regression, metric, case.belief.strength)
    if constraint == "none":
        pi = metric.L @ np.linalg.lstsq(M, r, rcond=None)[0]
        return PriorSolution(pi, time.perf_counter() - start, "solved", by_our_solver=False)
    solution = solve_by_clarabel(M, r, metric.sizes)
    return PriorSolution(
        metric.L @ metric.project(solution.x[1:]), solution.seconds, solution.status, by_our_solver=False
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
            rows=(cone.norm_below(0, residual, R[:, n] / unit),),
        )
    )
