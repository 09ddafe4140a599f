"""How far from the least F_M after how long, and where local solves end."""

import numpy as np
from matplotlib.axes import Axes

from testbench.report.table import Row
from testbench.views.colours import GCO, LEAST_SQUARES, SERIES, Look, hexadecimal
from testbench.views.figure import SMALL, SOFT, Figure, body, key, log_ticks, page, quiet, say
from testbench.views.markdown import counted

LOOKS = {
    letter: Look(colour, place, prior=True)
    for letter, colour, place in (
        ("a", SERIES[3], 0),
        ("a'", SERIES[2], 4),
        ("b", SERIES[1], 3),
        ("b'", SERIES[5], 5),
        ("c", SERIES[4], 1),
        ("d", GCO, 6),
        ("e", SERIES[6], 2),
    )
}
"""One colour and one mark a solver: the conic program green, the others not; all minimise the same F_M."""
PERCENT = 0.01
LEAST = 1e-10  #: Excess drawn for an F_M that is the least one itself.
SPREAD = 0.28


def solver_comparison(f: Row, answer: str) -> Figure:
    """Gap to the certified lower bound against time, and excess of local solves by order m."""
    figure = page(6.6)
    part = body(figure)
    left, right = part.subplots(1, 2, width_ratios=(3, 2))
    _ways(left, f)
    _minima(right, f)
    key(part, left.get_legend_handles_labels(), columns=2)
    say(
        figure,
        answer,
        f"{f.model}, {f.arm}. Left: ways down in seed {f.convergence.seed}, marks: ends in "
        f"{counted(len(f.seed), 'seed')}; times in the title: medians. Right: a dot a random start.",
    )
    return figure


def _ways(axes: Axes, f: Row) -> None:
    """Lines of the first seed, a marker for the end in every seed."""
    for row in f.solvers:
        look = LOOKS[row.key]
        ends = [(run.seconds, run.gap_to_bound) for run in f.runs if run.key == row.key]
        x, y = np.array(ends).T
        axes.plot(x, y, look.mark, color=look.hex, markersize=look.size(6), label=row.solver, zorder=3)
        way = f.convergence.points[row.key]
        seconds, gap = np.array([*way, (ends[0][0], way[-1][1])]).T
        axes.step(seconds, gap, where="post", color=look.hex, linewidth=2 if row.key in "ad" else 1.4)
    axes.axhline(PERCENT, color=SOFT, linewidth=1, linestyle="--")
    log_ticks(axes, "x", *axes.dataLim.intervalx)
    log_ticks(axes, "y", *axes.dataLim.intervaly)
    at, edge = (1, PERCENT), ("axes fraction", "data")
    axes.annotate("1 % ", at, xycoords=edge, ha="right", va="bottom", color=SOFT)
    axes.set_xlabel("wall time [s]")
    axes.set_ylabel("F_M over its certified lower bound, minus 1")
    axes.set_title("how far from the least after how long", fontsize="medium")
    quiet(axes)


def _minima(axes: Axes, f: Row) -> None:
    """Excess of every local solve over the best of its order, one strip an order."""
    rows = list(f.local_minima.values())
    for k, row in enumerate(rows):
        excess = np.maximum(row.excess, LEAST)
        x = k + SPREAD * np.linspace(-1, 1, len(excess))
        axes.plot(x, excess, ".", color=hexadecimal(LEAST_SQUARES if k else GCO), markersize=5)
        words = f"{row.within_1e_5_percent:.0f} % within\n0.001 %"
        axes.text(k, 20.0, words, ha="center", va="top", fontsize=SMALL)
    axes.axhline(PERCENT, color=SOFT, linewidth=1, linestyle="--")
    log_ticks(axes, "y", LEAST, 24)
    names = [f"m = {row.m}\nover {row.reference.replace(' of ', chr(10) + 'of ')}" for row in rows]
    axes.set_xticks(range(len(rows)), names, fontsize=SMALL)
    axes.set_ylabel("excess of F_M, relative")
    axes.set_title("where local solves end", fontsize="medium")
    quiet(axes)
