"""The relaxed design problem: real weights for all candidates, and a bound on every plan of N poses.

Weights w >= 0 with sum N in place of N poses make Phi(prior + sum w F^T F) a concave problem. With Z of a
tangent at any M, Phi of every plan is at most <Z, prior> + N max <Z, F^T F>: the equivalence theorem (Kiefer
and Wolfowitz 1960) read as a bound. Weights climb on a working set of candidates; candidates that the bound
blames for the gap join it.

Where Phi is smooth the weights climb by Newton's method: the best weights of its second-order model solve a
least-squares problem with weights >= 0 (Lawson and Hanson 1974). G and E use the multiplicative algorithm
(Silvey, Titterington and Torsney 1978; Yu 2010), which needs no second derivatives but more steps.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from testbench.design.criteria import Criterion, gram_matrices
from testbench.design.rows import DesignProblem, row_products, sum_information
from testbench.errors import Array, Ids

FIRST, JOINING = 120, 40  #: Candidates of the first working set, and how many join it in a round.
MAX_ROUNDS = 40  #: Most rounds.
GAP = 1e-3  #: Relative gap from Phi, or its smooth stand-in, to the bound at which the relaxation ends [1].
MIN_WEIGHT = 1e-6  #: Share of the mean weight below which a candidate leaves the working set [1].
MAX_STEPS = 150  #: Most multiplicative steps.
POWER, GROW, MAX_EXPONENT = 0.5, 1.3, 2.0
"""First exponent of a multiplicative step, and its factor after a step that climbs, up to `MAX_EXPONENT`."""
ENTRY_SHARE = 0.02  #: Share of all weight given to candidates without any before multiplicative steps [1].
INNER_GAP = 2.5e-4  #: Relative gap within the working set at which multiplicative steps end [1].
RIDGE = 1e-9  #: Ridge on the Newton model's curvature over its mean diagonal [1]; candidates may depend.
EQUALITY_WEIGHT = 1e3  #: Weight of the equation sum w = N over the root of the curvature's mean diagonal [1].
MIN_STEP = 1e-3  #: Least share of a Newton step that is tried [1].


@dataclass(frozen=True)
class Relaxed:
    """Hold the relaxed optimum: weights of candidates, and the bound on all plans with its dual."""

    support: Ids  #: Candidates with weight, (s,).
    weights: Array  #: Their weights, whose sum is the number of poses, (s,).
    bound: float  #: Upper bound on Phi of every plan of as many poses.
    dual: Array  #: Matrix Z of the plane that proves the bound, (r, r).


def sensitivity(rows: Array, Z: Array) -> Array:
    """Compute the sensitivity <Z, F^T F> of every candidate: how much a plane rises with its weight.

    Where Phi is smooth and Z its gradient, this is the derivative of Phi with respect to the weight.

    Args:
        rows: Whitened rows F, (candidates, k, r).
        Z: Matrix of a supporting plane, (r, r).

    Returns:
        Sensitivities, (candidates,).
    """
    return np.asarray(np.einsum("pkr,pkr->p", row_products(rows, Z), rows))


def relax(problem: DesignProblem, criterion: Criterion, poses: int, start: Relaxed | None = None) -> Relaxed:
    """Solve the relaxed problem to within `GAP`, and bound Phi of every plan of as many poses.

    For G and E, which are not smooth, the bound is within a few per cent.

    Mathematics: `pose-8`.

    Args:
        problem: Candidates.
        criterion: Information function.
        poses: Number of poses N, the sum of the weights.
        start: Optimum over fewer candidates to start from; None for even weights.

    Returns:
        The weights with the lowest bound met.
    """
    S = np.linspace(0, len(problem.rows) - 1, min(FIRST, len(problem.rows))).astype(int)
    S, w = (start.support, start.weights) if start else (S, np.full(len(S), poses / len(S)))
    best: Relaxed | None = None
    for _ in range(MAX_ROUNDS):
        # better weights on the working set S
        w = _climb(problem.prior, criterion, problem.rows[S], w)
        M = sum_information(problem.prior, np.sqrt(w)[:, None, None] * problem.rows[S])
        # the bound over all candidates: <Z, prior> + N max <Z, F^T F>
        plane = criterion.tangent(M)
        g = sensitivity(problem.rows, plane.Z)
        limit = float((plane.Z * problem.prior).sum() + poses * g.max())
        if best is None or limit < best.bound:
            best = Relaxed(S, w, limit, plane.Z)
        if limit <= (1 + GAP) * plane.height:
            break
        S, w = _exchange_members(g, S, w)
    assert best is not None
    return best


def _exchange_members(g: Array, S: Ids, w: Array) -> tuple[Ids, Array]:
    """Drop candidates without weight from the working set; add the most sensitive ones at weight zero."""
    total, stay = w.sum(), w > MIN_WEIGHT * w.mean()
    new = np.setdiff1d(np.argsort(-g, kind="stable")[:JOINING], S[stay])
    S, w = np.r_[S[stay], new], np.r_[w[stay], np.zeros(len(new))]
    return S, np.asarray(w * total / w.sum())


def _climb(prior: Array, criterion: Criterion, rows: Array, w: Array) -> Array:
    """Increase Phi(prior + sum w F^T F), by one Newton step or by many multiplicative steps.

    Args:
        prior: Information before any reading, (r, r).
        criterion: Information function.
        rows: Whitened rows of the working set, (candidates, k, r).
        w: Weights, (candidates,).

    Returns:
        Weights of the same sum whose Phi, or its stand-in, is no less, (candidates,).
    """
    every = gram_matrices(rows)
    M = prior + (w @ every).reshape(prior.shape)
    plane = criterion.tangent(M)
    if not plane.bend:
        return _multiply(prior, criterion, every, w)
    # Newton: the best weights of a second-order model, of log Phi for D and of the cost 1 / Phi for a linear
    # criterion; multiplicative steps where there is none
    Z, inverse = plane.Z / plane.height, np.asarray(np.linalg.inv(M))
    try:
        goal = _best_of_model(every @ Z.ravel(), plane.bend * _curvature(rows, every, inverse, Z), w)
    except (np.linalg.LinAlgError, RuntimeError):  # without a prior few poses cost too many digits
        return _multiply(prior, criterion, every, w)
    # halve the step until Phi does not fall
    share = 1.0
    while share > MIN_STEP:
        trial = w + share * (goal - w)
        if criterion.information(prior + (trial @ every).reshape(prior.shape)) >= plane.height:
            return np.asarray(trial)
        share /= 2
    return w


def _curvature(rows: Array, every: Array, I: Array, Z: Array) -> Array:  # noqa: E741
    """Compute <Z, S_i M^-1 S_j> of all pairs of S = F^T F, with I = M^-1, (candidates, candidates)."""
    half = row_products(rows, I).swapaxes(1, 2) @ row_products(rows, Z)
    return np.asarray((half + half.swapaxes(1, 2)).reshape(len(rows), -1) @ every.T / 2)


def _best_of_model(slope: Array, H: Array, w: Array) -> Array:
    """Minimise -slope x + (x - w)^T H (x - w) / 2 over x >= 0 of the same sum as w, (candidates,)."""
    # |L^T x - L^-1 (H w + slope)|^2 is the model but for a constant; one stiff row keeps the sum of x
    size = float(np.trace(H)) / len(H)
    L = np.linalg.cholesky(H + RIDGE * size * np.eye(len(H)))
    stiff = EQUALITY_WEIGHT * np.sqrt(size)
    A, b = np.vstack([L.T, np.full(len(w), stiff)]), np.r_[np.linalg.solve(L, H @ w + slope), stiff * w.sum()]
    x, _ = nnls(A, b)
    return np.asarray(x * w.sum() / x.sum())


def _multiply(prior: Array, criterion: Criterion, every: Array, w: Array) -> Array:
    """Climb by multiplicative steps w_i <- w_i g_i^power, scaled to the same sum, g_i = <Z, F^T F>."""
    total, power, new = w.sum(), POWER, w == 0
    # a weight of zero stays zero under products: give new candidates some
    if new.any():
        w = np.where(new, ENTRY_SHARE * total / new.sum(), (1 - ENTRY_SHARE) * w)
    plane = criterion.tangent(prior + (w @ every).reshape(prior.shape))
    for _ in range(MAX_STEPS):
        g = every @ plane.Z.ravel()
        if total * g.max() - w @ g <= INNER_GAP * plane.height:
            break
        # halve the exponent until the stand-in does not fall; let it grow after a step that climbs
        while power > 1e-3:
            trial = w * (g / g.max()) ** power
            trial *= total / trial.sum()
            reached = criterion.tangent(prior + (trial @ every).reshape(prior.shape))
            if reached.height >= plane.height:
                w, plane, power = trial, reached, min(GROW * power, MAX_EXPONENT)
                break
            power /= 2
        else:
            break
    return w
