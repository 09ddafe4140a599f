"""What every disturbance costs, without noise and with it."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.report.campaigns import RMS, existing
from testbench.report.columns import columns
from testbench.report.table import Row
from testbench.trials.spread import ends, grouped, middle, span
from testbench.views.colours import look
from testbench.views.figure import body, key, log_ticks, page, quiet, say

STEP = 0.09  #: Between the models of one case [cases].


def disturbances(f: Row, answer: str) -> Figure:
    """Median and spread of every model, a line a case: nothing joins one case to the next.

    Args:
        f: Numbers of the report.
        answer: The title.
    """
    [case], cases = columns("case"), list(f.sizes)
    figure = page(2.4 + 0.6 * len(cases))
    part = body(figure)
    left, right = part.subplots(1, 2, sharey=True)
    told = existing(f.cells)
    calm, noisy = ([c for c in told if (c.sigma_um == 0) == quietly] for quietly in (True, False))
    for axes, cells, words in (
        (left, calm, "without noise"),
        (right, noisy, f"with noise of {f.sigma_um:g} um"),
    ):
        _intervals(axes, cells, cases)
        axes.set_title(words, fontsize="medium")
    left.set_yticks(range(len(cases)), [case.text(name) for name in cases])
    left.set_ylim(len(cases) - 0.5, -0.5)
    key(part, left.get_legend_handles_labels(), columns=5)
    say(
        figure,
        answer,
        "RMS errors over the workspace. Dots: medians, lines: "
        f"{span(f.trials)} of {f.trials} trials. Filled: with a prior.",
    )
    return figure


def _intervals(axes: Axes, cells: Sequence[Row], cases: Sequence[str]) -> None:
    by_model = grouped(cells, lambda cell: cell.name)
    for k, (model, own) in enumerate(by_model.items()):
        shown = look(own[0].structure, own[0].constraint, own[0].prior)
        y = [cases.index(c.case) + STEP * (k - (len(by_model) - 1) / 2) for c in own]
        for place, cell in zip(y, own, strict=True):
            axes.plot(ends(cell.rms_um), (place, place), color=shown.hex, alpha=0.5)
        face = shown.hex if shown.prior else "white"
        medians = [middle(cell.rms_um) for cell in own]
        axes.plot(medians, y, shown.mark, color=shown.hex, markerfacecolor=face, label=model, markersize=5)
    log_ticks(axes, "x", *(f(ends(c.rms_um)[k] for c in cells) for k, f in enumerate((min, max))))
    axes.set_xlabel(f"{RMS.heading} of predicted deflection [{RMS.unit}]")
    axes.grid(axis="y", alpha=0.2)
    quiet(axes)
