"""Errors by factors: lines over a swept quantity, intervals by what names a row, maps of two factors."""

import textwrap
from collections.abc import Mapping, Sequence

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
    Line,
    body,
    draw_line,
    key,
    labelled,
    log_ticks,
    page,
    quiet,
    say,
)
from testbench.views.schema import Column, Table, looks

MOST = 10.0  #: Ratio of the darkest colours, and its inverse.
SCALE = LogNorm(1 / MOST, MOST, clip=True)
COLOURS = colormaps["BrBG_r"]
"""Green where a ratio is below 1, brown above: told apart by people who see no red or green."""
DARK = 3.0  #: Ratio, or its inverse, beyond which numbers are white.
TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10)
SIDE = 4  #: Maps side by side.


def sweeps(panes: Mapping[str, Table], answer: str, reading: str, bands: Sequence[str] = ()) -> Figure:
    """Lines over swept quantities on logarithmic axes, a pane a table with a legend of its own.

    Args:
        panes: By title; the columns of a table name the line, sweep and are drawn. Lines that are of models
            have their colours, others those that the table gives.
        answer: See `say`.
        reading: The same.
        bands: Names of the lines whose spread is drawn.
    """
    down = -(-len(panes) // 2)
    figure = page(1.0 + 4.6 * down)
    grid = figure.add_gridspec(down, 2)
    for k, (title, table) in enumerate(panes.items()):
        alone = k % 2 == 0 and k == len(panes) - 1
        axes, (name, x, y) = figure.add_subplot(grid[k // 2, slice(None) if alone else k % 2]), table.columns
        for line, look in (table.looks or looks(table.rows, name)).items():
            rows = [row for row in table.rows if name.cell(row) == line]
            draw_line(axes, x, y, Line(rows, look, line, line in bands))
        log_ticks(axes, "y", *axes.dataLim.intervaly)
        log_ticks(axes, "x", *axes.dataLim.intervalx)
        at = {middle(x.value(row)): x.cell(row) for row in table.rows}
        axes.set_xticks(list(at), list(at.values()))
        axes.set(xlabel=labelled(x), ylabel=labelled(y))
        axes.set_title(title, fontsize="medium")
        axes.legend(frameon=False, fontsize=SMALL, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.14))
        quiet(axes)
    say(figure, answer, reading)
    return figure


def ranges(panes: Mapping[str, Table], answer: str, reading: str) -> Figure:
    """Medians and spreads of models by what names a row, a pane a table: nothing joins one row to the next.

    Args:
        panes: By title; the columns of a table name the row and the model, and are drawn.
        answer: See `say`.
        reading: The same.
    """
    rows, (down, name, value) = (table := next(iter(panes.values()))).rows, table.columns
    places, known = list(dict.fromkeys(down.cell(row) for row in rows)), looks(rows, name)
    figure = page(2.4 + 0.6 * len(places))
    part = body(figure)
    sides = part.subplots(1, len(panes), sharey=True, squeeze=False)[0]
    for axes, (title, own) in zip(sides, panes.items(), strict=True):
        for k, (model, look) in enumerate(known.items()):
            shown = [row for row in own.rows if name.cell(row) == model]
            y = [places.index(down.cell(row)) + 0.8 * ((k + 0.5) / len(known) - 0.5) for row in shown]
            for row, at in zip(shown, y, strict=True):
                axes.plot(ends(value.value(row)), (at, at), color=look.hex, alpha=0.5)
            middles = [middle(value.value(row)) for row in shown]
            style = {"markerfacecolor": look.face, "markersize": look.size(5), "label": model}
            axes.plot(middles, y, look.mark, color=look.hex, **style)
        log_ticks(axes, "x", *axes.dataLim.intervalx)
        axes.set(xlabel=labelled(value))
        axes.set_title(title, fontsize="medium")
        axes.grid(axis="y", alpha=0.2)
        quiet(axes)
    sides[0].set_yticks(range(len(places)), places)
    sides[0].set_ylim(len(places) - 0.5, -0.5)
    key(part, sides[0].get_legend_handles_labels(), columns=5)
    say(figure, answer, reading)
    return figure


def maps(panes: Mapping[str, Table], answer: str, reading: str, framed: Column) -> Figure:
    """Ratios of errors by two factors, a map a table: colour and number are the median.

    Args:
        panes: By title; the columns of a table go along, go up, and are drawn.
        answer: See `say`.
        reading: The same.
        framed: A share; cells in which it is above one half have a frame.
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
