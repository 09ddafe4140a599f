"""Search for the best plan: relaxation to weights, exchange of whole poses, local refinement.

The relaxed problem has weights w >= 0 with sum N in place of N poses: Phi(prior + sum w F^T F) is concave in
them. With Z of a tangent at any M, Phi of every plan is at most <Z, prior> + N max <Z, F^T F>: the
equivalence theorem (Kiefer and Wolfowitz 1960) as a bound. Weights increase on a working set of candidates;
candidates that limit the bound join it. If Phi is smooth the weights follow Newton's method: the best
weights of its second-order model solve a least-squares problem with weights >= 0 (Lawson and Hanson 1974). G
and E use the multiplicative algorithm (Silvey, Titterington and Torsney 1978; Yu 2010), which needs no
second derivatives but more steps.

Whole poses are chosen by Fedorov's exchange (1972) and Mitchell's DETMAX (1974), from a greedy start and from
several starts by the relaxed weights. The pose that another candidate replaces best is exchanged, until no
exchange of one pose helps. Every trial is an update of rank k of the information matrix. Of a linear
criterion all trials are computed; of the others a tangent selects those that can help.

Local refinement then improves the joint angles pose by pose. It is a random search with a shrinking step, an
evolution strategy with one parent. Updates of the information matrix judge many neighbours of a pose at once;
feasibility is checked only for those that would help.

A plan with gauges also chooses where they touch: in every pose some markers, each along a world axis. A gauge
reads one number, so that a pose offers a choice that a tracker does not have. Gauges are chosen by the
criterion of the poses. A tilt of a gauge's direction counts as noise, so that directions across a large
deflection are avoided.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations, cycle, islice, product

import numpy as np

from testbench.design.criteria import (
    MAX_INVERTED_INFORMATION,
    CandidateGains,
    Criterion,
    LargestCriterion,
    LinearCriterion,
    candidate_gains,
    gains_at_root,
    gram_matrices,
    update_gains,
)
from testbench.design.rows import (
    DesignProblem,
    PlanSpecification,
    add_information,
    deflection_rows,
    information,
    row_products,
    select_loads,
    split_into_blocks,
    suffix_information,
)
from testbench.errors import Array, BenchError, Ids, Mask
from testbench.model.vjm import tool_poses
from testbench.progress import stepwise

# --- The relaxed design problem: real weights for all candidates, and a bound on every plan of N poses ------

#: Numbers of candidates in the first working set, and of those that join the working set in a round.
FIRST_CANDIDATES, JOINING_CANDIDATES = 120, 40
MAX_RELAXATION_ROUNDS = 40  #: Most rounds, each with better weights and a new bound.
RELAXATION_GAP = 1e-3  #: Relative gap from a tangent's height to the bound at which the rounds end [1].
MIN_CANDIDATE_WEIGHT = (
    1e-6  #: Weight over the mean weight, below which a candidate leaves the working set [1].
)
MAX_MULTIPLICATIVE_STEPS = 150  #: Most multiplicative steps in a round.
FIRST_EXPONENT, EXPONENT_GROWTH, MAX_EXPONENT = 0.5, 1.3, 2.0
"""First exponent of a multiplicative step, and its factor after a step that climbs, up to `MAX_EXPONENT`."""
NEW_CANDIDATES_WEIGHT_SHARE = 0.02
"""Share of all weight that candidates without weight get before multiplicative steps [1]."""
WORKING_SET_GAP = 2.5e-4
"""Relative gap from the tangent's height to the working set's bound at which multiplicative steps end [1]."""
CURVATURE_RIDGE = 1e-9
"""Ridge on the Newton model's curvature over its mean diagonal [1]: candidates may be linearly dependent."""
SUM_EQUATION_WEIGHT = 1e3
"""Weight of the equation sum w = N over the root of the curvature's mean diagonal [1]."""
MIN_NEWTON_STEP_SHARE = 1e-3  #: Least share of a Newton step that is tried [1].


@dataclass(frozen=True)
class RelaxedDesign:
    """Hold the optimum of the relaxed problem: weights of candidates, and an upper bound on Phi."""

    support: Ids  #: Indices of the candidates that have weight, (s,).
    weights: Array  #: Weights of these candidates, whose sum is the number of poses, (s,) [1].
    bound: float  #: Upper bound on Phi of every plan of as many poses.
    dual: Array  #: Matrix Z of the tangent plane that proves the bound, (r, r).


def sensitivity(rows: Array, Z: Array) -> Array:
    """Compute the sensitivity <Z, F^T F> of every candidate: the slope of a tangent plane in its weight.

    Where Phi is smooth, this is the derivative of Phi with respect to the candidate's weight.

    Args:
        rows: Whitened rows F of every candidate, (candidates, k, r).
        Z: Matrix of a tangent plane of Phi, (r, r).

    Returns:
        Sensitivities, (candidates,).
    """
    blocks = [np.einsum("pkr,pkr->p", row_products(block, Z), block) for block in split_into_blocks(rows)]
    return np.concatenate(blocks)


