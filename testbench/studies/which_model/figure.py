"""Error over the workspace of every method over the family, one panel a number of poses."""

from matplotlib.figure import Figure

from testbench.studies.which_model.report import WhichModelReport
from testbench.studies.which_model.tables import ERROR, METHOD, look_of
from testbench.trials.spread import ends, spans
from testbench.views.colours import CHOICE
from testbench.views.figure import SOFT, dots, log_ticks, page, say
from testbench.views.gains import beside


def methods(report: WhichModelReport) -> Figure:
    """Median and spread of every method; a line marks joints alone, a band and a bold name the default."""
    count = sum(m.poses == report.advice[0].poses for m in report.family)
    figure = page(1.8 + 0.3 * count)
    low, high = (f(ends(m.workspace_mm)[k] for m in report.family) for k, f in enumerate((min, max)))
    panes = figure.subplots(1, len(report.advice), squeeze=False)[0]
    for k, (axes, own) in enumerate(zip(panes, report.advice, strict=True)):
        rows = [m for m in report.family if m.poses == own.poses]
        axes.axvline(own.joints.workspace_mm.median, color=SOFT, linewidth=1, zorder=0)
        dots(axes, rows, None if k else METHOD, ERROR, [look_of(m) for m in rows])
        axes.axhspan(-0.5, 0.5, color=CHOICE.hex, alpha=0.1, linewidth=0, zorder=0)
        axes.get_yticklabels()[0].set_fontweight("bold")
        log_ticks(axes, "x", low, high)
        axes.set_title(f"{own.poses} poses", fontsize="medium")
    first = report.advice[0]
    gains = {"least squares": first.gains.least_squares, "joints alone": first.gains.joints}
    say(
        figure,
        f"{report.arm}, {first.poses} poses, RMS over the workspace: {beside(gains)}",
        "Errors over the family of true arms and priors. Dots: medians, lines: "
        f"{spans((m.workspace_mm for m in report.family), 'cases')}. Band: what testbench "
        "chooses from the readings. Filled: with a prior; grey line: joints alone.",
    )
    return figure
