"""Figures of fits: residuals, predictions, eigenvalues, sag by part, what readings tell, joint stiffness.

Every pane draws rows of report.json, as `workflows.fit_numbers` makes them, and nothing else.

The figures of `testbench identify`: which model to take, how it fits, and what it says of the arm.

Figures of studies: coverage of intervals, error against time, errors of joints against their angle.

Every figure draws rows of report.json and nothing else.
"""

import math
from collections.abc import Mapping, Sequence
from statistics import NormalDist

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, SymLogNorm

from testbench.errors import Array
from testbench.identify.conic import LEVER_LENGTH
from testbench.report.colours import (
    GREY,
    LINK,
    MEASURED,
    NEGATIVE,
    NOMINAL,
    SERIES,
    Look,
    hexadecimal,
    look_of,
)
from testbench.report.figure import (
    MIN_LETTER_SIZE,
    RATIO,
    SOFT,
    Figure,
    bands,
    few_ticks,
    for_column,
    forest_height,
    forest_pane,
    log_ticks,
    page,
    quiet,
    row_head,
    say,
    short,
    tick_words,
)
from testbench.report.markdown import ReportWords, as_plain, capital, counted, listed
from testbench.report.run_figure import CHART, FOREST, HEAD, headline, model_forest, run_chart
from testbench.report.scene import PageContent
from testbench.report.schema import Table, TableColumn
from testbench.runs.rows import Row
from testbench.runs.spread import middle
from testbench.workflows.fit_numbers import COMPLIANCES
from testbench.workflows.model_names import in_words, row_words
from testbench.workflows.models import JOINTS_ONLY

# --- Figures of fits ----------------------------------------------------------------------------------------

REJECTED = 0.05  #: Level of the test of normality [1].
REACH = 1.05  #: Ends of the axis of residuals over the largest that is drawn [1].
AXES = "x", "y", "z", "rot x", "rot y", "rot z"  #: Rows of a compliance, in the link's frame.
SIGNS = LinearSegmentedColormap.from_list(
    "signs", [hexadecimal(NOMINAL), "white", hexadecimal(MEASURED)]
).with_extremes(bad="0.7")
"""Colours of signed numbers: blue below zero, white, rust above; what is not there is grey."""
GAP = 0.93, 0.93, 0.93, 1.0  #: Between links in the strip of all.
LINEAR_COMPLIANCE, MOST_COMPLIANCE, PALE_COMPLIANCE = 0.1, 10.0, 1.5
"""Share of the reference up to which colours are linear, where they end, and where letters are white."""
TICKS_COMPLIANCE = -10, -1, -0.1, 0, 0.1, 1, 10
STEP, MANY_LINKS = 7, 9  #: From one link to the next in the strip of all [entries]; links that make it flat.
SPAN = 6.0  #: Decades of eigenvalues that an axis shows on either side of zero.
EIGENVALUE, TOLD = "eigenvalue [µrad/(N m)]", "readings over prior"
LEAST_TOLD = 1e-4  #: Singular values below this are drawn at it.


def residual_panes(panes: Sequence[Axes], rows: Sequence[Row], looks: Mapping[str, Look]) -> None:
    """Draw residuals of models side by side, all over the same range.

    Args:
        panes: Where to, a pane for each row.
        rows: See `fit_numbers.residual_histograms`.
        looks: How models are drawn, by name.
    """
    reach = max((row.edges_um[-1] for row in rows), default=1.0)
    for axes, row in zip(panes, rows, strict=True):
        _residual_pane(axes, row, looks[row.name])
        axes.set_xlim(-REACH * reach, REACH * reach)  # heights do not compare: bins differ


