"""Who decides every parameter: the data or the prior."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from testbench.views.colours import GCO, hexadecimal
from testbench.views.figure import SMALL, SOFT, body, key, page, say, short
from testbench.views.identifiability.report import Parameter, Seen

DIAGONAL = ("stretch", "deflection\ny", "deflection\nz", "torsion", "rotation\ny", "rotation\nz")
DATA = hexadecimal(GCO)
LETTER = 0.12  #: Width of a letter of a name.
PRIOR_ALPHA = 0.35  #: The prior is the lighter grey, so that green stands out.
CELL, NARROW, GAP = 0.9, 0.26, 0.35
"""Widths of a cell, of that of a coupling, and of the space between groups."""
HEIGHT = 0.78
COUPLINGS = [(a, b) for b in range(1, 7) for a in range(1, b)]


def shares(seen: Seen) -> Figure:
    """A row a link, a cell a parameter; green is filled by the data, grey is left to the prior."""
    rows = [block.component for block in seen.blocks]
    figure = page(2.0 + 0.45 * len(rows))
    part = body(figure)
    axes = part.subplots()
    for k, component in enumerate(rows):
        _row(axes, -k, [p for p in seen.parameters if p.component == component])
    start = _left((1, 2))
    end = start + NARROW * len(COUPLINGS)
    columns = [(*_left_width((i + 1, i + 1)), text) for i, text in enumerate(DIAGONAL)]
    for left, width, text in [*columns, (start, end - start, "couplings")]:
        axes.text(left + width / 2, 1.0, text, ha="center", va="bottom", fontsize=SMALL)
    for k, block in enumerate(seen.blocks):
        middle = HEIGHT / 2 - k
        axes.text(-0.75, middle, short(block.component), ha="right", va="center")
        share = f"{100 * block.data_share:.0f} %"
        axes.text(-0.12, middle, share, ha="right", va="center", color=DATA)
    axes.set_yticks([])
    axes.set_xticks([])
    axes.set_xlim(-0.8 - LETTER * max(len(short(name)) for name in rows), end + 0.1)
    axes.set_ylim(0.6 - len(rows), 1.75)
    axes.spines[:].set_visible(False)
    known = [
        Patch(color=DATA, label="the data tell"),
        Patch(color=SOFT, alpha=PRIOR_ALPHA, label=f"the prior tells ({seen.prior})"),
    ]
    key(part, (known, [str(patch.get_label()) for patch in known]), columns=2)
    decided = sum(p.decided_by == "prior" for p in seen.parameters)
    say(
        figure,
        f"{seen.structure}: the runs see {seen.seen} of {seen.unknowns} directions; the prior decides "
        f"{decided} entries",
        f"Not seen: {seen.lost_to_structure} for the structure, {seen.lost_to_loads} for these loads, "
        f"{seen.lost_to_poses} for too few poses. A cell is an entry of the compliance; per cent: of all of "
        "a link or joint, told by the data.",
    )
    return figure


def _left(entry: tuple[int, int]) -> float:
    a, b = entry
    if a == b:
        return a - 1.0
    return 6 + GAP + NARROW * COUPLINGS.index((min(entry), max(entry)))


def _left_width(entry: tuple[int, int]) -> tuple[float, float]:
    return _left(entry), CELL if entry[0] == entry[1] else 0.85 * NARROW


def _row(axes: Axes, bottom: float, parameters: Sequence[Parameter]) -> None:
    for p in parameters:
        # a joint has one entry: a bar over the six columns of the diagonal
        left, width = _left_width(p.entry) if p.entry else (0.0, 5 + CELL)
        axes.add_patch(Rectangle((left, bottom), width, HEIGHT, color=SOFT, alpha=PRIOR_ALPHA, linewidth=0))
        share = p.data_share
        filled = (width, share * HEIGHT) if p.entry else (share * width, HEIGHT)
        axes.add_patch(Rectangle((left, bottom), *filled, color=DATA, linewidth=0))
