"""Primitives as triangles, and what a closed surface weighs."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, QhullError

from testbench.errors import Array
from testbench.plant.import_robot.chain import Shape, Solid, moved

AROUND = 16  #: Corners of a circle.
SLACK = 5e-4  #: By which points may stand out of a hull over the extent of all of them [1].
SHRINKS = 0.9  #: As long as fewer than this share of points are left, there are more hulls to make [1].
AT_ONCE = 20_000  #: Points of a hull that is made at once.
VISIBLE = np.array([0.6, 0.6, 0.6, 1.0])  #: Colour where the file has none.


def solid_shape(solid: Solid, rgba: Array) -> Shape:
    """A primitive with its surface, that is drawn and collides."""
    corners = _corners(solid)
    hull = ConvexHull(corners)
    faces = _outward(corners, hull.simplices.astype(int))
    return Shape(moved(corners, solid.pose), faces, rgba, visual=True, collides=True, solid=solid)


def _corners(solid: Solid) -> Array:
    """Points whose hull is the primitive, in its own axes, (v, 3) [m]."""
    if solid.kind == "box":
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
        return np.asarray(signs * np.array(solid.size))
    turn = 2 * np.pi * np.arange(AROUND) / AROUND
    ring = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(AROUND)])
    if solid.kind == "cylinder":
        radius, half = solid.size
        return np.concatenate([ring * radius + [0, 0, z] for z in (-half, half)])
    tilt = np.linspace(-np.pi / 2, np.pi / 2, AROUND // 2 + 1)
    ball = np.concatenate([ring * np.cos(t) + [0, 0, np.sin(t)] for t in tilt])
    if solid.kind == "capsule":
        radius, half = solid.size
        return np.concatenate([ball * radius + [0, 0, z] for z in (-half, half)])
    return np.asarray(ball * np.array(solid.size if solid.kind == "ellipsoid" else solid.size * 3))


def hull_of(vertices: Array) -> tuple[Array, npt.NDArray[np.int_]] | None:
    """Corners and faces of the convex hull of points, to within SLACK; None where they are flat."""
    hull = _hull(vertices, _slack(vertices))
    if hull is None:
        return None
    used, faces = np.unique(hull.simplices, return_inverse=True)
    corners = vertices[used]
    return corners, _outward(corners, faces.reshape(-1, 3))


def outermost(vertices: Array) -> Array:
    """The corners that have the hull of all, (h, 3); all where they are flat.

    Of many, hulls of every tenth, say, are made first: the time for one grows faster than their number.
    """
    slack = _slack(vertices)
    while (groups := -(-len(vertices) // AT_ONCE)) > 1:
        kept = np.concatenate([_outer(vertices[k::groups], slack) for k in range(groups)])
        if len(kept) > SHRINKS * len(vertices):
            break
        vertices = kept
    return _outer(vertices, slack)


def _outer(vertices: Array, slack: float) -> Array:
    hull = _hull(vertices, slack)
    return vertices if hull is None else np.asarray(vertices[hull.vertices])


def _slack(vertices: Array) -> float:
    return SLACK * float(np.ptp(vertices, axis=0).max(initial=0.0))


def _hull(vertices: Array, slack: float) -> ConvexHull | None:
    """Without points that stand out by less than the slack: those of a fine cylinder take minutes else."""
    if len(vertices) < 4:
        return None
    try:
        return ConvexHull(vertices, qhull_options=f"W{slack:.17f}")
    except QhullError:
        return None


def _outward(corners: Array, faces: npt.NDArray[np.int_]) -> npt.NDArray[np.int_]:
    """Faces of a convex body with their corners counterclockwise as seen from outside."""
    a, b, c = corners[faces].transpose(1, 0, 2)
    inward = np.einsum("fx,fx->f", np.cross(b - a, c - a), a - corners.mean(axis=0)) < 0
    return np.where(inward[:, None], faces[:, ::-1], faces).astype(int)


def volume_integrals(vertices: Array, faces: npt.NDArray[np.int_]) -> tuple[float, Array, Array]:
    """Volume [m^3] of a closed surface, centroid [m] and inertia about it for unit density [m^5].

    Sums over tetrahedra from the origin; of one with corners 0, a, b, c the integral of x x^T is
    det/120 (sum of corners' outer products + outer product of their sum). To import trimesh, which has the
    same, takes a quarter of the time of `testbench check`.
    """
    t = vertices[faces]
    det = np.einsum("fx,fx->f", t[:, 0], np.cross(t[:, 1], t[:, 2]))
    volume = float(det.sum() / 6)
    if volume == 0:
        return 0.0, vertices.mean(axis=0), np.zeros((3, 3))
    total = t.sum(axis=1)
    centroid = np.einsum("f,fx->x", det, total) / (24 * volume)
    second = (np.einsum("f,fcx,fcy->xy", det, t, t) + np.einsum("f,fx,fy->xy", det, total, total)) / 120
    second -= volume * np.outer(centroid, centroid)
    return volume, centroid, np.trace(second) * np.eye(3) - second


def combined(parts: Sequence[tuple[float, Array, Array]]) -> tuple[float, Array, Array]:
    """Mass, centre of mass and inertia about it of bodies together, by parallel axes; zero without mass."""
    mass = sum(own for own, _, _ in parts)
    if mass == 0:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    centre = sum((own * c for own, c, _ in parts), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for own, c, tensor in parts:
        d = c - centre
        inertia += tensor + own * (d @ d * np.eye(3) - np.outer(d, d))
    return mass, centre, inertia
