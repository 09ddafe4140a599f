"""Rows of the linear equations: the change of every reading with every unknown, Eq. (3) and (12).

A reading is a position of a target or an orientation, three numbers in base axes. A pair is the difference of
two readings in one pose: then only compliances remain unknown, Eq. (13). Rows are whitened to standard
deviations. `weighted_readings` keeps them reading by reading, so that single ones can be left out.

A dial gauge, a ballbar or a draw-wire reads one number of a marker's motion. The marker moves by d and the
tool turns by w under a load. A gauge reads the plane face of the tool that its tip touches. The face has the
unit normal u and turns with the tool: to second order the gauge reads

    t = (u + w x u) . d

A distance to a fixed point, at the length r along the unit vector u, changes by

    t = (u + d' / (2 r)) . d,    d' = d - u (u . d)

Both are rows u . A of the observation matrix, Eq. (12), with a direction that moves by milliradians. If u is
known to a standard deviation a about each axis across it, a reading has the further variance a^2 |u x d|^2,
and readings of one set-up share it. The tilt itself is not estimated: it is marginalised.

d and w are predicted by the arm's folder, after the readings have scaled its joints and its links; any
readings determine these few unknowns. A prior may be wrong by a factor of two. This prediction is wrong by
about a tenth, which changes a standard deviation by a tenth and a direction by a part of a milliradian.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Dataset, Series, along_lines, rotation_between, select_evenly
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

# --- Jacobian of the readings, Eq. (3) and (12): their change with every unknown, and their residuals -------


def jacobian(
    unknowns: Unknowns,
    equilibrium: JointEquilibrium,
    points: Array,
    series: Series | None = None,
    *,
    rotations: bool,
) -> Array:
    """Compute the change of readings with every unknown, Eq. (3) and (12).

    Mathematics: `abs-3`.

    Args:
        unknowns: The unknowns, `size` of them.
        equilibrium: The arm at rest in every run.
        points: Targets in the tool's frame, (m, 3) [m].
        series: Readings whose frame and mount are unknown; None where neither is.
        rotations: Whether an orientation follows the targets.

    Returns:
        (m or m + 1, 3, size + 1, runs) [m, rad per unit of each unknown]; the last column is zero.
    """
    where = equilibrium.chain
    m = len(points)
    runs = len(equilibrium.chain.tool_position)
    A = np.zeros((m + rotations, 3, unknowns.size + 1, runs))
    J = translational_jacobian(where, points).reshape(m, 3, -1, runs)
    if rotations:
        J = np.concatenate([J, where.J_theta[3:][None]])
    if series is not None:
        _add_frame(A[:, :, unknowns.columns(f"frame {series.frame}")], where.tool_points_in_world(points), m)
        _add_mount(A[:, :, unknowns.columns(f"mount {series.target}")], where.tool_rotation)
    A[:, :, unknowns.columns("geometry")] = J[:, :, unknowns.geometry_slice]
    if unknowns.error_terms.n_coefficients:
        turns = J[:, :, unknowns.vjm.joint_spring_slice, None] * equilibrium.error_basis
        A[:, :, unknowns.columns("errors")] = turns.reshape(*A.shape[:2], -1, runs)
    elastic = unknowns.columns("elastic")
    lines = observation_rows(unknowns.structure, J.reshape(-1, *J.shape[2:]), equilibrium.u)
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
    """Compute the rows [A | y] of a series at a state, y the reading minus the model.

    Args:
        unknowns: The unknowns, `size` of them.
        state: Where the equations are linearised.
        series: The readings, or a part of them.

    Returns:
        (s, 3, size + 1, rows) [m, rad]; zero where nothing was read.
    """
    equilibrium, m = series_equilibrium(state, series), len(series.markers)
    A = jacobian(
        unknowns, equilibrium, state.mount(series).points, series, rotations=series.rotation is not None
    )
    A[:m] *= series.seen.T[:, None, None]
    A[m:] *= series.oriented
    if series.distance is not None:
        # A distance changes by the part along its beam; its fixed point has no axes that could turn.
        u, _ = distance_directions(state, series, equilibrium)
        if series.normal is None:
            A[:, :, unknowns.columns(f"frame {series.frame}")][:, :, 3:] = 0
        A = u[:, :, None] * np.einsum("sxr,sxcr->scr", u, A)[:, None]
        if series.zero_sigma:
            A[:, :, unknowns.columns(f"frame {series.frame}")][:, :, 6] = u * series.seen.T[:, None]
    A[:, :, -1] = series_residuals(state, series, equilibrium)
    return A


def distance_directions(
    state: ArmState, series: Series, equilibrium: JointEquilibrium
) -> tuple[Array, Array]:
    """Compute the directions in which targets change their distances, and the distances.

    Mathematics: `abs-14` for a fixed point, `abs-15` for a plane.

    Args:
        state: The model; the origin of the frame is the fixed point, or the frame has the plane as stated.
        series: Distances.
        equilibrium: The arm at rest in every row.

    Returns:
        Unit vectors in base axes, (m, 3, rows) [1], and distances as read, (m, rows) [m].
    """
    frame = state.frame(series)
    beam = (
        equilibrium.chain.tool_points_in_world(state.mount(series).points)
        + frame.translation @ frame.rotation
    )
    if series.normal is not None:
        u = frame.rotation.T @ series.normal
        height = beam @ u - np.dot(series.normal, np.array(series.fixed))
        return np.broadcast_to(u[:, None], (beam.shape[1], 3, len(beam))), height.T
    length = np.linalg.norm(beam, axis=2)
    return (beam / length[..., None]).transpose(1, 2, 0), length.T + frame.distance_offset


def series_residuals(state: ArmState, series: Series, equilibrium: JointEquilibrium) -> Array:
    """Compute residuals, readings minus model, in base axes.

    Mathematics: `abs-2`.

    Args:
        state: The model with its frames and mounts.
        series: The readings.
        equilibrium: The arm at rest in every row.

    Returns:
        (s, 3, rows) [m, rad]; zero where nothing was read.
    """
    if series.distance is not None:
        u, length = distance_directions(state, series, equilibrium)
        return np.asarray(u * ((series.distance.T - length) * series.seen.T)[:, None])
    frame, mount = state.frame(series), state.mount(series)
    x = equilibrium.chain.tool_points_in_world(mount.points)
    position = ((series.position - frame.translation) @ frame.rotation - x) * series.seen[..., None]
    residual = position.transpose(1, 2, 0)
    if series.rotation is None:
        return residual
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    measured = np.where(series.oriented[:, None, None], series.rotation, np.eye(3))
    left = frame.rotation.T @ measured @ (equilibrium.chain.tool_rotation @ mount.rotation).swapaxes(1, 2)
    vector = Rotation.from_matrix(left).as_rotvec() * series.oriented[:, None]
    return np.concatenate([residual, vector.T[None]])


def undeflected_arm(vjm: Vjm, q: Array, loads: Sequence[Load]) -> JointEquilibrium:
    """Place the undeflected arm in poses, and project loads on its virtual joints, u = J_F^T w, Eq. (5).

    Args:
        vjm: The arm's virtual joint model.
        q: Joint angles, (runs, n) [rad, m].
        loads: Loads that act at once in every run.

    Returns:
        The arm without deflection, with the generalised loads u of every run.
    """
    where = evaluate_chain(vjm, q)
    nothing = np.zeros((vjm.arm.n_joints, 0, len(q)))
    return JointEquilibrium(
        np.zeros((len(q), vjm.n_theta)), where, sum_generalised_loads(where, loads), nothing
    )


def deflection_equations(
    unknowns: Unknowns, equilibrium: JointEquilibrium, data: Dataset, runs: Ids, groups: Ids | None = None
) -> tuple[Array, Ids]:
    """Compute the weighted equations (13) of some pairs, in standard deviations of a difference.

    Args:
        unknowns: Compliances, n of them.
        equilibrium: The arm in these runs, `undeflected_arm`.
        data: All pairs.
        runs: Places of some of them, (runs,).
        groups: Part of each of these, (runs,): rows of different parts are never mixed. None for one part.

    Returns:
        [A | y], (s, 3, n + 1, runs) [1], and the kind of every reading, (s, runs): 0 a position, 1 an
        orientation, -1 lost.
    """
    m, points = len(data.markers), marker_positions(unknowns.vjm, data.markers)
    A = jacobian(unknowns, equilibrium, points, rotations=data.sigma_rotation is not None)
    A[:m, :, -1] = (data.after[runs] - data.before[runs]).transpose(1, 2, 0)
    if data.rotation_before is not None and data.rotation_after is not None:
        A[m:, :, -1] = rotation_between(data.rotation_before[runs], data.rotation_after[runs]).T
    return A, whiten_deflections(A, data, runs, groups)


def whiten_deflections(A: Array, data: Dataset, runs: Ids, groups: Ids | None = None) -> Ids:
    """Scale moves and turns of pairs, in place, to standard deviations of a difference, sqrt(2) sigma.

    A reading along a line u keeps one row, u . A over its standard deviation; its two other rows become zero.

    Mathematics: `obs-2`.

    Args:
        A: Rows, (s, 3, c, runs) [m, rad]; overwritten.
        data: All pairs.
        runs: Places of the pairs in A, (runs,).
        groups: Part of each of these, (runs,): rows of different parts are never mixed. None for one part.

    Returns:
        Kind of every reading, (s, runs): 0 a position, 1 an orientation, -1 lost.
    """
    m = len(data.markers)
    kinds = np.zeros((len(A), len(runs)), dtype=int)
    kinds[m:] = 1
    if data.sigma_rotation is not None:
        A[m:] /= math.sqrt(2) * data.sigma_rotation
    if data.precision is None:
        A[:m] /= math.sqrt(2) * data.sigma
        return kinds
    precision = data.precision[runs].swapaxes(0, 1)
    lost, lines = np.asarray(~precision.any(axis=(2, 3))), data.lines[runs].T
    root = np.linalg.cholesky(np.where((lost | lines)[..., None, None], np.eye(3), precision))
    if (
        data.direction is not None
    ):  # the first column of the root is u over the deviation, the others are zero
        u = data.direction[runs].swapaxes(0, 1)[lines]
        root[lines] = 0
        root[lines, :, 0] = u * np.sqrt(np.trace(precision[lines], axis1=1, axis2=2))[:, None]
    A[:m] = np.einsum("srxy,sxcr->sycr", root, A[:m], optimize=True)
    kinds[:m][lost] = -1
    if data.slide is not None:
        _separate_set_ups(A, data, runs, np.zeros(len(runs), dtype=int) if groups is None else groups)
    return kinds


def _separate_set_ups(A: Array, data: Dataset, runs: Ids, groups: Ids) -> None:
    """Make rows of one set-up independent, in place: a gauge that is not moved keeps its tilt.

    Readings of one marker in one pose share the tilt; the covariance of two of them is the product of their
    slides. Its Cholesky factor L replaces their rows, in standard deviations, by L^-1 times them.
    """
    assert data.slide is not None
    lines, pose = data.lines[runs], data.pose[runs]
    deviation = np.sqrt(np.trace(data.covariance[runs], axis1=2, axis2=3))
    share = data.slide[runs] / deviation[..., None]
    for k in range(len(data.markers)):
        for at in np.unique(np.column_stack([pose, groups])[lines[:, k]], axis=0):
            set_up = np.flatnonzero(lines[:, k] & (pose == at[0]) & (groups == at[1]))
            if len(set_up) > 1:
                C = share[set_up, k] @ share[set_up, k].T
                np.fill_diagonal(C, 1.0)
                A[k, 0][:, set_up] = np.linalg.solve(np.linalg.cholesky(C), A[k, 0][:, set_up].T).T


# --- Readings along lines: a dial gauge, a ballbar or a draw-wire reads one number of a marker's motion -----

PREDICTED_MOTION_ERROR = 0.1
"""Error of a model of scaled joints and links, over the RMS of the readings [1]."""
PART_SCALE_DEVIATION = 1.0
"""Standard deviation of every scale about that of the arm's folder [1]."""
BLOCK_RUNS = 384  #: Runs whose Jacobians are in memory at a time.


