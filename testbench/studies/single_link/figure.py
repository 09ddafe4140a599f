"""Section 5.1 as a picture: smallest eigenvalues over the draws, and what the order m costs."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.studies.single_link.report import LinkModel, LinkReport
from testbench.studies.single_link.tables import ORDER, POSITION, SMALLEST
from testbench.studies.single_link.trial import GCO, LEAST_SQUARES
from testbench.trials.spread import middle
from testbench.views.colours import look
from testbench.views.figure import SMALL, SOFT, log_ticks, page, quiet, say
from testbench.views.gains import beside
from testbench.views.schema import Column

ROUND = 1e-3  #: Eigenvalue below which GCO stands at the boundary of what is conservative [1e-6 SI].
UNIT = "10\u207b\u2076 SI"
BINS = 50
SPREAD = 2.8  #: Width of the histogram over that of its middle 80 %.


def single_link(report: LinkReport) -> Figure:
    """Left: smallest eigenvalue of every draw, LS against GCO. Right: F_M and error against the order m."""
    figure = page(6.2)
    axes = figure.subplot_mosaic("ab;ac", width_ratios=[1.9, 1])
    ls, ours = report.model(LEAST_SQUARES), report.model(GCO)
    _eigenvalues(axes["a"], ls, ours, report.draws)
    level = POSITION.value(ls)
    _order(axes["b"], report, ORDER[1])
    _order(axes["c"], report, POSITION, middle(level))
    axes["b"].set_title("by order m, Eq. (16)", fontsize="medium")
    axes["b"].tick_params(labelbottom=False)
    axes["c"].axhline(middle(level), color=_hex(ls), linewidth=2, label=LEAST_SQUARES)
    axes["c"].text(
        0.8,
        0.93 * middle(level),
        f"{LEAST_SQUARES} {middle(level):.1f}",
        color=_hex(ls),
        va="top",
        fontsize=SMALL,
    )
    axes["c"].set_xlabel("order m")
    loads = "six axis loads" if report.loads == "axes" else "six random loads"
    say(
        figure,
        f"Single link, position error: {beside({'least squares': report.gains.least_squares}, 'um')}; a "
        f"negative eigenvalue in {_negative(ours)} and {_negative(ls)} of the draws",
        f"Section 5.1, {loads}, {report.draws} draws of noise, medians; grey: the paper. Right: medians of "
        f"{report.order_draws} draws. What lies beyond an end of the left axis stands in its last bin.",
    )
    return figure


def _hex(model: LinkModel) -> str:
    return look(model.name, model.constraint).hex


def _eigenvalues(ax: Axes, ls: LinkModel, ours: LinkModel, draws: int) -> None:
    """Histograms; GCO's draws at the boundary are one stem, as no bin has a width for them."""
    left, right = (SMALLEST.scale * np.array(m.min_eigenvalues) for m in (ls, ours))
    orange, green = _hex(ls), _hex(ours)
    width = SPREAD * np.ptp(np.percentile(np.concatenate([left, right]), [10, 90])) / BINS
    bins = width * np.arange(-BINS // 2, BINS // 2 + 1)
    start, end = bins[0], bins[-1]
    edge = right < ROUND
    ax.axvspan(start, 0, color=orange, alpha=0.08, linewidth=0)
    ax.hist(np.clip(left, start, end), bins.tolist(), color=orange, alpha=0.75, linewidth=0, label=_below(ls))
    inside = np.clip(right[~edge], 0, end)
    ax.hist(inside, bins[bins >= 0].tolist(), color=green, histtype="step", linewidth=2.5, label=_below(ours))
    top = 1.5 * ax.dataLim.ymax
    ax.plot([0, 0], [0, 0.9 * top], color=green, linewidth=5, solid_capstyle="butt")
    ax.plot(
        [0],
        [0.9 * top],
        "o",
        markersize=13,
        color=green,
        label=f"at zero, not to scale: {100 * edge.mean():.0f} %",
    )
    if ls.paper is not None:
        paper = SMALLEST.value(ls.paper)
        words = f"the paper, Eq. (22): {paper:.2f} "
        ax.plot([paper, paper], [0, 0.7 * top], "--", color=SOFT, linewidth=2)
        ax.text(paper, 0.71 * top, words, color=SOFT, ha="right", va="bottom")
    ax.set_ylim(0, top)
    ax.set_xlim(start, end)
    ax.set_xlabel(f"{SMALLEST.heading} of C [{UNIT}]")
    ax.set_ylabel(f"draws, of {draws}")
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1), handlelength=1, frameon=False)
    quiet(ax)


def _below(model: LinkModel) -> str:
    """A model and how often it is not positive semi-definite."""
    method = "least squares" if model.constraint == "none" else "GCO"
    return f"{method}, {model.name}: below zero in {_negative(model)}"


def _negative(model: LinkModel) -> str:
    """Share of the draws with a negative eigenvalue."""
    return f"{100 * float(model.negative_eigenvalue_matrix or 0):.4g} %"


def _order(ax: Axes, report: LinkReport, column: Column, *others: float) -> None:
    """A quantity over the order m; `others` are values that the axis has to hold too."""
    m, values = [row.m for row in report.order], [middle(column.value(row)) for row in report.order]
    green = _hex(report.model(GCO))
    ax.plot(m, values, "o-", color=green, linewidth=2, markersize=7, label=GCO)
    for x, y in zip(m, values, strict=True):
        below = any(y < other < 1.5 * y for other in others)
        ax.annotate(
            f"{y:.3g}" if y < 1000 else f"{y:.0f}",
            (x, y),
            (-6, -18) if below else (4, 6),
            textcoords="offset points",
            color=green,
            fontsize=SMALL,
        )
    log_ticks(ax, "y", min([*values, *others]) / 1.5, 1.5 * max([*values, *others]))
    ax.set_xticks(m)
    ax.set_xlim(0.7, 6.7)
    ax.set_ylabel(f"{column.heading} [{column.unit}]" if column.unit else column.heading)
    quiet(ax)
