"""Figure of a calibration: errors before and after, where in joint space they are, spectra of the joints."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import MaxNLocator

from testbench.bench.absolute_report import AbsoluteReport, SpectrumRow
from testbench.bench.absolute_summary import Reported
from testbench.errors import Array
from testbench.views.colours import GCO, NOMINAL, hexadecimal
from testbench.views.figure import SIZES, SMALL, SOFT, log_ticks, page, quiet, say, short

DRAWN, FOUND = hexadecimal(NOMINAL), hexadecimal(GCO)
FAINT = 0.3  #: Opacity of an order that is no more than scatter.


def overview(found: Reported) -> Figure:
    """Errors by series, spectra of the joints, errors over the joints' ranges."""
    report = found.report
    figure = page(11.0)
    above, below = figure.subfigures(2, 1)  # type: ignore[misc]  # stubs: one or several
    left, right = above.subplots(1, 2, width_ratios=(1, 1.1))
    _series(left, found)
    _places(right, above, report)
    _spectra(below, report)
    before, after = report.total_before.mean_mm, report.total_after.mean_mm
    say(
        figure,
        f"{report.arm}: the mean error of {report.total_after.n:,} positions falls from {before:.3f} mm to "
        f"{after:.3f} mm",
        "Left: means, lines: 5 to 95 % of the positions. Right: RMS errors of the calibrated arm where a "
        "joint stood in its range, from end to end; hatched: nothing read. Below: faint bars are within 3 "
        "standard deviations of none.",
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
    axes.set_yticks(range(len(rows)), [short(row.series) for row in rows], rotation=90, va="center")
    axes.set_ylim(len(rows) - 0.5, -0.7)
    axes.set_xlabel("position error [mm]")
    axes.set_title("Error by series", fontsize="medium")
    axes.legend(frameon=False, fontsize=SMALL, loc="upper center", ncols=2)
    quiet(axes)


def _spectra(figure: SubFigure, report: AbsoluteReport) -> None:
    """Amplitude by order, a joint a row; what is no more than scatter is faint."""
    if not report.spectrum:
        axes = figure.subplots()
        axes.axis("off")
        axes.text(0.5, 0.5, "joint errors declined", ha="center", transform=axes.transAxes, color=SOFT)
        return
    down = -(-len(report.spectrum) // 2)
    grid = figure.subplots(down, 2, sharex=True, sharey=True, squeeze=False)
    rows = grid.T.flat[: len(report.spectrum)]
    top = max(one.amplitude_urad + one.deviation_urad for row in report.spectrum for one in row.orders)
    for axes, row in zip(rows, report.spectrum, strict=True):
        _spectrum(axes, row)
        axes.set_ylim(0, 1.05 * top)
    for axes in grid.T.flat[len(report.spectrum) :]:
        axes.axis("off")
    figure.suptitle("Periodic error of every joint by order", fontsize="medium")
    figure.supylabel("amplitude [urad]", fontsize="medium")
    for axes in grid[-1]:
        axes.set_xlabel("order, periods a turn")


def _spectrum(axes: Axes, row: SpectrumRow) -> None:
    order, amplitude, deviation = np.array(
        [(one.order, one.amplitude_urad, one.deviation_urad) for one in row.orders]
    ).T
    sure = np.array([one.significant for one in row.orders])
    for own, alpha in ((sure, 1.0), (~sure, FAINT)):
        axes.bar(order[own], amplitude[own], color=FOUND, alpha=alpha, width=0.8)
    axes.vlines(order, amplitude - deviation, amplitude + deviation, color=SOFT, linewidth=0.8)
    axes.text(1, 0.95, short(row.joint), transform=axes.transAxes, ha="right", va="top", fontsize=SMALL)
    quiet(axes)


def _places(axes: Axes, figure: SubFigure, report: AbsoluteReport) -> None:
    """RMS error of the calibrated arm over the range of every joint; where nothing was read is hatched."""
    joints = list(dict.fromkeys(row.joint for row in report.places))
    own = [[row for row in report.places if row.joint == name] for name in joints]
    values: Array = np.array([[row.after_mm or np.nan for row in rows] for rows in own])
    axes.set_facecolor("0.93")
    axes.pcolor(np.zeros_like(values), hatch="////", cmap="Greys", edgecolor="0.75", linewidth=0)
    shown = axes.pcolormesh(np.ma.masked_invalid(values), cmap=SIZES, vmin=0)
    figure.colorbar(
        shown, ax=axes, label="RMS error [mm]", location="bottom", shrink=0.8, ticks=MaxNLocator(5)
    )
    axes.set_yticks(np.arange(len(joints)) + 0.5, [short(name) for name in joints], fontsize=SMALL)
    axes.invert_yaxis()
    axes.set_xticks([])
    for y, rows in enumerate(own):
        for x, value, side in ((0, rows[0].low, "left"), (values.shape[1], rows[-1].high, "right")):
            text = f"{value:.0f} {rows[0].unit}"
            axes.text(x, y + 0.97, text, ha=side, va="bottom", fontsize=SMALL, color="white").set_bbox(
                {"facecolor": "0.3", "edgecolor": "none", "pad": 1, "alpha": 0.6}
            )
    axes.set_title("Error by place in a joint's range", fontsize="medium")
    axes.spines[:].set_visible(False)
