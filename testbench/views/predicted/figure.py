"""Figure of a prediction: deflections with intervals, ellipsoids at the tool, map over the workspace."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from testbench.bench.prediction import Predicted
from testbench.bench.rows import MM
from testbench.data.dataset import Ids
from testbench.model.vjm import body_poses
from testbench.views.colours import GCO, hexadecimal
from testbench.views.figure import SIZES, SMALL, SOFT, page, quiet, say
from testbench.views.magnified import round_scale

OURS, MARK = hexadecimal(GCO), "#202020"
NAMED = 30  #: Most poses whose name stands on the axis.
ELLIPSES = 12  #: Ellipsoids that are drawn at most, from the softest tool to the stiffest.
LARGEST = 0.09  #: Semi-axis of the largest over the width of the workspace [1].
CELLS = 17  #: Of the map, across.
VIEWS = (("seen from the side", 0, 2), ("seen from above", 0, 1))
"""Title, and the world axes to the right and up."""
Plane = tuple[int, int]


def overview(made: Predicted) -> Figure:
    """How far every pose goes, where the tool is soft in which direction, and where in the workspace."""
    figure = page(11.5)
    grid = figure.add_gridspec(3, 2, height_ratios=(1, 1, 1.25))
    _deflections(figure.add_subplot(grid[0, :]), made)
    worst = MM * made.map.worst
    scale = ScalarMappable(Normalize(float(worst.min()), float(worst.max())), SIZES)
    shown, axes = _shown(made), []
    for row, (title, x, y) in enumerate(VIEWS):
        left = figure.add_subplot(grid[row + 1, 0])
        right = figure.add_subplot(grid[row + 1, 1], sharex=left, sharey=left)
        _ellipses(left, made, shown, scale, (x, y))
        _map(right, made, scale, (x, y))
        left.set_title(f"Tool, {title}", fontsize="medium")
        blind = np.isinf(made.map.half).any(axis=1).mean()
        doubt = f" ({100 * blind:.0f} % not seen in some direction)" if blind else ""
        right.set_title(f"Workspace, {title}{doubt}", fontsize="medium")
        left.set_ylabel(f"{'xyz'[y]} [m]")
        axes += [left, right]
        for one in (left, right):
            one.set_aspect("equal")
            one.set_xlabel("x [m]")
            quiet(one)
    label = f"how far {made.map.force:,.0f} N move the tool at most [mm]"
    figure.colorbar(scale, ax=axes, label=label, shrink=0.7, pad=0.02)
    size = MM * made.found.size[:, 0]
    say(
        figure,
        f"{made.model.arm.name} under {made.asked.words}: the tool moves up to {size.max():.2f} mm; "
        f"{made.map.force:,.0f} N move it up to {worst.max():.2f} mm elsewhere",
        f"Left: where {_magnified(made, shown)}, would bring the tool. Right: the softest pose of each cell, "
        "the softest of all ringed.",
    )
    return figure


def _deflections(axes: Axes, made: Predicted) -> None:
    """Poses by the deflection of the tool, the largest first, with their intervals."""
    order = made.worst_first
    size, half = (MM * value[order, 0] for value in (made.found.size, made.found.widest))
    x, seen = np.arange(len(order)) + 1, np.isfinite(half)
    width = max(0.6, min(6.0, 250 / len(order)))
    low = np.maximum(size - half, 0)
    axes.vlines(x[seen], low[seen], (size + half)[seen], color=OURS, alpha=0.45, linewidth=width)
    dot = 6 if len(order) <= NAMED else 3
    axes.plot(x[seen], size[seen], "o", color=OURS, markersize=dot)
    if not seen.all():
        label = "interval not seen by the data"
        axes.plot(
            x[~seen], size[~seen], "o", color=OURS, markerfacecolor="white", markersize=dot, label=label
        )
    few = len(order) <= NAMED
    names = [made.asked.labels[k] for k in order] if few else []
    axes.set_xticks(
        x if few else [], names, fontsize=SMALL, rotation=90 if max(map(len, names), default=0) > 3 else 0
    )
    axes.set_xlabel("pose, the largest deflection first" if few else "poses, the largest deflection first")
    axes.set_ylabel("deflection of the tool [mm]")
    axes.set_ylim(0, 1.08 * float((size + np.where(seen, half, 0)).max()))
    axes.set_title(f"Tool under {made.asked.words}, 95 % intervals", fontsize="medium")
    if not seen.all():
        axes.legend(loc="upper right")
    quiet(axes)


def _shown(made: Predicted) -> Ids:
    """Poses whose ellipsoids are drawn: evenly, from the softest to the stiffest."""
    order = np.argsort(-made.stiffness.give[:, 0], kind="stable")
    return np.asarray(order[np.linspace(0, len(order) - 1, min(ELLIPSES, len(order))).round().astype(int)])


def _factor(made: Predicted, shown: Ids) -> float:
    """Magnification of the ellipsoids: 1, 2 or 5 times a power of ten [1]."""
    width = float(np.ptp(made.map.position, axis=0).max())
    return round_scale(LARGEST * width, float(made.map.force * made.stiffness.give[shown, 0].max()))


def _magnified(made: Predicted, shown: Ids) -> str:
    return f"{made.map.force:,.0f} N in every direction, x {_factor(made, shown):g}"


def _ellipses(axes: Axes, made: Predicted, shown: Ids, scale: ScalarMappable, plane: Plane) -> None:
    """The arm as a line, and where a force of every direction would bring the tool."""
    push, own = MM * made.map.force, list(plane)
    factor = _factor(made, shown) * made.map.force
    bodies = np.array([p for p, _ in body_poses(made.model.vjm, made.asked.q[shown])])
    for k in range(len(shown)):
        alpha, width = (0.7, 3.0) if k == 0 else (0.15, 1.5)
        axes.plot(*bodies[:, k, own].T, color=SOFT, alpha=alpha, linewidth=width)
    for k in shown[::-1]:
        U, s, _ = np.linalg.svd(made.stiffness.compliance[k, :3, :3][own])
        x, y = made.found.position[k, 0, own].tolist()
        wide, high = (2 * factor * s).tolist()
        drawn = Ellipse((x, y), wide, high, angle=float(np.degrees(np.arctan2(U[1, 0], U[0, 0]))), zorder=3)
        drawn.set(facecolor=scale.to_rgba(push * made.stiffness.give[k, 0]), edgecolor="0.3", alpha=0.9)
        axes.add_patch(drawn)


def _map(axes: Axes, made: Predicted, scale: ScalarMappable, plane: Plane) -> None:
    """The softest of the poses in every cell, and the softest of all."""
    x, y = made.map.position[:, list(plane)].T
    worst, k = MM * made.map.worst, 0
    low, high = scale.get_clim()
    cells = axes.hexbin(x, y, C=worst, reduce_C_function=np.max, gridsize=CELLS, linewidths=0.2)
    cells.set(cmap=scale.cmap, clim=(low, high))
    axes.plot(x[k], y[k], "o", markersize=16, markerfacecolor="none", color=MARK, markeredgewidth=2.5)
    inward = (14, -4) if x[k] < x.mean() else (-14, -4)
    label = axes.annotate(f"{worst[k]:.2f} mm", (x[k], y[k]), inward, textcoords="offset points", color=MARK)
    label.set(weight="bold", ha="left" if inward[0] > 0 else "right")
    label.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5})
