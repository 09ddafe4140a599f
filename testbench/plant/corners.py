"""Points on the surface of an arm's drawn shapes: how wide it is, and how it looks from a side."""

from collections.abc import Callable

import numpy as np

from testbench.errors import Array
from testbench.plant.feasible import Room
from testbench.plant.shapes import KINDS, VISUAL_GROUPS, Kind, Shape

ROUND = 2 * np.pi * np.arange(24) / 24
RING = np.column_stack([np.cos(ROUND), np.sin(ROUND), np.zeros_like(ROUND)])
BALL = np.concatenate([np.cos(t) * RING + [0, 0, np.sin(t)] for t in np.linspace(-np.pi / 2, np.pi / 2, 13)])
CUBE = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])


def _rod(size: Array, cap: Array) -> Array:
    """Two caps of the shape's radius at the ends of its half length."""
    return np.concatenate([size[0] * cap + [0, 0, end * size[2]] for end in (-1, 1)])


POINTS: dict[Kind, Callable[[Array], Array]] = {
    "box": lambda size: CUBE * size,
    "cylinder": lambda size: _rod(size, RING),
    "capsule": lambda size: _rod(size, BALL),
    "sphere": lambda size: BALL * size,
    "ellipsoid": lambda size: BALL * size,
}
"""Surface points of a primitive by its half sizes, in its own axes."""


def corners(shape: Shape) -> Array:
    """Points of a shape whose hull is that of the shape, in its body, (points, 3) [m]."""
    own = POINTS[shape.kind](shape.size) if shape.mesh is None else shape.mesh.vertices
    return np.asarray(shape.position + own @ shape.rotation.T)


def is_drawn(room: Room) -> bool:
    """Whether the arm has visual shapes of its own; sticks stand in for them otherwise."""
    visible = room.model.geom_group < VISUAL_GROUPS
    return bool(visible[np.isin(room.model.geom_type, list(KINDS))].any())
