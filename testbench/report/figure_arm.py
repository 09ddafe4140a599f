"""The arm as figures show it: outlines of its solids, seen along an axis, those behind drawn first."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from scipy.spatial import ConvexHull, QhullError

from testbench.errors import Array
from testbench.plant.shapes import BodyFrames, corners, visual_shapes
from testbench.report.colours import Colour
from testbench.workflows.cell import Cell

DARK, LIGHT = 0.45, 0.85  #: Greys of dark and of bright parts [1].
EDGE, THIN = 0.7, 0.4  #: Brightness of an outline over that of its face [1], and its width [pt].


def outlines(cell: Cell, frames: BodyFrames, pose: int, sides: Array) -> tuple[list[Array], Array]:
    """Outlines of the solids of an arm in a pose, from back to front.

    Args:
        cell: The arm.
        frames: Its bodies, straight or bent.
        pose: Which pose.
        sides: Unit vectors to the right and up in the figure, world axes, (2, 3).

    Returns:
        Polygons, (p, 2) each [m], and the brightness of each solid, (solids,) [1].
    """
    hidden = {cell.room.names.index(name) for name in (cell.arm.load, *cell.arm.markers)}
    away = np.cross(sides[0], sides[1])
    found: list[tuple[float, Array, float]] = []
    for shape in visual_shapes(cell.room):
        if shape.body in hidden:  # drawn by their roles
            continue
        points = frames.positions[pose, shape.body] + corners(shape) @ frames.rotations[pose, shape.body].T
        flat = points @ sides.T
        try:
            hull = flat[ConvexHull(flat).vertices]
        except QhullError:  # seen from its edge
            continue
        found.append((float((points @ away).max()), hull, float(shape.rgba[:3] @ [0.299, 0.587, 0.114])))
    found.sort(key=lambda own: own[0])
    return [hull for _, hull, _ in found], np.array([bright for *_, bright in found])


def draw_arm(axes: Axes, polygons: Sequence[Array], bright: Array, colour: Colour | None = None) -> None:
    """Draw outlines of an arm, in shades of grey or of a colour.

    Args:
        axes: Where to.
        polygons: See `outlines`.
        bright: The same, (solids,) [1].
        colour: In place of grey.
    """
    level = DARK + (LIGHT - DARK) * bright
    base = np.ones(3) if colour is None else np.array(colour[:3]) / 255
    faces = level[:, None] * base if colour is None else 1 - (1 - base) * (1.1 - 0.6 * level[:, None])
    axes.add_collection(
        PolyCollection(polygons, facecolors=faces, edgecolors=EDGE * faces, linewidths=THIN), autolim=True
    )