def resolve_line_readings(vjm: Vjm, data: Dataset) -> Dataset:
    """Turn directions of readings along lines with the loaded arm, and count their tilt as noise.

    Mathematics: `obs-10`.

    Args:
        vjm: The arm's virtual joint model.
        data: The runs, in the base's frame.

    Returns:
        The runs with `slide`, directions and precisions; as they are if they have no readings along lines, or
        have their slide already.
    """
    if data.direction is None or data.tilt is None or data.reach is None or data.slide is not None:
        return data
    d, turn = predicted_motion(vjm, data)
    u, lines = data.direction, data.lines[..., None]
    moved = np.where(lines, directions_under_load(u, data.reach, d, turn), 0.0)
    # The reading, its variance and the part that its set-up shares.
    slide = data.tilt[..., None] * np.cross(moved, d)
    assert data.precision is not None
    weight = np.trace(data.precision, axis1=2, axis2=3)
    variance = np.where(data.lines, 1 / np.where(data.lines, weight, 1.0), 1.0) + (slide**2).sum(axis=2)
    number = (u * data.deflection).sum(axis=2, keepdims=True)
    return replace(
        data,
        direction=moved,
        after=np.where(lines, data.before + moved * number, data.after),
        precision=np.where(lines[..., None], along_lines(moved, np.sqrt(variance / 2)), data.precision),
        slide=slide,
    )


