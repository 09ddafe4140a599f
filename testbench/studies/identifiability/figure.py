"""Errors over the workspace: by method, against the number of poses, against the prior's scale."""

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.bench.baselines import JOINTS, distinct
from testbench.studies.identifiability.summary import IdentifiabilityReport, ModelReport
from testbench.studies.identifiability.tables import MODELS, POSES, SCALE, WORKSPACE, rms
from testbench.trials.spread import Number, ends, middle
from testbench.views.colours import look
from testbench.views.figure import (
    Line,
    body,
    dots,
    draw_line,
    key,
    least,
    log_ticks,
    of_seeds,
    page,
    quiet,
    say,
)
from testbench.views.gains import beside
from testbench.views.schema import Column

BANDS = (JOINTS, "MLS56", "MGCO56", "MGCO56, GCO + prior")
"""Models whose spread is drawn as a band: all of them would cover one another."""


def errors(report: IdentifiabilityReport) -> Figure:
    """Every method with its spread; the prior's models over poses and over its scale."""
    models = distinct(report.models)
    figure = page(max(6.4, 2.2 + 0.31 * len(models)))
    part = body(figure)
    panes = part.subplot_mosaic("ab;ac", width_ratios=[1, 1.1], height_ratios=[1.5, 1])
    looks = [look(m.structure, m.constraint, m.prior, m.filling) for m in models]
    dots(panes["a"], models, MODELS[0], WORKSPACE, looks)
    log_ticks(panes["a"], "x", *panes["a"].dataLim.intervalx)
    panes["a"].set_title(f"{report.dataset.poses} poses", fontsize="medium")
    gco = [m for m in models if m.constraint == "psd"]  # least squares with a prior lies below it
    _lines(panes["b"], models, report.poses, POSES)
    panes["b"].set_title("more poses", fontsize="medium")
    _lines(panes["c"], gco, report.scales, SCALE)
    log_ticks(panes["c"], "x", *panes["c"].dataLim.intervalx)
    panes["c"].set_xticks(
        [middle(row["scale"]) for row in report.scales], [SCALE.cell(r) for r in report.scales]
    )
    panes["c"].set_title("a prior of another scale", fontsize="medium")
    key(part, panes["b"].get_legend_handles_labels(), columns=4)
    prior = report.prior
    gains = {"least squares": report.gains.least_squares, "joints alone": report.gains.joints}
    said = beside(gains) or least({m.name: m.workspace.rms_mm for m in models}, JOINTS)
    say(
        figure,
        f"{report.arm}, {report.dataset.poses} poses, RMS over the workspace: {said}",
        f"{of_seeds(report.seed)}; bands on the right: the same of some. Filled and dashed: with "
        f"a prior {prior.scale:g} times too soft, {prior.shape_percent:g} % wrong in shape.",
    )
    return figure


def _lines(
    axes: Axes, models: Sequence[ModelReport], rows: Sequence[Mapping[str, Number]], x: Column
) -> None:
    drawn = [m for m in models if m.name in rows[0]]
    for m in drawn:
        own = look(m.structure, m.constraint, m.prior, m.filling)
        draw_line(axes, x, rms(m.name), Line(rows, own, m.name, band=m.name in BANDS))
    values = [end for row in rows for m in drawn for end in ends(row[m.name])]
    log_ticks(axes, "y", min(values), max(values))
    axes.set_xlabel(x.heading)
    axes.set_ylabel(f"{WORKSPACE.heading} [{WORKSPACE.unit}]")
    quiet(axes)
