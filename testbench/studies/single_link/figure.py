"""Section 5.1 as a picture: smallest eigenvalues over the draws, and what the order m costs."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.report.columns import KNOWN
from testbench.report.table import Row
from testbench.trials.spread import middle
from testbench.views.colours import look
from testbench.views.figure import SMALL, SOFT, Line, draw_line, log_ticks, page, quiet, say
from testbench.views.gains import beside

ROUND = 1e-3  #: Eigenvalue below which GCO stands at the boundary of what is conservative [1e-6 SI].
BINS = 50
SPREAD = 2.8  #: Width of the histogram over that of its middle 80 %.
POSITION = "prediction.position_rms_um"


def single_link(f: Row, ls: Row, ours: Row) -> Figure:
    """Left: smallest eigenvalue of every draw, LS against GCO. Right: F_M and error against the order m."""
    figure = page(6.2)
    axes = figure.subplot_mosaic("ab;ac", width_ratios=[1.9, 1])
    _eigenvalues(axes["a"], ls, ours)
    axes["a"].set_ylabel(f"draws, of {f.draws}")
    for own, key in ((axes["b"], "f_m"), (axes["c"], POSITION)):
        draw_line(own, KNOWN["m"], KNOWN[key], Line(f.order, look(ours.name, "psd"), ours.name, band=False))
        own.set(xlabel=KNOWN["m"].title, ylabel=KNOWN[key].title)
        quiet(own)
    axes["c"].axhline(middle(ls.prediction.position_rms_um), color=look(ls.name, "none").hex, label=ls.name)
    axes["c"].legend(frameon=False, fontsize=SMALL)
    for own in (axes["b"], axes["c"]):
        log_ticks(own, "y", *own.dataLim.intervaly)
    loads = "six axis loads" if f.loads == "axes" else "six random loads"
    say(
        figure,
        f"Single link, position error: {beside({'least squares': f.gains.least_squares}, 'um')}; a negative "
        f"eigenvalue in {_negative(ours)} and {_negative(ls)} of the draws",
        f"Section 5.1, {loads}, {f.draws} draws of noise, medians; grey: the paper. Right: medians of "
        f"{f.order_draws} draws. What lies beyond an end of the left axis stands in its last bin.",
    )
    return figure


def _eigenvalues(ax: Axes, ls: Row, ours: Row) -> None:
    """Histograms; GCO's draws at the boundary are one stem, as no bin has a width for them."""
    left, right = np.array(ls.min_eigenvalues_micro), np.array(ours.min_eigenvalues_micro)
    orange, green = look(ls.name, "none").hex, look(ours.name, "psd").hex
    width = SPREAD * np.ptp(np.percentile(np.concatenate([left, right]), [10, 90])) / BINS
    bins = width * np.arange(-BINS // 2, BINS // 2 + 1)
    start, end = bins[0], bins[-1]
    edge = right < ROUND
    ax.axvspan(start, 0, color=orange, alpha=0.08, linewidth=0)
    ax.hist(
        np.clip(left, start, end), bins.tolist(), color=orange, alpha=0.75, label=_below(ls, "least squares")
    )
    inside, above = np.clip(right[~edge], 0, end), bins[bins >= 0].tolist()
    ax.hist(inside, above, color=green, histtype="step", linewidth=2.5, label=_below(ours, "GCO"))
    top = 1.5 * ax.dataLim.ymax
    at_zero = f"at zero, not to scale: {100 * edge.mean():.0f} %"
    ax.plot([0, 0], [0, 0.9 * top], color=green, linewidth=5, solid_capstyle="butt")
    ax.plot([0], [0.9 * top], "o", markersize=13, color=green, label=at_zero)
    paper = ls.paper.matrix_eigenvalue_micro
    ax.plot([paper, paper], [0, 0.7 * top], "--", color=SOFT, linewidth=2)
    ax.text(paper, 0.71 * top, f"the paper, Eq. (22): {paper:.2f} ", color=SOFT, ha="right", va="bottom")
    ax.set(xlim=(start, end), ylim=(0, top), xlabel="smallest eigenvalue of C [10\u207b\u2076 SI]")
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1), handlelength=1, frameon=False)
    quiet(ax)


def _below(m: Row, method: str) -> str:
    return f"{method}, {m.name}: below zero in {_negative(m)}"


def _negative(m: Row) -> str:
    """Share of the draws with a negative eigenvalue."""
    return f"{100 * m.negative_eigenvalue_matrix:.4g} %"
