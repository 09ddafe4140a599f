"""Figure of the solver comparison: how far from the least F_M after how long, and where local solves end."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.studies.solver_comparison.words import plain
from testbench.views.figures import GREEN, GREY, ORANGE, PURPLE
from testbench.views.report import Report, middle

BLUE, SKY, VERMILION = "#0072B2", "#56B4E9", "#D55E00"
"""More of Okabe-Ito."""
LOOK: dict[str, tuple[str, str, str]] = {
    "a": (ORANGE, "o", "(a) the paper's: genetic algorithm, global search"),
    "a'": (VERMILION, "v", "(a') the same, short genetic algorithm"),
    "b": (BLUE, "^", "(b) one local solve"),
    "b'": (GREY, "P", "(b') one local solve, finite differences"),
    "c": (SKY, "s", "(c) several local solves"),
    "d": (GREEN, "*", "(d) conic program, certified"),
    "e": (PURPLE, "D", "(e) conic program, SCS"),
}
"""Colour, marker and words of every solver."""
PERCENT = 0.01
LEAST = 1e-10
"""Excess drawn for an F_M that is the least one itself."""
SPREAD = 0.28


def solver_comparison(report: Report, file: Path) -> None:
    """Gap to the certified lower bound against time, and excess of local solves by order m."""
    figure = Figure(figsize=(12, 5.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    _ways(left, report)
    _minima(right, report)
    paper, local = (_factor(report, key) for key in ("a", "b"))
    figure.suptitle(
        f"Least F_M of {report['model']}, {report['arm']}, {len(report['seed'])} seeds: to come within 1 % "
        f"the paper's optimiser takes {paper} the time\nof the conic program with its proof; one local solve "
        f"takes {local}, without proof",
        fontsize="medium",
    )
    figure.legend(frameon=False, fontsize="small", loc="outside lower center", ncols=4)
    figure.savefig(file, dpi=120)


def _factor(report: Report, key: str) -> str:
    """Time to come within 1 %, as a multiple of that of the conic program."""
    ratio = next(row["ratio_to_conic"] for row in report["solvers"] if row["key"] == key)
    return "for ever" if ratio is None else f"{plain(middle(ratio), '.2g')} times"


def _ways(axes: Axes, report: Report) -> None:
    """Lines of the first seed, a marker for the end in every seed."""
    points = report["convergence"]["points"]
    for key, way in points.items():
        shade, marker, words = LOOK[key]
        ends = [(run["seconds"], run["gap_to_bound"]) for run in report["runs"] if run["key"] == key]
        x, y = np.array(ends).T
        axes.plot(
            x,
            y,
            marker,
            color=shade,
            markersize=11 if marker == "*" else 6,
            markeredgecolor="white",
            markeredgewidth=0.6,
            label=words,
            zorder=3,
        )
        seconds, gap = np.array([*way, [ends[0][0], way[-1][1]]]).T
        axes.step(seconds, gap, where="post", color=shade, linewidth=2 if key in "ad" else 1.4)
    axes.axhline(PERCENT, color=GREY, linewidth=1, linestyle="--")
    axes.loglog()
    axes.text(
        0.995, PERCENT, "1 % ", transform=axes.get_yaxis_transform(), ha="right", va="bottom", color=GREY
    )
    axes.set_xlabel("wall time [s]")
    axes.set_ylabel("F_M over its certified lower bound, minus 1")
    axes.set_title(
        f"way down in seed {report['convergence']['seed']}; markers: end in every seed", fontsize="medium"
    )
    axes.spines[["top", "right"]].set_visible(False)


def _minima(axes: Axes, report: Report) -> None:
    """Excess of every local solve over the best of its order, one strip an order."""
    rows = list(report["local_minima"].values())
    for k, row in enumerate(rows):
        excess = np.maximum(row["excess"], LEAST)
        x = k + SPREAD * np.linspace(-1, 1, len(excess))
        axes.plot(x, excess, ".", color=GREEN if k == 0 else ORANGE, markersize=5)
        share = f"{100 * row['share_within_1e-5']:.0f} % within 1e-5"
        axes.text(k, 3.0, share, ha="center", fontsize="small")
    axes.axhline(PERCENT, color=GREY, linewidth=1, linestyle="--")
    axes.set_yscale("log")
    axes.set_ylim(LEAST / 2, 10)
    names = [f"m = {row['m']}\nover {row['reference'].replace(' of ', chr(10) + 'of ')}" for row in rows]
    axes.set_xticks(range(len(rows)), names, fontsize="small")
    axes.set_ylabel("excess of F_M, relative")
    axes.set_title(
        f"where local solves end, {rows[0]['starts_per_seed']} random starts in {len(rows[0]['seeds'])} "
        f"seed{'s' if len(rows[0]['seeds']) > 1 else ''}",
        fontsize="medium",
    )
    axes.spines[["top", "right"]].set_visible(False)