def directions_under_load(u: Array, reach: Array, displacement: Array, tool_rotation: Array) -> Array:
    """Compute the directions along which motions are read to second order.

    Mathematics: `obs-9`.

    Args:
        u: Directions at the unloaded arm, unit vectors, (runs, m, 3) [1].
        reach: Lengths of distances, 0 for a gauge on a face of the tool, (runs, m) [m].
        displacement: Motion of every marker, (runs, m, 3) [m].
        tool_rotation: Rotation of the tool, (runs, 3) [rad].

    Returns:
        u + w x u for a gauge, u + d' / (2 r) for a distance, as unit vectors, (runs, m, 3) [1].
    """
    across = displacement - (u * displacement).sum(axis=2, keepdims=True) * u
    r = np.where(reach > 0, reach, 1.0)[..., None]
    moved = np.where(reach[..., None] > 0, u + across / (2 * r), u + np.cross(tool_rotation[:, None], u))
    return np.asarray(moved / np.maximum(np.linalg.norm(moved, axis=2, keepdims=True), np.finfo(float).tiny))


def predicted_motion(vjm: Vjm, data: Dataset) -> tuple[Array, Array]:
    """Predict the motion of all markers by the arm's folder, its joints and its links scaled to the readings.

    With the motion D_j of the markers by joint j alone, and D_0 by all links, the scales s >= 0 minimise

        sum of |P (D s - y)|^2 / (PREDICTED_MOTION_ERROR RMS(y))^2 + |s - 1|^2 / PART_SCALE_DEVIATION^2

    over all readings y, with P the projection on the measured directions.

    Args:
        vjm: The arm's virtual joint model.
        data: The runs.

    Returns:
        Displacement of every marker, (runs, m, 3) [m], and rotation of the tool, (runs, 3) [rad].
    """
    points = marker_positions(vjm, data.markers)
    parts = []
    turns = []
    for first in range(0, data.runs, BLOCK_RUNS):
        block = slice(first, first + BLOCK_RUNS)
        by_part = _motions_by_part(vjm, data, block, points)
        parts.append(by_part[0])
        turns.append(by_part[1])
    D, W = np.concatenate(parts, axis=1), np.concatenate(turns, axis=1)
    seen = data.seen
    read = np.array([data.measured_components(motion)[seen] for motion in D]).reshape(len(D), -1)
    y = data.measured_components(data.deflection)[seen].ravel()
    rough = PREDICTED_MOTION_ERROR * float(np.sqrt((y**2).mean())) or 1.0
    rows = np.vstack([read.T / rough, np.eye(len(D)) / PART_SCALE_DEVIATION])
    from scipy.optimize import nnls  # here: it takes long to import, and few readings are along lines

    s, _ = nnls(rows, np.concatenate([y / rough, np.full(len(D), 1 / PART_SCALE_DEVIATION)]))
    return np.tensordot(s, D, axes=1), np.tensordot(s, W, axes=1)