def _residual_pane(axes: Axes, row: Row, look: Look) -> None:
    """Draw components of residuals as bars with the normal curve of their mean and deviation, as Fig. 5."""
    edges, counts = np.array(row.edges_um), np.array(row.counts)
    most = float(max(1, counts.max()))
    axes.stairs(counts, edges, fill=True, color=look.hex, alpha=0.35)
    axes.stairs(counts, edges, color=look.hex, linewidth=0.8)
    said = f"n {row.n}, mean {round(row.mean_um) + 0:d} µm".replace("-", "−")
    if row.deviation_um:
        x = np.linspace(edges[0], edges[-1], 201)
        curve = NormalDist(row.mean_um, row.deviation_um)
        area = row.n * (edges[1] - edges[0])
        expected = [area * curve.pdf(at) for at in x.tolist()]
        axes.plot(x, expected, color="0.2", linewidth=1.0, label="normal")
        most = max(most, *expected)
        said += f"\ndeviation {row.deviation_um:.0f} µm\nLilliefors p {_share(row.lilliefors_p)}:\n"
        said += "not normal" if row.lilliefors_p < REJECTED else "normality not rejected"
    axes.text(
        0.02, 0.98, said, transform=axes.transAxes, va="top", ha="left", fontsize=MIN_LETTER_SIZE, color="0.2"
    )
    axes.set(xlabel="residual [µm]", ylabel="number of components", ylim=(0, 1.75 * most))
    few_ticks(axes.xaxis, axes.yaxis)
    axes.set_title(row_head(row.name))
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
        words = in_words(name).removeprefix("the ")
        axes.plot(x, y, linestyle="", label=words, alpha=0.8, zorder=2 + k, **look.dots(2.6))
    low, high = x.min(), x.max()
    room = 0.05 * (high - low) or 1.0
    ends = (low - room, high + room)
    axes.plot(ends, ends, color=SOFT, linewidth=0.8, zorder=1)
    axes.set(xlabel=f"{measured} deflection [mm]", ylabel="predicted [mm]")
    few_ticks(axes.xaxis, axes.yaxis)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), handletextpad=0.2)
    quiet(axes)


def eigenvalue_panes(
    panes: Sequence[Axes], by_name: Mapping[str, Sequence[Row]], looks: Mapping[str, Look]
) -> None:
    """Draw the eigenvalues of every part's compliance, a pane for each model, all in one scale.

    Negative ones are red crosses on a red ground. A part of a conservative model has none (Eqs. 8-9).

    Args:
        panes: Where to, a pane for each model.
        by_name: See `fit_details.eigenvalues`, by model.
        looks: How models are drawn, by name.
    """
    every = np.concatenate([row.urad_per_Nm for rows in by_name.values() for row in rows])
    most = float(np.abs(every).max()) or 1.0
    least = 10 ** (math.floor(math.log10(most)) - SPAN + 1)
    lowest = min(-least, 3 * float(every.min()))
    for k, (axes, (name, rows)) in enumerate(zip(panes, by_name.items(), strict=True)):
        axes.set_xscale("symlog", linthresh=least, linscale=0.6)
        _eigenvalue_pane(axes, rows, name, looks[name])
        axes.axvspan(lowest, 0, color=hexadecimal(NEGATIVE), alpha=0.08, linewidth=0, zorder=0)
        axes.hlines(range(len(rows)), lowest, 3 * most, color="0.93", linewidth=0.5, zorder=0)
        axes.set(xlim=(lowest, 3 * most), ylim=(len(rows) - 0.5, -0.5))
        ends = (least * 10, most) if lowest == -least else (least * 10, most, lowest)
        axes.set_xticks(*_symlog_ticks(ends))
        axes.set_xticks([], minor=True)
        axes.set_yticks(*([[]] if k else [range(len(rows)), [row.part for row in rows]]))


def _eigenvalue_pane(axes: Axes, rows: Sequence[Row], name: str, look: Look) -> None:
    """Draw the eigenvalues of one model."""
    values = [np.array(row.urad_per_Nm) for row in rows]
    every = np.concatenate(values)
    part, bad = np.repeat(np.arange(len(rows)), [len(own) for own in values]), every < 0
    axes.plot(every[~bad], part[~bad], linestyle="", **look.dots(3.4))
    axes.plot(every[bad], part[bad], "X", color=hexadecimal(NEGATIVE), markersize=5, zorder=4)
    axes.axvline(0, color="0.3", linewidth=0.8)
    axes.set_xlabel(EIGENVALUE)
    count = int(bad.sum())
    negative = f"{count} of {len(every)} negative" if count else "none negative"
    axes.set_title(f"{row_head(name)}:\n{negative}")
    quiet(axes)


def _symlog_ticks(ends: Sequence[float]) -> tuple[list[float], list[str]]:
    """Place powers of ten from the least to the greatest, zero, and one below it where something is."""
    low, high, *below = ends
    first, last = math.ceil(math.log10(low)), math.floor(math.log10(high))
    powers = range(last, first - 1, -3 if below else -2)  # half of the axis is below zero: fewer have room
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
    ends = [row.least_percent for row in rows], [row.most_percent for row in rows]
    axes.hlines(at, *ends, color="0.2", linewidth=0.8)
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
    if min(values) < LEAST_TOLD:  # what is below is drawn at it
        at = axes.get_yticks().tolist()
        axes.set_yticks(at, [f"{'≤ ' * (y <= LEAST_TOLD)}{tick_words(y)}" for y in at])
    axes.set(xlabel="direction of the unknowns", ylabel=TOLD, xlim=(0, len(s) + 1))
    axes.set_title(f"Readings determine {told} of {len(s)} directions")
    quiet(axes)


