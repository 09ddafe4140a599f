"""Where the tool rests under its loads, in any number of poses: in parts that are joined."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.data.dataset import Rows, arrays, joined
from testbench.errors import Array, Ids, check_array
from testbench.identify.absolute.state import State, equilibrium
from testbench.model.load import Load
from testbench.model.vjm import on_tool
from testbench.session import stepwise

TOGETHER = 512  #: Poses computed side by side: enough for numpy, few for its cache.


def batches(poses: int) -> Iterator[slice]:
    """Places of some poses at a time; one empty part of none."""
    return stepwise([slice(k, k + TOGETHER) for k in range(0, max(poses, 1), TOGETHER)], "solving poses")


def put(rows: Rows, where: Ids, others: Rows) -> None:
    """Others in place of some, (k,)."""
    for name, values in arrays(rows).items():
        values[where] = arrays(others)[name]


def replaced(rows: Rows, where: Ids, others: Rows) -> Rows:
    """The same, of a copy."""
    found = joined([rows])
    put(found, where, others)
    return found


@dataclass(frozen=True)
class Rest:
    """The tool at rest."""

    theta: Array  #: Virtual joints, (poses, n_theta) [m, rad].
    position: Array  #: Of the tool's origin, world, (poses, 3) [m].
    rotation: Array  #: World from tool, (poses, 3, 3).

    def at(self, point: Array) -> Array:
        """Positions of a point of the tool's frame, (3,) or (poses, 3) [m], in the world, (poses, 3) [m]."""
        return np.asarray(self.position + np.matvec(self.rotation, point))

    def points(self, points: Array) -> Array:
        """Points of the tool's frame, (k, 3) [m], in the world, (poses, k, 3) [m]."""
        return on_tool((self.position, self.rotation), points)


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
    found = (equilibrium(state, q[some], [load.of(some) for load in loads]) for some in batches(len(q)))
    return joined([Rest(one.theta, one.where.position, one.where.rotation) for one in found])