def _motions_by_part(vjm: Vjm, data: Dataset, block: slice, points: Array) -> tuple[Array, Array]:
    """Compute motions of markers, (n + 1, runs, m, 3) [m], and turns, (n + 1, runs, 3), of each part."""
    state = undeflected_arm(vjm, data.q[block], [Load(data.wrench[block], data.point[block])])
    C, first = vjm.arm.C_theta, 6 * len(vjm.arm.links)
    theta = C @ state.u[: len(C)]
    J = translational_jacobian(state.chain, points)
    parts = [slice(0, first), *(slice(k, k + 1) for k in range(first, len(C)))]
    runs = J.shape[-1]
    D = [np.einsum("xtr,tr->rx", J[:, part], theta[part]).reshape(runs, len(points), 3) for part in parts]
    W = [np.einsum("xtr,tr->rx", state.chain.J_theta[3:, part], theta[part]) for part in parts]
    return np.array(D), np.array(W)


# --- Readings of pairs one by one, weighted, so that single ones can be left out; and limits of datasets ----

MAX_INPUT_NUMBER = 1e9
"""Largest reading, load or coordinate [m, N, N m]: squares of larger ones may overflow."""
MAX_DEFLECTION = 0.1
"""Largest median deflection, as a share of the arm's reach [1]: larger ones are in millimetres."""
MAX_ROBUST_READINGS = 5000
"""Most readings in one program: about ten seconds and some hundred megabytes for 153 unknowns."""


