"""Plans of whole poses: greedy start, Fedorov's exchange, several starts from the relaxed weights.

Fedorov (1972), Mitchell's DETMAX (1974): take the pose out whose place another fills best, until no
exchange of one pose helps. Every trial is an update of rank k of the information matrix, and so is what the
candidates see of it: few columns a pose instead of all unknowns.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from testbench.design.criteria import Criterion, Largest
from testbench.design.relaxation import Relaxed, sensitivity
from testbench.design.rows import Ids, Problem, behind, information, total
from testbench.design.update import Seen, apart, look
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
    value, ceiling, seen = criterion.information(M), _ceiling(criterion, M, rows), None
    before, after = problem.prior, behind(rows[plan])
    for k in itertools.islice(itertools.cycle(range(len(plan))), SWEEPS * len(plan)):
        if k == 0:
            before, after, seen = problem.prior, behind(rows[plan]), None
        floor = (1 + BETTER) * value
        hopeful = ceiling.hopeful(M, plan[k], floor)
        if ceiling.M is not M and len(hopeful) > STALE * len(rows):
            ceiling = _ceiling(criterion, M, rows)
            hopeful = ceiling.hopeful(M, plan[k], floor)
        rest, own = before + after[k + 1], rows[plan[k]]
        if len(hopeful) and not isinstance(criterion, Largest):
            seen = seen or look(M, rows, criterion.W)
        reached, best = _best(criterion, _Without(rest, own, seen), rows, hopeful)
        if reached > floor:
            plan[k], value, left = best, reached, len(plan)
            M = rest + rows[best].T @ rows[best]
            seen = _exchanged(criterion, _Without(rest, own, seen), rows, best)
        elif left == 1:
            break
        else:
            left -= 1
        before = before + rows[plan[k]].T @ rows[plan[k]]
    return plan


@dataclass(frozen=True)
class _Without:
    """A plan without a pose."""

    M: Array  #: Its information, (r, r).
    own: Array  #: What the pose tells, (k, r).
    seen: Seen | None  #: The whole plan as candidates see it; None where that is not kept.


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


def _best(criterion: Criterion, without: _Without, rows: Array, hopeful: Ids) -> tuple[float, int]:
    """Phi with the best of the hopeful candidates in the place, and which it is; zero where there is none."""
    if not len(hopeful):
        return 0.0, -1
    if 2 * len(hopeful) > len(rows):  # then it takes longer to copy them than to try the others, too
        hopeful = np.arange(len(rows))
    every = len(hopeful) == len(rows)
    some = rows if every else rows[hopeful]
    reached = None
    if not isinstance(criterion, Largest) and without.seen:
        away = apart(without.M, without.own, some, criterion.W)
        if away.leverage.max() <= LOST:
            kept = without.seen if every else without.seen.of(hopeful)
            reached = criterion.reached(without.M, kept + away)
    if reached is None:
        reached = criterion.after(without.M, some)
    best = int(reached.argmax())
    return float(reached[best]), int(hopeful[best])


def _exchanged(criterion: Criterion, without: _Without, rows: Array, best: int) -> Seen | None:
    """The plan with another pose there as candidates see it; None where an update would lose digits."""
    if isinstance(criterion, Largest) or not without.seen:
        return None
    away = apart(without.M, without.own, rows, criterion.W)
    new = apart(without.M, rows[best], rows, criterion.W)
    lost = max(away.leverage.max(), new.leverage.max()) > LOST
    return None if lost else without.seen + away - new
