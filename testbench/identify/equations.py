"""Linear equations of identification: the change of every reading with every unknown, Eq. (3) and (12).

A reading is a position of a target or an orientation, three numbers in base axes. A deflection is the
difference of two readings in one pose: then only compliances remain unknown, Eq. (13). All equations are
divided by the standard deviation of their reading. `weighted_readings` keeps them reading by reading, so that
single readings can be left out.

A dial gauge, a ballbar or a draw-wire reads one number of a marker's motion. The marker moves by d and the
tool rotates by w under a load. A gauge touches a plane face of the tool. The face has the unit normal u and
rotates with the tool: to second order the gauge reads

    t = (u + w x u) . d

A distance to a fixed point, of length r along the unit vector u, changes by

    t = (u + d' / (2 r)) . d,    d' = d - u (u . d)

Both are rows u . A of the observation matrix, Eq. (12), with a direction that changes by milliradians. If u
has the standard deviation a about each axis across it, a reading has the additional variance a^2 |u x d|^2.
Readings of one set-up share this error. It is not estimated; it is part of their covariance.

d and w are predicted by the nominal compliances, after the readings have scaled each joint and all links
together; any readings determine these few factors. Nominal compliances may be wrong by a factor of two. The
scaled prediction is wrong by about a tenth, which changes a standard deviation by a tenth and a direction by
a fraction of a milliradian.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Dataset, Series, line_precision, rotation_between, select_evenly
from testbench.errors import Array, BenchError, Ids
from testbench.identify.absolute.state import (
    ArmState,
    JointEquilibrium,
    Unknowns,
    compliance_unknowns,
    series_equilibrium,
)
from testbench.model.laws import vjm_for_structure
from testbench.model.load import Load, sum_generalised_loads
from testbench.model.structure import Structure
from testbench.model.vjm import (
    Vjm,
    cross,
    evaluate_chain,
    marker_positions,
    observation_rows,
    translational_jacobian,
)

# --- Jacobian and residuals of readings, Eq. (3) and (12) ---------------------------------------------------


def jacobian(
    unknowns: Unknowns,
    equilibrium: JointEquilibrium,
    points: Array,
    series: Series | None = None,
    *,
    with_orientation: bool,
) -> Array:
    """Compute the Jacobian of readings: their change with every unknown, Eq. (3) and (12).

    Mathematics: `abs-3`.

    Args:
        unknowns: The n unknowns.
        equilibrium: The arm at static equilibrium in every run.
        points: Targets in the tool's frame, (m, 3) [m].
        series: The readings if their frame and mount are among the unknowns; else None.
        with_orientation: Whether the orientation of the tool is the last reading.

    Returns:
        Jacobian, base axes, (s, 3, n + 1, runs) [m, rad per unit of each unknown], of s = m or m + 1 readings
        per run; the last column is zero, for residuals.
    """
    where = equilibrium.chain
    m = len(points)
    runs = len(equilibrium.chain.tool_position)
    A = np.zeros((m + with_orientation, 3, unknowns.size + 1, runs))
    J = translational_jacobian(where, points).reshape(m, 3, -1, runs)
    if with_orientation:
        J = np.concatenate([J, where.J_theta[3:][None]])
    if series is not None:
        _add_frame(A[:, :, unknowns.columns(f"frame {series.frame}")], where.tool_points_in_world(points), m)
        _add_mount(A[:, :, unknowns.columns(f"mount {series.mount}")], where.tool_rotation)
    A[:, :, unknowns.columns("geometry")] = J[:, :, unknowns.geometry_slice]
    if unknowns.error_terms.n_coefficients:
        turns = J[:, :, unknowns.vjm.joint_spring_slice, None] * equilibrium.error_basis
        A[:, :, unknowns.columns("errors")] = turns.reshape(*A.shape[:2], -1, runs)
    elastic = unknowns.columns("elastic")
    lines = observation_rows(unknowns.structure, J.reshape(-1, *J.shape[2:]), equilibrium.generalised_loads)
    for k, line in enumerate(lines):
        A[k // 3, k % 3, elastic] = line
    return A


def _add_frame(A: Array, x: Array, m: int) -> None:
    """Add the columns of translation and rotation of the base frame: x + move + turn x x, (s, 3, 6, runs)."""
    for k, axis in enumerate(np.eye(3)):
        A[:m, k, k] = 1.0
        A[:m, :, 3 + k] = cross(axis[:, None, None], x.transpose(2, 1, 0)).transpose(1, 0, 2)
        A[m:, k, 3 + k] = 1.0


def _add_mount(A: Array, R: Array) -> None:
    """Add the columns of every target's move in tool axes, and of the rotation of the oriented target."""
    for k in range(len(A)):
        A[k, :, 3 * k : 3 * k + 3] = R.transpose(1, 2, 0)