def stiffness_pane(axes: Axes, rows: Sequence[Row]) -> None:
    """Draw every joint's stiffness as assumed, grey, and as identified, with 95 % intervals.

    Args:
        axes: Where to.
        rows: See `fit_details.joint_stiffness`; all of one unit.
    """
    known = [end for row in rows for own in (row.prior, row.posterior) for end in own.values() if end]
    low, high = min(known), max(known)
    y = np.arange(len(rows))
    for key, aside, colour, mark, words in (
        ("prior", -0.17, hexadecimal(GREY), "s", "the arm's folder, ±30 %"),
        ("posterior", 0.17, hexadecimal(NOMINAL), "o", "identified"),
    ):
        every = [row[key] for row in rows]
        ends = [own.low or low / 10 for own in every], [own.high or 10 * high for own in every]
        axes.hlines(y + aside, *ends, color=colour, linewidth=1.6)
        middles = [own.middle for own in every]
        axes.plot(middles, y + aside, mark, color=colour, markersize=3.6, label=words)
    log_ticks(axes, "x", low, high)
    axes.set_yticks(range(len(rows)), [row.joint for row in rows])
    axes.set(ylim=(len(rows) - 0.5, -0.5), xlabel=f"stiffness [{rows[0].unit}]")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)
    axes.set_title("Stiffness of each joint with the link before it, 95 %")
    quiet(axes)


def residual_figure(
    details: Row, looks: Mapping[str, Look], pair: Sequence[str], predicted: Sequence[str]
) -> Figure:
    """Draw residuals of two models with normal curves, as Fig. 5, and predicted against true deflections.

    Args:
        details: `residuals` and `predictions` of `workflows.fit_numbers`.
        looks: Of all models, by name.
        pair: Models whose residuals are drawn; those that are not there are left out.
        predicted: The same of predictions, the best last.
    """
    rows = {row.name: row for row in details.residuals}
    known = [name for name in pair if name in rows] or [*rows][:2]
    drawn = [name for name in predicted if name in details.predictions.predicted_mm]
    figure = page(3.0)
    panes = figure.subplots(1, len(known) + 1)
    residual_panes(panes[:-1], [rows[name] for name in known], looks)
    predicted_pane(panes[-1], details.predictions, {name: looks[name] for name in drawn}, "true")
    panes[-1].set_title("Predicted against true")
    normal = [in_words(name) for name in known if (rows[name].lilliefors_p or 0) >= REJECTED]
    answer = f"Residuals that pass Lilliefors' test of normality: {'; '.join(normal) or 'none'}"
    reading = (
        "Histograms: components of residuals, reading minus model, with the normal curve of their mean and "
        f"deviation; a p below {REJECTED:g} rejects normality. Predictions: a mark for each target; all "
        "marks of a perfect model lie on the line."
    )
    say(figure, answer, reading)
    return figure


def eigenvalue_figure(details: Row, looks: Mapping[str, Look], names: Sequence[str]) -> Figure:
    """Draw the eigenvalues of every part's compliance, a pane for each model: which are conservative.

    Args:
        details: `eigenvalues` of `workflows.fit_numbers`, by model.
        looks: Of all models, by name.
        names: Models from left to right; those that are not there are left out.
    """
    shown = {name: details.eigenvalues[name] for name in names if name in details.eigenvalues}
    parts = max(len(rows) for rows in shown.values())
    figure = page(1.3 + 0.15 * parts)
    panes = figure.subplots(1, len(shown), squeeze=False)[0]
    eigenvalue_panes(panes, shown, looks)
    for_column(panes[0], panes[-1])
    bad = {name: sum(x < 0 for row in rows for x in row.urad_per_Nm) for name, rows in shown.items()}
    told = [f"{in_words(name)} ({counted(n, 'negative eigenvalue')})" for name, n in bad.items() if n]
    answer = f"Not conservative: {', '.join(told)}" if told else "All of these models are conservative"
    say(figure, answer, OF_EIGENVALUES)
    return figure


