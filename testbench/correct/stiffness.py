"""Stiffness of the loaded tool in every direction: the compliance of Eq. (7) and its ellipsoid."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from testbench.correct.rest import batches, equilibrium
from testbench.correct.uncertainty import LoadedPoses, half_widths
from testbench.data.dataset import join_rows
from testbench.display import Displayed, span
from testbench.errors import Array, check_items, check_type
from testbench.identify.absolute.state import ArmState
from testbench.identify.arm_model import ArmModel
from testbench.model.laws import tangent
from testbench.model.load import Load, on_joints
from testbench.model.loaded import geometric_stiffness, loaded_compliance
from testbench.model.vjm import chain


@dataclass(frozen=True, repr=False)
class Stiffness(Displayed):
    """Hold how the loaded tool yields to a small further force at its origin."""

    #: Compliance C of Eq. (7), twist = C @ wrench, world axes, (poses, 6, 6) [m/N, rad/N, rad/(N m)].
    compliance: Array
    #: Semi-axes of the ellipsoid over which a unit force moves the tool, the longest first, (poses, 3) [m/N].
    displacement_per_force: Array
    axes: Array  #: Directions of the semi-axes as columns, world axes, (poses, 3, 3) [1].

    def about(self) -> dict[str, object]:
        """Summarise the stiffness: number of poses, least and largest principal stiffness."""
        ends = {"softest_N_per_um": self.principal[:, 0], "stiffest_N_per_um": self.principal[:, -1]}
        return {
            "poses": len(self.displacement_per_force),
            **{name: span(1e-6 * values) for name, values in ends.items()},
        }

    @cached_property
    def principal(self) -> Array:
        """Compute the principal stiffnesses, softest first, (poses, 3) [N/m]; infinite along a rigid axis."""
        with np.errstate(divide="ignore"):
            return np.asarray(1 / self.displacement_per_force)

    @cached_property
    def softest(self) -> Array:
        """Return the unit vector of the softest direction, its largest component positive, (poses, 3) [1]."""
        found = self.axes[:, :, 0]
        largest = np.take_along_axis(found, np.abs(found).argmax(axis=1)[:, None], axis=1)
        return np.asarray(found * np.where(largest < 0, -1.0, 1.0))


def stiffness(model: ArmModel, q: Array, loads: Sequence[Load] = (), theta: Array | None = None) -> Stiffness:
    """Compute the tangent compliance at the loaded equilibrium, Eq. (7), and its ellipsoid of translations.

    K_w holds the loads alone. The term of the arm's own weight, which turns with the arm too, is left out: on
    a KR 500 it changes a compliance by less than a hundredth.

    Mathematics: `loaded-6`.

    Args:
        model: Identified model of the arm.
        q: Joints as commanded, (poses, n) [rad, m].
        loads: Loads besides own weight, each the same in all poses or with one row per pose.
        theta: Virtual joints under these loads, (poses, n_theta) [m, rad], if they are known; None to solve
            them.

    Returns:
        Compliance at the tool's origin, and the ellipsoid of its translations.

    Raises:
        NoEquilibrium: When there is no equilibrium, or the load is exactly a buckling load.
        BenchError: When an argument has another type, or a load has rows for another number of poses.
    """
    check_type(model, ArmModel, "model")
    check_items(loads, Load, "loads")
    every = LoadedPoses(q, loads)
    theta = equilibrium(model.state, q, every.loads).theta if theta is None else theta
    return join_rows([_stiffness(model.state, every.of(some), theta[some]) for some in batches(len(q))])


def _stiffness(state: ArmState, poses: LoadedPoses, theta: Array) -> Stiffness:
    vjm, n = state.vjm, state.vjm.arm.n_theta
    lawful = chain(vjm, poses.q, theta)
    where = replace(lawful, J_theta=lawful.J_theta[:, :n], laws=None)
    # K_w of all loads together, and the tangent compliance of the springs, laws included
    K_w = np.zeros((len(poses.q), n, n))
    for load in poses.loads:
        K_w += geometric_stiffness(where, load.wrench, load.point)
    C = tangent(vjm, state.C_theta, lawful, on_joints(where, poses.loads))
    compliance = loaded_compliance(where.J_theta.transpose(2, 0, 1), C, K_w)
    axes, give, _ = np.linalg.svd(compliance[:, :3, :3])
    return Stiffness(compliance, give, axes)


def compliance_half_widths(model: ArmModel, q: Array, tool: Stiffness, force: float) -> Array:
    """Compute half widths of the 95 % interval of how far a force along each principal axis moves the tool.

    Args:
        model: Identified model of the arm.
        q: Joints as commanded, (poses, n) [rad, m].
        tool: Stiffness of the tool in these poses.
        force: Size of the force [N].

    Returns:
        Largest half width over world x, y, z, per principal axis, (poses, 3) [m]; infinite where the data
        have not shown the compliance.

    Raises:
        NoEquilibrium: When the arm has no equilibrium under the force.
    """
    found, origin = np.empty((len(q), 3)), np.zeros(3)
    for some in batches(len(q)):
        free = LoadedPoses(q[some], equilibrium=equilibrium(model.state, q[some]))
        for k in range(3):
            push = force * tool.axes[some, :, k]
            pushed = LoadedPoses(q[some], [Load(np.hstack([push, 0 * push]), origin)])
            found[some, k] = half_widths(model, pushed, free, origin[None])[:, 0].max(axis=1)
    return found
