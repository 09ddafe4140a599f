"""The recording of any run, made of what its page draws: arms in poses, charts, maps, figures, words.

A tab answers one question: what happens in the poses, where it errs, what all numbers are. All is on one
timeline: a typical pose, then all poses, the worst first, or along their path.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.path import Path as Path2D
from matplotlib.transforms import Transform

from testbench.errors import Array, Ids
from testbench.plant.shapes import BodyFrames, select_frames
from testbench.report.colours import (
    GCO,
    GREY,
    JOINTS,
    JOINTS_PRIOR,
    LEAST_SQUARES,
    LEAST_SQUARES_PRIOR,
    LOAD,
    MEASURED,
    NOMINAL,
    TASK,
    Colour,
)
from testbench.report.figure import RATIO, SOFT, Figure, forest_pane, log_ticks, row_head
from testbench.report.markdown import Markdown, ReportWords, as_markdown, capital, grid
from testbench.report.recording.stream import Pen, RecordingHeader, recording, snake, text_view
from testbench.report.recording.world import (
    ASPECT,
    SIDE,
    frame,
    map_tab,
    orbit,
    reach,
    write_arm,
    write_layer,
    write_map,
)
from testbench.report.run_figure import headline
from testbench.report.scene import (
    Layer,
    ModelLine,
    PageContent,
    PoseGroup,
    RunChart,
    Scene,
    charts_of,
    sorting_numbers,
    squares,
)
from testbench.report.schema import Table
from testbench.runs.spread import middle
from testbench.workflows.model_names import in_words

# --- Panes of a figure as views of a recording: lines, dots, names and axes that stay sharp at any size -----

LETTER, LINE, GAP = 6.2, 16.5, 9.0
"""Width of a letter, height of a line of text, and room around what is written, in a viewer 1600 pixels wide
[pixel]: its texts keep their size, whatever the view shows."""
LEAST_WIDE, LEAST_HIGH = 120.0, 90.0  #: Of the part inside of the axes [pixel].
DOT, STROKE = 0.7, 0.45  #: Radius of a dot and of a line over its size or width [pixel/pt].
GREYS = (0.25, 0.75)  #: Brightness beyond which a grey is not seen on a dark or on a light ground [1].
THIN, AXIS = 0.3, 0.5  #: Radius of an outline and of an axis [pixel].
NOTHING = ("None", "", " ", None)  #: Styles of lines and markers that are not drawn.
FAINT = 0.3  #: Least opacity of what is drawn.

Size = tuple[float, float]  #: Width and height [pixel].


def panes_of(figure_axes: list[Axes]) -> list[Axes]:
    """Those that hold lines or dots over named axes: no colour bars, keys or pictures."""
    return [axes for axes in figure_axes if axes.axison and axes.get_xlabel() and not axes.images]


def rows_of(axes: Axes) -> list[str]:
    """What stands beside the upright axis."""
    return _ticks(axes.yaxis)[1]


def least_height(axes: Axes, names: Sequence[str]) -> float:
    """Height of a pane in which no two names beside its upright axis touch [pixel]."""
    return _rows_height(names) + _above(axes) + BELOW


def _rows_height(names: Sequence[str]) -> float:
    """Height of the part inside of the axes that names beside it need [pixel]."""
    lines = max((name.count("\n") + 1 for name in names), default=0)
    return max(LEAST_HIGH, len(names) * (LINE * lines + GAP / 2))


def _longest(texts: Iterable[str]) -> float:
    """Width of the longest line of texts [pixel]."""
    return LETTER * max((len(line) for text in texts for line in text.split("\n")), default=0)


BELOW = 3 * LINE  #: Room below the axes: numbers and what they are [pixel].
KEY_LINE = 1.4 * LINE  #: From one entry of a key to the next [pixel].


def _above(axes: Axes) -> float:
    """Room above the axes: what the upright one is [pixel]."""
    return GAP + LINE * bool(axes.get_ylabel())


def write_pane(
    pen: Pen, path: str, axes: Axes, size: Size, names: Sequence[str] = (), *, with_key: bool = True
) -> rrb.Spatial2DView:
    """Write what a pane holds; its view, as large as all that is written in it.

    Args:
        pen: The recording.
        path: Where to.
        axes: The pane.
        size: Of the view in a viewer 1600 pixels wide [pixel].
        names: What stands beside its upright axis; what the pane has if empty.
        with_key: Whether its key is written; the room for it stays, so that axes below each other align.
    """
    names, keys = names or rows_of(axes), _keys(axes)
    texts = [text for text in axes.texts if text.get_text()]
    left = GAP + _longest(names)
    aside = GAP + _longest(text.get_text() for text in texts)
    right = aside + GAP + _longest(text for text, _ in keys)
    wide = max(LEAST_WIDE, size[0] - left - right)
    high = max(_rows_height(names), KEY_LINE * len(keys), size[1] - _above(axes) - BELOW)
    inside = (wide, high)
    marks = list(_marks(axes, inside))
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
    corners = [(0.0, 0.0), (0.0, high), (wide, high)]
    pen.still(f"{path}/axes", rr.LineStrips2D([corners], colors=GREY, radii=AXIS))
    if texts:
        at = [
            _placed(axes, inside, text.get_transform(), np.atleast_2d(text.get_position())) for text in texts
        ]
        said = _written_at(np.concatenate(at), [text.get_text() for text in texts], 1)
        pen.names(f"{path}/texts", *said, GREY)
    for k, (text, colour) in enumerate(keys if with_key else []):
        beside = np.array([[wide + (aside + right) / 2, KEY_LINE * k]])
        pen.names(f"{path}/key_{k}", beside, [text], _seen(colour))
    _around(pen, path, axes, inside, names)
    bounds = rrb.VisualBounds2D(x_range=(-left - GAP, wide + right), y_range=(-_above(axes), high + BELOW))
    title = " ".join((axes.get_title() or axes.get_title("left") or axes.get_xlabel()).split())
    return rrb.Spatial2DView(origin=path, name=title, visual_bounds=bounds)


def _written_at(at: Array, words: Sequence[str], side: int) -> tuple[Array, list[str]]:
    """Where the viewer is told to write texts, (n, 2) [pixel], and these, each line by itself.

    It centres a line below its place, and of many texts of several lines it shows the first lines only.

    Args:
        at: Where texts begin or end, in the middle of their height, (texts, 2) [pixel].
        words: The texts.
        side: 1 where they begin there, -1 where they end.
    """
    places, lines = [], []
    for (x, y), text in zip(at.tolist(), words, strict=True):
        own = text.split("\n")
        for k, line in enumerate(own):
            places.append([x + side * _longest([line]) / 2, y + LINE * (k - len(own) / 2)])
            lines.append(line)
    return np.array(places), lines


def _around(pen: Pen, path: str, axes: Axes, inside: Size, names: Sequence[str]) -> None:
    """Write numbers and names beside the axes."""
    wide, high = inside
    at, words = _ticks(axes.xaxis)
    if words:
        along = _placed(
            axes, inside, axes.transData, np.column_stack([at, np.full(len(at), axes.get_ylim()[0])])
        )
        pen.names(f"{path}/x_numbers", np.column_stack([along[:, 0], np.full(len(at), high)]), words, GREY)
    at, _ = _ticks(axes.yaxis)
    if names:
        along = _placed(
            axes, inside, axes.transData, np.column_stack([np.full(len(at), axes.get_xlim()[0]), at])
        )
        ends = np.column_stack([np.full(len(at), -GAP), along[:, 1]])
        pen.names(f"{path}/y_numbers", *_written_at(ends, names, -1), GREY)
    pen.names(f"{path}/x_name", np.array([[wide / 2, high + 1.3 * LINE]]), [axes.get_xlabel()], GREY)
    if axes.get_ylabel():
        pen.names(f"{path}/y_name", np.array([[wide / 4, -1.3 * LINE]]), [axes.get_ylabel()], GREY)


def _ticks(axis: Axis) -> tuple[Array, list[str]]:
    """Where ticks of an axis are and what stands at them, those inside of it."""
    low, high = sorted(axis.get_view_interval())
    at = np.asarray(axis.get_majorticklocs())
    texts = axis.get_major_formatter().format_ticks(at.tolist())
    words = ["\n".join(" ".join(line.split()) for line in text.split("\n")) for text in texts]
    inside = [k for k, place in enumerate(at.tolist()) if low <= place <= high and words[k]]
    return at[inside], [words[k] for k in inside]


def _keys(axes: Axes) -> list[tuple[str, tuple[float, ...]]]:
    """Names of lines, each with its colour."""
    named = zip(*axes.get_legend_handles_labels(), strict=True)
    return [(text, to_rgb(line.get_color())) for line, text in named if isinstance(line, Line2D)]


def _placed(axes: Axes, inside: Size, transform: Transform, points: Array) -> Array:
    """Points in pixels of the part inside of the axes, y downwards, (n, 2)."""
    shares = (transform + axes.transAxes.inverted()).transform(np.asarray(points, dtype=float))
    return np.column_stack([inside[0] * shares[:, 0], inside[1] * (1 - shares[:, 1])])


Mark = tuple[str, tuple[float, ...], float, Array]


def _marks(axes: Axes, inside: Size) -> Iterator[Mark]:
    """Lines and dots of a pane: what, colour, radius and points, cut off where its axes end."""
    wide, high = inside
    for what, colour, size, points in _all_marks(axes, inside):
        if what == "dots":
            near = ((points >= -1) & (points <= [wide + 1, high + 1])).all(axis=1)  # none of NaN is
            if near.any():
                yield what, colour, size, points[near]
            continue
        cut = Path2D(points).cleaned(clip=(0.0, 0.0, wide, high), remove_nans=True)
        codes = np.asarray(cut.codes)
        starts = np.flatnonzero(codes == Path2D.MOVETO)
        for part in np.split(np.asarray(cut.vertices)[codes != Path2D.STOP], starts)[1:]:
            if len(part) > 1:
                yield what, colour, size, part


def _all_marks(axes: Axes, inside: Size) -> Iterator[Mark]:
    """All that a pane draws, also beyond its axes."""
    for line in axes.get_lines():
        points = _placed(axes, inside, line.get_transform(), np.asarray(line.get_xydata(), dtype=float))
        colour = to_rgb(line.get_color())
        if line.get_linestyle() not in NOTHING and len(points) > 1 and np.ptp(points, axis=0).any():
            yield "line", colour, STROKE * line.get_linewidth(), points
        if line.get_marker() not in NOTHING and len(points):
            yield "dots", colour, DOT * line.get_markersize(), points
    for own in axes.collections:
        if isinstance(own, PolyCollection | LineCollection):
            yield from _outlined(axes, inside, own)
    for patch in axes.patches:
        if isinstance(patch, Rectangle) and (patch.get_alpha() or 1.0) > FAINT:
            (x0, y0), (x1, y1) = _placed(axes, inside, patch.get_transform(), np.array([[0, 0], [1, 1]]))
            centre, half = np.array([x0 + x1, y0 + y1]) / 2, np.abs([x1 - x0, y1 - y0]) / 2
            way = half - half.min()  # the ends of a line are round
            yield (
                "line",
                to_rgb(patch.get_facecolor()),
                float(half.min()),
                np.array([centre - way, centre + way]),
            )


def _outlined(axes: Axes, inside: Size, own: PolyCollection | LineCollection) -> Iterator[Mark]:
    """Outlines of areas, and lines."""
    colours = np.asarray(own.get_facecolor() if isinstance(own, PolyCollection) else own.get_colors())
    for k, outline in enumerate(own.get_paths()):
        points = _placed(axes, inside, own.get_transform(), np.asarray(outline.vertices))
        yield "line", tuple(colours[k % len(colours)][:3]), THIN, points


def _seen(colour: tuple[float, ...]) -> Colour:
    """The colour, of 0 to 1, as one that is seen on a dark and on a light ground."""
    low, high = min(colour[:3]), max(colour[:3])
    grey = high - low < 0.1 and not GREYS[0] < (low + high) / 2 < GREYS[1]
    return GREY if grey else tuple(round(255 * part) for part in colour[:3])


# --- The recording of any run, made of what its page draws: arms in poses, charts, maps, figures, words -----

TYPICAL = "typical_first"
"""The timeline: the pose that a reader lands on, then all from 1 on, the worst first or in their order."""
HUES: Mapping[str, Colour] = {
    "sky blue": NOMINAL,
    "rust": MEASURED,
    "purple": LOAD,
    "grey": GREY,
    "olive": TASK,
    "orange": LEAST_SQUARES,
    "green": GCO,
    "bright green": (8, 162, 14),
    "blue": JOINTS,
    "indigo": JOINTS_PRIOR,
    "pink": LEAST_SQUARES_PRIOR,
    "vermillion": (213, 94, 0),
    "salmon": (210, 116, 98),
    "teal": (0, 161, 154),
    "slate": (120, 150, 154),
    "grey-teal": (100, 136, 128),
    "dark slate": (99, 106, 125),
    "grey-green": (132, 150, 119),
    "dark grey-green": (88, 116, 109),
    "yellow-green": (122, 151, 6),
    "dark yellow-green": (93, 112, 12),
    "brown": (166, 118, 29),
    "grey-brown": (107, 107, 100),
    "maroon": (150, 86, 92),
    "sand": (157, 131, 83),
    "steel blue": (103, 130, 159),
    "pale green": (150, 205, 190),
}
"""Colours by name."""
STEEP = 0.8  #: How steeply a path is looked down on, over how far the eye is ahead and aside [1].
VIEW_MARGIN, NEAR_MARGIN = 0.16, 0.03  #: Room around the arm and around what is near, over its size [1].
STACKED = 1.9  #: Width over height of panes above each other [1].
SIDE_WIDE = 620.0  #: Width of the column beside the arm, in a viewer 1600 pixels wide [pixel].
MOST_MODELS = 10  #: Models beside the arm at most, the first ones.
ANSWER_WIDE, TAB_HIGH, TITLE_HIGH = 1120.0, 890.0, 28.0
"""Width of all figures beside the summary, height of a tab and of the title of a view in it [pixel]."""
MOST_PANES = 6  #: Panes of figures at most.
LEGEND_EDGE, LEGEND_LINE, CHART_EDGE = 40.0, 23.5, 25.0
"""Sizes of a legend besides its letters and of a line of it; height of the numbers below a chart [pixel]."""
SUMMARY, CHART = 5.0, 7.0  #: Usual heights of the summary and of a chart, as shares of what models leave.
SUMMARY_EDGE, CHART_HIGH, LEAST_CHART = 70.0, 240.0, 170.0
"""Height of a summary without words, of a chart beside more than headings, and at least [pixel]."""
SUMMARY_LINES = (("## ", 56, 27.0), ("#### ", 60, 23.0), ("", 86, 16.0))
"""Letters of a line of a summary and its height [pixel], by how its Markdown begins."""
FAR, BAR = 30.0, 0.45
"""Times the least number from which models are dots on a logarithmic axis; height of bars [1]."""


@dataclass(frozen=True)
class _Group:
    """A group of poses as the timeline has it, and where its parts are in the recording."""

    poses: PoseGroup  #: That of the page: the pose shown first, then all in their order.
    name: str  #: Of its entities.
    arm: str  #: Root of its arm's bodies; groups of the same poses share one.
    charts: Sequence[RunChart]  #: Its map as one, where it has no other.
    sorted: bool  #: Whether the worst pose is the first of the others.

    @property
    def size(self) -> float:
        """Of what is in view [m]."""
        near = self.poses.near
        return reach(self.poses.rigid) if near is None else float(np.linalg.norm(np.ptp(near, axis=0)))

    def path(self, chart: RunChart, *line: str) -> str:
        """Where a chart or a line of it is."""
        return "/".join(["charts", self.name, snake(chart.title), *map(snake, line)])


def write_run(
    path: Path, header: RecordingHeader, words: ReportWords, page: PageContent, figures: Mapping[str, Figure]
) -> None:
    """Write a run for the Rerun viewer; an existing file is replaced only by a whole one.

    Args:
        path: The .rrd file.
        header: What identifies it.
        words: What the report says.
        page: What is drawn of it.
        figures: Figures that the run has beside those of the page, by name: their panes are drawn anew.
    """
    if page.map and not any(np.isfinite(line.values).any() for line in page.map.lines):
        page = replace(page, map=None)  # nowhere is there a bound
    groups = _groups(page)
    titles = [own.title for own in (page.scene, page.map, *page.runs) if own]
    documents = {"summary": summary(words), "tables": _tables(words, page)}
    places = len(groups[0].poses.names) if groups else 1
    with recording(path, header, [*documents.values(), *titles]) as pen:
        pen.documents(documents)
        if page.scene:
            _write_scene(pen, page.scene, groups)
            if page.map:  # its balls are no layers: their colours are said beside it
                own = groups[page.map.group]
                _timed(pen, own).texts(f"place/{own.name}", _poses_words(own.poses))
        names, arm, body, size = _around_map(page, groups)
        if page.map:
            write_map(pen, page.map, names, size)
        models = _models(pen, page.tables, alone=page.scene is None)
        panes = _panes(pen, figures, alone=page.scene is None)
        tabs: list[rrb.Container | rrb.View] = []
        tabs += (
            _scene_tabs(page, groups, models, documents["summary"])
            if page.scene
            else [_answer(panes or [view for view, _ in models])]
        )
        if page.map:
            here = [f"place/{groups[page.map.group].name}"] if groups else []
            tabs.append(map_tab(page.map, arm, body, size, here))
        tables = text_view("tables", "Tables")
        tabs.append(_columns([tables], panes, "Tables") if page.scene and panes else tables)
        pen.layout(*tabs, timeline=TYPICAL if groups else None, places=places)


def _scene_tabs(
    page: PageContent, groups: Sequence[_Group], models: Sequence[tuple[rrb.View, float]], said: str
) -> list[rrb.Container]:
    """A tab a group, the answer beside the first one; insets are in that, the map's group is in its tab."""
    assert page.scene
    near = [group.name for group in page.scene.insets]
    insets = [group for group in groups if group.poses.name in near]
    first, *others = (group for group in groups if group not in insets)
    on_map = groups[page.map.group] if page.map else None
    told, chart = _heights(said, TAB_HIGH - sum(own for _, own in models), len(first.charts))
    shares = [told, *[own for _, own in models], *[chart] * len(first.charts)]
    views = [text_view("summary", "Summary"), *[view for view, _ in models], *_charts(first, chart)]
    answer = rrb.Vertical(*views, row_shares=shares)
    front = _columns(
        [
            _world(page.scene, first, aspect=STACKED if insets else ASPECT),
            *[rrb.Horizontal(*(_world(page.scene, group, aspect=STACKED) for group in insets))]
            * bool(insets),
        ],
        [answer],
        first.poses.name,
        text_view(f"here/{first.name}", "What is shown"),
    )
    more = [
        _columns(
            [_world(page.scene, group)],
            _charts(group, TAB_HIGH / max(1, len(group.charts))),
            group.poses.name,
            text_view(f"here/{group.name}", "What is shown"),
        )
        for group in others
        if group is not on_map
    ]
    return [front, *more]


