"""Error over the workspace of every method over the family, one panel a number of poses."""

from matplotlib.figure import Figure

from testbench.studies.which_model.methods import CHOSEN
from testbench.studies.which_model.report import MethodAt, WhichModelReport
from testbench.studies.which_model.tables import ERROR, METHOD
from testbench.trials.spread import ends
from testbench.views.colours import CHOICE, Look, look
from testbench.views.figure import SOFT, dots, log_ticks


def methods(report: WhichModelReport) -> Figure:
    """Median and spread of every method; a line marks joints alone, a band and a bold name the default."""
    figure = Figure(figsize=(15, 4.8), layout="constrained")
    low, high = (f(ends(m.workspace_mm)[k] for m in report.family) for k, f in enumerate((min, max)))
    for axes, own in zip(figure.subplots(1, len(report.advice)), report.advice, strict=True):
        rows = [m for m in report.family if m.poses == own.poses]
        axes.axvline(own.joints.workspace_mm.median, color=SOFT, linewidth=1, zorder=0)
        dots(axes, rows, METHOD, ERROR, [look_of(m) for m in rows])
        axes.axhspan(-0.5, 0.5, color=CHOICE.hex, alpha=0.1, linewidth=0, zorder=0)
        axes.get_yticklabels()[0].set_fontweight("bold")
        log_ticks(axes, "x", low, high)
        axes.set_title(f"{own.poses} poses", fontsize="medium")
    figure.suptitle(
        f"Black: what testbench chooses. Grey line: joints alone. Filled: with a prior. Error over the "
        f"workspace, median, 5 to 95 %; {report.arm}, {report.trials} trials",
        fontsize="medium",
    )
    return figure


def look_of(method: MethodAt) -> Look:
    """How a method is drawn."""
    if method.method == CHOSEN:
        return CHOICE
    return look(method.structure, method.constraint, method.filled)
