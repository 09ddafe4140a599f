"""Where the eye is: as near as it can be with everything in view."""

import numpy as np

from testbench.errors import Array

HALF_VIEW = np.tan(np.deg2rad(27.5))  #: Tangent of half the viewer's vertical angle of view.
ASPECT = 1.25  #: Width over height of the narrowest pane that shows the arm [1].
SIDE = (0.35, 0.9, 0.25)  #: Where the eye is: ahead along the reach of the arm, beside it, above [1].


def frame(
    points: Array,
    radii: Array,
    tool: Array,
    side: tuple[float, float, float] = SIDE,
    aspect: float = ASPECT,
) -> tuple[Array, Array]:
    """Eye and target, each (3,) [m], all spheres in view.

    Args:
        points: Their centres, (points, 3) [m].
        radii: Of the spheres, (points,) [m].
        tool: Where the arm reaches, seen from above, (2,) [m].
        side: Where the eye is: ahead along the reach of the arm, beside it, above [1].
        aspect: Width over height of the pane [1].
    """
    length = float(np.linalg.norm(tool))
    x, y = tool / length if length > 0 else (1.0, 0.0)
    ahead, aside, above = side
    back = np.array([aside * y + ahead * x, -aside * x + ahead * y, above])
    back /= np.linalg.norm(back)
    right = np.array([-back[1], back[0], 0]) / np.hypot(back[0], back[1])
    axes = np.column_stack([back, right, np.cross(back, right)])
    along = points @ axes
    low, high = (along - radii[:, None]).min(axis=0), (along + radii[:, None]).max(axis=0)
    target = axes @ ((low + high) / 2)
    depth, across, up = ((points - target) @ axes).T
    wide = np.maximum(np.abs(across) / aspect, np.abs(up)) + radii
    distance = float((depth + wide / HALF_VIEW).max())  # the point that needs most
    return target + distance * back, target
