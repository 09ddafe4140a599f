"""One bar a fault: how often the right doubt is first, another one is, or nothing is noticed."""

from matplotlib.figure import Figure

from testbench.report.table import Row
from testbench.views.colours import GREY, MEASURED, NOMINAL, hexadecimal
from testbench.views.figure import SMALL, body, key, page, quiet, say

PARTS = (
    ("right", "right doubt first", hexadecimal(NOMINAL), ""),
    ("other", "another doubt first", hexadecimal(MEASURED), "//"),
    ("silent", "not noticed", hexadecimal(GREY), ".."),
)
"""Words, colour and hatch of the parts of a bar."""


def bars(f: Row) -> Figure:
    """The fault that is named most seldom first is at the top; a black diamond is the incumbent."""
    rows = f.faults
    figure = page(1.9 + 0.23 * len(rows))
    part = body(figure)
    axes = part.subplots()
    shares = {
        "right": [row.right.share_percent for row in rows],
        "other": [row.other_percent for row in rows],
        "silent": [row.silent_percent for row in rows],
    }
    start = [0.0] * len(rows)
    for name, label, colour, hatch in PARTS:
        axes.barh(
            range(len(rows)),
            shares[name],
            0.75,
            start,
            color=colour,
            hatch=hatch,
            edgecolor="white",
            label=label,
        )
        start = [a + b for a, b in zip(start, shares[name], strict=True)]
    known = [(row.before_percent, k) for k, row in enumerate(rows) if row.before_percent is not None]
    share, place = [x for x, _ in known], [k for _, k in known]
    axes.plot(share, place, "D", color="black", markersize=4, label="noticed before", clip_on=False)
    axes.set_yticks(
        range(len(rows)), [f"{row.planted}  {row.right.share_percent:.0f} %" for row in rows], fontsize=SMALL
    )
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set(xlim=(0, 100), xlabel="data sets with the fault [%]")
    quiet(axes)
    key(part, axes.get_legend_handles_labels(), columns=4)
    right, alarms = f.right, f.alarms
    say(
        figure,
        f"In {right.share_percent:.1f} % of {right.of} data sets with a fault the right doubt is first; "
        f"{alarms.share_percent:.1f} % of {alarms.of} sound ones are doubted",
        "A bar a fault, the fault that is named most seldom on top. Diamonds: noticed, not named, by the two "
        "checks before, where they apply (base's frame).",
    )
    return figure
