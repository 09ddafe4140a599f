"""Error over the workspace of every method over the family, one panel a number of poses."""

from matplotlib.figure import Figure

from testbench.studies.which_model.report import WhichModelReport
from testbench.studies.which_model.tables import ERROR, METHOD
from testbench.trials.spread import ends
from testbench.views.colours import look
from testbench.views.figure import SOFT, dots, log_ticks


def methods(report: WhichModelReport) -> Figure:
    """Median and spread of every method; a line marks the median of joints alone."""
    figure = Figure(figsize=(15, 4.8), layout="constrained")
    low, high = (f(ends(m.workspace_mm)[k] for m in report.family) for k, f in enumerate((min, max)))
    for axes, own in zip(figure.subplots(1, len(report.advice)), report.advice, strict=True):
        rows = [m for m in report.family if m.poses == own.poses]
        axes.axvline(own.joints.workspace_mm.median, color=SOFT, linewidth=1, zorder=0)
        dots(axes, rows, METHOD, ERROR, [look(m.structure, m.constraint, m.filled) for m in rows])
        log_ticks(axes, "x", low, high)
        axes.set_title(f"{own.poses} poses", fontsize="medium")
    figure.suptitle(
        f"{report.arm}, {report.trials} trials, {len(report.truths)} true arms, {len(report.priors)} priors: "
        "error over the workspace, median, 5 to 95 %; grey line: joints alone; filled: with a prior",
        fontsize="medium",
    )
    return figure
