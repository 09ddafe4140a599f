"""Squares F^T F of many rows F: their weighted sum, and what a symmetric matrix makes of each.

Both are products with one matrix of upper triangles, a row for every F.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from testbench.errors import Array

Ids = npt.NDArray[np.int_]


@dataclass(frozen=True)
class Squares:
    """Upper triangles of F^T F, those beside the diagonal twice."""

    row: Ids  #: Of each entry, (r (r + 1) / 2,).
    column: Ids  #: The same.
    packed: Array  #: (count, r (r + 1) / 2).

    def total(self, weights: Array) -> Array:
        """Sum of weights times squares, symmetric, (r, r)."""
        r = self.row[-1] + 1
        half = np.zeros((r, r))
        half[self.row, self.column] = weights @ self.packed / 2
        return np.asarray(half + half.T)

    def inner(self, Z: Array) -> Array:
        """<Z, F^T F> of every F and every symmetric Z, (..., r, r) to (..., count)."""
        return np.asarray(Z[..., self.row, self.column] @ self.packed.T)


def squares(rows: Array) -> Squares:
    """Those of rows (count, k, r)."""
    row, column = np.triu_indices(rows.shape[2])
    twice = np.where(row == column, 1.0, 2.0)
    return Squares(row, column, (rows.swapaxes(1, 2) @ rows)[:, row, column] * twice)
