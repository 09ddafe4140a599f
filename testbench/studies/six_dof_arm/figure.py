"""Figure of section 5.2: errors of the five models under both truths, the paper's beside, and the order m."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.studies.six_dof_arm.summary import COLUMNS, ORDERS, ModelReport, SixDofReport, tables
from testbench.trials.spread import middle
from testbench.views.colours import look
from testbench.views.figure import Line, dots, draw_line, log_ticks, quiet

NAME, P95 = COLUMNS[0], next(c for c in COLUMNS if c.key == "readings.p95_mm")
M, F_M, ERROR = ORDERS[0], ORDERS[1], ORDERS[-1]


def six_dof_arm(report: SixDofReport) -> Figure:
    """Errors of every model against readings, under both truths; the error against the order m."""
    figure = Figure(figsize=(14, 4.6), layout="constrained")
    left, centre, right = figure.subplots(1, 3)
    shown = tables(report)
    _errors(left, shown["linear"].rows, report.models, "linear truth, as in the paper")
    _errors(centre, shown["nonlinear"].rows, report.nonlinear.models, "MuJoCo's non-linear truth")
    _orders(right, report)
    seeds = report.seed
    spread = "" if isinstance(seeds, int) else f"; median and 5 to 95 % of {len(seeds)} seeds"
    figure.suptitle(
        f"Section 5.2 on {report.arm}: least squares orange, GCO green, grey diamonds: the paper{spread}",
        fontsize="medium",
    )
    return figure


def _errors(axes: Axes, rows: Sequence[object], models: Sequence[ModelReport], title: str) -> None:
    dots(axes, rows, NAME, P95, [look(m.structure, m.constraint, m.prior) for m in models])
    log_ticks(axes, "x", *axes.dataLim.intervalx)
    axes.set_title(title, fontsize="medium")


def _orders(axes: Axes, report: SixDofReport) -> None:
    for name, rows in (("MGCO69", report.order.MGCO69), ("MGCO56", report.order.MGCO56)):
        own = look(name, "psd")
        draw_line(axes, M, ERROR, Line(rows, own, f"{name}, F_M at each point", band=False))
        for row in rows:
            at = (middle(M.value(row)), 1.1 * middle(ERROR.value(row)))
            words = f"{middle(F_M.value(row)):.3g}"
            axes.text(*at, words, color=own.hex, fontsize="small", ha="center", va="bottom")
    log_ticks(axes, "y", *axes.dataLim.intervaly)
    axes.set_xlabel("order m of the vector space (Eq. 16)")
    axes.set_ylabel(f"{ERROR.heading} runs, against the truth [{ERROR.unit}]")
    axes.set_title("order m, linear truth", fontsize="medium")
    axes.legend(frameon=False, fontsize="small")
    quiet(axes)
