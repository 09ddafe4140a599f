"""Residuals of absolute readings, their noise, and the initial frame and mount of each series.

The frame of a series is the pose of the arm's base in the frame of the readings; its mount holds the targets
on the tool. The noise of a reading is that of the instrument, sigma, plus the model error s, which all
readings of one pose share. k readings of one pose are replaced by their mean, times sqrt(k), with variance
sigma^2 + k s^2, and by k - 1 differences with variance sigma^2 (Helmert's transformation).

`align_all` finds frames and mounts by the nominal arm. `identify.registration` needs no nominal targets, so a
mount may be rotated by any angle. Frames and mounts that several series share are determined once. Targets
are matched by name; a target that a series lacks counts as not read there.

A target m on the tool is read at R_s (R_r m + p_r) + t_s. If the tool keeps one orientation R_r, along a line
or a surface, only the sum of R_s R_r m and t_s matters: three directions of frame and mount change no
reading. If the line is straight, neither does a rotation of the frame about it. `undetermined_frames` finds
such frames and mounts, and a prior determines them. Another series of the same mount or frame, in which the
tool rotates, makes the prior unnecessary.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from testbench.data.dataset import Series, evenly_spaced, select_rows
from testbench.errors import Array, BenchError, Ids
from testbench.identify.absolute.state import (
    MAX_ROWS_IN_MEMORY,
    ArmState,
    Mount,
    Unknowns,
    moved_frame,
    nominal_state,
    series_equilibrium,
)
from testbench.identify.base_frame import MAX_NOMINAL_DISTANCE
from testbench.identify.diagnosis.kinematics import Issue
from testbench.identify.equations import (
    distance_directions,
    series_equations,
    series_residuals,
    undeflected_arm,
)
from testbench.identify.registration import (
    ASSUMED_NOISE,
    MIN_REGISTRATION_POSES,
    NOMINAL_TARGET_DEVIATION,
    READING_LOSS,
    Frame,
    FramesAndTargets,
    HuberLoss,
    kabsch,
    largest_deviation,
    mean_readings,
    median_tool_distance,
    moving_joints,
    nearest_rotation,
    register,
)
from testbench.identify.registration import registration_residuals as left_by
from testbench.model.kinematics import JointErrorTerms
from testbench.model.load import massless_bodies
from testbench.model.structure import Structure, joints_only
from testbench.model.vjm import Vjm, tool_poses

# --- Residuals of readings, and their noise about a state ---------------------------------------------------

EQUATION_KINDS = ("position", "orientation", "position within a pose", "orientation within a pose")
"""Kinds of equations, each with its own noise factor; those "within a pose" are differences of readings."""
POSITION_KINDS = (0, 2)
"""Indices of the kinds of equations that are positions."""

MEAN_CLIPPED_SQUARE_RATIO = 0.9991 / 2.986
"""Mean of min(|z|, 3.5)^2 for a standard normal number z, over that for a standard normal 3-vector [1]."""


@dataclass(frozen=True)
class Noise:
    """Hold the noise of absolute readings, the error of the arm's model included, as standard deviations."""

    position_model_error: float = 0.0  #: Model error s of positions [m].
    rotation_model_error: float = 0.0  #: Model error s of orientations [rad].
    #: Estimated over expected noise, for each of EQUATION_KINDS, (kinds,) [1].
    factor: Array = field(default_factory=lambda: np.ones(len(EQUATION_KINDS)))


