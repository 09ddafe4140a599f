"""Figures of fits: residuals, predictions, eigenvalues, sag by part, what readings tell, joint stiffness.

Every pane draws rows of report.json, as `workflows.fit_details` makes them, and nothing else.
"""

import math
from collections.abc import Mapping, Sequence
from statistics import NormalDist

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.identify.certify import LENGTH
from testbench.report.colours import GREY, LINK, NEGATIVE, NOMINAL, Look, hexadecimal
from testbench.report.figure import MIN_LETTER_SIZE, SOFT, log_ticks, page, quiet, say, tick_words
from testbench.report.markdown import listed
from testbench.runs.rows import Row

REJECTED = 0.05  #: Level of the test of normality [1].
SPAN = 6.0  #: Decades of eigenvalues that an axis shows on either side of zero.
EIGENVALUE, TOLD = "eigenvalue [µrad/(N m)]", "readings over prior"
LEAST_TOLD = 1e-4  #: Singular values below this are drawn at it.


def residual_pane(axes: Axes, row: Row, name: str, look: Look) -> None:
    """Draw components of residuals as bars with the normal curve of their mean and deviation, as Fig. 5.

    Args:
        axes: Where to.
        row: See `fit_details.residual_histogram`.
        name: Of the model.
        look: How it is drawn.
    """
    edges, counts = np.array(row.edges_um), np.array(row.counts)
    axes.stairs(counts, edges, fill=True, color=look.hex, alpha=0.35)
    axes.stairs(counts, edges, color=look.hex, linewidth=0.8)
    said = f"n {row.n}, mean {round(row.mean_um) + 0:d} µm"
    if row.deviation_um:
        x = np.linspace(edges[0], edges[-1], 201)
        curve = NormalDist(row.mean_um, row.deviation_um)
        area = row.n * (edges[1] - edges[0])
        axes.plot(x, [area * curve.pdf(at) for at in x.tolist()], color="0.2", linewidth=1.0, label="normal")
        said += f"\ndeviation {row.deviation_um:.0f} µm\nLilliefors p {_share(row.lilliefors_p)}:\n"
        said += "not normal" if row.lilliefors_p < REJECTED else "normality holds"
    axes.text(
        0.02, 0.98, said, transform=axes.transAxes, va="top", ha="left", fontsize=MIN_LETTER_SIZE, color="0.2"
    )
    axes.set(xlabel="residual [µm]", ylabel="components", ylim=(0, 1.45 * max(1, int(counts.max()))))
    axes.set_title(name)
    quiet(axes)


def _share(p: float) -> str:
    """Write a p value: two digits, none below a thousandth."""
    return "< 0.001" if p < 1e-3 else f"{p:.3f}" if p < 0.1 else f"{p:.2f}"


def predicted_pane(axes: Axes, row: Row, looks: Mapping[str, Look], measured: str = "measured") -> None:
    """Draw predicted against measured lengths of deflections; a model that predicts all lies on the line.

    Args:
        axes: Where to.
        row: See `fit_details.predictions`.
        looks: Of the models that are drawn, by name, the last one on top.
        measured: What predictions are set beside.
    """
    x = np.array(row.measured_mm)
    for k, (name, look) in enumerate(looks.items()):
        y = row.predicted_mm[name]
        axes.plot(x, y, linestyle="", label=name, alpha=0.8, zorder=2 + k, **look.dots(2.6))
    low, high = x.min(), x.max()
    room = 0.05 * (high - low) or 1.0
    ends = (low - room, high + room)
    axes.plot(ends, ends, color=SOFT, linewidth=0.8, zorder=1)
    axes.set(xlabel=f"{measured} deflection [mm]", ylabel="predicted [mm]")
    axes.legend(frameon=False, fontsize=MIN_LETTER_SIZE, loc="upper left", handletextpad=0.2)
    quiet(axes)


