"""Figures of studies: coverage of intervals, error against time, errors of joints against their angle.

Every figure draws rows of report.json and nothing else.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from testbench.report.colours import NOMINAL, SERIES, Look, hexadecimal
from testbench.report.figure import (
    MIN_LETTER_SIZE,
    SOFT,
    log_ticks,
    page,
    quiet,
    say,
    short,
)
from testbench.report.markdown import listed
from testbench.runs.rows import Row
from testbench.runs.spread import middle

KINDS = {
    "linearised": "no prior, noise only",
    "bootstrap": "no prior, noise only",
    "posterior": "prior as assumed",
    "set": "prior as assumed",
    "learnt": "wrong prior, other arms",
    "believed": "wrong prior, other arms",
}
"""Panes by the kind of intervals."""
MARKS = "osD^vP*X"
DEVIATIONS = 2.0  #: Standard errors that a whisker of a coverage has on each side.
JOINTS_ACROSS = 3  #: Joints side by side.


def coverage_figure(rows: Sequence[Row]) -> Figure:
    """Draw actual against nominal coverage of every kind of intervals; true ones lie on the diagonal.

    Args:
        rows: Of each kind of intervals its `interval`, `kind`, `nominal_percent`, `actual_percent` and
            `actual_error_percent`; a kind that is known at one level has its `confidence`, `covered_percent`
            and `standard_error_percent`.
    """
    panes: dict[str, list[Row]] = {}
    for row in rows:
        panes.setdefault(KINDS[row.kind], []).append(row)
    lines = max(map(len, panes.values()))
    figure = page(2.6 + 0.15 * lines)
    for axes, (title, own) in zip(
        figure.subplots(1, len(panes), squeeze=False)[0], panes.items(), strict=True
    ):
        for k, row in enumerate(own):
            x, y, error = _levels(row)
            style = {"color": hexadecimal(SERIES[k % len(SERIES)]), "markersize": 3.4, "linewidth": 1.0}
            axes.plot(x, y, f"{MARKS[k % len(MARKS)]}-", label=short(row.interval, 44), **style)
            for at, middle_, half in zip(x, y, error, strict=True):
                ends = (middle_ - DEVIATIONS * half, middle_ + DEVIATIONS * half)
                axes.plot((at, at), ends, color=style["color"], linewidth=0.8)
        low = min(40.0, axes.dataLim.y0 - 2)
        axes.plot((0, 100), (0, 100), color=SOFT, linewidth=0.8, zorder=1)
        axes.set(xlim=(40, 101), ylim=(low, 101), xlabel="nominal coverage [%]")
        axes.set_title(title)
        axes.legend(
            frameon=False,
            fontsize=MIN_LETTER_SIZE,
            loc="upper center",
            bbox_to_anchor=(0.5, -0.18),
            handlelength=1.5,
        )
        quiet(axes)
    figure.axes[0].set_ylabel("actual coverage [%]")
    learnt = [row.covered_percent for row in rows if row.kind == "learnt"]
    answer = "How often intervals hold the truth"
    if learnt:
        shares = dict.fromkeys(f"{share:.0f}" for share in (min(learnt), max(learnt)))
        answer = f"Intervals of 95 % by a learnt prior hold {' to '.join(shares)} % of the deflections"
    reading = (
        "Above the line intervals are too wide, below it too narrow. Whiskers: two standard errors over "
        "datasets."
    )
    say(figure, answer, reading)
    return figure


def _levels(row: Row) -> tuple[list[float], list[float], list[float]]:
    """Nominal and actual coverage with its standard error, at all levels that are known [%]."""
    if row.nominal_percent:
        return row.nominal_percent, row.actual_percent, row.actual_error_percent
    return [100 * row.confidence], [row.covered_percent], [row.standard_error_percent or 0.0]


def cost_figure(rows: Sequence[Row], looks: Mapping[str, Look], error: str) -> Figure:
    """Draw the error of every estimator against its time; the title names those that none beats in both.

    Args:
        rows: Estimators by `name`, their `ratio` of errors with the ends of its interval `ratio_low` and
            `ratio_high`, and `cpu_seconds`.
        looks: By name.
        error: What the ratio is.
    """
    known = {row.name: (middle(row.cpu_seconds), row.ratio) for row in rows if middle(row.cpu_seconds) > 0}
    best = [
        name
        for name, (t, e) in known.items()
        if not any(b <= t and a <= e and (b, a) != (t, e) for b, a in known.values())
    ]
    figure = page(2.9)
    axes = figure.subplots()
    for row in rows:
        if row.name in known:
            at, _ = known[row.name]
            axes.plot((at, at), (row.ratio_low, row.ratio_high), color=looks[row.name].hex, linewidth=1.2)
            axes.plot(at, row.ratio, linestyle="", label=row.name, **looks[row.name].dots(4.5))
    front = np.array(sorted(known[name] for name in best))
    axes.plot(*front.T, ":", color=SOFT, linewidth=0.8, zorder=1)
    log_ticks(axes, "x", *axes.dataLim.intervalx)
    log_ticks(axes, "y", *axes.dataLim.intervaly)
    axes.legend(
        frameon=False,
        fontsize=MIN_LETTER_SIZE,
        loc="upper left",
        bbox_to_anchor=(1.0, 1.02),
        handletextpad=0.2,
    )
    axes.set(xlabel="CPU time of a fit [s]", ylabel=error)
    quiet(axes)
    answer = f"No other is both faster and better than {listed(best, 'or')}"
    say(figure, answer, "Dotted: from the fastest to the best; lines: 95 % intervals; filled: with a prior.")
    return figure


def joint_error_figure(rows: Sequence[Row]) -> Figure:
    """Draw the periodic error of every joint against its angle, with its 95 % band.

    Args:
        rows: Of each joint its name `joint` and a `curve` of `angle_deg`, `error_urad` and `half_urad`.
    """
    down = -(-len(rows) // JOINTS_ACROSS)
    figure = page(0.75 + 1.45 * down)
    panes = figure.subplots(down, min(JOINTS_ACROSS, len(rows)), squeeze=False, sharey=True)
    colour = hexadecimal(NOMINAL)
    for axes, row in zip(panes.flat, rows, strict=False):
        x, y, half = (np.array(row.curve[key]) for key in ("angle_deg", "error_urad", "half_urad"))
        axes.fill_between(x, y - half, y + half, color=colour, alpha=0.25, linewidth=0)
        axes.plot(x, y, color=colour, linewidth=1.0)
        axes.axhline(0, color=SOFT, linewidth=0.6)
        axes.set(xlim=(x[0], x[-1]))
        axes.set_title(f"{short(row.joint)}: {row.rms_urad:.0f} µrad RMS")
        quiet(axes)
    for axes in panes.flat[len(rows) :]:
        axes.set_visible(False)
    for axes in panes[:, 0]:
        axes.set_ylabel("error [µrad]")
    for k, axes in enumerate(panes.flat[: len(rows)]):
        if k + JOINTS_ACROSS >= len(rows):
            axes.set_xlabel("joint angle [deg]")
    worst = max(rows, key=lambda row: row.rms_urad)
    say(
        figure,
        f"Periodic joint errors: {worst.joint} errs most, {worst.rms_urad:.0f} µrad RMS",
        "Sum of all orders over the measured range, with its 95 % interval at each angle.",
    )
    return figure
