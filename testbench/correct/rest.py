"""Where the tool rests under its loads: the equilibrium theta = theta_0 + C_theta u(theta) + Phi n.

Each step takes the loads where the last one bent the arm to. On heavy arms that leaves a hundredth of the
error, so that a few steps reach rounding; no stiffness is ever inverted. The steps converge only where the
loaded springs K_theta - K_w of Eq. (7) are stable: an arm that buckles is found by that.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.correct.batches import batches, joined
from testbench.errors import Array, NoEquilibrium, check_array
from testbench.identify.absolute.state import State
from testbench.model.joint_errors import basis
from testbench.model.load import Load, on_joints
from testbench.model.vjm import Chain, chain
from testbench.model.weights import own_weight

TOLERANCE = 1e-11  #: A step below this [m, rad] is the last.
MOST = 100  #: Steps: what has not come to rest by then has no rest.


@dataclass(frozen=True)
class Rest:
    """The tool at rest."""

    theta: Array  #: Virtual joints, (poses, n_theta) [m, rad].
    position: Array  #: Of the tool's origin, world, (poses, 3) [m].
    rotation: Array  #: World from tool, (poses, 3, 3).

    def at(self, point: Array) -> Array:
        """Positions of a point of the tool's frame, (3,) or (poses, 3) [m], in the world, (poses, 3) [m]."""
        return np.asarray(self.position + np.matvec(self.rotation, point))


def loads_at(state: State, where: Chain, loads: Sequence[Load]) -> Array:
    """Load u of every virtual joint: own weight and all loads, (n_theta, poses) [N, N m]."""
    return own_weight(where, state.weights) + on_joints(where, loads)


def unbent(state: State, q: Array, loads: Sequence[Load]) -> Array:
    """Virtual joints but for the springs: theta_0, and the joints' errors Phi(q) n, (poses, n_theta)."""
    arm = state.vjm.arm
    theta, first = np.tile(state.theta_0, (len(q), 1)), arm.n_theta - arm.n_joints
    if state.errors.size:
        torque = loads_at(state, chain(state.vjm, q, theta), loads)[first:]
        phi = basis(state.errors, arm, q, torque, state.torque_scale)
        theta[:, first:] += np.einsum("jkr,jk->rj", phi, state.n)
    return theta


def rest(state: State, q: Array, loads: Sequence[Load] = ()) -> Rest:
    """The equilibrium of every pose under own weight and all loads.

    Args:
        state: The arm.
        q: Joints as commanded, (poses, n) [rad, m].
        loads: What acts, each in all poses alike or with a row a pose.

    Raises:
        NoEquilibrium: When there is none; names the pose.
        BenchError: When a load has another number of poses.
    """
    q = check_array(q, (None, state.vjm.arm.n_joints), "q [rad, m]")
    loads = [load.over(len(q)) for load in loads]
    return joined([_rest(state, q[some], [load.of(some) for load in loads]) for some in batches(len(q))])


def _rest(state: State, q: Array, loads: Sequence[Load]) -> Rest:
    start = unbent(state, q, loads)
    theta = start
    for _ in range(MOST):
        where = chain(state.vjm, q, theta)
        bent = start + (state.C_theta @ loads_at(state, where, loads)).T
        step = np.abs(bent - theta).max(axis=1, initial=0)
        theta = bent
        if not (step > TOLERANCE).any():
            break
    if not (step <= TOLERANCE).all():  # true for NaN
        lost = int(np.flatnonzero(~(step <= TOLERANCE))[0])
        words = state.vjm.arm.words(q[lost])
        raise NoEquilibrium(f"no static equilibrium at q = {words}: too soft for its load, or buckled")
    return Rest(theta, where.position, where.rotation)
