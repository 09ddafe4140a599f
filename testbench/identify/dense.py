"""GCO of many reduced datasets at once, dense: what `cone` solves one by one, for blocks that are whole.

Every answer is proven by itself, whatever found it. The cost f is convex: with S its gradient at X, no model
whose blocks have traces within t costs less than f(X) - <S, X> - sum max(0, -lambda_min S_i) t_i. With
squared residuals, which see all of X, and any S positive semi-definite, F what the gradient is more than S
and H the second derivative, none at all costs less than f(X) - <S, X> - F H^-1 F / 2.
"""

from dataclasses import dataclass

import numpy as np

from testbench.errors import Array
from testbench.identify.blocks import Blocks
from testbench.identify.interior import interior
from testbench.identify.linear import factorised
from testbench.identify.objective import Objective
from testbench.identify.smoothing import Start, projected_newton

CACHE = 500_000  #: Entries of the matrices of as many programs as go together: few enough for the cache.
BOLD, CAUTIOUS = 0.9, 0.6  #: Shares of the way to the boundary of a first try and of a second one.
REFINED = 2  #: Steps to least squares without a cone: the second takes back the rounding of the first.
ROOM = (
    10.0  #: Traces within which norms are proven least, over those found and one axis that explains all data.
)


@dataclass(frozen=True)
class Found:
    """Answers to programs."""

    x: Array  #: Blocks positive semi-definite up to rounding, (B, n).
    gap: Array  #: What the cost is at most above its least value, (B,); infinite where nothing is proven.


def shares(count: int, n: int) -> list[slice]:
    """Which programs of n unknowns go together."""
    each = max(1, CACHE // n**2)
    return [slice(first, first + each) for first in range(0, count, each)]


def least_norms(objective: Objective, blocks: Blocks, enough: float) -> Found:
    """Minimise sums of norms over positive semi-definite blocks, twice where less is proven than asked."""
    found = _by_interior(objective, blocks, BOLD)
    again = np.flatnonzero(found.gap > enough)
    if len(again):
        second = _by_interior(objective.take(again), blocks, CAUTIOUS)
        better = second.gap < found.gap[again]
        found.x[again[better]], found.gap[again[better]] = second.x[better], second.gap[better]
    return found


def _by_interior(objective: Objective, blocks: Blocks, bold: float) -> Found:
    try:
        x = interior(objective, blocks, bold)
    except np.linalg.LinAlgError:  # a pair lost its last digits
        count, n = len(objective.z), objective.R.shape[2]
        if count == 1:
            return Found(np.zeros((1, n)), np.array([np.inf]))
        each = [_by_interior(objective.take(np.array([k])), blocks, bold) for k in range(count)]
        return Found(np.concatenate([f.x for f in each]), np.concatenate([f.gap for f in each]))
    X, S = blocks.matrices(x), blocks.matrices(objective.at(x).gradient)
    room = ROOM * (np.trace(X, axis1=2, axis2=3) + X.shape[-1])
    below = np.maximum(0, -np.linalg.eigvalsh(S)[..., 0])
    gap = np.abs((X * S).sum(axis=(1, 2, 3))) + (below * room).sum(axis=1)
    return Found(x, np.minimum(gap, objective.value(x)))  # no sum of norms is below zero


def least_squares(objective: Objective, blocks: Blocks | None) -> Found:
    """Minimise squared residuals that see all of x, over positive semi-definite blocks if there are any.

    Where the optimum without a cone lies inside, it is the answer.
    """
    H = factorised(objective.H[:, 0].copy())
    x = np.zeros((len(objective.z), objective.R.shape[2]))
    for _ in range(REFINED):
        x -= np.nan_to_num(H.solve(objective.at(x).gradient))
    s, proven = np.zeros_like(x), H.good.copy()
    if blocks is not None:
        least = np.linalg.eigvalsh(blocks.matrices(x) + blocks.padding)
        out = np.flatnonzero(proven & (least[..., 0].min(axis=1) < 0))
        if len(out):
            start = Start(x[out], 1 / H.middle[out])
            x[out], s[out], proven[out] = projected_newton(objective.take(out), blocks, start)
    F = objective.at(x).gradient - s
    gap = np.abs((x * s).sum(axis=1)) + np.abs((F * H.solve(F)).sum(axis=1)) / 2
    return Found(x, np.where(proven, gap, np.inf))