OF_EIGENVALUES = (
    "Eigenvalues of the compliance of each link, and compliance of each joint. A translation is "
    f"divided by {LEVER_LENGTH:g} m, to compare it with rotations. Red crosses: negative; such a part would "
    "move against its load."
)


def compliance_figure(rows: Sequence[Row], model: str, reference: str) -> Figure:
    """Draw 6x6 compliances as maps: the reference, the estimate, and the half width of its interval.

    The link that moves the load most has numbers; below it all links are in the same colours.

    Args:
        rows: See `fit_details.link_compliances`.
        model: Name of the estimate.
        reference: What it is set beside, such as "true arm".
    """
    most = max(rows, key=lambda row: float(row.share_percent))
    heads = {"reference": reference, "estimate": row_head(model), "half": "half width, 95 %"}
    scaled = {row.part: _scaled(row) for row in rows}
    norm = SymLogNorm(LINEAR_COMPLIANCE, vmin=-MOST_COMPLIANCE, vmax=MOST_COMPLIANCE)
    figure = page(4.6)
    first, second = bands(figure, [2.55, 1.75 if len(rows) < MANY_LINKS else 1.5])
    panes = first.subplots(1, len(heads), sharey=True)
    for axes, (key, head) in zip(panes, heads.items(), strict=True):
        _matrix(axes, scaled[most.part][key], norm)
        axes.set_title(head)
    panes[0].set_yticks(range(6), AXES)
    for_column(panes[1])
    axes = second.subplots()
    strip = np.full((len(heads) * STEP - 1, len(rows) * STEP - 1, 4), GAP)
    for k, row in enumerate(rows):
        for j, key in enumerate(heads):
            block = np.ma.masked_invalid(scaled[row.part][key])
            strip[j * STEP : j * STEP + 6, k * STEP : k * STEP + 6] = SIGNS(norm(block))
    axes.imshow(strip, aspect="equal", interpolation="nearest")
    axes.set_xticks(np.arange(len(rows)) * STEP + 2.5, [short(row.part, 12) for row in rows])
    axes.set_yticks(np.arange(len(heads)) * STEP + 2.5, heads.values())
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    bar = figure.colorbar(ScalarMappable(norm, SIGNS), ax=[*panes], fraction=0.03, pad=0.02, extend="both")
    bar.set_ticks(TICKS_COMPLIANCE, labels=[f"{x:g}".replace("-", "−") for x in TICKS_COMPLIANCE])
    bar.minorticks_off()
    bar.set_label(f"entry over the reference,\nlogarithmic beyond ±{LINEAR_COMPLIANCE:g}")
    own = " with ".join(filter(None, [most.part, most.joint]))
    inside, known = entries_inside(most)
    answer = f"{own}: {inside} of {known} entries agree with the {reference} within 95 %"
    reading = (
        f"{own} causes {most.share_percent:.0f} % of the load's deflection, more than any other. Entry "
        f"(i, j) is divided by the square root of entries (i, i) and (j, j) of the {reference}, so that "
        "metres and radians compare: on the diagonal, 1 is the reference. Below: all links, each with its "
        "joint. Grey: rigid in the reference, or no interval is known. report.json has all numbers."
    )
    say(figure, answer, reading)
    return figure


def entries_inside(row: Row) -> tuple[int, int]:
    """Count the entries on and above the diagonal whose interval holds the reference, and those with one."""
    upper = np.triu_indices(6)
    reference, estimate, half = (np.array(row[key], dtype=float)[upper] for key in COMPLIANCES)
    known = np.isfinite(half)
    return int((np.abs(estimate - reference)[known] <= half[known]).sum()), int(known.sum())


def _scaled(row: Row) -> dict[str, Array]:
    """Divide the matrices of a link by the deviations of its reference; NaN where that is zero."""
    size = np.sqrt(np.diag(np.array(row.reference, dtype=float)))
    size = np.where(size > 0, size, np.nan)
    return {key: np.array(row[key], dtype=float) / np.outer(size, size) for key in COMPLIANCES}


def _matrix(axes: Axes, values: Array, norm: SymLogNorm) -> None:
    """Draw a 6x6 matrix with its numbers."""
    axes.imshow(values, norm=norm, cmap=SIGNS, interpolation="nearest")
    for (i, j), x in np.ndenumerate(values):
        if np.isfinite(x):
            dark = abs(x) > PALE_COMPLIANCE
            said = f"{x:.2f}" if abs(x) < 9.995 else f"{x:.0f}"
            said = said.replace("-", "−") if float(said) else "0"
            text = axes.text(j, i, said, ha="center", va="center", fontsize=MIN_LETTER_SIZE)
            text.set_color("white" if dark else "black")
    axes.set_xticks(range(6), AXES)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)