def _heights(said: str, high: float, charts: int) -> tuple[float, float]:
    """Share a height between the summary and so many charts.

    The summary has room for its headings; beside its other words, charts keep theirs for lines and legend.

    Args:
        said: The summary, as Markdown.
        high: The height [pixel].
        charts: How many.

    Returns:
        Heights of the summary and of each chart [pixel].
    """
    if not charts:
        return high, 0.0
    head = words = SUMMARY_EDGE
    for line in said.split("\n"):
        letters, pitch = next(own for mark, *own in SUMMARY_LINES if line.startswith(mark))
        more = pitch * math.ceil(len(line) / letters)
        words += more
        head += more if line.startswith("#") else 0.0
    usual = SUMMARY * high / (SUMMARY + CHART * charts)
    told = max(usual, min(words, high - CHART_HIGH * charts), min(head, high - LEAST_CHART * charts))
    return told, (high - told) / charts


def _answer(panes: list[rrb.View]) -> rrb.Container:
    """Figures beside the answer."""
    summary = text_view("summary", "Summary")
    tables = rrb.Vertical(text_view("tables", "Tables"))
    grid = rrb.Grid(*panes, grid_columns=_across(len(panes))) if panes else tables
    return rrb.Horizontal(grid, summary, column_shares=[5, 2], name="Answer")


