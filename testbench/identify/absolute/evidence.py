"""Prior deviations of all unknowns by maximum evidence, and the linear problem of a Gauss-Newton step.

Every group of unknowns, such as a band of the joints' harmonics, has a Gaussian prior with one standard
deviation. These deviations, and the noise of every kind of equations, maximise the evidence (`hierarchy`). A
hyperprior adds a few pseudo-observations of usual size to every group, and makes neighbouring bands similar.
If the arm lacks an error, the prior deviation of this error goes to zero.

`solve_step` then eliminates all unknowns except the compliances. The remaining equations are a `Regression`
of the compliances, for least squares or GCO, as in all other identification.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular

from testbench.data.dataset import Series
from testbench.errors import Array, BenchError, Ids
from testbench.identify import hierarchy
from testbench.identify.absolute.align import LEVEL_DEVIATION, Noise, estimate_model_error, unknowns_of
from testbench.identify.absolute.state import PERIODIC_ERROR_KINDS, ArmState, Mount, Unknowns, moved_frame
from testbench.identify.estimate import Constraint, Estimate
from testbench.identify.hierarchy import (
    STUDENT_SCALE,
    EvidenceModel,
    Hyperprior,
    NormalEquationsSolution,
    maximise_evidence,
    solve_normal_equations,
    student_neg_log_density,
)
from testbench.identify.interior import is_semidefinite
from testbench.identify.prior import (
    PriorScaling,
    PriorUncertainty,
    WeightedPrior,
    prior_rows,
    rescale_to_data,
    rows_with_prior,
)
from testbench.identify.registration import NOMINAL_TARGET_DEVIATION
from testbench.identify.regression import (
    Linearisation,
    ReducedReadings,
    Regression,
    reduce_series,
    regression_from_terms,
    term_from_triangle,
)
from testbench.identify.solve import fit_on_cone, solve
from testbench.model.kinematics import JointErrorTerms
from testbench.model.vjm import rotation_matrices

# --- Sizes of all kinds of errors, learnt from the readings by type-II maximum likelihood -------------------

DEFAULT_ERROR_SCALES: Mapping[str, float] = {
    "geometry shift": 1e-3,
    "geometry turn": 1e-3,
    "harmonics": 3e-5,
    "pattern": 3e-5,
    "ratio": 1e-4,
    "play": 3e-5,
    "stiffening": 3e-5,
}
"""Usual standard deviations of the unknowns of each kind [m, rad; rad per rad for the ratio]."""
MAX_PRIOR_DEVIATION_FACTOR = 10.0
"""Largest prior deviation over the usual one [1]; a larger one would stand for errors the model lacks."""
MAX_PRIOR_DEVIATION_FACTOR_UNDETERMINED_FRAME = 2.0
"""Largest prior deviation over the usual one if readings leave a frame or mount undetermined [1]: larger
errors of geometry would leave the linear range."""
PSEUDO_OBSERVATIONS = 2.0
"""Number of pseudo-observations of usual size in every small group of unknowns."""
MAX_SMALL_GROUP, LARGE_GROUP_SIZE_RATIO = 40, 1 / 6
"""Most unknowns of a small group, and size of the one pseudo-observation of a larger group, over the usual
size [1]. A large group determines its deviation well, and orders that the joints lack go to zero however many
are tried."""
PSEUDO_EQUATIONS = 2.0
"""Number of pseudo-equations of each kind with noise as stated: the unknowns may use up all real ones."""
WIDE_PRIOR = PriorUncertainty(3.0)
"""Uncertainty of the expected compliances while the prior deviations of all other unknowns are learnt."""
MAX_NOISE_FACTOR_ROUNDS, MAX_NOISE_FACTOR_CHANGE = 8, 0.01
"""Most alternations between noise factors and constrained compliances, and the relative change at which they
stop."""


@dataclass(frozen=True, eq=False)
class ActiveUnknowns:
    """Hold a selection of the unknowns of a calibration; all other unknowns are zero."""

    unknowns: Unknowns  #: All unknowns that may be selected.
    columns: Ids  #: Columns of the selected unknowns, compliances last, (c,).
    compliance_prior: PriorScaling | None  #: Prior of the selected compliances; None for a rigid arm.

    @property
    def n_rigid(self) -> int:
        """Count the selected unknowns that are not compliances."""
        compliances = 0 if self.compliance_prior is None else len(self.compliance_prior.expected_x)
        return len(self.columns) - compliances


def activate_unknowns(
    unknowns: Unknowns, error_kinds: frozenset[str], compliance_prior: PriorScaling | None
) -> ActiveUnknowns:
    """Select unknowns: all frames and mounts, some kinds of errors, and the compliances of a prior.

    Args:
        unknowns: All unknowns of a calibration.
        error_kinds: Names of the kinds of errors, as in `DEFAULT_ERROR_SCALES`.
        compliance_prior: Prior of the compliances; None for a rigid arm.

    Raises:
        BenchError: When the structure has compliances that the unknowns lack.
    """
    placed = np.setdiff1d(np.arange(unknowns.first_columns["geometry"]), unknowns.unused_rotations)
    on = [placed, *(c for kind, c in unknowns.prior_groups if kind in error_kinds)]
    rigid = np.sort(np.concatenate(on))
    if compliance_prior is None:
        return ActiveUnknowns(unknowns, rigid, None)
    places = compliance_prior.structure.indices_in(unknowns.structure)
    if (places < 0).any():
        raise BenchError(f"{compliance_prior.structure.name}: expected a part of {unknowns.structure.name}")
    return ActiveUnknowns(
        unknowns, np.concatenate([rigid, unknowns.first_columns["elastic"] + places]), compliance_prior
    )


@dataclass(frozen=True)
class ErrorScales:
    """Hold the prior standard deviations of all unknowns, and the noise factors of all kinds of equations."""

    #: Prior standard deviation of every unknown, (size,); infinite for unknowns without a prior.
    deviation: Array
    noise_factor: Array  #: Estimated over stated noise for each kind of equations, (kinds,) [1].


def default_error_scales(unknowns: Unknowns, n_kinds: int) -> ErrorScales:
    """Make the usual prior deviations of all unknowns, with noise as stated for the readings.

    Args:
        unknowns: All unknowns of a calibration.
        n_kinds: Number of kinds of equations.

    Returns:
        Prior deviations from `DEFAULT_ERROR_SCALES`, and noise factors of 1.
    """
    deviation = np.full(unknowns.size, np.inf)
    for name in unknowns.undetermined_frames:
        kind, _, of = name.partition(" ")
        first = unknowns.first_columns[name]
        if kind == "frame":
            deviation[first + 3 : first + 6] = LEVEL_DEVIATION
        else:
            deviation[first : first + 3 * unknowns.mounts[of][0]] = NOMINAL_TARGET_DEVIATION
    for name, sizes in unknowns.frame_deviations.items():
        deviation[unknowns.columns(f"frame {name}")] = [size or LEVEL_DEVIATION for size in sizes]
    for kind, columns in unknowns.prior_groups:
        deviation[columns] = DEFAULT_ERROR_SCALES[kind]
    return ErrorScales(deviation, np.ones(n_kinds))


def gram_of_active_unknowns(active_unknowns: ActiveUnknowns, gram: Array) -> Array:
    """Compute the Gram matrices of the selected unknowns, with compliances in units of their prior.

    Args:
        active_unknowns: The selected unknowns, c of them.
        gram: Gram matrices [A | y]^T [A | y] of all unknowns, (kinds, size + 1, size + 1).

    Returns:
        Gram matrices for each kind of equations, (kinds, c + 1, c + 1).
    """
    columns = np.r_[active_unknowns.columns, gram.shape[1] - 1]
    selected = gram[np.ix_(range(len(gram)), columns, columns)]
    if active_unknowns.compliance_prior is not None:
        e, L = slice(active_unknowns.n_rigid, -1), active_unknowns.compliance_prior.L
        selected[:, :, e] = selected[:, :, e] @ L
        selected[:, e, :] = L.T @ selected[:, e, :]
    return np.asarray(selected)


def prior_precision(
    active_unknowns: ActiveUnknowns, scales: ErrorScales, prior_uncertainty: PriorUncertainty
) -> tuple[Array, Array]:
    """Compute the prior precision P of the selected unknowns, and its product with the prior mean.

    Args:
        active_unknowns: The selected unknowns, c of them.
        scales: Prior deviations of the unknowns.
        prior_uncertainty: Relative uncertainty of the expected compliances.

    Returns:
        P, (c, c), and P times the prior mean, (c,), compliances in units of their prior.
    """
    c = len(active_unknowns.columns)
    P, b = np.zeros((c, c)), np.zeros(c)
    held = np.arange(active_unknowns.n_rigid)
    P[held, held] = scales.deviation[active_unknowns.columns[: active_unknowns.n_rigid]] ** -2.0
    if active_unknowns.compliance_prior is not None:
        B, towards = prior_rows(active_unknowns.compliance_prior, prior_uncertainty)
        P[active_unknowns.n_rigid :, active_unknowns.n_rigid :], b[active_unknowns.n_rigid :] = (
            B.T @ B,
            B.T @ towards,
        )
    return P, b


def solve_active_unknowns(
    active_unknowns: ActiveUnknowns,
    gram: Array,
    scales: ErrorScales,
    prior_uncertainty: PriorUncertainty,
    constraint: Constraint = "none",
) -> NormalEquationsSolution:
    """Solve the normal equations for the most probable unknowns, given their priors.

    They minimise the sum of |A x - y|^2 / factor^2 over the kinds of equations, plus the prior's squares.

    Args:
        active_unknowns: The selected unknowns, c of them.
        gram: Gram matrices [A | y]^T [A | y] of the equations A x = y of each kind, (kinds, c + 1, c + 1).
        scales: Prior deviations of the unknowns, and noise factors.
        prior_uncertainty: Relative uncertainty of the expected compliances.
        constraint: "psd" keeps every block of compliances positive semi-definite.

    Returns:
        The unknowns, and their precision without the constraint.

    Raises:
        BenchError: If the readings leave a frame or a target undetermined.
    """
    H, (P, b) = (
        np.tensordot(scales.noise_factor**-2.0, gram, 1),
        prior_precision(active_unknowns, scales, prior_uncertainty),
    )
    H[:-1, :-1] += P
    H[:-1, -1] += b
    optimum = solve_normal_equations(H)
    if active_unknowns.compliance_prior is None or constraint == "none":
        return optimum
    return replace(optimum, x=_in_cone(optimum, active_unknowns.n_rigid, active_unknowns.compliance_prior))


def _in_cone(optimum: NormalEquationsSolution, rigid: int, compliance_prior: PriorScaling) -> Array:
    """Constrain the most probable unknowns to positive semi-definite blocks, (c,).

    With the root U of the precision and the unconstrained optimum x_0 the cost is |U (x - x_0)|^2. The other
    unknowns follow the compliances e: their rows vanish, and |U_e (e - e_0)|^2 remains. Returns x_0 itself if
    it is in the cone.
    """
    if is_semidefinite(optimum.x[rigid:], compliance_prior.block_orders, 0.0):
        return optimum.x
    # Cost of the compliances alone.
    U = np.triu(optimum.precision_root[0]) * optimum.precision_scale
    M = U[rigid:, rigid:]
    r = M @ optimum.x[rigid:]
    e = fit_on_cone(M, r, compliance_prior.block_orders).x
    # The other unknowns follow.
    step = U[:rigid, rigid:] @ (e - optimum.x[rigid:])
    others: Array = optimum.x[:rigid] - solve_triangular(U[:rigid, :rigid], step)
    return np.concatenate([others, e])


def learn_error_scales(
    active_unknowns: ActiveUnknowns,
    reduced_readings: ReducedReadings,
    initial: ErrorScales,
    constraint: Constraint = "none",
) -> ErrorScales:
    """Learn the prior deviations of the unknowns and the noise factors by maximum evidence.

    If compliances lie on the boundary of the cone of positive semi-definite matrices, the noise factors are
    those of the residuals of the constrained arm.

    Mathematics: `abs-9`.

    Args:
        active_unknowns: The selected unknowns.
        reduced_readings: The reduced equations of all unknowns.
        initial: Prior deviations and noise factors from which the search starts.
        constraint: "psd" keeps every block of compliances positive semi-definite.

    Returns:
        Prior deviations and noise factors with the largest evidence.

    Raises:
        BenchError: If the readings leave a frame or a target undetermined.
    """
    gram, equation_counts = (
        gram_of_active_unknowns(active_unknowns, reduced_readings.total_gram_matrices),
        reduced_readings.n_equations,
    )
    scales = _maximise_scales(active_unknowns, gram, equation_counts, initial)
    if active_unknowns.compliance_prior is None or constraint == "none":
        return scales
    for _ in range(MAX_NOISE_FACTOR_ROUNDS):
        free = solve_active_unknowns(active_unknowns, gram, scales, WIDE_PRIOR)
        x = _in_cone(free, active_unknowns.n_rigid, active_unknowns.compliance_prior)
        if x is free.x:
            return scales
        # Noise factors where the evidence has no slope, with PSEUDO_EQUATIONS pseudo-equations.
        left, v = gram @ np.r_[x, -1.0], np.r_[x, -1.0]
        spent = np.einsum("kij,ij->k", gram[:, :-1, :-1], free.covariance) / scales.noise_factor**2
        factor = np.sqrt(
            (left @ v + PSEUDO_EQUATIONS)
            / np.maximum(equation_counts - spent + PSEUDO_EQUATIONS, PSEUDO_EQUATIONS)
        )
        settled = np.abs(np.log(factor / scales.noise_factor)).max() < MAX_NOISE_FACTOR_CHANGE
        scales = replace(scales, noise_factor=factor)
        if settled:
            break
    return scales


def _maximise_scales(
    active: ActiveUnknowns, gram: Array, equation_counts: Array, start: ErrorScales
) -> ErrorScales:
    """Learn prior deviations and noise factors by maximum evidence, without a constraint."""
    place = np.full(active.unknowns.size, -1)
    place[active.columns] = np.arange(len(active.columns))
    # Hyperparameters: log deviation of every selected group, then log noise factor of every kind.
    groups = [(kind, of) for kind, of in active.unknowns.prior_groups if (place[of] >= 0).all()]
    m, c = len(groups) + len(equation_counts), len(active.columns)
    drawn, known = np.zeros((c, m)), np.zeros((c + 1, c + 1))
    for k, (_, of) in enumerate(groups):
        drawn[place[of], k] = 1
    # Fixed priors: those of the compliances, of frames and of mounts.
    if active.compliance_prior is not None:
        B = np.column_stack(prior_rows(active.compliance_prior, WIDE_PRIOR))
        known[active.n_rigid :, active.n_rigid :] = B.T @ B
    first = np.searchsorted(active.columns, active.unknowns.first_columns["geometry"])
    placed = active.columns[:first]  # frames and mounts
    known[np.arange(first), np.arange(first)] = start.deviation[placed] ** -2.0
    times = (
        MAX_PRIOR_DEVIATION_FACTOR_UNDETERMINED_FRAME
        if active.unknowns.undetermined_frames
        else MAX_PRIOR_DEVIATION_FACTOR
    )
    most = [times * DEFAULT_ERROR_SCALES[kind] for kind, _ in groups] + [np.inf] * len(equation_counts)
    problem = EvidenceModel(
        gram_matrices=gram,
        equation_counts=equation_counts,
        gram_matrix_of_known_noise=known,
        log_deviation_rows=drawn,
        expected_over_scale=np.zeros(c),
        log_scale_rows=np.zeros((c, m)),
        hyperpriors=_priors(groups, m),
        bounds=np.stack([np.full(m, -np.inf), np.log(most)]),
    )
    deviation = start.deviation.copy()
    first = np.log(np.r_[[deviation[of[0]] for _, of in groups], start.noise_factor])
    h = maximise_evidence(problem, first).h
    for (_, of), size in zip(groups, np.exp(h), strict=False):
        deviation[of] = size
    return ErrorScales(deviation, np.exp(h[len(groups) :]))


def _priors(groups: Sequence[tuple[str, Ids]], m: int) -> tuple[Hyperprior, ...]:
    """Make the hyperpriors of the prior deviations of groups and of the noise factors."""
    large = np.array([len(of) > MAX_SMALL_GROUP for _, of in groups], dtype=bool)
    count, usual_ = np.full(m, PSEUDO_EQUATIONS), np.ones(m)
    count[: len(groups)] = np.where(large, 1.0, PSEUDO_OBSERVATIONS)
    usual_[: len(groups)] = np.where(large, LARGE_GROUP_SIZE_RATIO, 1.0) * [
        DEFAULT_ERROR_SCALES[kind] for kind, _ in groups
    ]

    def pseudo_observations(z: Array) -> tuple[Array, Array, Array]:
        """Compute the -log density of `count` pseudo-observations with deviation e^z, and derivatives."""
        over = np.exp(-2 * z)
        return count * (z + over / 2), count * (1 - over), 2 * count * over

    bands = [
        np.eye(m)[[k for k, (name, _) in enumerate(groups) if name == kind]] for kind in PERIODIC_ERROR_KINDS
    ]
    neighbours = np.concatenate([band[1:] - band[:-1] for band in bands]) / STUDENT_SCALE
    return (
        Hyperprior(np.eye(m), np.log(usual_), pseudo_observations),
        Hyperprior(neighbours, np.zeros(len(neighbours)), student_neg_log_density),
    )


# --- Linear problem of one Gauss-Newton step: all unknowns but the compliances are eliminated ---------------

GEOMETRY_ERROR_KINDS = frozenset({"geometry shift", "geometry turn"})  #: Kinds of errors of the geometry.
COLLINEARITY_TOLERANCE = 1e-10
"""Least share of a column that is linearly independent of all others [1]; below it, it is undetermined."""


@dataclass(frozen=True)
class StepSolution:
    """Hold the most probable values of the selected unknowns in a Gauss-Newton step, and their precision."""

    x: Array  #: Values of the selected unknowns in SI units, (c,).
    #: Upper triangular root R of their precision R^T R, compliances in units of the prior, (c, c).
    precision_root: Array
    estimate: Estimate | None  #: The compliances with their certificate; None for a rigid arm.
    degrees_of_freedom: float  #: Degrees of freedom that the unknowns use [1].
    constraint_chi2: float  #: Increase of chi squared by the constraint on compliances [1].
    weighted_prior: WeightedPrior | None  #: Prior of the compliances; None for a rigid arm.


def solve_step(
    active_unknowns: ActiveUnknowns,
    reduced_readings: ReducedReadings,
    scales: ErrorScales,
    constraint: Constraint = "psd",
    prior_uncertainty: PriorUncertainty | None = None,
) -> StepSolution:
    """Solve the linear problem of a Gauss-Newton step for the most probable unknowns.

    A QR decomposition eliminates all unknowns except the compliances, least squares or GCO solves for these,
    and the other unknowns follow by back substitution.

    Mathematics: `abs-8`.

    Args:
        active_unknowns: The selected unknowns.
        reduced_readings: The reduced equations, in the basis of the unknowns.
        scales: Prior deviations of the unknowns, and noise factors.
        constraint: "psd" for GCO, "none" for least squares.
        prior_uncertainty: Relative uncertainty of the expected compliances; None to learn it from readings.

    Returns:
        The unknowns, the root of their precision, and the estimate of the compliances.

    Raises:
        BenchError: If the readings leave a frame or a target undetermined.
    """
    # Triangular factor of all equations: the r other unknowns first, compliances last.
    T = triangular_factor_with_priors(active_unknowns, reduced_readings, scales)
    r, c = active_unknowns.n_rigid, len(active_unknowns.columns)
    x, root = solve_triangular(T[:r, :r], T[:r, c]), T[:r, :r]
    estimate, weighted_prior, pressure = None, None, 0.0
    prior = active_unknowns.compliance_prior
    if prior is not None:
        # The lower rows of T are the equations of the compliances alone.
        regression = compliance_equations(T, prior, int(reduced_readings.n_equations.sum()))
        weighted_prior = (
            WeightedPrior(prior, prior_uncertainty) if prior_uncertainty else _scaled_prior(regression, prior)
        )
        estimate = solve(regression, constraint, weighted_prior)
        pressure = _cone_pressure(regression, weighted_prior, estimate)
        x, root = back_substitute(T, estimate.pi), _precision_root(T, prior, weighted_prior)
    # Degrees of freedom: the share of each prior variance that the readings remove.
    inverse = solve_triangular(root[:r, :r], np.eye(r))
    deviation = scales.deviation[active_unknowns.columns[:r]]
    held = np.isfinite(deviation)
    known = 1 - (inverse[held] ** 2).sum(axis=1) / deviation[held] ** 2
    degrees_of_freedom = float(np.maximum(known, 0).sum() + (~held).sum() + c - r)
    if (basis := active_unknowns.unknowns.equation_basis) is not None:
        # From the basis of a shared pattern back to the joints.
        B = basis[active_unknowns.columns][:, active_unknowns.columns].toarray()  # its columns are orthogonal
        x, root = B @ x, np.asarray(np.linalg.qr(root / (B**2).sum(axis=0) @ B.T, mode="r"))
    return StepSolution(x, root, estimate, degrees_of_freedom, pressure, weighted_prior)


def _precision_root(T: Array, compliance_prior: PriorScaling, weighted_prior: WeightedPrior) -> Array:
    """Compute the root of the precision of all unknowns by likelihood and prior, (c, c).

    T is the triangular factor of all equations, (c + 1, c + 1); compliances are in units of the prior.
    """
    c = len(T) - 1
    r = c - len(compliance_prior.expected_x)
    L, B = compliance_prior.L, prior_rows(weighted_prior.scaling, weighted_prior.uncertainty)[0]
    B = B @ np.linalg.solve(weighted_prior.scaling.L, L)
    below = np.asarray(np.linalg.qr(np.vstack([T[r:c, r:c] @ L, B]), mode="r"))
    if weighted_prior.hyperparameter_effect is not None:
        below = _add_covariance(below, np.asarray(np.linalg.solve(L, weighted_prior.hyperparameter_effect.T)))
    return np.block([[T[:r, :r], T[:r, r:c] @ L], [np.zeros((c - r, r)), below]])


def _cone_pressure(regression: Regression, weighted_prior: WeightedPrior, estimate: Estimate) -> float:
    """Compute by how much the constraint raises chi squared, prior included, above the unconstrained one."""
    if estimate.constraint == "none":
        return 0.0
    M, r = rows_with_prior(regression, weighted_prior.scaling, weighted_prior.uncertainty)
    every = (estimate, solve(regression, "none", weighted_prior))
    mine, free = (
        float(np.sum((M @ np.linalg.solve(weighted_prior.scaling.L, e.pi) - r) ** 2)) for e in every
    )
    return mine - free


def compliance_equations(T: Array, compliance_prior: PriorScaling, n_equations: int) -> Regression:
    """Return the equations of the compliances, with all other unknowns eliminated.

    Args:
        T: Triangular factor of the equations of all unknowns, compliances last, (c + 1, c + 1).
        compliance_prior: Prior of the compliances.
        n_equations: Number of equations of the readings.
    """
    r = len(T) - 1 - len(compliance_prior.expected_x)
    term = term_from_triangle(T[r:, r:] / np.sqrt(n_equations / 3), 0.0, n_equations)
    return regression_from_terms(compliance_prior.structure, (term,))


def back_substitute(T: Array, pi: Array) -> Array:
    """Compute the most probable values of all unknowns for given compliances.

    Args:
        T: Triangular factor of the equations of all unknowns, compliances last, (c + 1, c + 1).
        pi: Compliances, (n,) [m/N, rad/(N m)].

    Returns:
        Values in SI units, compliances last, (c,).
    """
    r = len(T) - 1 - len(pi)
    others: Array = solve_triangular(T[:r, :r], T[:r, -1] - T[:r, r:-1] @ pi)
    return np.concatenate([others, pi])


def _add_covariance(root: Array, moves: Array) -> Array:
    """Update the triangular root of a precision, (e, e), for further covariance, the columns of moves."""
    deviations = np.hstack([solve_triangular(root, np.eye(len(root))), moves])
    R = np.linalg.qr(deviations.T, mode="r")
    return np.asarray(np.linalg.qr(solve_triangular(R, np.eye(len(R)), trans="T"), mode="r"))


def triangular_factor_with_priors(
    active_unknowns: ActiveUnknowns, reduced_readings: ReducedReadings, scales: ErrorScales
) -> Array:
    """Compute the triangular factor of [A | y]: all equations, and all priors except that of the compliances.

    Args:
        active_unknowns: The selected unknowns, c of them.
        reduced_readings: The reduced equations of all unknowns.
        scales: Prior deviations of the unknowns, and noise factors.

    Returns:
        The upper triangular factor, (c + 1, c + 1), in SI units.

    Raises:
        BenchError: If the readings do not determine a frame or a target.
    """
    columns = np.r_[active_unknowns.columns, active_unknowns.unknowns.size]
    # Rows of the priors.
    deviation = scales.deviation[active_unknowns.columns[: active_unknowns.n_rigid]]
    held = np.flatnonzero(np.isfinite(deviation))
    rows = np.zeros((len(held), len(columns)))
    rows[np.arange(len(held)), held] = 1 / deviation[held]
    # Rows of the readings, by their noise.
    factors = zip(reduced_readings.factors.values(), scales.noise_factor, strict=True)
    lines = [R[:, columns] / factor for R, factor in factors]
    T = np.asarray(np.linalg.qr(np.vstack([*lines, rows, np.zeros((len(columns), len(columns)))]), mode="r"))
    free = np.abs(np.diag(T))[: active_unknowns.n_rigid]
    if not (free > COLLINEARITY_TOLERANCE * np.linalg.norm(T[:, : active_unknowns.n_rigid], axis=0)).all():
        raise BenchError("calibration: the readings do not determine a frame or target; expected more poses")
    return T


def _scaled_prior(regression: Regression, compliance_prior: PriorScaling) -> WeightedPrior:
    """Learn the prior from the readings; if these require a negative scale, use the prior as it is."""
    try:
        rescale_to_data(compliance_prior, regression)
    except BenchError:
        return WeightedPrior(compliance_prior, WIDE_PRIOR)
    return hierarchy.learn_prior(regression, compliance_prior)


def apply_step(state: ArmState, active_unknowns: ActiveUnknowns, x: Array) -> ArmState:
    """Set the unknowns of an arm to the solution of a Gauss-Newton step.

    Frames and mounts move by their steps; all other unknowns are replaced, and are zero if not selected.

    Args:
        state: The arm before the step.
        active_unknowns: The selected unknowns, c of them.
        x: Their values, (c,), in SI units.

    Returns:
        The arm after the step.
    """
    unknowns = active_unknowns.unknowns
    every = np.zeros(unknowns.size)
    every[active_unknowns.columns] = x
    # Geometry, frames and mounts move; compliances and joint errors are replaced.
    theta_0 = state.theta_0.copy()
    theta_0[unknowns.geometry_slice] = every[unknowns.columns("geometry")]
    frames = {**state.frames}
    for name in unknowns.frames:
        frames[name] = moved_frame(frames[name], every[unknowns.columns(f"frame {name}")])
    mounts = {**state.mounts}
    for name in unknowns.mounts:
        mounts[name] = moved_mount(mounts[name], every[unknowns.columns(f"mount {name}")])
    return replace(
        state,
        theta_0=theta_0,
        C_theta=unknowns.structure.C_theta_of(every[unknowns.columns("elastic")]),
        error_terms=unknowns.error_terms,
        error_coefficients=every[unknowns.columns("errors")].reshape(
            state.vjm.arm.n_joints, unknowns.error_terms.n_coefficients
        ),
        frames=frames,
        mounts=mounts,
    )


def moved_mount(mount: Mount, step: Array) -> Mount:
    """Shift the targets of a mount in tool axes, and rotate its oriented target.

    Args:
        mount: The m targets on the tool.
        step: Shifts of the targets [m], then a rotation vector [rad] if one has an orientation, (3 m,) or
            (3 m + 3,).
    """
    m = len(mount.points)
    points = mount.points + step[: 3 * m].reshape(m, 3)
    [turn] = rotation_matrices(step[None, 3 * m :]) if len(step) > 3 * m else np.eye(3)[None]
    return replace(mount, points=points, rotation=turn @ mount.rotation)


def gauss_newton_step(
    active_unknowns: ActiveUnknowns,
    series: tuple[Series, ...],
    linearisation_point: tuple[ArmState, Noise],
    constraint: Constraint,
) -> tuple[ArmState, float]:
    """Fit the selected unknowns to absolute readings by one Gauss-Newton step.

    Args:
        active_unknowns: The selected unknowns.
        series: The readings.
        linearisation_point: The arm before the step, and noise of the readings about it.
        constraint: "psd" for GCO, "none" for least squares.

    Returns:
        The arm after the step, and the degrees of freedom of the residuals over the number of equations [1].
    """
    state, noise = linearisation_point
    reduced = reduce_series(Linearisation(active_unknowns.unknowns, state, noise), series)
    initial = default_error_scales(active_unknowns.unknowns, len(reduced.kinds))
    scales = learn_error_scales(active_unknowns, reduced, initial, constraint)
    solved = solve_step(active_unknowns, reduced, scales, constraint)
    dof_ratio = max(0.1, 1 - solved.degrees_of_freedom / reduced.n_equations.sum())
    return apply_step(state, active_unknowns, solved.x), dof_ratio


def fit_geometry_and_springs(
    state: ArmState, series: tuple[Series, ...], joint_prior: PriorScaling, constraint: Constraint = "psd"
) -> tuple[ArmState, Noise]:
    """Fit geometry, joint compliances, frames and mounts to absolute readings by two Gauss-Newton steps.

    Args:
        state: The arm from which the fit starts, with a frame and a mount for every series.
        series: The readings.
        joint_prior: Prior of the joint compliances.
        constraint: "psd" for GCO, "none" for least squares.

    Returns:
        The fitted arm, and the noise of the readings about it.
    """
    first = unknowns_of(state.vjm, series, JointErrorTerms(), joint_prior.structure)
    active, noise = (
        activate_unknowns(first, GEOMETRY_ERROR_KINDS, joint_prior),
        estimate_model_error(state, series, 1.0),
    )
    for _ in range(2):
        state, dof_ratio = gauss_newton_step(active, series, (state, noise), constraint)
        noise = estimate_model_error(state, series, dof_ratio)
    return state, noise