# --- Figures of studies: coverage of intervals, error against time, errors of joints against their angle ----

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
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), handlelength=1.5)
        quiet(axes)
    figure.axes[0].set_ylabel("actual coverage [%]")
    learnt = [row.covered_percent for row in rows if row.kind == "learnt"]
    answer = "How often intervals hold the truth"
    if learnt:
        shares = dict.fromkeys(f"{share:.0f}" for share in (min(learnt), max(learnt)))
        answer = f"The 95 % intervals with a learnt prior contain {' to '.join(shares)} % of the deflections"
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
            words = row_words(row.name)
            axes.plot(at, row.ratio, linestyle="", label=words, **looks[row.name].dots(4.5))
    front = np.array(sorted(known[name] for name in best))
    axes.plot(*front.T, ":", color=SOFT, linewidth=0.8, zorder=1)
    log_ticks(axes, "x", *axes.dataLim.intervalx)
    log_ticks(axes, "y", *axes.dataLim.intervaly)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.02), handletextpad=0.2)
    axes.set(xlabel="CPU time of a fit [s]", ylabel=error)
    quiet(axes)
    answer = f"No other is faster and better than {listed([*map(in_words, best)], 'or')}"
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
    worst, *others = sorted(rows, key=lambda row: -row.rms_urad)
    for_column(*(axes for axes, row in zip(panes.flat, rows, strict=False) if row in [worst, *others[:1]]))
    say(
        figure,
        f"Periodic joint errors: {worst.joint} errs most, {worst.rms_urad:.0f} µrad RMS",
        "Sum of all orders over the measured range, with its 95 % interval at each angle.",
    )
    return figure


# --- The figures of `testbench identify`: which model to take, how it fits, and what it says of the arm -----

FIT, MODEL, COMPLIANCE = "identify.png", "model.png", "compliance.png"
PANES, KEY_BELOW = 1.9, 0.4  #: Heights of a row of small panes, and of a key below it [in].


def identify_figures(words: ReportWords, seen: PageContent, f: Row) -> Mapping[str, Figure]:
    """Draw the figures of an identification.

    Args:
        words: The report.
        seen: What its page draws.
        f: The numbers of the report.

    Returns:
        Figures by name.
    """
    known = {m.name: look_of(m) for m in f.models}
    return {
        FIT: fit_figure(words, seen, f, known),
        MODEL: model_figure(f, known),
        COMPLIANCE: compliance_figure(f.details.compliances, f.recommended, "arm's folder"),
    }


def compared(f: Row) -> list[str]:
    """Name the model of least squares that is compared, where there is one, and the model to take."""
    own = {m.name: m for m in f.models}
    squares = [
        n for n in f.details.eigenvalues if own[n].constraint == "none" and own[n].structure != JOINTS_ONLY
    ]
    return list(dict.fromkeys([*squares[:1], f.recommended]))


def fit_figure(words: ReportWords, seen: PageContent, f: Row, known: Mapping[str, Look]) -> Figure:
    """Draw which model errs least and by how much, residuals, predictions, and residuals run by run."""
    models = headline(seen.tables)
    charts = [chart for chart in seen.runs if chart.labels]
    residuals = {row.name: row for row in f.details.residuals}
    names = [name for name in compared(f) if name in residuals]
    heights = [
        *([FOREST + forest_height(models[0])] if models else []),
        PANES + KEY_BELOW,
        *[CHART] * len(charts),
    ]
    figure = page(HEAD + sum(heights))
    parts = iter(bands(figure, heights))
    if models:
        panes = next(parts).subplots(1, 1 + bool(f.over), squeeze=False)[0]
        model_forest(panes[0], *models)
        for_column(panes[0])
        if f.over:
            ratio_pane(panes[1], f, models[0])
    panes = next(parts).subplots(1, 1 + len(names), squeeze=False)[0]
    residual_panes(panes[:-1], [residuals[name] for name in names], known)
    predicted_pane(panes[-1], f.details.predictions, {name: known[name] for name in compared(f)})
    panes[-1].set_title("Predicted against measured")
    for part, chart in zip(parts, charts, strict=True):
        axes = part.subplots()
        run_chart(axes, chart)
        for_column(axes)
    answer = [as_plain(words.block(part)) for part in ("badge", "answer")]
    reading = "Histograms: components of residuals with the normal curve of their mean and deviation."
    say(figure, " ".join(filter(None, answer)), reading)
    return figure


