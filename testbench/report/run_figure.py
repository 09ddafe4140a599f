"""Pictures of any run, made of what its page draws: models, the first poses, charts."""

import math
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypedDict

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PatchCollection, PolyCollection
from matplotlib.colorbar import Colorbar
from matplotlib.colors import ListedColormap, LogNorm, Normalize, to_rgba
from matplotlib.figure import SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from testbench.errors import Array, Ids, Mask
from testbench.plant.shapes import BodyFrames, hull_points, visual_shapes
from testbench.report.colours import LOAD, MEASURED, STIFFNESS, TASK, Colour, hexadecimal
from testbench.report.figure import (
    BAND,
    CAPTION,
    KEY_LETTERS,
    LOG_AXIS_RATIO,
    MIN_LETTER_SIZE,
    SIZES,
    SOFT,
    Figure,
    bands,
    few_ticks,
    for_column,
    forest_height,
    forest_pane,
    log_ticks,
    page,
    quiet,
    row_head,
    say,
    short,
    words_height,
)
from testbench.report.markdown import ReportWords, as_plain, capital, ended, place
from testbench.report.scene import (
    Layer,
    ModelLine,
    PageContent,
    PlaceMap,
    PoseGroup,
    RunChart,
    Scene,
    ellipsoid_layer,
    label_places,
    scale_of,
    shadow,
    squares,
    tube_colours,
)
from testbench.report.schema import Table, TableColumn, looks, plain
from testbench.runs.rows import Row
from testbench.runs.spread import Spread, dotted, middle, range_of
from testbench.workflows.cell import Cell
from testbench.workflows.model_names import in_words, row_words

# --- The arm as figures show it: outlines of its solids, seen along an axis, those behind drawn first -------

DARK, LIGHT = 0.45, 0.85  #: Greys of dark and of bright parts [1].
EDGE, THIN = 0.7, 0.4  #: Brightness of an outline over that of its face [1], and its width [pt].
WAYS = np.array([np.cos(angles := np.deg2rad(np.arange(360.0))), np.sin(angles)])
"""Unit vectors in a plane, one per degree, (2, 360) [1]."""
AT_ONCE = 4_000  #: Most points of an outline that is computed in one step; 360 at most are left of them.


def outlines(cell: Cell, frames: BodyFrames, pose: int, sides: Array) -> tuple[list[Array], Array]:
    """Outlines of the solids of an arm in a pose, from back to front.

    Args:
        cell: The arm.
        frames: Its bodies, straight or bent.
        pose: Which pose.
        sides: Unit vectors to the right and up in the figure, world axes, (2, 3).

    Returns:
        Polygons, (p, 2) each [m], and the brightness of each solid, (solids,) [1].
    """
    hidden = {cell.room.body_names.index(name) for name in (cell.arm.load_point, *cell.arm.markers)}
    away = np.cross(sides[0], sides[1])
    found: list[tuple[float, Array, float]] = []
    for shape in visual_shapes(cell.room):
        if shape.body in hidden:  # drawn by their roles
            continue
        points = (
            frames.positions[pose, shape.body] + hull_points(shape) @ frames.rotations[pose, shape.body].T
        )
        hull = _hull(points @ sides.T)
        found.append((float((points @ away).max()), hull, float(shape.rgba[:3] @ [0.299, 0.587, 0.114])))
    found.sort(key=lambda own: own[0])
    return [hull for _, hull, _ in found], np.array([bright for *_, bright in found])


