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
from testbench.views.figure import SOFT, dots, log_ticks, quiet

PAPERS = ("MGCO68", "MLS32")  #: The models of Fig. 5.


def models(report: GravityReport) -> Figure:
    """Errors of every model at check poses and over the workspace, the paper's beside."""
    figure = Figure(figsize=(15, 5.2), layout="constrained")
    name, rows = COLUMNS[0], distinct(report.models)
    looks = [look(m.structure, m.constraint, m.prior) for m in rows]
    sides = (
        ("check.rms_mm", "check poses, against readings"),
        ("check_true.rms_mm", "check poses, against the truth"),
        ("workspace.rms_mm", "whole workspace, against the truth"),
    )
    for axes, (key, words) in zip(figure.subplots(1, 3), sides, strict=True):
        [column] = [c for c in COLUMNS if c.key == key]
        dots(axes, rows, name, column, looks)
        log_ticks(axes, "x", *axes.dataLim.intervalx)
        for own, shade in zip(rows, looks, strict=True):
            if own.name == JOINTS:  # what there is to beat
                axes.axvline(middle(column.value(own)), color=shade.hex, linewidth=0.8, linestyle=":")
        axes.set_title(words, fontsize="medium")
    seeds = report.seed
    spread = "" if isinstance(seeds, int) else f"; median, 5 to 95 % of {len(seeds)} seeds"
    colours = "Least squares orange, joints alone blue, GCO green, filled with prior"
    figure.suptitle(f"{colours}; grey diamonds: the paper{spread}", fontsize="medium")
    return figure


def residuals(campaign: Campaign, results: Sequence[Result], recommended: str) -> Figure:
    """Distributions of residual components with their normal curve, as Fig. 5 of the paper.

    The paper's two models, joints alone, and the recommended one.
    """
    chosen = [r for r in results if r.model.name in (JOINTS, *PAPERS, recommended)]
    figure = Figure(figsize=(5 * len(chosen), 4.6), layout="constrained")
    axes = np.atleast_1d(figure.subplots(1, len(chosen), sharex=True))
    used = np.isin(campaign.measured.pose, campaign.identification.pose)
    normal = normalities(campaign, chosen)
    edge = max(4 * UM * max(fit.std for fit, _ in normal), 1e-6)
    for ax, result, (fit, check) in zip(axes, chosen, normal, strict=True):
        _distribution(ax, result, used, (fit, edge))
        ax.set_title(f"{result.model.name}\nfit: {_words(fit)}\ncheck: {_words(check)}", fontsize="small")
    axes[0].set_ylabel("density [1/um]")
    figure.suptitle(
        f"Residuals of seed {campaign.seed}, all markers and axes pooled (Fig. 5); what lies beyond an axis "
        "stands in its last bin",
        fontsize="medium",
    )
    return figure


def _distribution(ax: Axes, result: Result, used: Mask, shown: tuple[Normality, float]) -> None:
    """Residuals of one model under the normal curve of the fit, up to an edge [um]."""
    normal, edge = shown
    fit, check = (UM * result.residuals[runs].ravel() for runs in (used, ~used))
    bins = np.linspace(-edge, edge, 25).tolist()
    shade = look(result.estimate.structure.name, result.estimate.constraint).hex
    ax.hist(np.clip(fit, -edge, edge), bins, density=True, color=shade, alpha=0.7, label="fit")
    dark = hexadecimal(MEASURED)
    outside = np.clip(check, -edge, edge)
    ax.hist(outside, bins, density=True, histtype="step", color=dark, linewidth=2, label="check")
    x = np.linspace(-edge, edge, 400)
    curve = normal_density(x, UM * normal.mean, max(UM * normal.std, 1e-9))
    ax.plot(x, curve, color=SOFT, label="normal curve of the fit")
    ax.set_xlabel("residual component [um]")
    ax.legend(frameon=False, fontsize="small")
    quiet(ax)


def _words(n: Normality) -> str:
    return f"mean {UM * n.mean:.1f} um, std {UM * n.std:.1f} um, Lilliefors p = {n.p_value:.3f}"