def series_equations(unknowns: Unknowns, state: ArmState, series: Series) -> Array:
    """Compute the linearised equations [A | y] of absolute readings: Jacobian A and residuals y.

    Args:
        unknowns: The n unknowns.
        state: The arm, frames and mounts about which the equations are linearised.
        series: The readings, or some of their rows.

    Returns:
        [A | y], base axes, (s, 3, n + 1, rows) [m, rad], of s readings per row: the targets, and the
        orientation if it was read; zero where a reading is lost.
    """
    equilibrium, m = series_equilibrium(state, series), len(series.markers)
    A = jacobian(
        unknowns,
        equilibrium,
        state.mount(series).points,
        series,
        with_orientation=series.rotation is not None,
    )
    A[:m] *= series.is_measured.T[:, None, None]
    A[m:] *= series.is_oriented
    if series.distance is not None:
        # A distance changes by the part along its beam; its fixed point has no axes that could turn.
        u, _ = distance_directions(state, series, equilibrium)
        if series.plane_normal is None:
            A[:, :, unknowns.columns(f"frame {series.frame}")][:, :, 3:] = 0
        A = u[:, :, None] * np.einsum("sxr,sxcr->scr", u, A)[:, None]
        if series.distance_offset_sigma:
            A[:, :, unknowns.columns(f"frame {series.frame}")][:, :, 6] = u * series.is_measured.T[:, None]
    A[:, :, -1] = series_residuals(state, series, equilibrium)
    return A


def distance_directions(
    state: ArmState, series: Series, equilibrium: JointEquilibrium
) -> tuple[Array, Array]:
    """Predict distances of targets from a fixed point or a plane, and their gradients.

    Mathematics: `abs-14` for a fixed point, `abs-15` for a plane.

    Args:
        state: The arm and its frames; the frame of the series places the fixed point or the plane.
        series: Readings of distances from m targets.
        equilibrium: The arm at static equilibrium in every row.

    Returns:
        Gradients with respect to the target's position, unit vectors in base axes, (m, 3, rows) [1], and
        predicted distances, (m, rows) [m].
    """
    frame = state.frame(series)
    beam = (
        equilibrium.chain.tool_points_in_world(state.mount(series).points)
        + frame.translation @ frame.rotation
    )
    if series.plane_normal is not None:
        u = frame.rotation.T @ series.plane_normal
        height = beam @ u - np.dot(series.plane_normal, np.array(series.fixed_point))
        return np.broadcast_to(u[:, None], (beam.shape[1], 3, len(beam))), height.T
    length = np.linalg.norm(beam, axis=2)
    return (beam / length[..., None]).transpose(1, 2, 0), length.T + frame.distance_offset


def series_residuals(state: ArmState, series: Series, equilibrium: JointEquilibrium) -> Array:
    """Compute the residuals of absolute readings: reading minus prediction, in base axes.

    Mathematics: `abs-2`.

    Args:
        state: The arm with its frames and mounts.
        series: The readings.
        equilibrium: The arm at static equilibrium in every row.

    Returns:
        Residuals, (s, 3, rows) [m, rad], of s readings per row: the targets, and the orientation if it was
        read; zero where a reading is lost.
    """
    if series.distance is not None:
        u, length = distance_directions(state, series, equilibrium)
        return np.asarray(u * ((series.distance.T - length) * series.is_measured.T)[:, None])
    frame, mount = state.frame(series), state.mount(series)
    x = equilibrium.chain.tool_points_in_world(mount.points)
    position = ((series.position - frame.translation) @ frame.rotation - x) * series.is_measured[..., None]
    residual = position.transpose(1, 2, 0)
    if series.rotation is None:
        return residual
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    measured = np.where(series.is_oriented[:, None, None], series.rotation, np.eye(3))
    left = frame.rotation.T @ measured @ (equilibrium.chain.tool_rotation @ mount.rotation).swapaxes(1, 2)
    vector = Rotation.from_matrix(left).as_rotvec() * series.is_oriented[:, None]
    return np.concatenate([residual, vector.T[None]])


