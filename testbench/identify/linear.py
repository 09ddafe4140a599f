"""Symmetric positive definite systems, one after the other: LAPACK's Cholesky without a copy."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import blas, lapack

from testbench.errors import Array

TINY = 1e-150
SINGULAR = (
    3e-6  #: Least pivot of a firm matrix over its largest: the root of what Cholesky loses to rounding.
)


@dataclass(frozen=True)
class Factors:
    """Triangular factors of some matrices."""

    each: list[Array]  #: Lower ones, (n, n); above the diagonal stands anything.
    good: npt.NDArray[np.bool_]  #: Which of the matrices are positive definite, (B,).

    def solve(self, b: Array) -> Array:
        """Solutions of right sides (B, n); NaN where a matrix is not positive definite."""
        found = np.full(b.shape, np.nan)
        for k in np.flatnonzero(self.good):
            found[k] = lapack.dpotrs(self.each[k], b[k], lower=1)[0]
        return found

    @property
    def firm(self) -> npt.NDArray[np.bool_]:
        """Which of the matrices are so far from singular that solutions can be refined, (B,)."""
        pivots = np.array([np.abs(L.diagonal()) for L in self.each])
        return np.asarray(self.good & (pivots.min(axis=1) > SINGULAR * pivots.max(axis=1)))

    @property
    def middle(self) -> Array:
        """Geometric means of the eigenvalues, (B,); of any size where a matrix is not positive definite."""
        return np.array([np.exp(2 * np.log(np.maximum(L.diagonal(), TINY)).mean()) for L in self.each])


def factorised(A: Array, along: Array | None = None) -> Factors:
    """Factors of A - along^T along for matrices A (B, n, n), which are overwritten, and along (B, any, n)."""
    factors, good = [], np.ones(len(A), dtype=bool)
    for k, matrix in enumerate(A):
        L = matrix.T
        for v in () if along is None else along[k]:
            L = blas.dsyr(-1.0, v, lower=1, a=L, overwrite_a=1)
        L, info = lapack.dpotrf(L, lower=1, clean=0, overwrite_a=1)
        factors.append(L)
        good[k] = info == 0
    return Factors(factors, good)
