"""Maps of noise by poses: GCO over least squares, and what of it the cone does by itself."""

import textwrap
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import SubFigure
from matplotlib.patches import Rectangle

from testbench.report.table import Row
from testbench.trials.spread import ends, middle
from testbench.views.figure import SMALL, Figure, page, say
from testbench.views.schema import Column

MOST = 10.0  #: Ratio of the darkest colours, and its inverse.
SCALE = LogNorm(1 / MOST, MOST, clip=True)
COLOURS = colormaps["BrBG_r"]
"""Green where GCO is better, brown where least squares is: told apart by people who see no red or green."""
DARK = 3.0  #: Ratio, or its inverse, beyond which numbers are white.
TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10)


def maps(kinds: Mapping[str, tuple[Sequence[Row], Sequence[Column]]], answer: str, reading: str) -> Figure:
    """A panel a structure and ratio.

    Args:
        kinds: Cells and the ratios that are drawn, by kind of reading.
        answer: See `say`.
        reading: The same.
    """
    figure = page(13.6)
    grid = figure.add_gridspec(len(kinds), 1, height_ratios=[len(drawn) for _, drawn in kinds.values()])
    for k, (words, (cells, drawn)) in enumerate(kinds.items()):
        part = figure.add_subfigure(grid[k])
        _panels(part, cells, drawn)
        part.suptitle(words, fontsize="large")
    say(figure, answer, reading)
    return figure


def _panels(figure: SubFigure, cells: Sequence[Row], columns: Sequence[Column]) -> None:
    structures = list(dict.fromkeys(cell.structure for cell in cells))
    panels = figure.subplots(len(columns), len(structures), sharex=True, sharey=True, squeeze=False)
    for line, column in zip(panels, columns, strict=True):
        for axes, structure in zip(line, structures, strict=True):
            heat(axes, [cell for cell in cells if cell.structure == structure], column)
        line[0].set_ylabel("\n".join([*textwrap.wrap(column.heading.replace(", ", " of "), 26), "poses"]))
    for axes, structure in zip(panels[0], structures, strict=True):
        axes.set_title(structure, fontsize="medium")
    for axes in panels[-1]:
        axes.set_xlabel("noise [um]")
    bar = figure.colorbar(ScalarMappable(SCALE, COLOURS), ax=panels, extend="both", ticks=TICKS)
    bar.ax.set_yticklabels([f"{tick:g}" for tick in TICKS])
    bar.ax.minorticks_off()
    bar.set_label("below 1 GCO is better")


def heat(axes: Axes, cells: Sequence[Row], column: Column) -> None:
    """The cells of one structure: colour and number are the median."""
    noise, poses = (sorted({cell[key] for cell in cells}) for key in ("sigma_um", "poses"))
    values = np.full((len(poses), len(noise)), np.nan)
    for cell in cells:
        y, x = poses.index(cell.poses), noise.index(cell.sigma_um)
        low, high = ends(column.value(cell))
        ratio = values[y, x] = middle(column.value(cell))
        colour = "white" if abs(np.log(ratio)) > np.log(DARK) else "black"
        axes.text(x, y, column.text(ratio), color=colour, ha="center", va="center", fontsize=SMALL)
        if low < 1 < high:
            axes.add_patch(_around(x, y, 0.5, hatch="//", edgecolor=(0, 0, 0, 0.13), linewidth=0))
        if cell.beats_joints_in > 0.5:
            axes.add_patch(_around(x, y, 0.46, edgecolor=colour, linewidth=1.2))
    axes.imshow(values, cmap=COLOURS, norm=SCALE, aspect="auto", origin="lower")
    axes.set_xticks(range(len(noise)), [f"{level:g}" for level in noise])
    axes.set_yticks(range(len(poses)), [str(count) for count in poses])
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)


def _around(x: int, y: int, half: float, **style: object) -> Rectangle:
    return Rectangle((x - half, y - half), 2 * half, 2 * half, fill=False, **style)  # type: ignore[arg-type]
