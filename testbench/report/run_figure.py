"""Pictures of any run, made of what its page draws: models, the first poses, charts; and its maps."""

import math
import re
import textwrap
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm, Normalize
from matplotlib.ticker import MaxNLocator

from testbench.errors import Array
from testbench.report.colours import hexadecimal
from testbench.report.figure import (
    LOG_AXIS_RATIO,
    MIN_LETTER_SIZE,
    SIZES,
    SOFT,
    Figure,
    forest_pane,
    log_ticks,
    page,
    quiet,
    say,
    short,
)
from testbench.report.markdown import ReportWords, as_plain, place
from testbench.report.scene import Layer, ModelLine, PageContent, PlaceMap, PoseGroup, RunChart, scale_of
from testbench.report.schema import Table, TableColumn, looks, plain
from testbench.runs.spread import Spread, dotted, middle, range_of

SIDES = {"from the side": (0, 2), "from above": (0, 1)}
"""World axes to the right and up."""
HEAD, SCENE, KEY, CHART = 1.4, 3.6, 0.35, 2.3
"""Heights of title and caption, of the poses, of a line of their key, of a chart [in]."""
KEYS, NAME = 3, 40  #: Names on a line of the key, letters of a line of one.
SENTENCE = re.compile(r"(?<=[.!?]) (?=[A-Z])")  #: Where one ends.
BARS, NAMED = 40, 24  #: Poses up to which a chart has dots, and labels that an axis has room for.
DOT, LEAST = 26.0, 0.3
"""Size of the dot of the greatest error [pt^2], and that of the least over it [1]: colour is never alone."""
HEIGHT, PANES, PANE, MAPS = 2.0, 8.0, 2.9, 4
"""Of title and caption, the width that all maps share, that of one at most [in], and how many at most."""
NARROW = 0.4
"""A drawn side over the longest one at least [1]: arms that move in a plane or not at all have panes too."""
KEYED = 0.9  #: Height of what says which colour errs less, and of a second line of titles [in].
WIDE = 0.08  #: Room around what is drawn of the poses, over its size [1].
FOREST, ROW, ROWS = 0.9, 0.27, 15
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
    figure.set_layout_engine("constrained", rect=(0.02, 0, 0.98, 1))  # panes of equal scale stick out
    grid = figure.add_gridspec(len(rows) or 1, 2, height_ratios=rows or [1])
    answer, *more = SENTENCE.split(as_plain(words.block("answer")))
    if seen.scene:
        pose_group = seen.scene.groups[0]
        for k, (pose, name, plane) in enumerate(_panes(pose_group)):
            axes = figure.add_subplot(grid[len(forest), k])
            _poses(axes, pose_group, pose, plane)
            axes.set_title(f"{pose_group.names[pose]}, {name}", fontsize="medium")
        _key(figure.add_subplot(grid[len(forest) + 1, :]), layers, bent=bent)
        more.append(f"{pose_group.name}: {seen.scene.title}")
    if models:
        _forest(figure.add_subplot(grid[0, :]), *models)
    for k, chart in enumerate(charts, len(rows) - len(charts)):
        _chart(figure.add_subplot(grid[k, :]), chart)
    badge = as_plain(words.block("badge"))
    say(figure, "\n".join(filter(None, [badge, answer])), " ".join(more))
    return figure


def _panes(pose_group: PoseGroup) -> list[tuple[int, str, tuple[int, int]]]:
    """Pose, words and plane of both panes: a typical pose beside the worst, or one from both sides."""
    if pose_group.worst is None or pose_group.near is not None:
        return [(pose_group.first, name, plane) for name, plane in SIDES.items()]
    name, plane = next(iter(SIDES.items()))
    return [(pose_group.first, f"typical, {name}", plane), (pose_group.worst, f"worst, {name}", plane)]


def _poses(axes: Axes, pose_group: PoseGroup, k: int, plane: tuple[int, int]) -> None:
    """The arm in a pose, straight and bent, and what is drawn in it."""
    shown = list(plane)
    if pose_group.near is None:
        for frames, colour, style in ((pose_group.rigid, SOFT, "-"), (pose_group.bent, "0.3", "--")):
            if frames is not None:
                axes.plot(*frames.positions[k, 1:, shown], style, color=colour, linewidth=2.5, alpha=0.6)
    for layer in pose_group.layers:
        if layer.shown:
            _layer(axes, layer, k, shown)
    axes.set(xlabel=f"{'xyz'[plane[0]]} [m]", ylabel=f"{'xyz'[plane[1]]} [m]")
    low, high = np.array(axes.dataLim.min), np.array(axes.dataLim.max)
    half = (0.5 + WIDE) * (float((high - low).max()) or 1.0)  # square: room for numbers
    x, y = ((low + high) / 2).tolist()
    axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half))
    axes.set_aspect("equal")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(4))
    quiet(axes)