def repeated_rows(series: Series) -> tuple[Ids, ...]:
    """Group the rows of a series that read the same targets in the same pose.

    Returns:
        Indices of the rows, one array (groups, k) for every number k > 1 of repetitions.
    """
    read = np.column_stack([series.pose_id, series.is_measured, series.is_oriented])
    code = np.unique(read, axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(code, kind="stable")
    _, first, count = np.unique(code[order], return_index=True, return_counts=True)
    sizes = [k for k in np.unique(count) if k > 1]
    return tuple(np.array([order[f : f + k] for f in first[count == k]]) for k in sizes)


def equation_kinds_of(series: Sequence[Series]) -> tuple[int, ...]:
    """List the kinds of equations that occur in some series, as indices into `EQUATION_KINDS`."""
    turned = any(readings.rotation is not None for readings in series)
    again = any(repeated_rows(readings) for readings in series)
    return tuple(
        k for k in range(len(EQUATION_KINDS)) if (turned or k in POSITION_KINDS) and (again or k < 2)
    )


def combine_repeated_rows(row_groups: Sequence[Ids], values: Array) -> Array:
    """Replace repeated readings by their mean and differences (Helmert's transformation).

    Args:
        row_groups: Indices of repeated rows, from `repeated_rows`.
        values: Values of all rows, (..., rows).

    Returns:
        The combined values, (..., rows). The first row of a group of k rows holds sqrt(k) times their mean,
        the others hold k - 1 differences.
    """
    if row_groups:
        from scipy.linalg import helmert  # here: it takes long to import, and few readings are repeated

        values = values.copy()
    for group in row_groups:
        values[..., group] = values[..., group] @ helmert(group.shape[1], full=True).T
    return values


def readings_per_row(row_groups: Sequence[Ids], n_rows: int) -> Ids:
    """Count the readings of which each combined row is the mean.

    Args:
        row_groups: Indices of repeated rows, from `repeated_rows`.
        n_rows: Number of rows.

    Returns:
        k for a mean of k readings, 1 for a single reading, 0 for a difference, (rows,).
    """
    count = np.ones(n_rows, dtype=int)
    for group in row_groups:
        count[group[:, 0]], count[group[:, 1:]] = group.shape[1], 0
    return count


def whitening_matrices(
    series: Series, noise: Noise, rotation: Array, row_groups: Sequence[Ids] = ()
) -> tuple[Array, Ids]:
    """Compute matrices W = (covariance)^-1/2 that scale residuals to unit variance, and kinds of equations.

    Mathematics: `abs-4`.

    Args:
        series: The readings: s vectors per row, positions of the targets, then an orientation if read.
        noise: Noise of the readings.
        rotation: Tracker from base, (3, 3).
        row_groups: Indices of repeated rows that are combined; empty for single readings.

    Returns:
        W in base axes, (s, rows, 3, 3) [1/m, 1/rad], and indices into `EQUATION_KINDS`, (s, rows).
    """
    m, times = len(series.markers), readings_per_row(row_groups, series.n_rows)
    s = m + (series.rotation is not None)
    W = np.zeros((s, series.n_rows, 3, 3))
    kinds = np.where(times > 0, 0, 2) * np.ones((s, 1), dtype=int)
    kinds[m:] += 1
    # Covariance of positions: that of the instrument, averaged over a group, plus the model error k s^2.
    model_variance = times * noise.position_model_error**2
    if series.precision is None:
        W[:m] = np.eye(3) / np.sqrt(series.sigma**2 + model_variance)[:, None, None]
    else:
        covariance = np.linalg.inv(np.where(series.is_measured[..., None, None], series.precision, np.eye(3)))
        covariance = rotation.T @ covariance @ rotation
        for group in row_groups:
            covariance[group] = covariance[group].mean(axis=1, keepdims=True)
        covariance = covariance + model_variance[:, None, None, None] * np.eye(3)
        W[:m] = np.linalg.inv(np.linalg.cholesky(covariance)).swapaxes(0, 1)
    if series.sigma_rotation is not None:
        deviation = np.sqrt(series.sigma_rotation**2 + times * noise.rotation_model_error**2)
        W[m:] = np.eye(3) / deviation[:, None, None]
    return W / noise.factor[kinds][..., None, None], kinds


def robust_whitening(
    series: Series, noise: Noise, rotation: Array, residual: Array, loss: HuberLoss = READING_LOSS
) -> tuple[Array, Array]:
    """Compute whitening matrices of single readings, and the robust weight of each from its residual.

    Args:
        series: The readings: s vectors per row, positions of the targets, then an orientation if read.
        noise: Noise of the readings.
        rotation: Tracker from base, (3, 3).
        residual: Residuals in base axes, (s, 3, rows) [m, rad].
        loss: Robust loss, which sets the weights.

    Returns:
        Matrices W that scale residuals to unit variance, (s, rows, 3, 3) [1/m, 1/rad], and the weights,
        (s, rows) [1].
    """
    W, _ = whitening_matrices(series, noise, rotation)
    return W, loss.weight(np.linalg.norm(np.einsum("srxy,syr->sxr", W, residual), axis=1))


def residuals(state: ArmState, series: Series) -> Array:
    """Compute the residuals of a series: readings minus predictions of the model.

    Args:
        state: The arm with the frame and the mount of the series.
        series: The readings: s vectors per row, positions of the targets, then an orientation if read.

    Returns:
        Residuals in base axes, (s, 3, rows) [m, rad]; zero where nothing was read.
    """
    starts = range(0, max(series.n_rows, 1), MAX_ROWS_IN_MEMORY)
    parts = (select_rows(series, np.arange(k, min(k + MAX_ROWS_IN_MEMORY, series.n_rows))) for k in starts)
    return np.concatenate(
        [series_residuals(state, part, series_equilibrium(state, part)) for part in parts], axis=2
    )


def position_residual_lengths(state: ArmState, series: Series) -> Array:
    """Compute the distances between the measured and the modelled targets of a series.

    Args:
        state: The arm with the frame and the mount of the series.
        series: The readings of m targets.

    Returns:
        Distances, (rows, m) [m]; zero where nothing was read.
    """
    return np.asarray(np.linalg.norm(residuals(state, series)[: len(series.markers)], axis=1).T)


def robust_weights(state: ArmState, series: Series, noise: Noise) -> Array:
    """Compute the robust weight of every reading of a series from its residual.

    Args:
        state: The arm with the frame and the mount of the series.
        series: The readings: s vectors per row, positions of the targets, then an orientation if read.
        noise: Noise of the readings.

    Returns:
        Weights from 0 to 1, (s, rows) [1].
    """
    return robust_whitening(series, noise, state.frame(series).rotation, residuals(state, series))[1]


def estimate_model_error(state: ArmState, series: Sequence[Series], dof_ratio: float) -> Noise:
    """Estimate the error of the model from the residuals that the instrument's noise does not explain.

    Args:
        state: The arm with frames and mounts.
        series: The readings.
        dof_ratio: Degrees of freedom of the residuals over the number of equations [1].

    Returns:
        Noise with the model errors of positions and of orientations; the factors on the noise are 1.
    """
    none = np.zeros(0)
    position, rotation = [(none, none)], [(none, none)]  # lengths of residuals, variances of readings
    for readings in series:
        m, seen = len(readings.markers), readings.is_measured
        left = np.linalg.norm(residuals(state, readings), axis=1).T
        variance = np.full((readings.n_rows, m), readings.sigma**2)
        if readings.precision is not None:
            precision = np.where(seen[..., None, None], readings.precision, np.eye(3))
            variance = np.trace(np.linalg.inv(precision), axis1=2, axis2=3) / 3
        position.append((left[:, :m][seen], variance[seen]))
        if readings.sigma_rotation is not None:
            rotation.append(
                (
                    left[readings.is_oriented, m],
                    np.full(readings.is_oriented.sum(), readings.sigma_rotation**2),
                )
            )
    errors = []
    # A distance is one number: its squares are smaller than those of a position.
    every = sum(int(readings.is_measured.sum()) for readings in series)
    lines = sum(int(readings.is_measured.sum()) for readings in series if readings.distance is not None)
    mean = 1.0 - (1.0 - MEAN_CLIPPED_SQUARE_RATIO) * lines / max(every, 1)
    for kind, size in ((position, mean), (rotation, 1.0)):
        length, variances = (np.concatenate(part)[:, None] for part in zip(*kind, strict=True))
        errors.append(READING_LOSS.extra_noise(length, variances, dof_ratio * size))
    return Noise(errors[0], errors[1])


def single_reading_noise(noise: Noise, stated_variances: Array, repetitions: float) -> Noise:
    """Convert the noise of combined readings to that of a single reading in its pose.

    Means of k readings have the variance factor^2 (sigma^2 + k s^2), with the model error s. If their factor
    is below 1, s is lowered first. The noise sigma of the readings is lowered only if s = 0 is not enough.

    Args:
        noise: Noise of the combined readings.
        stated_variances: Mean stated variances sigma^2 of positions and orientations, (2,) [m^2, rad^2].
        repetitions: Mean number k of readings that are combined [1].

    Returns:
        Noise of a single reading, with the same variance of the mean of k readings.
    """
    factor, model_error = noise.factor.copy(), [noise.position_model_error, noise.rotation_model_error]
    for kind in np.flatnonzero((factor[:2] < 1) & (stated_variances > 0)):
        whole = factor[kind] ** 2 * (stated_variances[kind] + repetitions * model_error[kind] ** 2)
        model_error[kind] = float(np.sqrt(max(0.0, whole - stated_variances[kind]) / repetitions))
        factor[kind] = np.sqrt(whole / (stated_variances[kind] + repetitions * model_error[kind] ** 2))
    return Noise(model_error[0], model_error[1], factor)


def mean_stated_variances(series: Sequence[Series]) -> tuple[Array, float]:
    """Average the stated variances of the readings, and the number of repeated readings that are combined.

    Returns:
        Variances of positions and orientations, (2,) [m^2, rad^2], and the mean number of readings in a
        combined row [1].
    """
    count = [readings_per_row(repeated_rows(readings), readings.n_rows) for readings in series]
    position = np.mean([readings.sigma**2 for readings in series])
    turns = [readings.sigma_rotation**2 for readings in series if readings.sigma_rotation is not None]
    k = float(np.concatenate([x[x > 0] for x in count]).mean())
    return np.array([position, np.mean(turns) if turns else 0.0]), k


def equation_deviations(noise: Noise, stated_variances: Array, repetitions: float) -> Array:
    """Compute the expected standard deviation of each kind of equations, sqrt(sigma^2 + k s^2) or sigma.

    Args:
        noise: Noise with the model error s.
        stated_variances: Mean stated variances sigma^2 of positions and orientations, (2,) [m^2, rad^2].
        repetitions: Mean number k of readings that are combined [1].

    Returns:
        Standard deviations for each of EQUATION_KINDS, (kinds,) [m, rad].
    """
    model_error = np.array([noise.position_model_error, noise.rotation_model_error])
    return np.asarray(np.sqrt(np.r_[stated_variances + repetitions * model_error**2, stated_variances]))


# --- Unknowns of readings; frames and mounts that these cannot separate, which a prior then determines ------

MAX_EVALUATED_ROWS = 300
"""Most rows of a series that are evaluated, evenly spaced."""
WIDE_PRIOR_DEVIATIONS = 10.0, 1.0, 100.0
"""Wide prior standard deviations of a target [m], of rotations [rad], and of the origin of a frame [m]."""
LEVEL_DEVIATION = 0.05
"""Standard deviation of a tracker's tilt from upright, and largest standard deviation of a frame's rotation
that counts as determined [rad]."""


def unknowns_of(
    vjm: Vjm, series: Sequence[Series], error_terms: JointErrorTerms, structure: Structure
) -> Unknowns:
    """List all unknowns of a calibration from given series.

    Args:
        vjm: The arm's virtual joint model.
        series: The readings, which determine the frames and mounts.
        error_terms: Kinds of joint errors.
        structure: Structure of the compliances.
    """
    held = undetermined_frames(vjm, series)
    return replace(
        _all_determined(vjm, series), error_terms=error_terms, structure=structure, undetermined_frames=held
    )


def _all_determined(vjm: Vjm, series: Sequence[Series]) -> Unknowns:
    """List frames, mounts, geometry and compliances of joints, as if readings determined all frames."""
    mounts: dict[str, tuple[int, bool]] = {}
    fixed: dict[str, tuple[float, ...]] = {}
    normals: dict[str, tuple[tuple[float, float, float], ...]] = {}
    for readings in series:
        turned = readings.rotation is not None or mounts.get(readings.mount, (0, False))[1]
        mounts[readings.mount] = len(readings.markers), turned
        if (sizes := readings.frame_deviations) is not None:  # of faces of one block the largest
            fixed[readings.frame] = tuple(map(max, sizes, fixed.get(readings.frame, sizes)))
        if readings.plane_normal is not None:
            normals[readings.frame] = (*normals.get(readings.frame, ()), readings.plane_normal)
    return Unknowns(
        vjm,
        tuple(dict.fromkeys(readings.frame for readings in series)),
        mounts,
        JointErrorTerms(),
        joints_only(vjm.arm),
        frame_deviations=fixed,
        plane_normals=normals,
    )


def undetermined_frames(vjm: Vjm, series: Sequence[Series]) -> frozenset[str]:
    """Find the frames and mounts that absolute readings leave undetermined, for the nominal geometry.

    A mount is undetermined if the standard deviation of a target exceeds `NOMINAL_TARGET_DEVIATION`, a frame
    if that of its rotation exceeds `LEVEL_DEVIATION`.

    Mathematics: `abs-7`.

    Args:
        vjm: The arm's virtual joint model.
        series: All readings; they may share frames and mounts.

    Returns:
        Their names, as "frame NAME" and "mount NAME".
    """
    unknowns = _all_determined(vjm, series)
    first, placed = unknowns.first_columns, unknowns.first_columns["geometry"]
    # Wide priors; that of a fixed point or plane holds what readings leave open.
    deviation = np.full(placed, WIDE_PRIOR_DEVIATIONS[0])
    for name, (m, turned) in unknowns.mounts.items():
        deviation[first[f"mount {name}"] + 3 * m :][: 3 * turned] = WIDE_PRIOR_DEVIATIONS[1]
    for name in unknowns.frames:
        sizes = unknowns.frame_deviations.get(name)
        _, turn, shift = WIDE_PRIOR_DEVIATIONS
        if sizes is not None:
            turn, shift = min(sizes[3] or LEVEL_DEVIATION, LEVEL_DEVIATION / 2), sizes[0]
        deviation[unknowns.columns(f"frame {name}")] = [*[shift] * 3, *[turn] * 3, *(sizes or ())[6:]]
    # Information of all readings, of targets at the tool of the rigid arm.
    rigid = nominal_state(vjm, massless_bodies(vjm.arm), np.ones(vjm.arm.n_joints))
    M = np.zeros((placed, placed))
    M[np.diag_indices(placed)] = deviation**-2.0
    for readings in series:
        seen = np.flatnonzero(readings.is_measured.any(axis=1))
        rows = select_rows(readings, seen[evenly_spaced(len(seen), MAX_EVALUATED_ROWS)])
        mount = Mount(np.zeros((len(rows.markers), 3)), np.eye(3), rows.markers)
        state = replace(rigid, frames={rows.frame: stated_frame(rows)}, mounts={rows.mount: mount})
        A = series_equations(unknowns, state, rows)[:, :, :placed] / ASSUMED_NOISE
        M += np.tensordot(A, A, ((0, 1, 3), (0, 1, 3)))
    covariance: Array = np.asarray(np.linalg.inv(M), dtype=float)

    def spread(start: int) -> float:
        """Compute the largest standard deviation of the three unknowns from a column on."""
        return largest_deviation(covariance[start : start + 3, start : start + 3])

    undetermined = {
        f"frame {name}" for name in unknowns.frames if spread(first[f"frame {name}"] + 3) > LEVEL_DEVIATION
    }
    for readings in series:  # a target that was never read has no information
        name = f"mount {readings.mount}"
        targets = first[name] + 3 * np.flatnonzero(readings.is_measured.any(axis=0))
        if any(spread(k) > NOMINAL_TARGET_DEVIATION for k in targets.tolist()):
            undetermined.add(name)
    return frozenset(undetermined)


def fit_upright_frame(points: Array, measured: Array) -> Frame:
    """Fit a frame to points by least squares (Kabsch); it is upright where the points do not determine it.

    Two further points along the vertical count as much as a direction known to `LEVEL_DEVIATION`, if the
    readings are known to `ASSUMED_NOISE`.

    Args:
        points: Points in base axes, (n, 3) [m].
        measured: Measured positions of these points in tracker axes, (n, 3) [m].

    Returns:
        The frame, tracker from base.
    """
    up = (ASSUMED_NOISE / LEVEL_DEVIATION) * np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]) / np.sqrt(2)
    R, _ = kabsch(
        np.vstack([points - points.mean(axis=0), up]), np.vstack([measured - measured.mean(axis=0), up])
    )
    return Frame(R, measured.mean(axis=0) - R @ points.mean(axis=0))


