"""A reduced dataset: the triangular factors of its weighted rows, Eq. (13).

Least squares and GCO need a dataset only through F_M, Eq. (19), and F_M needs only the triangular factor of
the stacked weighted rows [A | y]: (n + 1)^2 numbers, whatever the number of runs. QR folds the rows into
these factors batch by batch, so that memory does not grow with the number of rows.

Rows are reduced group by group, and groups add up. A group is the unit of cross-validation: runs whose pose
is in one fold and whose load is in one fold, or a block of joint space.
"""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from testbench.data.dataset import Dataset, Series, select_rows
from testbench.display import Displayed
from testbench.errors import Array, BenchError, Ids, Mask, check_type
from testbench.identify.absolute.align import (
    POSITION_KINDS,
    Noise,
    combine_repeated_rows,
    equation_kinds_of,
    repeated_rows,
    robust_whitening,
    whitening_matrices,
)
from testbench.identify.absolute.state import ArmState, Unknowns, compliance_unknowns
from testbench.identify.equations import (
    RUNS_PER_BATCH,
    check_runs,
    deflection_equations,
    jacobian,
    resolve_line_readings,
    series_equations,
    undeflected_arm,
)
from testbench.identify.registration import READING_LOSS, HuberLoss
from testbench.model.laws import set_load_history, vjm_for_structure
from testbench.model.load import Load
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

if TYPE_CHECKING:  # scipy takes long to import, and who uses a model needs it not
    from scipy.sparse import csr_array

# --- A reduced dataset: the triangular factors of its weighted rows, Eq. (13) -------------------------------

ZERO_COLUMN_TOLERANCE = 1e-12
"""A column below this share of the largest is the rounding of a zero: lever arms that cancel."""
RANK_TOLERANCE = 1e-9
"""A singular value below this share of the largest is zero; structural zeros come out at 1e-16."""


@dataclass(frozen=True)
class ResidualTerm:
    """Hold one term of F_M, Eq. (19): that of the measured positions, or that of the measured rotations.

    The term is sqrt(|R pi - z|^2 + unexplained). The equations A pi = y are divided by sqrt(2) sigma sqrt(N),
    with N a third of their number; R and z come from their triangular factor, A = Q R.
    """

    R: Array  #: Triangular factor of A, (n, n) [1 per unit of pi].
    z: Array  #: Measured deflections Q^T y, (n,) [1].
    #: Squared norm of the part of y outside the range of A, which no parameter can explain [1].
    unexplained: float
    n_equations: int  #: Number of scalar equations, 3 N.


@dataclass(frozen=True, repr=False)
class Regression(Displayed):
    """Hold the weighted equations A pi = y, Eq. (13), of a dataset, reduced to triangular factors by QR.

    They give F_M, Eq. (19), of any parameters pi of the structure.
    """

    structure: Structure  #: The unknowns, n of them.
    terms: tuple[ResidualTerm, ...]  #: Position term, then the rotation term where orientations are read.
    #: Norm of each parameter's weighted column, (n,) [1 per unit of pi]: zero where it changes no reading.
    column_norms: Array
    #: Norm of the weighted column of each diagonal entry of C_theta, (n_theta,) [N/m, N m/rad].
    diagonal_sensitivity: Array
    #: Rows [A | y] of every pose in standard deviations, (k, n + 1) each; empty if they were not requested.
    rows_by_pose: tuple[Array, ...] = ()
    #: Standard deviation of each link's parameters from pose to pose, (links, n); None if they do not vary.
    pose_variation: Array | None = None

    def summary(self) -> dict[str, object]:
        """Summarise the reduced dataset: structure, unknowns, rank and equations."""
        return {
            "structure": self.structure.name,
            "unknowns": self.structure.n_parameters,
            "rank": self.rank,
            "equations": self.n_equations,
        }

    @cached_property
    def rank(self) -> int:
        """Return the rank: the number of directions of the parameters pi that the readings observe."""
        return rank(np.vstack([term.R for term in self.terms]))

    @cached_property
    def weighted_equations(self) -> tuple[Array, Array]:
        """Return the equations A pi = y, (r, n) and (r,), in standard deviations: their noise is N(0, 1)."""
        every = [math.sqrt(term.n_equations / 3) * np.c_[term.R, term.z] for term in self.terms]
        A, y = np.split(np.vstack(every), [self.structure.n_parameters], axis=1)
        return A, y[:, 0]

    @property
    def n_equations(self) -> int:
        """Count the scalar equations: 3 per measured point and 3 per orientation."""
        return sum(term.n_equations for term in self.terms)

    @property
    def f_m_floor(self) -> float:
        """Compute the F_M to expect from noise alone: sqrt(3 (1 - rank / equations)) summed over terms [1].

        Mathematics: `est-4`.
        """
        dof = max(0.0, 1 - self.rank / self.n_equations)
        return len(self.terms) * math.sqrt(3 * dof)


