"""Uncertainty of a calibrated arm, and prediction of targets in any series.

Frame and mount of a new series are fitted to a few of its rows, with the arm held fixed. Errors of the arm
appear in these rows too; the part that the frame absorbs does not matter in the other rows.

`further_information` computes the information that further readings would add: with one joint turned through
its range, and in poses of the whole joint space. A combination of unknowns that no pose determines is
structural: a change of it moves no target.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag, solve_triangular

from testbench.data.dataset import Series, evenly_spaced, select_evenly, select_rows
from testbench.errors import Array, BenchError, Ids, Mask
from testbench.identify.absolute.align import (
    EQUATION_KINDS,
    Noise,
    align_all,
    residuals,
    robust_whitening,
    underdetermined_reason,
    unknowns_of,
    whitening_matrices,
)
from testbench.identify.absolute.evidence import default_error_scales, moved_mount
from testbench.identify.absolute.state import MAX_ROWS_IN_MEMORY, ArmState, Unknowns, moved_frame
from testbench.identify.equations import series_equations
from testbench.identify.posterior import ArmModel, Posterior

FRAME_TOLERANCE, MAX_STEPS = 1e-9, 20
"""Step below which the fit of frame and mount has converged [m, rad], and most steps."""


@dataclass(frozen=True, eq=False)
class RegisteredSeries:
    """Hold a calibrated arm with the frame and the mount of a series, and their joint uncertainty."""

    state: ArmState  #: The arm with the frame and the mount.
    rows_of_frame_fit: (
        Ids  #: Rows of the series that determined frame and mount; empty if the calibration did.
    )
    #: Posterior of f steps of frame and mount, then of a unknowns of the arm, (f + a,), SI units.
    posterior: Posterior


def covariance_root(precision_root: Array, L: Array) -> Array:
    """Compute a root W of the covariance W^T W of unknowns in SI units from the root of their precision.

    Args:
        precision_root: Upper triangular root R of the precision R^T R, compliances in units of the prior,
            (c, c).
        L: Compliances in SI units per unit of the prior, (e, e); they are the last e unknowns.

    Returns:
        W, (c, c).
    """
    back = block_diag(np.eye(len(precision_root) - len(L)), L)
    return np.asarray(solve_triangular(precision_root, back.T, trans="T"))


def fit_frame_and_mount(model: ArmModel, series: Series, rows: Ids) -> RegisteredSeries:
    """Fit the frame and the mount of a series to some of its rows, with the arm held fixed.

    Mathematics: `abs-13`.

    Args:
        model: The calibrated arm.
        series: The readings.
        rows: Indices of the rows that are fitted, (r,).

    Returns:
        Frame and mount, with the joint posterior of these and the arm's unknowns.

    Raises:
        BenchError: If these rows do not determine frame and mount.
    """
    sample = select_rows(series, rows)
    state = align_all(without_frame_and_mount(model.state, sample), (sample,))
    # Gauss-Newton on frame and mount: normal equations by the triangular factor.
    for _ in range(MAX_STEPS):
        F, M, y = _whitened(model, state, sample)
        root = _root(model, F, sample)
        step = solve_triangular(root, solve_triangular(root, F.T @ y, trans="T"))
        f = _frame_columns(sample)
        state = replace(
            state,
            frames={**state.frames, sample.frame: moved_frame(state.frame(sample), step[:f])},
            mounts={**state.mounts, sample.mount: moved_mount(state.mount(sample), step[f:])},
        )
        if np.abs(step).max() < FRAME_TOLERANCE:
            break
    return RegisteredSeries(state, rows, _joint(model, root, F.T @ M))


def register_with_known_frame(model: ArmModel, series: Series) -> RegisteredSeries:
    """Compute the joint posterior of the arm and of a frame and mount that the calibration has determined.

    Readings count as independent: repeated readings of a pose do not share the model error.

    Args:
        model: The calibrated arm, with the frame and the mount.
        series: Readings with this frame and mount. Up to `MAX_ROWS_IN_MEMORY` of them, evenly spaced, give
            the uncertainty of frame and mount for a known arm.

    Returns:
        Frame and mount, with the joint posterior of these and the arm's unknowns.
    """
    seen = np.flatnonzero(series.is_measured.any(axis=1))
    sample = select_rows(series, seen[evenly_spaced(len(seen), MAX_ROWS_IN_MEMORY)])
    F, M, _ = _whitened(model, model.state, sample)
    return RegisteredSeries(
        model.state, np.zeros(0, dtype=int), _joint(model, _root(model, F, sample), F.T @ M)
    )


def without_frame_and_mount(state: ArmState, series: Series) -> ArmState:
    """Remove the frame and the mount of a series from the model of an arm.

    Args:
        state: The model of the arm.
        series: The series, for the names of its frame and mount.
    """
    frames = {key: frame for key, frame in state.frames.items() if key != series.frame}
    mounts = {key: mount for key, mount in state.mounts.items() if key != series.mount}
    return replace(state, frames=frames, mounts=mounts)


def predict_series(
    model: ArmModel, registered_series: RegisteredSeries, series: Series
) -> tuple[Array, Array]:
    """Predict the positions of a series: compute its residuals and their covariances.

    Args:
        model: The calibrated arm.
        registered_series: The arm with the frame and the mount of the series.
        series: The readings of m targets.

    Returns:
        Measured minus predicted positions in base axes, (rows, m, 3) [m], and their covariances from arm,
        frame, mount and noise, (rows, m, 3, 3) [m^2].
    """
    m, a = len(series.markers), len(model.uncertain_columns)
    f = _frame_columns(series) + 3 * m
    columns = np.r_[:f, -a:0]  # positions do not depend on the turn of a target
    posterior = Posterior.from_covariance_root(
        registered_series.posterior.mean[columns], registered_series.posterior.covariance_root[:, columns]
    )
    root = np.linalg.inv(
        whitening_matrices(series, _noise(model), registered_series.state.frame(series).rotation)[0][:m]
    )
    covariance: Array = (root @ root.swapaxes(2, 3)).swapaxes(0, 1)
    for first in range(0, series.n_rows, MAX_ROWS_IN_MEMORY):
        rows = np.arange(first, min(first + MAX_ROWS_IN_MEMORY, series.n_rows))
        A = _columns(model, registered_series.state, select_rows(series, rows))[0][:m]
        A = np.delete(A, np.s_[f : A.shape[2] - a], axis=2)
        covariance[rows] += posterior.covariance(A.transpose(3, 0, 1, 2))
    return residuals(registered_series.state, series)[:m].transpose(2, 0, 1), covariance


def inside_ellipsoid(residual: Array, covariance: Array, chi_squared_quantile: float) -> Mask:
    """Tell which measured positions lie in their confidence ellipsoid, r^T C^-1 r <= quantile.

    Args:
        residual: Residuals r, (rows, m, 3) [m].
        covariance: Covariances C of the residuals, (rows, m, 3, 3) [m^2].
        chi_squared_quantile: Quantile of chi squared [1]; 3 degrees of freedom for positions, 1 for lines.

    Returns:
        Whether each position lies in its ellipsoid, (rows, m).
    """
    solved = np.linalg.solve(covariance, residual[..., None])[..., 0]
    return np.asarray((residual * solved).sum(axis=-1) <= chi_squared_quantile)


def _frame_columns(series: Series) -> int:
    """Count the unknowns of the frame of a series."""
    return len(series.frame_deviations or range(6))


def _joint(model: ArmModel, root: Array, with_arm: Array) -> Posterior:
    """Combine the posterior of frame and mount, of precision root^T root, with that of the arm.

    `root` is (f, f), and `with_arm` holds the products of these columns with those of the arm, (f, a).
    """
    f, posterior = len(root), model.posterior
    inverse: Array = solve_triangular(root, np.eye(f))
    taken = inverse @ (inverse.T @ with_arm)
    blocks = [
        [inverse.T, np.zeros((f, len(posterior.mean)))],
        [-posterior.covariance_root @ taken.T, posterior.covariance_root],
    ]
    return Posterior.from_covariance_root(np.r_[np.zeros(f), posterior.mean], np.block(blocks))


def _columns(model: ArmModel, state: ArmState, series: Series) -> tuple[Array, Array]:
    """Compute columns of frame, mount and arm, (s, 3, f + a, rows), and residuals, (s, 3, rows)."""
    unknowns = unknowns_of(model.vjm, (series,), state.error_terms, model.structure)
    rows, f = series_equations(unknowns, state, series), unknowns.first_columns["geometry"]
    return rows[:, :, np.r_[:f, f + model.uncertain_columns]], rows[:, :, -1]


def _whitened(model: ArmModel, state: ArmState, series: Series) -> tuple[Array, Array, Array]:
    """Whiten the equations: columns of frame and mount, (e, f), of the arm, (e, a), and residuals, (e,)."""
    A, left = _columns(model, state, series)
    W, weights = robust_whitening(series, _noise(model), state.frame(series).rotation, left)
    W *= np.sqrt(weights)[..., None, None]
    rows = np.concatenate([A, left[:, :, None]], axis=2)
    lines = np.einsum("srxy,sycr->srxc", W, rows, optimize=True).reshape(-1, rows.shape[2])
    F, M, y = np.split(lines, [A.shape[2] - len(model.uncertain_columns), -1], axis=1)
    return F, M, y[:, 0]


def _root(model: ArmModel, F: Array, series: Series) -> Array:
    """Factorise the columns of frame and mount, with their prior where these rows leave them undetermined."""
    unknowns = unknowns_of(model.vjm, (series,), model.state.error_terms, model.structure)
    usual = default_error_scales(unknowns, len(EQUATION_KINDS))
    B = np.diag(1 / usual.deviation[: unknowns.first_columns["geometry"]])
    B = B[B.any(axis=1) & (not underdetermined_reason(model.vjm, series))]
    R = np.asarray(np.linalg.qr(np.vstack([F, B]), mode="r"))
    full = len(R) == F.shape[1] and (np.abs(np.diag(R)) > 1e-9 * np.linalg.norm(F, axis=0)).all()
    if not full:
        raise BenchError(
            f"{series.name}: its rows do not determine frame and target; expected larger joint motions"
        )
    return R


def _noise(model: ArmModel) -> Noise:
    if model.noise is None:
        raise BenchError("model: expected one of absolute readings; this one predicts deflections only")
    return model.noise


POSES_PER_TURNED_JOINT = 40
"""Number of further rows in which one joint is turned through its range."""
EQUATIONS_PER_UNKNOWN = 2
"""Number of equations of poses in the whole joint space, over the number of unknowns [1]."""
MAX_STRUCTURAL_INFORMATION = 1e-3
"""Information from poses in the whole joint space, over that of the prior, below which a direction is
structural [1]."""
MIN_INFORMATION_EIGENVALUE = 1e-10
"""Eigenvalue of an information matrix with unit diagonal below which it counts as zero [1]."""
INFORMATION_OF_FIXED_UNKNOWNS = 1.0
"""Information assumed for unknowns without prior deviation, so that they are not structural [1]."""
MIN_COMMON_SINGULAR_VALUE = 0.1
"""Singular value of two joined sets of directions below which a direction counts as common to both [1]."""


@dataclass(frozen=True)
class AddedInformation:
    """Hold information matrices of further readings about the unknowns of a calibration, SI units."""

    #: Of the poses of the series with joint j turned through its range, for each joint, (n, size, size).
    by_turned_joint: Array
    #: Of poses in the whole joint space, with more equations than unknowns, (size, size).
    whole_joint_space: Array
    #: Of the same poses for the rigid nominal arm, which shows structural directions exactly, (size, size).
    whole_joint_space_of_rigid_arm: Array


def further_information(
    unknowns: Unknowns,
    state: ArmState,
    series: tuple[Series, ...],
    information_of: Callable[[Series], Array] | None = None,
) -> AddedInformation:
    """Compute the information that further readings would add, under the loads of given series.

    Args:
        unknowns: The unknowns of a calibration.
        state: The arm at which the equations are linearised.
        series: Series that were read, or are planned.
        information_of: Function that computes the information matrix of a series, without a prior,
            (size, size); None for `information_of_series`.

    Returns:
        The information with each joint turned, and in poses of the whole joint space.
    """
    arm = unknowns.vjm.arm
    lower, upper = arm.limits
    rng = np.random.Generator(np.random.Philox(0))
    information_for = information_of or (lambda readings: information_of_series(unknowns, state, readings))

    def information_of_turned_joint(j: int) -> Array:
        """Compute the information from poses in which joint j turns through its range, (size, size)."""
        total = np.zeros((unknowns.size,) * 2)
        for readings in series:
            count = min(readings.n_rows, -(-POSES_PER_TURNED_JOINT // len(series)))
            rows = select_evenly(np.arange(readings.n_rows), count)
            q = readings.q[rows].copy()
            stratified = (rng.permutation(count) + rng.random(count)) / count
            q[:, j] = stratified * (upper[j] - lower[j]) + lower[j]
            total += information_for(_series_in_poses(readings, rows, arm.with_dependent_joints(q)))
        return total

    # Readings all over joint space: with the elastic arm, and with the rigid one.
    everywhere = []
    for readings in series:
        numbers = len(readings.markers) * (3 if readings.distance is None else 1)
        count = -(-EQUATIONS_PER_UNKNOWN * unknowns.size // (numbers * len(series)))
        q = arm.draw_poses(rng, count)
        everywhere.append(_series_in_poses(readings, np.arange(count) % readings.n_rows, q))
    nominal = replace(
        state,
        theta_0=0 * state.theta_0,
        C_theta=0 * state.C_theta,
        error_coefficients=0 * state.error_coefficients,
    )
    rigid = [information_of_series(unknowns, nominal, readings) for readings in everywhere]
    every = np.stack([information_of_turned_joint(j) for j in range(len(lower))])
    return AddedInformation(
        every, np.sum([information_for(readings) for readings in everywhere], axis=0), np.sum(rigid, axis=0)
    )


def information_of_series(unknowns: Unknowns, state: ArmState, series: Series) -> Array:
    """Compute the information matrix A^T W A of a series about the unknowns, without a prior.

    Args:
        unknowns: The unknowns of a calibration.
        state: The arm at which the equations are linearised.
        series: The readings, of positions and orientations, with their stated noise.

    Returns:
        Information matrix in SI units, (size, size).
    """
    m = len(series.markers)
    A = series_equations(unknowns, state, series)[:, :, :-1]
    A[:m] /= series.sigma
    if series.sigma_rotation is not None:
        A[m:] /= series.sigma_rotation
    flat = A.transpose(2, 0, 1, 3).reshape(unknowns.size, -1)
    return np.asarray(flat @ flat.T)


def _series_in_poses(series: Series, rows: Ids, q: Array) -> Series:
    """Put rows of a series into other poses, (count, n) [rad, m], with every target read."""
    rotation = None if series.rotation is None else np.tile(np.eye(3), (series.n_rows, 1, 1))
    return replace(select_rows(replace(series, precision=None, rotation=rotation), rows), q=q)


@dataclass(frozen=True)
class StructuralDirections:
    """Hold the combinations of unknowns that no pose determines under the given loads."""

    directions: Array  #: Orthonormal directions, unknowns in units of the prior, (size, k).
    n_geometry: int  #: Number of directions of geometry, frames and mounts.
    #: Indices of joints whose errors move no target, such as the last one with a target on its axis.
    inactive_joints: tuple[int, ...]
    n_compliance: int  #: Number of compliance directions that the given loads do not show.


def structural_directions(
    unknowns: Unknowns, prior_root: Array, added_information: AddedInformation
) -> StructuralDirections:
    """Find the structural directions: combinations of unknowns that move no target in any pose.

    Args:
        unknowns: The unknowns of a calibration.
        prior_root: Root L of the prior covariance L L^T of the unknowns, (size, size).
        added_information: Information of poses in the whole joint space.

    Returns:
        The directions, and how many of them concern geometry, joints and compliances.
    """
    # Directions with hardly any information, in units of the prior.
    of_fixed = np.diag(np.where(np.diag(prior_root) > 0, 0.0, INFORMATION_OF_FIXED_UNKNOWNS))
    M = prior_root.T @ added_information.whole_joint_space @ prior_root + of_fixed
    drawn = prior_root.T @ added_information.whole_joint_space_of_rigid_arm @ prior_root + of_fixed
    values, V = np.linalg.eigh(M)
    geometry = np.arange(unknowns.first_columns["errors"])
    # Structural directions of geometry, exactly, by the rigid nominal arm.
    never = np.zeros((len(M), _dimension(drawn, geometry)))
    never[geometry] = np.linalg.eigh(drawn[np.ix_(geometry, geometry)])[1][:, : never.shape[1]]
    U, s, _ = np.linalg.svd(
        np.hstack([V[:, values < MAX_STRUCTURAL_INFORMATION], never]), full_matrices=False
    )
    joints, first = range(unknowns.vjm.arm.n_joints), unknowns.first_columns["elastic"]
    size = unknowns.error_terms.n_coefficients
    of_joint = [unknowns.first_columns["errors"] + j * size + np.arange(size) for j in joints]
    return StructuralDirections(
        directions=U[:, s > MIN_COMMON_SINGULAR_VALUE],
        n_geometry=never.shape[1],
        inactive_joints=tuple(j for j in joints if size and _dimension(M, of_joint[j]) == size),
        n_compliance=int((np.linalg.eigvalsh(M[first:, first:]) < MAX_STRUCTURAL_INFORMATION).sum()),
    )


def _dimension(M: Array, columns: Ids) -> int:
    """Count the directions of some columns without information."""
    block = M[np.ix_(columns, columns)]
    size = np.sqrt(np.diag(block))
    informed = size > MIN_INFORMATION_EIGENVALUE * size.max(initial=0.0)
    unit = block[np.ix_(informed, informed)] / np.outer(size[informed], size[informed])
    return int((~informed).sum() + (np.linalg.eigvalsh(unit) < MIN_INFORMATION_EIGENVALUE).sum())
