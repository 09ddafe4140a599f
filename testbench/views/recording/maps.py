"""Maps of a run on one scale of colours: a ball a place, the worst by its name, and in words."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import rerun as rr
import rerun.blueprint as rrb
from rerun.components import FillMode

from testbench.errors import Array
from testbench.views.colours import GREY, SCALE
from testbench.views.markdown import Markdown, as_markdown, place
from testbench.views.recording.stream import Pen, snake, text_view
from testbench.views.recording.world import frame, orbit
from testbench.views.scene import PlaceMap, Scale, scale_of
from testbench.views.schema import show

MOST = 4  #: Maps side by side at most.
BALL = 0.02  #: Radius of the largest ball of a map over the size of what is in view [1].
SMALLEST = 0.4  #: Size of the ball of least error over that of the greatest [1]: colour is never alone.
KEYS, STEP, KEY = 5, 180.0, 20.0
"""Balls of the key, their distance and the radius of the largest, in the key's own units."""
ROOT, KEYED, WORDS = "world/map", "map_key_mm", "map_words"


def shades(share: Array) -> npt.NDArray[np.uint8]:
    """Colours of places on the scale, (n,) to (n, 3): the greater the error, the brighter."""
    at = np.linspace(0, 1, len(SCALE))
    parts = [np.rint(np.interp(share, at, part)) for part in zip(*SCALE, strict=True)]
    return np.column_stack(parts).astype(np.uint8)


def sizes(share: Array) -> Array:
    """Sizes of places on the scale over that of the greatest error, (n,) [1]."""
    return SMALLEST + (1 - SMALLEST) * share


def write_map(pen: Pen, found: PlaceMap, names: Sequence[str], size: float) -> None:
    """A map a line, rings where there is no number, the key, and in words where each is largest.

    Args:
        pen: What stands still is drawn with it.
        found: Errors by place.
        names: Of the places.
        size: Of what is in view [m].
    """
    scale, there, said = _scale(found), np.isfinite(found.at).all(axis=1), []
    for line in found.lines[:MOST]:
        path, known = f"{ROOT}/{snake(line.name)}", there & np.isfinite(line.values)
        share = scale.shares(line.values[known])
        balls = rr.Points3D(found.at[known], colors=shades(share), radii=BALL * size * sizes(share))
        pen.still(f"{path}/field", balls)
        if (there & ~known).any():
            _write_rings(pen, f"{path}/none", found.at[there & ~known], SMALLEST * BALL * size)
        if known.any():
            k = int(np.argmax(np.where(known, line.values, -np.inf)))
            own = f"{show(float(line.values[k]))} mm"
            pen.names(f"{path}/worst", found.at[[k]] + [0, 0, 3 * BALL * size], [f"worst {own}"], SCALE[-1])
            said.append(f"- {as_markdown(line.name)}: {own}, {as_markdown(names[k])}, {place(found.at[k])}")
    _write_key(pen, scale)
    rings = [f"Rings: {found.without}."] if found.without else []
    head = [f"{found.title}. Where each is largest:", "\n".join(said), *rings]
    pen.documents({WORDS: Markdown("\n\n".join(head))})


def _write_rings(pen: Pen, path: str, centres: Array, radius: float) -> None:
    """Grey rings about centres (n, 3) [m]."""
    half, lines = np.full(centres.shape, radius), FillMode.MajorWireframe
    rings = rr.Ellipsoids3D(centers=centres, half_sizes=half, colors=GREY, fill_mode=lines, line_radii=-0.5)
    pen.still(path, rings)


def _write_key(pen: Pen, scale: Scale) -> None:
    """Colours and sizes of a scale with their errors, in a row."""
    share = np.linspace(0, 1, KEYS)
    places = np.column_stack([STEP * np.arange(KEYS), np.zeros(KEYS)])
    pen.still(f"{KEYED}/dot", rr.Points2D(places, colors=shades(share), radii=KEY * sizes(share)))
    beside = places + np.array([0.45 * STEP, -0.75 * KEY])  # a label hangs below its point
    pen.names(f"{KEYED}/number", beside, [f"{show(mm)} mm" for mm in scale.errors(share)], GREY)


def _scale(found: PlaceMap) -> Scale:
    return scale_of(*(line.values for line in found.lines[:MOST]))


def map_tab(found: PlaceMap, arm: str, body: Array, size: float) -> rrb.Container:
    """The maps side by side with an arm, their key, and words.

    Args:
        found: Errors by place.
        arm: Root of the arm's entities in the world, empty for none.
        body: Points of the arm, (n, 3) [m].
        size: Of what is in view [m].
    """
    at = found.at[np.isfinite(found.at).all(axis=1)]
    points = np.vstack([at, body])
    eye = orbit(*frame(points, np.full(len(points), 0.1 * size), at[0, :2], aspect=1.1))
    views = [
        rrb.Spatial3DView(
            origin="world",
            name=f"{line.name}: {_typical(line.values)}, axes (m)",
            contents=[f"+ $origin/map/{snake(line.name)}/**", *([f"+ $origin/{arm}/**"] if arm else [])],
            eye_controls=eye,
        )
        for line in found.lines[:MOST]
    ]
    bounds = rrb.VisualBounds2D(x_range=(-0.3 * STEP, KEYS * STEP), y_range=(-1.6 * KEY, 1.6 * KEY))
    key = rrb.Spatial2DView(
        origin=KEYED, name=f"Colour and size ({_scale(found).words})", visual_bounds=bounds
    )
    parts = rrb.Horizontal(*views), key, text_view(WORDS, found.heading)
    return rrb.Vertical(*parts, row_shares=[11, 2, 3], name=found.heading)


def _typical(values: Array) -> str:
    known = values[np.isfinite(values)]
    if not known.size:
        return "none"
    return f"median {show(float(np.median(known)))}, largest {show(float(known.max()))} mm"
