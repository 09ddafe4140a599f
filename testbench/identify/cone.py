"""Conic programs: the one place that sets up Clarabel, and the algebra of its cones.

    minimise   1/2 v . P v + c . v   over   b - A v in cones, every PSD block of v positive semi-definite

The unknowns v come as blocks: a symmetric matrix that must be positive semi-definite, or free numbers. The
coordinates of a matrix X are svec(X), its upper triangle by column with off-diagonals times sqrt 2: the
length of svec(X) is the Frobenius norm of X.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Literal

import clarabel
import numpy as np
import numpy.typing as npt
from scipy import sparse

from testbench.errors import Array

TOLERANCE = 1e-10  #: Feasibility and gap asked of Clarabel, in units where the data are of order one.
GAP = 1e-6  #: Duality gap, relative to the cost, below which a program counts as solved.

Ids = npt.NDArray[np.int_]
Kind = Literal["zero", "nonnegative", "second order", "psd"]
CONES: dict[Kind, Callable[[int], object]] = {
    "zero": clarabel.ZeroConeT,
    "nonnegative": clarabel.NonnegativeConeT,
    "second order": clarabel.SecondOrderConeT,
    "psd": lambda rows: clarabel.PSDTriangleConeT(order(rows)),
}


@dataclass(frozen=True)
class Block:
    """Unknowns that belong together."""

    at: Ids  #: Their places in v, (k,).
    size: int = 0  #: Order of the symmetric matrix that must be positive semi-definite; 0 for a free block.
    #: svec of that matrix per unit of the unknowns, (size (size + 1) / 2, k); None where they are it.
    svec: Array | None = None


@dataclass(frozen=True)
class Rows:
    """Constraints b - A v in a cone, or in several of one kind."""

    kind: Kind  #: Of the cone; "psd" holds svec of a matrix.
    A: Array | sparse.csc_matrix  #: (rows, n), dense or sparse.
    b: Array  #: (rows,).
    each: int = 0  #: Rows of each cone, where there are several; 0 for one cone of all rows.


@dataclass(frozen=True)
class Problem:
    """A conic program."""

    cost: Array  #: c, (n,).
    blocks: tuple[Block, ...]  #: The unknowns; their places fill 0 to n - 1.
    rows: tuple[Rows, ...] = ()  #: All constraints but those of the PSD blocks.
    quadratic: sparse.csc_matrix | None = None  #: P, its upper triangle, (n, n); None for none.


@dataclass(frozen=True)
class Solution:
    """What the solver found."""

    x: Array  #: The unknowns v, (n,).
    duals: tuple[Array, ...]  #: Of every `Rows`, in their order, (rows,) each, then of every PSD block.
    cost: float  #: Of x.
    bound: float  #: What the duals prove: no feasible v costs less.
    word: str  #: The solver's own word for how it ended.
    seconds: float  #: Time inside the solver.

    @property
    def gap(self) -> float:
        """Distance between cost and bound."""
        return abs(self.cost - self.bound)

    @property
    def status(self) -> str:
        """Either "solved", where the cost lies within `GAP` of what the duals prove, or what went wrong."""
        if self.gap <= GAP * max(1.0, abs(self.cost)):
            return "solved"
        return self.failure

    @property
    def failure(self) -> str:
        """What is said of a program that is not solved."""
        return f"not solved: Clarabel says {self.word}"


def solve(problem: Problem, *, tolerance: float = TOLERANCE) -> Solution:
    """Solve a conic program; a solver that stalls has found what it found, and the status says so."""
    return solved(set_up(problem, settings(tolerance)), problem)


def psd_block(first: int, size: int) -> Block:
    """A matrix whose svec stands in v from this place on."""
    return Block(np.arange(first, first + triangle(size)), size)


def psd_blocks(first: int, sizes: tuple[int, ...]) -> tuple[Block, ...]:
    """Matrices of these orders, the svec of one behind that of the other."""
    starts = first + np.cumsum([0, *map(triangle, sizes)])
    return tuple(psd_block(int(k), size) for k, size in zip(starts, sizes, strict=False))


def free_block(first: int, count: int) -> Block:
    """So many numbers without a cone, from this place on."""
    return Block(np.arange(first, first + count))


def norm_below(column: int, R: Array, z: Array) -> Rows:
    """|R v - z| <= v[column], for R with a column of zeros there."""
    head = np.zeros((1, R.shape[1]))
    head[0, column] = -1
    return Rows("second order", np.vstack([head, R]), np.r_[0.0, z])


def triangle(size: int) -> int:
    """Number of entries of the upper triangle of a matrix of this order."""
    return size * (size + 1) // 2


def order(entries: int) -> int:
    """Order of the matrix whose upper triangle has so many entries."""
    return (math.isqrt(8 * entries + 1) - 1) // 2


@cache
def upper(size: int) -> tuple[Ids, Ids]:
    """Rows and columns of the upper triangle of a matrix of this order, by column."""
    column, row = np.tril_indices(size)
    return row, column


def svec(X: Array) -> Array:
    """Upper triangles by column, off-diagonals times sqrt 2, of symmetric matrices, (..., n, n)."""
    row, column = upper(X.shape[-1])
    return np.asarray(X[..., row, column] * np.where(row == column, 1, math.sqrt(2)))


def smat(x: Array) -> Array:
    """The symmetric matrices of such triangles, (..., n (n + 1) / 2)."""
    places, scale = _unpacked(order(x.shape[-1]))
    return np.asarray(x.take(places, axis=-1) * scale)


@cache
def _unpacked(n: int) -> tuple[Ids, Array]:
    """Where the entries of a matrix stand in its svec, and their size per unit of that, (n, n) each."""
    row, column = upper(n)
    places = np.zeros((n, n), int)
    places[row, column] = places[column, row] = np.arange(len(row))
    return places, np.where(np.eye(n) == 1, 1.0, math.sqrt(0.5))


def congruence(A: Array) -> Array:
    """The maps svec(Y) -> svec(A Y A^T), (..., t, t), of matrices (..., n, n)."""
    i, j = upper(A.shape[-1])
    diagonal = i == j
    weight = np.where(diagonal, 1.0, math.sqrt(2))[:, None] * np.where(diagonal, 0.5, math.sqrt(0.5))
    row, column = i[:, None], j[:, None]
    both = A[..., row, i] * A[..., column, j] + A[..., row, j] * A[..., column, i]
    return np.asarray(both * weight)


@lru_cache(maxsize=64)
def groups_of(sizes: tuple[int, ...]) -> list[Ids]:
    """Places of the blocks of each order in the svec of all, one behind the other, (blocks, entries)."""
    ends = np.cumsum([triangle(n) for n in sizes])
    return [
        np.array([np.arange(e - triangle(n), e) for n, e in zip(sizes, ends, strict=True) if n == size])
        for size in dict.fromkeys(sizes)
    ]


def psd_part(X: Array) -> Array:
    """The nearest positive semi-definite matrices, (..., n, n): negative eigenvalues are set to zero."""
    values, Q = np.linalg.eigh(X)
    return np.asarray((Q * np.maximum(values, 0)[..., None, :]) @ Q.swapaxes(-1, -2))


def settings(tolerance: float) -> clarabel.DefaultSettings:
    """Of Clarabel."""
    own = clarabel.DefaultSettings()
    own.verbose = False
    own.max_threads = 1
    own.direct_solve_method = "qdldl"  # a fifth faster here than the default, with the same digits
    own.tol_gap_abs = own.tol_gap_rel = own.tol_feas = tolerance
    return own


def set_up(problem: Problem, own: clarabel.DefaultSettings) -> clarabel.DefaultSolver:
    """Clarabel with a program."""
    n = len(problem.cost)
    P = sparse.csc_matrix((n, n)) if problem.quadratic is None else problem.quadratic
    entries, b, cones, first = [], [], [], 0
    for row in problem.rows:
        entries.append(_entries(row.A, first))
        b.append(row.b)
        each = row.each or len(row.b)
        cones += [CONES[row.kind](each) for _ in range(len(row.b) // each)]
        first += len(row.b)
    for block in problem.blocks:
        if block.size:
            size = triangle(block.size)
            i, k, value = _entries(np.eye(size) if block.svec is None else block.svec, first)
            entries.append((i, block.at[k], -value))
            b.append(np.zeros(size))
            cones.append(CONES["psd"](size))
            first += size
    i, k, value = (np.concatenate(part) for part in zip(*entries, strict=True))
    A = sparse.csc_matrix((value, (i, k)), shape=(first, n))
    return clarabel.DefaultSolver(P, problem.cost, A, np.concatenate(b), cones, own)


def _entries(A: Array | sparse.csc_matrix, first: int) -> tuple[Ids, Ids, Array]:
    """Rows, columns and values of what is not zero, the rows counted on from this one."""
    if isinstance(A, np.ndarray):
        i, k = np.nonzero(A)
        return first + i, k, A[i, k]
    coo = A.tocoo()
    return first + np.asarray(coo.row, int), np.asarray(coo.col, int), np.asarray(coo.data, float)


def solved(solver: clarabel.DefaultSolver, problem: Problem) -> Solution:
    """What Clarabel finds of a program that it was set up with."""
    found = solver.solve()
    sizes = [len(row.b) for row in problem.rows] + [triangle(b.size) for b in problem.blocks if b.size]
    ends = np.cumsum(sizes)[:-1]
    return Solution(
        x=np.array(found.x),
        duals=tuple(np.split(np.array(found.z), ends)),
        cost=found.obj_val,
        bound=found.obj_val_dual,
        word=str(found.status),
        seconds=found.solve_time,
    )
