"""Picture of measured runs: where the targets were read, how far they moved, how far from nominal."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from testbench.bench.campaign import Cell
from testbench.bench.rows import MM
from testbench.bench.understood import Understood
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.views.colours import MARKS, MEASURED, NOMINAL, hexadecimal
from testbench.views.data.nominal import magnification, nominal_markers
from testbench.views.data.words import count
from testbench.views.figure import SMALL, SOFT, page, quiet, say

READ, PLANNED = hexadecimal(MEASURED), hexadecimal(NOMINAL)


def picture(cell: Cell, name: str, found: Understood, data: Dataset) -> Figure:
    """Runs in the base's frame from the side, their deflections, and their distance from nominal."""
    figure = page(9.0)
    panes = figure.subplot_mosaic("ss;ma", height_ratios=(1.25, 1))
    side, moved, away = (panes[k] for k in "sma")
    nominal = nominal_markers(cell, data)
    _side(side, data, nominal)
    size = MM * np.linalg.norm(data.deflection, axis=-1)
    _runs(moved, data, size, "deflection [mm]", "Loaded minus unloaded")
    apart = MM * np.linalg.norm(data.before - nominal, axis=-1)
    _runs(away, data, apart, "distance [mm]", "Unloaded reading to the arm without sag")
    lost = f", {count(len(found.lost), 'target')} lost" if found.lost else ""
    low, high = size[data.seen].min(), size[data.seen].max()
    say(
        figure,
        f"{name}: {count(found.runs, 'run')} in {count(found.poses, 'pose')}{lost}; targets move "
        f"{low:.2f} to {high:.2f} mm",
        f"Above: arrows from unloaded to loaded readings, times {magnification(data, nominal):g}. Below: "
        "runs in the order of the file.",
    )
    return figure


def _side(axes: Axes, data: Dataset, nominal: Array) -> None:
    """Targets from the side: distance from the base's axis and height; arrows are magnified."""
    seen, scale = data.seen, magnification(data, nominal)
    flat = [
        np.stack([np.hypot(x[..., 0], x[..., 1]), x[..., 2]], axis=-1)[seen] for x in (nominal, data.before)
    ]
    end = data.before + scale * data.deflection
    tip = np.stack([np.hypot(end[..., 0], end[..., 1]), end[..., 2]], axis=-1)[seen]
    axes.plot(*flat[0].T, "o", color=PLANNED, fillstyle="none", markersize=8, label="arm without sag")
    axes.plot(*flat[1].T, ".", color=READ, markersize=5, label="read unloaded")
    axes.quiver(
        *flat[1].T, *(tip - flat[1]).T, angles="xy", scale_units="xy", scale=1, color=READ, width=0.002
    )
    axes.plot(*tip.T, ",", color=READ)  # so that the axes hold the arrows
    axes.set(xlabel="distance from the base's z axis [m]", ylabel="height [m]", aspect="equal")
    axes.set_adjustable("datalim")
    axes.set_title(f"Targets from the side, deflection x {scale:g}", fontsize="medium")
    axes.legend(frameon=False, fontsize=SMALL)
    quiet(axes)


def _runs(axes: Axes, data: Dataset, values: Array, label: str, title: str) -> None:
    """A value a run and marker, in the order of the file."""
    places = np.arange(data.runs) + 1
    for k, name in enumerate(data.markers):
        seen, shade = data.seen[:, k], 0.35 + 0.65 * (k + 1) / len(data.markers)
        mark = MARKS[k % len(MARKS)]
        axes.plot(places[seen], values[seen, k], mark, color=READ, alpha=shade, markersize=5, label=name)
    axes.set(xlabel="run", ylabel=label)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlim(0.5, data.runs + 0.5)
    axes.set_ylim(0, 1.1 * float(np.nanmax(values)))
    axes.grid(axis="y", color=SOFT, alpha=0.15)
    axes.set_title(title, fontsize="medium")
    if len(data.markers) <= 8:
        axes.legend(frameon=False, fontsize=SMALL, ncols=len(data.markers), loc="lower center")
    quiet(axes)
