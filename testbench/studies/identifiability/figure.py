"""Errors over the workspace: by method, against the number of poses, against the prior's scale."""

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.bench.baselines import distinct
from testbench.studies.identifiability.summary import IdentifiabilityReport, ModelReport
from testbench.studies.identifiability.tables import MODELS, POSES, SCALE, WORKSPACE, rms
from testbench.trials.spread import Number, ends
from testbench.views.colours import look
from testbench.views.figure import Line, dots, draw_line, log_ticks, quiet
from testbench.views.schema import Column


def errors(report: IdentifiabilityReport) -> Figure:
    """Every method with its spread; the prior's models over poses and over its scale."""
    figure = Figure(figsize=(15, 6), layout="constrained")
    left, centre, right = figure.subplots(1, 3, width_ratios=(1.2, 1, 1))
    models = distinct(report.models)
    looks = [look(m.structure, m.constraint, m.prior, m.filling) for m in models]
    dots(left, models, MODELS[0], WORKSPACE, looks)
    log_ticks(left, "x", *left.dataLim.intervalx)
    right.sharey(centre)
    gco = [m for m in models if m.constraint == "psd"]  # least squares with a prior lies below it
    _lines(right, gco, report.scales, SCALE)
    _lines(centre, models, report.poses, POSES)
    log_ticks(right, "x", *right.dataLim.intervalx)
    right.set_xticks([row["scale"] for row in report.scales], [SCALE.cell(row) for row in report.scales])
    seeds, prior = report.seed, report.prior
    spread = "" if isinstance(seeds, int) else f"; median, 5 to 95 % of {len(seeds)} seeds"
    wrong = f"{prior.scale:g} times too soft, {prior.shape_percent:g} % wrong in shape"
    colours = "least squares orange, joints alone blue, GCO green; filled and dashed"
    figure.suptitle(
        f"{report.dataset.poses} poses: {colours} with a prior {wrong}{spread}",
        fontsize="medium",
    )
    return figure


def _lines(
    axes: Axes, models: Sequence[ModelReport], rows: Sequence[Mapping[str, Number]], x: Column
) -> None:
    drawn = [m for m in models if m.name in rows[0]]
    for m in drawn:
        draw_line(
            axes, x, rms(m.name), Line(rows, look(m.structure, m.constraint, m.prior, m.filling), m.name)
        )
    values = [end for row in rows for m in drawn for end in ends(row[m.name])]
    log_ticks(axes, "y", min(values), max(values))
    axes.set_xlabel(x.heading)
    axes.set_ylabel(f"{WORKSPACE.heading} [{WORKSPACE.unit}]")
    axes.legend(frameon=False, fontsize="x-small", handlelength=4)
    quiet(axes)