def term_from_triangle(T: Array, unexplained: float, n_equations: int) -> ResidualTerm:
    """Make a term of F_M from the triangular factor of its rows.

    Mathematics: `obs-3`.

    Args:
        T: Triangular factor of the rows [A | y] over sqrt(N), (n + 1, n + 1) [1].
        unexplained: Squared norm of the readings that is not in T and that no parameter explains [1].
        n_equations: Number of scalar equations, 3 N.
    """
    return ResidualTerm(
        R=T[:-1, :-1], z=T[:-1, -1], unexplained=float(T[-1, -1] ** 2) + unexplained, n_equations=n_equations
    )


def triangular_factor(rows: Array) -> Array:
    """Compute the upper triangular factor R of rows, (rows, n), with R^T R = rows^T rows, (n, n), by QR."""
    R = np.linalg.qr(rows, mode="r")
    T = np.zeros((rows.shape[1],) * 2)
    T[: len(R)] = R
    return T


def regression_from_terms(structure: Structure, terms: tuple[ResidualTerm, ...]) -> Regression:
    """Make a regression from the reduced terms of F_M: positions, and rotations where they are read.

    Args:
        structure: The unknowns, n of them.
        terms: Terms of F_M, at least one.

    Returns:
        The regression; a column norm that is only rounding is zero.
    """
    columns = np.sqrt(sum((term.R**2).sum(axis=0) for term in terms))
    columns[columns <= ZERO_COLUMN_TOLERANCE * columns.max()] = 0
    weight = np.zeros(structure.n_theta)
    diagonal = structure.rows == structure.columns
    weight[structure.rows[diagonal]] = columns[diagonal]
    return Regression(structure, terms, columns, weight)


def restrict_regression(regression: Regression, structure: Structure) -> Regression:
    """Restrict a regression to fewer unknowns; the parameters left out are zero, which is rigid.

    Args:
        regression: The reduced dataset.
        structure: Some of the unknowns of the regression.

    Returns:
        The regression of the same readings in these unknowns.
    """
    columns = structure.indices_in(regression.structure)
    parts = ((triangular_factor(np.c_[term.R[:, columns], term.z]), term) for term in regression.terms)
    restricted = regression_from_terms(
        structure, tuple(term_from_triangle(T, term.unexplained, term.n_equations) for T, term in parts)
    )
    poses = tuple(rows[:, [*columns, -1]] for rows in regression.rows_by_pose)
    pose_variation = None if regression.pose_variation is None else regression.pose_variation[:, columns]
    return replace(restricted, rows_by_pose=poses, pose_variation=pose_variation)


def embed_parameters(values: Array, structure: Structure, wider: Structure) -> Array:
    """Extend the parameters of a structure to a wider structure; the parameters that it adds are zero.

    Args:
        values: One number per parameter of `structure`, such as pi, (..., n).
        structure: The structure, n parameters.
        wider: A structure with all parameters of `structure`, N parameters.

    Returns:
        One number per parameter of `wider`, (..., N).
    """
    every = np.zeros((*values.shape[:-1], wider.n_parameters))
    every[..., structure.indices_in(wider)] = values
    return every