def ratio_pane(axes: Axes, f: Row, models: Table) -> None:
    """Draw held-out errors over that of the model to take, with 95 % intervals.

    Args:
        axes: Where to.
        f: Numbers of the report, with the ratios `over`.
        models: Models in the order in which they stand.
    """
    name, ratio = models.columns[0], TableColumn(RATIO, "held-out error, ratio", form=".2f", none="")
    ratios = {row.name: row.ratio for row in f.over}
    rows = [Row(name=name.cell(row), ratio=ratios.get(name.cell(row), math.nan)) for row in models.rows]
    table = Table((TableColumn("name", "model"), ratio), rows, looks=models.looks)
    forest_pane(axes, table, ratio, named=False)
    ends = [*axes.dataLim.intervalx.tolist(), 1.0]
    axes.axvline(1, color=SOFT, linewidth=0.8, linestyle=":")
    log_ticks(axes, "x", min(ends), max(ends))
    axes.set_title("Ratio to the chosen model, 95 % interval")


def model_figure(f: Row, known: Mapping[str, Look]) -> Figure:
    """Draw eigenvalues, sag by part, stiffness of joints, and what the readings tell of the model to take."""
    d, names = f.details, compared(f)
    proposals = (f.get("identifiability") or Row(help=[])).help
    parts = len(d.eigenvalues[f.recommended])
    heights = [0.9 + 0.145 * parts, PANES + 0.3, *([0.6 + 0.2 * len(proposals)] if proposals else [])]
    figure = page(HEAD + sum(heights))
    first, second, *more = bands(figure, heights)
    panes = first.subplots(1, 1 + len(names))
    eigenvalue_panes(panes[:-1], {name: d.eigenvalues[name] for name in names}, known)
    sag_pane(panes[-1], d.sag)
    for_column(*panes[-2:])
    panes = second.subplots(1, 3 if d.joints else 2)
    if d.joints:
        stiffness_pane(panes[0], d.joints)
    singular_pane(panes[-2], d.singular_values)
    told_pane(panes[-1], f.seen.blocks)
    for part in more:
        help_pane(part.subplots(), proposals)
    negative = sum(x < 0 for row in d.eigenvalues[f.recommended] for x in row.urad_per_Nm)
    negatives = f" ({counted(negative, 'negative eigenvalue')})"
    conservative = f"not conservative{negatives}" if negative else "conservative"
    answer = f"{capital(in_words(f.recommended))} is {conservative}"
    bends = f"; {d.sag[0].part} causes {d.sag[0].share_percent:.0f} % of the deflection" if d.sag else ""
    colours = " Which part bends: joints are blue, links grey." if d.sag else ""
    say(figure, answer + bends, OF_EIGENVALUES + colours)
    return figure


def told_pane(axes: Axes, rows: Sequence[Row]) -> None:
    """Draw what the runs tell of every part, over what a prior known to 30 % leaves open."""
    at = np.arange(len(rows))
    axes.barh(at, [row.told_percent for row in rows], color=hexadecimal(NOMINAL), height=0.7)
    axes.set_yticks(at, [row.part for row in rows])
    axes.set(ylim=(len(rows) - 0.4, -0.6), xlim=(0, 100), xlabel="prior variance removed [%]")
    axes.set_title("What the readings determine")
    quiet(axes)


def help_pane(axes: Axes, rows: Sequence[Row]) -> None:
    """Draw what error is expected at random poses after each further way to measure, the best on top."""
    some = [row for row in rows if row.expected_error_mm is not None]
    at = np.arange(len(some))
    axes.barh(at, [row.expected_error_mm for row in some], color=hexadecimal(NOMINAL), height=0.7)
    for y, row in zip(at.tolist(), some, strict=True):
        said = f" {row.expected_error_mm:.3f} mm"
        axes.text(row.expected_error_mm, y, said, va="center", fontsize=MIN_LETTER_SIZE)
    axes.set_yticks(at, [row.measure for row in some])
    most = max((row.expected_error_mm for row in some), default=1.0)
    axes.set(ylim=(len(some) - 0.4, -0.6), xlim=(0, 1.2 * most), xlabel="expected error at random poses [mm]")
    axes.set_title("What to measure next")
    quiet(axes)
