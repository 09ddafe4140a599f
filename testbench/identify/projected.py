"""Least squares over positive semi-definite blocks: Newton's method on the smoothed projection, with a proof.

At the optimum x is the projection of u = x - unit s onto the cone, s the gradient. Smoothed, eigenvalues w
of U give those of X, (w + sqrt(w^2 + 4 nu)) / 2, and those of unit S, nu over them. Newton's steps in u
follow nu down its path (Chen and Mangasarian 1996; Sun, Sun and Qi 2004), from the optimum without a cone.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dposv

from testbench.errors import Array, Ids
from testbench.identify import cone

PATHS = (
    (1e-2, 1e-3, 1e-5, 1e-8, 1e-13),
    (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-7, 1e-10, 1e-14),
)
"""nu from step to step, in units of x squared: a quick way, and one for those whom it leads nowhere."""
MORE = 8  #: Steps at the end of a path after which it leads nowhere.
CONVERGED = 1e-18  #: Step as a share of x, both squared in the metric of the data, after which it ends.
SINGULAR = 3e-6  #: Least pivot of a matrix over its largest: the root of what Cholesky loses to rounding.
TINY = 1e-300
ROUNDING = 1e-12  #: Share of a trace that an eigenvalue may lie below zero.


@dataclass(frozen=True)
class Start:
    """Where a path begins."""

    u: Array  #: x - unit s, (n,).
    unit: float  #: Size of x over that of s.
    square: float  #: Size of x, squared.
    size: float  #: Size of the cost.


Cost = Callable[[Array], tuple[Array, Array]]
"""Gradient, (n,), and second derivative, (n, n), of a convex cost at x."""


def least_squares(M: Array, r: Array, sizes: tuple[int, ...] = ()) -> tuple[Array, float]:
    """Minimise |M x - r|^2 / 2 over x, svec of blocks of these orders that are positive semi-definite.

    Returns:
        x, (n,), and what its cost is at most above the least: |x . s| + F H^-1 F / 2 for any s in the cone,
        F what the gradient is more than s, H = M^T M. Infinite where nothing is proven.
    """
    H = M.T @ M
    try:
        root = cho_factor(H, lower=True)
    except np.linalg.LinAlgError:
        return np.zeros(H.shape[0]), np.inf
    pivots = np.diag(root[0])
    if pivots.min() <= SINGULAR * pivots.max():
        return np.zeros(len(H)), np.inf
    x, s, cone_ = np.zeros(len(H)), np.zeros(len(H)), cone.groups_of(sizes)
    for _ in range(2):  # the second takes back the rounding of the first
        x -= cho_solve(root, M.T @ (M @ x - r))
    if not _inside(x, cone_, 0.0):
        start = Start(
            u=x,
            unit=float(np.exp(-2 * np.log(pivots).mean())),
            square=max(float(x @ x) / sum(sizes), TINY),
            size=max(float(np.sum((M @ x) ** 2)), TINY),
        )
        with np.errstate(all="ignore"):  # a step that is not finite ends it
            ways = (follow(path, start, lambda x: (M.T @ (M @ x - r), H), cone_) for path in PATHS)
            found = next((way for way in ways if way), None)
        if found is None or not all(_inside(part, cone_, ROUNDING) for part in found):
            return x, np.inf
        x, s = found
    F = M.T @ (M @ x - r) - s
    return x, float(abs(x @ s) + abs(F @ cho_solve(root, F)) / 2)


def _inside(x: Array, groups: list[Ids], share: float) -> bool:
    """Whether all blocks are positive semi-definite, up to a share of their traces."""
    if not np.isfinite(x).all():
        return False
    X = [cone.smat(x[at]) for at in groups]
    return all((np.linalg.eigvalsh(B)[:, 0] >= -share * np.trace(B, axis1=1, axis2=2)).all() for B in X)


def follow(path: Sequence[float], start: Start, cost: Cost, groups: list[Ids]) -> tuple[Array, Array] | None:
    """X and s at the end of a path, None where it leads nowhere."""
    u, unit = start.u.copy(), start.unit
    for k in range(len(path) + MORE):
        product = path[min(k, len(path) - 1)] * start.square
        x, s, K = np.empty_like(u), np.empty_like(u), np.zeros((len(u), len(u)))
        for at in groups:
            w, Q = np.linalg.eigh(cone.smat(u[at]))
            large = (np.abs(w) + np.sqrt(w * w + 4 * product)) / 2
            small = product / large
            p, d = np.where(w > 0, large, small), np.where(w > 0, small, large)
            x[at] = cone.svec((Q * p[:, None]) @ Q.swapaxes(1, 2))
            s[at] = cone.svec((Q * d[:, None]) @ Q.swapaxes(1, 2)) / unit
            i, j = cone.upper(w.shape[1])
            turn = cone.congruence(Q)
            weight = (d[:, i] + d[:, j]) / (p[:, i] + p[:, j]) / unit
            K[at[:, :, None], at[:, None]] = (turn * weight[:, None]) @ turn.swapaxes(1, 2)
        gradient, H = cost(x)
        missing = gradient - s
        if not np.isfinite(missing).all():
            return None
        _, dx, failed = dposv(H + K, -missing, lower=1)
        if failed:  # not positive definite
            return None
        if k >= len(path) - 1 and -missing @ dx <= CONVERGED * start.size:
            return x, s
        u = u + dx - unit * (missing + H @ dx)
    return None
