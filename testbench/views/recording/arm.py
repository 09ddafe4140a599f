"""Any MJCF arm from its geometry: bodies rigid and, magnified, deflected; and the weight that it carries."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr
from rerun.components import FillMode
from scipy.spatial.transform import Rotation

from testbench.bench.campaign import Cell
from testbench.errors import Array
from testbench.plant.shapes import Frames, Shape, body_names, join_meshes, visual_shapes
from testbench.views.recording.style import GHOST, LOAD, Colour

ARROW = 0.2
"""Length of the load's arrow over the reach of the arm [1]."""
STEEL = 7850.0
"""Density [kg/m^3] of the drawn weight, a cube."""


def write_shapes(stream: rr.RecordingStream, cell: Cell, moving: Sequence[int]) -> None:
    """The shapes of every body of the arm, and once more those of the bodies that deflect visibly.

    Args:
        stream: Where to.
        cell: The arm.
        moving: Bodies with a ghost: one that stays where it is would flicker through the body's surface.
    """
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    shapes = visual_shapes(cell.room)
    for body, name in drawn_bodies(cell):
        own = [shape for shape in shapes if shape.body == body]
        stream.log(_path("arm", name), *_solids(own, None), static=True)
        if body in moving:
            stream.log(_path("arm_deflected", name), *_solids(own, GHOST), static=True)


@dataclass(frozen=True)
class Places:
    """Where every body is at every time, and where its ghost is."""

    times: Sequence[rr.TimeColumn]  #: Of the rows of the frames.
    rigid: Frames  #: Without load.
    ghost: Frames | None = None  #: Under load, magnified; None where no body has a ghost.
    moving: Sequence[int] = ()  #: Bodies with a ghost.


def write_places(stream: rr.RecordingStream, cell: Cell, places: Places) -> None:
    """Transforms of the bodies of an arm."""
    for body, name in drawn_bodies(cell):
        for entity, frames in (("arm", places.rigid), ("arm_deflected", places.ghost)):
            if frames is not None and (entity == "arm" or body in places.moving):
                turns = Rotation.from_matrix(frames.rotations[:, body]).as_quat()
                at = rr.Transform3D.columns(translation=frames.positions[:, body], quaternion=turns)
                stream.send_columns(_path(entity, name), places.times, at)


@dataclass(frozen=True)
class Weight:
    """A weight on the hook."""

    hook: Array  #: Load point, (rows, 3) [m].
    payload: Array  #: Mass of the weight, (rows,) [kg].
    share: Array  #: How much of it the arm carries, (rows,) [1].


def write_weight(
    stream: rr.RecordingStream, times: Sequence[rr.TimeColumn], weight: Weight, reach: float
) -> None:
    """The hung weight, a cube of steel; its label stands below it, away from the markers.

    Args:
        stream: Where to.
        times: Of the rows.
        weight: What hangs.
        reach: Of the arm, the scale of symbols [m].
    """
    hook, share = weight.hook, weight.share
    half = np.cbrt(weight.payload / STEEL) / 2
    look = rr.Boxes3D.from_fields(colors=LOAD, fill_mode=FillMode.Solid)
    stream.log("world/load/weight", look, static=True)
    down = np.array([0.0, 0.0, -1.0])
    centre = hook + np.outer(ARROW * reach * share + half, down)
    cubes = rr.Boxes3D.columns(centers=centre, half_sizes=np.column_stack([half] * 3))
    stream.send_columns("world/load/weight", times, cubes)
    below = centre + np.outer(half + 0.04 * reach, down)
    write_load_label(stream, times, below, [f"{kg:.4g} kg" for kg in share * weight.payload])


def write_load_label(
    stream: rr.RecordingStream, times: Sequence[rr.TimeColumn], at: Array, texts: Sequence[str]
) -> None:
    """What the load is: a text a row, at points (rows, 3) [m]."""
    look = rr.Points3D.from_fields(colors=LOAD, radii=0.0, show_labels=True)
    stream.log("world/load/label", look, static=True)
    columns = rr.Points3D.columns(positions=at, labels=texts).partition([1] * len(at))
    stream.send_columns("world/load/label", times, columns)


def drawn_bodies(cell: Cell) -> list[tuple[int, str]]:
    """Index and name of the bodies that have a shape; load and markers are drawn by their roles."""
    names = body_names(cell.room)
    bodies = sorted({shape.body for shape in visual_shapes(cell.room)})
    return [(k, names[k]) for k in bodies if names[k] not in (cell.arm.load, *cell.arm.markers)]


def _path(entity: str, name: str) -> str:
    return rr.new_entity_path(["world", entity, name])


def _solids(shapes: Sequence[Shape], colour: Colour | None) -> list[rr.AsComponents]:
    """The shapes of a body, one archetype a kind; in shades of grey where no colour is given."""
    solids: list[rr.AsComponents] = []
    for kind in dict.fromkeys(shape.kind for shape in shapes):
        own = [shape for shape in shapes if shape.kind == kind]
        size, centre = np.array([s.size for s in own]), np.array([s.position for s in own])
        R, radius, length = np.array([s.rotation for s in own]), size[:, 0], 2 * size[:, 2]
        look: dict[str, Any] = {
            "quaternions": Rotation.from_matrix(R).as_quat(),
            "colors": [colour or _grey(s.rgba) for s in own],
            "fill_mode": FillMode.Solid,
        }
        if kind == "mesh":
            solids.append(_mesh(own, look["colors"]))
        elif kind == "box":
            solids.append(rr.Boxes3D(half_sizes=size, centers=centre, **look))
        elif kind == "cylinder":
            solids.append(rr.Cylinders3D(lengths=length, radii=radius, centers=centre, **look))
        elif kind == "capsule":  # Rerun's begins at its origin
            start = centre - R[:, :, 2] * size[:, 2:]
            solids.append(rr.Capsules3D(lengths=length, radii=radius, translations=start, **look))
        else:
            solids.append(rr.Ellipsoids3D(half_sizes=size, centers=centre, **look))
    return solids


def _grey(rgba: Array) -> Colour:
    """Grey of about the brightness of a colour, neither black nor white: colours are roles."""
    level = round(255 * (0.35 + 0.45 * float(rgba[:3] @ [0.299, 0.587, 0.114])))
    return level, level, level


def _mesh(shapes: Sequence[Shape], colours: Sequence[Colour]) -> rr.Mesh3D:
    """All meshes of a body as one."""
    mesh, counts = join_meshes(shapes)
    return rr.Mesh3D(
        vertex_positions=mesh.vertices,
        vertex_normals=mesh.normals,
        triangle_indices=mesh.faces,
        vertex_colors=np.repeat(np.array(colours, dtype=np.uint8), counts, axis=0),
    )
