"""What figures share: dots with their spread, lines over a swept quantity, quiet axes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure as Figure

from testbench.trials.spread import ends, middle
from testbench.views.colours import GREY, SCALE, Look, hexadecimal
from testbench.views.schema import Column

SOFT = hexadecimal(GREY)
SIZES = LinearSegmentedColormap.from_list("sizes", [hexadecimal(colour) for colour in SCALE])
"""Colours of sizes, as recordings have them."""


def dots(axes: Axes, rows: Sequence[object], name: Column, value: Column, looks: Sequence[Look]) -> None:
    """One dot a row from top to bottom, its spread as a line, the paper's number as a grey diamond.

    Args:
        axes: Where to.
        rows: Of a table.
        name: Names the rows.
        value: What is drawn; it labels the axis.
        looks: One a row.
    """
    for y, (row, look) in enumerate(zip(rows, looks, strict=True)):
        number = value.value(row)
        axes.plot(ends(number), (y, y), color=look.hex, linewidth=2, alpha=0.6)
        axes.plot(middle(number), y, look.mark, color=look.hex, markerfacecolor=look.face, markersize=8)
        known = value.known(row)
        if known:
            axes.plot(float(known), y, "D", color=SOFT, markersize=5)
    axes.set_yticks(
        range(len(rows)), [f"{name.cell(r)}  {middle(value.value(r)):{value.form}}" for r in rows]
    )
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlabel(f"{value.heading} [{value.unit}]")
    quiet(axes)


@dataclass(frozen=True)
class Line:
    """One model over a swept quantity."""

    rows: Sequence[object]  #: Of the model.
    look: Look  #: Of the model.
    label: str  #: In the legend.
    band: bool = True  #: Whether the spread is drawn.


def draw_line(axes: Axes, x: Column, y: Column, line: Line) -> None:
    """A line over a swept quantity, with its spread as a band.

    Args:
        axes: Where to.
        x: What is swept.
        y: What is drawn.
        line: Of one model.
    """
    look, own = line.look, sorted(line.rows, key=lambda row: middle(x.value(row)))
    at = [middle(x.value(row)) for row in own]
    style = "--" if look.prior else "-"
    middles = [middle(y.value(row)) for row in own]
    axes.plot(
        at,
        middles,
        look.mark + style,
        color=look.hex,
        markerfacecolor=look.face,
        label=line.label,
        markersize=5,
    )
    if line.band:
        low, high = np.array([ends(y.value(row)) for row in own]).T
        axes.fill_between(at, low, high, color=look.hex, alpha=0.08, linewidth=0)


def log_ticks(axes: Axes, side: Literal["x", "y"], low: float, high: float) -> None:
    """A logarithmic axis with plain numbers: 1, 2, 5 times powers of ten, or powers of ten over many decades.

    Args:
        axes: Of a figure.
        side: Which axis.
        low: Least value drawn, above 0.
        high: Largest value drawn.
    """
    decades = range(math.floor(math.log10(low)) - 1, math.ceil(math.log10(high)) + 1)
    steps = (1, 2, 5) if high < 300 * low else (1,)
    low, high = low / 1.3, high * 1.3
    ticks = [step * 10.0**k for k in decades for step in steps if low <= step * 10.0**k <= high]
    axes.set(**{f"{side}scale": "log", f"{side}lim": (low, high)})
    axis = axes.xaxis if side == "x" else axes.yaxis
    axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.set_ticks([], minor=True)


def quiet(axes: Axes) -> None:
    """Without the frame above and on the right."""
    axes.spines[["top", "right"]].set_visible(False)
