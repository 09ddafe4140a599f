"""Figure of section 5.2: errors of every model under both truths, the paper's beside, and the order m."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.studies.six_dof_arm.report import ModelReport, SixDofReport
from testbench.studies.six_dof_arm.tables import COLUMNS, ORDERS, tables
from testbench.trials.spread import middle
from testbench.views.colours import look
from testbench.views.figure import SOFT, Line, dots, draw_line, log_ticks, quiet

NAME = COLUMNS[0]
P95, TRUE = (next(c for c in COLUMNS if c.key == f"{key}.p95_mm") for key in ("check", "check_true"))
FAR = 30.0  #: Times the least error beyond which a model is an arrow at the edge, with its number.
M, F_M, ERROR = ORDERS[0], ORDERS[1], ORDERS[-1]


def six_dof_arm(report: SixDofReport) -> Figure:
    """Errors of every model against readings and without noise, under both truths; the error against m."""
    figure = Figure(figsize=(14, 4.6), layout="constrained")
    left, centre, right = figure.subplots(1, 3)
    shown = tables(report)
    _errors(left, shown["linear"].rows, report.models, "linear truth, as in the paper")
    _errors(centre, shown["nonlinear"].rows, report.nonlinear.models, "MuJoCo's non-linear truth")
    _orders(right, report)
    seeds = report.seed
    spread = "" if isinstance(seeds, int) else f"; median and 5 to 95 % of {len(seeds)} seeds"
    figure.suptitle(
        f"Section 5.2 on {report.arm}: least squares orange, GCO green, against readings; grey bars: without "
        f"noise; diamonds: the paper{spread}",
        fontsize="medium",
    )
    return figure


def _errors(axes: Axes, rows: Sequence[object], models: Sequence[ModelReport], title: str) -> None:
    dots(axes, rows, NAME, P95, [look(m.structure, m.constraint, m.prior) for m in models])
    true = [middle(TRUE.value(row)) for row in rows]
    axes.plot(true, range(len(true)), "|", color=SOFT, markersize=16)
    largest = max(middle(P95.value(row)) for row in rows if middle(P95.value(row)) < FAR * min(true))
    log_ticks(axes, "x", axes.dataLim.xmin, 1.5 * largest)
    beyond = [y for y, row in enumerate(rows) if middle(P95.value(row)) > 1.5 * largest]
    axes.plot([1] * len(beyond), beyond, ">", color=SOFT, transform=axes.get_yaxis_transform(), clip_on=False)
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
    axes.set_ylabel(f"{ERROR.heading} error, without noise [{ERROR.unit}]")
    axes.set_title("order m, linear truth", fontsize="medium")
    axes.legend(frameon=False, fontsize="small")
    quiet(axes)
