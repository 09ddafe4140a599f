"""How stiff the loaded tool is in every direction: the compliance of Eq. (7) and its ellipsoid."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from testbench.correct.rest import batches, rest
from testbench.correct.uncertainty import Poses, half_widths
from testbench.data.dataset import joined
from testbench.errors import Array
from testbench.identify.absolute.state import State
from testbench.identify.arm_model import ArmModel
from testbench.model.laws import tangent
from testbench.model.load import Load, on_joints
from testbench.model.loaded import geometric_stiffness, loaded_compliance
from testbench.model.vjm import chain


@dataclass(frozen=True)
class Stiffness:
    """How the loaded tool gives way to a small further force at its origin."""

    compliance: Array  #: Twist of the tool = compliance @ wrench, world axes, (poses, 6, 6).
    #: Semi-axes of the ellipsoid that a force of 1 N in every direction moves the tool over, the longest
    #: first, (poses, 3) [m/N].
    give: Array
    axes: Array  #: Their unit vectors as columns, world axes, (poses, 3, 3).

    @cached_property
    def principal(self) -> Array:
        """Principal stiffnesses, the softest first, (poses, 3) [N/m]; infinite where nothing gives."""
        with np.errstate(divide="ignore"):
            return np.asarray(1 / self.give)

    @cached_property
    def softest(self) -> Array:
        """Unit vector along which it gives most, its largest component above zero, (poses, 3)."""
        found = self.axes[:, :, 0]
        largest = np.take_along_axis(found, np.abs(found).argmax(axis=1)[:, None], axis=1)
        return np.asarray(found * np.where(largest < 0, -1.0, 1.0))


def stiffness(model: ArmModel, q: Array, loads: Sequence[Load] = (), theta: Array | None = None) -> Stiffness:
    """The tangent at the loaded equilibrium, Eq. (7), and the ellipsoid of its translations.

    K_w holds the loads alone. Left out is that of the own weight, which turns with the arm too: on a KR 500
    it changes a compliance by less than a hundredth.

    Args:
        model: The arm.
        q: Joints as commanded, (poses, n) [rad, m].
        loads: What acts beside own weight.
        theta: Virtual joints under these loads, where they are known already, (poses, n_theta) [m, rad].

    Returns:
        Its compliance, and the ellipsoid of its translations.

    Raises:
        NoEquilibrium: When there is none, or the arm is about to buckle.
    """
    every = Poses(q, loads)
    theta = rest(model.state, q, every.loads).theta if theta is None else theta
    return joined([_stiffness(model.state, every.of(some), theta[some]) for some in batches(len(q))])


def _stiffness(state: State, poses: Poses, theta: Array) -> Stiffness:
    vjm, n = state.vjm, state.vjm.arm.n_theta
    lawful = chain(vjm, poses.q, theta)
    where = replace(lawful, J_theta=lawful.J_theta[:, :n], laws=None)
    K_w = np.zeros((len(poses.q), n, n))
    for load in poses.loads:
        K_w += geometric_stiffness(where, load.wrench, load.point)
    C = tangent(vjm, state.C_theta, lawful, on_joints(where, poses.loads))
    compliance = loaded_compliance(where.J_theta.transpose(2, 0, 1), C, K_w)
    axes, give, _ = np.linalg.svd(compliance[:, :3, :3])
    return Stiffness(compliance, give, axes)


def give_halves(model: ArmModel, q: Array, tool: Stiffness, force: float) -> Array:
    """Half of the 95 % interval of how far a force along each principal axis moves the tool's origin.

    Args:
        model: The arm.
        q: Joints, (poses, n) [rad, m].
        tool: Its stiffness there.
        force: [N].

    Returns:
        The widest along world x, y, z, (poses, 3) [m]; infinite where the model has not seen what gives.
    """
    found, origin = np.empty((len(q), 3)), np.zeros(3)
    for some in batches(len(q)):
        free = Poses(q[some], rest=rest(model.state, q[some]))
        for k in range(3):
            push = force * tool.axes[some, :, k]
            pushed = Poses(q[some], [Load(np.hstack([push, 0 * push]), origin)])
            found[some, k] = half_widths(model, pushed, free, origin[None])[:, 0].max(axis=1)
    return found
