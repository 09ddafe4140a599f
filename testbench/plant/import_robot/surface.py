"""The shapes of a part as few small files: one mesh that is drawn, hulls and primitives that collide."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.errors import Array
from testbench.plant.import_robot.meshes import decimated, distinct, joined, with_area
from testbench.plant.import_robot.robot import Body, Faces, Shape, Surface, seen
from testbench.plant.import_robot.solids import VISIBLE, hull_of, outermost

DRAWN_FACES = 1500  #: Of the mesh that shows a part.
HULL_FACES = 200  #: Of a hull.
GRID = 64, 48, 32, 24, 16, 12  #: Cells along the longest side of a surface that cannot be thinned as it is.
LOOSE = 5000  #: Faces that need not make a surface; the time to thin more of them has no bound.
OPEN = 0.25  #: Of a surface, sides that belong to one triangle alone over all, at most [1].
A_CORNER, AROUND = 4.0, 1000  #: Triangles of a surface over its corners, and around one corner, at most [1].
ENOUGH = 1.2  #: A surface of so many times the faces asked for is thin enough [1].
MOST_HULLS = 8  #: Of a part; more are one.


@dataclass(frozen=True, eq=False)
class Surfaces:
    """What a part looks like, and what of it others run into."""

    drawn: Surface | None  #: One mesh for all meshes of the file.
    drawn_solids: list[Shape]  #: Primitives.
    rgba: Array  #: Of the mesh, that of its largest piece, (4,) [1].
    hulls: list[Surface]
    solids: list[Shape]  #: Primitives that collide.


def surfaces(part: Body) -> Surfaces:
    """What is written of a part's shapes.

    Where nothing is drawn, what collides is drawn; where nothing collides, the hull of what is drawn does.
    Rods do not: held at zero, they stand where the arm goes.
    """
    drawn, hard = seen(part.shapes), [s for s in part.shapes if s.collides]
    meshes = [s for s in drawn if s.kind == "mesh"]
    found = [s.surface for s in meshes]
    areas = [_area(*surface) for surface in found]
    return Surfaces(
        drawn=_small(joined(found), DRAWN_FACES) if found else None,
        drawn_solids=[s for s in drawn if s.kind != "mesh"],
        rgba=meshes[int(np.argmax(areas))].rgba if meshes else VISIBLE,
        hulls=_hulls([s for s in hard if s.kind == "mesh"] if hard else [s for s in drawn if s.bears]),
        solids=[s for s in hard if s.kind != "mesh"],
    )


def _area(vertices: Array, faces: Faces) -> float:
    a, b, c = vertices[faces].swapaxes(0, 1)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def _small(surface: Surface, most: int) -> Surface:
    """A surface of few faces: thinned; where screws and plates cannot be thinned, on a coarser grid first."""
    if len(surface[1]) > LOOSE and not _sound(surface[1]):
        surface = hull_of(outermost(surface[0])) or surface
    thin = decimated(*surface, most)
    for cells in GRID:
        if len(thin[1]) <= ENOUGH * most:
            break
        thin = decimated(*_gridded(*surface, cells), most)
    return thin


def _sound(faces: Faces) -> bool:
    """Whether triangles make a surface: few have a rim, no corner belongs to a crowd of them."""
    faces = faces[distinct(np.sort(faces, axis=1))[0]]
    sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, shared = np.unique(sides @ np.array([1 << 32, 1]), return_counts=True)
    around = np.bincount(faces.ravel())
    few = len(faces) <= A_CORNER * np.count_nonzero(around) and around.max() <= AROUND
    return bool(few and (shared == 1).sum() <= OPEN * len(sides))


def _gridded(vertices: Array, faces: Faces, cells: int) -> Surface:
    """A surface whose corners in one cell of a grid are one, in their middle."""
    low, size = vertices.min(axis=0), np.ptp(vertices, axis=0).max()
    _, inverse = distinct((vertices - low) * (cells / size))
    count = np.bincount(inverse)
    middle = np.column_stack([np.bincount(inverse, weights=x) for x in vertices.T]) / count[:, None]
    kept = with_area(inverse[faces])
    first, _ = distinct(np.sort(kept, axis=1))
    return middle, kept[np.sort(first)]


def _hulls(shapes: Sequence[Shape]) -> list[Surface]:
    """Hulls of meshes, of all together where they are many; flat ones have none."""
    clouds = [s.cloud for s in shapes]
    if len(clouds) > MOST_HULLS:
        clouds = [np.concatenate(clouds)]
    found = []
    for cloud in clouds:
        hull = hull_of(cloud)
        if hull and len(hull[1]) > HULL_FACES:
            hull = hull_of(decimated(*hull, HULL_FACES)[0])
        if hull:
            found.append(hull)
    return found
