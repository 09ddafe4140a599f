"""GCO of random and nasty datasets against Clarabel as the referee: who comes lower, and what is proven."""

from dataclasses import dataclass

import numpy as np
from measure import Row, at_most, note
from programs import NASTY, random_regression, with_random_prior

from testbench.identify.certify import bound_gap, gradient_dual
from testbench.identify.conic import answers, by_clarabel, scale_program
from testbench.identify.metric import Case, with_prior_rows
from testbench.identify.regression import Regression
from testbench.identify.regularised import REFEREES
from testbench.identify.regularised import answers as with_prior

RANDOM, NASTY_ONES = 10_000, 1_000
SEED = 20_000
WORSE = 1e-8  #: Cost over the referee's, relative to that of no model, beyond which an answer is wrong.
ROUNDING = 1e-9  #: Gap that our own method has to prove, relative to F_M without a model.


@dataclass(frozen=True)
class Compared:
    """One dataset."""

    own: bool  #: Whether our own method answered; the referee did otherwise.
    over: float  #: Cost over the referee's, relative to that of no model [1].
    gap: float  #: What is proven of the answer, relative to that of no model [1].
    referee: float  #: The same of the referee's.


def agreement_with_the_referee() -> list[Row]:
    """Rows for random and nasty datasets, without a prior and with."""
    kinds = {"random": ["kind"] * RANDOM, "nasty": [NASTY[k % len(NASTY)] for k in range(NASTY_ONES)]}
    rows = []
    for name, each in kinds.items():
        rng = np.random.default_rng(SEED)
        found, firm = [], []
        for kind in each:
            regression = random_regression(kind, rng)
            found.append(compared(regression))
            firm.append(compared_with_prior(with_random_prior(regression, 10 ** rng.uniform(-6, 3), rng)))
        rows += rows_of(f"{len(each)} {name} datasets", found)
        rows += rows_of(f"{len(each)} {name} datasets with a prior", firm)
    return rows


def rows_of(name: str, found: list[Compared]) -> list[Row]:
    """Worst cost, worst proof, and how often the referee had to answer."""
    own = [one for one in found if one.own]
    worse = [one for one in own if one.gap > 10 * max(one.referee, ROUNDING)]
    over = max(one.over for one in own)
    below = -min(one.over for one in own)
    return [
        at_most(f"(h) {name}: cost over the referee's", over, "", WORSE, f"below it by up to {below:.1e}"),
        at_most(f"(h) {name}: proven less than a tenth as well", len(worse), "", 0, f"of {len(own)}"),
        note(f"    {name}: answered by the referee", 100 * (1 - len(own) / len(found)), "%", ""),
    ]


def compared(regression: Regression) -> Compared:
    """GCO without a prior; both answers are judged by one certificate."""
    program = scale_program(regression)
    [answer] = answers([regression], [program])
    referee = by_clarabel(regression, program)
    assert referee.dual is not None
    own = answer.dual or gradient_dual(regression, answer.pi)
    proof = bound_gap(regression, referee.pi, referee.dual)
    gaps = [
        bound_gap(regression, pi, dual, proof.trace_bounds, trace_weight=program.trace_weight).gap
        for pi, dual in ((answer.pi, own), (referee.pi, referee.dual))
    ]
    cost = [program.cost(regression, pi) for pi in (answer.pi, referee.pi)]
    return Compared(
        answer.dual is None,
        (cost[0] - cost[1]) / program.unit,
        gaps[0] / program.unit,
        gaps[1] / program.unit,
    )


def compared_with_prior(case: Case) -> Compared:
    """GCO with a prior; what is proven is what the answer costs over the lower of both."""
    [answer] = with_prior("psd", [case])
    referee = REFEREES["psd"](case)
    M, r = with_prior_rows(case.regression, case.belief.metric, case.belief.strength)
    costs = [
        float(np.linalg.norm(M @ np.linalg.solve(case.belief.metric.L, pi) - r))
        for pi in (answer.pi, referee.pi)
    ]
    unit, least = float(np.linalg.norm(r)), min(costs)
    return Compared(
        answer.own, (costs[0] - costs[1]) / unit, (costs[0] - least) / unit, (costs[1] - least) / unit
    )
