"""Least squares and GCO with the same prior: the likelihood times a Gaussian around what was expected.

Both minimise chi^2 + |x - s e|^2 / u^2 in the metric of the prior, x the compliance in units of what was
expected, e its expectation, u the relative uncertainty; GCO keeps every block positive semi-definite. The
scale s common to all compliances is left to the data: a CAD model that is wrong by one factor costs nothing.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.errors import Array, BenchError
from testbench.identify import cone
from testbench.identify.conic import optimum_each
from testbench.identify.estimate import Constraint, Estimate, make_estimate
from testbench.identify.least_squares import completed, minimum_norm
from testbench.identify.metric import Belief, Case, Metric, with_prior_rows
from testbench.identify.prior import Strength
from testbench.identify.projected import least_squares
from testbench.identify.regression import Regression

NEAR = 1e-8
"""Distance from the least half of chi squared and penalty within which an answer is proven to be: then it is
within 1.5e-4 standard deviations of the optimum in every direction."""
DIGITS = 1e-12  #: The same as a share of the cost: what rounding leaves of a misfit.


def least_squares_with(regression: Regression, metric: Metric, strength: Strength) -> Estimate:
    """Weighted least squares with a prior; not conservative where the data pull it out of the cone."""
    return _with("none", [Case(regression, Belief(metric, strength))])[0]


def gco_with(regression: Regression, metric: Metric, strength: Strength) -> Estimate:
    """GCO with a prior: the conservative model of greatest posterior density."""
    return _with("psd", [Case(regression, Belief(metric, strength))])[0]


def _with(constraint: Constraint, cases: Sequence[Case]) -> list[Estimate]:
    found = []
    for case in cases:
        own = answer(constraint, case)
        estimate = make_estimate(
            case.regression,
            own.pi,
            method=METHODS[constraint],
            constraint=constraint,
            advice=(words(case.belief),),
        )
        known = replace(estimate, belief=case.belief, status=own.status, solver_seconds=own.seconds)
        found.append(known)
    return found


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
    x, gap = least_squares(M, r, metric.sizes if constraint == "psd" else ())
    cost = float(np.sum((M @ x - r) ** 2)) / 2
    if not gap <= NEAR + DIGITS * cost:
        return REFEREES[constraint](case)
    return Answer(metric.L @ x, time.perf_counter() - start, "solved", own=True)


def _by_lapack(case: Case) -> Answer:
    start = time.perf_counter()
    M, r = with_prior_rows(case.regression, case.belief.metric, case.belief.strength)
    pi = case.belief.metric.L @ np.linalg.lstsq(M, r, rcond=None)[0]
    return Answer(pi, time.perf_counter() - start, "solved", own=False)


def _by_clarabel(case: Case) -> Answer:
    metric = case.belief.metric
    M, r = with_prior_rows(case.regression, metric, case.belief.strength)
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
    return Answer(metric.L @ metric.project(solution.x[1:]), solution.seconds, solution.status, own=False)


REFEREES: dict[Constraint, Callable[[Case], Answer]] = {"none": _by_lapack, "psd": _by_clarabel}
METHODS: dict[Constraint, str] = {"none": "least squares with prior", "psd": "GCO with prior"}


def words(belief: Belief) -> str:
    """Which prior filled what the data cannot see."""
    strength, name = belief.strength, belief.metric.prior
    if strength.coupling is not None:
        shape, coupling = (100 * belief.misfit * u for u in (strength.uncertainty, strength.coupling))
        learnt = f"shapes known to {shape:.2g} %, couplings to {coupling:.2g} %"
        return f"prior: {name}, the scale of every block learnt from the readings, {learnt}"
    scale = (
        "its scale left to the data"
        if np.isinf(strength.scale_uncertainty)
        else f"its scale known to {100 * strength.scale_uncertainty:g} %"
    )
    return f"prior: {name}, uncertainty {100 * strength.uncertainty:.3g} %, {scale}"


def fit_reduced(regression: Regression, constraint: Constraint, belief: Belief | None = None) -> Estimate:
    """Least squares or GCO of a reduced dataset; GCO refuses by BenchError what is not symmetric."""
    return fit_each([regression], constraint, [belief])[0]


def fit_each(
    regressions: Sequence[Regression], constraint: Constraint, beliefs: Sequence[Belief | None]
) -> list[Estimate]:
    """The same of many datasets of one structure, each with a belief of its own, or all without."""
    cases = [Case(r, own) for r, own in zip(regressions, beliefs, strict=True) if own is not None]
    if cases and len(cases) < len(regressions):
        raise BenchError("prior: expected one for every dataset or none at all")
    if cases:
        return _with(constraint, cases)
    if constraint == "psd":
        return optimum_each(regressions)
    return [completed(r) if constraint == "free" else minimum_norm(r) for r in regressions]
