"""A prediction put together: deflections with intervals, stiffness of the tool, map over the workspace."""

from dataclasses import dataclass

import numpy as np

from testbench.bench.campaign import Cell, clear_poses, stream
from testbench.bench.predict_input import Asked, carried
from testbench.correct.arm_model import ArmModel
from testbench.correct.beyond import Extent, extent
from testbench.correct.predicted import Prediction, predict
from testbench.correct.stiffness import Stiffness, give_halves, stiffness
from testbench.data.dataset import Ids
from testbench.errors import Array
from testbench.model.poses import WorkArea
from testbench.model.vjm import tool_pose

PLACES = 600  #: Poses over the workspace.
FORCE = 1000.0  #: Of the map where neither a flag nor the arm's payload says one [N].


@dataclass(frozen=True)
class StiffnessMap:
    """Poses all over the workspace, the softest first."""

    force: float  #: [N].
    q: Array  #: Joints, (places, n) [rad, m].
    position: Array  #: Tool, (places, 3) [m].
    worst: Array  #: How far the force moves the tool in the worst direction, (places,) [m].
    direction: Array  #: That direction, unit vectors, (places, 3).
    #: Half widths of how far it moves the tool along the principal axes, the softest first, (places, 3) [m].
    half: Array


@dataclass(frozen=True, eq=False)
class Predicted:
    """All that is known of the poses that were asked for."""

    model: ArmModel
    cell: Cell  #: The same arm and its room.
    asked: Asked
    linear: bool  #: Whether by Eq. (6).
    found: Prediction
    stiffness: Stiffness  #: Of the loaded tool.
    #: Half widths of how far the map's force moves the loaded tool along its principal axes, the softest
    #: first, (poses, 3) [m].
    give_half: Array
    extent: Extent  #: How large the loads are.
    map: StiffnessMap

    @property
    def names(self) -> tuple[str, ...]:
        """Of the points: the tool's origin, then the markers."""
        return (self.model.arm.tool, *self.model.arm.markers)

    @property
    def worst_first(self) -> Ids:
        """Poses by the deflection of the tool, the largest first, (poses,)."""
        return np.argsort(-self.found.size[:, 0], kind="stable")


@dataclass(frozen=True)
class Wanted:
    """How to predict."""

    force: float  #: Of the map [N].
    area: WorkArea | None = None  #: Of the map; None for all that the arm reaches.
    linear: bool = False  #: By Eq. (6) instead of Eq. (7).


def predicted(model: ArmModel, asked: Asked, wanted: Wanted) -> Predicted:
    """Predict all poses of a file.

    Raises:
        InputError: When a pose has no equilibrium; names its line.
        PoseError: When too few poses have their tool in the area of the map.
    """
    cell = Cell(model.arm, model.vjm)
    found = carried(asked, lambda q, loads: predict(model, q, loads, linear=wanted.linear))
    tool = carried(asked, lambda q, loads: stiffness(model, q, loads))
    return Predicted(
        model=model,
        cell=cell,
        asked=asked,
        linear=wanted.linear,
        found=found,
        stiffness=tool,
        give_half=give_halves(model, asked.q, tool, wanted.force),
        extent=extent(model, asked.q, asked.loads),
        map=_map(model, cell, wanted),
    )


def _map(model: ArmModel, cell: Cell, wanted: Wanted) -> StiffnessMap:
    """The compliance of Eq. (7) under own weight alone, times a force, at clear poses drawn at random."""
    q = clear_poses(cell, wanted.area, PLACES, stream(0))
    found = stiffness(model, q)
    position, _ = tool_pose(model.vjm, q)
    half = give_halves(model, q, found, wanted.force)
    worst: Array = wanted.force * found.give[:, 0]
    order = np.argsort(-worst, kind="stable")
    return StiffnessMap(wanted.force, *(x[order] for x in (q, position, worst, found.softest, half)))
