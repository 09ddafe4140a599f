"""Pictures of any run, made of what its page draws: models, the first poses, charts."""

import math
import re
import textwrap
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PatchCollection, PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from testbench.errors import Array
from testbench.report.colours import MEASURED, hexadecimal
from testbench.report.figure import (
    LOG_AXIS_RATIO,
    MIN_LETTER_SIZE,
    SOFT,
    Figure,
    bands,
    forest_pane,
    log_ticks,
    page,
    quiet,
    say,
    short,
)
from testbench.report.figure_arm import draw_arm, outlines
from testbench.report.markdown import ReportWords, as_plain
from testbench.report.scene import Layer, PageContent, PoseGroup, RunChart, Scene, shadow, tube_colours
from testbench.report.schema import Table, TableColumn, looks
from testbench.runs.spread import Spread, dotted, middle, range_of

SIDES = {"from the side": (0, 2), "from above": (0, 1)}
"""World axes to the right and up."""
HEAD, SCENE, KEY, CHART = 0.8, 2.6, 0.25, 1.65
"""Heights of title and caption, of the poses, of a line of their key, of a chart [in]."""
KEYS, NAME = 3, 40  #: Names on a line of the key, letters of a line of one.
POSE = 26  #: Letters of a line above an arm.
SENTENCE = re.compile(r"(?<=[.!?]) (?=[A-Z])")  #: Where one ends.
BARS, NAMED = 40, 24  #: Poses up to which a chart has dots, and labels that an axis has room for.
WIDE = 0.08  #: Room around what is drawn of the poses, over its size [1].
FOREST, ROW, ROWS = 0.65, 0.19, 15
"""Height of a table of models without its rows, of a row [in]; rows at most."""


def overview(words: ReportWords, seen: PageContent) -> Figure:
    """The first poses of the scene, the models of the first table that has some, and every chart."""
    charts = [chart for chart in seen.runs if chart.labels]
    layers = [layer for layer in seen.scene.groups[0].layers if layer.shown] if seen.scene else []
    first = seen.scene.groups[0] if seen.scene else None
    bent = first is not None and first.near is None and first.bent is not None
    key = KEY * -(-(len(layers) + bent) // KEYS)
    models = headline(seen.tables)
    forest = [FOREST + ROW * len(models[0].rows)] if models else []
    rows = [*forest, *([SCENE, key] if seen.scene else []), *[CHART] * len(charts)]
    figure = page(HEAD + sum(rows))
    # each as wide as it can be: labels of one shrink no other
    parts = iter(bands(figure, rows) if rows else [])
    answer, *more = SENTENCE.split(as_plain(words.block("answer")))
    if models:
        model_forest(next(parts).subplots(), *models)
    if seen.scene:
        pose_group, sides = seen.scene.groups[0], next(parts).subplots(1, 2)
        for axes, (pose, name, plane) in zip(sides, _panes(pose_group), strict=True):
            _poses(axes, seen.scene, pose, plane)
            title = f"{pose_group.names[pose]}, {name}"
            axes.set_title(textwrap.fill(title, POSE) if len(title) > POSE else title)
        _key(next(parts).subplots(), layers, bent=bent)
        more.append(f"{pose_group.name}: {seen.scene.title}")
    for part, chart in zip(parts, charts, strict=True):
        run_chart(part.subplots(), chart)
    badge = as_plain(words.block("badge"))
    say(figure, "\n".join(filter(None, [badge, answer])), " ".join(more))
    return figure


def _panes(pose_group: PoseGroup) -> list[tuple[int, str, tuple[int, int]]]:
    """Pose, words and plane of both panes: a typical pose beside the worst, or one from both sides."""
    if pose_group.worst is None or pose_group.near is not None:
        return [(pose_group.first, name, plane) for name, plane in SIDES.items()]
    name, plane = next(iter(SIDES.items()))
    return [(pose_group.first, f"typical, {name}", plane), (pose_group.worst, f"worst, {name}", plane)]


def _poses(axes: Axes, scene: Scene, k: int, plane: tuple[int, int]) -> None:
    """Draw the arm in a pose of the first group, straight in grey, bent in its colour, and what is in it."""
    pose_group, shown = scene.groups[0], list(plane)
    if pose_group.near is None:
        for frames, colour in ((pose_group.rigid, None), (pose_group.bent, MEASURED)):
            if frames is not None:
                draw_arm(axes, *outlines(scene.cell, frames, k, np.eye(3)[shown]), colour)
    for layer in pose_group.layers:
        if layer.shown:
            _layer(axes, layer, k, shown, scene)
    axes.set(xlabel=f"{'xyz'[plane[0]]} [m]", ylabel=f"{'xyz'[plane[1]]} [m]")
    low, high = np.array(axes.dataLim.min), np.array(axes.dataLim.max)
    half = (0.5 + WIDE) * (float((high - low).max()) or 1.0)  # square: room for numbers
    x, y = ((low + high) / 2).tolist()
    axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half))
    axes.set_aspect("equal")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(4))
    quiet(axes)