def solve_relaxed_design(
    problem: DesignProblem, criterion: Criterion, n_poses: int, start: RelaxedDesign | None = None
) -> RelaxedDesign:
    """Maximise Phi(prior + sum w F^T F) over weights w >= 0 of all candidates, and bound Phi of every plan.

    The weights are within `RELAXATION_GAP` of the optimum; for G and E, which are not smooth, within a few
    per cent.

    Mathematics: `pose-8`.

    Args:
        problem: Candidates.
        criterion: Information function Phi.
        n_poses: Number of poses N, the sum of the weights.
        start: Optimum over fewer candidates to start from; None for even weights.

    Returns:
        The weights of the round with the lowest bound.
    """
    S = np.linspace(0, len(problem.rows) - 1, min(FIRST_CANDIDATES, len(problem.rows))).astype(int)
    S, w = (start.support, start.weights) if start else (S, np.full(len(S), n_poses / len(S)))
    best: RelaxedDesign | None = None
    for _ in range(MAX_RELAXATION_ROUNDS):
        # better weights on the working set S
        w = _improve_weights(problem.prior_information, criterion, problem.rows[S], w)
        M = add_information(problem.prior_information, np.sqrt(w)[:, None, None] * problem.rows[S])
        # the bound over all candidates: <Z, prior> + N max <Z, F^T F>
        plane = criterion.tangent(M)
        g = sensitivity(problem.rows, plane.Z)
        limit = float((plane.Z * problem.prior_information).sum() + n_poses * g.max())
        if best is None or limit < best.bound:
            best = RelaxedDesign(S, w, limit, plane.Z)
        if limit <= (1 + RELAXATION_GAP) * plane.height:
            break
        S, w = _exchange_members(g, S, w)
    assert best is not None
    return best


def _exchange_members(g: Array, S: Ids, w: Array) -> tuple[Ids, Array]:
    """Drop candidates without weight from the working set; add the most sensitive ones at weight zero."""
    total, stay = w.sum(), w > MIN_CANDIDATE_WEIGHT * w.mean()
    new = np.setdiff1d(np.argsort(-g, kind="stable")[:JOINING_CANDIDATES], S[stay])
    S, w = np.r_[S[stay], new], np.r_[w[stay], np.zeros(len(new))]
    return S, np.asarray(w * total / w.sum())


def _improve_weights(prior: Array, criterion: Criterion, rows: Array, w: Array) -> Array:
    """Increase Phi(prior + sum w F^T F), by one Newton step or by many multiplicative steps.

    F are whitened rows of the working set, (candidates, k, r). The new weights, (candidates,), have the same
    sum, and the height of their tangent is no less.
    """
    every = gram_matrices(rows)
    M = prior + (w @ every).reshape(prior.shape)
    plane = criterion.tangent(M)
    if not plane.curvature:
        return _multiply(prior, criterion, every, w)
    # Newton: the best weights of a second-order model, of log Phi for D and of the cost 1 / Phi for a linear
    # criterion; multiplicative steps where there is none
    Z, inverse = plane.Z / plane.height, np.asarray(np.linalg.inv(M))
    try:
        goal = _best_of_model(every @ Z.ravel(), plane.curvature * _curvature(rows, inverse, Z), w)
    except (np.linalg.LinAlgError, RuntimeError):  # without a prior few poses cost too many digits
        return _multiply(prior, criterion, every, w)
    # halve the step until Phi does not fall
    share = 1.0
    while share > MIN_NEWTON_STEP_SHARE:
        trial = w + share * (goal - w)
        if criterion.phi(prior + (trial @ every).reshape(prior.shape)) >= plane.height:
            return np.asarray(trial)
        share /= 2
    return w


def _curvature(rows: Array, I: Array, Z: Array) -> Array:  # noqa: E741
    """Compute <Z, S_i M^-1 S_j> of all pairs of S = F^T F, with I = M^-1, (candidates, candidates).

    It is the sum over the entries of (F_i I F_j^T) * (F_i Z F_j^T).
    """
    candidates, k, r = rows.shape
    F = rows.reshape(-1, r)
    of_I, of_Z = ((F @ X @ F.T).reshape(candidates, k, candidates, k) for X in (I, Z))
    return np.asarray(np.einsum("iajb,iajb->ij", of_I, of_Z))


