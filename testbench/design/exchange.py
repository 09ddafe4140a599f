"""Plans of whole poses: greedy start, Fedorov's exchange, several starts from the relaxed weights.

Fedorov (1972), Mitchell's DETMAX (1974): take the pose out whose place another fills best, until no
exchange of one pose helps. Every trial is an update of rank k of the information matrix; a tangent of the
criterion tells which trials are worth it.
"""

import itertools

import numpy as np

from testbench.design.criteria import Criterion, Largest
from testbench.design.relaxation import Relaxed, sensitivity
from testbench.design.rows import Problem, behind, information, total
from testbench.errors import Array, Ids
from testbench.session import stepwise

STARTS, FEWER, DRAWN = 12, 4, 190
"""Most starts from the relaxed weights, beside the greedy one; those of G and E, whose trials cost more;
and most poses of all of them."""
SHORTLIST = 1000  #: Candidates for the starts of G and E, those that the bound finds most useful.
SWEEPS = 30
BETTER = 1e-7  #: Relative gain below which an exchange does not count.
STALE = 1 / 8  #: Share of the candidates that may be left to try before the tangent is taken anew.


def select(
    problem: Problem, criterion: Criterion, poses: int, relaxed: Relaxed, rng: np.random.Generator
) -> Ids:
    """The best plan found, indices of candidates in their order, (poses,); relaxed is for as many poses.

    Starts are made from those alone that have weight, by G and E, where weights are not the best ones, from
    more; the best plan of them is exchanged with all candidates.
    """
    short, most = relaxed.support, STARTS
    if isinstance(criterion, Largest):
        useful = np.argsort(-sensitivity(problem.rows, relaxed.dual), kind="stable")[:SHORTLIST]
        short, most = np.union1d(useful, short), FEWER
    rows, share = problem.rows[short], np.zeros(len(problem.rows))
    share[relaxed.support] = relaxed.weights / relaxed.weights.sum()
    starts = [greedy(problem, criterion, rows, poses)]
    starts += [rng.choice(len(short), poses, p=share[short]) for _ in range(min(most, DRAWN // poses))]
    plans = [exchange(problem, criterion, rows, start) for start in stepwise(starts, "exchanging poses")]
    best = max(plans, key=lambda plan: criterion.information(information(problem, short[plan])))
    return np.sort(exchange(problem, criterion, problem.rows, short[best]))


def greedy(problem: Problem, criterion: Criterion, rows: Array, poses: int) -> Ids:
    """One pose after the other of the candidates (candidates, k, r), each the best next one, (poses,)."""
    M, plan = problem.prior, np.zeros(poses, dtype=int)
    for k in stepwise(range(poses), "choosing poses"):
        plan[k] = criterion.after(M, rows).argmax()
        M = M + rows[plan[k]].T @ rows[plan[k]]
    return plan


def exchange(problem: Problem, criterion: Criterion, rows: Array, plan: Ids) -> Ids:
    """Exchange a pose of the plan (poses,) for a candidate (candidates, k, r) while that makes it better.

    Phi of any M is at most <Z, M> with Z of a tangent, here or some exchanges ago: it tells what to try.
    """
    plan, left = plan.copy(), len(plan)
    M = total(problem.prior, rows[plan])
    value, Z, fresh = criterion.information(M), criterion.tangent(M).Z, True
    useful, before, after = sensitivity(rows, Z), problem.prior, behind(rows[plan])
    for k in itertools.islice(itertools.cycle(range(len(plan))), SWEEPS * len(plan)):
        if k == 0:
            before, after = problem.prior, behind(rows[plan])
        floor, rest = (1 + BETTER) * value, before + after[k + 1]
        hopeful = np.flatnonzero((Z * M).sum() - useful[plan[k]] + useful > floor)
        if not fresh and len(hopeful) > STALE * len(rows):
            Z, fresh = criterion.tangent(M).Z, True
            useful = sensitivity(rows, Z)
            hopeful = np.flatnonzero((Z * M).sum() - useful[plan[k]] + useful > floor)
        reached = criterion.after(rest, rows[hopeful]) if len(hopeful) else np.zeros(1)
        left -= 1
        if reached.max() > floor:
            plan[k], value = hopeful[reached.argmax()], float(reached.max())
            M, left, fresh = rest + rows[plan[k]].T @ rows[plan[k]], len(plan), False
        elif left == 0:
            break
        before = before + rows[plan[k]].T @ rows[plan[k]]
    return plan
