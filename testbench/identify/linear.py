"""Symmetric positive definite systems, one after the other: LAPACK's Cholesky without a copy."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.linalg import blas, lapack

from testbench.errors import Array


def factorised(A: Array, along: Array) -> tuple[Callable[[Array], Array], npt.NDArray[np.bool_]]:
    """Factors of A - along^T along.

    Args:
        A: Symmetric matrices, (B, n, n); overwritten.
        along: (B, any, n).

    Returns:
        The solution of right sides (B, n), and which of the matrices are positive definite, (B,).
    """
    factors, good = [], np.ones(len(A), dtype=bool)
    for k, matrix in enumerate(A):
        L = matrix.T
        for v in along[k]:
            L = blas.dsyr(-1.0, v, lower=1, a=L, overwrite_a=1)
        L, info = lapack.dpotrf(L, lower=1, clean=0, overwrite_a=1)
        factors.append(L)
        good[k] = info == 0

    def solve(b: Array) -> Array:
        return np.array([lapack.dpotrs(L, v, lower=1)[0] for L, v in zip(factors, b, strict=True)])

    return solve, good
