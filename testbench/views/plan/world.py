"""A plan in space as layers of a page: what stands still, and what is read and hung pose by pose."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.bench.campaign import Cell
from testbench.errors import Array
from testbench.model.vjm import tool_points, tool_pose
from testbench.plant.shapes import Frames, rigid_frames
from testbench.views.colours import GREY, LOAD, MEASURED, NOMINAL, TASK
from testbench.views.page.scene import Layer, Poses
from testbench.views.picked import evenly

SPECKS, NUMBERED = 600, 20  #: Candidates that are drawn, and planned poses whose number is, at most.
FORCE = 0.2  #: Length of a load's arrow over the reach [1].


@dataclass(frozen=True)
class World:
    """What is there in every pose."""

    cell: Cell  #: The arm.
    station: tuple[float, float, float] | None  #: Where the tracker stands [m].
    plan: Array  #: Tools of the plan, in its order, (poses, 3) [m].
    tasks: Array  #: Tools of the tasks, (tasks, 3) [m].
    candidates: Array  #: Tools of the feasible poses, (c, 3) [m].

    def around(self, poses: Poses) -> Poses:
        """The same with all that stands still."""
        return replace(poses, layers=[*poses.layers, *self._still()])

    def rigid(self, q: Array) -> Frames:
        """The arm in poses (poses, n) [rad, m]."""
        return rigid_frames(self.cell.room, q)

    def measured(self, q: Array, force: Array) -> tuple[Layer, ...]:
        """Markers, lines of sight and loads (poses, 3) [N] of poses that are measured."""
        markers = tool_points(self.cell.vjm, q, self.cell.vjm.markers)
        found = [Layer("markers", NOMINAL, "dots", markers)]
        if self.station is not None:
            tracker = np.broadcast_to(np.array(self.station), markers.shape)
            found.append(Layer("lines of sight", MEASURED, "lines", tracker, markers))
        return (*found, *self.pulled(q, force))

    def pulled(self, q: Array, force: Array) -> tuple[Layer, ...]:
        """What hangs or pulls, all arrows of one length."""
        if not force.any():
            return ()
        hook = tool_points(self.cell.vjm, q, self.cell.vjm.load[None])
        size = np.linalg.norm(force, axis=1, keepdims=True)
        way = np.divide(force, size, out=np.full(force.shape, np.nan), where=size > 0)
        return (Layer("load", LOAD, "arrows", hook, hook + FORCE * self.cell.vjm.reach * way[:, None]),)

    def _still(self) -> list[Layer]:
        numbers = [str(k + 1) for k in range(len(self.plan))] if len(self.plan) <= NUMBERED else []
        some = evenly(np.arange(len(self.candidates)), SPECKS)
        found = [
            Layer("feasible poses", GREY, "specks", self.candidates[None, some], shown=False),
            Layer("way", NOMINAL, "lines", self.plan[None, :-1], self.plan[None, 1:], shown=False),
            Layer("planned, in order", NOMINAL, "dots", self.plan[None], labels=numbers),
        ]
        if len(self.tasks):
            found.append(Layer("tasks", TASK, "dots", self.tasks[None]))
        if self.station is not None:
            found.append(Layer("tracker", MEASURED, "dots", np.array([[self.station]]), labels=["tracker"]))
        return found


def places(world: World, q: Array, words: Sequence[str], first: int) -> Poses:
    """The arm all over the workspace."""
    names, at = [f"Place {k} of {len(q)}" for k in range(1, len(q) + 1)], tool_pose(world.cell.vjm, q)[0]
    tool = Layer("tool", MEASURED, "dots", at[:, None])
    return world.around(Poses("Workspace", names, words, world.rigid(q), None, [tool], first))
