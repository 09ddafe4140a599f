"""Plans of whole poses: greedy start, Fedorov's exchange, several starts from the relaxed weights.

Fedorov (1972), Mitchell's DETMAX (1974): take the pose out whose place another fills best, until no
exchange of one pose helps. Every trial is an update of rank k of the information matrix.
"""

import numpy as np

from testbench.design.criteria import Criterion
from testbench.design.relaxation import Relaxed, sensitivity
from testbench.design.rows import Ids, Problem, information, total
from testbench.errors import Array

STARTS = 4  #: Starts drawn from the relaxed weights, beside the greedy one.
SHORTLIST = 1000
"""Candidates for the starts, those that the bound finds most useful; the last exchange sees all of them."""
SWEEPS = 30
BETTER = 1e-7  #: Relative gain below which an exchange does not count.


def select(
    problem: Problem, criterion: Criterion, poses: int, relaxed: Relaxed, rng: np.random.Generator
) -> Ids:
    """The best plan found, indices of candidates in their order, (poses,); relaxed is for as many poses."""
    useful = np.argsort(-sensitivity(problem.rows, relaxed.dual), kind="stable")[:SHORTLIST]
    short = np.union1d(useful, relaxed.support)
    rows = problem.rows[short]
    share = np.zeros(len(short))
    share[np.searchsorted(short, relaxed.support)] = relaxed.weights / relaxed.weights.sum()
    starts = [greedy(problem, criterion, rows, poses)]
    starts += [rng.choice(len(short), poses, p=share) for _ in range(STARTS)]
    plans = [exchange(problem, criterion, rows, start) for start in starts]
    best = max(plans, key=lambda plan: criterion.information(information(problem, short[plan])))
    return np.sort(exchange(problem, criterion, problem.rows, short[best]))


def greedy(problem: Problem, criterion: Criterion, rows: Array, poses: int) -> Ids:
    """One pose after the other of the candidates (candidates, k, r), each the best next one, (poses,)."""
    M, plan = problem.prior, []
    for _ in range(poses):
        plan.append(int(criterion.after(M, rows).argmax()))
        M = M + rows[plan[-1]].T @ rows[plan[-1]]
    return np.array(plan)


def exchange(problem: Problem, criterion: Criterion, rows: Array, plan: Ids) -> Ids:
    """Exchange a pose of the plan (poses,) for a candidate (candidates, k, r) while that makes it better."""
    plan = plan.copy()
    value = criterion.information(total(problem.prior, rows[plan]))
    for _ in range(SWEEPS):
        before = value
        for k in range(len(plan)):
            reached = criterion.after(total(problem.prior, rows[np.delete(plan, k)]), rows)
            best = int(reached.argmax())
            if reached[best] > (1 + BETTER) * value:
                plan[k], value = best, float(reached[best])
        if value <= (1 + BETTER) * before:
            break
    return plan
