"""The recording of any run, made of what its page draws: arms in poses, charts, maps, figures, words.

A tab answers one question: what happens in the poses, where it errs, what all numbers are. All is on one
timeline: a typical pose, then all poses, the worst first, or along their path.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

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
from testbench.report.figure import Figure, forest_pane, log_ticks, short
from testbench.report.markdown import Markdown, ReportWords, as_markdown, grid
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
    ErrorScale,
    Layer,
    ModelLine,
    PageContent,
    PoseGroup,
    RunChart,
    Scene,
    charts_of,
    sorting_numbers,
)
from testbench.report.schema import Table, show
from testbench.runs.spread import middle
from testbench.workflows.model_names import in_words

# --- Panes of a figure as views of a recording: lines, dots, names and axes that stay sharp at any size -----

WIDE, HIGH = 160.0, 100.0  #: Of the part inside of the axes, in units of the view; higher for many names.
LETTER, LINE, APART = 3.9, 8.0, 10.5
"""Room for a letter, for a line of text, and from one name to the next below it, in the same units."""
DOT, STROKE = 0.4, 0.25  #: Radius of a dot and of a line over its size or width [1/pt].
GREYS = (0.25, 0.75)  #: Brightness beyond which a grey is not seen on a dark or on a light ground [1].
LETTERS = 42  #: Most letters of a name beside an axis.
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
    high = _high(axes)
    corners = [(0.0, 0.0), (0.0, high), (WIDE, high)]
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
    high = _high(axes)
    if words:
        along = _placed(axes, axes.transData, np.column_stack([at, np.full(len(at), axes.get_ylim()[0])]))
        pen.names(f"{path}/x_numbers", np.column_stack([along[:, 0], np.full(len(at), high)]), words, GREY)
    at, words = _ticks(axes.yaxis)
    words = [short(own, LETTERS) for own in (names or words)]
    left = 4 + LETTER * max(map(len, words), default=0)
    if words:
        along = _placed(axes, axes.transData, np.column_stack([np.full(len(at), axes.get_xlim()[0]), at]))
        places = np.column_stack([np.full(len(at), -left / 2), along[:, 1] - LINE / 2])
        pen.names(f"{path}/y_numbers", places, words, GREY)
    pen.names(f"{path}/x_name", np.array([[WIDE / 2, high + LINE]]), [axes.get_xlabel()], GREY)
    above = _key(pen, path, axes)
    if axes.get_ylabel():
        above += LINE
        pen.names(f"{path}/y_name", np.array([[WIDE / 4, -above - 2]]), [axes.get_ylabel()], GREY)
    right = 10 + LETTER * max((len(text.get_text()) for text in axes.texts), default=0)
    bounds = rrb.VisualBounds2D(x_range=(-left - 4, WIDE + right), y_range=(-above - 6, high + 2 * LINE + 6))
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


def _high(axes: Axes) -> float:
    """Height of the part inside of the axes: each name beside the upright one has room for its line."""
    return max(HIGH, APART * len(axes.yaxis.get_majorticklocs()))


def _placed(axes: Axes, transform: Transform, points: Array) -> Array:
    """Points in units of the view, y downwards, (n, 2)."""
    shares = (transform + axes.transAxes.inverted()).transform(np.asarray(points, dtype=float))
    return np.column_stack([WIDE * shares[:, 0], _high(axes) * (1 - shares[:, 1])])


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
COLUMN, LEAST_ROWS = 24, 8  #: Rows of names that a column has room for, and those of the smallest pane.
LEGEND_EDGE, LEGEND_LETTER, LEGEND_LINE = 0.08, 0.0135, 0.09
"""Shares of a pane that a legend takes: across besides letters, a letter, a line of it [1]."""
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
    documents = {"summary": summary(words, page.tables), "tables": _tables(words, page)}
    places = len(groups[0].poses.names) if groups else 1
    with recording(path, header, [*documents.values(), *titles]) as pen:
        pen.documents(documents)
        if page.scene:
            _write_scene(pen, page.scene, groups)
        names, arm, body, size = _around_map(page, groups)
        if page.map:
            write_map(pen, page.map, names, size)
        models = _models(pen, page.tables)
        panes = _panes(pen, figures, COLUMN if page.scene else 2 * COLUMN)
        tabs: list[rrb.Container | rrb.View] = []
        tabs += _scene_tabs(page, groups, models) if page.scene else [_answer(panes or models)]
        if page.map:
            here = [f"here/{groups[page.map.group].name}"] if groups else []
            tabs.append(map_tab(page.map, arm, body, size, here))
        tables = text_view("tables", "Tables")
        tabs.append(_columns([tables], panes, "Tables") if page.scene and panes else tables)
        pen.layout(*tabs, timeline=TYPICAL if groups else None, places=places)


def _scene_tabs(page: PageContent, groups: Sequence[_Group], models: list[rrb.View]) -> list[rrb.Container]:
    """A tab a group, the answer beside the first one; insets are in that, the map's group is in its tab."""
    assert page.scene
    near = [group.name for group in page.scene.insets]
    insets = [group for group in groups if group.poses.name in near]
    first, *others = (group for group in groups if group not in insets)
    on_map = groups[page.map.group] if page.map else None
    front = _columns(
        [
            _world(page.scene, first, aspect=STACKED if insets else ASPECT),
            *[rrb.Horizontal(*(_world(page.scene, group, aspect=STACKED) for group in insets))]
            * bool(insets),
        ],
        [text_view("summary", "Summary"), *models, *_charts(first)],
        first.poses.name,
        text_view(f"here/{first.name}", "What is shown"),
    )
    more = [
        _columns(
            [_world(page.scene, group)],
            _charts(group),
            group.poses.name,
            text_view(f"here/{group.name}", "What is shown"),
        )
        for group in others
        if group is not on_map
    ]
    return [front, *more]


