"""One bar a fault: how often the right doubt is first, another one is, or nothing is noticed."""

from matplotlib.figure import Figure

from testbench.studies.wrong_inputs.report import WrongInputsReport
from testbench.studies.wrong_inputs.tables import BEFORE, OTHER, RIGHT, SILENT
from testbench.views.colours import GREY, MEASURED, NOMINAL, hexadecimal
from testbench.views.figure import SMALL, body, key, page, quiet, say

PARTS = (
    (RIGHT, "right doubt first", hexadecimal(NOMINAL), ""),
    (OTHER, "another doubt first", hexadecimal(MEASURED), "//"),
    (SILENT, "not noticed", hexadecimal(GREY), ".."),
)
"""Column, words, colour and hatch of the parts of a bar."""


def bars(report: WrongInputsReport) -> Figure:
    """The fault that is named most seldom first is at the top; a black diamond is the incumbent."""
    rows = report.faults
    figure = page(1.9 + 0.23 * len(rows))
    part = body(figure)
    axes = part.subplots()
    start = [0.0] * len(rows)
    for column, label, colour, hatch in PARTS:
        share = [column.value(row) for row in rows]
        axes.barh(
            range(len(rows)), share, 0.75, start, color=colour, hatch=hatch, edgecolor="white", label=label
        )
        start = [a + b for a, b in zip(start, share, strict=True)]
    known = [(BEFORE.value(row), k) for k, row in enumerate(rows) if row.before is not None]
    label = "noticed before"
    share, place = [x for x, _ in known], [k for _, k in known]
    axes.plot(share, place, "D", color="black", markersize=4, label=label, clip_on=False)
    axes.set_yticks(
        range(len(rows)), [f"{row.words}  {RIGHT.value(row):.0f} %" for row in rows], fontsize=SMALL
    )
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set(xlim=(0, 100), xlabel="data sets with the fault [%]")
    quiet(axes)
    key(part, axes.get_legend_handles_labels(), columns=4)
    right, alarms = report.right, report.alarms
    say(
        figure,
        f"In {100 * right.share:.1f} % of {right.of} data sets with a fault the right doubt is first; "
        f"{100 * alarms.share:.1f} % of {alarms.of} sound ones are doubted",
        "A bar a fault, the fault that is named most seldom on top. Diamonds: noticed, not named, by the two "
        "checks before, where they apply (base's frame).",
    )
    return figure
