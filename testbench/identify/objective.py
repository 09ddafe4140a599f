"""The smooth part of GCO: norms of affine residuals, or one squared, of many programs at once."""

from dataclasses import dataclass, replace

import numpy as np

from testbench.errors import Array
from testbench.identify.regression import Ids

TINY = 1e-300


@dataclass(frozen=True)
class Point:
    """The objective at x."""

    norms: Array  #: tau of every term, (B, K); ones where the residual is squared.
    pulls: Array  #: R_k^T y_k of every term, (B, K, n).
    gradient: Array  #: Their sum and c, (B, n).

    def take(self, which: Ids) -> "Point":
        """Of some of the programs."""
        return Point(self.norms[which], self.pulls[which], self.gradient[which])


@dataclass(frozen=True)
class Objective:
    """sum_k |R_k x - z_k, rest_k| + c . x, or 1/2 |R x - z|^2 + c . x, of B programs of one shape."""

    R: Array  #: Rows of all terms, (B, rows, n).
    z: Array  #: (B, rows).
    rest: Array  #: What no x can change, (B, K).
    c: Array  #: (B, n).
    H: Array  #: R_k^T R_k of every term, (B, K, n, n).
    terms: tuple[slice, ...]  #: Rows of every term, K of them.
    squared: bool = False  #: Whether the one term is 1/2 |R x - z|^2.

    def residual(self, x: Array) -> Array:
        """R x - z, (B, rows)."""
        return np.asarray((self.R @ x[..., None])[..., 0] - self.z)

    def at(self, x: Array) -> Point:
        """Norms and gradient at x, (B, n)."""
        r = self.residual(x)
        norms = np.ones_like(self.rest) if self.squared else self._norms(r)
        pulls = np.empty((*norms.shape, self.R.shape[2]))
        for k, rows in enumerate(self.terms):
            y = r[:, rows] / np.maximum(norms[:, k, None], TINY)
            pulls[:, k] = (y[:, None] @ self.R[:, rows])[:, 0]
        return Point(norms, pulls, pulls.sum(axis=1) + self.c)

    def value(self, x: Array) -> Array:
        """The objective at x, (B,)."""
        r = self.residual(x)
        cost = (r * r).sum(axis=1) / 2 if self.squared else self._norms(r).sum(axis=1)
        return np.asarray(cost + (x * self.c).sum(axis=1))

    def _norms(self, r: Array) -> Array:
        squares = [(r[:, rows] ** 2).sum(axis=1) for rows in self.terms]
        return np.sqrt(np.transpose(squares) + self.rest**2)

    def hessian(self, point: Point, tangent: Array) -> "Hessian":
        """Second derivative of norms; without that of a norm along itself where tangent, (B,), is zero."""
        share = 1 / np.maximum(point.norms, TINY)
        return Hessian(self.H, share, point.pulls * np.sqrt(tangent[:, None] * share)[..., None])

    def take(self, which: Ids) -> "Objective":
        """Some of the programs."""
        R, z, rest, c, H = (_pick(a, which) for a in (self.R, self.z, self.rest, self.c, self.H))
        return replace(self, R=R, z=z, rest=rest, c=c, H=H)


@dataclass(frozen=True)
class Hessian:
    """sum_k share_k H_k - along_k along_k^T."""

    H: Array  #: (B, K, n, n).
    share: Array  #: (B, K).
    along: Array  #: (B, K, n).

    def matrix(self) -> Array:
        """The first sum, (B, n, n)."""
        found = self.H[:, 0] * self.share[:, 0, None, None]
        for k in range(1, self.share.shape[1]):
            found += self.H[:, k] * self.share[:, k, None, None]
        return found

    def times(self, x: Array) -> Array:
        """Product with x, (B, n)."""
        found = -((self.along @ x[..., None]) * self.along).sum(axis=1)
        for k in range(self.share.shape[1]):
            found += self.share[:, k, None] * (self.H[:, k] @ x[..., None])[..., 0]
        return np.asarray(found)


def _pick(a: Array, which: Ids) -> Array:
    """Rows of an array; what all programs share stays shared."""
    return np.broadcast_to(a[0], (len(which), *a.shape[1:])) if a.strides[0] == 0 else a[which]
