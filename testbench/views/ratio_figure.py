"""Maps of ratios of errors by two factors."""

import textwrap
from collections.abc import Mapping

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.patches import Rectangle

from testbench.trials.spread import ends, middle
from testbench.views.figure import (
    SMALL,
    Figure,
    labelled,
    page,
    say,
)
from testbench.views.schema import Column, Table

MOST = 10.0  #: Ratio of the darkest colours, and its inverse.
SCALE = LogNorm(1 / MOST, MOST, clip=True)
COLOURS = colormaps["BrBG_r"]
"""Green where a ratio is below 1, brown above: told apart by people who see no red or green."""
DARK = 3.0  #: Ratio, or its inverse, beyond which numbers are white.
TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10)
SIDE = 4  #: Maps side by side.


def maps(panes: Mapping[str, Table], answer: str, reading: str, framed: Column) -> Figure:
    """Ratios of errors by two factors, a map a table: its columns go along, go up, and are drawn.

    Colour and number are the median; cells in which the share `framed` is above one half have a frame.
    """
    down = -(-len(panes) // SIDE)
    figure = page(1.6 + 2.9 * down)
    grid = figure.add_gridspec(down, SIDE)
    for k, (title, table) in enumerate(panes.items()):
        axes = figure.add_subplot(grid[k // SIDE, k % SIDE])
        _map(axes, table, framed)
        axes.set_title(textwrap.fill(title, 26), fontsize=SMALL)
    bar = figure.colorbar(ScalarMappable(SCALE, COLOURS), ax=figure.axes, extend="both", ticks=TICKS)
    bar.ax.set_yticklabels([f"{tick:g}" for tick in TICKS])
    bar.ax.minorticks_off()
    say(figure, answer, reading)
    return figure


def _map(axes: Axes, table: Table, framed: Column) -> None:
    across, up, value = table.columns
    right, above = (sorted({middle(c.value(row)) for row in table.rows}) for c in (across, up))
    values = np.full((len(above), len(right)), np.nan)
    for row in table.rows:
        x, y = right.index(middle(across.value(row))), above.index(middle(up.value(row)))
        low, high = ends(value.value(row))
        ratio = values[y, x] = middle(value.value(row))
        colour = "white" if abs(np.log(ratio)) > np.log(DARK) else "black"
        axes.text(
            x,
            y,
            value.text(ratio) if ratio < MOST else f"{ratio:.0f}",
            color=colour,
            ha="center",
            va="center",
            fontsize=SMALL,
        )
        if low < 1 < high:
            axes.add_patch(_around(x, y, 0.5, hatch="//", edgecolor=(0, 0, 0, 0.13), linewidth=0))
        if middle(framed.value(row)) > 0.5:
            axes.add_patch(_around(x, y, 0.46, edgecolor=colour, linewidth=1.2))
    axes.imshow(values, cmap=COLOURS, norm=SCALE, aspect="auto", origin="lower")
    axes.set_xticks(range(len(right)), [f"{level:g}" for level in right])
    axes.set_yticks(range(len(above)), [f"{level:g}" for level in above])
    axes.set(xlabel=labelled(across), ylabel=labelled(up))
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)


def _around(x: int, y: int, half: float, **style: object) -> Rectangle:
    return Rectangle((x - half, y - half), 2 * half, 2 * half, fill=False, **style)  # type: ignore[arg-type]
