"""Primitives as triangles, hulls, and what a closed surface weighs.

Hulls are Qhull's and not trimesh's, which shakes what is flat until it has one.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from testbench.errors import Array
from testbench.files.robot.robot import Faces, Mesh, Surface
from testbench.plant.shapes import POINTS, Kind, half_sizes

SLACK = 5e-4  #: By which points may stand out of a hull over the extent of all of them [1].
LEAST_INERTIA = 1e-9  #: Of a body about any axis [kg m^2].
SHRINKS = 0.9  #: As long as fewer than this share of points are left, there are more hulls to make [1].
AT_ONCE = 20_000  #: Points of a hull that is made at once.
Weighed = tuple[float, Array, Array]
"""Mass [kg] or volume [m^3], its centre, (3,) [m], and inertia about that, (3, 3) [kg m^2] or [m^5]."""
VISIBLE = np.array([0.6, 0.6, 0.6, 1.0])  #: Colour where the file has none.


def primitive(kind: Kind, size: Array) -> Mesh:
    """The surface of a primitive in its own axes, its size, (3,), as MuJoCo counts it [m]."""
    corners = POINTS[kind](half_sizes(kind, size))
    return Mesh(corners, _outward(corners, ConvexHull(corners).simplices.astype(int)), corners)


def hull_of(vertices: Array) -> Surface | None:
    """Corners and faces of the convex hull of points, to within SLACK; None where they are flat."""
    hull = _hull(vertices, _slack(vertices))
    if hull is None:
        return None
    used, faces = np.unique(hull.simplices, return_inverse=True)
    corners = vertices[used]
    return corners, _outward(corners, faces.reshape(-1, 3))


def hull_volume(vertices: Array) -> float:
    """Volume of the convex hull of points [m^3]; 0 where they are flat."""
    hull = _hull(vertices, _slack(vertices))
    return 0.0 if hull is None else float(hull.volume)


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


def _outward(corners: Array, faces: Faces) -> Faces:
    """Faces of a convex body with their corners counterclockwise as seen from outside."""
    a, b, c = corners[faces].transpose(1, 0, 2)
    inward = np.einsum("fx,fx->f", np.cross(b - a, c - a), a - corners.mean(axis=0)) < 0
    return np.where(inward[:, None], faces[:, ::-1], faces).astype(int)


def integrals(surface: Surface) -> Weighed:
    """Volume [m^3] of a closed surface, centroid [m] and inertia about it for unit density [m^5]."""
    import trimesh  # takes as long to import as MuJoCo

    found = trimesh.triangles.mass_properties(surface[0][surface[1]])
    return float(found.volume), found.center_mass, np.asarray(found.inertia)


def combined(parts: Sequence[Weighed]) -> Weighed:
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


def plausible(inertia: Array) -> Array:
    """The nearest inertia that a body can have: no moment exceeds the sum of the others."""
    moments, axes = np.linalg.eigh((inertia + inertia.T) / 2)
    least = max(LEAST_INERTIA, 1e-6 * float(np.abs(moments).max()))
    second = np.maximum(moments.sum() / 2 - moments, least / 2)  # integrals of x^2, y^2, z^2
    return np.asarray(axes @ np.diag(second.sum() - second) @ axes.T)