def undeflected_arm(vjm: Vjm, q: Array, loads: Sequence[Load]) -> JointEquilibrium:
    """Compute kinematics and generalised loads u = J_F^T w of the arm without deflection, Eq. (5).

    Args:
        vjm: The arm's virtual joint model.
        q: Actuated joints, (runs, n) [rad, m].
        loads: Loads that act together in every run.

    Returns:
        The chain at theta = 0, and the generalised loads u on its virtual joints.
    """
    where = evaluate_chain(vjm, q)
    nothing = np.zeros((vjm.arm.n_joints, 0, len(q)))
    return JointEquilibrium(
        np.zeros((len(q), vjm.n_theta)), where, sum_generalised_loads(where, loads), nothing
    )


def deflection_equations(
    unknowns: Unknowns,
    equilibrium: JointEquilibrium,
    data: Dataset,
    run_indices: Ids,
    groups: Ids | None = None,
) -> tuple[Array, Ids]:
    """Compute the weighted equations (13) of some runs: each deflection over its standard deviation.

    Args:
        unknowns: The n compliances.
        equilibrium: The arm in these runs, as `undeflected_arm` returns it.
        data: The dataset.
        run_indices: Indices of the runs, (runs,).
        groups: Number of the group of each run, (runs,): readings of different groups are not combined. None
            for one group.

    Returns:
        [A | y], (s, 3, n + 1, runs) [1], of s readings per run: markers, and the orientation if it was read;
        and the kind of every reading, (s, runs): 0 a position, 1 an orientation, -1 lost.
    """
    m, points = len(data.markers), marker_positions(unknowns.vjm, data.markers)
    A = jacobian(unknowns, equilibrium, points, with_orientation=data.sigma_rotation is not None)
    A[:m, :, -1] = (data.after[run_indices] - data.before[run_indices]).transpose(1, 2, 0)
    if data.rotation_before is not None and data.rotation_after is not None:
        A[m:, :, -1] = rotation_between(data.rotation_before[run_indices], data.rotation_after[run_indices]).T
    return A, whiten_deflections(A, data, run_indices, groups)


def whiten_deflections(A: Array, data: Dataset, run_indices: Ids, groups: Ids | None = None) -> Ids:
    """Divide equations of deflections, in place, by their standard deviation, sqrt(2) sigma of one reading.

    A reading along a line u keeps one row, u . A over its standard deviation; its two other rows become zero.

    Mathematics: `obs-2`.

    Args:
        A: Equations of s readings per run, (s, 3, c, runs) [m, rad]; overwritten.
        data: The dataset.
        run_indices: Indices of the runs of A, (runs,).
        groups: Number of the group of each run, (runs,): readings of different groups are not combined. None
            for one group.

    Returns:
        Kind of every reading, (s, runs): 0 a position, 1 an orientation, -1 lost.
    """
    m = len(data.markers)
    kinds = np.zeros((len(A), len(run_indices)), dtype=int)
    kinds[m:] = 1
    if data.sigma_rotation is not None:
        A[m:] /= math.sqrt(2) * data.sigma_rotation
    if data.precision is None:
        A[:m] /= math.sqrt(2) * data.sigma
        return kinds
    precision = data.precision[run_indices].swapaxes(0, 1)
    lost, lines = np.asarray(~precision.any(axis=(2, 3))), data.is_line_reading[run_indices].T
    root = np.linalg.cholesky(np.where((lost | lines)[..., None, None], np.eye(3), precision))
    if (
        data.line_direction is not None
    ):  # the first column of the root is u over the deviation, the others are zero
        u = data.line_direction[run_indices].swapaxes(0, 1)[lines]
        root[lines] = 0
        root[lines, :, 0] = u * np.sqrt(np.trace(precision[lines], axis1=1, axis2=2))[:, None]
    A[:m] = np.einsum("srxy,sxcr->sycr", root, A[:m], optimize=True)
    kinds[:m][lost] = -1
    if data.tilt_error is not None:
        _separate_set_ups(
            A, data, run_indices, np.zeros(len(run_indices), dtype=int) if groups is None else groups
        )
    return kinds


