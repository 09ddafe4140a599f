"""Maps of errors over the workspace: slices from the side and from above, with the arm."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypedDict

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from scipy.spatial import KDTree

from testbench.errors import Array, Ids, Mask
from testbench.report.figure import MIN_LETTER_SIZE, SIZES, SOFT, Figure, log_ticks, page, quiet, say
from testbench.report.markdown import place
from testbench.report.run_figure import SIDES
from testbench.report.scene import ModelLine, PageContent, PlaceMap, scale_of
from testbench.report.schema import plain

DOT = 9.0  #: Size of the dot of a place [pt^2].
GRID, NEIGHBOURS, FAR = 90, 6, 2.0
"""Points of a slice along each side, places that tell each of them, and how far these may be, over the
distance of neighbours [1]."""
ROOM = 0.03  #: Room around what is drawn, over its size [1].
PERCENTILES = 0.02, 0.98  #: Of all errors, where colours end.
HEIGHT, PANES, PANE, MAPS = 1.4, 5.8, 2.1, 4
"""Of title and caption, the width that all maps share, that of one at most [in], and how many at most."""
NARROW = 0.4
"""A drawn side over the longest one at least [1]: arms that move in a plane or not at all have panes too."""
KEYED = 0.65  #: Height of what says which colour errs less, and of a second line of titles [in].


def error_map(place_map: PlaceMap, title: str, arm: Array | None = None) -> Figure:
    """Draw slices through the errors of each model, from the side and from above, on one colour scale.

    Between the places the error is interpolated; dots are the places next to the slice, a circle is the
    worst place of all. The scale ends at percentiles: what is beyond has the colour of its end.

    Args:
        place_map: Places, and the errors of models there.
        title: What is mapped.
        arm: Origins of the arm's bodies in a pose, from base to tool, (bodies, 3) [m]; None for no arm.

    Returns:
        The figure: a column for each model, and one for the difference of two.
    """
    there, both = np.asarray(np.isfinite(place_map.at).all(axis=1)), place_map.difference
    at, lines = place_map.at[there], place_map.lines[-(MAPS - bool(both)) :]
    values = {line.name: line.values[there] for line in lines}
    ends = _ends(at)
    count = len(lines) + bool(both)
    sides, wide = ends[1] - ends[0], min(PANE, PANES / count)
    rows = [wide * float(sides[plane[1]] / sides[0]) for plane in SIDES.values()]
    figure = page(HEIGHT + KEYED * bool(both) + sum(rows))
    panes = figure.subplots(2, count, sharex="col", sharey="row", height_ratios=rows, squeeze=False)
    norm, extend = _norm(*values.values())
    middle_of = np.median(at, axis=0)
    for plane, row in zip(SIDES.values(), panes, strict=True):
        across = 3 - sum(plane)
        level = 0.0 if across == 1 and ends[0, 1] < 0 < ends[1, 1] else float(middle_of[across])
        cut = slice_of(at, across, level, ends)
        for axes, mm in zip(row, values.values(), strict=False):
            _slice(axes, cut, mm, norm)
        if both:
            _difference(row[-1], cut, both, there)
        for axes in row:
            _finish(axes, cut, arm, ends)
        row[0].set_ylabel(f"at {'xyz'[across]} = {level:.1f} m\n{'xyz'[plane[1]]} [m]")
    for axes, (name, mm) in zip(panes[0], values.items(), strict=False):
        known = mm[np.isfinite(mm)]
        size = f"median {np.median(known):.3f} mm" if known.size else place_map.without
        axes.set_title(f"{name}:\n{size}" if count == MAPS else f"{name}: {size}")
    if both:
        _key_of_difference([*panes[:, -1]], *both, there)
    for axes in panes[-1]:
        axes.set_xlabel("x [m]")
    what, *_ = re.split(" (?:of|over|in) ", place_map.title)
    unit = "mm, logarithmic" if isinstance(norm, LogNorm) else "mm"
    bar = figure.colorbar(
        ScalarMappable(norm, SIZES),
        ax=panes,
        label=f"{what.lower()} [{unit}]",
        fraction=0.03,
        pad=0.02,
        extend=extend,
    )
    if isinstance(norm, LogNorm):
        log_ticks(bar.ax, "y", norm.vmin, norm.vmax)  # type: ignore[arg-type]
        bar.ax.set_ylim(norm.vmin, norm.vmax)
    worst = {name: int(np.nanargmax(mm)) for name, mm in values.items() if np.isfinite(mm).any()}
    largest = ", ".join(f"{name} {values[name][k]:.3f} mm" for name, k in worst.items())
    where = "; ".join(f"{name} at {place(at[k])}" for name, k in worst.items())
    rings = f" Grey rings: {place_map.without}." if place_map.without else ""
    reading = (
        f"{place_map.title}; interpolated between places, dots: those near the slice. Worst: {where}.{rings}"
    )
    say(figure, f"{title}, {what.lower()}: at most {largest}", reading)
    return figure


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
        bbox={"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 1.0},
    )


def _finish(axes: Axes, cut: Slice, arm: Array | None, ends: Array) -> None:
    """Draw the arm's silhouette, and give a pane its frame."""
    if arm is not None:
        axes.plot(*arm[:, cut.plane].T, "-", color="white", linewidth=4.5, solid_capstyle="round", alpha=0.9)
        axes.plot(*arm[:, cut.plane].T, "-", color="0.35", linewidth=2.5, solid_capstyle="round")
    drawn = ends[:, cut.plane] if arm is None else np.vstack([ends[:, cut.plane], arm[:, cut.plane]])
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    room = ROOM * float((high - low).max())
    axes.set(xlim=(low[0] - room, high[0] + room), ylim=(low[1] - room, high[1] + room))
    axes.set_aspect("equal")
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
    colours = ListedColormap([own.look.hex for own in both])
    axes.imshow(
        np.where(np.isfinite(less), less > 0, np.nan), cmap=colours, vmin=0, vmax=1, alpha=0.75, **cut.frame
    )


