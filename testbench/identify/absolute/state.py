"""State of a calibrated arm (geometry, springs, joint errors, frames, mounts), and its static equilibrium.

    theta = theta_0 + C_theta u(q, theta, loads) + Phi(q) n

Everything is a virtual joint. Constants theta_0 of the inner links are errors of geometry; those of the first
and of the last link are the frame (base in the tracker's frame) and the mount (targets in the tool's frame)
of each series.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from testbench.data.series import Series
from testbench.display import Displayed
from testbench.errors import Array, BenchError, NoEquilibrium
from testbench.identify.registration import Frame
from testbench.model.joint_errors import JointErrors, basis
from testbench.model.load import Load, Weights, on_joints, own_weight
from testbench.model.vjm import Chain, Vjm, chain

ROWS_AT_ONCE = 500
"""Rows whose Jacobian is in memory at a time."""
TOLERANCE = 1e-11
"""Step at which the equilibrium has converged [m, rad]."""
MAX_STEPS = 100
"""Most steps to the equilibrium."""
LOAD_STEPS = 2
"""Updates of the loads for the deflected arm; each reduces the error by a factor of a hundred or more."""


@dataclass(frozen=True)
class Mount:
    """Describe targets on the tool."""

    points: Array  #: Positions in the tool's frame, (m, 3) [m].
    rotation: Array  #: Tool from the target with an orientation, (3, 3); identity without one.
    markers: tuple[str, ...]  #: Names of the targets, in the order of the points.


@dataclass(frozen=True, repr=False)
class ArmState(Displayed):
    """Describe a calibrated arm."""

    vjm: Vjm  #: Nominal kinematics.
    weights: Weights  #: Masses of the links.
    theta_0: Array  #: Constants of the virtual joints, (n_theta,) [m, rad]: errors of geometry.
    C_theta: Array  #: Compliances, (n_theta, n_theta) [m/N, rad/(N m)].
    errors: JointErrors  #: Kinds of joint errors.
    n: Array  #: Coefficients of the joint errors, (n joints, k) [rad, m].
    torque_scale: Array  #: Typical torque of every joint, (n,) [N m, N].
    frames: Mapping[str, Frame] = field(default_factory=dict)  #: Tracker frames by name.
    mounts: Mapping[str, Mount] = field(default_factory=dict)  #: Mounts by name.

    def frame(self, series: Series) -> Frame:
        """Return the frame of a series.

        Args:
            series: The readings.

        Returns:
            The frame.

        Raises:
            BenchError: If it is not known.
        """
        if series.frame not in self.frames:
            raise BenchError(f"{series.name}: its frame {series.frame!r} is not known")
        return self.frames[series.frame]

    def mount(self, series: Series) -> Mount:
        """Return the mount of a series, targets in the order of the series.

        Args:
            series: The readings.

        Returns:
            The mount.

        Raises:
            BenchError: If the mount or one of its targets is not known.
        """
        if series.target not in self.mounts:
            raise BenchError(f"{series.name}: its target {series.target!r} is not known")
        mount = self.mounts[series.target]
        unknown = [name for name in series.markers if name not in mount.markers]
        if unknown:
            have = ", ".join(mount.markers)
            raise BenchError(f"{series.name}: no target {', '.join(unknown)} is known; there are {have}")
        at = [mount.markers.index(name) for name in series.markers]
        return replace(mount, points=mount.points[at], markers=series.markers)


def nominal_state(vjm: Vjm, weights: Weights, torque_scale: Array) -> ArmState:
    """Make the state of the nominal arm: rigid, without errors.

    Args:
        vjm: The arm's virtual joint model.
        weights: Weights of the links.
        torque_scale: Typical torque of every joint, (n,) [N m, N].

    Returns:
        The state.
    """
    n = vjm.n_theta
    empty = np.zeros((vjm.arm.n_joints, 0))
    return ArmState(vjm, weights, np.zeros(n), np.zeros((n, n)), JointErrors(), empty, torque_scale)


@dataclass(frozen=True)
class JointEquilibrium:
    """Hold the virtual joints at rest under some loads."""

    theta: Array  #: Virtual joints, (runs, n_theta) [m, rad].
    chain: Chain  #: Tool pose and Jacobian at rest.
    u: Array  #: Generalised load of every virtual joint at rest, (n_theta, runs) [N, N m].
    phi: Array  #: Functions of the joint errors, (n joints, k, runs).


def joint_equilibrium(
    state: ArmState, q: Array, loads: Sequence[Load] = (), steps: int | None = None
) -> JointEquilibrium:
    """Solve for the equilibrium of every pose under own weight and all loads, by fixed-point steps.

    Each step applies the loads to the arm as the last step deflected it. Steps converge only if the loaded
    springs K_theta - K_w of Eq. (7) are stable, so an arm that buckles is detected.

    Mathematics: `loaded-1`.

    Args:
        state: The arm.
        q: Commanded joints, (runs, n) [rad, m].
        loads: Loads that act at once, each with one row per run.
        steps: Number of steps; None to iterate to convergence.

    Returns:
        The arm at rest in every pose.

    Raises:
        NoEquilibrium: If the steps do not converge; names the pose.
    """
    start, u, phi = _start(state, q, loads)
    theta, step = start + (state.C_theta @ u).T, np.zeros(len(q))
    # theta <- theta_0 + Phi(q) n + C_theta u(q, theta), until the step is at rounding.
    for _ in range(MAX_STEPS if steps is None else steps):
        where = chain(state.vjm, q, theta)
        u = loads_at(state, where, loads)
        bent = start + (state.C_theta @ u).T
        step = np.abs(bent - theta).max(axis=1, initial=0)
        theta = bent
        if (step <= TOLERANCE).all():  # not of NaN
            return JointEquilibrium(theta, where, u, phi)
    if steps is None:
        words = state.vjm.arm.words(q[np.argmin(step <= TOLERANCE)])
        raise NoEquilibrium(f"no static equilibrium at q = {words}: too soft for its load, or buckled")
    return JointEquilibrium(theta, chain(state.vjm, q, theta), u, phi)


def _start(state: ArmState, q: Array, loads: Sequence[Load]) -> tuple[Array, Array, Array]:
    """Compute virtual joints without springs, (runs, n_theta), the load of the undeflected arm, and phi."""
    arm, theta = state.vjm.arm, np.tile(state.theta_0, (len(q), 1))
    u, joints = loads_at(state, chain(state.vjm, q, theta), loads), slice(6 * len(arm.links), arm.n_theta)
    phi = basis(state.errors, arm, q, u[joints], state.torque_scale)
    theta[:, joints] += np.einsum("jkr,jk->rj", phi, state.n)
    return theta, u, phi


def loads_at(state: ArmState, where: Chain, loads: Sequence[Load]) -> Array:
    """Compute the generalised load u of every virtual joint, from own weight and all loads.

    Args:
        state: The model.
        where: The poses.
        loads: Loads that act at once.

    Returns:
        u, (n_theta, runs) [N, N m].
    """
    return own_weight(where, state.weights) + on_joints(where, loads)


def unsprung_theta(state: ArmState, q: Array, loads: Sequence[Load]) -> Array:
    """Compute the virtual joints without their springs: theta_0 + Phi(q) n.

    Args:
        state: The model.
        q: Joint angles, (runs, n) [rad, m].
        loads: Loads that act at once.

    Returns:
        theta, (runs, n_theta) [m, rad].
    """
    if not state.errors.size:
        return np.tile(state.theta_0, (len(q), 1))
    return _start(state, q, loads)[0]


def series_equilibrium(state: ArmState, series: Series) -> JointEquilibrium:
    """Compute the arm at rest in every row of a series, by `LOAD_STEPS` steps.

    Mathematics: `abs-1`.

    Args:
        state: The model.
        series: The readings, which give poses and loads.

    Returns:
        The arm in every row, in base axes.
    """
    loads = [Load(series.wrench, series.point)] if series.wrench.any() else []
    return joint_equilibrium(state, series.q, loads, LOAD_STEPS)


def torque_scale(vjm: Vjm, weights: Weights, series: tuple[Series, ...]) -> Array:
    """Compute the root mean square torque of every joint over all rows.

    Args:
        vjm: The arm's virtual joint model.
        weights: Weights of the links.
        series: The readings, which give poses and loads.

    Returns:
        Torque, (n,) [N m, N].
    """
    total = np.zeros(vjm.arm.n_joints)
    for one in series:
        for first in range(0, one.rows, ROWS_AT_ONCE):
            some = slice(first, first + ROWS_AT_ONCE)
            where = chain(vjm, one.q[some])
            u = own_weight(where, weights) + on_joints(where, [Load(one.wrench[some], one.point[some])])
            total += (u[-vjm.arm.n_joints :] ** 2).sum(axis=1)
    scale = np.sqrt(total / sum(one.rows for one in series))
    return np.where(scale > 1e-6 * scale.max(initial=0), scale, 0.0)
