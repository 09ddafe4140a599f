"""A reduced dataset: the triangular factors of its weighted rows, Eq. (13).

Least squares and GCO need a dataset only through F_M, and F_M only through the triangular factor of the
stacked weighted rows: (n + 1)^2 numbers, whatever the number of runs.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import qr

from testbench.display import Displayed
from testbench.errors import Array, BenchError, Ids
from testbench.identify.absolute.unknowns import compliance_unknowns
from testbench.identify.rows import jacobian, nominal_chain
from testbench.model.load import Load
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

ZERO_COLUMN = 1e-12
"""A column below this share of the largest is the rounding of a zero: lever arms that cancel."""
RANK_TOLERANCE = 1e-9
"""A singular value below this share of the largest is zero; structural zeros come out at 1e-16."""


@dataclass(frozen=True)
class Term:
    """Hold one term of F_M, Eq. (19): positions or rotations.

    The rows are divided by sqrt(2) sigma sqrt(N), so that F_M is the sum of sqrt(|R pi - z|^2 + rest).
    """

    R: Array  #: Triangular factor of the rows, (n, n).
    z: Array  #: Measured deflections in its coordinates, (n,).
    #: Squared norm of the readings outside the columns' span, which no parameter can explain.
    unexplained: float
    equations: int  #: Number of scalar equations.


@dataclass(frozen=True, repr=False)
class Regression(Displayed):
    """Hold F_M of a structure on a dataset, as triangular factors of the weighted equations (13)."""

    structure: Structure  #: The unknowns, n of them.
    terms: tuple[Term, ...]  #: Position term, then the rotation term where orientations are read.
    columns: Array  #: Norm of each parameter's weighted column, (n,): zero where no data touch it.
    weight: Array  #: The same of the diagonal entries of C_theta, (n_theta,) [N/m, N m/rad].
    #: Rows [A | y] of every pose in standard deviations, (k, n + 1) each; empty if they were not requested.
    poses: tuple[Array, ...] = ()
    #: By how much parameters wander from pose to pose, a standard deviation a row, (links, n); None for not.
    wander: Array | None = None

    def about(self) -> dict[str, object]:
        """Summarise the reduced dataset: structure, unknowns, rank and equations."""
        return {
            "structure": self.structure.name,
            "unknowns": self.structure.n,
            "rank": self.rank,
            "equations": self.equations,
        }

    @cached_property
    def rank(self) -> int:
        """Count the directions of pi that the data observe."""
        return rank(np.vstack([term.R for term in self.terms]))

    @cached_property
    def rows(self) -> tuple[Array, Array]:
        """Return A, (r, n), and y, (r,), in standard deviations: A pi - y has noise of deviation 1."""
        every = [math.sqrt(term.equations / 3) * np.c_[term.R, term.z] for term in self.terms]
        A, y = np.split(np.vstack(every), [self.structure.n], axis=1)
        return A, y[:, 0]

    @property
    def equations(self) -> int:
        """Count the scalar equations: 3 per measured point and 3 per orientation."""
        return sum(term.equations for term in self.terms)

    @property
    def f_m_floor(self) -> float:
        """Return the F_M to expect from noise alone: sqrt(3 (1 - rank / equations)) per term [1].

        Mathematics: `est-4`.
        """
        dof = max(0.0, 1 - self.rank / self.equations)
        return len(self.terms) * math.sqrt(3 * dof)


def term_from_triangle(T: Array, rest: float, equations: int) -> Term:
    """Make a term of F_M from the triangular factor of its rows.

    Mathematics: `obs-3`.

    Args:
        T: Triangular factor of the rows [A | y] over sqrt(N), (n + 1, n + 1) [1].
        rest: Squared norm that T does not hold and no parameter explains [1].
        equations: Scalar equations behind it.

    Returns:
        The term.
    """
    return Term(R=T[:-1, :-1], z=T[:-1, -1], unexplained=float(T[-1, -1] ** 2) + rest, equations=equations)


def triangular_factor(rows: Array) -> Array:
    """Compute the triangular factor of rows by QR.

    Args:
        rows: The rows, (rows, n).

    Returns:
        Upper triangular factor R with R^T R = rows^T rows, (n, n).
    """
    R = np.linalg.qr(rows, mode="r")
    T = np.zeros((rows.shape[1],) * 2)
    T[: len(R)] = R
    return T


def regression_of(structure: Structure, terms: tuple[Term, ...]) -> Regression:
    """Make a regression from terms that were reduced elsewhere.

    Args:
        structure: The unknowns, n of them.
        terms: Terms of F_M, at least one.

    Returns:
        The regression, with the column norms of its terms.
    """
    columns = np.sqrt(sum((term.R**2).sum(axis=0) for term in terms))
    columns[columns <= ZERO_COLUMN * columns.max()] = 0
    weight = np.zeros(structure.n_theta)
    diagonal = structure.a == structure.b
    weight[structure.a[diagonal]] = columns[diagonal]
    return Regression(structure, terms, columns, weight)


def restrict_to(regression: Regression, structure: Structure) -> Regression:
    """Restrict a regression to fewer unknowns; all others are rigid.

    Args:
        regression: The reduced dataset.
        structure: Some of its unknowns.

    Returns:
        The regression of the same readings in these unknowns.
    """
    columns = parameter_places(structure, regression.structure)
    parts = ((triangular_factor(np.c_[term.R[:, columns], term.z]), term) for term in regression.terms)
    found = regression_of(
        structure, tuple(term_from_triangle(T, term.unexplained, term.equations) for T, term in parts)
    )
    poses = tuple(rows[:, [*columns, -1]] for rows in regression.poses)
    wander = None if regression.wander is None else regression.wander[:, columns]
    return replace(found, poses=poses, wander=wander)


def parameter_places(structure: Structure, whole: Structure) -> Ids:
    """Find the parameters of a structure among those of a wider one.

    Args:
        structure: The unknowns, n of them.
        whole: A structure that has all of them.

    Returns:
        Place of every parameter, (n,).
    """
    place = {pair: k for k, pair in enumerate(zip(whole.a.tolist(), whole.b.tolist(), strict=True))}
    return np.array([place[pair] for pair in zip(structure.a.tolist(), structure.b.tolist(), strict=True)])


def scatter_to(values: Array, structure: Structure, widest: Structure) -> Array:
    """Put numbers of a structure's parameters at their places among those of a wider structure.

    Args:
        values: Numbers, (..., n).
        structure: The structure, n parameters.
        widest: The wider structure, N parameters.

    Returns:
        The numbers, zero for all other parameters, (..., N).
    """
    every = np.zeros((*values.shape[:-1], widest.n))
    every[..., parameter_places(structure, widest)] = values
    return every


def check_symmetric(structure: Structure) -> None:
    """Check that a structure can be a Gramian.

    Args:
        structure: The structure.

    Raises:
        BenchError: If it does not impose symmetry.
    """
    if not structure.symmetric:
        raise BenchError(f"GCO: expected a symmetric structure, {structure.name} leaves the symmetry open")


def rank(A: Array) -> int:
    """Compute the rank of a matrix whose columns have unlike units: each is scaled to norm one first.

    Mathematics: `obs-4`.

    Args:
        A: The matrix, (rows, n).

    Returns:
        The rank.
    """
    norm = np.linalg.norm(A, axis=0)
    seen = norm > ZERO_COLUMN * norm.max(initial=0)
    if not seen.any():
        return 0
    A = A[:, seen] / norm[seen]
    length = np.linalg.norm(A, axis=1)  # of a few readings most rows of R are rounding
    A = A[length > ZERO_COLUMN * length.max()]
    s = np.linalg.svd(A, compute_uv=False)
    return int((s > RANK_TOLERANCE * s[0]).sum())


def f_m(regression: Regression, pi: Array) -> float:
    """Compute the cost F_M of parameters, Eq. (19): the sum over terms of RMS / (sqrt(2) sigma).

    Mathematics: `est-3`.

    Args:
        regression: The reduced dataset.
        pi: Parameters, (n,) [m/N, rad/(N m), rad/N].

    Returns:
        F_M [1].
    """
    every = ((term.R @ pi - term.z, term.unexplained) for term in regression.terms)
    return float(sum(math.sqrt(residual @ residual + rest) for residual, rest in every))


GENERIC_RUNS = 60  #: Random runs of a full wrench, read in full pose: they see all that any experiment can.


def generic_rows(vjm: Vjm, structure: Structure) -> Array:
    """Compute the observation matrix, Eq. (12), of an experiment that observes all that any experiment can.

    It has random poses within the joint limits, a random full wrench at a random point, and the full pose
    read. Its rank is generic: it does not depend on the draw.

    Args:
        vjm: The arm's virtual joint model.
        structure: The unknowns, n of them.

    Returns:
        Rows of positions, then of rotations, (rows, n) [m, rad per unit of pi].
    """
    rng = np.random.Generator(np.random.Philox(0))
    q = vjm.arm.drawn(rng, GENERIC_RUNS)
    wrench, point = rng.standard_normal((GENERIC_RUNS, 6)), rng.standard_normal((GENERIC_RUNS, 3))
    equilibrium = nominal_chain(vjm, q, [Load(wrench, point)])
    A = jacobian(compliance_unknowns(vjm, structure), equilibrium, vjm.markers, rotations=True)[:, :, :-1]
    return np.concatenate([part.transpose(3, 0, 1, 2).reshape(-1, structure.n) for part in (A[:-1], A[-1:])])


def non_redundant(vjm: Vjm, structure: Structure, *, name: str) -> Structure:
    """Remove the parameters whose columns the others span in every experiment.

    QR with pivoting of a generic observation matrix selects the columns. A removed parameter is zero, and its
    effect is regrouped into the kept ones (Klimchik et al.; Khalil and Gautier's base parameters).

    Mathematics: `obs-6`.

    Args:
        vjm: The arm's virtual joint model.
        structure: The unknowns.
        name: Name of the new structure, such as MLS32.

    Returns:
        The structure of the kept parameters.
    """
    A = generic_rows(vjm, structure)
    A = A / np.linalg.norm(A, axis=0)
    _, order = qr(A, mode="r", pivoting=True)
    return structure.keep(np.sort(order[: rank(A)]), name)
