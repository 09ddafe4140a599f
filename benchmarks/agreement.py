"""Fits with a prior of random and nasty datasets against independent solvers: who comes lower."""

from dataclasses import dataclass

import numpy as np
from measure import Row, at_most, note
from programs import NASTY, random_regression, with_random_prior

from testbench.identify.metric import Case, with_prior_rows
from testbench.identify.solve import solve_by_reference, solve_with_prior

RANDOM, NASTY_ONES = 10_000, 1_000
SEED = 20_000
WORSE = 1e-8  #: Cost over the referee's, relative to that of no model, beyond which an answer is wrong.
OFF = 1e-4  #: Standard deviations that least squares with a prior may be off.
APART = 1e-2  #: Standard deviations that an answer with a prior may be off.


@dataclass(frozen=True)
class Compared:
    """One dataset."""

    own: bool  #: Whether our own method answered; the referee did otherwise.
    over: float  #: Cost over the referee's, relative to that of no model [1].
    gap: float  #: Distance from the better of both answers, in standard deviations [1].


def agreement_with_the_referee() -> list[Row]:
    """Rows for random and nasty datasets."""
    kinds = {"random": ["kind"] * RANDOM, "nasty": [NASTY[k % len(NASTY)] for k in range(NASTY_ONES)]}
    rows = []
    for name, each in kinds.items():
        rng = np.random.default_rng(SEED)
        found, least = [], []
        for kind in each:
            case = with_random_prior(random_regression(kind, rng), 10 ** rng.uniform(-6, 3), rng)
            found.append(compared(case))
            least.append(least_squares_off(case))
        rows += rows_of(f"{len(each)} {name} datasets with a prior", found)
        title = f"(h) {len(each)} {name} datasets with a prior: least squares off"
        rows.append(
            at_most(title, max(least), "", OFF, "standard deviations, against an orthogonal factorisation")
        )
    return rows


def rows_of(name: str, found: list[Compared]) -> list[Row]:
    """Worst cost, farthest answer, and how often the referee had to answer."""
    own = [one for one in found if one.own]
    over, gap = [one.over for one in own] or [0.0], max([one.gap for one in own] or [0.0])
    referee = 100 * (1 - len(own) / len(found))
    below = f"below it by up to {-min(over):.1e}"
    return [
        at_most(f"(h) {name}: cost over the referee's", max(over), "", WORSE, below),
        at_most(f"(h) {name}: standard deviations off", gap, "", APART, f"of {len(own)} datasets"),
        note(f"    {name}: answered by the referee", referee, "%", ""),
    ]


def compared(case: Case) -> Compared:
    """GCO with a prior; what is left is told by the step to the best of both, in standard deviations."""
    own, other = solve_with_prior("psd", case), solve_by_reference("psd", case)
    M, r = with_prior_rows(case.regression, case.belief.scaling, case.belief.strength)
    x = [np.linalg.solve(case.belief.scaling.L, pi) for pi in (own.pi, other.pi)]
    costs = [float(np.linalg.norm(M @ one - r)) for one in x]
    unit, best = float(np.linalg.norm(r)), x[int(np.argmin(costs))]
    return Compared(own.by_our_solver, (costs[0] - costs[1]) / unit, float(np.linalg.norm(M @ (x[0] - best))))


def least_squares_off(case: Case) -> float:
    """Standard deviations between least squares with a prior and those of an orthogonal factorisation."""
    M, _ = with_prior_rows(case.regression, case.belief.scaling, case.belief.strength)
    apart = solve_with_prior("none", case).pi - solve_by_reference("none", case).pi
    return float(np.linalg.norm(M @ np.linalg.solve(case.belief.scaling.L, apart)))