def check_symmetric(structure: Structure) -> None:
    """Check that a structure has symmetric compliance blocks, as C_i = V_i^T V_i of GCO requires.

    Raises:
        BenchError: If the structure does not impose symmetry.
    """
    if not structure.symmetric:
        raise BenchError(f"GCO: expected a symmetric structure, {structure.name} leaves the symmetry open")


def rank(A: Array) -> int:
    """Compute the rank of a matrix, (rows, n), whose columns have unlike units: each is scaled to norm one.

    Mathematics: `obs-4`.
    """
    norm = np.linalg.norm(A, axis=0)
    seen = norm > ZERO_COLUMN_TOLERANCE * norm.max(initial=0)
    if not seen.any():
        return 0
    A = A[:, seen] / norm[seen]
    length = np.linalg.norm(A, axis=1)  # of a few readings most rows of R are rounding
    A = A[length > ZERO_COLUMN_TOLERANCE * length.max()]
    s = np.linalg.svd(A, compute_uv=False)
    return int((s > RANK_TOLERANCE * s[0]).sum())


def f_m(regression: Regression, pi: Array) -> float:
    """Compute the cost F_M of parameters, Eq. (19): RMS residual over sqrt(2) sigma, summed over the terms.

    Mathematics: `est-3`.

    Args:
        regression: The reduced dataset.
        pi: Parameters, (n,) [m/N, rad/(N m), rad/N].

    Returns:
        F_M [1].
    """
    every = ((term.R @ pi - term.z, term.unexplained) for term in regression.terms)
    return float(sum(math.sqrt(residual @ residual + rest) for residual, rest in every))


N_GENERIC_RUNS = 60
"""Number of random runs with a full wrench, read in full pose: they observe all that any experiment can."""


def generic_observation_matrix(vjm: Vjm, structure: Structure) -> Array:
    """Compute the observation matrix, Eq. (12), of an experiment that observes all that any experiment can.

    The experiment has random poses within the joint limits, a random full wrench at a random point, and reads
    the full pose. The rank of the matrix is generic: it does not depend on the draw.

    Args:
        vjm: The arm's virtual joint model.
        structure: The unknowns, n of them.

    Returns:
        Rows of marker positions, then of tool rotations, (rows, n) [m, rad per unit of pi].
    """
    rng = np.random.Generator(np.random.Philox(0))
    q = vjm.arm.draw_poses(rng, N_GENERIC_RUNS)
    wrench, point = rng.standard_normal((N_GENERIC_RUNS, 6)), rng.standard_normal((N_GENERIC_RUNS, 3))
    equilibrium = undeflected_arm(vjm, q, [Load(wrench, point)])
    A = jacobian(compliance_unknowns(vjm, structure), equilibrium, vjm.markers, with_orientation=True)[
        :, :, :-1
    ]
    return np.concatenate(
        [part.transpose(3, 0, 1, 2).reshape(-1, structure.n_parameters) for part in (A[:-1], A[-1:])]
    )


def non_redundant_structure(vjm: Vjm, structure: Structure, *, name: str) -> Structure:
    """Remove the parameters whose columns the others span in every experiment.

    QR with pivoting of a generic observation matrix selects the columns. A removed parameter is zero, and the
    remaining ones take over its effect (Klimchik et al.; Khalil and Gautier's base parameters).

    Mathematics: `obs-6`.

    Args:
        vjm: The arm's virtual joint model.
        structure: The unknowns.
        name: Name of the new structure, such as MLS32.

    Returns:
        The structure of the remaining parameters.
    """
    from scipy.linalg import qr  # here: see above

    A = generic_observation_matrix(vjm, structure)
    A = A / np.linalg.norm(A, axis=0)
    _, order = qr(A, mode="r", pivoting=True)
    return structure.select_parameters(np.sort(order[: rank(A)]), name)