def check_runs(vjm: Vjm, data: Dataset) -> None:
    """Refuse runs that cannot be reduced: none, no reading, another arm, or numbers that are too large.

    Args:
        vjm: The arm's virtual joint model.
        data: The runs.

    Raises:
        BenchError: When the dataset is one of these.
    """
    if data.runs == 0:
        raise BenchError("dataset: expected at least one run, got none")
    if not data.seen.any():
        raise BenchError(f"dataset: expected readings, but every target was lost in all {data.runs} runs")
    for name in ("before", "after", "wrench", "point"):
        values = getattr(data, name)
        largest = max(values.max(), -values.min())  # np.abs would copy the dataset
        if largest > MAX_INPUT_NUMBER:
            raise BenchError(
                f"{name}: expected SI numbers up to {MAX_INPUT_NUMBER:g}, got {largest:g}: too large"
            )
    vjm.arm.check_joint_positions(data.q)


MAX_CHECKED_RUNS = 1000  #: Most runs, evenly out of all, whose deflections tell a wrong unit.


def check_deflections(vjm: Vjm, data: Dataset) -> None:
    """Refuse deflections of another unit than metres.

    Args:
        vjm: The arm's virtual joint model.
        data: The runs.

    Raises:
        BenchError: When the median deflection exceeds `MAX_DEFLECTION` of the arm's reach.
    """
    sample = select_evenly(np.arange(data.runs), MAX_CHECKED_RUNS)
    seen = data.deflection[sample][data.seen[sample]]
    median = float(np.median(np.linalg.norm(seen, axis=1))) if len(seen) else 0.0
    if median > MAX_DEFLECTION * vjm.reach:
        problem = f"the median deflection is {median:.3g} m on an arm that reaches {vjm.reach:.3g} m"
        raise BenchError(f"before, after [m]: expected metres; {problem}")


