"""The shapes of a part as few small files: one mesh that is drawn, hulls and primitives that collide."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.errors import Array
from testbench.plant.adopt.chain import Part, Shape, Solid
from testbench.plant.adopt.meshes import Faces, decimated
from testbench.plant.adopt.solids import VISIBLE, hull_of

DRAWN_FACES = 1500  #: Of the mesh that shows a part.
HULL_FACES = 200  #: Of a hull.
MOST_HULLS = 8  #: Of a part; more are one.

Surface = tuple[Array, Faces]


@dataclass(frozen=True, eq=False)
class Surfaces:
    """What a part looks like, and what of it others run into."""

    drawn: Surface | None  #: One mesh for all meshes of the file.
    drawn_solids: tuple[tuple[Solid, Array], ...]  #: With their colours.
    rgba: Array  #: Of the mesh, that of its largest piece, (4,) [1].
    hulls: tuple[Surface, ...]
    solids: tuple[Solid, ...]  #: Those that collide.


def surfaces(part: Part) -> Surfaces:
    """What is written of a part's shapes.

    Where nothing is drawn, what collides is drawn; where nothing collides, the hull of what is drawn does.
    """
    drawn = [s for s in part.shapes if s.visual] or [s for s in part.shapes if s.collides]
    meshes = [s for s in drawn if s.solid is None]
    hard = [s for s in part.shapes if s.collides]
    largest = max(meshes, key=lambda s: float(_areas(s).sum()), default=None)
    return Surfaces(
        drawn=_small(_joined(meshes), DRAWN_FACES) if meshes else None,
        drawn_solids=tuple((s.solid, s.rgba) for s in drawn if s.solid),
        rgba=VISIBLE if largest is None else largest.rgba,
        hulls=tuple(_hulls([s for s in hard if s.solid is None] if hard else drawn)),
        solids=tuple(s.solid for s in hard if s.solid),
    )


def _areas(shape: Shape) -> Array:
    t = shape.vertices[shape.faces]
    return np.asarray(np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1) / 2)


def _joined(shapes: Sequence[Shape]) -> Surface:
    first = np.cumsum([0, *(len(s.vertices) for s in shapes)])
    faces = np.concatenate([s.faces + first[k] for k, s in enumerate(shapes)])
    return np.concatenate([s.vertices for s in shapes]), faces


def _small(surface: Surface, most: int) -> Surface:
    """A surface of few faces; the largest ones of it if it cannot be thinned."""
    vertices, faces = decimated(*surface, most)
    if len(faces) > 2 * most:
        t = vertices[faces]
        area = np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1)
        faces = faces[np.sort(np.argsort(-area)[: 2 * most])]
    return vertices, faces


def _hulls(shapes: Sequence[Shape]) -> list[Surface]:
    """Hulls of meshes, of all together where they are many; flat ones have none."""
    clouds = [s.vertices for s in shapes]
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