def eigenvalue_pane(axes: Axes, rows: Sequence[Row], name: str, look: Look, *, named: bool = True) -> None:
    """Draw the eigenvalues of every part's compliance; negative ones are red crosses on a red ground.

    A part of a conservative model has none below zero (Eqs. 8-9).

    Args:
        axes: Where to.
        rows: See `fit_details.eigenvalues`.
        name: Of the model.
        look: How it is drawn.
        named: Whether the parts are named beside it.
    """
    values = [np.array(row.urad_per_Nm) for row in rows]
    every = np.concatenate(values)
    most = float(np.abs(every).max()) or 1.0
    least = 10 ** (math.floor(math.log10(most)) - SPAN + 1)
    axes.set_xscale("symlog", linthresh=least, linscale=0.6)
    for y, own in enumerate(values):
        good, bad = own[own >= 0], own[own < 0]
        axes.plot(good, np.full(len(good), y), linestyle="", **look.dots(3.4))
        axes.plot(bad, np.full(len(bad), y), "X", color=hexadecimal(NEGATIVE), markersize=5, zorder=4)
    lowest = min(-least, 3 * float(every.min()))
    axes.axvspan(lowest, 0, color=hexadecimal(NEGATIVE), alpha=0.08, linewidth=0, zorder=0)
    axes.axvline(0, color="0.3", linewidth=0.8)
    axes.set(xlim=(lowest, 3 * most), ylim=(len(rows) - 0.5, -0.5), xlabel=EIGENVALUE)
    count = int((every < 0).sum())
    axes.set_title(f"{name}: {f'{count} of {len(every)} negative' if count else 'none negative'}")
    ends = (least * 10, most) if lowest == -least else (least * 10, most, lowest)
    axes.set_xticks(*_symlog_ticks(ends))
    axes.set_xticks([], minor=True)
    axes.set_yticks(range(len(rows)), [row.part if named else "" for row in rows])
    axes.grid(axis="y", alpha=0.2, linewidth=0.5)
    quiet(axes)


def _symlog_ticks(ends: Sequence[float]) -> tuple[list[float], list[str]]:
    """Place powers of ten from the least to the greatest, zero, and one below it where something is."""
    low, high, *below = ends
    first, last = math.ceil(math.log10(low)), math.floor(math.log10(high))
    powers = range(last, first - 1, -2)
    ticks = [0.0, *sorted(10.0**k for k in powers)]
    if below:
        ticks = [-(10.0 ** math.floor(math.log10(-below[0]))), *ticks]
    return ticks, [f"−{tick_words(-tick)}" if tick < 0 else tick_words(tick) for tick in ticks]


def sag_pane(axes: Axes, rows: Sequence[Row]) -> None:
    """Draw by what share each link and joint moves the load, the largest on top; whiskers: all runs.

    Args:
        axes: Where to.
        rows: See `fit_details.sag_by_part`.
    """
    at = np.arange(len(rows))
    share = np.array([row.share_percent for row in rows])
    joints = [not row.part.startswith("link") for row in rows]
    colours = [hexadecimal(NOMINAL if joint else LINK) for joint in joints]
    axes.barh(at, share, color=colours, height=0.7)
    for y, row in zip(at.tolist(), rows, strict=True):
        axes.plot((row.least_percent, row.most_percent), (y, y), color="0.2", linewidth=0.8)
    most = max((row.most_percent for row in rows), default=1.0)
    for y, row in zip(at.tolist(), rows, strict=True):
        end = max(row.most_percent, row.share_percent, 0)
        axes.text(end + 0.02 * most, y, f"{row.share_percent:.0f} %", va="center", fontsize=MIN_LETTER_SIZE)
    axes.set_yticks(at, [row.part for row in rows])
    axes.set(ylim=(len(rows) - 0.4, -0.6), xlabel="share of the load's deflection [%]")
    low = min(0.0, min((row.least_percent for row in rows), default=0.0))
    axes.set_xlim(1.1 * low, 1.18 * most)
    axes.set_title("Which part bends: median, range")
    quiet(axes)


def singular_pane(axes: Axes, values: Sequence[float]) -> None:
    """Draw singular values of the readings over the prior: above the line readings decide, below the prior.

    Args:
        axes: Where to.
        values: See `fit_details.singular_values`, the largest first.
    """
    s = np.maximum(np.array(values), LEAST_TOLD)
    k = np.arange(1, len(s) + 1)
    told = int((s > 1).sum())
    axes.fill_between(
        k[: max(told, 1)], 1, s[: max(told, 1)], color=hexadecimal(NOMINAL), alpha=0.2, linewidth=0
    )
    axes.plot(k, s, ".", color=hexadecimal(NOMINAL), markersize=3)
    axes.axhline(1, color=SOFT, linewidth=0.8, linestyle="--")
    log_ticks(axes, "y", float(s.min()), max(1.0, float(s.max())))
    axes.set(xlabel="direction of the unknowns", ylabel=TOLD, xlim=(0, len(s) + 1))
    axes.set_title(f"Readings decide {told} of {len(s)} directions")
    quiet(axes)


