"""Error against noise, and against the distance of the instrument."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.studies.noise_sensitivity.instruments import FLAT
from testbench.studies.noise_sensitivity.report import Level, NoiseReport
from testbench.studies.noise_sensitivity.summary import PARTS
from testbench.studies.noise_sensitivity.tables import DISTANCE, RMS, SIGMA
from testbench.trials.spread import ends, grouped, middle
from testbench.views.colours import GREENS, GREY, NOMINAL, Look, look
from testbench.views.figure import SOFT, Line, draw_line, quiet
from testbench.views.schema import Column

SHADES = (GREENS[0], GREY, *GREENS[1:], NOMINAL)
"""Of the instruments, which are all read by one model; the second has flat weights."""
LINEAR_UM = 1.0  #: Errors below are drawn on a linear scale: without noise some are exact.


def sensitivity(report: NoiseReport) -> Figure:
    """Error against noise for both arms, and against distance for the instruments."""
    figure = Figure(figsize=(15, 5.2), layout="constrained")
    *left, right = figure.subplots(1, 3)
    for axes, (part, words) in zip(left, PARTS.items(), strict=True):
        for name, own in grouped(report.sweeps[part], lambda row: row.model).items():
            first = own[0]
            draw_line(axes, SIGMA, RMS, Line(own, look(first.structure, first.constraint, first.prior), name))
        axes.set_title(words, fontsize="medium")
        _finish(axes, SIGMA, report.sweeps[part])
    rows = [c for c in report.instruments if c.truth == "linear"]
    placed = grouped([c for c in rows if c.x > 0], lambda row: row.model)
    for k, (name, distances) in enumerate(placed.items()):
        draw_line(right, DISTANCE, RMS, Line(distances, Look(SHADES[k], k, prior=False), name))
    [flat] = [middle(c.rms_um) for c in rows if c.model == FLAT]
    right.axhline(flat, color=SOFT, linewidth=0.8)
    right.annotate(FLAT, (1, flat), xycoords=("axes fraction", "data"), ha="right", va="bottom", color=SOFT)
    right.set_title("laser tracker, MGCO56 with prior, KR 500, linear truth", fontsize="medium")
    _finish(right, DISTANCE, rows)
    figure.suptitle(
        f"What noise costs: medians, bands 5 to 95 %, of {report.trials['six_dof']}, "
        f"{report.trials['gravity']} and {report.trials['instrument_linear']} trials; dashed with prior",
        fontsize="medium",
    )
    return figure


def _finish(axes: Axes, x: Column, rows: Sequence[Level]) -> None:
    """Labels, legend and a logarithmic axis that goes down to no error at all."""
    axes.set_xlabel(f"{x.heading} [{x.unit}]")
    axes.set_ylabel(f"{RMS.heading} [{RMS.unit}]")
    axes.set_yscale("symlog", linthresh=LINEAR_UM)
    low = min(middle(row.rms_um) for row in rows)
    high = 1.2 * max(ends(row.rms_um)[1] for row in rows)
    steps = (1, 3) if high > 300 * max(low, LINEAR_UM) else (1, 2, 5)
    ticks = [0, *(tick for k in range(6) for tick in (step * 10**k for step in steps) if tick <= high)]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_yticks([], minor=True)
    axes.set_ylim(0 if low < LINEAR_UM else 0.7 * low, high)
    legend = axes.legend(frameon=False, fontsize="x-small", ncols=2, handlelength=4, loc="upper center")
    legend.set_bbox_to_anchor((0.5, -0.14))
    quiet(axes)
