"""What a calibration knows of an arm: geometry, springs, joint errors, frames and mounts; and what it tells.

    theta = theta_0 + C_theta u(q, theta, loads) + Phi(q) n

Everything is a virtual joint. Constants of the inner links' are the errors of geometry; those of the first
and of the last link are the base in the tracker's frame and the targets in the tool's, each series' own.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from testbench.data.series import Series, select_rows
from testbench.errors import Array, BenchError
from testbench.identify.registration import Frame
from testbench.model.joint_errors import JointErrors, basis
from testbench.model.vjm import Chain, Vjm, chain, generalised_load
from testbench.model.weights import Weights, own_weight

BATCH = 500  #: Rows whose Jacobian is in memory at a time.
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
    """The arm as drawn: rigid, without errors."""
    n = vjm.arm.n_theta
    empty = np.zeros((vjm.arm.n_joints, 0))
    return State(vjm, weights, np.zeros(n), np.zeros((n, n)), JointErrors(), empty, torque_scale)


def loads(where: Chain, weights: Weights, wrench: Array, point: Array) -> Array:
    """Load u of every virtual joint, own weight and wrench, (n_theta, runs) [N, N m]."""
    u = own_weight(where, weights)
    return u + generalised_load(where, wrench, point) if wrench.any() else u


@dataclass(frozen=True)
class Told:
    """Where a state has the tool in some poses, and what that follows from."""

    where: Chain  #: The tool, and how virtual joints move it.
    u: Array  #: Load of every virtual joint that bends it there, (n_theta, runs) [N, N m].
    phi: Array  #: Functions of the joint errors, (n joints, k, runs).


def tell(state: State, q: Array, wrench: Array, point: Array) -> Told:
    """Where the tool is, in base axes: the equilibrium under its loads, by fixed-point steps."""
    arm = state.vjm.arm
    first = arm.n_theta - arm.n_joints
    rest = np.tile(state.theta_0, (len(q), 1))
    u = loads(chain(state.vjm, q, rest), state.weights, wrench, point)
    phi = basis(state.errors, arm, q, u[first:], state.torque_scale)
    rest[:, first:] += np.einsum("jkr,jk->rj", phi, state.n)
    for _ in range(LOAD_STEPS):
        bent = chain(state.vjm, q, rest + (state.C_theta @ u).T)
        u = loads(bent, state.weights, wrench, point)
    return Told(chain(state.vjm, q, rest + (state.C_theta @ u).T), u, phi)


def targets(told: Told, mount: Mount) -> Array:
    """Targets in base axes, (runs, m, 3) [m]."""
    return np.asarray(
        told.where.position[:, None] + np.einsum("rxy,my->rmx", told.where.rotation, mount.points)
    )


def in_batches(series: Series) -> Iterator[Series]:
    """The rows of a series, some at a time: Jacobians of all of them would take gigabytes."""
    for first in range(0, max(series.rows, 1), BATCH):
        yield select_rows(series, np.arange(first, min(first + BATCH, series.rows)))


def torque_scale(vjm: Vjm, weights: Weights, series: tuple[Series, ...]) -> Array:
    """Root mean square torque of every joint over all rows, (n,) [N m, N]."""
    total, rows = np.zeros(vjm.arm.n_joints), 0
    for one in series:
        for some in in_batches(one):
            u = loads(chain(vjm, some.q), weights, some.wrench, some.point)[-vjm.arm.n_joints :]
            total, rows = total + (u**2).sum(axis=1), rows + some.rows
    scale = np.sqrt(total / rows)
    return np.where(scale > 1e-6 * scale.max(initial=0), scale, 0.0)