def stiffness_pane(axes: Axes, rows: Sequence[Row]) -> None:
    """Draw every joint's stiffness as assumed, grey, and as identified, with 95 % intervals.

    Args:
        axes: Where to.
        rows: See `fit_details.joint_stiffness`; all of one unit.
    """
    known = [end for row in rows for own in (row.prior, row.posterior) for end in own.values() if end]
    low, high = min(known), max(known)
    for y, row in enumerate(rows):
        for own, aside, colour, mark in (
            (row.prior, -0.17, hexadecimal(GREY), "s"),
            (row.posterior, 0.17, hexadecimal(NOMINAL), "o"),
        ):
            ends = (own.low or low / 10, own.high or 10 * high)
            axes.plot(ends, (y + aside, y + aside), color=colour, linewidth=1.6)
            axes.plot(own.middle, y + aside, mark, color=colour, markersize=3.6)
    log_ticks(axes, "x", low, high)
    axes.plot([], [], "s-", color=hexadecimal(GREY), markersize=3.6, label="the arm's folder, ±30 %")
    axes.plot([], [], "o-", color=hexadecimal(NOMINAL), markersize=3.6, label="identified")
    axes.set_yticks(range(len(rows)), [row.joint for row in rows])
    axes.set(ylim=(len(rows) - 0.5, -0.5), xlabel=f"stiffness [{rows[0].unit}]")
    axes.legend(
        frameon=False, fontsize=MIN_LETTER_SIZE, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2
    )
    axes.set_title("Joint with the link before it, 95 % intervals")
    quiet(axes)


def residual_figure(
    details: Row, looks: Mapping[str, Look], pair: Sequence[str], predicted: Sequence[str], against: str
) -> Figure:
    """Draw residuals of two models with normal curves, as Fig. 5, and predicted against true deflections.

    Args:
        details: `residuals` and `predictions` of `workflows.fit_details`.
        looks: Of all models, by name.
        pair: Models whose residuals are drawn; those that are not there are left out.
        predicted: The same of predictions, the best last.
        against: What predictions are set beside, such as "true".
    """
    rows = {row.name: row for row in details.residuals}
    known = [name for name in pair if name in rows] or [*rows][:2]
    drawn = [name for name in predicted if name in details.predictions.predicted_mm]
    figure = page(2.5)
    panes = figure.subplots(1, len(known) + 1)
    for axes, name in zip(panes, known, strict=False):
        residual_pane(axes, rows[name], name, looks[name])
    predicted_pane(panes[-1], details.predictions, {name: looks[name] for name in drawn}, against)
    panes[-1].set_title("Predicted against " + against)
    normal = [name for name in known if (rows[name].lilliefors_p or 0) >= REJECTED]
    answer = f"Normally distributed residuals (Lilliefors' test): {listed(normal) or 'of no model'}"
    reading = (
        "Left: components of residuals, reading minus model, with the normal curve of their mean and "
        f"deviation; a p below {REJECTED:g} rejects normality. Right: a mark for each target; all marks of a "
        "perfect model lie on the line."
    )
    say(figure, answer, reading)
    return figure


def eigenvalue_figure(details: Row, looks: Mapping[str, Look], names: Sequence[str]) -> Figure:
    """Draw the eigenvalues of every part's compliance, a pane for each model: which are conservative.

    Args:
        details: `eigenvalues` of `workflows.fit_details`, by model.
        looks: Of all models, by name.
        names: Models from left to right; those that are not there are left out.
    """
    shown = {name: details.eigenvalues[name] for name in names if name in details.eigenvalues}
    parts = max(len(rows) for rows in shown.values())
    figure = page(1.15 + 0.15 * parts)
    for k, (axes, (name, rows)) in enumerate(
        zip(figure.subplots(1, len(shown), squeeze=False)[0], shown.items(), strict=True)
    ):
        eigenvalue_pane(axes, rows, name, looks[name], named=not k)
    bad = {name: sum(x < 0 for row in rows for x in row.urad_per_Nm) for name, rows in shown.items()}
    told = [f"{name} ({n} negative)" for name, n in bad.items() if n]
    answer = f"Not conservative: {', '.join(told)}" if told else "All of these models are conservative"
    say(figure, answer, OF_EIGENVALUES)
    return figure


OF_EIGENVALUES = (
    "Eigenvalues of the compliance of every link, and the compliance of every joint; a translation counts as "
    f"the rotation on an arm of {LENGTH:g} m. A part with a negative eigenvalue, a red cross, would move "
    "against its load, which no body does."
)
