"""What hangs or pushes at the tool."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.errors import Array, BenchError, Ids, check_array
from testbench.model.vjm import Chain, Vjm, plain_load, with_laws


@dataclass(frozen=True)
class Load:
    """What hangs or pushes at the tool, in every pose the same or in each its own."""

    wrench: Array  #: Force and moment, world axes, (6,) or (poses, 6) [N, N m].
    point: Array  #: Where it acts, in the tool's frame, (3,) or (poses, 3) [m].

    def over(self, poses: int) -> "Load":
        """The same with a row a pose.

        Raises:
            BenchError: When it has another number of poses, or a number that is not finite.
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
        """That of some poses, where there is a row a pose."""
        return Load(self.wrench[some], self.point[some])


def weight(vjm: Vjm, mass: float | Array) -> Load:
    """Make the load of a mass that hangs from the arm's load point, w = (0, 0, -m g, 0, 0, 0).

    Args:
        vjm: The arm.
        mass: Mass, or one for each pose, (poses,) [kg].

    Returns:
        The load, the same in all poses or with a row for each pose.
    """
    wrench = np.zeros((*np.shape(mass), 6))
    wrench[..., 2] = -GRAVITY * mass
    return Load(wrench, np.broadcast_to(vjm.load, (*np.shape(mass), 3)))


def resultant(rotation: Array, loads: Sequence[Load]) -> Array:
    """Sum of all loads, the moment about the tool's origin, world axes, (poses, 6) [N, N m].

    Args:
        rotation: World from tool, (poses, 3, 3).
        loads: What acts.
    """
    total = np.zeros((len(rotation), 6))
    for load in loads:
        own = load.over(len(total))
        lever = np.matvec(rotation, own.point)
        total[:, :3] += own.wrench[:, :3]
        total[:, 3:] += own.wrench[:, 3:] + np.cross(lever, own.wrench[:, :3])
    return total


def on_joints(where: Chain, loads: Sequence[Load]) -> Array:
    """Sum of J_F^T w of every virtual joint, (n_theta, runs) [N, N m]; every load has a row a pose."""
    u = np.zeros((7 * len(where.bodies) - 8, len(where.position)))
    for load in loads:
        u += plain_load(where, load.wrench, load.point)
    return with_laws(where, u)
