"""Positive semi-definite blocks as arrays: svec coordinates of the blocks of many models at once.

Blocks are packed along the diagonals of matrices as large as the largest of them, so that one call takes them
all. Coordinates are those of `cone`: svec of one block behind that of the other.
"""

from functools import lru_cache

import numpy as np

from testbench.errors import Array
from testbench.identify import cone
from testbench.identify.regression import Ids

ROOT2 = np.sqrt(2)


class Blocks:
    """Symmetric matrices of given sizes as the coordinates of one vector; B is any number of models."""

    def __init__(self, sizes: tuple[int, ...]) -> None:
        """Index sets of these orders."""
        most = max(sizes)
        rows = _packed(sizes, most)
        bins = max(int(at[0]) for at in rows) // most + 1
        self.degree = sum(sizes)  #: Number of eigenvalues.
        self.n = sum(map(cone.triangle, sizes))  #: Number of coordinates.
        empty = np.setdiff1d(np.arange(bins * most), np.concatenate(rows))
        self.padding = np.zeros((bins, most, most))  #: One on every diagonal that is no row of a block.
        self.padding[empty // most, empty % most, empty % most] = 1
        i, j = np.concatenate([at[np.array(cone.upper(len(at)))] for at in rows], axis=1)
        bin_of, i, j = i // most, i % most, j % most
        self._gather = np.full(self.padding.shape, self.n)  # behind the last coordinate stands a zero
        self._gather[bin_of, i, j] = self._gather[bin_of, j, i] = np.arange(self.n)
        self._scale = np.where(np.eye(most) == 1, 1.0, 1 / ROOT2)
        self._entry = (bin_of * most + i) * most + j
        self._unit = np.where(i == j, 1.0, ROOT2)
        row, column = cone.upper(most)
        diagonal = row == column
        self._triangle = row, column
        pairs = (row, row), (column, column), (row, column), (column, row)
        self._pairs = [a[:, None] * most + b for a, b in pairs]  # of A_ik A_jl + A_il A_jk
        self._weight = np.where(diagonal, 1.0, ROOT2)[:, None] * np.where(diagonal, 0.5, 1 / ROOT2)
        place = self._gather[:, row, column]
        a, b = np.broadcast_arrays(place[:, :, None], place[:, None])
        own = (a < self.n) & (b < self.n)
        self._from, self._to = np.flatnonzero(own), (a * self.n + b)[own]
        self.one = np.where(i == j, 1.0, 0.0)  #: Coordinates of X = 1, (n,).

    def matrices(self, x: Array) -> Array:
        """The matrices of coordinates (B, n), zero in the padding, (B, bins, most, most)."""
        x = np.concatenate([x, np.zeros((len(x), 1))], axis=1)
        return np.asarray(x.take(self._gather, axis=1) * self._scale)

    def vector(self, X: Array) -> Array:
        """Coordinates (B, n) of symmetric matrices (B, bins, most, most)."""
        return np.asarray(X.reshape(len(X), -1).take(self._entry, axis=1) * self._unit)

    def congruence(self, A: Array) -> Array:
        """The maps Y -> A Y A^T in packed coordinates, (B, bins, t, t), of A (B, bins, most, most)."""
        flat = A.reshape(*A.shape[:2], -1)
        ik, jl, il, jk = (flat.take(pair, axis=2) for pair in self._pairs)
        ik *= jl
        il *= jk
        ik += il
        ik *= self._weight
        return ik

    def sandwich(self, Q: Array, E: Array) -> Array:
        """The maps Y -> Q (E o (Q^T Y Q)) Q^T in packed coordinates, of Q and E (B, bins, most, most)."""
        P = self.congruence(Q)
        return np.asarray((P * E[..., None, *self._triangle]) @ P.swapaxes(-1, -2))

    def add(self, H: Array, K: Array) -> None:
        """Add maps in packed coordinates, (B, bins, t, t), to matrices in coordinates, (B, n, n)."""
        H.reshape(len(H), -1)[:, self._to] += K.reshape(len(K), -1).take(self._from, axis=1)


@lru_cache(maxsize=64)
def blocks_of(sizes: tuple[int, ...]) -> Blocks:
    """The index sets of these orders, made once."""
    return Blocks(sizes)


def _packed(sizes: tuple[int, ...], most: int) -> list[Ids]:
    """Rows of every block in matrices of this size, counted on from one matrix to the next: first fit."""
    filled: list[int] = []
    rows = []
    for size in sizes:
        k = next((k for k, used in enumerate(filled) if used + size <= most), len(filled))
        if k == len(filled):
            filled.append(0)
        rows.append(k * most + filled[k] + np.arange(size))
        filled[k] += size
    return rows