def _hull(flat: Array) -> Array:
    """The points of a plane, (n, 2), that are the farthest in one of `WAYS`, counterclockwise.

    A corner of the convex hull that is left out turns its edges by less than a degree, which is not seen.
    """
    if len(flat) > AT_ONCE:
        blocks = np.array_split(flat, -(-len(flat) // AT_ONCE))
        return _hull(np.concatenate([_hull(block) for block in blocks]))
    farthest = (flat @ WAYS).argmax(axis=0)
    return np.asarray(flat[farthest[farthest != np.roll(farthest, 1)]])


def draw_arm(
    axes: Axes, polygons: Sequence[Array], bright: Array, colour: Colour | None = None, opacity: float = 1.0
) -> None:
    """Draw outlines of an arm, in shades of grey or of a colour.

    Args:
        axes: Where to.
        polygons: See `outlines`.
        bright: The same, (solids,) [1].
        colour: In place of grey.
        opacity: Of faces and edges [1].
    """
    level = DARK + (LIGHT - DARK) * bright
    base = np.ones(3) if colour is None else np.array(colour[:3]) / 255
    faces = level[:, None] * base if colour is None else 1 - (1 - base) * (1.1 - 0.6 * level[:, None])
    axes.add_collection(
        PolyCollection(polygons, facecolors=faces, edgecolors=EDGE * faces, linewidths=THIN, alpha=opacity),
        autolim=True,
    )


# --- Pictures of any run, made of what its page draws: models, the first poses, charts ----------------------

SIDES = {"from the side": (0, 2), "from above": (0, 1)}
"""World axes to the right and up."""
HEAD, SCENE, KEY, CHART = 0.8, 2.5, 0.17, 1.65
"""Heights of title and caption, of the poses, of a line of their key, of a chart [in]."""
KEYS = 4  #: Names on a line of the key at most.
POSE = 60  #: Letters of a line above an arm.
SENTENCE = re.compile(r"(?<=[.!?]) (?=[A-Z])")  #: Where one ends.
BARS, NAMED, ACROSS = 40, 24, 85
"""Poses up to which a chart has dots, labels that an axis has room for, and letters of level ones."""
WIDTHS = {"cylinders": (3.5, "butt"), "tubes": (2.5, "projecting")}
"""Width of lines [pt] and their ends, where these are no fine lines."""
SEEN_THROUGH_BOX = {"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 1.0}
"""Ground of words that stand on what is drawn."""
WIDE = 0.08  #: Room around what is drawn of the poses, over its size [1].
FOREST, ROWS = 0.65, 15  #: Height of a table of models without its rows [in]; rows at most.


def overview(words: ReportWords, seen: PageContent) -> Figure:
    """The first poses of the scene, the models of the first table that has some, and every chart."""
    charts = [chart for chart in seen.runs if chart.labels]
    first = seen.scene.groups[0] if seen.scene else None
    drawn = [first, *seen.scene.insets] if seen.scene and first else []
    layers = [*{own.name: own for group in drawn for own in group.layers if own.shown}.values()]
    signs = _signs(layers, bent=first is not None and first.near is None and first.bent is not None)
    across = max(1, min(KEYS, CAPTION // (KEY_LETTERS + max((len(own.words) for own in signs), default=1))))
    key = KEY * (1 + -(-len(signs) // across))
    models = headline(seen.tables)
    forest = [FOREST + forest_height(models[0])] if models else []
    rows = [*forest, *([SCENE, key] if seen.scene else []), *[CHART] * len(charts)]
    figure = page(HEAD + sum(rows))
    # each as wide as it can be: labels of one shrink no other
    parts = iter(bands(figure, rows) if rows else [])
    answer, *more = SENTENCE.split(as_plain(words.block("answer")))
    if models:
        axes = next(parts).subplots()
        model_forest(axes, *models)
        for_column(axes)
    if seen.scene:
        pose_group = seen.scene.groups[0]
        part = next(parts)
        insets = seen.scene.insets
        views = _panes(pose_group)[: 1 if insets else 2]
        sides = part.subplots(1, len(views) + len(insets))
        for axes, (pose, name, plane) in zip(sides, views, strict=False):
            _poses(axes, seen.scene, pose_group, pose, plane)
            axes.set_title(short(f"{pose_group.names[pose]}, {name}", POSE))
        if insets:
            _insets(sides[len(views) :], seen.scene, pose_group.first)
        if (scale := seen.scene.tube_scale) is not None:
            norm = (LogNorm if scale.logarithmic else Normalize)(*scale.ends)
            bar = part.colorbar(ScalarMappable(norm, SIZES), ax=[*sides], fraction=0.03, pad=0.02)
            bar.set_label(f"error of the path [{scale.words}]")
            _plain_numbers(bar)
        _key(next(parts).subplots(), signs, across)
        more.append(seen.scene.title)
    for part, chart in zip(parts, charts, strict=True):
        axes = part.subplots()
        run_chart(axes, chart)
        for_column(axes)
    badge = as_plain(words.block("badge"))
    say(figure, "\n".join(filter(None, [badge, answer])), " ".join(more))
    return figure


def _plain_numbers(bar: Colorbar) -> None:
    """Write 0.1 and 1 beside a logarithmic color bar, not powers of ten; a few numbers beside another."""
    norm = bar.norm
    if isinstance(norm, LogNorm):
        log_ticks(bar.ax, "y", norm.vmin, norm.vmax)  # type: ignore[arg-type]
        bar.ax.set_ylim(norm.vmin, norm.vmax)
    else:
        few_ticks(bar.ax.yaxis)


def _panes(pose_group: PoseGroup) -> list[tuple[int, str, tuple[int, int]]]:
    """Pose, words and plane of both panes: a typical pose beside the worst, or one from both sides."""
    if pose_group.worst is None or pose_group.near is not None:
        return [(pose_group.first, name, plane) for name, plane in SIDES.items()]
    name, plane = next(iter(SIDES.items()))
    return [(pose_group.first, f"typical, {name}", plane), (pose_group.worst, f"worst, {name}", plane)]


def _insets(panes: Sequence[Axes], scene: Scene, k: int) -> None:
    """Draw what is seen from near, along the axis in which it is narrowest, all in the same frame.

    Labels stand in the titles.
    """
    layers = [layer for inset in scene.insets for layer in inset.layers]
    both_ends = [end for layer in layers for end in (layer.at, layer.to) if end is not None]
    points = np.concatenate([end.reshape(-1, 3) for end in both_ends])
    ends = np.array([np.nanmin(points, axis=0), np.nanmax(points, axis=0)])
    plane = [(1, 2), (0, 2), (0, 1)][int((ends[1] - ends[0]).argmin())]
    for axes, inset in zip(panes, scene.insets, strict=True):
        axes.plot(*ends[:, plane].T, linestyle="")
        _poses(axes, scene, inset, k, plane)
        # A narrow pane has no room beside the path: a label there would cover the numbers of the axes.
        labels = [
            words for layer in inset.layers if layer.kind == "dots" and layer.shown for words in layer.labels
        ]
        axes.set_title("\n".join([inset.name, *labels]))


def _poses(axes: Axes, scene: Scene, pose_group: PoseGroup, k: int, plane: tuple[int, int]) -> None:
    """Draw the arm in a pose of a group, straight in grey, bent in its colour, and what is in it."""
    shown = list(plane)
    if pose_group.near is None:
        for frames, colour in ((pose_group.rigid, None), (pose_group.bent, MEASURED)):
            if frames is not None:
                draw_arm(axes, *outlines(scene.cell, frames, k, np.eye(3)[shown]), colour)
    for layer in pose_group.layers:
        if layer.shown:
            _layer(axes, layer, k, shown, scene)
    axes.margins(WIDE)
    _label_plane(axes, plane)


def _label_plane(axes: Axes, plane: Sequence[int]) -> None:
    """Give the axes of a plane of the world their names, one scale and few ticks."""
    axes.set(xlabel=f"{'xyz'[plane[0]]} [m]", ylabel=f"{'xyz'[plane[1]]} [m]")
    axes.set_aspect("equal", adjustable="datalim")  # the pane keeps its size, and shows more where it is wide
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    quiet(axes)


def _layer(axes: Axes, layer: Layer, k: int, shown: list[int], scene: Scene) -> None:
    """Draw a layer in a pose: dots, or lines from their beginning to their end; what stands still always."""
    colour, at = hexadecimal(layer.colour), layer.at[k if len(layer.at) > 1 else 0]
    if layer.semi_axes is not None:
        draw_ellipsoids(axes, at, layer.semi_axes, shown, colour)
        return
    if layer.kind == "faces":
        _faces(axes, layer, shown, colour)
        return
    if layer.to is None:
        size = 2 if layer.kind == "specks" else 4.3
        axes.plot(*at[:, shown].T, "^" if layer.kind == "trackers" else "o", color=colour, markersize=size)
        return
    to = layer.to[k if len(layer.to) > 1 else 0]
    ends = np.stack([at, to], axis=1)[:, :, shown]  # one artist for all: each has a cost of its own
    known = np.isfinite(ends).all(axis=(1, 2))
    colours = tube_colours(layer, scene.tube_scale)[known] / 255 if layer.kind == "tubes" else colour
    wide, cap = WIDTHS.get(layer.kind, (1.0, "projecting"))
    axes.add_collection(LineCollection(ends[known], colors=colours, linewidths=wide, capstyle=cap))
    if layer.kind == "arrows":
        axes.plot(*to[:, shown].T, "o", color=colour, markersize=2)
    _write_sizes(axes, layer, k, shown)
    if layer.kind == "weights":
        side = 2 * layer.radius  # a cylinder as high as wide: a square, its top where the cord ends
        below = ends[known, 1] - [layer.radius, side if shown[1] == 2 else layer.radius]
        shapes = [Rectangle((x, y), side, side) for x, y in below]
        axes.add_collection(PatchCollection(shapes, facecolors=colour, linewidths=0))


def _faces(axes: Axes, layer: Layer, shown: list[int], colour: str) -> None:
    """Draw squares that are seen through, their normals, and their names in the middle."""
    assert layer.to is not None  # by its kind
    _fill(axes, [*squares(layer)[:, :, shown]], colour)
    ends = np.stack([layer.at[0], layer.to[0]], axis=1)[:, :, shown]
    axes.add_collection(LineCollection([*ends], colors=colour, linewidths=1.0))
    axes.plot(*ends[:, 1].T, "o", color=colour, markersize=2)
    named: dict[tuple[float, float], list[str]] = {}  # faces behind each other share a place
    for (x, y), words in zip(ends[:, 0].round(1).tolist(), layer.labels, strict=False):
        named.setdefault((x, y), []).append(words)
    for middle_of, names in named.items():
        axes.annotate(
            ", ".join(names), middle_of, xytext=(2, 2), textcoords="offset points", fontsize=MIN_LETTER_SIZE
        )


def _fill(axes: Axes, outlines: Sequence[Array], colour: str) -> None:
    """Draw areas that are seen through, with their outlines, (corners, 2) each [m]."""
    areas = PolyCollection(outlines, facecolors=to_rgba(colour, 0.3), edgecolors=colour, linewidths=0.7)
    axes.add_collection(areas, autolim=True)


def _write_sizes(axes: Axes, layer: Layer, k: int, shown: list[int]) -> None:
    """Write masses below weights seen from the side, and sizes of forces at the ends of their arrows."""
    if layer.colour != LOAD or (layer.kind == "weights" and shown[1] != 2):
        return
    places, starts = label_places(layer), layer.at
    row = k if len(places) > 1 else 0
    for end, start, words in zip(places[row][:, shown], starts[row][:, shown], layer.labels, strict=False):
        if np.isfinite(end).all():
            up = layer.kind == "arrows" and end[1] >= start[1]
            axes.annotate(
                words,
                end,
                xytext=(0, 3 if up else -2),
                textcoords="offset points",
                ha="center",
                va="bottom" if up else "top",
                fontsize=MIN_LETTER_SIZE,
                bbox=SEEN_THROUGH_BOX,
            )


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
    _fill(axes, outlines, colour)


def headline(tables: Sequence[Table]) -> tuple[Table, TableColumn] | None:
    """The first table with one row per model and the column that it is about; the winner first, then by size.

    Rows that each add something to the one before keep their order.
    """
    for table in tables:
        name, *others = table.columns
        known = table.looks or looks(table.rows, name)
        own = [row for row in table.rows if name.cell(row) in known]
        if len({name.cell(row) for row in own}) < len(own):  # the name alone does not say what a row is
            continue
        columns = [column for column in others if column.key == table.headline] or others[::-1]
        for column in columns:
            sizes = [(not table.marks(row), _size(column, row), k) for k, row in enumerate(own)]
            ranked = sizes if table.stepwise else sorted(sizes)
            order = [own[k] for *_, size, k in ranked if np.isfinite(size)]
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
    axes.set_title(textwrap.fill(title, PANE_TITLE), loc="left")


class _Sign(NamedTuple):
    """A colour with its mark, and what is drawn so."""

    colour: str
    mark: str
    words: str


def _signs(layers: Sequence[Layer], *, bent: bool) -> list[_Sign]:
    """What each colour is, and the bent arm; layers that are drawn alike share their sign."""
    signs: dict[tuple[str, str], list[str]] = {}
    for layer in (own for own in layers if own.kind != "tubes"):  # these have a bar of colours
        marks = {
            "specks": ".",
            "trackers": "^",
            "weights": "s",
            "ellipsoids": "o",
            "cylinders": "d",
            "faces": "s",
        }
        mark = marks.get(layer.kind, "o" if layer.to is None else "-")
        signs.setdefault((hexadecimal(layer.colour), mark), []).append(layer.name)
    found = [_Sign(colour, mark, "; ".join(names)) for (colour, mark), names in signs.items()]
    return [*found, *[_Sign(hexadecimal(MEASURED), "s", "arm, bent")] * bent]


def _key(axes: Axes, signs: Sequence[_Sign], across: int) -> None:
    """Write what each colour is, so many side by side."""
    axes.axis("off")
    for sign in signs:
        axes.plot([], [], sign.mark, color=sign.colour, linewidth=1.4, label=sign.words)
    axes.legend(loc="center", ncols=across, borderaxespad=0)


def run_chart(axes: Axes, chart: RunChart) -> None:
    """Draw a number for each pose and line, with intervals; dashed: what noise alone stays below.

    Args:
        axes: Where to.
        chart: The numbers.
    """
    at, few = np.arange(len(chart.labels)), len(chart.labels) <= BARS
    for line in chart.lines:
        size = 3 if few else 0
        width = 1.6 if chart.leads and line is chart.lines[-1] else 0.9
        axes.plot(at, line.values, linewidth=width, label=row_head(line.name), **line.look.dots(size))
        if line.ends:
            axes.fill_between(at, *line.ends, color=line.look.hex, alpha=BAND, linewidth=0)
    if chart.limit is not None and np.isfinite(chart.limit):
        axes.axhline(chart.limit, color=SOFT, linewidth=1, linestyle="--", label=chart.limit_is)
    some = at[:: -(-len(at) // NAMED)]
    names = [short(chart.labels[k], 8) for k in some]
    axes.set_xticks(some, names, rotation=0 if sum(map(len, names)) + 2 * len(names) < ACROSS else 45)
    axes.set_xlabel(chart.across)
    axes.set_title(", ".join(filter(None, [chart.title, chart.note])))
    axes.set_ylim(min(0.0, axes.get_ylim()[0]), None)
    few_ticks(axes.yaxis)
    if len(axes.get_legend_handles_labels()[1]) > 1:  # the title says what a line alone is
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    quiet(axes)


# --- Maps of errors over the workspace: slices from the side and from above, with the arm -------------------

DOT = 9.0  #: Size of the dot of a place [pt^2].
GRID, NEIGHBOURS, FAR = 90, 6, 2.0
"""Points of a slice along each side, places that tell each of them, and how far these may be, over the
distance of neighbours [1]."""
ROOM = 0.03  #: Room around what is drawn, over its size [1].
SEEN_THROUGH = 0.85  #: Opacity of the arm on a map [1].
PERCENTILES = 0.02, 0.98  #: Of all errors, where colours end.
PANES, BETWEEN, PANE, SINGLE_MAP, TALLEST_MAP, MAPS = 5.85, 0.14, 2.4, 2.6, 3.0, 4
"""Width that all maps share, what is left of it between two, width of one at most, of the two views of a
single one, and their height at most [in]; how many maps at most."""
MAP_LINE, MAP_AXES, MAP_GAP = 0.13, 0.42, 0.13
"""Heights of a line above a map or of its key, of the numbers below, and of what is between two rows [in]."""
NARROW = 0.4
"""A drawn side over the longest one at least [1]: arms that move in a plane or not at all have panes too."""
PANE_TITLE = 76  #: Letters of a line of the title of a pane, beside names of rows in words.
MAP_LETTERS = 26  #: Letters of a line of the title of a map.


Silhouette = Mapping[tuple[int, int], tuple[Sequence[Array], Array]]
"""Outlines of an arm and their brightness, see `outlines`, by the world axes to the right and up."""


def error_map(place_map: PlaceMap, title: str, arm: Silhouette | None = None) -> Figure:
    """Draw slices through the errors of each model, from the side and from above, on one colour scale.

    Between the places the error is interpolated; dots are the places next to the slice, a circle is the
    worst place of all. The scale ends at percentiles: what is beyond has the colour of its end.

    Args:
        place_map: Places, and the errors of models there.
        title: What is mapped.
        arm: What is drawn of the arm in a pose; None for no arm.

    Returns:
        The figure: a column for each model, and one for the difference of two.
    """
    there, both = np.asarray(np.isfinite(place_map.at).all(axis=1)), place_map.difference
    at, lines = place_map.at[there], place_map.lines[-(MAPS - bool(both)) :]
    values = {line.name: line.values[there] for line in lines}
    reached, ends = _ends(at, 0.0), _ends(np.vstack([at, *_corners(arm or {})]), ROOM)
    figure, part, panes, height = _map_panes(len(lines) + bool(both), ends[1] - ends[0])
    norm, extend = _norm(*values.values())
    middle_of = np.median(at, axis=0)
    for plane, row in zip(SIDES.values(), panes, strict=True):
        across = 3 - sum(plane)
        level = 0.0 if across == 1 and reached[0, 1] < 0 < reached[1, 1] else float(middle_of[across])
        cut = slice_of(at, across, level, reached)
        for axes, mm in zip(row, values.values(), strict=False):
            _slice(axes, cut, mm, norm)
        if both:
            _difference(row[-1], cut, both, there)
        for axes in row:
            _finish(axes, arm[plane] if arm else None, ends[:, plane])
        row[0].set_ylabel(f"at {'xyz'[across]} = {level:.1f} m\n{'xyz'[plane[1]]} [m]")
    for axes, (name, mm) in zip(panes[0], values.items(), strict=False):
        known = mm[np.isfinite(mm)]
        size = f"median {np.median(known):.3f} mm" if known.size else place_map.without
        axes.set_title(f"{textwrap.fill(row_words(name), MAP_LETTERS)}:\n{size}")
    for_column(*panes[:, len(lines) - 1])
    if both:
        _key_of_difference(part, panes[0, -1], *both, there)
    what, *_ = re.split(" (?:of|over|in) ", place_map.title)
    unit = "mm, logarithmic" if isinstance(norm, LogNorm) else "mm"
    count = panes.shape[1]
    bar = part.colorbar(
        ScalarMappable(norm, SIZES),
        ax=panes[:, -1],  # each of these measures the bar again
        label=f"{what.lower()} [{unit}]",
        fraction=0.03 * count,
        pad=0.02 * count,
        extend=extend,
    )
    _plain_numbers(bar)
    say(figure, *_map_words(place_map, title, values, at))
    lines = max(axes.get_title().count("\n") + 1 for axes in panes[0]) + 3 * bool(both)
    figure.set_figheight(words_height(figure) + MAP_LINE * lines + MAP_AXES + height)
    return figure


def _map_panes(count: int, sides: Array) -> tuple[Figure, SubFigure, npt.NDArray[np.object_], float]:
    """Make the panes of maps, a row of them for each view; those of one map stand side by side.

    Args:
        count: How many stand side by side.
        sides: Lengths of what is drawn along the world's axes, (3,) [m].

    Returns:
        The figure; the part of it that holds its panes; these, (views, count); the height of all rows [in].
    """
    figure = page(1.0)  # its height follows from its words
    [part] = bands(figure, [1.0])
    if count == 1:
        wide = min(SINGLE_MAP, TALLEST_MAP * float(sides[0] / max(sides)))
        panes = part.subplots(1, len(SIDES), squeeze=False).T
    else:
        wide = min(PANE, (PANES - BETWEEN * (count - 1)) / count)
    rows = [wide * float(sides[plane[1]] / sides[0]) for plane in SIDES.values()]
    if count > 1:
        panes = part.subplots(len(rows), count, sharex="col", sharey="row", height_ratios=rows, squeeze=False)
    for axes in panes[-1] if count > 1 else panes.flat:
        axes.set_xlabel("x [m]")
    return figure, part, panes, sum(rows) + MAP_GAP if count > 1 else max(rows)


def _map_words(place_map: PlaceMap, title: str, values: Mapping[str, Array], at: Array) -> tuple[str, str]:
    """Say how large the error of the last model is at most, and what a map is.

    Args:
        place_map: The map.
        title: What is mapped.
        values: Errors of the models that are drawn, the last one ours, (n,) each [mm].
        at: Their places, (n, 3) [m].

    Returns:
        Title and words below the figure.
    """
    what, *_ = re.split(" (?:of|over|in) ", place_map.title)
    worst = {name: int(np.nanargmax(mm)) for name, mm in values.items() if np.isfinite(mm).any()}
    largest = {name: f"{values[name][k]:.3f} mm at {place(at[k])}" for name, k in worst.items()}
    circles = "; ".join(f"{in_words(name)} {where}" for name, where in largest.items())
    rings = f" Grey rings: {place_map.without}." if place_map.without else ""
    reading = (
        f"{title}. {ended(place_map.title)} Colours are interpolated between places; dots: places near the "
        f"slice. Circles: the worst places, on the slice or off it: {circles}.{rings}"
    )
    *_, ours = values
    said = f"at most {largest[ours]}" if ours in largest else place_map.without
    return f"{capital(in_words(ours))}: {what.lower()} {said}", reading


class ImageFrame(TypedDict):
    """Hold what matplotlib is told of an image."""

    extent: tuple[float, float, float, float]
    origin: Literal["lower"]
    interpolation: str


@dataclass(frozen=True)
class Slice:
    """A plane through places, and which of them tell the error at each point of it."""

    plane: tuple[int, int]  #: World axes to the right and up.
    at: Array  #: Places in the plane, (n, 2) [m].
    near: Mask  #: Which places are next to the plane, (n,).
    x: Array  #: Grid to the right, (GRID,) [m].
    y: Array  #: Grid upwards, (GRID,) [m].
    neighbours: Ids  #: Nearest places of every point, (GRID, GRID, NEIGHBOURS).
    weights: Array  #: Their shares, NaN where no place is near, (GRID, GRID, NEIGHBOURS).

    @property
    def frame(self) -> ImageFrame:
        """Tell matplotlib where an image of the grid lies."""
        dx, dy = (float(own[1] - own[0]) / 2 for own in (self.x, self.y))
        ends = (self.x[0] - dx, self.x[-1] + dx, self.y[0] - dy, self.y[-1] + dy)
        return {"extent": tuple(map(float, ends)), "origin": "lower", "interpolation": "nearest"}  # type: ignore[typeddict-item]

    def interpolate(self, values: Array) -> Array:
        """Interpolate values at the places, (n,), to the grid, (GRID, GRID); NaN where nothing is known."""
        own = np.asarray(values)[self.neighbours]
        known = np.isfinite(own)
        total = np.where(known, self.weights, 0.0).sum(axis=-1)
        mean = np.where(known, self.weights * np.where(known, own, 0.0), 0.0).sum(axis=-1)
        return np.asarray(
            np.where(np.isfinite(self.weights[..., 0]) & (total > 0), mean / np.maximum(total, 1e-12), np.nan)
        )


def slice_of(at: Array, across: int, level: float, ends: Array) -> Slice:
    """Cut a plane through places; each point of it has the mean of its nearest places by inverse squares.

    Args:
        at: Places, (n, 3) [m].
        across: World axis that the plane stands on.
        level: Where it does [m].
        ends: Least and greatest of what is drawn, (2, 3) [m].
    """
    from scipy.spatial import KDTree  # here: it takes long to import, and few commands draw maps

    right, up = plane = (0, 1 if across == 2 else 2)
    x, y = (np.linspace(float(ends[0, axis]), float(ends[1, axis]), GRID) for axis in plane)
    points = np.full((GRID, GRID, 3), level)
    points[..., right], points[..., up] = x, y[:, None]
    tree = KDTree(at)
    spacing = float(np.median(np.asarray(tree.query(at, 2)[0])[:, 1])) if len(at) > 1 else 0.0
    found = tree.query(points, min(NEIGHBOURS, len(at)))
    distance, neighbours = (np.asarray(own).reshape(GRID, GRID, -1) for own in found)
    weights = 1 / np.maximum(distance, 1e-6) ** 2
    weights = np.where(distance[..., :1] <= FAR * spacing, weights, np.nan)
    near = np.abs(at[:, across] - level) <= spacing
    return Slice(plane, at[:, plane], near, x, y, neighbours, weights)


def _norm(*errors_mm: Array) -> tuple[Normalize, Literal["neither", "min", "max", "both"]]:
    """Scale colours between percentiles of all maps; and which ends of the bar have errors beyond them."""
    every = np.concatenate([mm[np.isfinite(mm)] for mm in errors_mm])
    low, high = np.quantile(every, PERCENTILES).tolist()
    if high <= low:
        low, high = low - 1e-9, low + 1e-9
    log = scale_of(*errors_mm).logarithmic and low > 0
    norm = (LogNorm if log else Normalize)(low, high, clip=True)
    below, above = bool(every.min() < low), bool(every.max() > high)
    return norm, "both" if below and above else "min" if below else "max" if above else "neither"


def _slice(axes: Axes, cut: Slice, mm: Array, norm: Normalize) -> None:
    """Draw one slice of one map, and the places next to it."""
    known = np.isfinite(mm)
    logarithmic = isinstance(norm, LogNorm)
    between = cut.interpolate(np.log(mm) if logarithmic else mm)
    axes.imshow(np.exp(between) if logarithmic else between, norm=norm, cmap=SIZES, **cut.frame)
    near = cut.near & known
    x, y = cut.at[near].T
    axes.scatter(x, y, s=DOT, c=mm[near], norm=norm, cmap=SIZES, edgecolors="0.2", linewidths=0.4)
    if not known.all():
        lost = cut.near & ~known
        axes.plot(*cut.at[lost].T, "o", markersize=3, markerfacecolor="none", color=SOFT)
    if not known.any():
        return
    worst = int(np.nanargmax(mm))
    axes.plot(*cut.at[worst], "o", markersize=7, markerfacecolor="none", color="black")
    inward = np.sign(cut.at.mean(axis=0) - cut.at[worst])
    axes.annotate(
        f"{plain(f'{mm[worst]:.3g}')} mm",
        cut.at[worst],
        xytext=9 * inward,
        textcoords="offset points",
        ha="left" if inward[0] > 0 else "right",
        va="bottom" if inward[1] > 0 else "top",
        fontsize=MIN_LETTER_SIZE,
        bbox=SEEN_THROUGH_BOX,
    )


def _corners(arm: Silhouette) -> Iterator[Array]:
    """Corners of an arm's outlines in the world, (n, 3) [m]; NaN along the axis that the eye looks along."""
    for plane, (polygons, _) in arm.items():
        points = np.full((sum(map(len, polygons)), 3), np.nan)
        points[:, plane] = np.concatenate(polygons)
        yield points


def _finish(axes: Axes, arm: tuple[Sequence[Array], Array] | None, ends: Array) -> None:
    """Draw the arm, and give a pane its frame: least and greatest, (2, 2) [m]."""
    if arm is not None:
        draw_arm(axes, *arm, opacity=SEEN_THROUGH)
    axes.set(xlim=tuple(ends[:, 0]), ylim=tuple(ends[:, 1]))
    axes.set_aspect("equal")
    few_ticks(axes.xaxis, axes.yaxis)
    quiet(axes)


def _difference(axes: Axes, cut: Slice, both: tuple[ModelLine, ModelLine], there: Mask) -> None:
    """Draw where the winner errs less than joint stiffness, in the colour of the one that errs less.

    Args:
        axes: The pane.
        cut: Its slice.
        both: Errors of the winner and of joint stiffness.
        there: Which places are known, (n,).
    """
    ours, theirs = both
    less = cut.interpolate((ours.values - theirs.values)[there])
    colours = ListedColormap([model_line.look.hex for model_line in both])
    axes.imshow(
        np.where(np.isfinite(less), less > 0, np.nan), cmap=colours, vmin=0, vmax=1, alpha=0.75, **cut.frame
    )


def _key_of_difference(part: SubFigure, pane: Axes, ours: ModelLine, theirs: ModelLine, there: Mask) -> None:
    """Say what the colours of a difference mean, and in how many places the winner errs less."""
    mm = (ours.values - theirs.values)[there]
    known = mm[np.isfinite(mm)]
    pane.set_title(f"Which errs less:\nthe chosen one in\n{(known <= 0).sum()} of {len(known)} places")
    signs = [Line2D([], [], linestyle="", marker="s", color=own.look.hex) for own in (ours, theirs)]
    part.legend(
        signs, [ours.words, theirs.words], title="Which errs less", loc="outside lower right", ncols=2
    )


def _ends(at: Array, room: float) -> Array:
    """Least and greatest of points (n, 3), with room around them over the longest side [1]: (2, 3) [m]."""
    least, most = np.nanmin(at, axis=0), np.nanmax(at, axis=0)
    spans = most - least
    longest = spans.max() or 1.0
    more = np.maximum(spans, NARROW * longest) + 2 * room * longest - spans
    return np.array([least - more / 2, most + more / 2])


def silhouette(seen: PageContent, place_map: PlaceMap) -> Silhouette | None:
    """Draw the arm for a map.

    Args:
        seen: What of the run is drawn.
        place_map: The map.

    Returns:
        Outlines of the arm from the side and from above, in the pose of `forward_pose`; None where no arm is
        drawn.
    """
    if seen.scene is None:
        return None
    frames = seen.scene.groups[place_map.group].rigid
    k = forward_pose(np.asarray(frames.positions)[:, 1:])
    return {plane: outlines(seen.scene.cell, frames, k, np.eye(3)[list(plane)]) for plane in SIDES.values()}


def forward_pose(bodies: Array) -> int:
    """Choose a pose that reaches forward, at a typical distance.

    Args:
        bodies: Origins of the bodies from base to tool, (poses, bodies, 3) [m].

    Returns:
        Its index.
    """
    x, y, _ = bodies[:, -1].T
    far = np.abs(np.hypot(x, y) - np.median(np.hypot(x, y)))
    return int(np.argmin(far + np.abs(y) - np.minimum(x, 0)))


# --- Figures of programs: the stiffness of the tool along the path ------------------------------------------

NARROW_ACROSS = 25  #: Letters of level names below a third of a figure.
SEMI_AXES = ("softest direction", "between", "stiffest direction")
MARKS = "ovs"


def stiffness_figure(rows: Sequence[Row], force: float) -> Figure:
    """Draw the ellipsoids over which a force moves the tool, from the side and from above, and their sizes.

    Args:
        rows: Along the path, see `workflows.program_numbers`.
        force: Size of the force [N].
    """
    at = np.array([row.at_m for row in rows])
    sides = np.ptp(at, axis=0)
    scale, layer = ellipsoid_layer(rows, force)
    assert layer.semi_axes is not None  # by its kind
    across = int(sides[1] > sides[0])
    figure = page(2.7)
    panes = figure.subplots(1, 3)
    sizes = np.array([row.semi_axes_mm for row in rows])
    soft, stiff = (int(k) for k in (sizes[:, 0].argmax(), sizes[:, 0].argmin()))
    views = {"from the side": [across, 2], "from above": [0, 1]}
    for axes, (name, plane) in zip(panes, views.items(), strict=False):
        axes.plot(*at[:, plane].T, color=hexadecimal(TASK), linewidth=1.0, linestyle=":")
        draw_ellipsoids(axes, at, layer.semi_axes, plane, hexadecimal(layer.colour))
        right = at[soft, plane[0]] <= np.median(at[:, plane[0]])  # inwards
        axes.annotate(
            _pose_name(rows[soft], 12),
            at[soft, plane],
            xytext=(7 if right else -7, 7),
            textcoords="offset points",
            fontsize=MIN_LETTER_SIZE,
            ha="left" if right else "right",
        )
        axes.set_title(f"{name.capitalize()}, × {scale:,g}")
        _label_plane(axes, plane)
    size_pane(panes[2], rows, force)
    named = [_pose_name(rows[k]) for k in (soft, stiff)]
    answer = f"Softest at {named[0]}: {force:,.0f} N move the tool by up to {sizes[soft, 0]:.3f} mm"
    if sizes[soft, 0] > sizes[stiff, 0]:
        answer += f"; stiffest at {named[1]}: {sizes[stiff, 0]:.3f} mm"
    reading = (
        f"Ellipsoids at {len(rows)} poses: how far {force:,.0f} N in any direction move the loaded tool, "
        f"magnified. Dotted: order of the poses. Named: the softest pose."
    )
    say(figure, answer, reading)
    return figure


def _pose_name(row: Row, letters: int = 20) -> str:
    """Return the name of a pose; a number alone is called a pose."""
    return f"pose {row.label}" if row.label.isdigit() else short(row.label, letters)


def size_pane(axes: Axes, rows: Sequence[Row], force: float) -> None:
    """Draw the semi-axes of the ellipsoids pose by pose.

    Args:
        axes: Where to.
        rows: See `workflows.program_numbers`.
        force: Size of the force [N].
    """
    k, sizes = np.arange(len(rows)), np.array([row.semi_axes_mm for row in rows])
    for own, name, mark in zip(sizes.T, SEMI_AXES, MARKS, strict=True):
        axes.plot(k, own, f"{mark}-", color=hexadecimal(STIFFNESS), markersize=3.4, label=name)
    names = [short(row.label, 8) for row in rows]
    axes.set_xticks(k, names, rotation=0 if sum(map(len, names)) < NARROW_ACROSS else 45)
    axes.set(xlabel="pose", ylabel=f"moved by {force:,.0f} N [mm]", ylim=(0, 1.6 * sizes.max() or 1.0))
    axes.set_title("Semi-axes")
    axes.legend(loc="upper center", ncols=1)
    quiet(axes)