def _separate_set_ups(A: Array, data: Dataset, runs: Ids, groups: Ids) -> None:
    """Decorrelate readings of one set-up, in place: the error of a gauge's direction is common to them.

    Readings of one marker in one pose share this error; the covariance of two of them is the product of their
    `Dataset.tilt_error`. With L the Cholesky factor of the covariance in standard deviations, their rows
    become L^-1 times them.
    """
    assert data.tilt_error is not None
    lines, pose = data.is_line_reading[runs], data.pose_id[runs]
    deviation = np.sqrt(np.trace(data.covariance[runs], axis1=2, axis2=3))
    share = data.tilt_error[runs] / deviation[..., None]
    for k in range(len(data.markers)):
        for at in np.unique(np.column_stack([pose, groups])[lines[:, k]], axis=0):
            set_up = np.flatnonzero(lines[:, k] & (pose == at[0]) & (groups == at[1]))
            if len(set_up) > 1:
                C = share[set_up, k] @ share[set_up, k].T
                np.fill_diagonal(C, 1.0)
                A[k, 0][:, set_up] = np.linalg.solve(np.linalg.cholesky(C), A[k, 0][:, set_up].T).T


# --- Readings along lines: a dial gauge, a ballbar or a draw-wire reads one number of a marker's motion -----

PREDICTED_MOTION_ERROR = 0.1
"""Error of deflections that `predicted_motion` predicts, over the RMS of the readings [1]."""
COMPLIANCE_SCALE_DEVIATION = 1.0
"""Standard deviation of the factors on nominal compliances in `predicted_motion`, about 1 [1]."""
RUNS_PER_BATCH = 384  #: Runs reduced at a time: long enough for LAPACK, short enough for the cache.


def resolve_line_readings(vjm: Vjm, data: Dataset) -> Dataset:
    """Correct the directions of readings along lines for the deflection, and add their error to the noise.

    Mathematics: `obs-10`.

    Args:
        vjm: The arm's virtual joint model.
        data: The dataset in base axes.

    Returns:
        The dataset with corrected directions, precisions and `tilt_error`; unchanged if no reading is along a
        line, or the correction was made already.
    """
    if (
        data.line_direction is None
        or data.line_direction_deviation is None
        or data.line_length is None
        or data.tilt_error is not None
    ):
        return data
    d, turn = predicted_motion(vjm, data)
    u, lines = data.line_direction, data.is_line_reading[..., None]
    moved = np.where(lines, directions_under_load(u, data.line_length, d, turn), 0.0)
    # The number read, its variance, and the error by the direction that readings of one set-up share.
    slide = data.line_direction_deviation[..., None] * np.cross(moved, d)
    assert data.precision is not None
    weight = np.trace(data.precision, axis1=2, axis2=3)
    variance = np.where(data.is_line_reading, 1 / np.where(data.is_line_reading, weight, 1.0), 1.0) + (
        slide**2
    ).sum(axis=2)
    number = (u * data.deflection).sum(axis=2, keepdims=True)
    return replace(
        data,
        line_direction=moved,
        after=np.where(lines, data.before + moved * number, data.after),
        precision=np.where(lines[..., None], line_precision(moved, np.sqrt(variance / 2)), data.precision),
        tilt_error=slide,
    )


def directions_under_load(
    directions: Array, line_length: Array, displacement: Array, tool_rotation: Array
) -> Array:
    """Compute the directions along which gauges and distance meters read a motion, to second order.

    Mathematics: `obs-9`.

    Args:
        directions: Directions u without load, unit vectors, (runs, m, 3) [1].
        line_length: Distance r from the fixed point, 0 for a gauge on a face of the tool, (runs, m) [m].
        displacement: Motion d of every marker, (runs, m, 3) [m].
        tool_rotation: Rotation w of the tool, (runs, 3) [rad].

    Returns:
        u + w x u for a gauge, u + d' / (2 r) for a distance, with d' = d - u (u . d); normalised to unit
        vectors, (runs, m, 3) [1].
    """
    u = directions
    across = displacement - (u * displacement).sum(axis=2, keepdims=True) * u
    r = np.where(line_length > 0, line_length, 1.0)[..., None]
    moved = np.where(
        line_length[..., None] > 0, u + across / (2 * r), u + np.cross(tool_rotation[:, None], u)
    )
    return np.asarray(moved / np.maximum(np.linalg.norm(moved, axis=2, keepdims=True), np.finfo(float).tiny))


