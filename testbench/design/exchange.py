"""Plans of whole poses: a greedy start, Fedorov's exchange, and several starts from the relaxed weights.

Fedorov (1972) and Mitchell's DETMAX (1974): remove the pose that another candidate replaces best, until no
exchange of one pose helps. Every trial is an update of rank k of the information matrix. A tangent of the
criterion selects the trials that can help. `planning` refines the plan afterwards.
"""

import itertools

import numpy as np

from testbench.design.criteria import Criterion, LargestCriterion, LinearCriterion, gains_of, grown
from testbench.design.relaxation import Relaxed, sensitivity
from testbench.design.rows import DesignProblem, information, suffix_information, sum_information
from testbench.errors import Array, Ids
from testbench.progress import stepwise

MAX_STARTS, MAX_STARTS_OF_MAXIMUM, MAX_DRAWN = 12, 4, 190
"""Most random starts from the relaxed weights; the same for G and E, whose trials cost more; and the most
poses that all random starts have together. The greedy start comes in addition."""
SHORTLIST = 1000  #: Candidates for the starts of G and E: the most sensitive ones.
SWEEPS = 30  #: Most passes of the exchange over all poses of a plan.
MIN_GAIN = 1e-7  #: Relative gain of Phi below which an exchange does not count [1].
STALE_SHARE = 1 / 8  #: Share of candidates left to try from which an old tangent is taken anew [1].


def select_poses(
    problem: DesignProblem, criterion: Criterion, poses: int, relaxed: Relaxed, rng: np.random.Generator
) -> Ids:
    """Find the best plan from several starts, each improved by exchange.

    Starts come from the relaxed weights. For the smooth criteria they use only candidates with weight; for G
    and E, whose weights are not optimal, also the most useful others. The best plan is then exchanged with
    all candidates.

    Args:
        problem: Candidates.
        criterion: Information function.
        poses: Number of poses of the plan.
        relaxed: Relaxed optimum for the same number of poses.
        rng: Source of the random starts.

    Returns:
        Indices of the candidates of the plan, sorted, (poses,); a candidate may occur more than once.
    """
    # candidates that the starts may use
    short, most = relaxed.support, MAX_STARTS
    if isinstance(criterion, LargestCriterion):
        useful = np.argsort(-sensitivity(problem.rows, relaxed.dual), kind="stable")[:SHORTLIST]
        short, most = np.union1d(useful, short), MAX_STARTS_OF_MAXIMUM
    # random starts are drawn in proportion to the relaxed weights
    rows, share = problem.rows[short], np.zeros(len(problem.rows))
    share[relaxed.support] = relaxed.weights / relaxed.weights.sum()
    starts = [greedy(problem, criterion, rows, poses)]
    starts += [rng.choice(len(short), poses, p=share[short]) for _ in range(min(most, MAX_DRAWN // poses))]
    plans = [exchange(problem, criterion, rows, start) for start in stepwise(starts, "exchanging poses")]
    # only the best start is exchanged with all candidates
    best = max(plans, key=lambda plan: criterion.information(information(problem, short[plan])))
    return np.sort(exchange(problem, criterion, problem.rows, short[best]))


def greedy(problem: DesignProblem, criterion: Criterion, rows: Array, poses: int) -> Ids:
    """Choose one pose after the other, each the best next one.

    Args:
        problem: Candidates, for the prior's information.
        criterion: Information function.
        rows: Whitened rows of the candidates to choose from, (candidates, k, r).
        poses: Number of poses.

    Returns:
        Indices into rows in the order of choice, (poses,).
    """
    M, plan = problem.prior, np.zeros(poses, dtype=int)
    gains = gains_of(M, rows, criterion.W) if isinstance(criterion, LinearCriterion) else None
    for k in stepwise(range(poses), "choosing poses"):
        # of a linear criterion the gains follow M; the others are computed from it
        worth = criterion.after(M, rows) if gains is None else gains.after()
        plan[k] = worth.argmax()
        own = rows[plan[k]]
        M = M + own.T @ own
        gains = None if gains is None or k == poses - 1 else grown(gains, own)
    return plan


def exchange(problem: DesignProblem, criterion: Criterion, rows: Array, plan: Ids) -> Ids:
    """Improve a plan by exchanging one pose for one candidate until no exchange helps (Fedorov 1972).

    Phi of any M is at most <Z, M> with Z of a tangent taken at any point. A tangent, even one of some
    exchanges ago, therefore tells which candidates can help.

    Mathematics: `pose-10`.

    Args:
        problem: Candidates, for the prior's information.
        criterion: Information function.
        rows: Whitened rows of the candidates to choose from, (candidates, k, r).
        plan: Indices into rows to start from, (poses,).

    Returns:
        Indices into rows of the improved plan, (poses,).
    """
    plan, left = plan.copy(), len(plan)
    M = sum_information(problem.prior, rows[plan])
    value, Z, fresh = criterion.information(M), criterion.tangent(M).Z, True
    useful, before, after = sensitivity(rows, Z), problem.prior, suffix_information(rows[plan])
    # `before` and `after` sum the information of the poses before and behind k: the plan without k
    for k in itertools.islice(itertools.cycle(range(len(plan))), SWEEPS * len(plan)):
        if k == 0:
            before, after = problem.prior, suffix_information(rows[plan])
        # promising candidates: in place of k they lift the plane, a bound of Phi, above Phi of the plan
        floor, rest = (1 + MIN_GAIN) * value, before + after[k + 1]
        promising = np.flatnonzero((Z * M).sum() - useful[plan[k]] + useful > floor)
        # an old plane leaves too many: take it anew at the present M
        if not fresh and len(promising) > STALE_SHARE * len(rows):
            Z, fresh = criterion.tangent(M).Z, True
            useful = sensitivity(rows, Z)
            promising = np.flatnonzero((Z * M).sum() - useful[plan[k]] + useful > floor)
        # exact Phi of the promising ones; if the best is better it replaces k, and all poses are tried again
        reached = criterion.after(rest, rows[promising]) if len(promising) else np.zeros(1)
        left -= 1
        if reached.max() > floor:
            plan[k], value = promising[reached.argmax()], float(reached.max())
            M, left, fresh = rest + rows[plan[k]].T @ rows[plan[k]], len(plan), False
        elif left == 0:
            break
        before = before + rows[plan[k]].T @ rows[plan[k]]
    return plan
