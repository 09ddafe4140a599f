"""Distributions of residuals (Fig. 5 of the paper)."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.bench.baselines import JOINTS
from testbench.bench.campaign import Campaign
from testbench.bench.campaign_row import normalities
from testbench.bench.judged import Result
from testbench.bench.rows import UM
from testbench.data.dataset import Mask
from testbench.identify.evaluate import Normality, normal_density
from testbench.views.colours import MEASURED, hexadecimal, look
from testbench.views.figure import SMALL, SOFT, page, quiet, say

BINS = 24  #: Of a histogram.
PAPERS = ("MGCO68", "MLS32")  #: The models of Fig. 5.


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