def _answer(panes: list[rrb.View]) -> rrb.Container:
    """Figures beside the answer."""
    summary = text_view("summary", "Summary")
    across = 1 if len(panes) < 3 else 2
    grid = rrb.Grid(*panes, grid_columns=across) if panes else rrb.Vertical(text_view("tables", "Tables"))
    return rrb.Horizontal(grid, summary, column_shares=[5, 2], name="Answer")


def _models(pen: Pen, tables: Sequence[Table]) -> list[rrb.View]:
    """The models of the first table that has some, sorted by what it is about; which are not conservative."""
    if not (found := headline(tables)):
        return []
    table, column = found
    axes, name = Figure().subplots(), table.columns[0]
    forest_pane(axes, table, column)
    low, high = axes.dataLim.intervalx.tolist()
    sizes = [middle(column.value(row)) for row in table.rows]
    if high > FAR * low > 0:
        log_ticks(axes, "x", low, high)
    else:
        colours = [table.looks[name.cell(row)].hex for row in table.rows]
        axes.barh(range(len(sizes)), sizes, BAR, color=colours)
        axes.set_xlim(min(0.0, low), 1.03 * high)
    axes.set_yticks(range(len(sizes)), [name.cell(row) for row in table.rows])
    known = [own for own in table.columns if own.key == "conservative"]
    for y, (size, row) in enumerate(zip(sizes, table.rows, strict=True)):
        free = any(own.value(row) is False for own in known)
        words = f"{column.text(size)}, not conservative" if free else column.text(size)
        axes.text(1.01, y, words, transform=axes.get_yaxis_transform())
    axes.set_title(table.title or "Models")
    return [write_pane(pen, "models", axes)]


def _panes(pen: Pen, figures: Mapping[str, Figure], room: int) -> list[rrb.View]:
    """The first panes of figures, as many as have room for all their rows, at least one.

    Panes side by side share the names of their rows; each view has them.
    """
    panes: list[rrb.View] = []
    for name, figure in figures.items():
        every = panes_of(figure.axes)
        heads = [text.rpartition(" ")[0] for text in rows_of(every[0])] if every else []
        for k, axes in enumerate(every):
            rows = rows_of(axes)
            room -= max(len(rows), LEAST_ROWS)
            if room < 0 and panes:
                return panes
            bare = k > 0 and len(rows) == len(heads) and not any(" " in own for own in rows)
            names = [f"{head} {own}" for head, own in zip(heads, rows, strict=True)] if bare else []
            panes.append(write_pane(pen, f"figures/{snake(name)}_{k}", axes, names))
    return panes


def summary(words: ReportWords, tables: Sequence[Table] = ()) -> str:
    """What a recording says first, and what the names of models beside it mean."""
    badge = words.block("badge")
    head = [f"## **{badge}**" if badge else "", f"### {words.block('question')}"]
    head += [f"#### **{words.block('answer')}**" if words.block("answer") else ""]
    return "\n\n".join(filter(None, [*head, *map(words.block, ("worst", "statements")), _names(tables)]))


def _names(tables: Sequence[Table]) -> Markdown:
    """The models that are drawn first, each with its words; empty where names say what they are."""
    table, _ = headline(tables) or (Table((), ()), None)
    names = [table.columns[0].cell(row) for row in table.rows]
    words = {name: in_words(name) for name in names if in_words(name) != name}
    told = [f"**{as_markdown(name)}**: {as_markdown(own)}" for name, own in words.items()]
    return Markdown("; ".join(told) and f"{'; '.join(told)}.")