def predicted_motion(vjm: Vjm, data: Dataset) -> tuple[Array, Array]:
    """Predict the motion of all markers by nominal compliances that are scaled to the readings.

    With the motion D_j of the markers by joint j alone, and D_0 by all links, the factors s >= 0 minimise

        sum of |P (D s - y)|^2 / (PREDICTED_MOTION_ERROR RMS(y))^2 + |s - 1|^2 / COMPLIANCE_SCALE_DEVIATION^2

    over all readings y, with P the projection on the measured directions.

    Args:
        vjm: The arm's virtual joint model.
        data: The dataset in base axes.

    Returns:
        Displacement of every marker, (runs, m, 3) [m], and rotation of the tool, (runs, 3) [rad], base axes.
    """
    points = marker_positions(vjm, data.markers)
    parts = []
    turns = []
    for first in range(0, data.n_runs, RUNS_PER_BATCH):
        block = slice(first, first + RUNS_PER_BATCH)
        by_part = _motions_by_part(vjm, data, block, points)
        parts.append(by_part[0])
        turns.append(by_part[1])
    D, W = np.concatenate(parts, axis=1), np.concatenate(turns, axis=1)
    seen = data.is_measured
    read = np.array([data.measured_components(motion)[seen] for motion in D]).reshape(len(D), -1)
    y = data.measured_components(data.deflection)[seen].ravel()
    rough = PREDICTED_MOTION_ERROR * float(np.sqrt((y**2).mean())) or 1.0
    rows = np.vstack([read.T / rough, np.eye(len(D)) / COMPLIANCE_SCALE_DEVIATION])
    from scipy.optimize import nnls  # here: it takes long to import, and few readings are along lines

    s, _ = nnls(rows, np.concatenate([y / rough, np.full(len(D), 1 / COMPLIANCE_SCALE_DEVIATION)]))
    return np.tensordot(s, D, axes=1), np.tensordot(s, W, axes=1)


def _motions_by_part(vjm: Vjm, data: Dataset, block: slice, points: Array) -> tuple[Array, Array]:
    """Compute motions by all links and by each joint: markers, (n + 1, runs, m, 3) [m], and tool [rad]."""
    state = undeflected_arm(vjm, data.q[block], [Load(data.wrench[block], data.point[block])])
    C, first = vjm.arm.C_theta, 6 * len(vjm.arm.links)
    theta = C @ state.generalised_loads[: len(C)]
    J = translational_jacobian(state.chain, points)
    parts = [slice(0, first), *(slice(k, k + 1) for k in range(first, len(C)))]
    runs = J.shape[-1]
    D = [np.einsum("xtr,tr->rx", J[:, part], theta[part]).reshape(runs, len(points), 3) for part in parts]
    W = [np.einsum("xtr,tr->rx", state.chain.J_theta[3:, part], theta[part]) for part in parts]
    return np.array(D), np.array(W)


# --- Limits of datasets, and weighted equations reading by reading, so that readings can be left out --------

MAX_INPUT_NUMBER = 1e9
"""Largest reading, load or coordinate that is accepted [m, N, N m]: squares of larger ones may overflow."""
MAX_DEFLECTION_OVER_REACH = 0.1
"""Largest median deflection over the arm's reach that is accepted [1]: a larger one is in millimetres."""
MAX_ROBUST_READINGS = 5000
"""Largest number of readings in a robust fit; it takes ten seconds and some 100 MB for 153 unknowns."""


def check_runs(vjm: Vjm, data: Dataset) -> None:
    """Check that a dataset has runs and readings, numbers within limits, and joints of this arm.

    Args:
        vjm: The arm's virtual joint model.
        data: The dataset.

    Raises:
        BenchError: If one of these is missing or wrong.
    """
    if data.n_runs == 0:
        raise BenchError("dataset: expected at least one run, got none")
    if not data.is_measured.any():
        raise BenchError(f"dataset: expected readings, but every target was lost in all {data.n_runs} runs")
    for name in ("before", "after", "wrench", "point"):
        values = getattr(data, name)
        largest = max(values.max(), -values.min())  # np.abs would copy the dataset
        if largest > MAX_INPUT_NUMBER:
            raise BenchError(
                f"{name}: expected SI numbers up to {MAX_INPUT_NUMBER:g}, got {largest:g}: too large"
            )
    vjm.arm.check_joint_positions(data.q)


#: Largest number of runs, evenly spaced out of all, in which `check_deflections` looks at deflections.
MAX_CHECKED_RUNS = 1000


