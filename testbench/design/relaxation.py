"""The relaxed problem: how much of each candidate, as a number, and what no plan of N poses can exceed.

Weights w >= 0 with sum N instead of N poses make Phi(prior + sum w F^T F) a concave problem. With Z a dual
at any M, Phi of every plan is at most <Z, prior> + N max <Z, F^T F>: the equivalence theorem (Kiefer and
Wolfowitz 1960) read as a bound. Weights climb on a working set of candidates; those that the bound blames for
the gap join it.

Where Phi is smooth they climb by Newton's method: the best weights of its second-order model are a
least-squares problem with weights >= 0 (Lawson and Hanson 1974). Else, as with G and E, by the multiplicative
algorithm (Silvey, Titterington and Torsney 1978; Yu 2010), which needs no second derivatives but more steps.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from testbench.design.criteria import Criterion, squares
from testbench.design.rows import Problem, times, total
from testbench.errors import Array, Ids

FIRST, JOINING = 120, 40  #: Candidates of the first working set, and how many join it in a round.
ROUNDS = 40  #: Most rounds.
GAP = 1e-3  #: Relative gap between value, or its smooth stand-in, and bound at which the relaxation ends.
DROPPED = 1e-6  #: Share of the mean weight below which a candidate leaves the working set.
STEPS = 150  #: Most multiplicative steps.
POWER, GROW, MOST = 0.5, 1.3, 2.0
"""First exponent of a multiplicative step, and its factor after a step that climbs, up to `MOST`."""
ENTRY = 0.02  #: Share of all weight given to those without any before multiplicative steps.
ENOUGH = 2.5e-4  #: Relative gap within the working set at which multiplicative steps end.
RIDGE = 1e-9  #: Of the model's curvature, over the mean of its diagonal: squares may depend on each other.
STIFF = 1e3  #: How much more the sum of the weights counts than the model does.
SHORTEST = 1e-3  #: Least share of a Newton step.


@dataclass(frozen=True)
class Relaxed:
    """The relaxed optimum."""

    support: Ids  #: Candidates with weight, (s,).
    weights: Array  #: Their weights, the sum is the number of poses, (s,).
    bound: float  #: No plan of as many poses has more.
    dual: Array  #: Z that proves it, (r, r).


def sensitivity(rows: Array, Z: Array) -> Array:
    """<Z, F^T F> of every candidate, (candidates,)."""
    return np.asarray(np.einsum("pkr,pkr->p", times(rows, Z), rows))


def relax(problem: Problem, criterion: Criterion, poses: int, start: Relaxed | None = None) -> Relaxed:
    """The best weights, to within `GAP`, and the bound; with G and E, not smooth, to within a few per cent.

    The weights' sum is the number of poses. Start from an optimum over fewer candidates; None: even weights.
    """
    S = np.linspace(0, len(problem.rows) - 1, min(FIRST, len(problem.rows))).astype(int)
    S, w = (start.support, start.weights) if start else (S, np.full(len(S), poses / len(S)))
    best: Relaxed | None = None
    for _ in range(ROUNDS):
        w = _climb(problem.prior, criterion, problem.rows[S], w)
        M = total(problem.prior, np.sqrt(w)[:, None, None] * problem.rows[S])
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
    """Those without weight leave the working set; the most wanted join it, without weight yet."""
    total, stay = w.sum(), w > DROPPED * w.mean()
    new = np.setdiff1d(np.argsort(-g, kind="stable")[:JOINING], S[stay])
    S, w = np.r_[S[stay], new], np.r_[w[stay], np.zeros(len(new))]
    return S, np.asarray(w * total / w.sum())


def _climb(prior: Array, criterion: Criterion, rows: Array, w: Array) -> Array:
    """Weights with no less Phi(prior + sum w F^T F), (candidates,): one Newton or many multiplicative steps.

    Rows are those of the working set, (candidates, k, r).
    """
    every = squares(rows)
    M = prior + (w @ every).reshape(prior.shape)
    plane = criterion.tangent(M)
    if not plane.bend:
        return _multiply(prior, criterion, every, w)
    Z, inverse = plane.Z / plane.height, np.asarray(np.linalg.inv(M))
    try:
        goal = _best_of_model(every @ Z.ravel(), plane.bend * _curvature(rows, every, inverse, Z), w)
    except (np.linalg.LinAlgError, RuntimeError):  # without a prior few poses cost too many digits
        return _multiply(prior, criterion, every, w)
    share = 1.0
    while share > SHORTEST:
        trial = w + share * (goal - w)
        if criterion.information(prior + (trial @ every).reshape(prior.shape)) >= plane.height:
            return np.asarray(trial)
        share /= 2
    return w


def _curvature(rows: Array, every: Array, I: Array, Z: Array) -> Array:  # noqa: E741
    """<Z, S_i M^-1 S_j> of all pairs of squares S = F^T F, I = M^-1, (candidates, candidates)."""
    half = times(rows, I).swapaxes(1, 2) @ times(rows, Z)
    return np.asarray((half + half.swapaxes(1, 2)).reshape(len(rows), -1) @ every.T / 2)


def _best_of_model(slope: Array, H: Array, w: Array) -> Array:
    """Weights x >= 0 of the same sum that make -slope x + (x - w)^T H (x - w) / 2 least, (candidates,)."""
    size = float(np.trace(H)) / len(H)
    L = np.linalg.cholesky(H + RIDGE * size * np.eye(len(H)))
    stiff = STIFF * np.sqrt(size)
    A, b = np.vstack([L.T, np.full(len(w), stiff)]), np.r_[np.linalg.solve(L, H @ w + slope), stiff * w.sum()]
    x, _ = nnls(A, b)
    return np.asarray(x * w.sum() / x.sum())


def _multiply(prior: Array, criterion: Criterion, every: Array, w: Array) -> Array:
    """Steps w_i <- w_i g_i^power, scaled to the same sum, g_i = <Z, F^T F>."""
    total, power, new = w.sum(), POWER, w == 0
    if new.any():
        w = np.where(new, ENTRY * total / new.sum(), (1 - ENTRY) * w)
    plane = criterion.tangent(prior + (w @ every).reshape(prior.shape))
    for _ in range(STEPS):
        g = every @ plane.Z.ravel()
        if total * g.max() - w @ g <= ENOUGH * plane.height:
            break
        while power > 1e-3:
            trial = w * (g / g.max()) ** power
            trial *= total / trial.sum()
            reached = criterion.tangent(prior + (trial @ every).reshape(prior.shape))
            if reached.height >= plane.height:
                w, plane, power = trial, reached, min(GROW * power, MOST)
                break
            power /= 2
        else:
            break
    return w