def _layer(axes: Axes, layer: Layer, k: int, shown: list[int]) -> None:
    """Dots, or lines and arrows from their beginning to their end, of a pose; what stands still always."""
    colour, at = hexadecimal(layer.colour), layer.at[k if len(layer.at) > 1 else 0]
    if layer.to is None:
        size = 3 if layer.kind == "specks" else 6
        axes.plot(*at[:, shown].T, "o", color=colour, markersize=size)
        return
    to = layer.to[k if len(layer.to) > 1 else 0]
    ends = np.stack([at, to], axis=1)[:, :, shown]  # one artist for all: each has a cost of its own
    known = np.isfinite(ends).all(axis=(1, 2))
    axes.add_collection(LineCollection(ends[known], colors=colour, linewidths=1.4, capstyle="projecting"))
    if layer.kind == "arrows":
        axes.plot(*to[:, shown].T, "o", color=colour, markersize=3)


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


def _forest(axes: Axes, table: Table, column: TableColumn) -> None:
    """A dot a trial and the median of every model; the winner has a band."""
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
    axes.set_title(title, fontsize="medium", loc="left")


def _key(axes: Axes, layers: Sequence[Layer], *, bent: bool) -> None:
    """What each colour is, and the dashed arm; layers that are drawn alike share their sign."""
    axes.axis("off")
    signs: dict[tuple[str, str], list[str]] = {}
    for layer in layers:
        mark = ("." if layer.kind == "specks" else "o") if layer.to is None else "-"
        signs.setdefault((hexadecimal(layer.colour), mark), []).append(layer.name)
    for (colour, mark), names in signs.items():
        axes.plot([], [], mark, color=colour, linewidth=2, label=textwrap.fill("; ".join(names), NAME))
    if bent:
        axes.plot([], [], "--", color="0.3", linewidth=2.5, alpha=0.6, label="arm, bent")
    axes.legend(frameon=False, fontsize=MIN_LETTER_SIZE, loc="center", ncols=KEYS)


