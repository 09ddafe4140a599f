"""Loads at the tool: hung weights and process forces, and what they do to the virtual joints.

A `Load` is a wrench w and its point of action. `on_joints` turns loads into the generalised loads J^T w of
Eq. (10), which the linear model and the equilibrium take.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.display import Displayed
from testbench.errors import Array, BenchError, Ids, check_array, check_type
from testbench.model.vjm import Chain, Vjm, append_law_loads, plain_load


@dataclass(frozen=True, repr=False)
class Load(Displayed):
    """Describe a wrench at the tool: one for all poses, or one per pose."""

    wrench: Array  #: Force and moment, world axes, (6,) or (poses, 6) [N, N m].
    point: Array  #: Where it acts, in the tool's frame, (3,) or (poses, 3) [m].

    def over(self, poses: int) -> "Load":
        """Expand the load to one row per pose.

        Args:
            poses: Number of poses.

        Returns:
            The load with a wrench (poses, 6) [N, N m] and a point (poses, 3) [m].

        Raises:
            BenchError: When it has rows for another number of poses, or a number that is not finite.
        """
        try:
            wrench, point = np.broadcast_to(self.wrench, (poses, 6)), np.broadcast_to(self.point, (poses, 3))
        except ValueError:
            shapes = f"{np.shape(self.wrench)} and {np.shape(self.point)}"
            problem = f"expected a wrench and a point, or one for each of {poses} poses, got {shapes}"
            raise BenchError(f"load: {problem}") from None
        check_array(wrench, (poses, 6), "wrench [N, N m]")
        check_array(point, (poses, 3), "point [m]")
        return Load(wrench, point)

    def of(self, some: slice | Ids) -> "Load":
        """Take the rows of some poses from a load that has one row per pose.

        Args:
            some: Indices of poses, (k,), or a slice.

        Returns:
            The load with k rows.
        """
        return Load(self.wrench[some], self.point[some])


def weight(vjm: Vjm, mass: float | Array) -> Load:
    """Make the load of a mass hung from the arm's load point: force -m g along world z.

    Args:
        vjm: Kinematics, for the load point.
        mass: Mass, one number or one per pose, (poses,) [kg].

    Returns:
        The load: wrench (6,) or (poses, 6) [N, N m], point (3,) or (poses, 3) [m].

    Raises:
        BenchError: When an argument has another type, or a mass is not finite.
    """
    check_type(vjm, Vjm, "vjm")
    check_array(mass, (None,) * np.ndim(mass), "mass [kg]")
    wrench = np.zeros((*np.shape(mass), 6))
    wrench[..., 2] = -GRAVITY * mass
    return Load(wrench, np.broadcast_to(vjm.load, (*np.shape(mass), 3)))


def resultant(rotation: Array, loads: Sequence[Load]) -> Array:
    """Sum all loads to one wrench, its moment about the tool's origin.

    Args:
        rotation: Orientation of the tool, world from tool, (poses, 3, 3) [1].
        loads: Loads that act together, each the same in all poses or with one row per pose.

    Returns:
        Force and moment, world axes, (poses, 6) [N, N m].

    Raises:
        BenchError: When a load has rows for another number of poses.
    """
    total = np.zeros((len(rotation), 6))
    for load in loads:
        own = load.over(len(total))
        lever = np.matvec(rotation, own.point)
        total[:, :3] += own.wrench[:, :3]
        total[:, 3:] += own.wrench[:, 3:] + np.cross(lever, own.wrench[:, :3])
    return total


def on_joints(chain: Chain, loads: Sequence[Load]) -> Array:
    """Sum the generalised loads J_F^T w of all loads on every virtual joint, Eq. (10).

    Args:
        chain: Tool and Jacobian of every run.
        loads: Loads that act together, each with one row per run.

    Returns:
        Load of every virtual joint, (n_theta, runs) [N, N m]; for a joint law the turn per unit of its size
        [rad, m].

    Raises:
        BenchError: When a load does not have one row per run.
    """
    u = np.zeros((7 * len(chain.bodies) - 8, len(chain.position)))
    for load in loads:
        u += plain_load(chain, load.wrench, load.point)
    return append_law_loads(chain, u)