# --- Initial frame and mount of a series from the nominal arm and the series' positions and orientations ----

MAX_ALIGNED_ROWS = 300
"""Most rows that the alignment of a series uses, evenly spaced."""
MIN_ROWS_OF_HALF_SERIES = 12
"""Fewest rows of half a series for an alignment of this half."""
MIN_MOVING_JOINTS, MIN_MOVING_JOINTS_ORIENTED = 3, 2
"""Fewest joints that move in a series, without and with orientations, to determine frame and targets."""
MAX_FRAME_DEVIATION = np.radians(0.2)
"""Largest standard deviation of a frame's rotation from few poses and a known mount [rad]; beyond it the
frame counts as undetermined."""
FITTED_SHARE, MAX_FITTED_DISTANCE = 0.9, 5e-3
"""Share of the readings, the nearest, that must fit, and their largest RMS distance from the arm with fitted
geometry and springs, over its reach [1]. For heavy arms with gear errors and soft links it is 0.001."""
UNNAMED_TARGET_DEVIATION = 1.0
"""Standard deviation of an unnamed target from the tool's origin, along each axis [m]."""
MAX_POINT_DEVIATIONS = 5.0
"""Largest distance of a fixed point from its stated position, over its stated standard deviation [1]."""
MAX_RESIDUAL_EVALUATIONS = 100
"""Most evaluations of the residuals in the search for a fixed point or plane."""
MAX_ORIENTATION_ERROR = 0.1
"""Largest median angle between measured orientations and the nominal arm [rad]; beyond it their notation is
wrong."""


