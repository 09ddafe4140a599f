"""Conic programs and their solution by Clarabel, and the algebra of symmetric matrices in them.

    minimise   1/2 v . P v + c . v   subject to   b - A v in cones

A cone may be that of positive semi-definite (PSD) matrices. The coordinates of a matrix X are svec(X), its
upper triangle by column with off-diagonals times sqrt 2: the length of svec(X) is the Frobenius norm of X.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Literal

import clarabel
import numpy as np

from testbench.errors import Array, Ids

#: Feasibility and duality gap that Clarabel must reach, in units in which the data are of order one [1].
SOLVER_TOLERANCE = 1e-10
MAX_RELATIVE_GAP = 1e-6  #: Duality gap over the cost up to which a program counts as solved [1].

ConeKind = Literal["zero", "nonnegative", "second order", "psd"]
"""Kind of a cone: zero, non-negative numbers, second order |x_2...| <= x_1, or svec of PSD matrices."""
CLARABEL_CONES: dict[ConeKind, Callable[[int], object]] = {
    "zero": clarabel.ZeroConeT,
    "nonnegative": clarabel.NonnegativeConeT,
    "second order": clarabel.SecondOrderConeT,
    "psd": lambda rows: clarabel.PSDTriangleConeT(matrix_order(rows)),
}


@dataclass(frozen=True)
class ConeConstraint:
    """Hold the constraint that b - A v lies in a cone, with the n unknowns v of a conic program."""

    kind: ConeKind  #: Kind of the cone; for "psd", b - A v is the svec of a matrix.
    A: Array  #: Matrix A, (rows, n).
    b: Array  #: Vector b, (rows,).


@dataclass(frozen=True)
class ConeProgram:
    """Hold a conic program: minimise 1/2 v . P v + c . v over n unknowns v with constraints on cones."""

    cost: Array  #: Linear cost c, (n,).
    constraints: tuple[ConeConstraint, ...]  #: Constraints on the unknowns.
    quadratic_diagonal: Array | None = None  #: Diagonal of P, (n,); None for P = 0.


@dataclass(frozen=True)
class Solution:
    """Hold the solution of a conic program: unknowns, dual variables, cost and its proven lower bound."""

    unknowns: Array  #: The unknowns v, (n,).
    duals: tuple[Array, ...]  #: Dual variables of every `ConeConstraint`, (rows,) each.
    cost: float  #: Cost of the unknowns.
    lower_bound: float  #: Cost that no feasible v can go below, proven by the dual variables.
    solver_status: str  #: Status as the solver names it.
    seconds: float  #: Time inside the solver [s].

    @property
    def status(self) -> str:
        """Return "solved" if the cost is within `MAX_RELATIVE_GAP` of its bound, else the failure."""
        if abs(self.cost - self.lower_bound) <= MAX_RELATIVE_GAP * max(1.0, abs(self.cost)):
            return "solved"
        return self.failure

    @property
    def failure(self) -> str:
        """Return the status of a program that is not solved, with the message of the solver."""
        return f"not solved: Clarabel says {self.solver_status}"


def solve(problem: ConeProgram, *, tolerance: float = SOLVER_TOLERANCE) -> Solution:
    """Solve a conic program by Clarabel.

    Args:
        problem: The program, in units in which its data are of order one.
        tolerance: Feasibility and duality gap to reach [1].

    Returns:
        The last iterate; its status says whether the program is solved.
    """
    from scipy import sparse  # here: it takes long to import, and who uses a model solves no program

    options = clarabel.DefaultSettings()
    options.verbose = False
    options.max_threads = 1
    options.direct_solve_method = "qdldl"  # a fifth faster here than the default, with the same digits
    options.tol_gap_abs = options.tol_gap_rel = options.tol_feas = tolerance
    rows = problem.constraints
    P = np.zeros(len(problem.cost)) if problem.quadratic_diagonal is None else problem.quadratic_diagonal
    result = clarabel.DefaultSolver(
        sparse.csc_matrix(np.diag(P)),
        problem.cost,
        sparse.csc_matrix(np.vstack([row.A for row in rows])),
        np.concatenate([row.b for row in rows]),
        [CLARABEL_CONES[row.kind](len(row.b)) for row in rows],
        options,
    ).solve()
    return Solution(
        unknowns=np.array(result.x),
        duals=tuple(np.split(np.array(result.z), np.cumsum([len(row.b) for row in rows])[:-1])),
        cost=result.obj_val,
        lower_bound=result.obj_val_dual,
        solver_status=str(result.status),
        seconds=result.solve_time,
    )


def psd_constraints(
    orders: tuple[int, ...], svecs_per_unknown: Array, constant_svecs: Array | None = None
) -> tuple[ConeConstraint, ...]:
    """Make the constraints that matrices are positive semi-definite, with their svecs linear in the unknowns.

    Args:
        orders: Orders of the matrices.
        svecs_per_unknown: svecs of all matrices, one after the other, per unit of the unknowns, (entries, n).
        constant_svecs: svecs of all matrices where the unknowns are zero, (entries,); None for zero.

    Returns:
        One constraint per matrix.
    """
    constant = np.zeros(len(svecs_per_unknown)) if constant_svecs is None else constant_svecs
    ends = np.cumsum([svec_length(order) for order in orders])[:-1]
    parts = zip(np.split(svecs_per_unknown, ends), np.split(constant, ends), strict=True)
    return tuple(ConeConstraint("psd", -A, b) for A, b in parts)


def norm_constraint(bound_index: int, R: Array, z: Array) -> ConeConstraint:
    """Make the constraint |R v - z| <= v_k of a conic program with n unknowns v: a second-order cone.

    Args:
        bound_index: Index k of the unknown that bounds the norm.
        R: Matrix R, zero in column k, (rows, n).
        z: Right-hand side, (rows,).
    """
    head = np.zeros((1, R.shape[1]))
    head[0, bound_index] = -1
    return ConeConstraint("second order", np.vstack([head, R]), np.r_[0.0, z])


def svec_length(order: int) -> int:
    """Return the number of entries of the upper triangle of a matrix of order n: n (n + 1) / 2."""
    return order * (order + 1) // 2


def matrix_order(entries: int) -> int:
    """Return the order n of a matrix whose upper triangle has n (n + 1) / 2 entries."""
    return (math.isqrt(8 * entries + 1) - 1) // 2


@cache
def upper_triangle(order: int) -> tuple[Ids, Ids]:
    """List row and column of every entry of the upper triangle of a matrix, by column, (t,) each."""
    column, row = np.tril_indices(order)
    return row, column


def svec(X: Array) -> Array:
    """Pack symmetric matrices, (..., n, n), as vectors of their entries, (..., n (n + 1) / 2).

    Entries are those of the upper triangle by column, off-diagonal ones times sqrt 2.
    """
    places, scale = _packed(X.shape[-1])
    return np.asarray(X.reshape(*X.shape[:-2], -1).take(places, axis=-1) * scale)


@cache
def _packed(n: int) -> tuple[Ids, Array]:
    """Locate the entries of a svec in its matrix, with their size per unit of the svec, (t,) each."""
    row, column = upper_triangle(n)
    return n * row + column, np.where(row == column, 1.0, math.sqrt(2))


def smat(x: Array) -> Array:
    """Unpack symmetric matrices X, (..., n, n), from their entries svec(X), (..., n (n + 1) / 2).

    svec(X) is the upper triangle by column, with off-diagonal entries times sqrt 2.
    """
    places, scale = _unpacked(matrix_order(x.shape[-1]))
    return np.asarray(x.take(places, axis=-1) * scale)


@cache
def _unpacked(n: int) -> tuple[Ids, Array]:
    """Locate the entries of a matrix in its svec, with their size per unit of the svec, (n, n) each."""
    row, column = upper_triangle(n)
    places = np.zeros((n, n), int)
    places[row, column] = places[column, row] = np.arange(len(row))
    return places, np.where(np.eye(n) == 1, 1.0, math.sqrt(0.5))


def congruence_map(A: Array) -> Array:
    """Compute the matrices of the linear maps from svec(Y) to svec(A Y A^T), with Y symmetric.

    svec(Y) is the upper triangle by column, with off-diagonal entries times sqrt 2.

    Args:
        A: Matrices A, (..., n, n).

    Returns:
        Matrices of the maps, (..., t, t), with t = n (n + 1) / 2.
    """
    n = A.shape[-1]
    places, weight = _products(n)
    a, b, c, d = (A.reshape(*A.shape[:-2], n * n).take(place, axis=-1) for place in places)
    return np.asarray((a * b + c * d) * weight)


@cache
def _products(n: int) -> tuple[tuple[Ids, ...], Array]:
    """Locate the factors of both products in a matrix of order n, with the weight of their sum, (t, t)."""
    i, j = upper_triangle(n)
    row, column = n * i[:, None], n * j[:, None]
    weight = np.where(i == j, 1.0, math.sqrt(2))[:, None] * np.where(i == j, 0.5, math.sqrt(0.5))
    return (row + i, column + j, row + j, column + i), weight


@lru_cache(maxsize=64)
def svec_indices_by_order(orders: tuple[int, ...]) -> list[Ids]:
    """Find indices of blocks in the svecs of all blocks one after the other, grouped by order.

    Args:
        orders: Order of every block.

    Returns:
        One array per different order, (blocks of this order, entries of their svec).
    """
    ends = np.cumsum([svec_length(n) for n in orders])
    return [
        np.array([np.arange(e - svec_length(n), e) for n, e in zip(orders, ends, strict=True) if n == size])
        for size in dict.fromkeys(orders)
    ]


def clip_negative_eigenvalues(x: Array, orders: tuple[int, ...]) -> Array:
    """Set negative eigenvalues of positive semi-definite blocks to zero; they are rounding of a solver.

    Args:
        x: svecs of all blocks, one after the other, (n,).
        orders: Orders of the blocks.

    Returns:
        svecs of the nearest positive semi-definite blocks, (n,).
    """
    projected = x.copy()
    for at in svec_indices_by_order(orders):
        projected[at] = svec(nearest_psd(smat(x[at])))
    return projected


def nearest_psd(X: Array) -> Array:
    """Compute the nearest positive semi-definite matrices, (..., n, n): negative eigenvalues become 0."""
    values, Q = np.linalg.eigh(X)
    return np.asarray((Q * np.maximum(values, 0)[..., None, :]) @ Q.swapaxes(-1, -2))
