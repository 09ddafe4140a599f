"""The one solve: least squares or GCO of a reduced dataset, with a prior or without.

With a prior both minimise chi^2 + |x - s e|^2 / u^2 in its metric, x the compliance in units of what was
expected, e its expectation, u the relative uncertainty; GCO keeps every block positive semi-definite. The
scale s common to all compliances is left to the data: a CAD model that is wrong by one factor costs nothing.
"""

import time
from dataclasses import dataclass, replace

import numpy as np

from testbench.errors import Array
from testbench.identify import cone
from testbench.identify.conic import optimum
from testbench.identify.estimate import Constraint, Estimate, Penalty, make_estimate
from testbench.identify.interior import least_squares
from testbench.identify.least_squares import completed, minimum_norm
from testbench.identify.metric import Belief, Case, with_prior_rows
from testbench.identify.regression import Regression

NEAR = 1e-8
"""Distance from the least half of chi squared and penalty within which an answer is proven to be: then it is
within 1.5e-4 standard deviations of the optimum in every direction."""
DIGITS = 1e-12  #: The same as a share of the cost: what rounding leaves of a misfit.
METHODS: dict[Constraint, str] = {"none": "least squares with prior", "psd": "GCO with prior"}


def solve(regression: Regression, constraint: Constraint, belief: Belief | Penalty | None = None) -> Estimate:
    """Least squares or GCO, with a prior or without.

    Args:
        regression: The reduced dataset.
        constraint: "none" for least squares, "psd" for GCO, "free" for least squares whose free directions
            make it conservative, which takes no prior.
        belief: The prior, and how firmly it is believed; or the trace term of GCO without a prior; None for
            neither, as in the paper.

    Returns:
        The estimate; its status says whether it is proven to be the optimum.

    Raises:
        BenchError: When GCO gets a structure that is not symmetric.
    """
    if not isinstance(belief, Belief):
        if constraint == "psd":
            return optimum(regression, belief)
        return (completed if constraint == "free" else minimum_norm)(regression)
    own = answer(constraint, Case(regression, belief))
    estimate = make_estimate(regression, own.pi, method=METHODS[constraint], constraint=constraint)
    return replace(estimate, belief=belief, status=own.status, solver_seconds=own.seconds)


@dataclass(frozen=True)
class Answer:
    """What a solver found."""

    pi: Array  #: Parameters, (n,).
    seconds: float  #: Time inside the solver.
    status: str  #: "solved", or what went wrong.
    own: bool  #: Whether our own method found it.


def answer(constraint: Constraint, case: Case) -> Answer:
    """Newton's answer with a prior; an independent solver's where it is not proven."""
    start, metric = time.perf_counter(), case.belief.metric
    M, r = with_prior_rows(case.regression, metric, case.belief.strength)
    x = proven(M, r, metric.sizes if constraint == "psd" else ())
    if x is None:
        return referee(constraint, case)
    return Answer(metric.L @ x, time.perf_counter() - start, "solved", own=True)


def proven(M: Array, r: Array, sizes: tuple[int, ...]) -> Array | None:
    """Newton's least |M x - r| over x, svec of positive semi-definite blocks of some sizes, (n,).

    None where it is not proven to be the optimum.
    """
    x, gap = least_squares(M, r, sizes)
    cost = float(np.sum((M @ x - r) ** 2)) / 2
    return x if gap <= NEAR + DIGITS * cost else None


def referee(constraint: Constraint, case: Case) -> Answer:
    """The answer of LAPACK to least squares with a prior, of Clarabel to GCO with one."""
    start, metric = time.perf_counter(), case.belief.metric
    M, r = with_prior_rows(case.regression, metric, case.belief.strength)
    if constraint == "none":
        pi = metric.L @ np.linalg.lstsq(M, r, rcond=None)[0]
        return Answer(pi, time.perf_counter() - start, "solved", own=False)
    solution = by_clarabel(M, r, metric.sizes)
    return Answer(metric.L @ metric.project(solution.x[1:]), solution.seconds, solution.status, own=False)


def by_clarabel(M: Array, r: Array, sizes: tuple[int, ...]) -> cone.Solution:
    """The least t with |M x - r| below it, over t, then x as of `proven`."""
    n = M.shape[1]
    R: Array = np.asarray(np.linalg.qr(np.c_[M, r], mode="r"))
    unit = max(1.0, abs(R[-1, n]))
    residual = np.c_[np.zeros(len(R)), R[:, :n] / unit]
    return cone.solve(
        cone.Problem(
            cost=np.r_[1.0, np.zeros(n)],
            blocks=(cone.free_block(0, 1), *cone.psd_blocks(1, sizes)),
            rows=(cone.norm_below(0, residual, R[:, n] / unit),),
        )
    )