# --- Reduction of readings: rows [A | y] folded by QR into triangular factors, group by group ---------------

MAX_SORTED_RUNS = 16 * RUNS_PER_BATCH
"""Runs that are sorted by their groups at a time: limits memory."""
MAX_NUMBERS_IN_MEMORY = 3_000_000
"""Numbers of the equations of absolute readings that are in memory at a time."""
PANEL_COLUMNS = 16  #: Columns that LAPACK eliminates at a time: few, as the blocks are short.
MIN_SEPARATE_POSES, MAX_SEPARATE_POSES = 4, 60  #: Numbers of poses with `rows_by_pose`.


class TriangularFactors:
    """Hold the triangular factors of rows [A | y]: one per kind of equations and group of runs."""

    def __init__(self, n_columns: int) -> None:
        """Start without rows.

        Args:
            n_columns: Number of columns of [A | y], n + 1.
        """
        self.n_columns = n_columns
        #: Factor by kind and group, (n + 1, n + 1), or all rows where they are fewer.
        self.factors: dict[tuple[int, int], Array] = {}
        #: Number of scalar equations by kind and group.
        self.n_equations: defaultdict[tuple[int, int], int] = defaultdict(int)

    def add_readings(self, A: Array, kinds: Ids, groups: Ids, *, drop_zero_rows: bool = False) -> None:
        """Add whitened rows of some runs to the triangular factors, each to that of its kind and group.

        Args:
            A: Whitened [A | y] of s readings per run, three components each, (s, 3, columns, runs) [1].
            kinds: Kind of the equations of every reading, (s, runs); -1 for a reading that was lost.
            groups: Group of every run, (runs,).
            drop_zero_rows: Whether to leave out rows of zeros, so that they do not count as equations; a
                reading along a line has zeros in place of its other two components.
        """
        lines = A.transpose(2, 1, 0, 3)
        for group in np.unique(groups).tolist():
            kinds_of_group = np.where(groups == group, kinds, -1)
            for kind in np.unique(kinds_of_group[kinds_of_group >= 0]).tolist():
                these = kinds_of_group == kind
                rows = np.flatnonzero(these.any(axis=1))
                block = slice(rows[0], rows[-1] + 1)  # a tenth of the time of a mask, where nothing was lost
                selected = lines[:, :, block if these[block].all() else these].reshape(self.n_columns, -1)
                selected = selected[:, selected.any(axis=0)] if drop_zero_rows else selected
                self.n_equations[kind, group] += selected.shape[1]
                self.add_rows(kind, group, selected)

    def add_rows(self, kind: int, group: int, transposed_rows: Array) -> None:
        """Add whitened rows [A | y] to the triangular factor of one kind and group, by QR.

        Args:
            kind: Kind of the equations.
            group: Number of the group.
            transposed_rows: [A | y]^T, (columns, rows) [1]; its memory is overwritten.
        """
        from scipy.linalg.lapack import dtpqrt  # here: see above

        n, at = self.n_columns, (kind, group)
        T = self.factors.get(at, np.zeros((0, n)))
        if len(T) < n:
            transposed_rows = np.concatenate([T.T, transposed_rows], axis=1)
            if transposed_rows.shape[1] < n:
                self.factors[at] = transposed_rows.T
                return
            T = np.zeros((n, n), order="F")
        panel = min(PANEL_COLUMNS, n)
        self.factors[at] = dtpqrt(0, panel, T, transposed_rows.T, overwrite_a=True, overwrite_b=True)[0]

    def merge(self, other: "TriangularFactors") -> None:
        """Add the equations of other triangular factors to these, kind by kind and group by group.

        Args:
            other: Triangular factors of [A | y] in the same unknowns.
        """
        for at, T in other.factors.items():
            self.add_rows(*at, T.T.copy())
            self.n_equations[at] += other.n_equations[at]

    def factor(self, kind: int, groups: Sequence[int], columns: Ids | slice = slice(None)) -> Array:
        """Compute one triangular factor of all equations of a kind in some groups.

        Args:
            kind: Kind of the equations.
            groups: Numbers of the groups, (groups,).
            columns: Columns of [A | y] that are wanted, (k,).

        Returns:
            Triangular factor, (k, k) [1].
        """
        rows = [self.factors[kind, k][:, columns] for k in groups if (kind, k) in self.factors]
        whole = TriangularFactors(len(np.arange(self.n_columns)[columns]))
        whole.add_rows(0, 0, np.vstack([np.zeros((0, whole.n_columns)), *rows]).T.copy())
        T = whole.factors[0, 0]
        return T if len(T) == whole.n_columns else triangular_factor(T)


