"""Any MJCF arm from its geometry: bodies rigid and, magnified, deflected; and the weight that it carries."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.components import FillMode
from scipy.spatial.transform import Rotation

from testbench.bench.campaign import Cell
from testbench.errors import Array
from testbench.plant.shapes import Frames, Shape, body_names, join_meshes, visual_shapes
from testbench.views.recording.pen import Pen
from testbench.views.recording.style import GHOST, LOAD, Colour

ARROW = 0.2  #: Length of the load's arrow over the reach of the arm [1].
STEEL = 7850.0  #: Density [kg/m^3] of the drawn weight, a cube.
LABEL = "world/load/label"


def write_shapes(
    pen: Pen, cell: Cell, moving: Sequence[int], colour: Colour | None = None, root: str = "arm"
) -> None:
    """The shapes of every body of the arm, and once more those of the bodies that deflect visibly.

    `moving` are those with a ghost: one that stays where it is would flicker through the body's surface.
    Without a colour the arm is grey, each shape of its own brightness. `root` is its entity in the world.
    """
    pen.still("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    shapes = visual_shapes(cell.room)
    for body, name in drawn_bodies(cell):
        own = [shape for shape in shapes if shape.body == body]
        pen.still(_path(root, name), *_solids(own, colour))
        if body in moving:
            pen.still(_path(f"{root}_deflected", name), *_solids(own, GHOST))


def write_places(
    pen: Pen, cell: Cell, rigid: Frames, ghost: Frames | None = None, moving: Sequence[int] = ()
) -> None:
    """Transforms of the bodies of an arm.

    Args:
        pen: On the times of the frames.
        cell: The arm.
        rigid: The arm without load.
        ghost: Under load, magnified; None where no body has a ghost.
        moving: Bodies with a ghost.
    """
    every = [body for body, _ in drawn_bodies(cell)]
    write_frames(pen, cell, rigid, "arm", every)
    if ghost is not None:
        write_frames(pen, cell, ghost, "arm_deflected", moving)


def write_frames(pen: Pen, cell: Cell, frames: Frames, root: str, bodies: Sequence[int]) -> None:
    """Transforms of some bodies of the arm that is at `root` in the world."""
    for body, name in drawn_bodies(cell):
        if body in bodies:
            turns = Rotation.from_matrix(frames.rotations[:, body]).as_quat()
            at = rr.Transform3D.columns(translation=frames.positions[:, body], quaternion=turns)
            pen.rows(_path(root, name), at)


def write_weight(pen: Pen, hook: Array, carried: Array, size: float) -> None:
    """The hung weight on its sling; its label stands below it; see `write_hung`."""
    below = write_hung(pen, hook, carried, np.full(len(hook), ARROW * size), size)
    pen.label(LABEL, below, [f"{kg:.4g} kg" for kg in carried], LOAD)


def write_hung(pen: Pen, hook: Array, carried: Array, sling: Array, size: float) -> Array:
    """A sling with a hook, and on it a cube of steel: none where the hook is empty.

    Args:
        pen: On the times of the rows.
        hook: Load point, (rows, 3) [m].
        carried: Mass that hangs, (rows,) [kg].
        sling: Length of the sling, (rows,) [m].
        size: Reach of the arm, the scale of symbols [m].

    Returns:
        Places below what hangs, (rows, 3) [m].
    """
    down, end = np.array([0.0, 0.0, -1.0]), hook - sling[:, None] * [0, 0, 1]
    pen.still("world/load/sling", rr.LineStrips3D.from_fields(colors=LOAD, radii=0.004 * size))
    pen.rows("world/load/sling", rr.LineStrips3D.columns(strips=np.stack([hook, end], axis=1)))
    pen.still("world/load/hook", rr.Points3D.from_fields(colors=LOAD, radii=0.012 * size))
    pen.points("world/load/hook", end[:, None])
    half = np.cbrt(carried / STEEL) / 2
    centre = end + np.outer(half, down)
    pen.still("world/load/weight", rr.Boxes3D.from_fields(colors=LOAD, fill_mode=FillMode.Solid))
    hung = np.asarray(carried > 0)
    cubes = rr.Boxes3D.columns(centers=centre[hung], half_sizes=np.column_stack([half] * 3)[hung])
    pen.rows("world/load/weight", cubes.partition(hung.astype(int)))
    return np.asarray(centre + np.outer(half + 0.04 * size, down))


def reach(frames: Frames) -> float:
    """Largest distance of a body from the foot of the arm, the scale of symbols [m]."""
    arm = frames.positions[:, 1:]  # the world is first
    return float(np.linalg.norm(arm - arm[:, :1], axis=-1).max())


def origins(cell: Cell, names: Sequence[str], frames: Frames) -> Array:
    """Origins of named bodies, (rows, len(names), 3) [m]."""
    known = body_names(cell.room)
    return frames.positions[:, [known.index(name) for name in names]]


def orbit(eye: Array, target: Array) -> rrb.EyeControls3D:
    """A camera that turns about its target; both (3,) [m]."""
    return rrb.EyeControls3D(kind=rrb.Eye3DKind.Orbital, position=eye, look_target=target, eye_up=(0, 0, 1))


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
        vertex_colors=np.repeat(np.array(colours, dtype=np.uint8)[:, :3], counts, axis=0),
        albedo_factor=(255, 255, 255, *colours[0][3:]),  # of a vertex the viewer takes no transparency
    )