def check_deflections(vjm: Vjm, data: Dataset) -> None:
    """Check that deflections are in metres, by their median over the arm's reach.

    Args:
        vjm: The arm's virtual joint model.
        data: The dataset.

    Raises:
        BenchError: When the median deflection over the reach exceeds `MAX_DEFLECTION_OVER_REACH`.
    """
    sample = select_evenly(np.arange(data.n_runs), MAX_CHECKED_RUNS)
    seen = data.deflection[sample][data.is_measured[sample]]
    median = float(np.median(np.linalg.norm(seen, axis=1))) if len(seen) else 0.0
    if median > MAX_DEFLECTION_OVER_REACH * vjm.reach:
        problem = f"the median deflection is {median:.3g} m on an arm that reaches {vjm.reach:.3g} m"
        raise BenchError(f"before, after [m]: expected metres; {problem}")


@dataclass(frozen=True)
class WeightedReadings:
    """Hold the equations A pi = y of Eq. (13), reading by reading, over their standard deviations."""

    A: Array  #: Observation matrices, (readings, 3, n) [1 per unit of pi].
    y: Array  #: Measured deflections and rotations over their standard deviation, (readings, 3) [1].
    #: Standard deviation of a reading, sqrt(2) sigma if equal along all axes, (readings,) [m, rad].
    standard_deviation: Array
    n_components: Ids  #: Count of numbers of a reading: 3, or 1 along a line, (readings,).
    run_index: Ids  #: Index of its run in the dataset, (readings,).
    marker_index: Ids  #: Index of its marker, -1 for the orientation of the tool, (readings,).


def weighted_readings(vjm: Vjm, structure: Structure, data: Dataset) -> WeightedReadings:
    """Compute the weighted equations (13) of a dataset, reading by reading, without lost ones.

    Args:
        vjm: The arm's virtual joint model.
        structure: Structure of the n unknowns.
        data: The dataset; `check_runs` has accepted it.

    Returns:
        Equations, with run, marker and standard deviation of every reading.

    Raises:
        BenchError: When there are more than `MAX_ROBUST_READINGS` readings.
    """
    per_run = len(data.markers) + (data.sigma_rotation is not None)
    if data.n_runs * per_run > MAX_ROBUST_READINGS:
        raise BenchError(
            f"robust fit: expected at most {MAX_ROBUST_READINGS} readings, got {data.n_runs * per_run}"
        )
    data = resolve_line_readings(vjm, data)
    vjm = vjm_for_structure(vjm, structure)
    # Rows of every reading, whitened, without lost ones.
    equilibrium = undeflected_arm(vjm, data.q, [Load(data.wrench, data.point)])
    rows, kinds = deflection_equations(
        compliance_unknowns(vjm, structure), equilibrium, data, np.arange(data.n_runs)
    )
    A, marker = flatten_readings(rows, kinds), np.arange(per_run)
    unit = np.tile(np.eye(3)[None, :, :, None], (per_run, 1, 1, data.n_runs))
    root = flatten_readings(unit, whiten_deflections(unit, data, np.arange(data.n_runs)))
    marker[len(data.markers) :] = -1
    used = (kinds >= 0).T.ravel()
    lines = np.zeros((data.n_runs, per_run), dtype=bool)
    lines[:, : len(data.markers)] = data.is_line_reading
    lines = lines.ravel()[used]
    # Size of a standard deviation: of a position the geometric mean of its axes.
    size = np.abs(np.linalg.det(np.where(lines[:, None, None], np.eye(3), root))) ** (-1 / 3)
    return WeightedReadings(
        A=A[:, :, :-1],
        y=A[:, :, -1],
        standard_deviation=np.where(
            lines, 1 / np.where(lines, np.linalg.norm(root[:, 0], axis=1), 1.0), size
        ),
        n_components=np.where(lines, 1, 3),
        run_index=np.repeat(np.arange(data.n_runs), per_run)[used],
        marker_index=np.tile(marker, data.n_runs)[used],
    )


def flatten_readings(rows: Array, reading_kinds: Ids) -> Array:
    """Reorder equations reading by reading, run after run, without lost readings.

    Args:
        rows: Equations of s readings per run, (s, 3, c, runs).
        reading_kinds: Kind of every reading, (s, runs); -1 for lost ones.

    Returns:
        Equations, (readings, 3, c).
    """
    return np.asarray(
        rows.transpose(3, 0, 1, 2).reshape(-1, *rows.shape[1:3])[(reading_kinds >= 0).T.ravel()]
    )