class Misfit(BenchError):
    """Report a series of readings that does not fit the arm in any frame; `series` holds it."""

    def __init__(self, words: str, series: Series) -> None:
        super().__init__(words)
        self.series = series


def align_all(state: ArmState, series: tuple[Series, ...]) -> ArmState:
    """Add the frame and the mount (targets on the tool) of every series to a model; existing ones are kept.

    Args:
        state: The model of the arm.
        series: The readings.

    Returns:
        The model with the frames and mounts of all series.

    Raises:
        BenchError: When a series has too few rows, or does not fit the arm.
    """
    frames, mounts = dict(state.frames), dict(state.mounts)
    # Start with series that determine their own frame and mount, and among these with those that have
    # orientations: they give the mount to the others.
    waiting = sorted(
        series,
        key=lambda readings: (_is_underdetermined(state.vjm, readings), not readings.is_oriented.any()),
    )
    while waiting:
        failed: list[tuple[Series, BenchError]] = []
        for readings in waiting:
            known = mounts.get(readings.mount)
            if readings.frame in frames and known is not None and set(readings.markers) <= set(known.markers):
                continue
            faces = [one for one in series if one.plane_normal is not None and one.frame == readings.frame]
            now = replace(state, frames=frames, mounts=mounts)
            try:
                frame, mount = align(now, without_unread_targets(readings), faces)
            except BenchError as why:  # another series may determine the shared frame or mount
                failed.append((readings, why))
                continue
            frames.setdefault(readings.frame, frame)
            mounts[readings.mount] = mount if known is None else _merge_mounts(known, mount)
        if len(failed) == len(waiting):
            raise failed[0][1]
        waiting = [readings for readings, _ in failed]
    aligned = replace(state, frames=frames, mounts=mounts)
    _check_shared(aligned, series)
    return replace(
        aligned, mounts={**mounts, **{readings.mount: aligned.mount(readings) for readings in series}}
    )


