"""Plans of whole poses: greedy start, Fedorov's exchange, several starts from the relaxed weights.

Fedorov (1972), Mitchell's DETMAX (1974): take the pose out whose place another fills best, until no
exchange of one pose helps. Every trial is an update of rank k of the information matrix.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from testbench.design.criteria import Criterion, Largest
from testbench.design.relaxation import Relaxed, sensitivity
from testbench.design.rows import Ids, Problem, information, total
from testbench.design.update import apart, look
from testbench.errors import Array

STARTS, FEWER, DRAWN = 12, 4, 190
"""Most starts from the relaxed weights, beside the greedy one; those of G and E, whose trials cost more;
and most poses of all of them."""
SHORTLIST = 1000  #: Candidates for the starts of G and E, those that the bound finds most useful.
SWEEPS = 30
BETTER = 1e-7  #: Relative gain below which an exchange does not count.
STALE = 1 / 8  #: Share of the candidates that may be left to try before the tangent is taken anew.
LOST = 1e6  #: Leverage above which a greedy step is not an update, which would lose digits.


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
    plans = [exchange(problem, criterion, rows, start) for start in starts]
    best = max(plans, key=lambda plan: criterion.information(information(problem, short[plan])))
    return np.sort(exchange(problem, criterion, problem.rows, short[best]))


def greedy(problem: Problem, criterion: Criterion, rows: Array, poses: int) -> Ids:
    """One pose after the other of the candidates (candidates, k, r), each the best next one, (poses,)."""
    M, plan, seen = problem.prior, [], None
    for _ in range(poses):
        if isinstance(criterion, Largest):
            plan.append(int(criterion.after(M, rows).argmax()))
        else:
            seen = seen or look(M, rows, criterion.W)
            plan.append(int(criterion.reached(M, seen).argmax()))
            lost = seen.leverage.max() > LOST
            seen = None if lost else seen - apart(M, rows[plan[-1]], rows, criterion.W)
        M = M + rows[plan[-1]].T @ rows[plan[-1]]
    return np.array(plan)


def exchange(problem: Problem, criterion: Criterion, rows: Array, plan: Ids) -> Ids:
    """Exchange a pose of the plan (poses,) for a candidate (candidates, k, r) while that makes it better."""
    plan, left = plan.copy(), len(plan)
    M = total(problem.prior, rows[plan])
    value, ceiling = criterion.information(M), _ceiling(criterion, M, rows)
    for k in itertools.islice(itertools.cycle(range(len(plan))), SWEEPS * len(plan)):
        floor = (1 + BETTER) * value
        hopeful = ceiling.hopeful(M, plan[k], floor)
        if ceiling.M is not M and len(hopeful) > STALE * len(rows):
            ceiling = _ceiling(criterion, M, rows)
            hopeful = ceiling.hopeful(M, plan[k], floor)
        rest = np.delete(plan, k)
        reached, best = _best(criterion, total(problem.prior, rows[rest]), rows, hopeful)
        if reached > floor:
            plan[k], value, left = best, reached, len(plan)
            M = total(problem.prior, rows[plan])
        elif left == 1:
            break
        else:
            left -= 1
    return plan


@dataclass(frozen=True)
class _Ceiling:
    """A tangent of Phi at a plan as it is, or as it was some exchanges ago: no plan lies above it."""

    M: Array  #: Information of that plan, (r, r).
    Z: Array  #: Phi of any M is at most <Z, M>, (r, r).
    useful: Array  #: <Z, F^T F> of every candidate, (candidates,).

    def hopeful(self, M: Array, pose: int, floor: float) -> Ids:
        """Candidates that may lift Phi above the floor in the place of a pose that M holds."""
        return np.flatnonzero((self.Z * M).sum() - self.useful[pose] + self.useful > floor)


def _ceiling(criterion: Criterion, M: Array, rows: Array) -> _Ceiling:
    Z = criterion.tangent(M).Z
    return _Ceiling(M, Z, sensitivity(rows, Z))


def _best(criterion: Criterion, M: Array, rows: Array, hopeful: Ids) -> tuple[float, int]:
    """Phi with the best of the hopeful candidates, and which it is; zero where there are none."""
    if not len(hopeful):
        return 0.0, -1
    if 2 * len(hopeful) > len(rows):  # then it takes longer to copy them than to try the others, too
        hopeful = np.arange(len(rows))
    reached = criterion.after(M, rows if len(hopeful) == len(rows) else rows[hopeful])
    best = int(reached.argmax())
    return float(reached[best]), int(hopeful[best])
