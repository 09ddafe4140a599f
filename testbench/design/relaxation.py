"""The relaxed problem: how much of each candidate, as a number, and what no plan of N poses can exceed.

Weights w >= 0 with sum N instead of N poses make Phi(prior + sum w F^T F) a concave problem. With Z a dual
at any M, Phi of every plan is at most <Z, prior> + N max <Z, F^T F>: the equivalence theorem (Kiefer and
Wolfowitz 1960) read as a bound. Weights climb on a working set of candidates; those that the bound blames for
the gap join it.
"""

from dataclasses import dataclass

import numpy as np

from testbench.design.climb import climb
from testbench.design.criteria import Criterion
from testbench.design.rows import Ids, Problem, times, total
from testbench.errors import Array

FIRST, JOINING = 120, 40  #: Candidates of the first working set, and how many join it in a round.
ROUNDS = 40  #: Most rounds.
GAP = 1e-3  #: Relative gap between value, or its smooth stand-in, and bound at which the relaxation ends.
DROPPED = 1e-6  #: Share of the mean weight below which a candidate leaves the working set.


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
    return np.asarray(np.einsum("pkr,pkr->p", times(rows, Z), rows))


def relax(problem: Problem, criterion: Criterion, poses: int, start: Relaxed | None = None) -> Relaxed:
    """The best weights, to within `GAP`, and the bound; with G and E, not smooth, to within a few per cent.

    The weights' sum is the number of poses. Start from an optimum over fewer candidates; None: even weights.
    """
    S = np.linspace(0, len(problem.rows) - 1, min(FIRST, len(problem.rows))).astype(int)
    S, w = (start.support, start.weights) if start else (S, np.full(len(S), poses / len(S)))
    best: Relaxed | None = None
    for _ in range(ROUNDS):
        w = climb(problem.prior, criterion, problem.rows[S], w)
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


def _exchange_members(g: Array, S: Ids, w: Array) -> tuple[Ids, Array]:
    """Those without weight leave the working set; the most wanted join it, without weight yet."""
    total, stay = w.sum(), w > DROPPED * w.mean()
    new = np.setdiff1d(np.argsort(-g, kind="stable")[:JOINING], S[stay])
    S, w = np.r_[S[stay], new], np.r_[w[stay], np.zeros(len(new))]
    return S, np.asarray(w * total / w.sum())
