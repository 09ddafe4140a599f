"""Static equilibrium of the loaded arm in any number of poses, computed in batches that are joined.

All predictions and corrections of this package start from `equilibrium`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Rows, arrays, join_rows
from testbench.errors import Array, Ids, check_array
from testbench.identify.absolute.state import ArmState, joint_equilibrium
from testbench.model.load import Load
from testbench.model.vjm import on_tool
from testbench.progress import stepwise

POSES_AT_ONCE = 512  #: Poses computed side by side: enough for numpy, few for its cache.


def batches(poses: int) -> Iterator[slice]:
    """Split poses into slices of at most `POSES_AT_ONCE`, and report progress; one empty slice for no poses.

    Args:
        poses: Number of poses.

    Returns:
        The slices, in order.
    """
    return stepwise(
        [slice(k, k + POSES_AT_ONCE) for k in range(0, max(poses, 1), POSES_AT_ONCE)], "solving poses"
    )


def assign_rows(rows: Rows, where: Ids, others: Rows) -> None:
    """Overwrite some rows of arrays that belong together, in place.

    Args:
        rows: Dataclass of arrays with one row per pose.
        where: Indices of the rows to overwrite, (k,).
        others: Dataclass of the same type with k rows.
    """
    for name, values in arrays(rows).items():
        values[where] = arrays(others)[name]


def with_rows(rows: Rows, where: Ids, others: Rows) -> Rows:
    """Copy arrays that belong together, with some rows overwritten.

    Args:
        rows: Dataclass of arrays with one row per pose.
        where: Indices of the rows to overwrite, (k,).
        others: Dataclass of the same type with k rows.

    Returns:
        The copy; the input stays as it is.
    """
    found = join_rows([rows])
    assign_rows(found, where, others)
    return found


@dataclass(frozen=True)
class RestPoses:
    """Hold the equilibrium: virtual joints, and the tool's pose."""

    theta: Array  #: Virtual joints, (poses, n_theta) [m, rad].
    position: Array  #: Position of the tool's origin, world, (poses, 3) [m].
    rotation: Array  #: Orientation, world from tool, (poses, 3, 3) [1].

    def at(self, point: Array) -> Array:
        """Compute world positions of one point of the tool.

        Args:
            point: Point in the tool's frame, (3,), or one per pose, (poses, 3) [m].

        Returns:
            Positions in the world, (poses, 3) [m].
        """
        return np.asarray(self.position + np.matvec(self.rotation, point))

    def points(self, points: Array) -> Array:
        """Compute world positions of several points of the tool.

        Args:
            points: Points in the tool's frame, (k, 3) [m].

        Returns:
            Positions in the world, (poses, k, 3) [m].
        """
        return on_tool((self.position, self.rotation), points)


def equilibrium(state: ArmState, q: Array, loads: Sequence[Load] = ()) -> RestPoses:
    """Solve the static equilibrium of every pose under own weight and all loads.

    theta = theta_0 + C_theta u(q, theta, loads) + Phi(q) n, with u the generalised loads at theta, geometric
    errors theta_0 and joint errors Phi n.

    Mathematics: `loaded-1`.

    Args:
        state: The identified arm.
        q: Joints as commanded, (poses, n) [rad, m].
        loads: Loads besides own weight, each the same in all poses or with one row per pose.

    Returns:
        Virtual joints and the tool's pose.

    Raises:
        NoEquilibrium: When there is none; the message names the pose.
        BenchError: When q has another shape or is not finite, or a load has rows for another number of poses.
    """
    q = check_array(q, (None, state.vjm.arm.n_joints), "q [rad, m]")
    loads = [load.over(len(q)) for load in loads]
    found = (joint_equilibrium(state, q[some], [load.of(some) for load in loads]) for some in batches(len(q)))
    return join_rows([RestPoses(one.theta, one.chain.position, one.chain.rotation) for one in found])