@dataclass(frozen=True)
class GroupedRegression:
    """Hold the equations A pi = y of a dataset, reduced by QR to one triangular factor per group of runs.

    A group of runs can be held out as a whole. Positions and orientations have separate factors.
    """

    structure: Structure  #: The unknowns, n of them.
    #: Factors of [A | y] of these unknowns or more, in units of the noise sqrt(2) sigma [1].
    factors: TriangularFactors
    columns: Ids | slice  #: Columns of the unknowns, and of y, in `factors`, (n + 1,).

    @property
    def groups(self) -> Ids:
        """Return the numbers of the groups, ascending, (groups,)."""
        return np.unique([group for _, group in self.factors.factors])

    def select_groups(self, groups: Ids) -> "GroupedRegression":
        """Select the equations of some groups of runs.

        Args:
            groups: Numbers of the groups, some of the property `groups`, (k,).
        """
        kept, wanted = TriangularFactors(self.factors.n_columns), set(groups.tolist())
        kept.factors = {at: T for at, T in self.factors.factors.items() if at[1] in wanted}
        kept.n_equations.update({at: n for at, n in self.factors.n_equations.items() if at[1] in wanted})
        return replace(self, factors=kept)

    def to_regression(self, groups: Ids | None = None) -> Regression:
        """Make one regression of the equations of some groups: rows over sqrt(N), as in F_M, Eq. (19).

        Args:
            groups: Numbers of the groups, some of the property `groups`, (k,); None for all.
        """
        terms, chosen = [], (self.groups if groups is None else groups).tolist()
        for kind in sorted({kind for kind, _ in self.factors.factors}):
            equations = sum(self.factors.n_equations[kind, k] for k in chosen)
            T = self.factors.factor(kind, chosen, self.columns) / math.sqrt(equations / 3)
            terms.append(term_from_triangle(T, 0.0, equations))
        return regression_from_terms(self.structure, tuple(terms))


def reduce(vjm: Vjm, structure: Structure, data: Dataset | Regression) -> Regression:
    """Reduce a dataset to triangular factors of its weighted equations, Eq. (13).

    Memory does not grow with the number of runs.

    Mathematics: `obs-3`.

    Args:
        vjm: The arm's virtual joint model.
        structure: The unknowns, n of them.
        data: The runs, or their reduction for a larger structure.

    Returns:
        The regression: it gives F_M of any parameters of the structure.

    Raises:
        BenchError: When an argument has another type, or the dataset is empty or names a marker that the arm
            lacks.
    """
    check_type(vjm, Vjm, "vjm")
    check_type(structure, Structure, "structure")
    check_type(data, (Dataset, Regression), "data")
    if isinstance(data, Regression):
        return restrict_regression(data, structure)
    [grouped] = reduce_by_group(vjm, [structure], data, np.broadcast_to(0, data.n_runs))
    return with_rows_by_pose(vjm, grouped.to_regression(), data)


