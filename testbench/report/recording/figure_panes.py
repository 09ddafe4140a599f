"""Panes of a figure as views of a recording: lines, dots, names and axes that stay sharp at any size."""

from collections.abc import Iterator, Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import LineCollection, PathCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.transforms import Transform

from testbench.errors import Array
from testbench.report.colours import GREY, Colour
from testbench.report.figure import short
from testbench.report.recording.stream import Pen

WIDE, HIGH = 160.0, 100.0  #: Of the part inside of the axes, in units of the view.
LETTER, LINE = 3.9, 8.0  #: Room for a letter and for a line of text, in the same units.
DOT, STROKE = 0.4, 0.25  #: Radius of a dot and of a line over its size or width [1/pt].
GREYS = (0.25, 0.75)  #: Brightness beyond which a grey is not seen on a dark or on a light ground [1].
LETTERS = 30  #: Most letters of a name beside an axis.
THIN = 0.15  #: Radius of an outline.
NOTHING = ("None", "", " ", None)  #: Styles of lines and markers that are not drawn.
FAINT = 0.3  #: Least opacity of what is drawn.


def panes_of(figure_axes: list[Axes]) -> list[Axes]:
    """Those that hold lines or dots over named axes: no colour bars, keys or pictures."""
    return [axes for axes in figure_axes if axes.axison and axes.get_xlabel() and not axes.images]


def rows_of(axes: Axes) -> list[str]:
    """What stands beside the upright axis."""
    return _ticks(axes.yaxis)[1]


def write_pane(pen: Pen, path: str, axes: Axes, names: Sequence[str] = ()) -> rrb.Spatial2DView:
    """Write what a pane holds; its view, as large as all that is written in it.

    Args:
        pen: The recording.
        path: Where to.
        axes: The pane.
        names: What stands beside its upright axis; what the pane has if empty.
    """
    marks = list(_marks(axes))
    dots = [own for own in marks if own[0] == "dots"]
    lines = [own for own in marks if own[0] == "line"]
    if dots:
        colours = [_seen(colour) for _, colour, _, points in dots for _ in points]
        radii = [size for *_, size, points in dots for _ in points]
        places = np.concatenate([points for *_, points in dots])
        pen.still(f"{path}/dots", rr.Points2D(places, colors=colours, radii=radii))
    if lines:
        strips, shades = [points for *_, points in lines], [_seen(colour) for _, colour, *_ in lines]
        pen.still(f"{path}/lines", rr.LineStrips2D(strips, colors=shades, radii=[own[2] for own in lines]))
    corners = [(0.0, 0.0), (0.0, HIGH), (WIDE, HIGH)]
    pen.still(f"{path}/axes", rr.LineStrips2D([corners], colors=GREY, radii=0.3))
    if texts := [text for text in axes.texts if text.get_text()]:
        at = [_placed(axes, text.get_transform(), np.atleast_2d(text.get_position())) for text in texts]
        words = [text.get_text() for text in texts]
        aside = [[LETTER * len(own) / 2, -LINE / 2] for own in words]  # the viewer centres them
        pen.names(f"{path}/texts", np.concatenate(at) + aside, words, GREY)
    return _around(pen, path, axes, names)


def _around(pen: Pen, path: str, axes: Axes, names: Sequence[str]) -> rrb.Spatial2DView:
    """Numbers and names beside the axes and the key above them; the view that has room for all."""
    at, words = _ticks(axes.xaxis)
    if words:
        along = _placed(axes, axes.transData, np.column_stack([at, np.full(len(at), axes.get_ylim()[0])]))
        pen.names(f"{path}/x_numbers", np.column_stack([along[:, 0], np.full(len(at), HIGH)]), words, GREY)
    at, words = _ticks(axes.yaxis)
    words = [short(own, LETTERS) for own in (names or words)]
    left = 4 + LETTER * max(map(len, words), default=0)
    if words:
        along = _placed(axes, axes.transData, np.column_stack([np.full(len(at), axes.get_xlim()[0]), at]))
        places = np.column_stack([np.full(len(at), -left / 2), along[:, 1] - LINE / 2])
        pen.names(f"{path}/y_numbers", places, words, GREY)
    pen.names(f"{path}/x_name", np.array([[WIDE / 2, HIGH + LINE]]), [axes.get_xlabel()], GREY)
    above = _key(pen, path, axes)
    if axes.get_ylabel():
        above += LINE
        pen.names(f"{path}/y_name", np.array([[WIDE / 4, -above - 2]]), [axes.get_ylabel()], GREY)
    right = 10 + LETTER * max((len(text.get_text()) for text in axes.texts), default=0)
    bounds = rrb.VisualBounds2D(x_range=(-left - 4, WIDE + right), y_range=(-above - 6, HIGH + 2 * LINE + 6))
    title = " ".join((axes.get_title() or axes.get_title("left") or axes.get_xlabel()).split())
    return rrb.Spatial2DView(origin=path, name=title, visual_bounds=bounds)