def _key_of_difference(column: Sequence[Axes], ours: ModelLine, theirs: ModelLine, there: Mask) -> None:
    """Say what the colours of a difference mean, and in how many places the winner errs less."""
    mm = (ours.values - theirs.values)[there]
    known = mm[np.isfinite(mm)]
    column[0].set_title(f"{ours.name} minus {theirs.name}:\nless in {(known <= 0).sum()} of {len(known)}")
    for model_line in (ours, theirs):
        column[-1].plot([], [], "s", color=model_line.look.hex, label=f"{model_line.name} errs less")
    column[-1].legend(frameon=False, fontsize=MIN_LETTER_SIZE, loc="upper center", bbox_to_anchor=(0.5, -0.2))


def _ends(at: Array) -> Array:
    """Least and greatest of what is drawn (2, 3) [m], of places (places, 3) [m]."""
    least, most = at.min(axis=0), at.max(axis=0)
    spans = most - least
    more = np.maximum(spans, NARROW * spans.max() or 1.0) - spans
    return np.array([least - more / 2, most + more / 2])


def silhouette(seen: PageContent, place_map: PlaceMap) -> Array | None:
    """Choose the pose in which the arm is drawn into a map: one that reaches forward, at a typical distance.

    Args:
        seen: What of the run is drawn.
        place_map: The map.

    Returns:
        Origins of the bodies from base to tool, (bodies, 3) [m]; None where no arm is drawn.
    """
    if seen.scene is None:
        return None
    bodies = np.asarray(seen.scene.groups[place_map.group].rigid.positions)[:, 1:]
    x, y, _ = bodies[:, -1].T
    far = np.abs(np.hypot(x, y) - np.median(np.hypot(x, y)))
    return np.asarray(bodies[int(np.argmin(far + np.abs(y) - np.minimum(x, 0)))])
