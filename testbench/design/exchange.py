"""Plans of whole poses: greedy start, Fedorov's exchange, several starts from the relaxed weights.

Fedorov (1972), Mitchell's DETMAX (1974): take the pose out whose place another fills best, until no
exchange of one pose helps. Every trial is an update of rank k of the information matrix.
"""

import numpy as np

from testbench.design.criteria import Criterion
from testbench.design.relaxation import Relaxed, sensitivity
from testbench.design.rows import Ids, Problem, information
from testbench.errors import Array

STARTS = 4
"""Starts drawn from the relaxed weights, beside the greedy one."""
SHORTLIST = 1000
"""Candidates for the starts, those that the bound finds most useful; the last exchange sees all of them."""
SWEEPS = 30
BETTER = 1e-7
"""Relative gain below which an exchange does not count."""


def select(
    problem: Problem, criterion: Criterion, poses: int, relaxed: Relaxed, rng: np.random.Generator
) -> Ids:
    """The best plan found, (poses,): indices of candidates, in the order of the indices.

    Args:
        problem: The candidates.
        criterion: What makes a plan good.
        poses: How many.
        relaxed: The relaxed optimum for as many.
        rng: Source of the starts.
    """
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
    """One pose after the other, each the best next one, (poses,).

    Args:
        problem: Gives the prior.
        criterion: What makes a plan good.
        rows: Candidates, (candidates, k, r).
        poses: How many.
    """
    M, plan = problem.prior, []
    for _ in range(poses):
        plan.append(int(criterion.after(M, rows).argmax()))
        M = M + rows[plan[-1]].T @ rows[plan[-1]]
    return np.array(plan)


def exchange(problem: Problem, criterion: Criterion, rows: Array, plan: Ids) -> Ids:
    """Exchange one pose at a time while the plan gets better, (poses,).

    Args:
        problem: Gives the prior.
        criterion: What makes a plan good.
        rows: Candidates, (candidates, k, r).
        plan: Where to start, (poses,).
    """
    plan = plan.copy()
    value = criterion.information(_of(problem, rows, plan))
    for _ in range(SWEEPS):
        before = value
        for k in range(len(plan)):
            reached = criterion.after(_of(problem, rows, np.delete(plan, k)), rows)
            best = int(reached.argmax())
            if reached[best] > (1 + BETTER) * value:
                plan[k], value = best, float(reached[best])
        if value <= (1 + BETTER) * before:
            break
    return plan


def _of(problem: Problem, rows: Array, plan: Ids) -> Array:
    A = rows[plan].reshape(-1, problem.r)
    return np.asarray(problem.prior + A.T @ A)