def _is_underdetermined(vjm: Vjm, series: Series) -> bool:
    """Return whether a series by itself leaves its frame or mount undetermined."""
    return bool(underdetermined_reason(vjm, series)) or bool(undetermined_frames(vjm, (series,)))


def align(state: ArmState, series: Series, block_faces: Sequence[Series] = ()) -> tuple[Frame, Mount]:
    """Find the frame and the mount (targets on the tool) of one series by the arm's nominal geometry.

    If the poses do not determine both, the frame or the mount of the model is used. If the model has none,
    but three joints move, the targets are nominal and the frame is upright. If the targets or the tracker
    moved far in mid-series, frame and mount are those of its first half.

    Args:
        state: The model of the arm; it may have the frame or the mount.
        series: The readings.
        block_faces: Heights over all faces of the same block, which share the frame, this series among them.

    Returns:
        The frame (tracker from base) and the mount.

    Raises:
        BenchError: If a target was never read, or the poses determine neither frame nor targets.
        Misfit: If the readings do not fit this arm.
    """
    if lost := [name for name in series.markers if name not in _read_targets(series)]:
        raise BenchError(f"{series.name}: {', '.join(lost)} was never read; leave such a target out")
    if series.distance is not None:
        same = [one for one in block_faces if (one.mount, one.markers) == (series.mount, series.markers)]
        return _by_distances(state, series, same or [series])
    # By the series alone; else with the frame or mount that the state has; else, if enough joints turn, with
    # nominal targets.
    few, turns = underdetermined_reason(state.vjm, series), len(moving_joints(state.vjm, (series,)))
    enough, determined = not few and turns >= MIN_MOVING_JOINTS, not _is_underdetermined(state.vjm, series)
    ways = [*[_registered] * determined, _registered_as_shared, *[_level_layout] * enough]
    placed = None
    for place in (*ways, *[_registered] * (enough and not determined)):
        tried = _aligned(state, series, place)
        if tried is not None and tried.fits_nominal_arm:
            return tried.frame, tried.mount
        if place is _registered:
            placed = tried
    if placed is None and not enough:
        open_ = "its poses do not determine frame and target; turn joints whose axes are not parallel"
        raise BenchError(f"{series.name}: {few or open_}")
    # Something may have moved in mid-series: the frame and mount of its first half.
    halves = np.array_split(np.argsort(series.row_id, kind="stable"), 2)
    parts = [select_rows(series, half) for half in halves if len(half) >= MIN_ROWS_OF_HALF_SERIES]
    fits = [part for half in parts if (part := _aligned(state, half, _registered)) and part.fits_nominal_arm]
    if len(fits) < 2:
        raise _misfit(state, series, placed)
    return fits[0].frame, fits[0].mount