def _ticks(axis: Axis) -> tuple[Array, list[str]]:
    """Where ticks of an axis are and what stands at them, those inside of it."""
    low, high = sorted(axis.get_view_interval())
    at = np.asarray(axis.get_majorticklocs())
    words = [" ".join(text.split()) for text in axis.get_major_formatter().format_ticks(at.tolist())]
    inside = [k for k, place in enumerate(at.tolist()) if low <= place <= high and words[k]]
    return at[inside], [words[k] for k in inside]


def _key(pen: Pen, path: str, axes: Axes) -> float:
    """Names of lines in their colours; how high that is."""
    named = [(text, handle) for handle, text in zip(*axes.get_legend_handles_labels(), strict=True)]
    lines = [(text, handle) for text, handle in named if isinstance(handle, Line2D)]
    longest = max((len(text) for text, _ in lines), default=1)
    across = max(1, int(WIDE / (LETTER * (longest + 1))))
    rows = -(-len(lines) // across)
    for k, (text, line) in enumerate(lines):
        at = np.array([[WIDE * (k % across + 0.5) / across, -LINE * (rows - k // across) - 2]])
        pen.names(f"{path}/key_{k}", at, [text], _seen(to_rgb(line.get_color())))
    return LINE * rows


def _placed(axes: Axes, transform: Transform, points: Array) -> Array:
    """Points in units of the view, y downwards, (n, 2)."""
    shares = (transform + axes.transAxes.inverted()).transform(np.asarray(points, dtype=float))
    return np.column_stack([WIDE * shares[:, 0], HIGH * (1 - shares[:, 1])])


Mark = tuple[str, tuple[float, ...], float, Array]


def _marks(axes: Axes) -> Iterator[Mark]:
    """Lines and dots of a pane: what, colour, radius and points, those within its axes."""
    for what, colour, size, points in _all_marks(axes):
        near = np.isfinite(points) & (np.abs(points - 0.5 * WIDE) < 2 * WIDE)
        inside = np.asarray(near.all(axis=1))
        if what == "dots":
            if inside.any():
                yield what, colour, size, points[inside]
            continue
        for part in np.split(np.arange(len(points)), np.flatnonzero(~inside)):
            whole = part[inside[part]]
            if len(whole) > 1:
                yield what, colour, size, points[whole]


def _all_marks(axes: Axes) -> Iterator[Mark]:
    for line in axes.get_lines():
        points = _placed(axes, line.get_transform(), np.asarray(line.get_xydata(), dtype=float))
        colour = to_rgb(line.get_color())
        if line.get_linestyle() not in NOTHING and len(points) > 1 and np.ptp(points, axis=0).any():
            yield "line", colour, STROKE * line.get_linewidth(), points
        if line.get_marker() not in NOTHING and len(points):
            yield "dots", colour, DOT * line.get_markersize(), points
    for own in axes.collections:
        if isinstance(own, PathCollection):
            yield from _scattered(axes, own)
        elif isinstance(own, PolyCollection | LineCollection):
            yield from _outlined(axes, own)
    for patch in axes.patches:
        if isinstance(patch, Rectangle) and (patch.get_alpha() or 1.0) > FAINT:
            (x0, y0), (x1, y1) = _placed(axes, patch.get_transform(), np.array([[0, 0], [1, 1]]))
            centre, half = np.array([x0 + x1, y0 + y1]) / 2, np.abs([x1 - x0, y1 - y0]) / 2
            way = half - half.min()  # the ends of a line are round
            yield (
                "line",
                to_rgb(patch.get_facecolor()),
                float(half.min()),
                np.array([centre - way, centre + way]),
            )


def _scattered(axes: Axes, own: PathCollection) -> Iterator[Mark]:
    """Dots of one size or several, in one colour or several."""
    at = _placed(axes, own.get_offset_transform(), np.asarray(own.get_offsets()))
    colours, sizes = np.asarray(own.get_facecolor()), np.sqrt(own.get_sizes())
    for k, point in enumerate(at):
        yield "dots", tuple(colours[k % len(colours)][:3]), DOT * sizes[k % len(sizes)], point[None]


def _outlined(axes: Axes, own: PolyCollection | LineCollection) -> Iterator[Mark]:
    """Outlines of areas, and lines."""
    colours = np.asarray(own.get_facecolor() if isinstance(own, PolyCollection) else own.get_colors())
    for k, outline in enumerate(own.get_paths()):
        points = _placed(axes, own.get_transform(), np.asarray(outline.vertices))
        yield "line", tuple(colours[k % len(colours)][:3]), THIN, points


def _seen(colour: tuple[float, ...]) -> Colour:
    """The colour, of 0 to 1, as one that is seen on a dark and on a light ground."""
    low, high = min(colour[:3]), max(colour[:3])
    grey = high - low < 0.1 and not GREYS[0] < (low + high) / 2 < GREYS[1]
    return GREY if grey else tuple(round(255 * part) for part in colour[:3])
