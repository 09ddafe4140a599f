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
KEYS = 5  #: Errors of which the words say the colour.
ROOT, WORDS = "world/map", "map_words"


def shades(share: Array) -> npt.NDArray[np.uint8]:
    """Colours of places on the scale, (n,) to (n, 3): the greater the error, the brighter."""
    at = np.linspace(0, 1, len(SCALE))
    parts = [np.rint(np.interp(share, at, part)) for part in zip(*SCALE, strict=True)]
    return np.column_stack(parts).astype(np.uint8)


def sizes(share: Array) -> Array:
    """Sizes of places on the scale over that of the greatest error, (n,) [1]."""
    return SMALLEST + (1 - SMALLEST) * share


def write_map(pen: Pen, found: PlaceMap, names: Sequence[str], size: float) -> None:
    """A map a line, rings where there is no number; in words what colours are, and where each is largest.

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
    key = ", ".join(f"{show(mm)}" for mm in scale.errors(np.linspace(0, 1, KEYS)))
    said.append(f"\nFrom small and blue-grey by green to large and orange: {key} {scale.words}.")
    rings = [f"Rings: {found.without}."] if found.without else []
    head = [f"{found.title}. Where each is largest:", "\n".join(said), *rings]
    pen.documents({WORDS: Markdown("\n\n".join(head))})


def _write_rings(pen: Pen, path: str, centres: Array, radius: float) -> None:
    """Grey rings about centres (n, 3) [m]."""
    half, lines = np.full(centres.shape, radius), FillMode.MajorWireframe
    rings = rr.Ellipsoids3D(centers=centres, half_sizes=half, colors=GREY, fill_mode=lines, line_radii=-0.5)
    pen.still(path, rings)


def _scale(found: PlaceMap) -> Scale:
    return scale_of(*(line.values for line in found.lines[:MOST]))


def map_tab(found: PlaceMap, arm: str, body: Array, size: float) -> rrb.Container:
    """The maps side by side with an arm, and words.

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
    parts = rrb.Horizontal(*views), text_view(WORDS, found.heading)
    return rrb.Vertical(*parts, row_shares=[13, 3], name=found.heading)


def _typical(values: Array) -> str:
    known = values[np.isfinite(values)]
    if not known.size:
        return "none"
    return f"median {show(float(np.median(known)))}, largest {show(float(known.max()))} mm"
