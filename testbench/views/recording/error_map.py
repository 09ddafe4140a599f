"""How errors look on a map: colours and sizes of balls, and their key."""

import numpy as np
import numpy.typing as npt
import rerun as rr
import rerun.blueprint as rrb

from testbench.errors import Array
from testbench.views.colours import SCALE
from testbench.views.recording.pen import Pen
from testbench.views.recording.style import NOISE
from testbench.views.scale import Scale
from testbench.views.schema import show

SMALLEST = 0.4  #: Size of the point of least error over that of the greatest [1]: colour is never alone.
KEYS, STEP, KEY = 5, 180.0, 20.0
"""Points of the key, their distance and the radius of the largest, in the key's own units."""


def shades(share: Array) -> npt.NDArray[np.uint8]:
    """Colours of places on the scale, (n,) to (n, 3): the greater the error, the brighter."""
    at = np.linspace(0, 1, len(SCALE))
    parts = [np.rint(np.interp(share, at, part)) for part in zip(*SCALE, strict=True)]
    return np.column_stack(parts).astype(np.uint8)


def sizes(share: Array) -> Array:
    """Sizes of places on the scale over that of the greatest error, (n,) [1]."""
    return SMALLEST + (1 - SMALLEST) * share


def write_balls(pen: Pen, path: str, centres: Array, share: Array, radius: float) -> None:
    """Balls at centres (n, 3) [m] by their places on the scale, (n,); `radius` of the largest [m]."""
    pen.still(path, rr.Points3D(centres, colors=shades(share), radii=radius * sizes(share)))


def write_key(pen: Pen, path: str, scale: Scale) -> None:
    """Colours and sizes of a scale with their errors, in a row; the path must name the unit, mm."""
    share = np.linspace(0, 1, KEYS)
    places = np.column_stack([STEP * np.arange(KEYS), np.zeros(KEYS)])
    pen.still(f"{path}/dot", rr.Points2D(places, colors=shades(share), radii=KEY * sizes(share)))
    beside = places + np.array([0.45 * STEP, -0.75 * KEY])  # a label hangs below its point
    pen.names(f"{path}/number", beside, [f"{show(mm)} mm" for mm in scale.errors(share)], NOISE)


def key_view(path: str, scale: Scale) -> rrb.Spatial2DView:
    """The view of a key."""
    bounds = rrb.VisualBounds2D(x_range=(-0.3 * STEP, KEYS * STEP), y_range=(-1.6 * KEY, 1.6 * KEY))
    name = f"Colour and size of an error ({scale.words})"
    return rrb.Spatial2DView(origin=path, name=name, visual_bounds=bounds)
