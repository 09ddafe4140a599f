"""The relaxed problem: how much of each candidate, as a number, and what no plan of N poses can exceed.

Weights w >= 0 with sum N instead of N poses make Phi(prior + sum w F^T F) a concave problem. With Z a dual
at any M, Phi of every plan is at most <Z, prior> + N max <Z, F^T F>: the equivalence theorem (Kiefer and
Wolfowitz 1960) read as a bound. The multiplicative algorithm (Silvey, Titterington and Torsney 1978; Yu 2010)
climbs on a working set of candidates; those that the bound blames for the gap join it.
"""

from dataclasses import dataclass

import numpy as np

from testbench.design.criteria import Criterion
from testbench.design.rows import Ids, Problem, total
from testbench.design.squares import squares
from testbench.errors import Array

FIRST, JOINING = 120, 40  #: Candidates of the first working set, and how many join it in a round.
STEPS, ROUNDS = 150, 40  #: Steps of the multiplicative algorithm in a round, and rounds.
POWER, GROW, MOST = 0.5, 1.3, 2.0
"""First exponent of a multiplicative step, and its factor after a step that climbs, up to `MOST`."""
GAP = 2e-3  #: Relative gap between value, or its smooth stand-in, and bound at which the relaxation ends.
DROPPED = 1e-6  #: Share of the mean weight below which a candidate leaves the working set.
ENTRY = 0.02  #: Share of all weight given to those who join.


@dataclass(frozen=True)
class Relaxed:
    """The relaxed optimum."""

    support: Ids  #: Candidates with weight, (s,).
    weights: Array  #: Their weights, the sum is the number of poses, (s,).
    value: float  #: Phi there.
    bound: float  #: No plan of as many poses has more.
    dual: Array  #: Z that proves it, (r, r).


def sensitivity(rows: Array, Z: Array) -> Array:
    """<Z, F^T F> of every candidate, (candidates,)."""
    return np.asarray(((rows @ Z) * rows).sum(axis=(1, 2)))


def relax(problem: Problem, criterion: Criterion, poses: int, start: Relaxed | None = None) -> Relaxed:
    """The best weights, to within `GAP`, and the bound; with G and E, not smooth, to within a few per cent.

    The weights' sum is the number of poses. Start from an optimum over fewer candidates; None: even weights.
    """
    S = np.linspace(0, len(problem.rows) - 1, min(FIRST, len(problem.rows))).astype(int)
    S, w = (start.support, start.weights) if start else (S, np.full(len(S), poses / len(S)))
    best: Relaxed | None = None
    for _ in range(ROUNDS):
        w = _climb(problem, criterion, S, w)
        M = total(problem.prior, np.sqrt(w)[:, None, None] * problem.rows[S])
        plane = criterion.tangent(M)
        g = sensitivity(problem.rows, plane.Z)
        limit = float((plane.Z * problem.prior).sum() + poses * g.max())
        if best is None or limit < best.bound:
            best = Relaxed(S, w, criterion.information(M), limit, plane.Z)
        if limit <= (1 + GAP) * plane.height:
            break
        S, w = _exchange_members(g, S, w)
    assert best is not None
    return best


def _climb(problem: Problem, criterion: Criterion, S: Ids, w: Array) -> Array:
    """Multiplicative steps on the working set: w_i <- w_i g_i^power, scaled to the same sum.

    M and all <Z, F^T F> are products with the squares F^T F.
    """
    every, total, power = squares(problem.rows[S]), w.sum(), POWER
    plane = criterion.tangent(problem.prior + every.total(w))
    for _ in range(STEPS):
        g = every.inner(plane.Z)
        if total * g.max() - w @ g <= GAP / 4 * plane.height:
            break
        while power > 1e-3:
            trial = w * (g / g.max()) ** power
            trial *= total / trial.sum()
            reached = criterion.tangent(problem.prior + every.total(trial))
            if reached.height >= plane.height:
                w, plane, power = trial, reached, min(GROW * power, MOST)
                break
            power /= 2
        else:
            break
    return w


def _exchange_members(g: Array, S: Ids, w: Array) -> tuple[Ids, Array]:
    """Those without weight leave the working set; the most wanted join it."""
    total, stay = w.sum(), w > DROPPED * w.mean()
    wanted = np.argsort(-g, kind="stable")[:JOINING]
    new = np.setdiff1d(wanted, S[stay])
    S, w = S[stay], w[stay]
    if len(new):
        w = np.r_[(1 - ENTRY) * w, np.full(len(new), ENTRY * total / len(new))]
    S = np.r_[S, new]
    return S, np.asarray(w * total / w.sum())
