"""Where in the workspace the tool gives most: the worst deflection under a force of any direction."""

from dataclasses import dataclass

import numpy as np

from testbench.bench.campaign import Cell, clear_poses, stream
from testbench.correct.arm_model import ArmModel
from testbench.correct.stiffness import give_halves, stiffness
from testbench.errors import Array
from testbench.model.poses import WorkArea
from testbench.model.vjm import tool_pose

PLACES = 600  #: Poses over the workspace.
FORCE = 1000.0  #: Where neither a flag nor the arm's payload says one [N].


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


def stiffness_map(
    model: ArmModel, cell: Cell, force: float, area: WorkArea | None, places: int = PLACES
) -> StiffnessMap:
    """The compliance of Eq. (7) under own weight alone, times a force, at clear poses drawn at random.

    Args:
        model: The arm.
        cell: The same arm and the room that it stands in.
        force: [N].
        area: Where the tool has to be; None for all that the arm reaches.
        places: How many poses.

    Raises:
        PoseError: When too few poses have their tool in the area.
    """
    q = clear_poses(cell, area, places, stream(0))
    found = stiffness(model, q)
    position, _ = tool_pose(model.vjm, q)
    half = give_halves(model, q, found, force)
    worst: Array = force * found.give[:, 0]
    order = np.argsort(-worst, kind="stable")
    every = (q, position, worst, found.softest, half)
    return StiffnessMap(force, *(values[order] for values in every))
