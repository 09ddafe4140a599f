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
    y: Array  #: Residual over its norm, (B, rows).
    gradient: Array  #: R^T y + c, (B, n).

    def take(self, which: Ids) -> "Point":
        """Of some of the programs."""
        return Point(self.norms[which], self.y[which], self.gradient[which])


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

    def at(self, x: Array) -> Point:
        """Norms and gradient at x, (B, n)."""
        r = (self.R @ x[..., None])[..., 0] - self.z
        if self.squared:
            return Point(np.ones_like(self.rest), r, self.transposed(r) + self.c)
        norms = np.empty_like(self.rest)
        for k, rows in enumerate(self.terms):
            part = r[:, rows]
            norms[:, k] = np.sqrt((part * part).sum(axis=1) + self.rest[:, k] ** 2)
            part /= np.maximum(norms[:, k, None], TINY)
        return Point(norms, r, self.transposed(r) + self.c)

    def transposed(self, y: Array) -> Array:
        """R^T y, (B, n), of (B, rows)."""
        return np.asarray((y[:, None] @ self.R)[:, 0])

    def value(self, x: Array) -> Array:
        """The objective at x, (B,)."""
        point = self.at(x)
        if self.squared:
            return np.asarray((point.y**2).sum(axis=1) / 2 + (x * self.c).sum(axis=1))
        return np.asarray(point.norms.sum(axis=1) + (x * self.c).sum(axis=1))

    def hessian(self, point: Point, tangent: Array) -> "Hessian":
        """Second derivative; without that of a norm along itself where tangent, (B,), is zero."""
        along = np.empty((len(self.z), 0 if self.squared else len(self.terms), self.R.shape[2]))
        for k in range(along.shape[1]):
            rows = self.terms[k]
            along[:, k] = (point.y[:, None, rows] @ self.R[:, rows])[:, 0]
            along[:, k] *= np.sqrt(tangent / np.maximum(point.norms[:, k], TINY))[:, None]
        return Hessian(self.H, 1 / np.maximum(point.norms, TINY), along)

    def take(self, which: Ids) -> "Objective":
        """Some of the programs."""
        R, z, rest, c, H = (_pick(a, which) for a in (self.R, self.z, self.rest, self.c, self.H))
        return replace(self, R=R, z=z, rest=rest, c=c, H=H)


@dataclass(frozen=True)
class Hessian:
    """sum_k share_k H_k - along_k along_k^T."""

    H: Array  #: (B, K, n, n).
    share: Array  #: (B, K).
    along: Array  #: (B, any, n).

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
