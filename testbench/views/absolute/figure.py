"""Figure of a calibration: errors before and after, where in joint space they are, spectra of the joints."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from testbench.bench.absolute_report import AbsoluteReport, SpectrumRow
from testbench.bench.absolute_summary import Reported
from testbench.errors import Array
from testbench.views.colours import GCO, NOMINAL, hexadecimal
from testbench.views.figure import SIZES, SOFT, log_ticks, quiet

DRAWN, FOUND = hexadecimal(NOMINAL), hexadecimal(GCO)
FAINT = 0.3  #: Opacity of an order that is no more than scatter.
NAMED = 22  #: Letters of a name on an axis.


def overview(found: Reported) -> Figure:
    """Errors by series, spectra of the joints, errors over the joints' ranges."""
    report = found.report
    figure = Figure(figsize=(16, 6.2), layout="constrained")
    grid = figure.add_gridspec(1, 3, width_ratios=(1, 1.15, 1.1))
    left, centre, right = (figure.add_subfigure(grid[0, k]) for k in range(3))
    _series(left.subplots(), found)
    _spectra(centre, report)
    _places(right, report)
    before, after = report.total_before.mean_mm, report.total_after.mean_mm
    figure.suptitle(
        f"{report.arm}: {before:.3f} mm -> {after:.3f} mm mean over {report.total_after.n:,} positions",
        fontsize="large",
    )
    return figure


def _series(axes: Axes, found: Reported) -> None:
    """Of every series median, mean and the middle 90 % before and after."""
    rows, ends = found.report.series, []
    for y, row in enumerate(rows):
        for shift, colour, left, known, mark in (
            (-0.16, DRAWN, found.before[y], row.before, "s"),
            (0.16, FOUND, found.after[y], row.after, "o"),
        ):
            size = np.linalg.norm(left, axis=2)
            size = 1e3 * size[size > 0]
            low, high = np.percentile(size, (5, 95))
            ends += [low, high]
            axes.plot((low, high), (y + shift,) * 2, color=colour, linewidth=3, alpha=0.5)
            axes.plot(known.mean_mm, y + shift, mark, color=colour, markersize=10)
            axes.annotate(
                f"{known.mean_mm:.3f}",
                (known.mean_mm, y + shift),
                (0, -17 if shift > 0 else 9),
                textcoords="offset points",
                ha="center",
                color=colour,
            )
    axes.plot([], [], "s-", color=DRAWN, label="as drawn")
    axes.plot([], [], "o-", color=FOUND, label="calibrated")
    log_ticks(axes, "x", max(min(ends), 1e-6), max(ends))
    axes.set_yticks(range(len(rows)), [_short(row.series) for row in rows], rotation=90, va="center")
    axes.set_ylim(len(rows) - 0.5, -0.7)
    axes.set_xlabel("position error [mm]: mean, 5 to 95 % of the positions")
    axes.set_title("Error by series", fontsize="medium")
    axes.legend(frameon=False, fontsize="small", loc="upper center", ncols=2)
    quiet(axes)


def _spectra(figure: SubFigure, report: AbsoluteReport) -> None:
    """Amplitude by order, a joint a row; what is no more than scatter is faint."""
    if not report.spectrum:
        axes = figure.subplots()
        axes.axis("off")
        axes.text(0.5, 0.5, "joint errors declined", ha="center", transform=axes.transAxes, color=SOFT)
        return
    rows = np.atleast_1d(figure.subplots(len(report.spectrum), 1, sharex=True, sharey=True))
    top = max(one.amplitude_urad + one.deviation_urad for row in report.spectrum for one in row.orders)
    for axes, row in zip(rows, report.spectrum, strict=True):
        _spectrum(axes, row)
        axes.set_ylim(0, 1.05 * top)
    figure.suptitle("Periodic error of every joint [urad], faint: within 3 sd of none", fontsize="medium")
    rows[-1].set_xlabel("order, times a turn of the joint")


def _spectrum(axes: Axes, row: SpectrumRow) -> None:
    order, amplitude, deviation = np.array(
        [(one.order, one.amplitude_urad, one.deviation_urad) for one in row.orders]
    ).T
    sure = np.array([one.significant for one in row.orders])
    for own, alpha in ((sure, 1.0), (~sure, FAINT)):
        axes.bar(order[own], amplitude[own], color=FOUND, alpha=alpha, width=0.8)
    axes.vlines(order, amplitude - deviation, amplitude + deviation, color=SOFT, linewidth=0.8)
    axes.text(1, 0.95, _short(row.joint), transform=axes.transAxes, ha="right", va="top", fontsize="small")
    quiet(axes)


def _places(figure: SubFigure, report: AbsoluteReport) -> None:
    """RMS error of the calibrated arm over the range of every joint; where nothing was read is hatched."""
    axes = figure.subplots()
    joints = list(dict.fromkeys(row.joint for row in report.places))
    own = [[row for row in report.places if row.joint == name] for name in joints]
    values: Array = np.array([[row.after_mm or np.nan for row in rows] for rows in own])
    axes.set_facecolor("0.93")
    axes.pcolor(np.zeros_like(values), hatch="////", cmap="Greys", edgecolor="0.75", linewidth=0)
    shown = axes.pcolormesh(np.ma.masked_invalid(values), cmap=SIZES, vmin=0)
    figure.colorbar(shown, ax=axes, label="RMS error, calibrated [mm]", location="bottom", shrink=0.8)
    axes.set_yticks(np.arange(len(joints)) + 0.5, [_short(name) for name in joints], fontsize="small")
    axes.invert_yaxis()
    axes.set_xticks([])
    for y, rows in enumerate(own):
        for x, value, side in ((0, rows[0].low, "left"), (values.shape[1], rows[-1].high, "right")):
            text = f"{value:.0f} {rows[0].unit}"
            axes.text(x, y + 0.97, text, ha=side, va="bottom", fontsize="x-small", color="white").set_bbox(
                {"facecolor": "0.3", "edgecolor": "none", "pad": 1, "alpha": 0.6}
            )
    axes.set_title("Where in its range; hatched: not read", fontsize="medium")
    axes.spines[:].set_visible(False)


def _short(name: str) -> str:
    return name if len(name) <= NAMED else f"{name[: NAMED - 1]}…"