def with_rows_by_pose(vjm: Vjm, regression: Regression, data: Dataset) -> Regression:
    """Add the rows [A | y] of every pose to a regression whose structure has joint laws.

    They show how link compliances vary from pose to pose (`pose_to_pose_variation`). They are added to
    datasets of positions only, with `MIN_SEPARATE_POSES` to `MAX_SEPARATE_POSES` poses.

    Args:
        vjm: The arm's virtual joint model.
        regression: The reduced dataset.
        data: The runs of the dataset.

    Returns:
        The regression with `rows_by_pose`; unchanged for all other structures and datasets.
    """
    poses, group = np.unique(data.pose_id, return_inverse=True)
    if (
        not regression.structure.n_laws
        or len(regression.terms) > 1
        or not MIN_SEPARATE_POSES <= len(poses) <= MAX_SEPARATE_POSES
    ):
        return regression
    [grouped] = reduce_by_group(vjm, [regression.structure], data, group)
    factors = grouped.factors.factors
    return replace(regression, rows_by_pose=tuple(factors[at][:, grouped.columns] for at in sorted(factors)))


def reduce_by_group(
    vjm: Vjm, structures: Sequence[Structure], data: Dataset, group: Ids
) -> list[GroupedRegression]:
    """Reduce the weighted equations of a dataset for several structures, group by group of its runs.

    Args:
        vjm: The arm's virtual joint model.
        structures: The unknowns of every model.
        data: The runs.
        group: Group of every run, 0 or more, (runs,); -1 for runs that are left out.

    Returns:
        The equations, one object per structure in order.

    Raises:
        BenchError: When there is no run, a number is too large, or a marker is none of the arm's.
    """
    widest = max(structures, key=lambda s: s.n_parameters)
    # Structures whose unknowns are some of the widest one's share its factors.
    places = [_columns(s, widest) for s in structures]
    separate = [widest, *(s for s, place in zip(structures, places, strict=True) if place is None)]
    unknowns = [compliance_unknowns(vjm_for_structure(vjm, s), s) for s in separate]

    factors = [TriangularFactors(s.n_parameters + 1) for s in separate]
    check_runs(vjm, data)
    data, lines = resolve_line_readings(vjm, data), data.line_direction is not None
    # Rows are made and folded block by block, so that memory does not grow with the runs.
    for these in _blocks_of(group, data.pose_id if lines else np.arange(len(group))):
        load = Load(data.wrench[these], data.point[these])
        chains = {
            v: undeflected_arm(set_load_history(v, data.unloaded_after_load, these), data.q[these], [load])
            for v in {model.vjm for model in unknowns}
        }
        for model, folded in zip(unknowns, factors, strict=True):
            folded.add_readings(
                *deflection_equations(model, chains[model.vjm], data, these, group[these]),
                group[these],
                drop_zero_rows=lines,
            )
    alone = iter(factors[1:])
    return [
        GroupedRegression(s, next(alone), slice(None))
        if place is None
        else GroupedRegression(s, factors[0], place)
        for s, place in zip(structures, places, strict=True)
    ]


def _blocks_of(group: Ids, pose: Ids) -> Iterator[Ids]:
    """Divide runs into batches of about RUNS_PER_BATCH, sorted within some thousand runs at a time."""
    for first in range(0, len(group), MAX_SORTED_RUNS):
        block = slice(first, first + MAX_SORTED_RUNS)
        for these in pose_batches(group[block], pose[block], RUNS_PER_BATCH):
            yield first + these


def pose_batches(group: Ids, pose: Ids, batch_size: int) -> Iterator[Ids]:
    """Yield indices of rows in batches, group by group; rows of one pose stay together.

    Args:
        group: Group of every row, (rows,); rows of group -1 are left out.
        pose: Pose of every row, (rows,).
        batch_size: Approximate number of rows in a batch.

    Yields:
        Indices of the rows of one batch, (k,).
    """
    order = np.lexsort((pose, group))
    order = order[group[order] >= 0]
    poses = np.append(np.flatnonzero(np.r_[True, np.diff(pose[order]) != 0]), len(order))
    wanted = np.append(np.arange(0, len(order), batch_size), len(order))
    for a, b in pairwise(np.unique(poses[np.searchsorted(poses, wanted)]).tolist()):
        yield order[a:b]


