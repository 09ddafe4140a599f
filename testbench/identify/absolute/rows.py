"""Readings against a state: what is left of them, and how every unknown would move it.

A reading is a position of a target or an orientation, three numbers each in base axes.
"""

from dataclasses import dataclass

import numpy as np

from testbench.data.series import Series
from testbench.errors import Array
from testbench.identify.absolute.state import Equilibrium, State, forward, targets
from testbench.identify.absolute.unknowns import Unknowns
from testbench.model.vjm import cross, parameter_rows, translation_rows


@dataclass(frozen=True)
class Rows:
    """Linear equations of some rows of one series."""

    left: Array  #: Reading minus model, (s, 3, runs) [m, rad]: s targets, then an orientation where read.
    A: Array  #: Change of the model with every unknown, (s, 3, size, runs).


def left_over(state: State, series: Series, told: Equilibrium) -> Array:
    """Readings minus model in base axes, (s, 3, runs) [m, rad]; zero where nothing was read."""
    frame, mount = state.frame(series), state.mount(series)
    x = targets(told.where, mount)
    position = ((series.position - frame.translation) @ frame.rotation - x) * series.seen[..., None]
    found = position.transpose(1, 2, 0)
    if series.rotation is None:
        return found
    measured = np.where(series.turned[:, None, None], series.rotation, np.eye(3))
    model = told.where.rotation @ mount.rotation
    turn = _rotation_vector(frame.rotation.T @ measured @ model.swapaxes(1, 2)) * series.turned[:, None]
    return np.concatenate([found, turn.T[None]])


def rows_of(unknowns: Unknowns, state: State, series: Series) -> Rows:
    """Equations of a series, or of a part of one."""
    told = forward(state, series)
    where, mount = told.where, state.mount(series)
    m, turned = len(series.markers), series.rotation is not None
    A = np.zeros((m + turned, 3, unknowns.size, series.rows))
    J = translation_rows(where, mount.points).reshape(m, 3, -1, series.rows)
    if turned:
        J = np.concatenate([J, where.J_theta[3:][None]])
    _add_frame(A[:, :, unknowns.columns(f"frame {series.frame}")], targets(told.where, mount), m)
    _add_mount(A[:, :, unknowns.columns(f"mount {series.target}")], where.rotation, m)
    A[:, :, unknowns.columns("geometry")] = J[:, :, unknowns.inner]
    if unknowns.errors.size:
        arm = unknowns.vjm.arm
        own = J[:, :, -arm.n_joints :, None] * told.phi
        A[:, :, unknowns.columns("errors")] = own.reshape(*A.shape[:2], -1, series.rows)
    lines = parameter_rows(unknowns.structure, J.reshape(-1, *J.shape[2:]), told.u)
    elastic = unknowns.columns("elastic")
    for k, line in enumerate(lines):
        A[k // 3, k % 3, elastic] = line
    A[:m] *= series.seen.T[:, None, None]
    A[m:] *= series.turned
    return Rows(left_over(state, series, told), A)


def _add_frame(A: Array, x: Array, m: int) -> None:
    """Move and turn of the base frame: x + move + turn x x, (s, 3, 6, runs)."""
    for k, axis in enumerate(np.eye(3)):
        A[:m, k, k] = 1.0
        A[:m, :, 3 + k] = cross(axis[:, None, None], x.transpose(2, 1, 0)).transpose(1, 0, 2)
        A[m:, k, 3 + k] = 1.0


def _add_mount(A: Array, R: Array, m: int) -> None:
    """Moves of every target in the tool's axes, then the turn of the one with an orientation."""
    for k in range(m):
        A[k, :, 3 * k : 3 * k + 3] = R.transpose(1, 2, 0)
    for one in A[m:]:
        one[:, 3 * m : 3 * m + 3] = R.transpose(1, 2, 0)


def _rotation_vector(R: Array) -> Array:
    """Of rotations, (runs, 3, 3), their vectors, (runs, 3) [rad]."""
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few runs need it

    return np.asarray(Rotation.from_matrix(R).as_rotvec())
