"""GCO of many reduced datasets at once, dense: what `cone` solves one by one, for blocks that are whole.

Every answer is proven by itself, whatever found it: X has to be positive semi-definite, and the cost f is
convex, so that with S its gradient at X no model whose blocks have traces within t costs less than
f(X) - <S, X> - sum max(0, -lambda_min S_i) t_i. With squared residuals, which see all of X, and any S that is
positive semi-definite, F what the gradient is more than S and H the second derivative, none at all costs less
than f(X) - <S, X> - F H^-1 F / 2.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from testbench.errors import Array
from testbench.identify.blocks import Blocks
from testbench.identify.interior import interior
from testbench.identify.linear import factorised
from testbench.identify.objective import Objective
from testbench.identify.smoothing import Start, projected_newton

Mask = npt.NDArray[np.bool_]

TOGETHER = 500_000  #: Entries of the matrices of as many programs as go together: few enough for the cache.
BOLD, CAUTIOUS = 0.9, 0.6  #: Shares of the way to the boundary of a first try and of a second one.
REFINED = 2  #: Steps to least squares without a cone: the second takes back the rounding of the first.
ROOM = 10.0  #: Traces within which norms are proven: so often those found and one that explains all data.
ROUNDING = 1e-12  #: Share of a trace that an eigenvalue may lie below zero.


@dataclass(frozen=True)
class Found:
    """Answers to programs."""

    x: Array  #: Blocks positive semi-definite up to rounding, (B, n).
    gap: Array  #: What the cost is at most above its least value, (B,); infinite where nothing is proven.


def shares(shapes: Sequence[tuple[int, Hashable]]) -> list[list[int]]:
    """Which programs go together: those of one shape, its number of unknowns and whatever else tells it."""
    alike: dict[tuple[int, Hashable], list[int]] = {}
    for k, shape in enumerate(shapes):
        alike.setdefault(shape, []).append(k)
    found = []
    for (n, _), which in alike.items():
        each = max(1, TOGETHER // max(1, n**2))
        found += [which[first : first + each] for first in range(0, len(which), each)]
    return found


def least_norms(objective: Objective, blocks: Blocks, enough: float) -> Found:
    """Minimise sums of norms over positive semi-definite blocks, twice where less is proven than asked."""
    found = _by_interior(objective, blocks, BOLD)
    again = np.flatnonzero(~(found.gap <= enough))
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
    finite: Mask = np.asarray(np.isfinite(x).all(axis=1))
    x = np.where(finite[:, None], x, 0.0)
    X, S = blocks.matrices(x), blocks.matrices(objective.at(x).gradient)
    inside = finite & _inside(blocks, x)
    room = ROOM * (np.trace(X, axis1=2, axis2=3) + X.shape[-1])
    below = np.maximum(0, -np.linalg.eigvalsh(S)[..., 0])
    gap = np.abs((X * S).sum(axis=(1, 2, 3))) + (below * room).sum(axis=1)
    return Found(x, np.where(inside, np.minimum(gap, objective.value(x)), np.inf))  # no norms are below zero


def _inside(blocks: Blocks, x: Array) -> Mask:
    """Which models are positive semi-definite up to rounding, (B,)."""
    X = blocks.matrices(x)
    trace = np.abs(np.diagonal(X, axis1=2, axis2=3)).sum(axis=2)
    return np.asarray((np.linalg.eigvalsh(X)[..., 0] >= -ROUNDING * trace).all(axis=1))


def least_squares(objective: Objective, blocks: Blocks | None) -> Found:
    """Minimise squared residuals that see all of x, over positive semi-definite blocks if there are any.

    Where the optimum without a cone lies inside, it is the answer.
    """
    H = factorised(objective.H[:, 0].copy())
    x, s = np.zeros((2, len(objective.z), objective.R.shape[2]))
    for _ in range(REFINED):
        x -= np.nan_to_num(H.solve(objective.at(x).gradient), posinf=0.0, neginf=0.0)
    proven: Mask = H.firm
    if blocks is not None:
        least = np.linalg.eigvalsh(blocks.matrices(x) + blocks.padding)[..., 0].min(axis=1)
        out = np.flatnonzero(proven & (least < 0))
        if len(out):
            start = Start(x[out], 1 / H.middle[out])
            own, multipliers, good = projected_newton(objective.take(out), blocks, start)
            good = good & np.isfinite(own + multipliers).all(axis=1)
            x[out] = np.where(good[:, None], own, 0.0)
            s[out] = np.where(good[:, None], multipliers, 0.0)
            proven[out] = good & _inside(blocks, x[out]) & _inside(blocks, s[out])
    F = objective.at(x).gradient - s
    gap = np.abs((x * s).sum(axis=1)) + np.abs((F * H.solve(F)).sum(axis=1)) / 2
    return Found(x, np.where(proven, gap, np.inf))
