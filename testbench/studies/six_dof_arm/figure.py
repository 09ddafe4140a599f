"""Figure of section 5.2: errors of every model under both truths, the paper's beside, and the order m."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.studies.six_dof_arm.report import ModelReport, SixDofReport
from testbench.studies.six_dof_arm.tables import COLUMNS, ORDERS, tables
from testbench.trials.spread import middle
from testbench.views.colours import look
from testbench.views.figure import SMALL, SOFT, Line, dots, draw_line, log_ticks, of_seeds, page, quiet, say
from testbench.views.gains import beside
from testbench.views.map_figure import error_map

NAME = COLUMNS[0]
P95, TRUE = (next(c for c in COLUMNS if c.key == f"{key}.p95_mm") for key in ("check", "check_true"))
FAR = 30.0  #: Times the least error beyond which a model is an arrow at the edge, with its number.
M, F_M, ERROR = ORDERS[0], ORDERS[1], ORDERS[-1]


def six_dof_arm(report: SixDofReport) -> Figure:
    """Errors of every model against readings and without noise, under both truths; the error against m."""
    figure = page(4.6 + 0.3 * len(report.models))
    panes = figure.subplot_mosaic("ab;cc", height_ratios=[1.1 + 0.3 * len(report.models), 2.6])
    shown = tables(report)
    _errors(panes["a"], shown["linear"].rows, report.models, "linear truth, as in the paper")
    _errors(panes["b"], shown["nonlinear"].rows, report.nonlinear.models, "MuJoCo's non-linear truth", False)
    _orders(panes["c"], report)
    gains = {"least squares": report.gains.least_squares, "joints alone": report.gains.joints}
    say(
        figure,
        f"{report.arm}, section 5.2, true error of 95 % in the check runs: {beside(gains)}",
        f"Against the truth. {of_seeds(report.seed)}. Grey strokes: the same against readings, diamonds: the "
        "paper's; arrows: beyond the axis, with their number. Numbers in the lower axes: F_M.",
    )
    return figure


def places(report: SixDofReport) -> Figure:
    """Errors of the best of each method in the check runs."""
    return error_map(report.map, f"{report.arm}, check runs under linear truth", report.seed)


def _errors(
    axes: Axes, rows: Sequence[object], models: Sequence[ModelReport], title: str, named: bool = True
) -> None:
    dots(
        axes, rows, NAME if named else None, TRUE, [look(m.structure, m.constraint, m.prior) for m in models]
    )
    read = [middle(P95.value(row)) for row in rows]
    axes.plot(read, range(len(read)), "|", color=SOFT, markersize=16)
    known = [(float(P95.known(row)), y) for y, row in enumerate(rows) if P95.known(row)]
    axes.plot(*np.reshape(known, (-1, 2)).T, "D", color=SOFT, markersize=5)
    shown = [middle(TRUE.value(row)) for row in rows]
    largest = max(max(a, b) for a, b in zip(shown, read, strict=True) if a < FAR * min(shown))
    log_ticks(axes, "x", axes.dataLim.xmin, 1.5 * largest)
    beyond = [y for y, value in enumerate(shown) if value > 1.5 * largest]
    axes.plot([1] * len(beyond), beyond, ">", color=SOFT, transform=axes.get_yaxis_transform(), clip_on=False)
    axes.set_title(title, fontsize="medium")


def _orders(axes: Axes, report: SixDofReport) -> None:
    for name, rows in (("MGCO69", report.order.MGCO69), ("MGCO56", report.order.MGCO56)):
        own = look(name, "psd")
        draw_line(axes, M, ERROR, Line(rows, own, name, band=False))
        for row in rows:
            at = (middle(M.value(row)), 1.1 * middle(ERROR.value(row)))
            words = f"{middle(F_M.value(row)):.3g}"
            axes.text(*at, words, color=own.hex, fontsize=SMALL, ha="center", va="bottom")
    low, high = axes.dataLim.intervaly
    log_ticks(axes, "y", low, 1.5 * high)
    axes.set_xlabel("order m of the vector space (Eq. 16)")
    axes.set_ylabel(f"{ERROR.heading} [{ERROR.unit}]")
    axes.set_title("error by order m, linear truth", fontsize="medium")
    axes.legend(frameon=False, fontsize=SMALL)
    quiet(axes)