@dataclass(frozen=True)
class WeightedReadings:
    """Hold rows of Eq. (13), reading by reading, in standard deviations."""

    A: Array  #: Observation matrices, (readings, 3, n).
    y: Array  #: Measured deflections, (readings, 3) [1].
    deviation: (
        Array  #: Standard deviation of each, sqrt(2) sigma if all axes are equal, (readings,) [m, rad].
    )
    n_components: Ids  #: Numbers of each reading: 3, or 1 along a line, (readings,).
    run_index: Ids  #: Index of its run in the dataset, (readings,).
    marker_index: Ids  #: Index of its marker, -1 for the orientation, (readings,).


def weighted_readings(vjm: Vjm, structure: Structure, data: Dataset) -> WeightedReadings:
    """Compute the weighted equations (13) reading by reading; `reduce` has checked the dataset.

    Args:
        vjm: The arm's virtual joint model.
        structure: The unknowns, n of them.
        data: The runs.

    Returns:
        Rows, readings and their units.

    Raises:
        BenchError: When there are more than `MAX_REGISTERED_READINGS` readings.
    """
    per_run = len(data.markers) + (data.sigma_rotation is not None)
    if data.runs * per_run > MAX_ROBUST_READINGS:
        raise BenchError(
            f"robust fit: expected at most {MAX_ROBUST_READINGS} readings, got {data.runs * per_run}"
        )
    data = resolve_line_readings(vjm, data)
    vjm = vjm_for_structure(vjm, structure)
    # Rows of every reading, whitened, without lost ones.
    equilibrium = undeflected_arm(vjm, data.q, [Load(data.wrench, data.point)])
    rows, kinds = deflection_equations(
        compliance_unknowns(vjm, structure), equilibrium, data, np.arange(data.runs)
    )
    A, marker = rows_of_readings(rows, kinds), np.arange(per_run)
    unit = np.tile(np.eye(3)[None, :, :, None], (per_run, 1, 1, data.runs))
    root = rows_of_readings(unit, whiten_deflections(unit, data, np.arange(data.runs)))
    marker[len(data.markers) :] = -1
    used = (kinds >= 0).T.ravel()
    lines = np.zeros((data.runs, per_run), dtype=bool)
    lines[:, : len(data.markers)] = data.lines
    lines = lines.ravel()[used]
    # Size of a standard deviation: of a position the geometric mean of its axes.
    size = np.abs(np.linalg.det(np.where(lines[:, None, None], np.eye(3), root))) ** (-1 / 3)
    return WeightedReadings(
        A=A[:, :, :-1],
        y=A[:, :, -1],
        deviation=np.where(lines, 1 / np.where(lines, np.linalg.norm(root[:, 0], axis=1), 1.0), size),
        n_components=np.where(lines, 1, 3),
        run_index=np.repeat(np.arange(data.runs), per_run)[used],
        marker_index=np.tile(marker, data.runs)[used],
    )


def rows_of_readings(rows: Array, kinds: Ids) -> Array:
    """Select the rows of readings that were not lost.

    Args:
        rows: Rows, (s, 3, c, runs).
        kinds: Kind of every reading, (s, runs); -1 for lost ones.

    Returns:
        Rows reading by reading, (readings, 3, c).
    """
    return np.asarray(rows.transpose(3, 0, 1, 2).reshape(-1, *rows.shape[1:3])[(kinds >= 0).T.ravel()])
