"""What a calibration knows of an arm: geometry, springs, joint errors, frames and mounts; and where it rests.

    theta = theta_0 + C_theta u(q, theta, loads) + Phi(q) n

Everything is a virtual joint. Constants of the inner links' are the errors of geometry; those of the first
and of the last link are the base in the tracker's frame and the targets in the tool's, each series' own.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from testbench.data.series import Series
from testbench.errors import Array, BenchError, NoEquilibrium
from testbench.identify.registration import Frame
from testbench.model.joint_errors import JointErrors, basis
from testbench.model.load import Load, on_joints
from testbench.model.vjm import Chain, Vjm, chain
from testbench.model.weights import Weights, own_weight

BATCH = 500  #: Rows whose Jacobian is in memory at a time.
TOLERANCE = 1e-11  #: A step below this [m, rad] is the last.
MOST = 100  #: Steps: what has not come to rest by then has no rest.
LOAD_STEPS = 2
"""Times the loads are taken again where they bend the arm to; each leaves a hundredth of an error or less."""


@dataclass(frozen=True)
class Mount:
    """Targets on the tool."""

    points: Array  #: In the tool's frame, (m, 3) [m].
    rotation: Array  #: Tool from the target that has an orientation, (3, 3); the unit matrix without one.
    markers: tuple[str, ...]  #: Names of the targets, in the order of the points.


@dataclass(frozen=True)
class State:
    """A calibrated arm."""

    vjm: Vjm  #: Its nominal kinematics.
    weights: Weights  #: What its links weigh.
    theta_0: Array  #: Constants of the virtual joints, (n_theta,) [m, rad]: errors of geometry.
    C_theta: Array  #: Compliances, (n_theta, n_theta) [m/N, rad/(N m)].
    errors: JointErrors  #: Which errors the joints have.
    n: Array  #: Their coefficients, (n joints, k) [rad, m].
    torque_scale: Array  #: Typical torque of every joint, (n,) [N m, N].
    frames: Mapping[str, Frame] = field(default_factory=dict)  #: Of every tracker frame, by name.
    mounts: Mapping[str, Mount] = field(default_factory=dict)  #: Of every mount, by name.

    def frame(self, series: Series) -> Frame:
        """The frame of a series, BenchError where it is not known."""
        if series.frame not in self.frames:
            raise BenchError(f"{series.name}: its frame {series.frame!r} is not known")
        return self.frames[series.frame]

    def mount(self, series: Series) -> Mount:
        """The mount of a series, its targets in their order there; BenchError where one is not known."""
        if series.target not in self.mounts:
            raise BenchError(f"{series.name}: its target {series.target!r} is not known")
        found = self.mounts[series.target]
        unknown = [name for name in series.markers if name not in found.markers]
        if unknown:
            have = ", ".join(found.markers)
            raise BenchError(f"{series.name}: no target {', '.join(unknown)} is known; there are {have}")
        at = [found.markers.index(name) for name in series.markers]
        return replace(found, points=found.points[at], markers=series.markers)


def nominal(vjm: Vjm, weights: Weights, torque_scale: Array) -> State:
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
    return State(vjm, weights, np.zeros(n), np.zeros((n, n)), JointErrors(), empty, torque_scale)


@dataclass(frozen=True)
class Equilibrium:
    """Where the virtual joints rest under some loads, and what that follows from."""

    theta: Array  #: Virtual joints, (runs, n_theta) [m, rad].
    where: Chain  #: The tool there, and how virtual joints move it.
    u: Array  #: Load of every virtual joint that bends it there, (n_theta, runs) [N, N m].
    phi: Array  #: Functions of the joint errors, (n joints, k, runs).


def equilibrium(state: State, q: Array, loads: Sequence[Load] = (), steps: int | None = None) -> Equilibrium:
    """The equilibrium of every pose under own weight and all loads, by fixed-point steps.

    Each takes the loads where the last one bent the arm to. They converge only where the loaded springs
    K_theta - K_w of Eq. (7) are stable: an arm that buckles is found by that.

    Mathematics: `loaded-1`.

    Args:
        state: The arm.
        q: Joints as commanded, (runs, n) [rad, m].
        loads: What acts, each with a row a run.
        steps: So many steps; None for as many as it takes to come to rest.

    Raises:
        NoEquilibrium: When it does not come to rest; names the pose.
    """
    start, u, phi = _start(state, q, loads)
    theta, step = start + (state.C_theta @ u).T, np.zeros(len(q))
    for _ in range(MOST if steps is None else steps):
        where = chain(state.vjm, q, theta)
        u = loads_at(state, where, loads)
        bent = start + (state.C_theta @ u).T
        step = np.abs(bent - theta).max(axis=1, initial=0)
        theta = bent
        if (step <= TOLERANCE).all():  # not of NaN
            return Equilibrium(theta, where, u, phi)
    if steps is None:
        words = state.vjm.arm.words(q[np.argmin(step <= TOLERANCE)])
        raise NoEquilibrium(f"no static equilibrium at q = {words}: too soft for its load, or buckled")
    return Equilibrium(theta, chain(state.vjm, q, theta), u, phi)


def _start(state: State, q: Array, loads: Sequence[Load]) -> tuple[Array, Array, Array]:
    """Virtual joints but for the springs, (runs, n_theta), the load of the straight arm, and phi."""
    arm, theta = state.vjm.arm, np.tile(state.theta_0, (len(q), 1))
    u, joints = loads_at(state, chain(state.vjm, q, theta), loads), slice(6 * len(arm.links), arm.n_theta)
    phi = basis(state.errors, arm, q, u[joints], state.torque_scale)
    theta[:, joints] += np.einsum("jkr,jk->rj", phi, state.n)
    return theta, u, phi


def loads_at(state: State, where: Chain, loads: Sequence[Load]) -> Array:
    """Compute the generalised load u of every virtual joint, from own weight and all loads.

    Args:
        state: The model.
        where: The poses.
        loads: Loads that act at once.

    Returns:
        u, (n_theta, runs) [N, N m].
    """
    return own_weight(where, state.weights) + on_joints(where, loads)


def unbent(state: State, q: Array, loads: Sequence[Load]) -> Array:
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


def forward(state: State, series: Series) -> Equilibrium:
    """Compute the arm at rest in every row of a series, by `LOAD_STEPS` steps.

    Mathematics: `abs-1`.

    Args:
        state: The model.
        series: The readings, which give poses and loads.

    Returns:
        The arm in every row, in base axes.
    """
    loads = [Load(series.wrench, series.point)] if series.wrench.any() else []
    return equilibrium(state, series.q, loads, LOAD_STEPS)


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
        for first in range(0, one.rows, BATCH):
            some = slice(first, first + BATCH)
            where = chain(vjm, one.q[some])
            u = own_weight(where, weights) + on_joints(where, [Load(one.wrench[some], one.point[some])])
            total += (u[-vjm.arm.n_joints :] ** 2).sum(axis=1)
    scale = np.sqrt(total / sum(one.rows for one in series))
    return np.where(scale > 1e-6 * scale.max(initial=0), scale, 0.0)
