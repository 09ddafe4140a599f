"""Share of the deflection removed by campaign, number of poses and model; and the error along one path."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.bench.baselines import JOINTS
from testbench.studies.compensation.report import CompensationReport, Group
from testbench.studies.compensation.settings import (
    BOTH,
    DEFAULT,
    IDENTIFIED,
    LINEAR,
    NOMINAL,
    PERFECT,
    PLANNED,
    RANDOM,
    REAL,
    WEIGHT,
)
from testbench.trials.spread import Spread
from testbench.views.colours import CHOICE, GREY, Look, look
from testbench.views.colours import NOMINAL as SKY
from testbench.views.figure import SMALL, SOFT, body, key, page, quiet, say
from testbench.views.gains import beside

LOOKS = {
    JOINTS: look("Joints", "none"),
    "MLS56": look("MLS56", "none"),
    "MGCO56": look("MGCO56", "psd"),
    DEFAULT: CHOICE,
    NOMINAL: Look(SKY, 4, prior=False),
    PERFECT: Look(GREY, 5, prior=True),
}
CAMPAIGNS = ((PLANNED, WEIGHT), (PLANNED, BOTH), (RANDOM, WEIGHT), (RANDOM, BOTH))
LEAST, MOST = 2e-3, 5.0  #: Shares left between which the axis ends.
TICKS = (5, 3, 1, 0.5, 0.3, 0.1, 0.03, 0.01, 0.003)  #: Shares left.
APART = 0.17  #: Distance of dots that stand side by side.


def removed(report: CompensationReport) -> Figure:
    """The four campaigns, undisturbed; the same disturbed; the milling path of the first trial."""
    figure = page(13.0)
    part = body(figure)
    above, below = part.subfigures(2, 1)  # type: ignore[misc]  # stubs: one or several
    panes = above.subplots(2, 2, sharey=True)
    for axes, (by, loads) in zip(panes.flat, CAMPAIGNS, strict=True):
        _by_poses(axes, report, by, loads)
    disturbed, path = below.subplots(2, 1)
    _disturbed(disturbed, report)
    _path(path, report)
    for axes in (*panes[:, 0], disturbed):
        axes.set_ylabel("deflection removed [%]")
    key(above, disturbed.get_legend_handles_labels(), columns=len(LOOKS))
    gains = {"least squares": report.gains.least_squares, "joints alone": report.gains.joints}
    say(
        figure,
        f"{report.arm}, {report.featured} planned poses, weight and pull, error left: {beside(gains)}",
        "Title and above: true arms that bend as a model can. Dots: medians of all points, lines: 5 to 95 % "
        f"of them; {report.trials} trials, {report.force[0] / 1e3:g} to {report.force[1] / 1e3:g} kN.",
    )
    return figure


def _by_poses(axes: Axes, report: CompensationReport, by: str, loads: str) -> None:
    for k, poses in enumerate(report.numbers):
        _dots(axes, k, [report.group(m, f"{by}, {loads}", poses) for m in IDENTIFIED])
    axes.set_xticks(range(len(report.numbers)), [f"{n} poses" for n in report.numbers])
    axes.set_title(f"{by} poses, {loads}", fontsize="medium")
    _share_axis(axes, len(report.numbers))


def _disturbed(axes: Axes, report: CompensationReport) -> None:
    n = report.featured
    for k, (by, loads) in enumerate(CAMPAIGNS):
        own = [report.group(m, f"{by}, {loads}", n, arm=REAL) for m in IDENTIFIED]
        _dots(axes, k, own, named=not k)
    known = [report.group(m, arm=REAL) for m in (NOMINAL, PERFECT)]
    _dots(axes, len(CAMPAIGNS), known, named=True)
    _dots(
        axes, len(CAMPAIGNS) + 1, [report.group(m, f"{PLANNED}, {BOTH}", n, arm=LINEAR) for m in IDENTIFIED]
    )
    names = [*(f"{by},\n{loads}" for by, loads in CAMPAIGNS), "not\nidentified", "second, joints\nlinear"]
    axes.set_xticks(range(len(names)), names)
    axes.set_title(f"arm with all that no model knows, {n} poses", fontsize="medium")
    _share_axis(axes, len(names))


def _dots(axes: Axes, at: float, groups: Sequence[Group], *, named: bool = False) -> None:
    for k, group in enumerate(groups):
        own, x = LOOKS[group.model], at + APART * (k - (len(groups) - 1) / 2)
        low, middle, high = _left(group.removed)
        axes.plot((x, x), (low, high), color=own.hex, linewidth=2, alpha=0.6)
        label = group.model if named else None
        axes.plot(
            x, middle, own.mark, color=own.hex, markerfacecolor=own.face, markersize=own.size(7), label=label
        )


def _left(own: Spread) -> tuple[float, float, float]:
    """Shares left of the best, the middle and the worst of the cases, where the axis has them."""
    worst, best = own.ends
    left = 1 - np.array([best, own.median, worst])
    low, middle, high = np.clip(left, LEAST, MOST).tolist()
    return low, middle, high


def _share_axis(axes: Axes, count: int) -> None:
    """What is left on a logarithmic axis, named by what is removed: upwards is better."""
    axes.axhline(1, color=SOFT, linewidth=0.8, zorder=0)
    axes.set_yscale("log")
    axes.set_ylim(MOST * 1.2, LEAST / 1.2)
    axes.set_yticks(TICKS, [f"{100 * (1 - left):.3g}" for left in TICKS])
    axes.set_yticks([], minor=True)
    axes.set_xlim(-0.5, count - 0.5)
    quiet(axes)


def _path(axes: Axes, report: CompensationReport) -> None:
    own = report.shown
    axes.plot(own.way_m, own.before_mm, "--", color=SOFT, label="not corrected")
    for model in (JOINTS, DEFAULT):
        axes.plot(own.way_m, own.after_mm[model], color=LOOKS[model].hex, label=f"corrected, {model}")
    axes.set_ylim(bottom=0)
    axes.set(xlabel="along the milling path [m]", ylabel="tool from where it was asked [mm]")
    title = f"milling under {own.force:.0f} N, {PLANNED} poses, {BOTH}, seed {own.seed}"
    axes.set_title(title, fontsize="medium")
    axes.legend(frameon=False, fontsize=SMALL)
    quiet(axes)