def _layer(axes: Axes, layer: Layer, k: int, shown: list[int], scene: Scene) -> None:
    """Draw a layer in a pose: dots, or lines from their beginning to their end; what stands still always."""
    colour, at = hexadecimal(layer.colour), layer.at[k if len(layer.at) > 1 else 0]
    if layer.semi_axes is not None:
        draw_ellipsoids(axes, at, layer.semi_axes, shown, colour)
        return
    if layer.to is None:
        size = 2 if layer.kind == "specks" else 4.3
        axes.plot(*at[:, shown].T, "^" if layer.kind == "trackers" else "o", color=colour, markersize=size)
        return
    to = layer.to[k if len(layer.to) > 1 else 0]
    ends = np.stack([at, to], axis=1)[:, :, shown]  # one artist for all: each has a cost of its own
    known = np.isfinite(ends).all(axis=(1, 2))
    colours = tube_colours(layer, scene.tube_scale)[known] / 255 if layer.kind == "tubes" else colour
    wide, cap = (3.5, "butt") if layer.kind == "cylinders" else (1.0, "projecting")
    axes.add_collection(LineCollection(ends[known], colors=colours, linewidths=wide, capstyle=cap))
    if layer.kind == "arrows":
        axes.plot(*to[:, shown].T, "o", color=colour, markersize=2)
    if layer.kind == "weights":
        side = 2 * layer.radius  # a cylinder as high as wide: a square, its top where the cord ends
        below = ends[known, 1] - [layer.radius, side if shown[1] == 2 else layer.radius]
        squares = [Rectangle((x, y), side, side) for x, y in below]
        axes.add_collection(PatchCollection(squares, facecolors=colour, linewidths=0))


def draw_ellipsoids(axes: Axes, at: Array, semi_axes: Array, plane: Sequence[int], colour: str) -> None:
    """Draw the shadows of ellipsoids, seen through.

    Args:
        axes: Where to.
        at: Their centres, (k, 3) [m].
        semi_axes: See `scene.Layer`.
        plane: World axes to the right and up.
        colour: As #RRGGBB.
    """
    outlines = [centre[list(plane)] + shadow(own, plane) for centre, own in zip(at, semi_axes, strict=True)]
    shadows = PolyCollection(outlines, facecolors=to_rgba(colour, 0.3), edgecolors=colour, linewidths=0.7)
    axes.add_collection(shadows, autolim=True)