def _tables(words: ReportWords, page: PageContent) -> str:
    """What stands below the first sentences, and tables of the page that are not among it."""
    rest = words.block("body")
    others = [(table.title, grid(table)) for table in page.tables if table.rows]
    parts = [f"### {as_markdown(title)}\n\n{text}" for title, text in others if text not in rest]
    return "\n\n".join([rest, *parts])


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
        rows = pen.on(rr.TimeColumn(TYPICAL, sequence=np.arange(len(group.poses.names))))
        if group.arm not in drawn:
            drawn.add(group.arm)
            bent = next((g.poses.bent for g in groups if g.arm == group.arm and g.poses.bent), None)
            write_arm(rows, scene.cell, group.arm, group.poses.rigid, bent)
        pairs = zip(group.poses.names, group.poses.words, strict=True)
        key = "; ".join(
            filter(None, [_colours(group.poses.layers), _tubes(scene.tube_scale, group.poses.layers)])
        )
        texts = [f"**{as_markdown(name)}.** {as_markdown(text)}\n\n{key}" for name, text in pairs]
        rows.texts(f"here/{group.name}", texts)
        for layer in group.poses.layers:
            write_layer(rows, f"world/{group.name}/{snake(layer.name)}", layer, group.size, scene.tube_scale)
        for chart in group.charts:
            for line in chart.lines:
                _write_line(rows, group.path(chart, line.name), line, lead=line is chart.lines[-1])
            if chart.limit is not None and np.isfinite(chart.limit):
                level = np.full(len(group.poses.names), chart.limit)
                rows.line(group.path(chart, chart.limit_is), chart.limit_is, None, level)


def _tubes(scale: ErrorScale | None, layers: Sequence[Layer]) -> str:
    """What the colours of tubes mean, in words."""
    if scale is None or all(layer.kind != "tubes" for layer in layers):
        return ""
    low, high = scale.ends
    return f"tubes from dark blue, {show(low)} mm, to light green, {show(high)} mm"


def _colours(layers: Sequence[Layer]) -> str:
    """What each colour is, in words."""
    named = [(_hue(layer.colour), layer) for layer in layers if layer.shown]
    return "; ".join(f"{hue} {layer.kind}: {as_markdown(layer.name)}" for hue, layer in named)


def _hue(colour: Colour) -> str:
    """The nearest colour that has a name."""
    apart = {name: sum((a - b) ** 2 for a, b in zip(own, colour, strict=False)) for name, own in HUES.items()}
    return min(apart, key=apart.__getitem__)


def _write_line(rows: Pen, path: str, line: ModelLine, *, lead: bool) -> None:
    """A number a pose with its interval; what is not known leaves a gap."""
    rows.line(path, line.name, line.look, line.values, lead=lead)
    for name, values in zip(("lower", "upper"), line.ends or (), strict=False):
        if np.isfinite(values).any():
            rows.line(f"{path}_{name}", f"{line.name}, {name} end", None, values)


def _charts(group: _Group) -> list[rrb.View]:
    """Numbers of each pose, a chart a view."""
    order = "the worst first" if group.sorted else "in order"
    rooms = [_legend_room(chart) for chart in group.charts]
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


def _legend_room(chart: RunChart) -> tuple[float, float]:
    """Room for the legend of a chart, so that it covers no number, where it takes less of the pane.

    Args:
        chart: The chart.

    Returns:
        Shares of the pane that stay empty above and on the right [1].
    """
    names = [line.name for line in chart.lines] + [chart.limit_is] * (chart.limit is not None)
    names += [f"{line.name}, upper end" for line in chart.lines for _ in line.ends or ()]
    wide = LEGEND_EDGE + LEGEND_LETTER * max(map(len, names))
    high = LEGEND_LINE * len(names)
    return (high, 0.0) if high < wide else (0.0, wide)


def _world(scene: Scene, group: _Group, aspect: float = ASPECT) -> rrb.Spatial3DView:
    """The arm and what is drawn in its poses; from near without the arm, which would hide it."""
    bodies = [f"+ $origin/{group.arm}/**", f"+ $origin/{group.arm}_deflected/**"]
    near = group.poses.near is not None
    return rrb.Spatial3DView(
        origin="world",
        name=f"{group.poses.name} (m)" if near else f"{group.poses.name} (m): {scene.title}",
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
    right: Sequence[rrb.View],
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