def _best_of_model(slope: Array, H: Array, w: Array) -> Array:
    """Minimise -slope x + (x - w)^T H (x - w) / 2 over x >= 0 of the same sum as w, (candidates,)."""
    from scipy.optimize import nnls  # here: it takes long to import

    # |L^T x - L^-1 (H w + slope)|^2 is the model but for a constant; one stiff row keeps the sum of x
    size = float(np.trace(H)) / len(H)
    L = np.linalg.cholesky(H + CURVATURE_RIDGE * size * np.eye(len(H)))
    stiff = SUM_EQUATION_WEIGHT * np.sqrt(size)
    A, b = np.vstack([L.T, np.full(len(w), stiff)]), np.r_[np.linalg.solve(L, H @ w + slope), stiff * w.sum()]
    x, _ = nnls(A, b)
    return np.asarray(x * w.sum() / x.sum())


def _multiply(prior: Array, criterion: Criterion, grams: Array, w: Array) -> Array:
    """Climb by multiplicative steps w_i <- w_i g_i^power, scaled to the same sum, g_i = <Z, F^T F>."""
    total = w.sum()
    power = FIRST_EXPONENT
    new = w == 0
    # a weight of zero stays zero under products: give new candidates some
    if new.any():
        w = np.where(
            new, NEW_CANDIDATES_WEIGHT_SHARE * total / new.sum(), (1 - NEW_CANDIDATES_WEIGHT_SHARE) * w
        )
    plane = criterion.tangent(prior + (w @ grams).reshape(prior.shape))
    for _ in range(MAX_MULTIPLICATIVE_STEPS):
        g = grams @ plane.Z.ravel()
        if total * g.max() - w @ g <= WORKING_SET_GAP * plane.height:
            break
        # halve the exponent until the stand-in does not fall; let it grow after a step that climbs
        while power > 1e-3:
            trial = w * (g / g.max()) ** power
            trial *= total / trial.sum()
            reached = criterion.tangent(prior + (trial @ grams).reshape(prior.shape))
            if reached.height >= plane.height:
                w = trial
                plane = reached
                power = min(EXPONENT_GROWTH * power, MAX_EXPONENT)
                break
            power /= 2
        else:
            break
    return w


# --- Plans of whole poses -----------------------------------------------------------------------------------

MAX_STARTS, MAX_MINIMAX_STARTS, MAX_START_POSES = 12, 4, 190
"""Most random starts from the relaxed weights; most for G and E, whose trials cost more; and most poses of
all random starts together. The greedy start comes in addition."""
MAX_MINIMAX_CANDIDATES = 1000  #: Number of the most sensitive candidates that may start plans by G and E.
MAX_EXCHANGE_SWEEPS = 30  #: Most passes of the exchange over all poses of a plan.
MIN_EXCHANGE_GAIN = 1e-7  #: Least relative gain of Phi for which a pose, or its gauges, are exchanged [1].
STALE_TANGENT_SHARE = 1 / 8
"""Share of candidates that an old tangent plane does not exclude, from which a new one is computed [1]."""