def _columns(structure: Structure, widest: Structure) -> Ids | slice | None:
    """Locate a structure's parameters, and the readings, among those of another; None if one is missing."""
    if structure is widest:
        return slice(None)
    alike = (structure.symmetric, structure.n_compliance_rows) == (widest.symmetric, widest.n_compliance_rows)
    places = structure.indices_in(widest)
    return np.append(places, widest.n_parameters) if alike and (places >= 0).all() else None


@dataclass(frozen=True)
class SeriesBlock:
    """Hold the Gram matrices [A | y]^T [A | y] of one series of readings, in one block of joint space."""

    series_index: int  #: Index of the series in the list of all series.
    gram_matrices: Array  #: Gram matrix of every kind of equations, (kinds, size + 1, size + 1) [1].
    n_equations: Array  #: Number of scalar equations of every kind, (kinds,).
    is_plane_face: bool = False  #: Whether the readings are heights over a plane face.


@dataclass(frozen=True)
class ReducedReadings:
    """Hold the whitened equations A x = y of absolute readings as Gram matrices and triangular factors.

    The unknowns x are `size` numbers: frames, mounts, geometry, joint errors and compliances.
    """

    kinds: tuple[int, ...]  #: Kinds of equations that occur, as indices into `EQUATION_KINDS`.
    blocks: tuple[SeriesBlock, ...]  #: Gram matrices, one object per series and block of joint space.
    factors: Mapping[int, Array]  #: Triangular factor of [A | y] by kind, (size + 1, size + 1) [1].

    @cached_property
    def total_gram_matrices(self) -> Array:
        """Return [A | y]^T [A | y] of all equations of every kind, (kinds, size + 1, size + 1) [1]."""
        return sum_gram_matrices(self.blocks)

    def in_basis(self, basis: "csr_array") -> "ReducedReadings":
        """Transform the equations to other unknowns z with x = basis @ z.

        Args:
            basis: Matrix of the transformation, (size, size) [1].

        Returns:
            The equations (A basis) z = y.
        """
        from scipy.sparse import block_diag  # here: see above

        B = block_diag((basis, 1.0), format="csr").T
        grams = [
            np.array([B @ np.asarray(B @ rotated).T for rotated in block.gram_matrices])
            for block in self.blocks
        ]
        blocks = tuple(
            replace(block, gram_matrices=gram) for block, gram in zip(self.blocks, grams, strict=True)
        )
        factors = {kind: np.asarray(B @ R.T).T for kind, R in self.factors.items()}
        return ReducedReadings(self.kinds, blocks, factors)

    @property
    def is_position(self) -> Mask:
        """Return which of the kinds of equations are measured positions, (kinds,)."""
        return np.isin(self.kinds, POSITION_KINDS)

    @property
    def n_equations(self) -> Array:
        """Return the number of scalar equations of each kind of readings, (kinds,)."""
        return np.asarray(sum(part.n_equations for part in self.blocks))


@dataclass(frozen=True)
class Linearisation:
    """Hold the state of the arm where the equations of readings are linearised, and the readings' weights."""

    unknowns: Unknowns  #: Layout of the unknowns.
    state: ArmState  #: Values of the unknowns where the equations are linearised.
    noise: Noise  #: Standard deviations of the readings.
    loss: HuberLoss = READING_LOSS  #: Robust loss that weighs each reading.