def _by_distances(state: ArmState, series: Series, parts: Sequence[Series]) -> tuple[Frame, Mount]:
    """Find the fixed point or plane and the targets of distances, from their stated places.

    Robust least squares with the nominal arm holds the frame and the targets by their priors. The frame of
    a fixed point has its origin there and the base's axes; that of a plane is the base's, as it is stated.
    All faces of a block are fitted together: they are the parts, else the series alone is.

    Raises:
        BenchError: If the distances are too few, or not those of this arm.
    """
    from scipy.optimize import least_squares  # here: it takes long to import, and few runs need it

    assert series.frame_deviations is not None
    if few := underdetermined_reason(state.vjm, series):
        raise BenchError(f"{series.name}: {few}")
    # Unknowns: steps of the frame, then of the targets, in base axes; a deviation of 0 fixes one.
    targets, known = _nominal_targets(state, series), state.mounts.get(series.mount)
    named = set(series.markers) <= {*state.vjm.arm.markers, *(known.markers if known else ())}
    of_target = NOMINAL_TARGET_DEVIATION if named else UNNAMED_TARGET_DEVIATION
    deviation = np.r_[series.frame_deviations, np.full(targets.size, of_target)]
    free, f = deviation > 0, len(series.frame_deviations)
    arms = [undeflected_arm(state.vjm, part.q, []) for part in parts]

    def moved_frame_and_mount(steps: Array) -> tuple[Frame, Mount]:
        """Move the stated frame and the nominal targets by steps of the free unknowns."""
        every = np.zeros(len(deviation))
        every[free] = steps
        mount = Mount(targets + every[f:].reshape(-1, 3), np.eye(3), series.markers)
        return moved_frame(stated_frame(series), every[:f]), mount

    def distance_errors(steps: Array) -> list[Array]:
        """Compute measured minus modelled distances of each part, (read,) [m]."""
        frame, mount = moved_frame_and_mount(steps)
        moved = replace(state, frames={series.frame: frame}, mounts={series.mount: mount})
        errors = []
        for part, arm in zip(parts, arms, strict=True):
            assert part.distance is not None
            errors.append((part.distance - distance_directions(moved, part, arm)[1].T)[part.is_measured])
        return errors

    def whitened_residuals(steps: Array) -> Array:
        """Compute residuals of readings and priors, over their deviations, (read + free,) [1]."""
        return np.concatenate(
            [np.concatenate(distance_errors(steps)) / ASSUMED_NOISE, steps / deviation[free]]
        )

    # Start at the stated places; the constant of a wire, behind its point, is the median of what is left.
    start = np.zeros(free.sum())
    if series.distance_offset_sigma:
        start[3] = np.median(np.concatenate(distance_errors(start)))
    steps = least_squares(whitened_residuals, start, loss="soft_l1", max_nfev=MAX_RESIDUAL_EVALUATIONS).x
    frame, mount = moved_frame_and_mount(steps)
    for part, before, after in zip(parts, distance_errors(start), distance_errors(steps), strict=True):
        _check_placed(state, part, (before, after), frame)
    return frame, mount


def stated_frame(series: Series) -> Frame:
    """Return the frame of a series whose fixed point or plane is exactly where the user states it.

    The frame of distances has its origin in the fixed point and the axes of the base. The frame of heights
    is that of the base.

    Args:
        series: Distances to a point, or heights over a plane.
    """
    point = series.fixed_point is not None and series.plane_normal is None
    return Frame(np.eye(3), -np.array(series.fixed_point) if point else np.zeros(3))


def _check_placed(state: ArmState, series: Series, left: tuple[Array, Array], frame: Frame) -> None:
    """Refuse distances that do not fit the arm, or a point or plane far from where it is stated.

    Args:
        state: The arm's state.
        series: The distances.
        left: Distance read minus modelled with frame and targets as stated, and as found, (read,) [m].
        frame: The frame that was found.

    Raises:
        BenchError: When one of these is so.
    """
    assert series.distance is not None
    far, plane = float(np.median(np.abs(left[1]))), series.plane_normal is not None
    place = ", ".join(f"{own:.4g}" for own in series.fixed_point or ())
    if not far < MAX_NOMINAL_DISTANCE * state.vjm.reach:
        read = series.distance[series.is_measured]
        times = "" if plane else f", {np.median(read / (read - left[0])):.3g} times as long as expected"
        what, other = ("a plane through", "normal") if plane else ("a fixed point near", "point")
        raise BenchError(
            f"{series.name}: the distances do not fit this arm and {what} {place} m: {far:.3g} m "
            f"off (median){times}; is it another unit, {other} or marker?"
        )
    off, turn, found = deviation_from_stated(series, frame)
    if (
        max(off / series.fixed_point_sigma, turn / series.plane_normal_sigma if plane else 0.0)
        > MAX_POINT_DEVIATIONS
    ):
        what, other = ("plane", "normal") if plane else ("fixed point", "point")
        turned = f" and {np.degrees(turn):.3g} deg" if plane else ""
        raise BenchError(
            f"{series.name}: its {what} is {off:.3g} m{turned} from where it is stated, at "
            f"{', '.join(f'{own:.4g}' for own in found)} m rather than "
            f"{place} m; is it another {other}, sign or axes?"
        )


def deviation_from_stated(series: Series, frame: Frame) -> tuple[float, float, Array]:
    """Compute how far an estimated fixed point or plane is from the stated one.

    Args:
        series: Distances to the point, or heights over the plane, with the stated place.
        frame: The estimated frame of the series.

    Returns:
        Distance of the estimated point from the stated one, or of the estimated plane from its stated point
        [m]; angle between the normals, 0 for a point [rad]; the estimated point, for a plane the nearest to
        the stated one, in base axes, (3,) [m].
    """
    fixed = np.array(series.fixed_point)
    if series.plane_normal is None:
        found = -frame.rotation.T @ frame.translation
        return float(np.linalg.norm(found - fixed)), 0.0, found
    normal = np.array(series.plane_normal)
    u = frame.rotation.T @ normal
    height = float(normal @ (frame.rotation @ fixed + frame.translation - fixed))
    turn = float(np.arctan2(np.linalg.norm(np.cross(u, normal)), u @ normal))
    return abs(height), turn, fixed - height * u


@dataclass(frozen=True)
class _AlignedSeries:
    """Hold the frame and mount of a series, and how well they fit."""

    frame: Frame
    mount: Mount
    typical: float  #: Median distance between readings and the nominal arm [m].
    turn: float  #: Median angle between orientations and the nominal arm [rad]; 0 without orientations.
    near: bool  #: Whether positions fit, with targets closer to the tool than the arm's reach.

    @property
    def fits_nominal_arm(self) -> bool:
        """Tell whether positions and orientations fit the nominal arm, with targets within its reach."""
        return self.near and self.turn < MAX_ORIENTATION_ERROR


