"""Errors of models over the workspace side by side in one scale of colours, the worst place of each named."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure

from testbench.bench.error_places import ErrorPlaces
from testbench.views.figure import SIZES, SMALL, SOFT, log_ticks, page, quiet, say
from testbench.views.scene import scale_of
from testbench.views.schema import plain

SIDES = {"z": (0, 2), "y": (0, 1)}
"""Seen from aside and from above: what stands on the ordinate, and the axes that are drawn."""
DOT, LEAST = 26.0, 0.3
"""Size of the dot of the greatest error [pt^2], and that of the least over it [1]: colour is never alone."""
HEIGHT, PANES, PANE = 2.0, 8.0, 2.9
"""Of title and caption, the width that all panes share, and that of one at most [in]."""
NARROW = 0.4
"""A drawn side over the longest one at least [1]: arms that move in a plane or not at all have panes too."""


def error_map(found: ErrorPlaces, title: str, seed: int | list[int] = 0) -> Figure:
    """A column a compared model: the reachable volume from aside and from above.

    Args:
        found: Errors by place, of one compared model at least with a bound.
        title: What is calibrated, under which load.
        seed: Of the report: the places are those of the first.
    """
    position = np.array(found.position_m)
    ends = _ends(position)
    sides, wide = ends[1] - ends[0], min(PANE, PANES / len(found.compared))
    rows = [wide * float(sides[axis] / sides[0]) for _, axis in SIDES.values()]
    figure = page(HEIGHT + sum(rows))
    panes = figure.subplots(
        2, len(found.compared), sharex="col", sharey="row", height_ratios=rows, squeeze=False
    )
    scale = scale_of(*(found.errors(name) for name in found.compared))
    norm = (LogNorm if scale.logarithmic else Normalize)(*scale.ends, clip=True)
    for name, column in zip(found.compared, panes.T, strict=True):
        share = scale.shares(found.errors(name))
        for axes, (letter, shown) in zip(column, SIDES.items(), strict=True):
            _draw(axes, found, name, (position[:, shown], share))
            axes.update_datalim(ends[:, shown])
            if axes in panes[:, 0]:
                axes.set_ylabel(f"{letter} [m]")
        known = name in found.worst
        size = f"{found.means.typical} {found.typical_mm(name):.3f} mm" if known else "no bound"
        column[0].set_title(f"{name}: {size}", fontsize="medium")
        column[-1].set_xlabel("x [m]")
    words = f"{found.means.name} [{scale.words}]"
    bar = figure.colorbar(ScalarMappable(norm, SIZES), ax=panes, label=words, fraction=0.03, pad=0.02)
    if scale.logarithmic:
        log_ticks(bar.ax, "y", *scale.ends)
        bar.ax.set_ylim(*scale.ends)
    which = "" if isinstance(seed, int) else f" of seed {seed[0]}"
    open_ = " Grey rings: no bound." if any(map(found.unbounded, found.compared)) else ""
    say(
        figure,
        f"{title}: {_worst(found)}",
        f"{_places(found)} {found.means.name.capitalize()}{which}: {found.means.words}.{open_}",
    )
    return figure


def _ends(position: np.ndarray) -> np.ndarray:
    """Least and greatest of what is drawn (2, 3) [m], of places (places, 3) [m]."""
    least, most = position.min(axis=0), position.max(axis=0)
    spans = most - least
    more = np.maximum(spans, NARROW * spans.max() or 1.0) - spans
    return np.array([least - more / 2, most + more / 2])


def _draw(axes: Axes, found: ErrorPlaces, name: str, drawn: tuple[np.ndarray, np.ndarray]) -> None:
    """One projection of one model: places in the plane (places, 2) [m] and on the scale (places,) [1]."""
    at, share = drawn
    unknown = at[np.isnan(share)]
    if len(unknown):
        axes.plot(*unknown.T, "o", markersize=4, markerfacecolor="none", color=SOFT)
    order = np.argsort(share)[: len(at) - len(unknown)]  # the greatest on top
    sizes = DOT * (LEAST + (1 - LEAST) * share[order])
    x, y = at[order].T
    axes.scatter(x, y, s=sizes, c=SIZES(share[order]), linewidths=0)
    axes.set_aspect("equal")
    quiet(axes)
    if name not in found.worst:
        return
    worst = found.worst[name]
    axes.plot(*at[worst.place], "o", markersize=10, markerfacecolor="none", color="black")
    inward = np.sign(at.mean(axis=0) - at[worst.place])
    axes.annotate(
        f"{plain(f'{worst.error_mm:.3g}')} mm",
        at[worst.place],
        xytext=12 * inward,
        textcoords="offset points",
        ha="left" if inward[0] > 0 else "right",
        va="bottom" if inward[1] > 0 else "top",
        fontsize=SMALL,
        bbox={"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 1.5},
    )


def _worst(found: ErrorPlaces) -> str:
    """How far the compared models are off at worst."""
    return f"greatest {found.means.name} over the workspace " + ", ".join(
        f"{name} {plain(f'{found.worst[name].error_mm:.3g}')} mm"
        for name in found.compared
        if name in found.worst
    )


def _places(found: ErrorPlaces) -> str:
    """Where that is."""
    parts = []
    for name in filter(found.worst.__contains__, found.compared):
        own = found.worst[name]
        position = ", ".join(f"{x:.2f}" for x in own.position_m)
        parts.append(f"{name} at {position} m, joints {own.joints}")
    return f"Circles, the worst place: {'; '.join(parts)}."
