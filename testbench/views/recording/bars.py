"""Bars whose lengths change along the timelines, each with its name and number above it."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.errors import Array
from testbench.views.recording.pen import Pen
from testbench.views.recording.style import NOISE, Colour
from testbench.views.schema import show

WIDTH, ROW, THICK = 1000.0, 150.0, 56.0
"""Length of the longest bar, distance of bars and their thickness, in the pane's own units."""
THREADS = 8  #: Lines of a bar: the ends of a line are round, and one thick line would be too long.
RADIUS = 1.3 * THICK / (2 * THREADS)  #: Of such a line: they leave no gaps.
LABEL, MARGIN = 108.0, 60.0
"""Height of a name's point above the middle of its bar, space on either side."""
SMALLEST = 1e-9  #: Longest bar is at least this long [mm]: exact models have no error.


def write_bars(
    path: str, names: Sequence[str], colours: Sequence[Colour], on: Sequence[tuple[Pen, Array]]
) -> None:
    """Bars from 0 on one linear scale, the first on top.

    Args:
        path: Root of their entities, which must name the unit, mm.
        names: One a bar.
        colours: One a bar.
        on: Pens, and the lengths that they write, (bars, rows) [mm].
    """
    longest = max(SMALLEST, *(float(mm.max()) for _, mm in on))
    count = len(names)
    y = ROW * np.arange(count, dtype=float)
    looks, _ = on[0]
    radii = [-0.5] * count + [RADIUS] * count
    looks.still(f"{path}/bar", rr.LineStrips2D.from_fields(colors=[NOISE] * count + [*colours], radii=radii))
    looks.still(f"{path}/name", rr.Points2D.from_fields(colors=colours, radii=0.0, show_labels=True))
    for pen, mm in on:
        rows = mm.shape[1]
        strips = [strip for ends in mm.T for strip in (*_frames(y), *_bars(WIDTH * ends / longest, y))]
        columns = rr.LineStrips2D.columns(strips=strips)
        pen.rows(f"{path}/bar", columns.partition([2 * count] * rows))
        texts = [f"{name}: {show(x)} mm" for row in mm.T for name, x in zip(names, row, strict=True)]
        at = np.tile(np.column_stack([np.full(count, WIDTH / 2), y - LABEL]), (rows, 1))
        words = rr.Points2D.columns(positions=at, labels=texts)
        pen.rows(f"{path}/name", words.partition([count] * rows))


def _frames(y: Array) -> Array:
    """How long bars at heights, (bars,), can be: (bars, 5, 2)."""
    corners = np.array([(0, -1), (1, -1), (1, 1), (0, 1), (0, -1)]) * [WIDTH, THICK / 2]
    return np.asarray(corners + np.column_stack([np.zeros(len(y)), y])[:, None])


def _bars(ends: Array, y: Array) -> Array:
    """Bars from 0 to their ends, (bars,), at heights, (bars,), each to and fro: (bars, 2 THREADS, 2)."""
    across = np.repeat(np.linspace(RADIUS - THICK / 2, THICK / 2 - RADIUS, THREADS), 2)
    there = np.tile([0.0, 1.0, 1.0, 0.0], THREADS // 2)
    return np.stack(np.broadcast_arrays(ends[:, None] * there, y[:, None] + across), axis=-1)


def bars_view(path: str, name: str, count: int) -> rrb.Spatial2DView:
    """The view of so many bars."""
    y = (-LABEL - THICK / 4, (count - 1) * ROW + THICK)
    bounds = rrb.VisualBounds2D(x_range=(-MARGIN, WIDTH + MARGIN), y_range=y)
    return rrb.Spatial2DView(origin=path, name=name, visual_bounds=bounds)