def reduce_series(
    linearisation: Linearisation, series: Sequence[Series], blocks: Sequence[Ids] | None = None
) -> ReducedReadings:
    """Reduce absolute readings to Gram matrices and triangular factors, per series and block of joint space.

    Args:
        linearisation: State where the equations are linearised, and weights of the readings.
        series: The readings.
        blocks: Block of joint space of every row of a series, (rows,) each, equal for all rows of a pose;
            None for one block per series.
    """
    blocks = [np.zeros(readings.n_rows, dtype=int) for readings in series] if blocks is None else blocks
    kinds = equation_kinds_of(series)
    parts = []
    whole = TriangularFactors(linearisation.unknowns.size + 1)
    for place, (readings, block) in enumerate(zip(series, blocks, strict=True)):
        for block_number in np.unique(block):
            part = _factors_of_rows(linearisation, readings, np.where(block == block_number, 0, -1))
            factors = [part.factor(kind, [0]) for kind in kinds]
            numbers = 1 if readings.distance is None else 3  # two of three rows of a distance are zero
            counts = np.array([part.n_equations[kind, 0] for kind in kinds]) // numbers
            grams, face = np.array([T.T @ T for T in factors]), readings.plane_normal is not None
            parts.append(SeriesBlock(place, grams, counts, face))
            whole.merge(part)
    return ReducedReadings(kinds, tuple(parts), {kind: whole.factor(kind, [0]) for kind in kinds})


def _factors_of_rows(linearisation: Linearisation, series: Series, group: Ids) -> TriangularFactors:
    """Fold the rows of a series whose group is 0, batch by batch."""
    folded = TriangularFactors(linearisation.unknowns.size + 1)
    numbers = 3 * folded.n_columns * (len(series.markers) + (series.rotation is not None))
    for rows in pose_batches(group, series.pose_id, max(16, MAX_NUMBERS_IN_MEMORY // numbers)):
        A, kinds = whitened_rows(linearisation, select_rows(series, rows))
        folded.add_readings(A, kinds, np.zeros(len(rows), dtype=int))
    return folded


def whitened_rows(linearisation: Linearisation, series: Series) -> tuple[Array, Ids]:
    """Compute the whitened equations A x = y of absolute readings.

    The readings of one pose are replaced by their mean and differences.

    Args:
        linearisation: State where the equations are linearised, and weights of the readings.
        series: The readings, s targets and orientations per row.

    Returns:
        [A | y], three components per reading, (s, 3, size + 1, rows) [1], and the kind of every reading's
        equations, (s, rows); -1 where nothing was read.
    """
    A, rotation = (
        series_equations(linearisation.unknowns, linearisation.state, series),
        linearisation.state.frame(series).rotation,
    )
    # Weights by the loss, and the right-hand side for the unknowns themselves in place of steps.
    _, pull = robust_whitening(series, linearisation.noise, rotation, A[:, :, -1], linearisation.loss)
    A[:, :, -1] += np.einsum("sxcr,c->sxr", A[:, :, :-1], linearisation.unknowns.values(linearisation.state))
    # Readings of one pose become a mean and differences, (abs-4), and are whitened.
    groups = repeated_rows(series)
    A, (W, kinds) = (
        combine_repeated_rows(groups, A),
        whitening_matrices(series, linearisation.noise, rotation, groups),
    )
    for group in groups:
        pull[:, group] = pull[:, group].min(axis=2, keepdims=True)
    W = W * np.sqrt(pull)[..., None, None]
    isotropic = series.precision is None
    A = A * W[:, None, None, :, 0, 0] if isotropic else np.einsum("srxy,sycr->sxcr", W, A)
    read = np.concatenate([series.is_measured.T, series.is_oriented[None]])[: len(kinds)]
    return A, np.where(read, kinds, -1)


def sum_gram_matrices(blocks: Sequence[SeriesBlock]) -> Array:
    """Sum the Gram matrices of several blocks of readings, kind by kind, (kinds, size + 1, size + 1) [1]."""
    return np.asarray(sum(part.gram_matrices for part in blocks))
