"""Figure of the solver comparison: how far from the least F_M after how long, and where local solves end."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.studies.solver_comparison.looks import COLOURS, MARKS
from testbench.studies.solver_comparison.report import SolverComparisonReport
from testbench.views.colours import GCO, LEAST_SQUARES, hexadecimal
from testbench.views.figure import SMALL, SOFT, body, key, log_ticks, page, quiet, say

PERCENT = 0.01
LEAST = 1e-10  #: Excess drawn for an F_M that is the least one itself.
SPREAD = 0.28


def solver_comparison(report: SolverComparisonReport) -> Figure:
    """Gap to the certified lower bound against time, and excess of local solves by order m."""
    figure = page(6.6)
    part = body(figure)
    left, right = part.subplots(1, 2, width_ratios=(3, 2))
    _ways(left, report)
    _minima(right, report)
    paper, local = (next(row.times for row in report.solvers if row.key == own) for own in ("a", "b"))
    key(part, left.get_legend_handles_labels(), columns=2)
    say(
        figure,
        f"To within 1 % of the least F_M the paper's optimiser takes {paper} the time of the conic program "
        f"with its proof; one local solve {local}, without proof",
        f"{report.model}, {report.arm}. Left: ways down in seed {report.convergence.seed}, marks: ends in "
        f"{len(report.seed)} seeds; times in the title: medians. Right: a dot a random start.",
    )
    return figure


def _ways(axes: Axes, report: SolverComparisonReport) -> None:
    """Lines of the first seed, a marker for the end in every seed."""
    for row in report.solvers:
        shade = hexadecimal(COLOURS[row.key])
        ends = [(run.seconds, run.gap_to_bound) for run in report.runs if run.key == row.key]
        x, y = np.array(ends).T
        size = 11 if row.key == "d" else 6
        axes.plot(x, y, MARKS[row.key], color=shade, markersize=size, label=row.title, zorder=3)
        way = report.convergence.points[row.key]
        seconds, gap = np.array([*way, (ends[0][0], way[-1][1])]).T
        axes.step(seconds, gap, where="post", color=shade, linewidth=2 if row.key in "ad" else 1.4)
    axes.axhline(PERCENT, color=SOFT, linewidth=1, linestyle="--")
    log_ticks(axes, "x", *axes.dataLim.intervalx)
    log_ticks(axes, "y", *axes.dataLim.intervaly)
    at, edge = (1, PERCENT), ("axes fraction", "data")
    axes.annotate("1 % ", at, xycoords=edge, ha="right", va="bottom", color=SOFT)
    axes.set_xlabel("wall time [s]")
    axes.set_ylabel("F_M over its certified lower bound, minus 1")
    axes.set_title("how far from the least after how long", fontsize="medium")
    quiet(axes)


def _minima(axes: Axes, report: SolverComparisonReport) -> None:
    """Excess of every local solve over the best of its order, one strip an order."""
    rows = list(report.local_minima.values())
    for k, row in enumerate(rows):
        excess = np.maximum(row.excess, LEAST)
        x = k + SPREAD * np.linspace(-1, 1, len(excess))
        axes.plot(x, excess, ".", color=hexadecimal(LEAST_SQUARES if k else GCO), markersize=5)
        axes.text(
            k, 20.0, f"{100 * row.share_close:.0f} % within\n0.001 %", ha="center", va="top", fontsize=SMALL
        )
    axes.axhline(PERCENT, color=SOFT, linewidth=1, linestyle="--")
    log_ticks(axes, "y", LEAST, 24)
    names = [f"m = {row.m}\nover {row.reference.replace(' of ', chr(10) + 'of ')}" for row in rows]
    axes.set_xticks(range(len(rows)), names, fontsize=SMALL)
    axes.set_ylabel("excess of F_M, relative")
    axes.set_title("where local solves end", fontsize="medium")
    quiet(axes)
