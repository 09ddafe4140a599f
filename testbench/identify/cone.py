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

from testbench.errors import Array, Ids

SOLVER_TOLERANCE = (
    1e-10  #: Required feasibility and gap of Clarabel, in units where the data are of order one.
)
MAX_RELATIVE_GAP = 1e-6  #: Duality gap, relative to the cost, below which a program counts as solved.

ConeKind = Literal["zero", "nonnegative", "second order", "psd"]
CLARABEL_CONES: dict[ConeKind, Callable[[int], object]] = {
    "zero": clarabel.ZeroConeT,
    "nonnegative": clarabel.NonnegativeConeT,
    "second order": clarabel.SecondOrderConeT,
    "psd": lambda rows: clarabel.PSDTriangleConeT(matrix_order(rows)),
}


@dataclass(frozen=True)
class Block:
    """Hold unknowns of a conic program: the entries of one semi-definite matrix, or free numbers."""

    indices: Ids  #: Their places in v, (k,).
    matrix_order: int = (
        0  #: Order of the symmetric matrix that must be positive semi-definite; 0 for a free block.
    )
    #: svec of that matrix per unit of the unknowns, (size (size + 1) / 2, k); None if they are svec itself.
    svec_per_unknown: Array | None = None


@dataclass(frozen=True)
class ConeConstraint:
    """Hold constraints: b - A v lies in a cone."""

    kind: ConeKind  #: Kind of the cone; for "psd", rows are svec of a matrix.
    A: Array  #: (rows, n).
    b: Array  #: (rows,).


@dataclass(frozen=True)
class ConeProgram:
    """Hold a conic program: its cost, blocks of unknowns and constraints."""

    cost: Array  #: c, (n,).
    blocks: tuple[Block, ...]  #: The unknowns; their places fill 0 to n - 1.
    constraints: tuple[ConeConstraint, ...] = ()  #: All constraints but those of the PSD blocks.
    quadratic_diagonal: Array | None = None  #: Diagonal of P, (n,); None for none.


@dataclass(frozen=True)
class Solution:
    """Hold the solution of a conic program: unknowns, duals, cost and the lower bound that they prove."""

    x: Array  #: The unknowns v, (n,).
    duals: tuple[Array, ...]  #: Dual of every `ConeConstraint`, (rows,) each, then of every PSD block.
    cost: float  #: Cost of x.
    lower_bound: float  #: Lower bound that the duals prove: no feasible v costs less.
    solver_status: str  #: Status as the solver names it.
    seconds: float  #: Time inside the solver.

    @property
    def status(self) -> str:
        """Return "solved" if the cost is within `GAP` of the bound, else the failure."""
        if abs(self.cost - self.lower_bound) <= MAX_RELATIVE_GAP * max(1.0, abs(self.cost)):
            return "solved"
        return self.failure

    @property
    def failure(self) -> str:
        """Return the message for a program that is not solved."""
        return f"not solved: Clarabel says {self.solver_status}"


def solve(problem: ConeProgram, *, tolerance: float = SOLVER_TOLERANCE) -> Solution:
    """Solve a conic program by Clarabel; if the solver stalls, the status reports it.

    Args:
        problem: The program, in units where its data are of order one.
        tolerance: Required feasibility and duality gap [1].

    Returns:
        The last iterate, its duals and status.
    """
    return run_solver(build_solver(problem, clarabel_settings(tolerance)), problem)


def psd_blocks(first_index: int, orders: tuple[int, ...]) -> tuple[Block, ...]:
    """Make positive semi-definite blocks whose svecs follow each other.

    Args:
        first_index: Place of the first unknown.
        orders: Orders of the matrices.

    Returns:
        One block per matrix.
    """
    ends = first_index + np.cumsum([svec_length(size) for size in orders])
    return tuple(
        Block(np.arange(k - svec_length(n), k), n) for k, n in zip(ends.tolist(), orders, strict=True)
    )


def free_block(first_index: int, count: int) -> Block:
    """Make a block of unconstrained unknowns.

    Args:
        first_index: Place of the first unknown.
        count: Number of unknowns.
    """
    return Block(np.arange(first_index, first_index + count))


def norm_constraint(bound_index: int, R: Array, z: Array) -> ConeConstraint:
    """Make the second-order cone |R v - z| <= v[column].

    Args:
        bound_index: Place of the bound among the unknowns.
        R: ConeConstraint, zero in that column, (rows, n).
        z: Right-hand side, (rows,).
    """
    head = np.zeros((1, R.shape[1]))
    head[0, bound_index] = -1
    return ConeConstraint("second order", np.vstack([head, R]), np.r_[0.0, z])


def svec_length(order: int) -> int:
    """Count the entries of the upper triangle of a matrix of some order."""
    return order * (order + 1) // 2


def matrix_order(entries: int) -> int:
    """Compute the order of a matrix from the number of entries of its upper triangle."""
    return (math.isqrt(8 * entries + 1) - 1) // 2


@cache
def upper_triangle(order: int) -> tuple[Ids, Ids]:
    """List rows and columns of the upper triangle of a matrix of some order, by column."""
    column, row = np.tril_indices(order)
    return row, column


def svec(X: Array) -> Array:
    """Pack symmetric matrices, (..., n, n), as upper triangles by column, off-diagonals times sqrt 2."""
    places, scale = _packed(X.shape[-1])
    return np.asarray(X.reshape(*X.shape[:-2], -1).take(places, axis=-1) * scale)