def _aligned(
    state: ArmState, series: Series, place: Callable[[ArmState, Series], FramesAndTargets | None]
) -> _AlignedSeries | None:
    """Place a series by MAX_ALIGNED_ROWS of its rows; None if these do not determine it."""
    seen = np.flatnonzero(series.is_measured.any(axis=1))
    sample = select_rows(series, seen[evenly_spaced(len(seen), MAX_ALIGNED_ROWS)])
    layout = place(state, sample)
    if layout is None:
        return None
    typical = float(np.median(np.linalg.norm(left_by(mean_readings(state.vjm, (sample,)), layout), axis=1)))
    turns = _target_orientations(state, sample, layout.rotation[0])
    mount = nearest_rotation(turns.sum(axis=0)) if len(turns) else np.eye(3)
    angles = np.arccos(np.clip((np.trace(mount.T @ turns, axis1=1, axis2=2) - 1) / 2, -1, 1))
    return _AlignedSeries(
        frame=Frame(layout.rotation[0], layout.translation[0]),
        mount=Mount(layout.targets, mount, series.markers),
        typical=typical,
        turn=float(np.median(angles)) if len(turns) else 0.0,
        near=typical < MAX_NOMINAL_DISTANCE * median_tool_distance(state.vjm, sample.q)
        and float(np.abs(layout.targets).max()) < state.vjm.reach,
    )


def _registered(state: ArmState, series: Series) -> FramesAndTargets | None:
    """Register a series by its own readings; None if these do not determine frame and targets."""
    try:
        return register(state.vjm, (series,), {}).frames_and_targets
    except BenchError:
        return None


def _registered_as_shared(state: ArmState, series: Series) -> FramesAndTargets | None:
    """Register a series with the state's frame or mount; None if it has neither or they do not suffice."""
    frame, mount = state.frames.get(series.frame), state.mounts.get(series.mount)
    if frame is None and mount is None:
        return None
    given = {} if frame is None else {series.frame: frame}
    nominal = {} if mount is None else dict(zip(mount.markers, mount.points, strict=True))
    try:
        registration = register(state.vjm, (series,), nominal, given)
    except BenchError:
        return None
    deviation = registration.frames[series.frame].rotation_deviation
    return None if deviation > MAX_FRAME_DEVIATION else registration.frames_and_targets


def _level_layout(state: ArmState, series: Series) -> FramesAndTargets:
    """Fit a frame to nominal targets: those of the state, else of the arm's folder, else the tool's origin.

    The frame is upright as far as the readings leave its rotation undetermined.
    """
    targets = _nominal_targets(state, series)
    position, rotation = tool_poses(state.vjm, series.q)
    points = position[:, None] + targets @ rotation.swapaxes(1, 2)
    frame = fit_upright_frame(points[series.is_measured], series.position[series.is_measured])
    return FramesAndTargets(frame.rotation[None], frame.translation[None], targets)


def _nominal_targets(state: ArmState, series: Series) -> Array:
    """Return the targets of the state, else of the arm's folder, else the tool's origin, (m, 3) [m]."""
    vjm, known = state.vjm, state.mounts.get(series.mount)
    places = dict(zip(vjm.arm.markers, vjm.markers, strict=True))
    places |= dict(zip(known.markers, known.points, strict=True)) if known else {}
    return np.array([places.get(name, np.zeros(3)) for name in series.markers])


def _target_orientations(state: ArmState, series: Series, rotation: Array) -> Array:
    """Compute the tool from the target for every orientation, (read, 3, 3), for a rotation of the frame."""
    if series.rotation is None:
        return np.zeros((0, 3, 3))
    tool = tool_poses(state.vjm, series.q[series.is_oriented])[1]
    return np.asarray(tool.swapaxes(1, 2) @ rotation.T @ series.rotation[series.is_oriented])


def underdetermined_reason(vjm: Vjm, series: Series) -> str:
    """Explain why a series by itself does not determine its frame and mount (targets on the tool).

    Args:
        vjm: The arm's virtual joint model.
        series: The readings.

    Returns:
        The reason; "" if the number of poses and of moving joints suffices.
    """
    poses, joints = (
        len(np.unique(series.q[series.is_measured.any(axis=1)], axis=0)),
        moving_joints(vjm, (series,)),
    )
    turn = MIN_MOVING_JOINTS_ORIENTED if series.is_oriented.any() else MIN_MOVING_JOINTS
    count = 6 + 3 * len(series.markers) + 3 * bool(series.is_oriented.any())
    numbers = f"the {count} numbers of its frame and mount"
    if poses < MIN_REGISTRATION_POSES:
        few = f"{poses} poses with a reading are too few for {numbers}"
        return f"{few}; expected at least {MIN_REGISTRATION_POSES} poses, with {turn} joints that turn"
    if series.plane_normal is not None and _touches_in_a_row(vjm, series):
        return "its poses touch the plane along a line and do not determine its tilt; spread them all over it"
    if len(joints) < min(turn, vjm.arm.n_joints):
        expected = f"{numbers} need {turn} joints that turn, or another series of its frame or mount"
        return f"only {' and '.join(joints)} turn; {expected}"
    return ""


def _touches_in_a_row(vjm: Vjm, series: Series) -> bool:
    """Return whether heights determine the plane's normal worse than its prior, for the nominal arm."""
    drawn = dict(zip(vjm.arm.markers, vjm.markers, strict=True))
    targets = np.array([drawn.get(name, np.zeros(3)) for name in series.markers])
    position, rotation = tool_poses(vjm, series.q)
    points = (position[:, None] + targets @ rotation.swapaxes(1, 2))[series.is_measured]
    across = np.linalg.svd(np.array([series.plane_normal]))[2][1:]  # two axes in the plane
    lever = np.linalg.svd((points - points.mean(axis=0)) @ across.T, compute_uv=False)[-1]
    return bool(lever * series.plane_normal_sigma < ASSUMED_NOISE)


