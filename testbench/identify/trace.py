"""Trace weight of GCO without a prior, and cross-validation over poses and load levels.

GCO without a prior minimises F_M + w tr C over conservative compliances, a convex program. The trace, in
rad/(N m), is that of the links: joints cost next to nothing, also joints that are part of a link's block. The
larger the weight, the stiffer the links; with w = 0 it is the paper's GCO. It needs no expected compliances,
only the arm's kinematics.

As chi^2 = N F_M^2 for N points, the minimum of F_M + w tr C is that of chi^2 / 2 + l tr C with the rate l = w
N F_M: the most probable model for normal noise if every link has the prior density exp(-l tr C). For a matrix
C of order m its mean is (m + 1) / (2 l) along every axis.

Cross-validation over poses determines l. Of all weights whose held-out F_M exceeds the least one only by
chance (Student's paired test of the logarithms, pose by pose, at 5 %), the largest is chosen. The largest
weight of all makes links rigid. So a link is elastic only if held-out readings require it. One reduction
serves all folds and weights.

Runs in one pose share its geometry. So whole poses are held out: the error that counts is at poses that were
not fitted. If the data have several loads, all runs with one load are held out too.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag
from scipy.special import stdtrit

from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError, Ids
from testbench.identify import interior
from testbench.identify.conic import trace_units
from testbench.identify.estimate import TracePenalty
from testbench.identify.interior import SMALLEST_DIVISOR
from testbench.identify.regression import GroupedRegression, Regression
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

MAX_FOLDS = 8
"""Largest number of groups of poses, and of groups of loads, for cross-validation."""
MIN_STANDARD_ERRORS_BETTER = 2.0
"""Number of standard errors by which another model must predict better to replace the first one [1]."""
LOAD_LEVEL_DECIMALS = 1
"""Decimals to which forces [N] and moments [N m] are rounded before loads are compared."""


@dataclass(frozen=True)
class Fold:
    """Hold one split of the data: equations that are fitted, and equations that are held out."""

    fitted_equations: GroupedRegression  #: The equations of the groups of runs that are fitted.
    held_out_regression: Regression  #: The equations of all other groups.

    @cached_property
    def fitted_regression(self) -> Regression:
        """Return the weighted equations of all fitted groups of runs as one regression."""
        return self.fitted_equations.to_regression()


@dataclass(frozen=True)
class HeldOutErrors:
    """Hold the errors of one model on held-out runs."""

    model_name: str  #: Name of the model, for reports.
    errors: Array  #: F_M of the held-out runs of every fold, (folds,) [1].

    @property
    def mean_error(self) -> float:
        """Return the mean F_M of held-out runs over all folds [1]."""
        return mean_and_standard_error(self.errors)[0]

    @property
    def standard_error(self) -> float:
        """Return the standard error of the mean F_M over all folds [1]."""
        return mean_and_standard_error(self.errors)[1]


def cross_validation_groups(data: Dataset) -> Ids:
    """Divide runs into groups for cross-validation, by pose and by load.

    Loads are of one level if their forces and their moments have equal magnitude, to `LOAD_LEVEL_DECIMALS`.

    Returns:
        Number of the group of every run, (runs,): `MAX_FOLDS` times that of its pose plus that of its load;
        -1 for runs without a reading.
    """
    level = np.linalg.norm(data.wrench.reshape(-1, 2, 3), axis=2)
    force, moment = (np.unique(sizes, return_inverse=True)[1] for sizes in level.round(LOAD_LEVEL_DECIMALS).T)
    load = np.unique(force * len(level) + moment, return_inverse=True)[1] % MAX_FOLDS
    part = np.unique(data.pose_id, return_inverse=True)[1] % MAX_FOLDS * MAX_FOLDS + load
    return np.where(data.is_measured.any(axis=1), part, -1)


def folds(equations: GroupedRegression) -> list[Fold]:
    """Make the folds of cross-validation: each group of poses held out in turn, then each group of loads.

    Args:
        equations: The weighted equations, in the groups of `cross_validation_groups`.

    Raises:
        BenchError: When all runs are in one pose.
    """
    numbers = equations.groups
    pose, load = numbers // MAX_FOLDS, numbers % MAX_FOLDS
    if len(np.unique(pose)) < 2:
        raise BenchError("cross-validation: expected at least 2 poses, got 1")
    held = [labels == k for labels in (pose, load) for k in np.unique(labels)]
    pairs = [(numbers[~labels], numbers[labels]) for labels in held if not labels.all()]
    return [Fold(equations.select_groups(kept), equations.to_regression(out)) for kept, out in pairs]


@dataclass(frozen=True)
class GramMatrices:
    """Hold Gram matrices [A | y]^T [A | y] of weighted equations A x = y in k parameters."""

    total: Array  #: Gram matrix of all equations, (k + 1, k + 1) [1].
    held_out: Array  #: Gram matrices of the held-out equations of every fold, (folds, k + 1, k + 1) [1].
    n_held_out_equations: Array  #: Number of held-out equations of every fold, (folds,).
    n_equations: int  #: Number of all equations.
    n_terms: int  #: Number of terms of F_M: positions, and rotations if they are read.


def gram_matrices(equations: GroupedRegression | Regression, change_of_parameters: Array) -> GramMatrices:
    """Compute Gram matrices of all equations and of each group of poses, after a change of parameters.

    Args:
        equations: The weighted equations in n parameters pi, in the groups of `cross_validation_groups`; or
            without groups, then nothing is held out.
        change_of_parameters: Matrix T with [pi, 1] = T [x, 1] for new parameters x, (n + 1, k + 1).

    Returns:
        The Gram matrices in x; without folds if there are no groups or a single pose.
    """
    if isinstance(equations, Regression):
        A, y = equations.weighted_equations
        rows = np.c_[A, y] @ change_of_parameters
        total = rows.T @ rows
        total[-1, -1] += sum(term.n_equations / 3 * term.unexplained for term in equations.terms)
        return GramMatrices(
            total, np.zeros((0, *total.shape)), np.zeros(0), equations.n_equations, len(equations.terms)
        )
    folded = equations.factors
    poses, kinds = np.unique(equations.groups // MAX_FOLDS), {kind for kind, _ in folded.factors}
    totals, counts = np.zeros((len(poses), *(change_of_parameters.shape[1],) * 2)), np.zeros(len(poses))
    for at, T in folded.factors.items():
        k, rows = np.searchsorted(poses, at[1] // MAX_FOLDS), T[:, equations.columns] @ change_of_parameters
        totals[k] += rows.T @ rows
        counts[k] += folded.n_equations[at]
    several = slice(None if len(poses) > 1 else 0)
    return GramMatrices(totals.sum(axis=0), totals[several], counts[several], int(counts.sum()), len(kinds))


def mean_and_standard_error(difference: Array) -> tuple[float, float]:
    """Compute mean and standard error of numbers, (folds,), such as differences of held-out errors [1].

    The standard error is infinite for a single number.
    """
    n = len(difference)
    error = float(difference.std(ddof=1) / np.sqrt(n)) if n > 1 else np.inf
    return float(difference.mean()) if n else 0.0, error


@dataclass(frozen=True)
class ModelComparison:
    """Hold the result of comparing a preferred model with all others by their held-out errors."""

    selected_name: str  #: Name of the selected model.
    difference: float  #: Mean held-out error of the selected model minus that of the preferred one [1].
    standard_error: float  #: Standard error of this difference over folds [1].


def keep_first_unless_beaten(candidates: Sequence[HeldOutErrors], first_name: str) -> ModelComparison:
    """Select a preferred model unless another one predicts held-out readings clearly better.

    Clearly means by `MIN_STANDARD_ERRORS_BETTER` standard errors of the paired difference.

    Args:
        candidates: All models with their errors, the preferred one among them.
        first_name: Name of the preferred model.

    Returns:
        The preferred model, or the best of those that are clearly better.
    """
    [candidate] = [c for c in candidates if c.model_name == first_name]
    duels = [
        ModelComparison(c.model_name, *mean_and_standard_error(c.errors - candidate.errors))
        for c in candidates
        if c is not candidate
    ]
    better = [d for d in duels if d.difference < -MIN_STANDARD_ERRORS_BETTER * d.standard_error]
    return min(better, key=lambda d: d.difference, default=ModelComparison(first_name, 0.0, 0.0))


RELATIVE_JOINT_TRACE_WEIGHT = 1e-6
"""Weight of a joint in the trace over that of a link [1]; with it, unobservable joints are rigid."""
GRAM_RANK_TOLERANCE = 1e-12
"""Eigenvalue of a Gram matrix, over the largest, below which it is rounding [1]."""
ROOT_RANK_TOLERANCE = 1e-15
"""Squared singular value of a root matrix, over the largest, below which its row is left out [1]."""
TRIED_WEIGHT_RATIO, N_TRIED_WEIGHTS = 5.0, 6
"""Ratio of neighbouring trace weights that are tried [1], and their number."""
SELECTION_CONFIDENCE = 0.95
"""Confidence with which a smaller trace weight must predict held-out poses better to be chosen [1]. In
comparison with the rule of one standard error of F_M, errors of MGCO56 are 11 % smaller on coupled links, 7 %
on links 10 times stiffer and 6 % on disturbed arms, equal on cast links and on links 40 % off tubes, and 3 %
larger on the family (geometric means). GCO is more than 5 % worse than rigid links on 5 to 22 % of the arms
of these kinds, with that rule on 14 to 33 % (`kr500_l480`, seeds 760001 to 760060; chosen on 300000 to
300039)."""


def trace_penalty(vjm: Vjm, structure: Structure, weight: float) -> TracePenalty:
    """Make the trace term w <W, C> of GCO; W weights translations, rotations and joints of this arm.

    Mathematics: `est-8`.

    Args:
        vjm: The arm's virtual joint model.
        structure: Structure of the unknowns.
        weight: w [N m/rad].

    Returns:
        The trace term. In W rotations have weight 1, displacements count as the rotations that cause them
        (`trace_units`), and joints have a small weight.
    """
    first, columns = 6 * structure.n_links, []
    aggregated = [first + j for j in range(structure.n_links - 1) if structure.block_of_row[first + j] < 0]
    for j in (row - first for row in aggregated):
        rows = np.arange(6 * j, 6 * j + 3) + (0 if vjm.arm.joints[j].prismatic else 3)
        C = np.zeros((structure.n_theta,) * 2)
        C[np.ix_(rows, rows)] = np.outer(vjm.joint_axes_in_beam_frame[j], vjm.joint_axes_in_beam_frame[j])
        columns.append(structure.parameters_of(C))
    whole = replace(
        structure,
        rows=np.r_[structure.rows, aggregated].astype(int),
        columns=np.r_[structure.columns, aggregated].astype(int),
    )
    W = trace_units(structure) ** -2.0
    W[first:] = RELATIVE_JOINT_TRACE_WEIGHT
    return TracePenalty(weight, W, whole, np.column_stack([np.eye(structure.n_parameters), *columns]))


def learn_trace_penalty(vjm: Vjm, equations: GroupedRegression | Regression) -> TracePenalty | None:
    """Learn the weight w of the trace term w <W, C> of GCO by cross-validation over poses.

    If nothing can be held out, generalised cross-validation chooses w (Golub, Heath, Wahba 1979).

    Mathematics: `est-9`.

    Args:
        vjm: The arm's virtual joint model.
        equations: The weighted equations, in the groups of `cross_validation_groups`; without groups, or with
            a single pose, nothing can be held out.

    Returns:
        The trace term with the learnt weight; None where no marker moves, or the structure lacks entries of a
        block.
    """
    penalty = trace_penalty(vjm, equations.structure, 1.0)
    s = penalty.structure
    readings = gram_matrices(equations, block_diag(penalty.pi_per_split_parameter, np.eye(1)))
    # Gram matrices of all readings and of what every fold fits; models with rigid links.
    G = np.concatenate([[readings.total], readings.total - readings.held_out])
    rigid = np.array([_fit_joints_only(s, gram) for gram in G])
    strongest = _rigid_rate(s, readings.total, rigid[0])
    if not (s.has_full_blocks and strongest > 0 and readings.total[-1, -1] > 0):
        return None
    # Try weights from that which makes links rigid downwards, and choose by held-out readings.
    weights = strongest * TRIED_WEIGHT_RATIO ** -np.arange(float(N_TRIED_WEIGHTS))
    scaled = _scaled_folds(penalty, G, weights[N_TRIED_WEIGHTS // 2])
    choose = _by_held_out_poses if len(readings.held_out) else _by_generalised_cross_validation
    k, left = choose(readings, scaled, rigid, weights)
    weights[0] *= TRIED_WEIGHT_RATIO  # the weight of rigid links, so large that rounding cannot bend a link
    # From the rate l of chi^2 / 2 + l tr C to the weight of F_M + w tr C.
    chi2 = max(left, GRAM_RANK_TOLERANCE * readings.total[-1, -1])  # an exact fit leaves only rounding errors
    misfit = math.sqrt(chi2 * readings.n_equations / 3)
    return replace(penalty, weight=float(weights[k] * readings.n_terms / misfit))


@dataclass(frozen=True)
class _ScaledFolds:
    """Hold least-squares problems of all data and of every fold in scaled coordinates x of order one.

    The first row of an array belongs to all readings y, each further row to the readings that a fold fits.
    """

    H: Array  #: Gram matrices A^T A, (1 + folds, n, n).
    g: Array  #: Products A^T y, (1 + folds, n).
    half_squares: Array  #: Half the sum of squares of y, (1 + folds,).
    trace_gradient: Array  #: Trace <W, C> per unit of x, (n,).
    block_orders: tuple[int, ...]  #: Orders of the blocks whose svec is x.
    parameter_indices: Ids  #: Indices of the parameters in the order of x, (n,).
    scale: Array  #: Parameters per unit of x and of `reading_norm`, (n,) [m/N, rad/(N m)].
    reading_norm: float  #: Norm of all readings [1].

    def problems(self, folds: slice) -> interior.BatchedProblems:
        """Make the least-squares problems of some rows of `H`, with the trace term, in coordinates x.

        Args:
            folds: The rows: 0 is the fit of all readings, 1 + k that of fold k.
        """
        R = _roots(self.H[folds], _span(self.H[0]))
        return interior.BatchedProblems(
            R, self.g[folds], self.half_squares[folds], self.trace_gradient, self.block_orders
        )

    def parameters(self, x: Array) -> Array:
        """Convert scaled coordinates x to parameters pi.

        Args:
            x: Coordinates, (..., n) [1].

        Returns:
            Parameters, (..., n) [m/N, rad/N, rad/(N m)].
        """
        pi = np.empty_like(x)
        pi[..., self.parameter_indices] = x * self.scale * self.reading_norm
        return pi


def _scaled_folds(penalty: TracePenalty, G: Array, rate: float) -> _ScaledFolds:
    """Scale Gram matrices, (1 + folds, n + 1, n + 1), and the trace term at a rate l of middle size."""
    s, total = penalty.structure, G[0]
    unit, order = math.sqrt(total[-1, -1]), s.parameter_of_entry
    diagonal, size = s.rows == s.columns, np.zeros(s.n_theta)
    size[s.rows[diagonal]] = np.sqrt(np.diag(total)[:-1][diagonal])
    d = 1 / np.sqrt(size + rate / unit * penalty.W_diagonal)
    scale = (d[s.rows] * d[s.columns])[order] * np.where(s.fills_two_entries[order], math.sqrt(0.5), 1.0)
    return _ScaledFolds(
        H=G[:, order][:, :, order] * np.outer(scale, scale),
        g=G[:, order, -1] * scale / unit,
        half_squares=G[:, -1, -1] / unit**2 / 2,
        trace_gradient=penalty.trace_gradient[order] * scale / unit,
        block_orders=s.block_orders,
        parameter_indices=order,
        scale=scale,
        reading_norm=unit,
    )


def _by_held_out_poses(
    readings: GramMatrices, scaled: _ScaledFolds, rigid: Array, weights: Array
) -> tuple[int, float]:
    """Choose a trace weight by held-out poses, then fit all readings with it.

    Returns:
        Index of the weight, and the sum of squared residuals of all readings [1].
    """
    x, _ = interior.solve_batch(scaled.problems(slice(1, None)), weights[1:])
    fits = np.concatenate([rigid[1:, None], scaled.parameters(x)], axis=1)
    squares = np.array([_squared_residuals(*pair) for pair in zip(readings.held_out, fits, strict=True)])
    k = _strongest_weight(np.sqrt(squares / (readings.n_held_out_equations[:, None] / 3)))
    best = rigid[0]
    if k:
        best = scaled.parameters(interior.solve_batch(scaled.problems(slice(0, 1)), weights[k : k + 1])[0])[
            0, 0
        ]
    return k, float(_squared_residuals(readings.total, best))


def _by_generalised_cross_validation(
    readings: GramMatrices, scaled: _ScaledFolds, rigid: Array, weights: Array
) -> tuple[int, float]:
    """Choose a trace weight from all readings; returns what `_by_held_out_poses` returns."""
    whole = scaled.problems(slice(0, 1))
    x, multipliers = interior.solve_batch(whole, weights[1:])
    errors = _squared_residuals(readings.total, np.concatenate([rigid[:1], scaled.parameters(x[0])]))
    spent = np.r_[np.count_nonzero(rigid[0]), interior.effective_parameters(whole, x, multipliers)[0]]
    k = int(np.nanargmin(errors / (readings.n_equations - spent) ** 2))
    return k, float(errors[k])


def _span(H: Array) -> Array:
    """Compute orthonormal directions that a Gram matrix spans, (n, rank)."""
    values, V = np.linalg.eigh(H)
    return np.asarray(V[:, values > GRAM_RANK_TOLERANCE * values[-1]])


def _roots(H: Array, V: Array) -> Array:
    """Compute roots R of Gram matrices, R^T R = H, (folds, rank, n), within the span of V, (n, k)."""
    values, Q = np.linalg.eigh(V.T @ H @ V)
    kept = (values > ROOT_RANK_TOLERANCE * values[:, -1:]).any(axis=0)
    return np.asarray((np.sqrt(np.maximum(values, 0))[..., None] * (Q.swapaxes(1, 2) @ V.T))[:, kept])


def _fit_joints_only(s: Structure, gram: Array) -> Array:
    """Fit joint stiffness only by non-negative least squares, (n,)."""
    joints = np.flatnonzero(s.rows >= 6 * s.n_links)
    joints = joints[np.diag(gram)[joints] > 0]
    pi = np.zeros(s.n_parameters)
    H = gram[:-1, :-1]
    g = gram[:-1, -1]
    if len(joints):
        from scipy.optimize import nnls  # here: it takes long to import, and few commands learn a weight

        unit = 1 / np.sqrt(np.diag(H)[joints])
        values, Q = np.linalg.eigh(H[np.ix_(joints, joints)] * np.outer(unit, unit))
        kept = values > GRAM_RANK_TOLERANCE * values[-1]
        root = np.sqrt(values[kept])[:, None] * Q[:, kept].T
        aim = Q[:, kept].T @ (unit * g[joints]) / np.sqrt(values[kept])
        pi[joints] = unit * nnls(root, aim)[0]
    return pi


def _rigid_rate(s: Structure, gram: Array, pi: Array) -> float:
    """Compute the least rate l that keeps all links rigid at the best joints, (n,)."""
    H = gram[:-1, :-1]
    g = gram[:-1, -1]
    units = trace_units(s)
    S = s.gradient_matrix(H @ pi - g) * np.outer(units, units)
    links = [block for block in s.blocks if block[0] < 6 * s.n_links]
    return max((-float(np.linalg.eigvalsh(S[np.ix_(b, b)])[0]) for b in links), default=0.0)


def _squared_residuals(gram: Array, pi: Array) -> Array:
    """Compute the squared residuals of parameters, (..., n)."""
    every = np.concatenate([pi, -np.ones((*pi.shape[:-1], 1))], axis=-1)
    return np.asarray(np.maximum(np.vecdot(every, every @ gram), 0))


def _strongest_weight(errors: Array) -> int:
    """Select the strongest weight whose error exceeds the least one only by chance, (folds, weights)."""
    logs = np.log(np.where(np.isfinite(errors).all(axis=0), np.maximum(errors, SMALLEST_DIVISOR), np.inf))
    best, chance = int(logs.mean(axis=0).argmin()), stdtrit(max(1, len(logs) - 1), SELECTION_CONFIDENCE)
    for k in range(best):
        if np.isfinite(logs[0, k]):
            more, error = mean_and_standard_error(logs[:, k] - logs[:, best])
            if more <= chance * error:
                return k
    return best