def _models(pen: Pen, tables: Sequence[Table], *, alone: bool) -> list[tuple[rrb.View, float]]:
    """The models of the first table that has some, sorted by what it is about; which are not conservative.

    Args:
        pen: The recording.
        tables: Of the page.
        alone: Whether they have the tab to themselves, and not a place beside the arm.

    Returns:
        Their view and its height in a viewer 1000 pixels high [pixel]; none without models.
    """
    if not (found := headline(tables)):
        return []
    (table, column), count = found, len(found[0].rows)
    table = table if alone else replace(table, rows=table.rows[:MOST_MODELS])
    axes, name = Figure().subplots(), table.columns[0]
    forest_pane(axes, table, column)
    low, high = axes.dataLim.intervalx.tolist()
    sizes = [middle(column.value(row)) for row in table.rows]
    if column.key == RATIO:
        axes.axvline(1, color=SOFT)
        log_ticks(axes, "x", min(low, 1.0), max(high, 1.0))
    elif high > FAR * low > 0:
        log_ticks(axes, "x", low, high)
    else:
        colours = [table.looks[name.cell(row)].hex for row in table.rows]
        axes.barh(range(len(sizes)), sizes, BAR, color=colours)
        axes.set_xlim(min(0.0, low), 1.03 * high)
    axes.set_yticks(range(len(sizes)), [row_head(in_words(name.cell(row))) for row in table.rows])
    known = [own for own in table.columns if own.key == "conservative"]
    for y, (size, row) in enumerate(zip(sizes, table.rows, strict=True)):
        free = any(own.value(row) is False for own in known)
        words = f"{column.text(size)}, not conservative" if free else column.text(size)
        axes.text(1.01, y, words, transform=axes.get_yaxis_transform())
    some = f", {len(sizes)} of {count}" if len(sizes) < count else ""
    axes.set_title(f"{table.title or 'Models'}{some}")
    high = TAB_HIGH - TITLE_HIGH if alone else least_height(axes, rows_of(axes))
    wide = ANSWER_WIDE if alone else SIDE_WIDE
    return [(write_pane(pen, "models", axes, (wide, high)), high + TITLE_HIGH)]


