"""A dataset boiled down: weighted rows of Eq. (13), reduced by QR in blocks.

Least squares and GCO see a dataset only through F_M, and F_M only through the triangular factor of the
stacked weighted rows: n + 1 numbers squared, however many runs there were.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg.lapack import dtpqrt

from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm, chain, generalised_load, parameter_rows, twist_rows

Ids = npt.NDArray[np.int_]

BLOCK_RUNS = 384  #: Runs reduced at a time: long enough for LAPACK, short enough for the cache.
PANEL = 8  #: Columns that LAPACK eliminates at a time: few, as the blocks are short.
ROUNDING = 1e-12
"""A column below this share of the largest is the rounding of a zero: lever arms that cancel."""
LARGEST = 1e9
"""Largest reading, load or coordinate that can be meant [m, N, N m]; squares of more may overflow."""
RANK_TOLERANCE = 1e-9
"""A singular value below this share of the largest is zero; structural zeros come out at 1e-16."""


@dataclass(frozen=True)
class Term:
    """One term of F_M, Eq. (19): positions or rotations.

    The rows are divided by sqrt(2) sigma sqrt(N), so that F_M is the sum of sqrt(|R pi - z|^2 + rest).
    """

    R: Array  #: Triangular factor of the rows, (n, n).
    z: Array  #: Measured deflections in its coordinates, (n,).
    rest: float  #: What no parameter can explain: squared norm outside the columns' span.
    equations: int  #: Scalar equations behind it.


@dataclass(frozen=True)
class Regression:
    """F_M of a structure on a dataset."""

    structure: Structure  #: The unknowns, n of them.
    terms: tuple[Term, ...]  #: Position term, then the rotation term where orientations are read.
    columns: Array  #: Norm of each parameter's weighted column, (n,): zero where no data touch it.
    weight: Array  #: The same of the diagonal entries of C_theta, (n_theta,) [N/m, N m/rad].
    rank: int  #: Number of directions of pi that the data see.

    @property
    def equations(self) -> int:
        """Scalar equations, 3 a measured point and 3 an orientation."""
        return sum(term.equations for term in self.terms)

    @property
    def f_m_floor(self) -> float:
        """F_M to expect of noise alone: sqrt(3 (1 - rank / equations)) a term."""
        dof = max(0.0, 1 - self.rank / self.equations)
        return len(self.terms) * math.sqrt(3 * dof)


def reduce(vjm: Vjm, structure: Structure, data: Dataset) -> Regression:
    """Boil a dataset down to the triangular factors of its weighted rows; memory does not grow with the runs.

    Raises:
        BenchError: When the dataset is empty or names a marker that the arm lacks.
    """
    if data.runs == 0:
        raise BenchError("dataset: expected at least one run, got none")
    if not data.seen.any():
        raise BenchError(f"dataset: expected readings, every target was lost in all of {data.runs} runs")
    for name in ("before", "after", "wrench", "point"):
        values = getattr(data, name)
        largest = max(values.max(), -values.min())  # np.abs would copy the dataset
        if largest > LARGEST:
            raise BenchError(f"{name}: expected SI numbers up to {LARGEST:g}, got {largest:g}: too large")
    if data.q.shape[1] != vjm.arm.n_joints:
        raise BenchError(f"q: expected {vjm.arm.n_joints} joints, got {data.q.shape[1]}")
    terms = [_reduce_rows(vjm, structure, data, rotation=False)]
    if data.rotation_before is not None:
        terms.append(_reduce_rows(vjm, structure, data, rotation=True))
    return regression_of(structure, tuple(terms))


def regression_of(structure: Structure, terms: tuple[Term, ...]) -> Regression:
    """The regression of terms, at least one, reduced elsewhere."""
    columns = np.sqrt(sum((term.R**2).sum(axis=0) for term in terms))
    columns[columns <= ROUNDING * columns.max()] = 0
    weight = np.zeros(structure.n_theta)
    diagonal = structure.a == structure.b
    weight[structure.a[diagonal]] = columns[diagonal]
    return Regression(
        structure=structure,
        terms=terms,
        columns=columns,
        weight=weight,
        rank=rank(np.vstack([term.R for term in terms])),
    )


def check_symmetric(structure: Structure) -> None:
    """Refuse by BenchError a structure that no Gramian has: one that leaves the symmetry open."""
    if not structure.symmetric:
        raise BenchError(f"GCO: expected a symmetric structure, {structure.name} leaves the symmetry open")


def _reduce_rows(vjm: Vjm, structure: Structure, data: Dataset, *, rotation: bool) -> Term:
    """Fold block after block of runs into the triangular factor of [A | y].

    In the tool's axes the readings of a run are a constant matrix times the twist of the tool. Its QR leaves
    at most six equations a run, however many markers there are; what no rigid tool can do goes to the rest.
    """
    n = structure.n
    sigma = data.sigma_rotation if rotation else data.sigma
    assert sigma is not None
    turned = data.rotation[:, None] if rotation else None
    motion = np.eye(6)[3:] if rotation else marker_motion(marker_points(vjm, data.markers))
    equations = data.runs * len(motion) if rotation else 3 * int(data.seen.sum())
    weight = 1 / (math.sqrt(2) * sigma * math.sqrt(equations / 3))
    Q, G = np.linalg.qr(motion, mode="complete")
    G = G[:6]
    T, rest = np.zeros((n + 1, n + 1), order="F"), 0.0
    for first in range(0, data.runs, BLOCK_RUNS):
        block = slice(first, first + BLOCK_RUNS)
        where = chain(vjm, data.q[block])
        u = generalised_load(where, data.wrench[block], data.point[block])
        y = data.after[block] - data.before[block] if turned is None else turned[block]
        if data.precision is None or rotation:
            J = np.tensordot(weight * G, twist_rows(where), axes=1)
            z = weight * Q.T @ (y @ where.rotation).reshape(len(y), -1).T
        else:
            own, z = _weighted(data.precision[block] / (equations / 3), where.rotation, motion, y)
            J = np.einsum("rkx,xtr->ktr", own, twist_rows(where), optimize=True)
        rest += float((z[len(G) :] ** 2).sum())
        rows = on_a_cache_line((n + 1, len(y)))
        for A, z_k in zip(parameter_rows(structure, J, u), z, strict=False):
            rows[:n], rows[n] = A, z_k
            T = dtpqrt(0, min(PANEL, n + 1), T, rows.T, overwrite_a=True, overwrite_b=True)[0]
    return Term(R=T[:n, :n], z=T[:n, n], rest=float(T[n, n] ** 2) + rest, equations=equations)


def _weighted(precision: Array, rotation: Array, motion: Array, y: Array) -> tuple[Array, Array]:
    """Readings with a covariance each: QR of every run's own weighted motion of the markers.

    Of inverse covariances, (runs, m, 3, 3), rotations from the tool, (runs, 3, 3), the motion of the markers,
    (3 m, 6), and deflections, (runs, m, 3): triangular factors, (runs, k, 6), and the readings in their
    coordinates, k and then those that no rigid tool can do, (3 m, runs).
    """
    runs, m = precision.shape[:2]
    values, V = np.linalg.eigh(precision)
    root = np.sqrt(np.maximum(values, 0))[..., None] * V.swapaxes(2, 3)  # root^T root = precision
    inside = root @ rotation[:, None] @ motion.reshape(m, 3, 6)
    Q, G = np.linalg.qr(inside.reshape(runs, 3 * m, 6), mode="complete")
    readings = (root @ y[..., None]).reshape(runs, 3 * m, 1)
    return G[:, :6], (Q.swapaxes(1, 2) @ readings)[..., 0].T


def on_a_cache_line(shape: tuple[int, int]) -> Array:
    """An array not filled yet that starts on a cache line of 64 bytes: LAPACK is a fifth faster there."""
    size = math.prod(shape)
    memory = np.empty(size + 7)
    first = -memory.ctypes.data % 64 // 8
    return memory[first : first + size].reshape(shape)


def marker_motion(points: Array) -> Array:
    """How markers at (m, 3) [m] move per unit twist of the tool, all in the tool's frame, (3 m, 6) [1, m]."""
    return np.vstack([np.hstack([np.eye(3), np.cross(np.eye(3), point).T]) for point in points])


def marker_points(vjm: Vjm, names: tuple[str, ...]) -> Array:
    """Positions of these markers in the tool's frame, (m, 3) [m]; BenchError when the arm lacks one."""
    have = vjm.arm.markers
    for name in names:
        if name not in have:
            raise BenchError(f"no marker {name!r} in {vjm.arm.name}; markers are {', '.join(have)}")
    return vjm.markers[[have.index(name) for name in names]]


def rank(A: Array) -> int:
    """Rank of a matrix whose columns have unlike units: each is scaled to norm one first."""
    norm = np.linalg.norm(A, axis=0)
    seen = norm > ROUNDING * norm.max(initial=0)
    if not seen.any():
        return 0
    s = np.linalg.svd(A[:, seen] / norm[seen], compute_uv=False)
    return int((s > RANK_TOLERANCE * s[0]).sum())


def f_m(regression: Regression, pi: Array) -> float:
    """Cost F_M of parameters, (n,), Eq. (19): the sum of its terms' RMS over sqrt(2) sigma [1]."""
    return float(sum(_rms(term, pi) for term in regression.terms))


def _rms(term: Term, pi: Array) -> float:
    residual = term.R @ pi - term.z
    return math.sqrt(residual @ residual + term.rest)