def _misfit(state: ArmState, series: Series, placed: _AlignedSeries | None) -> Misfit:
    """Make the error about a series that does not fit, with its distance from the arm."""
    if placed is not None and placed.near:
        turn = f"{np.degrees(placed.turn):.3g} degrees off (median) for the best mount"
        return Misfit(f"{series.name}: its positions fit this arm, but its orientations are {turn}", series)
    far = "" if placed is None else f": they are {1e3 * placed.typical:.4g} mm off (median) in the best frame"
    places = series.position[series.is_measured], tool_poses(state.vjm, series.q)[0]
    sizes = [float(np.sqrt(x.var(axis=0).sum())) for x in places]
    spread = f"they spread {sizes[0] / sizes[1]:.3g} times as far as its tool"
    return Misfit(f"{series.name}: the readings do not fit this arm{far}; {spread}", series)


def _check_shared(state: ArmState, series: tuple[Series, ...]) -> None:
    """Refuse a series that does not fit the frame or mount that it shares with another, by BenchError."""
    for readings in series:
        others = [other for other in series if other is not readings]
        what = [f"frame {readings.frame!r}"] * any(other.frame == readings.frame for other in others)
        what += [f"mount {readings.mount!r}"] * any(other.mount == readings.mount for other in others)
        off = distance_from_known_frame(state, readings) if what else 0.0
        if off:
            raise BenchError(
                f"{readings.name}: three quarters of its readings are {1e3 * off:.4g} mm or more from the "
                f"positions predicted in the {' and the '.join(what)} that it shares; "
                "did the tracker or the target move between series?"
            )


def check_fitted_distances(state: ArmState, series: Sequence[Series]) -> None:
    """Reject a series that is far from the arm even after its geometry and joint springs are fitted.

    Neither few poses nor a tracker that moved explains such a distance.

    Args:
        state: The fitted arm, with frames and mounts.
        series: The readings.

    Raises:
        Misfit: If the nearest FITTED_SHARE of a series is farther than MAX_FITTED_DISTANCE times the reach.
    """
    for readings in series:
        left = position_residual_lengths(state, readings)[readings.is_measured]
        far = float(np.sqrt(np.mean(np.sort(left)[: max(1, int(FITTED_SHARE * len(left)))] ** 2)))
        if far > MAX_FITTED_DISTANCE * median_tool_distance(state.vjm, readings.q):
            raise Misfit(
                f"{readings.name}: the readings do not fit this arm: {1e3 * far:.4g} mm (RMS of the nearest "
                "nine tenths) after its geometry and springs are fitted",
                readings,
            )


def distance_from_known_frame(state: ArmState, series: Series) -> float:
    """Compute how far a series is from the model with its known frame and mount.

    This is the 25th percentile of the residuals: a quarter may fit even if targets or tracker moved.

    Args:
        state: The arm with the frame and the mount of the series.
        series: The readings.

    Returns:
        Distance that three quarters of the readings exceed [m]; 0 if errors of the nominal arm explain it.
    """
    left = position_residual_lengths(state, series)[series.is_measured]
    off = float(np.percentile(left, 25)) if len(left) else 0.0
    return off if off > 2 * MAX_NOMINAL_DISTANCE * median_tool_distance(state.vjm, series.q) else 0.0


def _merge_mounts(mount: Mount, other: Mount) -> Mount:
    """Add the targets of another series to a mount."""
    new = [k for k, name in enumerate(other.markers) if name not in mount.markers]
    markers = (*mount.markers, *(other.markers[k] for k in new))
    return replace(mount, points=np.concatenate([mount.points, other.points[new]]), markers=markers)


def with_common_targets(series: Sequence[Series]) -> tuple[tuple[Series, ...], list[Issue]]:
    """Give all series with the same mount the same targets in the same order, without targets never read.

    Returns:
        The series, and an issue for each series with a target that no series read.
    """
    completed, notes = [], []
    for readings in series:
        mount = [other for other in series if other.mount == readings.mount]
        every = dict.fromkeys(name for other in mount for name in other.markers)
        read = {name for other in mount for name in _read_targets(other)} or set(every)
        lost = [name for name in readings.markers if name not in read]
        if lost:
            notes.append(Issue("never_read", (readings.name, *lost)))
        completed.append(with_targets(readings, tuple(name for name in every if name in read)))
    return tuple(completed), notes


def without_unread_targets(series: Series) -> Series:
    """Drop the targets without any reading from a series; a series without any reading stays as it is."""
    return with_targets(series, _read_targets(series) or series.markers)


def _read_targets(series: Series) -> tuple[str, ...]:
    """List the targets that were read at least once."""
    return tuple(name for name, seen in zip(series.markers, series.is_measured.T, strict=True) if seen.any())


def with_targets(series: Series, markers: tuple[str, ...]) -> Series:
    """Select and order the targets of a series.

    Args:
        series: The readings.
        markers: Names of the targets, in order; a name that the series lacks counts as never read.
    """
    if markers == series.markers:
        return series
    # The column of every target; that of a target that the series lacks is behind the last one, zero.
    column = [
        series.markers.index(name) if name in series.markers else len(series.markers) for name in markers
    ]

    def select(readings: Array) -> Array:
        return np.concatenate([readings, np.zeros_like(readings[:, :1])], axis=1)[:, column]

    precision = series.precision
    if precision is None and not set(markers) <= set(series.markers):
        precision = np.tile(np.eye(3) / series.sigma**2, (*series.position.shape[:2], 1, 1))
    return replace(
        series,
        markers=markers,
        position=select(series.position),
        precision=None if precision is None else select(precision),
        distance=None if series.distance is None else select(series.distance),
    )