def _across(count: int) -> int:
    """How many of so many figures stand side by side beside the summary."""
    return {1: 1, 2: 1, 4: 2}.get(count, 3)


def _panes(pen: Pen, figures: Mapping[str, Figure], *, alone: bool) -> list[rrb.View]:
    """The first panes of figures, as many as have room for all their rows, at least one.

    Panes side by side share the names of their rows; each view has them.

    Args:
        pen: The recording.
        figures: By name.
        alone: Whether they have a tab to themselves, and not a column beside the tables.
    """
    every: list[tuple[str, Axes, list[str]]] = []
    for name, figure in figures.items():
        panes = panes_of(figure.axes)
        heads = [text.rpartition(" ")[0] for text in rows_of(panes[0])] if panes else []
        for k, axes in enumerate(panes):
            rows = rows_of(axes)
            bare = k > 0 and len(rows) == len(heads) and not any(" " in own for own in rows)
            names = [f"{head} {own}" for head, own in zip(heads, rows, strict=True)] if bare else rows
            every.append((f"figures/{snake(name)}_{k}", axes, names))
    for count in range(min(len(every), MOST_PANES), 0, -1):
        chosen, across = every[:count], _across(count) if alone else 1
        needed = max(least_height(axes, names) for _, axes, names in chosen) + TITLE_HIGH
        if count == 1 or -(-count // across) * needed <= TAB_HIGH:
            return _written(pen, chosen, across, alone=alone)
    return []


def _written(
    pen: Pen, chosen: Sequence[tuple[str, Axes, list[str]]], across: int, *, alone: bool
) -> list[rrb.View]:
    """Write panes, each as large as its place in the tab: so many side by side; a key that repeats once."""
    wide = ANSWER_WIDE / across if alone else SIDE_WIDE
    high = TAB_HIGH / -(-len(chosen) // across) - TITLE_HIGH
    keys = [_keys(axes) for _, axes, _ in chosen]
    return [
        write_pane(pen, path, axes, (wide, high), names, with_key=keys[k] not in keys[:k])
        for k, (path, axes, names) in enumerate(chosen)
    ]


def summary(words: ReportWords) -> str:
    """What a recording says first."""
    badge = words.block("badge")
    head = [f"## **{badge}**" if badge else "", f"#### {words.block('question')}"]
    head += [f"#### **{words.block('answer')}**" if words.block("answer") else ""]
    return "\n\n".join(filter(None, [*head, *map(words.block, ("worst", "statements"))]))


def _names(tables: Sequence[Table]) -> Markdown:
    """The models of tables, each with its words; empty where names say what they are."""
    names = dict.fromkeys(table.columns[0].cell(row) for table in tables for row in table.rows)
    words = {name: in_words(name) for name in names if in_words(name) != name}
    told = [f"**{as_markdown(name)}**: {as_markdown(own)}" for name, own in words.items()]
    return Markdown("; ".join(told) and f"Models: {'; '.join(told)}.")


def _tables(words: ReportWords, page: PageContent) -> str:
    """What stands below the first sentences, and tables of the page that are not among it."""
    rest = words.block("body")
    others = [(table.title, grid(table)) for table in page.tables if table.rows]
    parts = [f"### {as_markdown(title)}\n\n{text}" for title, text in others if text not in rest]
    return "\n\n".join(filter(None, [_names(page.tables), rest, *parts]))


def _groups(page: PageContent) -> list[_Group]:
    """Groups of the scene in their orders; those of the same poses have one order, arm and set of charts."""
    found: dict[int, tuple[str, Ids, bool, BodyFrames]] = {}
    groups: list[_Group] = []
    every = page.scene.groups if page.scene else ()
    for k, poses in enumerate(every):
        charts = [] if page.scene and poses in page.scene.insets else charts_of(page, k)
        if id(poses.rigid) not in found:
            leads = [] if poses.ordered else sorting_numbers(poses, charts)
            order = np.argsort(-leads[-1], kind="stable") if leads else np.arange(len(poses.names))
            shown = np.array([poses.first, *order])
            found[id(poses.rigid)] = (
                f"arm_{k}" if k else "arm",
                shown,
                bool(leads),
                select_frames(poses.rigid, shown),
            )
        arm, shown, by_size, rigid = found[id(poses.rigid)]
        lines = [replace(chart, lines=[_of_rows(line, shown) for line in chart.lines]) for chart in charts]
        groups.append(_Group(_shown(poses, shown, rigid), snake(poses.name), arm, lines, by_size))
    return groups


def _shown(poses: PoseGroup, rows: Ids, rigid: BodyFrames) -> PoseGroup:
    """Poses in the order of the timeline."""
    layers = [
        replace(
            layer,
            at=layer.at[rows] if len(layer.at) == len(poses.names) else layer.at,
            to=layer.to if layer.to is None or len(layer.to) != len(poses.names) else layer.to[rows],
        )
        for layer in poses.layers
    ]
    return replace(
        poses,
        names=[poses.names[k] for k in rows],
        words=[poses.words[k] for k in rows],
        rigid=rigid,
        bent=None if poses.bent is None else select_frames(poses.bent, rows),
        layers=layers,
        first=0,
    )


def _of_rows(line: ModelLine, rows: Ids) -> ModelLine:
    """Numbers in the order of the timeline; none at its start, where a pose stands for the second time."""
    values, *ends = (np.append(np.nan, own[rows[1:]]) for own in (line.values, *(line.ends or ())))
    return replace(line, values=values, ends=(ends[0], ends[1]) if ends else None)


def _around_map(page: PageContent, groups: Sequence[_Group]) -> tuple[Sequence[str], str, Array, float]:
    """Names of the places of the map, the arm beside them, its points (n, 3) [m], size of all that [m]."""
    if page.map and page.scene:
        group, names = groups[page.map.group], page.scene.groups[page.map.group].names
        return names, group.arm, group.poses.rigid.positions[0, 1:], group.size
    at = page.map.at if page.map else np.zeros((1, 3))
    size = float(np.nanmax(np.linalg.norm(at, axis=1)))
    return [f"place {k}" for k in range(1, len(at) + 1)], "", np.zeros((1, 3)), size


def _write_scene(pen: Pen, scene: Scene, groups: Sequence[_Group]) -> None:
    """Arms, layers, words and charts of every group."""
    drawn: set[str] = set()
    for group in groups:
        rows = _timed(pen, group)
        if group.arm not in drawn:
            drawn.add(group.arm)
            bent = next((g.poses.bent for g in groups if g.arm == group.arm and g.poses.bent), None)
            write_arm(rows, scene.cell, group.arm, group.poses.rigid, bent)
        tubes = scene.tube_words if any(layer.kind == "tubes" for layer in group.poses.layers) else ""
        key = " ".join(filter(None, [_colours(group.poses.layers), tubes]))
        rows.texts(f"here/{group.name}", [f"{text}\n\n{key}" for text in _poses_words(group.poses)])
        for layer in group.poses.layers:
            write_layer(rows, f"world/{group.name}/{snake(layer.name)}", layer, group.size, scene.tube_scale)
        for chart in group.charts:
            for line in chart.lines:
                _write_line(
                    rows, group.path(chart, line.words), line, lead=chart.leads and line is chart.lines[-1]
                )
            if chart.limit is not None and np.isfinite(chart.limit):
                level = np.full(len(group.poses.names), chart.limit)
                rows.line(group.path(chart, chart.limit_is), chart.limit_is, None, level)


def _timed(pen: Pen, group: _Group) -> Pen:
    """Write in rows, a pose a time."""
    return pen.on(rr.TimeColumn(TYPICAL, sequence=np.arange(len(group.poses.names))))


def _poses_words(poses: PoseGroup) -> list[str]:
    """Say which pose is shown and what is said of it, a text a pose."""
    pairs = zip(poses.names, poses.words, strict=True)
    return [f"**{as_markdown(name)}.** {as_markdown(text)}" for name, text in pairs]


def _colours(layers: Sequence[Layer]) -> str:
    """What each colour is, in words; tubes have those of their errors."""
    named: dict[str, list[str]] = {}
    for own in (layer for layer in layers if layer.shown):
        look = f"{'' if own.kind == 'tubes' else _hue(own.colour)} {own.kind}".strip()
        named.setdefault(look, []).append(as_markdown(own.name))
    said = "; ".join(f"{look}: {', '.join(names)}" for look, names in named.items())
    return said and f"{capital(said)}."


def _hue(colour: Colour) -> str:
    """The nearest colour that has a name."""
    apart = {name: sum((a - b) ** 2 for a, b in zip(own, colour, strict=False)) for name, own in HUES.items()}
    return min(apart, key=apart.__getitem__)


def _write_line(rows: Pen, path: str, line: ModelLine, *, lead: bool) -> None:
    """A number a pose with its interval; what is not known leaves a gap."""
    rows.line(path, line.words, line.look, line.values, lead=lead)
    for name, values in zip(("lower", "upper"), line.ends or (), strict=False):
        if np.isfinite(values).any():
            rows.line(f"{path}_{name}", f"{line.words}, {name} end", None, values)


def _charts(group: _Group, height: float) -> list[rrb.View]:
    """Numbers of each pose, a chart a view of this height [pixel]."""
    order = "the worst first" if group.sorted else "in order"
    rooms = [_legend_room(chart, height) for chart in group.charts]
    return [
        rrb.TimeSeriesView(
            origin=group.path(chart),
            name=f"{chart.title}, by {chart.across}, {order}",
            axis_x=_beyond(len(group.poses.names), aside),
            axis_y=_from_zero(chart, above),
            plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
        )
        for chart, (above, aside) in zip(group.charts, rooms, strict=True)
    ]


def _legend_room(chart: RunChart, height: float) -> tuple[float, float]:
    """Room for the legend of a chart, so that it covers no number, where it takes less of the pane.

    Args:
        chart: The chart.
        height: Of its view in a viewer 1600 x 1000 [pixel].

    Returns:
        Shares of the pane that stay empty above and on the right [1].
    """
    names = [line.words for line in chart.lines] + [chart.limit_is] * (chart.limit is not None)
    names += [f"{line.words}, upper end" for line in chart.lines for _ in line.ends or ()]
    wide = (LEGEND_EDGE + _longest(names)) / SIDE_WIDE
    high = LEGEND_LINE * len(names) / (height - TITLE_HIGH - CHART_EDGE)
    return (high, 0.0) if high < wide else (0.0, wide)


def _world(scene: Scene, group: _Group, aspect: float = ASPECT) -> rrb.Spatial3DView:
    """The arm and what is drawn in its poses; from near without the arm, which would hide it."""
    bodies = [f"+ $origin/{group.arm}/**", f"+ $origin/{group.arm}_deflected/**"]
    near = group.poses.near is not None
    return rrb.Spatial3DView(
        origin="world",
        name=group.poses.name if near else f"{group.poses.name}. {scene.title}",
        contents=[f"+ $origin/{group.name}/**", *([] if near else bodies)],
        eye_controls=orbit(*_eye(group, aspect)),
        overrides={
            f"world/{group.name}/{snake(layer.name)}": rrb.EntityBehavior(visible=False)
            for layer in group.poses.layers
            if not layer.shown
        },
    )


def _columns(
    left: Sequence[rrb.Container | rrb.View],
    right: Sequence[rrb.Container | rrb.View],
    name: str,
    words: rrb.View | None = None,
) -> rrb.Container:
    """Views one above the other, in two columns; what is shown is said below the left one."""
    shares = [4, *[2] * (len(left) - 1)]
    main = rrb.Vertical(*left, *([words] if words else []), row_shares=[*shares, *([1] if words else [])])
    if not right:
        return rrb.Horizontal(main, name=name)
    return rrb.Horizontal(main, rrb.Vertical(*right), column_shares=[3, 2], name=name)


def _from_zero(chart: RunChart, above: float) -> rrb.archetypes.ScalarAxis:
    """All numbers and ends of intervals, from 0: a difference looks as large as it is; above stays empty."""
    parts = [own for line in chart.lines for own in (line.values, *(line.ends or ()))]
    every = np.concatenate([*parts, np.ravel(chart.limit if chart.limit is not None else [])])
    every = every[np.isfinite(every)]
    low, high = min(every.min(initial=0.0), 0.0), every.max(initial=0.0)
    return rrb.archetypes.ScalarAxis(
        range=(float(low), float(low + 1.05 * (high - low) / (1 - above) or 1.0))
    )


def _beyond(count: int, aside: float) -> rrb.archetypes.TimeAxis:
    """All places of the timelines, from 0 and from 1, with room at both ends; a share aside stays empty."""
    room = 1 + count // 50
    ends = (-room, math.ceil((count + room) / (1 - aside)))
    low, high = (rr.TimeRangeBoundary.absolute(seq=at) for at in ends)
    return rrb.archetypes.TimeAxis(view_range=rr.TimeRange(low, high))


def _eye(group: _Group, aspect: float) -> tuple[Array, Array]:
    """Eye and target: all that is near, or the arm in the pose shown first and all that moves there."""
    poses, k = group.poses, group.poses.first
    points = poses.near
    if points is None:
        moved = [layer.at[min(k, len(layer.at) - 1)] for layer in poses.layers if layer.kind != "specks"]
        moved += [squares(layer).reshape(-1, 3) for layer in poses.layers if layer.kind == "faces"]
        hung = [
            (layer.to, layer.radius)
            for layer in poses.layers
            if layer.kind == "weights" and layer.to is not None
        ]
        moved += [to[min(k, len(to) - 1)] - np.array([0, 0, 2 * radius]) for to, radius in hung]
        bent = [] if poses.bent is None else [poses.bent.positions[k, 1:]]
        points = np.vstack([poses.rigid.positions[k, 1:], *bent, *moved])
        points = points[np.isfinite(points).all(axis=1)]
    tool = poses.rigid.positions[k, -1, :2]
    if poses.near is not None:  # from the broad side
        along = np.linalg.svd(points[:, :2] - points[:, :2].mean(axis=0))[2][0]
        across = np.array([-along[1], along[0]])
        across = across if across @ tool > 0 else -across
        turn = np.arctan2(SIDE[1], SIDE[0])
        tool = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ across
    above, margin = (SIDE[2], VIEW_MARGIN) if poses.near is None else (STEEP, NEAR_MARGIN)
    return frame(points, np.full(len(points), margin * group.size), tool, aspect, above)
