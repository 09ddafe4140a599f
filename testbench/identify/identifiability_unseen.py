"""Directions of pi that no reading sees, as a basis that can be put into words.

A null space has no axes of its own. It is searched from the small to the large: one link or joint, then
neighbours along the chain. Elimination with pivots chosen by size gives each find a basis of circuits: a
direction takes the fewest parameters that can trade against each other, all in units of what is expected.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from testbench.errors import Array
from testbench.identify.regression import RANK_TOLERANCE, ROUNDING

Ids = npt.NDArray[np.int_]
Mask = npt.NDArray[np.bool_]

SHARE = 0.15
"""A parameter takes part in a direction if it changes by this share of the one that changes most."""
ZERO = 1e-7  #: Below this share of the largest an entry of a direction is the rounding of a zero.
NEW = 1e-5  #: A direction is new if this share of it lies outside those found before.
NEIGHBOURS = (1, 2, 3, 5)  #: Links and joints along the chain that are searched together, before all are.


@dataclass(frozen=True)
class Direction:
    """Parameters that trade against each other: together they may change, and no reading does."""

    #: Their indices, the one that changes most first, relative to what is expected.
    parameters: tuple[int, ...]
    others: tuple[int, ...]  #: Those that change as well, but less than `SHARE` of it, in the same order.


def null_space(A: Array) -> Array:
    """Basis of what rows, (rows, n), with columns of unlike units do not see, (n, n - rank)."""
    n = A.shape[1]
    seen = np.flatnonzero(~idle(A))
    norm = np.linalg.norm(A, axis=0)
    if not len(seen):
        return np.eye(n)
    triangular: Array = np.asarray(np.linalg.qr(A[:, seen] / norm[seen], mode="r"))
    _, s, Vt = np.linalg.svd(triangular)
    rank = int((s > RANK_TOLERANCE * s[0]).sum())
    N = np.zeros((n, n - rank))
    N[seen, : len(seen) - rank] = Vt[rank:].T / norm[seen, None]
    N[np.setdiff1d(np.arange(n), seen), np.arange(len(seen) - rank, n - rank)] = 1
    return N


def directions(A: Array, unit: Array, groups: Sequence[Ids], known: Array) -> Array:
    """A sparse basis of what a matrix, (rows, n), does not see, beyond what is known, (m, n): (k, n).

    Rows are relative to `unit`, what is expected of every parameter, (n,) [m/N, rad/(N m), rad/N]; `groups`
    has the parameters of every link and joint, in the order of the chain.
    """
    R: Array = np.array(np.linalg.qr(A, mode="r"))
    R[:, idle(A)] = 0
    missing = null_space(R).shape[1] - len(known)
    found = np.zeros((0, A.shape[1]))
    Q = np.linalg.qr(known.T)[0].T  # orthonormal rows: known, then found
    for window in _windows(groups):
        if len(found) >= missing:
            break
        rows = circuits(null_space(R[:, window]), unit[window])
        T = np.zeros((len(rows), A.shape[1]))
        T[:, window] = rows
        for row in T[np.argsort((np.abs(T) > ZERO).sum(axis=1), kind="stable")]:
            new = row / np.linalg.norm(row)
            for _ in range(2):  # twice is enough
                new = new - (Q @ new) @ Q
            if np.linalg.norm(new) > NEW:
                found = np.vstack([found, row])
                Q = np.vstack([Q, new / np.linalg.norm(new)])
    return found


def idle(A: Array) -> Mask:
    """Columns that are zero, up to rounding, (n,)."""
    norm = np.linalg.norm(A, axis=0)
    return np.asarray(norm <= ROUNDING * norm.max(initial=0))


def _windows(groups: Sequence[Ids]) -> Iterator[Ids]:
    for length in NEIGHBOURS:
        for first in range(len(groups) - length + 1):
            yield np.concatenate(groups[first : first + length])
    yield np.concatenate(groups)


def circuits(N: Array, unit: Array) -> Array:
    """Reduced echelon form of a null space, (n, k), pivots by size: (k, n), relative to `unit`, (n,)."""
    T = (N / unit[:, None]).T
    T = T / np.linalg.norm(T, axis=1, keepdims=True)
    pivots: list[int] = []
    for i in range(len(T)):
        size = np.abs(T[i:])
        size[:, pivots] = 0
        row, column = divmod(int(size.argmax()), T.shape[1])
        T[[i, i + row]] = T[[i + row, i]]
        T[i] /= T[i, column]
        others = np.arange(len(T)) != i
        T[others] -= np.outer(T[others, column], T[i])
        pivots.append(column)
    return np.asarray(T)


def direction(row: Array) -> Direction:
    """Who takes part in a direction, (n,)."""
    size = np.abs(row) / np.abs(row).max()
    order = [int(k) for k in np.argsort(-size, kind="stable") if size[k] > ZERO]
    return Direction(tuple(k for k in order if size[k] >= SHARE), tuple(k for k in order if size[k] < SHARE))


def whereabouts(N: Array, within: Array, unit: Array) -> Array:
    """How many directions of N, (n, k + m), beyond those of `within`, (n, m), each parameter holds, (n,)."""
    scaled = (within / unit[:, None], N / unit[:, None])
    inner, outer = (np.linalg.qr(M / np.linalg.norm(M, axis=0))[0] for M in scaled)
    values, V = np.linalg.eigh(np.eye(outer.shape[1]) - outer.T @ inner @ (inner.T @ outer))
    more = outer @ V[:, len(values) - (N.shape[1] - within.shape[1]) :]
    return np.asarray((more**2).sum(axis=1))
