"""Section 5.1 as a picture: smallest eigenvalues over the draws, and what the order m costs."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.studies.single_link.trial import GCO, LEAST_SQUARES
from testbench.views.figures import GREEN, GREY, ORANGE
from testbench.views.report import UM, Report, middle

ROUND = 1e-3
"""Eigenvalue below which GCO stands at the boundary of what is conservative [1e-6 SI]."""
BINS = 50
SPREAD = 2.8
"""Width of the histogram over that of its middle 80 %."""
DARK_ORANGE = "#A86F00"
"""Least squares in words: the orange of areas is too light for text."""


def single_link(report: Report, file: Path) -> None:
    """Left: smallest eigenvalue of every draw, LS against GCO. Right: F_M and error against the order m."""
    figure = Figure(figsize=(12, 5.4), layout="constrained")
    axes = figure.subplot_mosaic("aab;aac")
    by_name = {m["name"]: m for m in report["models"]}
    _eigenvalues(axes["a"], by_name[LEAST_SQUARES], by_name[GCO], report["draws"])
    rows = report["order"]
    _order(axes["b"], rows, [middle(row["f_m"]) for row in rows], "{:.3g}")
    axes["b"].set_title(f"order m of Eq. (16), {report['order_draws']} draws: F_M", fontsize="medium")
    axes["b"].tick_params(labelbottom=False)
    _order(axes["c"], rows, [middle(row["prediction"]["position_rms_um"]) for row in rows], "{:.3g}")
    ls = middle(by_name[LEAST_SQUARES]["prediction"]["position_rms_um"])
    axes["c"].axhline(ls, color=ORANGE, linewidth=2)
    axes["c"].text(0.8, 0.93 * ls, f"LS {ls:.3g}", color=DARK_ORANGE, va="top", ha="left")
    axes["c"].set_title("position error under fresh loads [um]", fontsize="medium")
    axes["c"].set_xlabel("m")
    axes["b"].sharex(axes["c"])
    loads = "six axis loads" if report["loads"] == "axes" else "six random loads"
    figure.suptitle(
        f"Single link of section 5.1, {loads}, {report['draws']} draws of noise: "
        f"least squares orange, GCO green, paper grey",
        fontsize="large",
    )
    figure.savefig(file, dpi=120)


def _eigenvalues(ax: Axes, ls: Report, ours: Report, draws: int) -> None:
    """Histograms; GCO's draws at the boundary are one stem, as no bin has a width for them."""
    left, right = (UM * np.array(m["min_eigenvalues"]) for m in (ls, ours))
    width = SPREAD * np.ptp(np.percentile(np.concatenate([left, right]), [10, 90])) / BINS
    bins = width * np.arange(-BINS // 2, BINS // 2 + 1)
    start, end = bins[0], bins[-1]
    edge = right < ROUND
    ax.axvspan(start, 0, color=ORANGE, alpha=0.08, linewidth=0)
    ax.hist(np.clip(left, start, end), bins.tolist(), color=ORANGE, alpha=0.75, linewidth=0)
    ax.hist(
        np.clip(right[~edge], 0, end), bins[bins >= 0].tolist(), color=GREEN, histtype="step", linewidth=2.5
    )
    top = 1.5 * ax.dataLim.ymax
    ax.plot([0, 0], [0, 0.9 * top], color=GREEN, linewidth=5, solid_capstyle="butt")
    ax.plot([0], [0.9 * top], "o", markersize=13, color=GREEN)
    gap = 0.03 * (end - start)
    ranks = [int(rank) for rank in ours["rank_of_C"] if int(rank) < 6]
    what = f"rank {ranks[0]}; " if len(ranks) == 1 else ""
    words = f"GCO: never below zero\n{100 * edge.mean():.0f} % at zero ({what}bar cut off),\nthe others above"
    ax.text(gap, 0.9 * top, words, color=GREEN, va="center", fontsize="large")
    symmetric, below = (100 * ls[key] for key in ("symmetric", "negative_eigenvalue_matrix"))
    words = f"least squares: symmetric in {symmetric:.4g} %,\n{below:.0f} % of draws below zero"
    ax.text(-gap, 0.9 * top, words, color=DARK_ORANGE, ha="right", va="center", fontsize="large")
    paper = UM * ls["paper"]["min_eigenvalue_matrix"]
    ax.plot([paper, paper], [0, 0.7 * top], "--", color=GREY, linewidth=2)
    ax.text(paper, 0.71 * top, f"the paper's LS, Eq. (22): {paper:.2f} ", color=GREY, ha="right", va="bottom")
    ax.set_ylim(0, top)
    ax.set_xlim(start, end)
    ax.set_xlabel(
        "smallest eigenvalue of C [1e-6, mixed SI units as the paper's]; beyond an end: in its last bin"
    )
    ax.set_ylabel(f"draws, of {draws}")
    ax.spines[["top", "right"]].set_visible(False)


def _order(ax: Axes, rows: list[Report], values: list[float], form: str) -> None:
    m = [row["m"] for row in rows]
    ax.semilogy(m, values, "o-", color=GREEN, linewidth=2, markersize=7)
    for x, y in zip(m, values, strict=True):
        ax.annotate(form.format(y), (x, y), (5, 7), textcoords="offset points", color=GREEN)
    ax.set_ylim(0.45 * min(values), 2.4 * max(values))
    ax.set_xticks(m)
    ax.set_xlim(0.7, 6.7)
    ax.set_yticks([], minor=True)
    ax.yaxis.set_major_formatter("{x:g}")
    ax.spines[["top", "right"]].set_visible(False)
