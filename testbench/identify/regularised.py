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
from testbench.identify.blocks import blocks_of
from testbench.identify.completion import completed
from testbench.identify.conic import EXACT, f_m_norms, optima, optimum, optimum_each
from testbench.identify.dense import least_squares, shares
from testbench.identify.estimate import Constraint, Estimate, make_estimate
from testbench.identify.least_squares import minimum_norm, solve, solve_all
from testbench.identify.metric import Belief, Case, Metric, precision_root, whitened, with_prior_rows
from testbench.identify.objective import Objective
from testbench.identify.prior import Strength
from testbench.identify.regression import Regression, f_m

NEAR = 1e-8
"""Distance from the least half of chi squared and penalty within which an answer is proven to be: then it is
within 1.5e-4 standard deviations of the optimum in every direction."""
DIGITS = 1e-12  #: The same as a share of the cost: what rounding leaves of a misfit.
SLACK = 1e-2  #: Share by which F_M may exceed its optimum while the trace is made least.


def least_squares_with(regression: Regression, metric: Metric, strength: Strength) -> Estimate:
    """Weighted least squares with a prior; not conservative where the data pull it out of the cone."""
    return _with("none", [Case(regression, Belief(metric, strength))])[0]


def gco_with(regression: Regression, metric: Metric, strength: Strength) -> Estimate:
    """GCO with a prior: the conservative model of greatest posterior density."""
    return _with("psd", [Case(regression, Belief(metric, strength))])[0]


def _with(constraint: Constraint, cases: Sequence[Case]) -> list[Estimate]:
    found = []
    for case, answer in zip(cases, answers(constraint, cases), strict=True):
        estimate = make_estimate(
            case.regression,
            answer.pi,
            method=METHODS[constraint],
            constraint=constraint,
            advice=(words(case.belief),),
        )
        known = replace(estimate, belief=case.belief, status=answer.status, solver_seconds=answer.seconds)
        found.append(known)
    return found


@dataclass(frozen=True)
class Answer:
    """What a solver found."""

    pi: Array  #: Parameters, (n,).
    seconds: float  #: Time inside the solver.
    status: str  #: "solved", or what went wrong.
    own: bool  #: Whether our own method found it.


def parameters(constraint: Constraint, cases: Sequence[Case]) -> Array:
    """Parameters of many datasets of one structure with priors, all at once, (cases, n)."""
    return np.array([answer.pi for answer in answers(constraint, cases)])


def answers(constraint: Constraint, cases: Sequence[Case]) -> list[Answer]:
    """What `parameters` come from, those of one structure and number of terms together."""
    found: dict[int, Answer] = {}
    shapes = [
        (c.regression.structure.n, (id(c.regression.structure), len(c.regression.terms))) for c in cases
    ]
    for share in shares(shapes):
        found |= zip(share, _dense(constraint, [cases[k] for k in share]), strict=True)
    return [found[k] for k in range(len(cases))]


def _dense(constraint: Constraint, cases: Sequence[Case]) -> list[Answer]:
    """By our own method; by an independent solver where its answer is not proven."""
    start = time.perf_counter()
    objective = _objective(cases)
    blocks = blocks_of(cases[0].belief.metric.sizes) if constraint == "psd" else None
    found = least_squares(objective, blocks)
    good = np.isfinite(found.gap) & (found.gap <= NEAR + DIGITS * objective.value(found.x))
    seconds = (time.perf_counter() - start) / len(cases)
    return [
        Answer(case.belief.metric.L @ x, seconds, "solved", own=True)
        if proven
        else REFEREES[constraint](case)
        for case, x, proven in zip(cases, found.x, good, strict=True)
    ]


def _objective(cases: Sequence[Case]) -> Objective:
    """Squared residuals of data and prior; a dataset is squared once, however many strengths there are."""
    data: dict[tuple[int, int], tuple[Array, Array, Array]] = {}
    R, z, H = [], [], []
    for case in cases:
        key = id(case.regression), id(case.belief.metric)
        if key not in data:
            A, y = whitened(case.regression, case.belief.metric)
            data[key] = A, y, A.T @ A
        A, y, AA = data[key]
        B, c = precision_root(case.belief.metric, case.belief.strength)
        R.append(np.concatenate([A, B]))
        z.append(np.concatenate([y, c]))
        H.append(AA + B.T @ B)
    rows, n = R[0].shape
    zero = np.zeros((len(R), n))
    return Objective(
        np.array(R), np.array(z), zero[:, :1], zero, np.array(H)[:, None], (slice(0, rows),), squared=True
    )


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


def fit_all(regressions: Sequence[Regression], constraint: Constraint, belief: Belief | None = None) -> Array:
    """The parameters that `fit_reduced` finds, of many datasets of one structure, (datasets, n)."""
    if belief is not None:
        return parameters(constraint, [Case(regression, belief) for regression in regressions])
    if constraint == "psd":
        return optima(regressions)
    if constraint == "free":
        return np.array([completed(r).pi for r in regressions])
    rows = {tuple(id(term.R) for term in r.terms) for r in regressions}
    return solve_all(regressions) if len(rows) == 1 else np.array([solve(r) for r in regressions])
