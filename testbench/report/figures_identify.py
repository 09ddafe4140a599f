"""The figures of `testbench identify`: which model to take, how it fits, and what it says of the arm."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes

from testbench.report.colours import NOMINAL, Look, hexadecimal, look_of
from testbench.report.figure import (
    MIN_LETTER_SIZE,
    RATIO,
    SOFT,
    Figure,
    bands,
    for_column,
    forest_height,
    forest_pane,
    log_ticks,
    page,
    quiet,
    say,
)
from testbench.report.figures_fit import (
    OF_EIGENVALUES,
    compliance_figure,
    eigenvalue_pane,
    predicted_pane,
    residual_panes,
    sag_pane,
    singular_pane,
    stiffness_pane,
)
from testbench.report.markdown import ReportWords, as_plain, capital, counted
from testbench.report.run_figure import CHART, FOREST, HEAD, headline, model_forest, run_chart
from testbench.report.scene import PageContent
from testbench.report.schema import Table, TableColumn
from testbench.runs.rows import Row
from testbench.workflows.model_names import in_words
from testbench.workflows.models import JOINTS

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
    squares = [n for n in f.details.eigenvalues if own[n].constraint == "none" and own[n].structure != JOINTS]
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
        table, column = models
        if column.key == "f_m_held_out":
            column = replace(column, heading="held-out error F_M", unit="deviations of the noise")
        model_forest(panes[0], table, column)
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
    for k, (axes, name) in enumerate(zip(panes, names, strict=False)):
        eigenvalue_pane(axes, d.eigenvalues[name], name, known[name], named=not k)
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
    say(figure, answer + bends, OF_EIGENVALUES)
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