def headline(tables: Sequence[Table]) -> tuple[Table, TableColumn] | None:
    """The first table of several models and the column that it is about; the winner first, then by size."""
    for table in tables:
        name, *others = table.columns
        known = table.looks or looks(table.rows, name)
        own = [row for row in table.rows if name.cell(row) in known]
        columns = [column for column in others if column.key == table.headline] or others[::-1]
        for column in columns:
            sizes = [(not table.marks(row), _size(column, row), k) for k, row in enumerate(own)]
            order = [own[k] for *_, size, k in sorted(sizes) if np.isfinite(size)]
            if len({_size(column, row) for row in order}) > 1:
                return replace(table, rows=order[:ROWS], looks=known), column
    return None


def _size(column: TableColumn, row: object) -> float:
    """The number in a row, or its median; NaN of what is none."""
    value = column.value(row)
    known = isinstance(value, Spread | float | int) and column.form != "yes"
    return middle(value) if known else math.nan


def model_forest(axes: Axes, table: Table, column: TableColumn) -> None:
    """Draw a dot for each trial and the median of every model; the winner has a band.

    Args:
        axes: Where to.
        table: Rows of models with their looks.
        column: The quantity.
    """
    forest_pane(axes, table, column)
    reached = np.array([end for row in table.rows for end in range_of(column.value(row))])
    if column.key == "ratio":
        axes.axvline(1, color=SOFT, linewidth=1, linestyle=":")
        reached = np.append(reached, 1.0)
    if reached.max() > LOG_AXIS_RATIO * reached.min() > 0:
        log_ticks(axes, "x", float(reached.min()), float(reached.max()))
    else:
        low = min(0.0, float(reached.min()))
        axes.set_xlim(low, low + 1.03 * (float(reached.max()) - low))
    title = "; ".join(filter(None, [table.title or "Models", dotted(map(column.value, table.rows))]))
    axes.set_title(title, loc="left")


def _key(axes: Axes, layers: Sequence[Layer], *, bent: bool) -> None:
    """What each colour is, and the dashed arm; layers that are drawn alike share their sign."""
    axes.axis("off")
    signs: dict[tuple[str, str], list[str]] = {}
    for layer in layers:
        mark = ("." if layer.kind == "specks" else "o") if layer.to is None else "-"
        signs.setdefault((hexadecimal(layer.colour), mark), []).append(layer.name)
    for (colour, mark), names in signs.items():
        axes.plot([], [], mark, color=colour, linewidth=1.4, label=textwrap.fill("; ".join(names), NAME))
    if bent:
        axes.plot([], [], "s", color=hexadecimal(MEASURED), alpha=0.6, label="arm, bent")
    axes.legend(frameon=False, fontsize=MIN_LETTER_SIZE, loc="center", ncols=KEYS)


def run_chart(axes: Axes, chart: RunChart) -> None:
    """Draw a number for each pose and line, with intervals; dashed: what noise alone stays below.

    Args:
        axes: Where to.
        chart: The numbers.
    """
    at, few = np.arange(len(chart.labels)), len(chart.labels) <= BARS
    for line in chart.lines:
        style, size = "-" if chart.joined else "", 3 if few or not chart.joined else 0
        width = 1.6 if line is chart.lines[-1] else 0.9  # the winner is last
        axes.plot(at, line.values, linestyle=style, linewidth=width, label=line.name, **line.look.dots(size))
        if line.ends:
            axes.fill_between(at, *line.ends, color=line.look.hex, alpha=0.15, linewidth=0)
    if chart.limit is not None and np.isfinite(chart.limit):
        axes.axhline(chart.limit, color=SOFT, linewidth=1, linestyle="--", label=chart.limit_is)
    some = at[:: -(-len(at) // NAMED)]
    axes.set_xticks(some, [short(chart.labels[k], 8) for k in some], rotation=0 if len(some) < 15 else 45)
    axes.set_xlabel(chart.across)
    axes.set_title(" ".join(filter(None, [chart.title, chart.note and f"({chart.note})"])))
    axes.set_ylim(min(0.0, axes.get_ylim()[0]), None)
    axes.legend(frameon=False, fontsize=MIN_LETTER_SIZE, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    quiet(axes)
