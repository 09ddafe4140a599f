"""Errors of every model, and the distributions of their residuals (Fig. 5 of the paper)."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.bench.baselines import JOINTS, distinct
from testbench.bench.campaign import Campaign
from testbench.bench.judged import Result
from testbench.bench.rows import UM
from testbench.data.dataset import Mask
from testbench.identify.evaluate import Normality, normal_density
from testbench.studies.gravity_calibration.summary import COLUMNS, GravityReport
from testbench.studies.gravity_calibration.trial import normalities
from testbench.trials.spread import middle
from testbench.views.colours import MEASURED, hexadecimal, look
from testbench.views.figure import SMALL, SOFT, dots, least, log_ticks, of_seeds, page, quiet, say
from testbench.views.gains import beside
from testbench.views.map_figure import error_map

SIDES = {
    "workspace.rms_mm": "whole workspace, against the truth",
    "check_true.rms_mm": "check poses, against the truth",
    "check.rms_mm": "check poses, against readings",
}
"""Columns that are drawn, where it matters first."""
BINS = 24  #: Of a histogram.
PAPERS = ("MGCO68", "MLS32")  #: The models of Fig. 5.


def models(report: GravityReport) -> Figure:
    """Errors of every model over the workspace and at check poses, the paper's beside."""
    name, rows = COLUMNS[0], distinct(report.models)
    figure = page(1.9 + 0.3 * len(rows))
    looks = [look(m.structure, m.constraint, m.prior) for m in rows]
    panes = figure.subplots(1, len(SIDES))
    for k, (axes, (key, words)) in enumerate(zip(panes, SIDES.items(), strict=True)):
        [column] = [c for c in COLUMNS if c.key == key]
        dots(axes, rows, None if k else name, column, looks)
        log_ticks(axes, "x", *axes.dataLim.intervalx)
        for own, shade in zip(rows, looks, strict=True):
            if own.name == JOINTS:  # what there is to beat
                axes.axvline(middle(column.value(own)), color=shade.hex, linewidth=0.8, linestyle=":")
        axes.set_title(words, fontsize="medium")
    gains = {"least squares": report.gains.least_squares, "joints alone": report.gains.joints}
    said = beside(gains) or least({m.name: m.workspace.rms_mm for m in rows}, JOINTS)
    paper = "; grey diamonds: the paper" if any(m.paper for m in rows) else ""
    say(
        figure,
        f"{report.arm} under {report.payload_kg:g} kg, RMS over the workspace: {said}",
        f"RMS errors. {of_seeds(report.seed)}. Filled: with a prior; dotted line: joints alone{paper}.",
    )
    return figure


def places(report: GravityReport) -> Figure:
    """Errors over the workspace of least squares, joints alone and the model to take."""
    return error_map(report.map, f"{report.arm} under {report.payload_kg:g} kg", report.seed)


def residuals(campaign: Campaign, results: Sequence[Result], take: str) -> Figure:
    """Distributions of residual components with their normal curve, as Fig. 5 of the paper.

    The paper's two models, joints alone, and the one to take; all axes have one range.
    """
    chosen = [r for r in results if r.model.name in (JOINTS, *PAPERS, take)]
    across = min(len(chosen), 2)
    down = -(-len(chosen) // across)
    figure = page(1.3 + 2.9 * down)
    panes = figure.subplots(down, across, sharex=True, sharey=True, squeeze=False)
    used = np.isin(campaign.measured.pose, campaign.identification.pose)
    normal = normalities(campaign, chosen)
    edge = max(4 * UM * max(fit.std for fit, _ in normal), 1e-6)
    for axes, result, (fit, check) in zip(panes.flat, chosen, normal, strict=False):
        _distribution(axes, result, used, (fit, edge))
        axes.set_title(
            f"{result.model.name}\nfit: {_words(fit)}\ncheck: {_words(check)}", fontsize=SMALL, loc="left"
        )
    for axes in panes.flat[len(chosen) :]:
        axes.axis("off")
    for axes in panes[:, 0]:
        axes.set_ylabel("share of the components [%]")
    for axes in panes[-1]:
        axes.set_xlabel("residual component [um]")
    scatter = {r.model.name: UM * check.std for r, (_, check) in zip(chosen, normal, strict=True)}
    best, worst = (f(scatter, key=scatter.__getitem__) for f in (min, max))
    say(
        figure,
        f"At check poses {best} of these leaves the least scatter, {scatter[best]:.0f} um, {worst} the most, "
        f"{scatter[worst]:.0f} um",
        f"Residuals of seed {campaign.seed}, all markers and axes pooled (Fig. 5). Filled: runs fitted; "
        "vermillion: check runs; grey: normal curve of the fit. What lies beyond an end stands in its last "
        "bin. Small p: not normal (Lilliefors). A narrow fit may have followed the noise.",
    )
    return figure


def _distribution(ax: Axes, result: Result, used: Mask, shown: tuple[Normality, float]) -> None:
    """Residuals of one model under the normal curve of the fit, up to an edge [um]."""
    normal, edge = shown
    bins = np.linspace(-edge, edge, BINS + 1).tolist()
    own = result.estimate
    shade = look(own.structure.name, own.constraint, own.belief is not None).hex
    fit, check = (np.clip(UM * result.residuals[runs].ravel(), -edge, edge) for runs in (used, ~used))
    shares = [np.full(left.size, 100 / left.size) for left in (fit, check)]
    ax.hist(fit, bins, weights=shares[0], color=shade, alpha=0.7)
    ax.hist(check, bins, weights=shares[1], histtype="step", color=hexadecimal(MEASURED), linewidth=2)
    x = np.linspace(-edge, edge, 400)
    curve = normal_density(x, UM * normal.mean, max(UM * normal.std, 1e-9))
    ax.plot(x, 100 * (bins[1] - bins[0]) * curve, color=SOFT)
    quiet(ax)


def _words(n: Normality) -> str:
    return f"mean {UM * n.mean:.0f} um, standard deviation {UM * n.std:.0f} um, p = {n.p_value:.3f}"
