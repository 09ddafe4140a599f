"""Figures as PNG, written from a report; matplotlib's object interface, no global state."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import stats

from testbench.bench.campaign import Campaign, Result
from testbench.data.dataset import Mask
from testbench.identify.evaluate import Normality
from testbench.views.report import UM, Report, middle

ORANGE, GREEN, PURPLE, GREY = "#E69F00", "#009E73", "#CC79A7", "#595959"
"""Okabe-Ito: least squares, GCO, check readings; grey for the paper and for theory."""


def colour(method: str) -> str:
    """The colour of a method's role."""
    return GREEN if method.startswith("GCO") else ORANGE


def models(report: Report, file: Path) -> None:
    """Errors of every model on check poses and over the workspace, the paper's beside."""
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    _bars(left, report, "check", "check poses, against readings", "check_rms_mm")
    _bars(right, report, "workspace", "whole workspace, against the truth", "")
    left.set_ylabel("RMS error [mm]")
    left.set_yscale("log")  # both: the axis is shared
    left.set_ylim(0.03, 2 * max(left.dataLim.ymax, right.dataLim.ymax))
    seeds = report["seed"]
    spread = "" if isinstance(seeds, int) else f"; median, 5 to 95 % of {len(seeds)} seeds"
    figure.suptitle(
        f"{report['scenario']}: least squares orange, GCO green, paper grey diamonds{spread}",
        fontsize="medium",
    )
    figure.savefig(file, dpi=120)


def _bars(axes: Axes, report: Report, group: str, title: str, paper: str) -> None:
    rows: list[dict[str, Any]] = report["models"]
    x = np.arange(len(rows))
    values = [m[group]["rms_mm"] for m in rows]
    height = np.array([middle(v) for v in values])
    axes.bar(x, height, color=[colour(m["method"]) for m in rows], width=0.6)
    ends = [(v["p05"], v["p95"]) if isinstance(v, dict) else (v, v) for v in values]
    if any(low < high for low, high in ends):
        low, high = np.array(ends).T
        error = [height - low, high - height]
        axes.errorbar(x, height, yerr=error, fmt="none", color=GREY, capsize=4)
    known = [(m["paper"] or {}).get(paper, math.nan) for m in rows]
    axes.plot(x, known, "D", color=GREY, markersize=8, markeredgecolor="white")
    names = [f"{m['name']}\n{h:.3f} mm" for m, h in zip(rows, height, strict=True)]
    axes.set_xticks(x, names)
    axes.set_title(title, fontsize="medium")
    axes.spines[["top", "right"]].set_visible(False)


def residuals(campaign: Campaign, results: Sequence[Result], file: Path) -> None:
    """Distributions of residual components with their normal curve, as Fig. 5 of the paper.

    The paper's two models, and the conservative one that does best on the check poses.
    """
    best = min((r for r in results if r.estimate.conservative), key=lambda r: r.check.rms, default=None)
    chosen = [r for r in results if r.model.name in ("MGCO68", "MLS32") or r is best]
    figure = Figure(figsize=(5 * len(chosen), 4.6), layout="constrained")
    axes = np.atleast_1d(figure.subplots(1, len(chosen)))
    used = np.isin(campaign.measured.pose, campaign.identification.pose)
    for ax, result in zip(axes, chosen, strict=True):
        _distribution(ax, result, used)
    figure.suptitle(
        f"Residuals of seed {campaign.seed}, all markers and axes pooled (Fig. 5); what lies beyond an axis "
        "stands in its last bin",
        fontsize="medium",
    )
    figure.savefig(file, dpi=120)


def _distribution(ax: Axes, result: Result, used: Mask) -> None:
    fit, check = (UM * result.residuals[runs].ravel() for runs in (used, ~used))
    normal = result.fit_normality
    edge = max(1e-6, 4 * UM * normal.std)
    bins = np.linspace(-edge, edge, 25).tolist()
    shade = colour(result.estimate.method)
    ax.hist(np.clip(fit, -edge, edge), bins, density=True, color=shade, alpha=0.7, label="fit")
    ax.hist(
        np.clip(check, -edge, edge),
        bins,
        density=True,
        histtype="step",
        color=PURPLE,
        linewidth=2,
        label="check",
    )
    x = np.linspace(-edge, edge, 400)
    ax.plot(x, stats.norm.pdf(x, UM * normal.mean, edge / 4), color=GREY, label="normal curve of the fit")
    ax.set_title(
        f"{result.model.name}\nfit: {_words(normal)}\ncheck: {_words(result.check_normality)}",
        fontsize="small",
    )
    ax.set_xlabel("residual component [um]")
    ax.set_yticks([])
    ax.legend(frameon=False, fontsize="small")
    ax.spines[["top", "right", "left"]].set_visible(False)


def _words(n: Normality) -> str:
    return f"mean {UM * n.mean:.1f} um, std {UM * n.std:.1f} um, Lilliefors p = {n.p_value:.3f}"
