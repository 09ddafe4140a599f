"""GCO of random and nasty datasets against Clarabel as the referee: who comes lower, and what is proven."""

from dataclasses import dataclass

import numpy as np
from measure import Row, at_most, note
from programs import NASTY, random_regression, with_random_prior

from testbench.identify.certify import bound, gradient_dual
from testbench.identify.conic import answers, by_clarabel, scale_program
from testbench.identify.metric import Case, with_prior_rows
from testbench.identify.regression import Regression
from testbench.identify.regularised import REFEREES
from testbench.identify.regularised import answer as with_prior

RANDOM, NASTY_ONES = 10_000, 1_000
SEED = 20_000
WORSE = 1e-8  #: Cost over the referee's, relative to that of no model, beyond which an answer is wrong.
OFF = 1e-4  #: Standard deviations that least squares with a prior may be off.
ROUNDING = 1e-8  #: Gap that is proven of every answer of our own, by another certificate than its own.
APART = 1e-2  #: Standard deviations that an answer with a prior may be off.


@dataclass(frozen=True)
class Compared:
    """One dataset."""

    own: bool  #: Whether our own method answered; the referee did otherwise.
    over: float  #: Cost over the referee's, relative to that of no model [1].
    #: Proven gap, relative to the cost of no model; with a prior the distance from the better of both
    #: answers, in standard deviations [1].
    gap: float


def agreement_with_the_referee() -> list[Row]:
    """Rows for random and nasty datasets, without a prior and with."""
    kinds = {"random": ["kind"] * RANDOM, "nasty": [NASTY[k % len(NASTY)] for k in range(NASTY_ONES)]}
    rows = []
    for name, each in kinds.items():
        rng = np.random.default_rng(SEED)
        found, firm, least = [], [], []
        for kind in each:
            regression = random_regression(kind, rng)
            found.append(compared(regression))
            case = with_random_prior(regression, 10 ** rng.uniform(-6, 3), rng)
            firm.append(compared_with_prior(case))
            least.append(least_squares_off(case))
        rows += rows_of(f"{len(each)} {name} datasets", found, "proven gap", ROUNDING)
        rows += rows_of(f"{len(each)} {name} datasets with a prior", firm, "standard deviations off", APART)
        title = f"(h) {len(each)} {name} datasets with a prior: least squares off"
        rows.append(
            at_most(title, max(least), "", OFF, "standard deviations, against an orthogonal factorisation")
        )
    return rows


def rows_of(name: str, found: list[Compared], proof: str, enough: float) -> list[Row]:
    """Worst cost, worst proof, and how often the referee had to answer."""
    own = [one for one in found if one.own]
    over, gap = [one.over for one in own] or [0.0], max([one.gap for one in own] or [0.0])
    referee = 100 * (1 - len(own) / len(found))
    below = f"below it by up to {-min(over):.1e}"
    return [
        at_most(f"(h) {name}: cost over the referee's", max(over), "", WORSE, below),
        at_most(f"(h) {name}: {proof}", gap, "", enough, f"of {len(own)} datasets"),
        note(f"    {name}: answered by the referee", referee, "%", ""),
    ]


def compared(regression: Regression) -> Compared:
    """GCO without a prior; both answers are judged by one certificate."""
    program = scale_program(regression)
    [answer] = answers([regression], [program])
    referee = by_clarabel(regression, program)
    assert referee.dual is not None
    own = answer.dual or gradient_dual(regression, answer.pi)
    proof = bound(regression, referee.pi, referee.dual)
    gap = bound(regression, answer.pi, own, proof.trace_bounds).duality_gap
    cost = [program.cost(regression, pi) for pi in (answer.pi, referee.pi)]
    return Compared(answer.dual is None, (cost[0] - cost[1]) / program.unit, gap / program.unit)


def compared_with_prior(case: Case) -> Compared:
    """GCO with a prior; what is left is told by the step to the best of both, in standard deviations."""
    answer = with_prior("psd", case)
    referee = REFEREES["psd"](case)
    M, r = with_prior_rows(case.regression, case.belief.metric, case.belief.strength)
    x = [np.linalg.solve(case.belief.metric.L, pi) for pi in (answer.pi, referee.pi)]
    costs = [float(np.linalg.norm(M @ one - r)) for one in x]
    unit, best = float(np.linalg.norm(r)), x[int(np.argmin(costs))]
    return Compared(answer.own, (costs[0] - costs[1]) / unit, float(np.linalg.norm(M @ (x[0] - best))))


def least_squares_off(case: Case) -> float:
    """Standard deviations between least squares with a prior and those of an orthogonal factorisation."""
    M, _ = with_prior_rows(case.regression, case.belief.metric, case.belief.strength)
    apart = with_prior("none", case).pi - REFEREES["none"](case).pi
    return float(np.linalg.norm(M @ np.linalg.solve(case.belief.metric.L, apart)))
