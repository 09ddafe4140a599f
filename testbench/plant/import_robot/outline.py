"""How thick a link is: its drawn surface cut across the beam axis."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from testbench.errors import Array
from testbench.plant.import_robot.chain import Shape, seen

CUTS = 17  #: Cuts across a link.
INNER = 0.1, 0.9  #: They stand at this share of its length, clear of the flanges [1].
FEWEST = 6  #: Cuts that must meet the surface: a third of the link is drawn at least.


def triangles(shapes: Sequence[Shape]) -> Array:
    """Triangles of a part's drawn shapes, of those that collide where none is drawn, (f, 3, 3) [m]."""
    bearing = seen([s for s in shapes if s.bears])
    return np.concatenate([np.empty((0, 3, 3)), *(s.vertices[s.faces] for s in bearing)])


def extent(surface: Array, axis: Array) -> tuple[float, float]:
    """Where a surface begins and ends along an axis [m]."""
    along = surface @ axis
    return float(along.min()), float(along.max())


def outer_diameter(surface: Array, frame: Array, span: tuple[float, float]) -> float | None:
    """Diameter of the circle of the same area as the hull of a cut, the median of the cuts [m].

    Args:
        surface: Triangles in the part's frame, (f, 3, 3) [m].
        frame: Beam axes as columns, (3, 3).
        span: From where to where along the beam axis [m].

    Returns:
        None where too few cuts meet the surface.
    """
    low, high = (span[0] + share * (span[1] - span[0]) for share in INNER)
    turned = surface @ frame
    least, most = turned[:, :, 0].min(axis=1), turned[:, :, 0].max(axis=1)
    found = [_diameter(turned[(least < x) & (x <= most)], x) for x in np.linspace(low, high, CUTS)]
    met = [d for d in found if d is not None]
    return float(np.median(met)) if len(met) >= FEWEST else None


def _diameter(surface: Array, x: float) -> float | None:
    """Of the cut at x of triangles in beam axes, (f, 3, 3)."""
    ends = []
    for a, b in ((0, 1), (1, 2), (2, 0)):
        p, q = surface[:, a], surface[:, b]
        cut = (p[:, 0] < x) != (q[:, 0] < x)
        p, q = p[cut], q[cut]
        share = (x - p[:, 0]) / (q[:, 0] - p[:, 0])
        ends.append(p[:, 1:] + share[:, None] * (q[:, 1:] - p[:, 1:]))
    points = np.concatenate(ends)
    if len(points) < 3:
        return None
    try:
        return float(2 * np.sqrt(ConvexHull(points).volume / np.pi))  # of a plane hull the area
    except QhullError:  # a line
        return None
