"""Primitives as triangles, convex hulls, and masses of closed surfaces.

Hulls are computed by Qhull, not by trimesh, which perturbs flat points until they have a hull.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from testbench.errors import Array
from testbench.files.robot.robot import Faces, ImportedMesh, Surface
from testbench.plant.shapes import POINTS, Kind, half_sizes

SLACK = 5e-4
"""Distance by which points may be outside a hull, over the extent of all points [1]."""
MIN_INERTIA = 1e-9
"""Least moment of inertia of a body about any axis [kg m^2]."""
SHRINKS = 0.9
"""Share of points below which the next hull is computed of the points that are left [1]."""
AT_ONCE = 20_000
"""Most points of a hull that is computed in one step."""
Weighed = tuple[float, Array, Array]
"""Mass [kg] or volume [m^3], its centre, (3,) [m], and inertia about that, (3, 3) [kg m^2] or [m^5]."""
VISIBLE = np.array([0.6, 0.6, 0.6, 1.0])
"""Colour if the file states none."""


def primitive(kind: Kind, size: Array) -> ImportedMesh:
    """Make the surface of a primitive in its own axes.

    Args:
        kind: Name of the primitive in MuJoCo, such as "capsule".
        size: Its half sizes or radius in MuJoCo's convention, (3,) [m].

    Returns:
        The triangles of its convex hull.
    """
    corners = POINTS[kind](half_sizes(kind, size))
    return ImportedMesh(corners, _outward(corners, ConvexHull(corners).simplices.astype(int)), corners)


def hull_of(vertices: Array) -> Surface | None:
    """Compute the convex hull of points, to within SLACK.

    Args:
        vertices: The points, (v, 3) [m].

    Returns:
        Corners and faces of the hull; None if the points are flat.
    """
    hull = _hull(vertices, _slack(vertices))
    if hull is None:
        return None
    used, faces = np.unique(hull.simplices, return_inverse=True)
    corners = vertices[used]
    return corners, _outward(corners, faces.reshape(-1, 3))


def hull_volume(vertices: Array) -> float:
    """Compute the volume of the convex hull of points.

    Args:
        vertices: The points, (v, 3) [m].

    Returns:
        The volume [m^3]; 0 if the points are flat.
    """
    hull = _hull(vertices, _slack(vertices))
    return 0.0 if hull is None else float(hull.volume)


def outermost(vertices: Array) -> Array:
    """Select the corners that span the convex hull of all.

    For many corners, hulls of subsets are computed first: the time of one hull grows faster than their
    number.

    Args:
        vertices: The corners, (v, 3) [m].

    Returns:
        The selected corners, (h, 3) [m]; all if they are flat.
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
    """Compute the hull without points outside by less than the slack: a fine cylinder would take minutes."""
    if len(vertices) < 4:
        return None
    try:
        return ConvexHull(vertices, qhull_options=f"W{slack:.17f}")
    except QhullError:
        return None


def _outward(corners: Array, faces: Faces) -> Faces:
    """Orient the faces of a convex body counterclockwise as seen from outside."""
    a, b, c = corners[faces].transpose(1, 0, 2)
    inward = np.einsum("fx,fx->f", np.cross(b - a, c - a), a - corners.mean(axis=0)) < 0
    return np.where(inward[:, None], faces[:, ::-1], faces).astype(int)


def integrals(surface: Surface) -> Weighed:
    """Compute volume, centroid and inertia of a closed surface.

    Args:
        surface: Its vertices [m] and faces.

    Returns:
        Volume [m^3], centroid, (3,) [m], and inertia about it at unit density, (3, 3) [m^5].
    """
    import trimesh  # takes as long to import as MuJoCo

    found = trimesh.triangles.mass_properties(surface[0][surface[1]])
    return float(found.volume), found.center_mass, np.asarray(found.inertia)


def combined(parts: Sequence[Weighed]) -> Weighed:
    """Combine bodies to one mass, centre of mass and inertia, by the parallel axis theorem.

    With d from the common centre to that of a body, it adds I + m (d^T d 1 - d d^T).

    Args:
        parts: Mass m [kg], centre of mass, (3,) [m], and inertia I about it, (3, 3) [kg m^2], of each body.

    Returns:
        The same of all bodies; zeros if they have no mass.
    """
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
    """Compute the nearest inertia that a body can have: no principal moment exceeds the sum of the others.

    Args:
        inertia: Any inertia about the centre of mass, (3, 3) [kg m^2].

    Returns:
        Inertia with positive integrals of x^2, y^2 and z^2 over the mass, (3, 3) [kg m^2].
    """
    moments, axes = np.linalg.eigh((inertia + inertia.T) / 2)
    least = max(MIN_INERTIA, 1e-6 * float(np.abs(moments).max()))
    second = np.maximum(moments.sum() / 2 - moments, least / 2)  # integrals of x^2, y^2, z^2
    return np.asarray(axes @ np.diag(second.sum() - second) @ axes.T)