@cache
def _packed(n: int) -> tuple[Ids, Array]:
    """Locate the entries of a svec in its matrix, with their size per unit of the svec, (t,) each."""
    row, column = upper_triangle(n)
    return n * row + column, np.where(row == column, 1.0, math.sqrt(2))


def smat(x: Array) -> Array:
    """Unpack symmetric matrices, (..., n, n), from their svec, (..., n (n + 1) / 2)."""
    places, scale = _unpacked(matrix_order(x.shape[-1]))
    return np.asarray(x.take(places, axis=-1) * scale)


@cache
def _unpacked(n: int) -> tuple[Ids, Array]:
    """Locate the entries of a matrix in its svec, with their size per unit of the svec, (n, n) each."""
    row, column = upper_triangle(n)
    places = np.zeros((n, n), int)
    places[row, column] = places[column, row] = np.arange(len(row))
    return places, np.where(np.eye(n) == 1, 1.0, math.sqrt(0.5))


def cholesky(X: Array) -> Array:
    """Factor matrices, (..., n, n); numbers in closed form, for which LAPACK takes ten times as long.

    Raises:
        LinAlgError: If a matrix is not positive definite.
    """
    if X.shape[-1] > 1:
        return np.asarray(np.linalg.cholesky(X))
    if not (X > 0).all():
        raise np.linalg.LinAlgError
    return np.asarray(np.sqrt(X))


def eigh(X: Array) -> tuple[Array, Array]:
    """Compute eigenvalues, ascending, and eigenvectors of matrices, (..., n, n); numbers in closed form."""
    if X.shape[-1] > 1:
        values, V = np.linalg.eigh(X)
        return values, V
    return X[..., 0], np.ones_like(X)


def eigvalsh(X: Array) -> Array:
    """Compute eigenvalues, ascending, of matrices, (..., n, n); of numbers in closed form."""
    return np.asarray(np.linalg.eigvalsh(X)) if X.shape[-1] > 1 else X[..., 0]


def congruence_map(A: Array) -> Array:
    """Compute the maps svec(Y) -> svec(A Y A^T), (..., t, t), t = n (n + 1) / 2, of A, (..., n, n)."""
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
    """Find the places, (blocks, entries), of the blocks of each order in the svec of all blocks."""
    ends = np.cumsum([svec_length(n) for n in orders])
    return [
        np.array([np.arange(e - svec_length(n), e) for n, e in zip(orders, ends, strict=True) if n == size])
        for size in dict.fromkeys(orders)
    ]


def nearest_psd(X: Array) -> Array:
    """Compute the nearest positive semi-definite matrices, (..., n, n): negative eigenvalues become zero."""
    values, Q = np.linalg.eigh(X)
    return np.asarray((Q * np.maximum(values, 0)[..., None, :]) @ Q.swapaxes(-1, -2))


def clarabel_settings(tolerance: float) -> clarabel.DefaultSettings:
    """Make Clarabel's settings with a tolerance of feasibility and gap [1]."""
    options = clarabel.DefaultSettings()
    options.verbose = False
    options.max_threads = 1
    options.direct_solve_method = "qdldl"  # a fifth faster here than the default, with the same digits
    options.tol_gap_abs = options.tol_gap_rel = options.tol_feas = tolerance
    return options


def build_solver(problem: ConeProgram, options: clarabel.DefaultSettings) -> clarabel.DefaultSolver:
    """Set up Clarabel for a program.

    Args:
        problem: The program.
        options: Clarabel's settings.

    Returns:
        The solver, not yet run.
    """
    from scipy import sparse  # here: it takes long to import, and who uses a model solves no program

    n, rows = len(problem.cost), list(problem.constraints)
    for block in problem.blocks:
        if block.matrix_order:
            A = np.zeros((svec_length(block.matrix_order), n))
            A[:, block.indices] = (
                -np.eye(len(A)) if block.svec_per_unknown is None else -block.svec_per_unknown
            )
            rows.append(ConeConstraint("psd", A, np.zeros(len(A))))
    P = np.zeros(n) if problem.quadratic_diagonal is None else problem.quadratic_diagonal
    return clarabel.DefaultSolver(
        sparse.csc_matrix(np.diag(P)),
        problem.cost,
        sparse.csc_matrix(np.vstack([row.A for row in rows])),
        np.concatenate([row.b for row in rows]),
        [CLARABEL_CONES[row.kind](len(row.b)) for row in rows],
        options,
    )


def run_solver(solver: clarabel.DefaultSolver, problem: ConeProgram) -> Solution:
    """Run Clarabel and collect its solution.

    Args:
        solver: Clarabel, set up with the program.
        problem: The same program.

    Returns:
        The solution: unknowns, (n,), a dual for every cone, cost, lower bound, status and time [s].
    """
    result = solver.solve()
    sizes = [len(row.b) for row in problem.constraints] + [
        svec_length(b.matrix_order) for b in problem.blocks if b.matrix_order
    ]
    ends = np.cumsum(sizes)[:-1]
    return Solution(
        x=np.array(result.x),
        duals=tuple(np.split(np.array(result.z), ends)),
        cost=result.obj_val,
        lower_bound=result.obj_val_dual,
        solver_status=str(result.status),
        seconds=result.solve_time,
    )
