"""A prediction put together: deflections with intervals, stiffness of the tool, map over the workspace."""

from dataclasses import dataclass

import numpy as np

from testbench.bench.campaign import Cell
from testbench.bench.predict_input import Asked, carried
from testbench.bench.stiffness_map import StiffnessMap, stiffness_map
from testbench.correct.arm_model import ArmModel
from testbench.correct.beyond import Extent, extent
from testbench.correct.predicted import Prediction, predict
from testbench.correct.stiffness import Stiffness, give_halves, stiffness
from testbench.data.dataset import Ids
from testbench.errors import Array
from testbench.model.poses import WorkArea


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
        map=stiffness_map(model, cell, wanted.force, wanted.area),
    )
