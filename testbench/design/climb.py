"""Better weights of a working set of candidates, of the same sum: steps of the relaxed problem.

Where Phi is smooth, by Newton's method: the best weights of its second-order model are a least-squares
problem with weights >= 0 (Lawson and Hanson 1974). Else, as with G and E, by the multiplicative algorithm
(Silvey, Titterington and Torsney 1978; Yu 2010), which needs no second derivatives but many more steps.
"""

import numpy as np
from scipy.optimize import nnls

from testbench.design.criteria import Criterion
from testbench.design.rows import times
from testbench.design.squares import Squares, squares
from testbench.errors import Array

STEPS = 150  #: Most multiplicative steps.
POWER, GROW, MOST = 0.5, 1.3, 2.0
"""First exponent of a multiplicative step, and its factor after a step that climbs, up to `MOST`."""
ENTRY = 0.02  #: Share of all weight given to those without any before multiplicative steps.
ENOUGH = 2.5e-4  #: Relative gap within the working set at which multiplicative steps end.
RIDGE = 1e-9  #: Of the model's curvature, over the mean of its diagonal: squares may depend on each other.
STIFF = 1e3  #: How much more the sum of the weights counts than the model does.
SHORTEST = 1e-3  #: Least share of a Newton step.


def climb(prior: Array, criterion: Criterion, rows: Array, w: Array) -> Array:
    """Weights with no less Phi(prior + sum w F^T F), (candidates,): one Newton or many multiplicative steps.

    Rows are those of the working set, (candidates, k, r).
    """
    every = squares(rows)
    M = prior + every.total(w)
    plane = criterion.tangent(M)
    if not plane.bend:
        return _multiply(prior, criterion, every, w)
    Z, inverse = plane.Z / plane.height, np.asarray(np.linalg.inv(M))
    try:
        goal = _best_of_model(every.inner(Z), plane.bend * _curvature(rows, every, inverse, Z), w)
    except (np.linalg.LinAlgError, RuntimeError):  # without a prior few poses cost too many digits
        return _multiply(prior, criterion, every, w)
    share = 1.0
    while share > SHORTEST:
        trial = w + share * (goal - w)
        if criterion.information(prior + every.total(trial)) >= plane.height:
            return np.asarray(trial)
        share /= 2
    return w


def _curvature(rows: Array, every: Squares, I: Array, Z: Array) -> Array:  # noqa: E741
    """<Z, S_i M^-1 S_j> of all pairs of squares S = F^T F, I = M^-1, (candidates, candidates)."""
    half = times(rows, I).swapaxes(1, 2) @ times(rows, Z)
    return np.asarray((half + half.swapaxes(1, 2))[:, every.row, every.column] @ every.packed.T / 2)


def _best_of_model(slope: Array, H: Array, w: Array) -> Array:
    """Weights x >= 0 of the same sum that make -slope x + (x - w)^T H (x - w) / 2 least, (candidates,)."""
    size = float(np.trace(H)) / len(H)
    L = np.linalg.cholesky(H + RIDGE * size * np.eye(len(H)))
    stiff = STIFF * np.sqrt(size)
    A, b = np.vstack([L.T, np.full(len(w), stiff)]), np.r_[np.linalg.solve(L, H @ w + slope), stiff * w.sum()]
    x, _ = nnls(A, b)
    return np.asarray(x * w.sum() / x.sum())


def _multiply(prior: Array, criterion: Criterion, every: Squares, w: Array) -> Array:
    """Steps w_i <- w_i g_i^power, scaled to the same sum, g_i = <Z, F^T F>."""
    total, power, new = w.sum(), POWER, w == 0
    if new.any():
        w = np.where(new, ENTRY * total / new.sum(), (1 - ENTRY) * w)
    plane = criterion.tangent(prior + every.total(w))
    for _ in range(STEPS):
        g = every.inner(plane.Z)
        if total * g.max() - w @ g <= ENOUGH * plane.height:
            break
        while power > 1e-3:
            trial = w * (g / g.max()) ** power
            trial *= total / trial.sum()
            reached = criterion.tangent(prior + every.total(trial))
            if reached.height >= plane.height:
                w, plane, power = trial, reached, min(GROW * power, MOST)
                break
            power /= 2
        else:
            break
    return w