def select_poses(
    problem: DesignProblem,
    criterion: Criterion,
    n_poses: int,
    relaxed: RelaxedDesign,
    rng: np.random.Generator,
) -> Ids:
    """Find the best plan of whole poses by exchange from several starts.

    Starts are drawn by the relaxed weights. For the smooth criteria they use only candidates with weight; for
    G and E, whose weights are not optimal, also the most sensitive others. The best of the improved starts is
    then exchanged with all candidates.

    Args:
        problem: Candidates.
        criterion: Information function Phi.
        n_poses: Number of poses of the plan.
        relaxed: Relaxed optimum for the same number of poses.
        rng: Source of the random starts.

    Returns:
        Indices of the candidates of the plan, sorted, (poses,); a candidate may occur more than once.
    """
    # candidates that the starts may use
    short, most = relaxed.support, MAX_STARTS
    if isinstance(criterion, LargestCriterion):
        useful = np.argsort(-sensitivity(problem.rows, relaxed.dual), kind="stable")[:MAX_MINIMAX_CANDIDATES]
        short, most = np.union1d(useful, short), MAX_MINIMAX_STARTS
    # random starts are drawn in proportion to the relaxed weights
    rows, share = problem.rows[short], np.zeros(len(problem.rows))
    share[relaxed.support] = relaxed.weights / relaxed.weights.sum()
    starts = [greedy_plan(problem, criterion, rows, n_poses)]
    starts += [
        rng.choice(len(short), n_poses, p=share[short]) for _ in range(min(most, MAX_START_POSES // n_poses))
    ]
    plans = [
        exchange_poses(problem, criterion, rows, start) for start in stepwise(starts, "exchanging poses")
    ]
    # only the best start is exchanged with all candidates
    best = max(plans, key=lambda plan: criterion.phi(information(problem, short[plan])))
    return np.sort(exchange_poses(problem, criterion, problem.rows, short[best]))


def greedy_plan(problem: DesignProblem, criterion: Criterion, rows: Array, n_poses: int) -> Ids:
    """Choose poses greedily: each is the candidate that increases the criterion most.

    Args:
        problem: Candidates, for the prior's information.
        criterion: Information function Phi.
        rows: Whitened rows F of the candidates to choose from, (candidates, k, r).
        n_poses: Number of poses.

    Returns:
        Indices of the candidates in the order of choice, (poses,).
    """
    if isinstance(criterion, LinearCriterion):
        return _choose_linear(problem.prior_information, criterion.W, rows, n_poses)
    M, plan = problem.prior_information, np.zeros(n_poses, dtype=int)
    for k in stepwise(range(n_poses), "choosing poses"):
        plan[k] = criterion.phi_with_candidate(M, rows).argmax()
        M = M + rows[plan[k]].T @ rows[plan[k]]
    return plan


def _choose_linear(prior: Array, W: Array, rows: Array, n_poses: int) -> Ids:
    """Choose greedily by a linear criterion, whose gains of all candidates follow the plan."""
    plan = np.zeros(n_poses, dtype=int)
    # M, and the rows of the gains, are in coordinates in which the information was the identity
    gains, M = gains_at_root(np.asarray(np.linalg.cholesky(prior).T), rows, W), np.eye(len(prior))
    for k in stepwise(range(n_poses), "choosing poses"):
        if k > 0:
            gains, M = _add_to_gains(gains, M, gains.rows[plan[k - 1]])
        plan[k] = gains.phi_with_candidate().argmax()
    return plan


def _add_to_gains(gains: CandidateGains, M: Array, added: Array) -> tuple[CandidateGains, Array]:
    """Add a pose with the rows `added`, (k, r), to the information M; return the new gains, and their M."""
    if gains.largest_information() <= MAX_INVERTED_INFORMATION:
        M = M + added.T @ added
        return update_gains(gains, M, added, np.ones(len(added))), M
    # the first poses tell far more than was known: a triangular root keeps the digits of what they leave open
    root = np.linalg.qr(np.vstack([np.linalg.cholesky(M).T, added]), mode="r")
    return gains_at_root(np.asarray(root), gains.rows, gains.W), np.eye(len(M))


def exchange_poses(problem: DesignProblem, criterion: Criterion, rows: Array, plan: Ids) -> Ids:
    """Improve a plan by exchanging one pose for one candidate until no exchange helps (Fedorov 1972).

    Mathematics: `pose-10`.

    Args:
        problem: Candidates, for the prior's information.
        criterion: Information function Phi.
        rows: Whitened rows F of the candidates to choose from, (candidates, k, r).
        plan: Indices of the candidates in the plan to start from, (poses,).

    Returns:
        Indices of the candidates in the improved plan, (poses,).
    """
    if isinstance(criterion, LinearCriterion):
        return _exchange_linear(problem.prior_information, criterion.W, rows, plan.copy())
    return _exchange_promising(problem.prior_information, criterion, rows, plan.copy())


def _exchange_linear(prior: Array, W: Array, rows: Array, plan: Ids) -> Ids:
    """Exchange by a linear criterion, whose gains of all candidates follow the plan; see `exchange`."""
    one, left = np.ones(rows.shape[1]), len(plan)
    gains = candidate_gains(add_information(prior, rows[plan]), rows, W)
    before, after = prior, suffix_information(rows[plan])
    # `before` and `after` sum the information of the poses before and behind k: the plan without k
    for k in itertools.islice(itertools.cycle(range(len(plan))), MAX_EXCHANGE_SWEEPS * len(plan)):
        if k == 0:
            before, after = prior, suffix_information(rows[plan])
        rest, replaced = before + after[k + 1], rows[plan[k]]
        # Phi with every candidate in place of k; if the best one is better it stays there, and all poses are
        # tried again
        reached = update_gains(gains, rest, replaced, -one).phi_with_candidate()
        best, left = int(reached.argmax()), left - 1
        if reached[best] > (1 + MIN_EXCHANGE_GAIN) * reached[plan[k]]:
            M, changed = rest + rows[best].T @ rows[best], np.concatenate([rows[best], replaced])
            gains = update_gains(gains, M, changed, np.r_[one, -one])
            left = len(plan)
            plan[k] = best
        elif left == 0:
            break
        before = before + rows[plan[k]].T @ rows[plan[k]]
    return plan


def _exchange_promising(prior: Array, criterion: Criterion, rows: Array, plan: Ids) -> Ids:
    """Exchange by any criterion, which is computed for the promising candidates; see `exchange`.

    Phi of any M is at most <Z, M> with Z of a tangent taken at any point. A tangent, even one of some
    exchanges ago, therefore shows which candidates can help.
    """
    left = len(plan)
    M = add_information(prior, rows[plan])
    value = criterion.phi(M)
    Z = criterion.tangent(M).Z
    fresh = True
    useful = sensitivity(rows, Z)
    before = prior
    after = suffix_information(rows[plan])
    # `before` and `after` sum the information of the poses before and behind k: the plan without k
    for k in itertools.islice(itertools.cycle(range(len(plan))), MAX_EXCHANGE_SWEEPS * len(plan)):
        if k == 0:
            before, after = prior, suffix_information(rows[plan])
        # promising candidates: in place of k they lift the plane, a bound of Phi, above Phi of the plan
        floor, rest = (1 + MIN_EXCHANGE_GAIN) * value, before + after[k + 1]
        promising = np.flatnonzero((Z * M).sum() - useful[plan[k]] + useful > floor)
        # an old plane leaves too many: take it anew at the present M
        if not fresh and len(promising) > STALE_TANGENT_SHARE * len(rows):
            Z, fresh = criterion.tangent(M).Z, True
            useful = sensitivity(rows, Z)
            promising = np.flatnonzero((Z * M).sum() - useful[plan[k]] + useful > floor)
        # exact Phi of the promising ones; if the best is better it replaces k, and all poses are tried again
        reached = criterion.phi_with_candidate(rest, rows[promising]) if len(promising) else np.zeros(1)
        left -= 1
        if reached.max() > floor:
            plan[k], value = promising[reached.argmax()], float(reached.max())
            M = rest + rows[plan[k]].T @ rows[plan[k]]
            left = len(plan)
            fresh = False
        elif left == 0:
            break
        before = before + rows[plan[k]].T @ rows[plan[k]]
    return plan


# --- Local refinement of a plan: from the best candidates to better joint angles, pose after pose -----------

REFINEMENT_NEIGHBOURS, SINGLE_POSE_NEIGHBOURS = 32, 16
"""Neighbours of a pose that `refine_plan` and `improve_single_poses` try in a round."""
REFINEMENT_ROUNDS, SINGLE_POSE_ROUNDS = 22, 14  #: Rounds of `refine_plan` and of `improve_single_poses`.
FIRST_JOINT_STEP, STEP_SHRINKAGE = 0.25, 0.7
"""First standard deviation of a joint's step [rad], and its factor after a round without gain."""
N_CHECKED_NEIGHBOURS = 8  #: Number of the best neighbours of a pose whose feasibility is checked in a round.
MIN_REFINEMENT_GAIN = 1e-6  #: Least relative gain of Phi for which a pose moves to a neighbour [1].
POSES_AT_ONCE = 32  #: Poses of the plan whose neighbours' rows are computed together.

PlanRows = Callable[[Array, Ids], Array]
"""Function of joints (poses, n) [rad, m] and indices in the plan (poses,) to whitened rows (poses, k, r).

Each pose is measured as the plan's pose of this index is, such as under the same load.
"""
WhitenedRows = Callable[[Array, Ids, Array | None], Array]
"""Function of joints (poses, n) [rad, m], indices of loads (poses,) and basis (n, r) to whitened rows.

The rows, (poses, k, r), are per unit of a, where x = basis @ a, or of x itself where the basis is None.
"""
Feasible = Callable[[Array], Mask]
"""Function of joints (poses, n) [rad, m] to whether each pose is feasible, (poses,)."""


@dataclass(frozen=True)
class Feasibility:
    """Hold two checks: of poses that the arm can take, and of motions between two poses."""

    poses_are_feasible: Feasible  #: Function that tells which poses the arm can take and the tracker can see.
    #: Function of two poses, (n,) [rad, m] each, that tells if the arm can move straight between them.
    path_is_clear: Callable[[Array, Array], bool] = lambda _start, _end: True


@dataclass(frozen=True)
class PoseSearch:
    """Describe a search for poses: their readings, number, joint limits and feasibility."""

    whitened_rows: WhitenedRows  #: Function that computes the whitened rows of poses under given loads.
    n_poses: int  #: Number of poses to measure.
    joint_limits: Array  #: Lower and upper joint limits, (2, n) [rad, m].
    feasibility: Feasibility  #: Checks of poses, and of the motions between them.
    rng: np.random.Generator  #: Source of random starts and steps.
    #: Function of poses, (..., n) [rad, m], that sets the dependent joints to follow the others.
    with_dependent_joints: Callable[[Array], Array] = lambda q: q

    def draw_around(self, q: Array, step_deviation: Array) -> Array:
        """Draw poses around others within the joint limits, with normally distributed steps.

        Args:
            q: Actuated joints, (..., n) [rad, m].
            step_deviation: Standard deviation of the step, (..., n) [rad, m]; broadcasts with q.

        Returns:
            Poses, (..., n) [rad, m].
        """
        shape = np.broadcast_shapes(q.shape, step_deviation.shape)
        return self.with_dependent_joints(
            np.clip(q + step_deviation * self.rng.standard_normal(shape), *self.joint_limits)
        )


def refine_plan(
    q: Array, prior_information: Array, criterion: Criterion, rows: PlanRows, search: PoseSearch
) -> Array:
    """Improve the joint angles of every pose of a plan by random local search; Phi never falls.

    Args:
        q: Poses of the plan, (poses, n) [rad, m].
        prior_information: Information of the prior, (r, r) [1].
        criterion: Information function Phi.
        rows: Function that computes whitened rows of poses, each measured as one pose of the plan.
        search: Joint limits, feasibility and source of the steps.

    Returns:
        Improved poses, (poses, n) [rad, m].
    """
    step = np.full(len(q), FIRST_JOINT_STEP)
    read = rows(q, np.arange(len(q)))
    q = q.copy()
    reached = _reach(criterion, add_information(prior_information, read))
    for _ in stepwise(range(REFINEMENT_ROUNDS), "refining poses"):
        before, after = prior_information, suffix_information(read)
        for places in np.array_split(np.arange(len(q)), -(-len(q) // POSES_AT_ONCE)):
            # neighbours of some poses at once, (places, REFINEMENT_NEIGHBOURS, n), and their information
            trials = search.draw_around(
                q[places, None], np.tile(step[places, None, None], (REFINEMENT_NEIGHBOURS, 1))
            )
            seen = rows(trials.reshape(-1, q.shape[1]), np.repeat(places, REFINEMENT_NEIGHBOURS))
            for k, trial, tells in zip(places, trials, np.split(seen, len(places)), strict=True):
                rest = before + after[k + 1]
                # the best feasible neighbour that helps replaces the pose; without one its step shrinks
                better = _better(criterion, reached, read[k], tells, rest)
                allowed = (
                    better[search.feasibility.poses_are_feasible(trial[better])] if len(better) else better
                )
                if len(allowed):
                    q[k], read[k] = trial[allowed[0]], tells[allowed[0]]
                    reached = _reach(criterion, rest + read[k].T @ read[k])
                else:
                    step[k] *= STEP_SHRINKAGE
                before = before + read[k].T @ read[k]
    return q


@dataclass(frozen=True)
class _Reached:
    """Hold how good a plan is, which trials have to beat, and a bound on what they can reach."""

    phi: float  #: Phi(M) of the plan.
    M: Array  #: Its information, (r, r).
    Z: Array  #: Matrix of a tangent at M, (r, r): Phi(M') is no more than <Z, M'>.


def _reach(criterion: Criterion, M: Array) -> _Reached:
    return _Reached(criterion.phi(M), M, criterion.tangent(M).Z)


def _better(criterion: Criterion, reached: _Reached, replaced: Array, rows: Array, others: Array) -> Ids:
    """Find the trials that increase Phi in place of a pose, the best first, at most `N_CHECKED_NEIGHBOURS`.

    `rows` are those of the trials, (trials, k, r), `replaced` those of the pose, (k, r). `others` is the
    information of the plan without the pose, (r, r). Phi is only computed for trials that the tangent plane
    does not exclude.
    """
    floor, Z = (1 + MIN_REFINEMENT_GAIN) * reached.phi, reached.Z
    without = (Z * reached.M).sum() - sensitivity(replaced[None], Z)
    hopeful = np.flatnonzero(without + sensitivity(rows, Z) > floor)
    if not len(hopeful):
        return hopeful
    values = criterion.phi_with_candidate(others, rows[hopeful])
    first = np.argsort(-values)[:N_CHECKED_NEIGHBOURS]
    return np.asarray(hopeful[first[values[first] > floor]])


def improve_single_poses(q: Array, usefulness: Callable[[Array], Array], search: PoseSearch) -> Array:
    """Improve poses independently by random local search for the largest usefulness of each.

    Args:
        q: Poses to start from, (poses, n) [rad, m].
        usefulness: Function of poses to their usefulness, (k poses, n) to (k poses,): k neighbours of each
            pose, in its order.
        search: Joint limits, feasibility and source of the steps.

    Returns:
        Poses at least as useful as those to start from, (poses, n) [rad, m].
    """
    value = usefulness(q)
    step = np.full(len(q), FIRST_JOINT_STEP)
    q = q.copy()
    for _ in range(SINGLE_POSE_ROUNDS):
        trial = search.draw_around(q, np.tile(step[:, None], (SINGLE_POSE_NEIGHBOURS, 1, 1)))
        # every pose is replaced by its most useful neighbour if that is better and feasible; else its step
        # shrinks
        reached = usefulness(trial.reshape(-1, q.shape[1])).reshape(SINGLE_POSE_NEIGHBOURS, -1)
        best = reached.argmax(axis=0)
        trial, reached = trial[best, np.arange(len(q))], reached.max(axis=0)
        better = np.flatnonzero(reached > (1 + MIN_REFINEMENT_GAIN) * value)
        better = better[search.feasibility.poses_are_feasible(trial[better])] if len(better) else better
        q[better], value[better] = trial[better], reached[better]
        step[np.setdiff1d(np.arange(len(q)), better)] *= STEP_SHRINKAGE
    return q


# --- Where gauges touch: in every pose of a plan, which markers are read and along which axes ---------------


@dataclass(frozen=True)
class Gauges:
    """Describe the dial gauges that read in every pose: their number and accuracy."""

    count: int  #: Number of gauges in a pose, each at a different marker.
    sigma: float  #: Standard deviation of one reading [m].
    tilt_deviation: float  #: Standard deviation of a direction about each axis across it [rad].


@dataclass(frozen=True)
class GaugePlan:
    """Hold chosen poses, with the marker and the axis that every gauge reads in them."""

    pose_index: Ids  #: Indices of the poses among the candidates, (poses,).
    marker: Ids  #: Index of the marker that every gauge reads, (poses, gauges).
    axis: Ids  #: World axis along which every gauge reads, 0 to 2 for x, y, z, (poses, gauges).
    information: Array  #: Information matrix M of all readings, prior included, (r, r) [1].


def gauge_rows(spec: PlanSpecification, q: Array, load_index: Ids, gauges: Gauges, lift: Array) -> Array:
    """Compute whitened rows of a gauge at every marker along every world axis.

    The row of axis u is the deflection along u over its noise sqrt(2 sigma^2 + tilt^2 |u x d|^2), with d the
    deflection that the prior expects.

    Args:
        spec: Specification of the plan, with its possible loads.
        q: Actuated joints, (poses, n) [rad, m].
        load_index: Index of every pose's load, (poses,).
        gauges: Noise sigma and tilt of the gauges.
        lift: Unknowns x per unit of the coordinates a, (n, r) [1].

    Returns:
        Rows of the m markers per unit of a, (poses, m, 3, r) [1].
    """
    D = _motions(spec, q, load_index)
    poses, markers = D.shape[:2]
    deviation = _deviations(D @ spec.setup.scaling.expected_x, gauges)
    rows = D.reshape(poses, markers * 3, -1) / deviation.reshape(poses, -1, 1)
    return row_products(rows, lift).reshape(poses, markers, 3, -1)


def _motions(spec: PlanSpecification, q: Array, load: Ids) -> Array:
    """Compute deflections of all markers per unit of x along world axes, (poses, m, 3, n) [m]."""
    D = deflection_rows(spec.setup, q, select_loads(spec, load))  # tool axes
    D = D.reshape(len(q), len(spec.setup.targets), 3, -1)
    return np.asarray(np.einsum("pxy,pmyn->pmxn", tool_poses(spec.setup.vjm, q)[1], D))


def _deviations(d: Array, gauges: Gauges) -> Array:
    """Compute the noise of a gauge along each world axis u at deflections d, (poses, m, 3) [m]."""
    across = (d**2).sum(axis=2, keepdims=True) - d**2  # |u x d|^2
    return np.asarray(np.sqrt(2 * gauges.sigma**2 + gauges.tilt_deviation**2 * across))


@dataclass(frozen=True)
class PlacedGauges:
    """Hold the marker, axis and noise of every gauge reading of a plan, in the order of measuring."""

    gauges: Gauges  #: Number and accuracy of the gauges.
    marker: Ids  #: Index of the marker that every gauge reads, (poses, gauges).
    axis: Ids  #: World axis along which every gauge reads, 0 to 2 for x, y, z, (poses, gauges).
    deviation: Array  #: Standard deviation of every reading, that of the tilt included, (poses, gauges) [m].

    def whitened_rows(self, spec: PlanSpecification, q: Array, load_index: Ids) -> Array:
        """Compute whitened rows of all gauge readings of the plan per unit of a specification's unknowns x.

        Args:
            spec: The plan's specification, or one with other unknowns, prior or loads.
            q: Poses of the plan, (poses, n) [rad, m].
            load_index: Index of every pose's load, (poses,).

        Returns:
            Rows, (poses, gauges, n) [1].
        """
        D = _motions(spec, q, load_index)
        return np.asarray(D[np.arange(len(q))[:, None], self.marker, self.axis] / self.deviation[..., None])


def collect_placed_gauges(
    spec: PlanSpecification, q: Array, load_index: Ids, gauges: Gauges, gauge_plan: GaugePlan
) -> PlacedGauges:
    """Collect marker, axis and standard deviation of every gauge reading of a plan.

    Args:
        spec: Specification of the plan, with its possible loads.
        q: Poses of the plan, (poses, n) [rad, m].
        load_index: Index of every pose's load, (poses,).
        gauges: Number and accuracy of the gauges.
        gauge_plan: Marker and axis of every gauge in these poses.
    """
    d = _motions(spec, q, load_index) @ spec.setup.scaling.expected_x
    index = np.arange(len(q))[:, None], gauge_plan.marker, gauge_plan.axis
    return PlacedGauges(gauges, gauge_plan.marker, gauge_plan.axis, _deviations(d, gauges)[index])


def most_informative_gauges(rows: Array, Z: Array, n_gauges: int) -> tuple[Ids, Ids, Array]:
    """Choose the most sensitive gauges of each pose: every marker's best axis, then the best markers.

    Args:
        rows: Whitened rows of a gauge at every marker along every axis, `gauge_rows`, (poses, m, 3, r) [1].
        Z: Matrix of a tangent plane of Phi, (r, r).
        n_gauges: Number of gauges that are read in a pose.

    Returns:
        Markers and axes, (poses, n_gauges) each, and the sensitivity <Z, F^T F> of the poses with these
        gauges, (poses,).
    """
    sensitivities = sensitivity(rows.reshape(-1, 1, rows.shape[-1]), Z).reshape(rows.shape[:3])
    best = sensitivities.max(axis=2)
    marker = np.sort(np.argsort(-best, axis=1, kind="stable")[:, :n_gauges], axis=1)
    every = np.arange(len(rows))[:, None]
    return marker, sensitivities.argmax(axis=2)[every, marker], best[every, marker].sum(axis=1)


def choose_poses_and_gauges(
    rows: Array, problem: DesignProblem, criterion: Criterion, gauges: Gauges, n_poses: int
) -> GaugePlan:
    """Choose poses, and the gauges in each of them, by exchange over all poses with all choices of gauges.

    Args:
        rows: Whitened rows of a gauge at every marker along every axis in all candidate poses, `gauge_rows`,
            (candidates, m, 3, r) [1].
        problem: Candidates, for the prior's information.
        criterion: Information function Phi.
        gauges: Number and accuracy of the gauges.
        n_poses: Number of poses to measure.

    Returns:
        The poses with their gauges; a pose may occur more than once.

    Raises:
        BenchError: When there are more gauges than markers.
    """
    marker, axis = _gauge_choices(rows.shape[1], gauges.count)
    every = rows[:, marker, axis].reshape(-1, *rows[0][marker, axis].shape[1:])
    chosen = exchange_poses(problem, criterion, every, greedy_plan(problem, criterion, every, n_poses))
    pose, way = np.divmod(np.sort(chosen), len(marker))
    A = every[chosen].reshape(-1, every.shape[-1])
    return GaugePlan(pose, marker[way], axis[way], problem.prior_information + A.T @ A)


def place_gauges(rows: Array, problem: DesignProblem, criterion: Criterion, gauges: Gauges) -> GaugePlan:
    """Choose marker and axis of every gauge in given poses, until no change in a single pose helps.

    Args:
        rows: Whitened rows of a gauge at every marker along every axis, `gauge_rows`, (poses, m, 3, r) [1].
        problem: Candidates, for the prior's information.
        criterion: Information function Phi.
        gauges: Number and accuracy of the gauges.

    Returns:
        The gauges of all poses in order.

    Raises:
        BenchError: When there are more gauges than markers.
    """
    marker, axis = _gauge_choices(rows.shape[1], gauges.count)
    every, poses = rows[:, marker, axis], len(rows)
    M = problem.prior_information
    way = np.full(poses, -1)
    left = poses
    for p in islice(cycle(range(poses)), MAX_EXCHANGE_SWEEPS * poses):
        present = every[p, way[p]] if way[p] >= 0 else np.zeros_like(every[p, 0])
        rest = M - present.T @ present
        reached = criterion.phi_with_candidate(rest, every[p])
        better = way[p] < 0 or reached.max() > (1 + MIN_EXCHANGE_GAIN) * reached[way[p]]
        way[p] = int(reached.argmax()) if better else way[p]
        M = rest + every[p, way[p]].T @ every[p, way[p]]
        left = poses if better else left - 1
        if left == 0:
            break
    return GaugePlan(np.arange(poses), marker[way], axis[way], M)


def _gauge_choices(markers: int, count: int) -> tuple[Ids, Ids]:
    """List markers and axes of all choices of gauges in a pose, (choices, count) each."""
    if not 1 <= count <= markers:
        raise BenchError(f"gauges: expected 1 to {markers}, one per marker, got {count}")
    choices = [(m, a) for m in combinations(range(markers), count) for a in product(range(3), repeat=count)]
    marker, axis = zip(*choices, strict=True)
    return np.array(marker), np.array(axis)