def _chart(axes: Axes, chart: RunChart) -> None:
    """A number a pose and line, with intervals; dashed, what noise alone stays below."""
    at, few = np.arange(len(chart.labels)), len(chart.labels) <= BARS
    for line in chart.lines:
        style, size = "-" if chart.joined else "", 4 if few or not chart.joined else 0
        width = 2.2 if line is chart.lines[-1] else 1.2  # the winner is last
        axes.plot(at, line.values, linestyle=style, linewidth=width, label=line.name, **line.look.dots(size))
        if line.ends:
            axes.fill_between(at, *line.ends, color=line.look.hex, alpha=0.15, linewidth=0)
    if chart.limit is not None and np.isfinite(chart.limit):
        axes.axhline(chart.limit, color=SOFT, linewidth=1, linestyle="--", label=chart.limit_is)
    some = at[:: -(-len(at) // NAMED)]
    axes.set_xticks(some, [short(chart.labels[k], 8) for k in some], rotation=0 if len(some) < 15 else 45)
    axes.set_xlabel(chart.across)
    axes.set_title(" ".join(filter(None, [chart.title, chart.note and f"({chart.note})"])), fontsize="medium")
    axes.set_ylim(min(0.0, axes.get_ylim()[0]), None)
    axes.legend(frameon=False, fontsize=MIN_LETTER_SIZE, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    quiet(axes)


def error_map(place_map: PlaceMap, title: str) -> Figure:
    """A column a map: the places from the side and from above, the worst of each named; one has a number."""
    there, both = np.isfinite(place_map.at).all(axis=1), place_map.difference
    at, lines = place_map.at[there], place_map.lines[-(MAPS - bool(both)) :]
    values = {line.name: line.values[there] for line in lines}
    ends = _ends(at)
    count = len(lines) + bool(both)
    sides, wide = ends[1] - ends[0], min(PANE, PANES / count)
    rows = [wide * float(sides[plane[1]] / sides[0]) for plane in SIDES.values()]
    figure = page(HEIGHT + KEYED * bool(both) + sum(rows))
    panes = figure.subplots(2, count, sharex="col", sharey="row", height_ratios=rows, squeeze=False)
    scale = scale_of(*values.values())
    if both:
        _difference([*panes[:, -1]], *both, place_map.at)
    for (name, mm), column in zip(values.items(), panes.T, strict=False):
        for axes, plane in zip(column, SIDES.values(), strict=True):
            _places(axes, at[:, plane], mm, scale.shares(mm))
            axes.update_datalim(ends[:, plane])
            if axes in panes[:, 0]:
                axes.set_ylabel(f"{'xyz'[plane[1]]} [m]")
        known = mm[np.isfinite(mm)]
        size = f"median {np.median(known):.3f} mm" if known.size else place_map.without
        column[0].set_title(f"{name}:\n{size}" if count == MAPS else f"{name}: {size}", fontsize="medium")
        column[-1].set_xlabel("x [m]")
    norm = (LogNorm if scale.logarithmic else Normalize)(*scale.ends, clip=True)
    what, *_ = re.split(" (?:of|over|in) ", place_map.title)
    words = f"{what.lower()} [{scale.words}]"
    bar = figure.colorbar(ScalarMappable(norm, SIZES), ax=panes, label=words, fraction=0.03, pad=0.02)
    if scale.logarithmic:
        log_ticks(bar.ax, "y", *scale.ends)
        bar.ax.set_ylim(*scale.ends)
    worst = {name: int(np.nanargmax(mm)) for name, mm in values.items() if np.isfinite(mm).any()}
    largest = ", ".join(f"{name} {values[name][k]:.3f} mm" for name, k in worst.items())
    where = "; ".join(f"{name} at {place(at[k])}" for name, k in worst.items())
    rings = f" Grey rings: {place_map.without}." if place_map.without else ""
    reading = f"{place_map.title}. Circles, the worst place: {where}.{rings}"
    say(figure, f"{title}, {what.lower()}: at most {largest}", reading)
    return figure


def _difference(column: Sequence[Axes], ours: ModelLine, theirs: ModelLine, at: Array) -> None:
    """The error of ours minus that of theirs: a dot in the colour of the one that errs less, larger for more.

    Args:
        column: Both panes.
        ours: The winner.
        theirs: Joint stiffness.
        at: Places, (n, 3) [m]; NaN where there is none.
    """
    mm = ours.values - theirs.values
    known = np.isfinite(mm) & np.isfinite(at).all(axis=1)
    order = np.flatnonzero(known)[np.argsort(np.abs(mm[known]))]  # the greatest on top
    most = float(np.abs(mm[order]).max(initial=0.0)) or 1.0
    sizes = DOT * (LEAST + (1 - LEAST) * np.abs(mm[order]) / most)
    colours = [(ours if mm[k] <= 0 else theirs).look.hex for k in order]
    for axes, plane in zip(column, SIDES.values(), strict=True):
        x, y = at[order][:, plane].T
        axes.scatter(x, y, s=sizes, c=colours, linewidths=0)
        axes.set_aspect("equal")
        quiet(axes)
    less = int((mm[order] <= 0).sum())
    column[0].set_title(
        f"{ours.name} minus {theirs.name}:\nless in {less} of {len(order)}", fontsize="medium"
    )
    for model_line in (ours, theirs):
        column[0].plot([], [], "o", color=model_line.look.hex, label=f"{model_line.name} errs less")
    column[0].legend(frameon=False, fontsize=MIN_LETTER_SIZE, loc="upper left", bbox_to_anchor=(0, -0.05))
    column[-1].set_xlabel("x [m]")


def _ends(at: Array) -> Array:
    """Least and greatest of what is drawn (2, 3) [m], of places (places, 3) [m]."""
    least, most = at.min(axis=0), at.max(axis=0)
    spans = most - least
    more = np.maximum(spans, NARROW * spans.max() or 1.0) - spans
    return np.array([least - more / 2, most + more / 2])


def _places(axes: Axes, at: Array, mm: Array, share: Array) -> None:
    """One side of one map: places in the plane (places, 2) [m], errors [mm] and their shares of the scale."""
    known = np.isfinite(mm)
    if not known.all():
        axes.plot(*at[~known].T, "o", markersize=4, markerfacecolor="none", color=SOFT)
    order = np.argsort(share)[: known.sum()]  # the greatest on top
    sizes = DOT * (LEAST + (1 - LEAST) * share[order])
    x, y = at[order].T
    axes.scatter(x, y, s=sizes, c=SIZES(share[order]), linewidths=0)
    axes.set_aspect("equal")
    quiet(axes)
    if not known.any():
        return
    worst = int(np.nanargmax(mm))
    axes.plot(*at[worst], "o", markersize=10, markerfacecolor="none", color="black")
    inward = np.sign(at.mean(axis=0) - at[worst])
    axes.annotate(
        f"{plain(f'{mm[worst]:.3g}')} mm",
        at[worst],
        xytext=12 * inward,
        textcoords="offset points",
        ha="left" if inward[0] > 0 else "right",
        va="bottom" if inward[1] > 0 else "top",
        fontsize=MIN_LETTER_SIZE,
        bbox={"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 1.5},
    )
