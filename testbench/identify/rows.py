"""Jacobian of the readings, Eq. (3) and (12): their change with every unknown, and their residuals.

A reading is a position of a target or an orientation, three numbers in base axes. A pair is the difference of
two readings in one pose: only its compliances remain unknown, Eq. (13).
"""

import math
from collections.abc import Sequence

import numpy as np

from testbench.data.dataset import Dataset, rotation_between
from testbench.data.series import Series
from testbench.errors import Array, Ids
from testbench.identify.absolute.state import ArmState, JointEquilibrium, series_equilibrium
from testbench.identify.absolute.unknowns import Unknowns
from testbench.model.load import Load, on_joints
from testbench.model.vjm import Vjm, chain, cross, marker_points, parameter_rows, translation_rows


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
    where, m, runs = equilibrium.chain, len(points), len(equilibrium.chain.position)
    A = np.zeros((m + rotations, 3, unknowns.size + 1, runs))
    J = translation_rows(where, points).reshape(m, 3, -1, runs)
    if rotations:
        J = np.concatenate([J, where.J_theta[3:][None]])
    if series is not None:
        _add_frame(A[:, :, unknowns.columns(f"frame {series.frame}")], where.points(points), m)
        _add_mount(A[:, :, unknowns.columns(f"mount {series.target}")], where.rotation)
    A[:, :, unknowns.columns("geometry")] = J[:, :, unknowns.inner]
    if unknowns.errors.size:
        own = J[:, :, unknowns.vjm.joint_slice, None] * equilibrium.phi
        A[:, :, unknowns.columns("errors")] = own.reshape(*A.shape[:2], -1, runs)
    elastic = unknowns.columns("elastic")
    lines = parameter_rows(unknowns.structure, J.reshape(-1, *J.shape[2:]), equilibrium.u)
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


def series_rows(unknowns: Unknowns, state: ArmState, series: Series) -> Array:
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
    A[m:] *= series.turned
    A[:, :, -1] = series_residuals(state, series, equilibrium)
    return A


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
    frame, mount = state.frame(series), state.mount(series)
    x = equilibrium.chain.points(mount.points)
    position = ((series.position - frame.translation) @ frame.rotation - x) * series.seen[..., None]
    found = position.transpose(1, 2, 0)
    if series.rotation is None:
        return found
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    measured = np.where(series.turned[:, None, None], series.rotation, np.eye(3))
    left = frame.rotation.T @ measured @ (equilibrium.chain.rotation @ mount.rotation).swapaxes(1, 2)
    vector = Rotation.from_matrix(left).as_rotvec() * series.turned[:, None]
    return np.concatenate([found, vector.T[None]])


def nominal_chain(vjm: Vjm, q: Array, loads: Sequence[Load]) -> JointEquilibrium:
    """Place the undeflected arm in poses, and project loads on its virtual joints, u = J_F^T w, Eq. (5).

    Args:
        vjm: The arm's virtual joint model.
        q: Joint angles, (runs, n) [rad, m].
        loads: Loads that act at once in every run.

    Returns:
        The arm without deflection, with the generalised loads u of every run.
    """
    where = chain(vjm, q)
    nothing = np.zeros((vjm.arm.n_joints, 0, len(q)))
    return JointEquilibrium(np.zeros((len(q), vjm.n_theta)), where, on_joints(where, loads), nothing)


def pair_rows(
    unknowns: Unknowns, equilibrium: JointEquilibrium, data: Dataset, runs: Ids, part: Ids | None = None
) -> tuple[Array, Ids]:
    """Compute the weighted equations (13) of some pairs, in standard deviations of a difference.

    Args:
        unknowns: Compliances, n of them.
        equilibrium: The arm in these runs, `nominal_chain`.
        data: All pairs.
        runs: Places of some of them, (runs,).
        part: Part of each of these, (runs,): rows of different parts are never mixed. None for one part.

    Returns:
        [A | y], (s, 3, n + 1, runs) [1], and the kind of every reading, (s, runs): 0 a position, 1 an
        orientation, -1 lost.
    """
    m, points = len(data.markers), marker_points(unknowns.vjm, data.markers)
    A = jacobian(unknowns, equilibrium, points, rotations=data.sigma_rotation is not None)
    A[:m, :, -1] = (data.after[runs] - data.before[runs]).transpose(1, 2, 0)
    if data.rotation_before is not None and data.rotation_after is not None:
        A[m:, :, -1] = rotation_between(data.rotation_before[runs], data.rotation_after[runs]).T
    return A, whiten(A, data, runs, part)


def whiten(A: Array, data: Dataset, runs: Ids, part: Ids | None = None) -> Ids:
    """Scale moves and turns of pairs, in place, to standard deviations of a difference, sqrt(2) sigma.

    A reading along a line u keeps one row, u . A over its standard deviation; its two other rows become zero.

    Mathematics: `obs-2`.

    Args:
        A: Rows, (s, 3, c, runs) [m, rad]; overwritten.
        data: All pairs.
        runs: Places of the pairs in A, (runs,).
        part: Part of each of these, (runs,): rows of different parts are never mixed. None for one part.

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
    own = data.precision[runs].swapaxes(0, 1)
    lost, lines = np.asarray(~own.any(axis=(2, 3))), data.lines[runs].T
    root = np.linalg.cholesky(np.where((lost | lines)[..., None, None], np.eye(3), own))
    if (
        data.direction is not None
    ):  # the first column of the root is u over the deviation, the others are zero
        u = data.direction[runs].swapaxes(0, 1)[lines]
        root[lines] = 0
        root[lines, :, 0] = u * np.sqrt(np.trace(own[lines], axis1=1, axis2=2))[:, None]
    A[:m] = np.einsum("srxy,sxcr->sycr", root, A[:m], optimize=True)
    kinds[:m][lost] = -1
    if data.slide is not None:
        _separate_set_ups(A, data, runs, np.zeros(len(runs), dtype=int) if part is None else part)
    return kinds


def _separate_set_ups(A: Array, data: Dataset, runs: Ids, part: Ids) -> None:
    """Make rows of one set-up independent, in place: a gauge that stays put keeps its tilt.

    Readings of one marker in one pose share the tilt; the covariance of two of them is the product of their
    slides. Its Cholesky factor L replaces their rows, in standard deviations, by L^-1 times them.
    """
    assert data.slide is not None
    lines, pose = data.lines[runs], data.pose[runs]
    deviation = np.sqrt(np.trace(data.covariance[runs], axis1=2, axis2=3))
    share = data.slide[runs] / deviation[..., None]
    for k in range(len(data.markers)):
        for at in np.unique(np.column_stack([pose, part])[lines[:, k]], axis=0):
            own = np.flatnonzero(lines[:, k] & (pose == at[0]) & (part == at[1]))
            if len(own) > 1:
                C = share[own, k] @ share[own, k].T
                np.fill_diagonal(C, 1.0)
                A[k, 0][:, own] = np.linalg.solve(np.linalg.cholesky(C), A[k, 0][:, own].T).T
