"""Share of the deflection removed by campaign, number of poses and model; and the error along one path."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.bench.baselines import JOINTS
from testbench.report.table import Row, find
from testbench.studies.compensation.settings import (
    ADVISED,
    ALL,
    BOTH,
    DEFAULT,
    FEATURED,
    IDEAL,
    IDENTIFIED,
    LINEAR,
    NOMINAL,
    NOWHERE,
    PERFECT,
    PLANNED,
    RANDOM,
    REAL,
    WEIGHT,
    Way,
)
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


def group(f: Row, name: str, way: Way = NOWHERE, arm: str = IDEAL) -> Row:
    """A model by a campaign, both jobs."""
    return find(f.groups, name=name, campaign=way.campaign, poses=way.poses, arm=arm, job=ALL)


def removed(f: Row) -> Figure:
    """The four campaigns, undisturbed; the same disturbed; the milling path of the first trial."""
    figure = page(13.0)
    part = body(figure)
    above, below = part.subfigures(2, 1)  # type: ignore[misc]  # stubs: one or several
    panes = above.subplots(2, 2, sharey=True)
    for axes, campaign in zip(panes.flat, CAMPAIGNS, strict=True):
        every = [[group(f, m, Way(*campaign, n)) for m in IDENTIFIED] for n in f.numbers]
        _shares(axes, every, [f"{n} poses" for n in f.numbers], "{} poses, {}".format(*campaign))
    disturbed, path = below.subplots(2, 1)
    every = [[group(f, m, Way(*campaign, FEATURED), REAL) for m in IDENTIFIED] for campaign in CAMPAIGNS]
    every.append([group(f, m, arm=REAL) for m in (NOMINAL, PERFECT)])
    every.append([group(f, m, ADVISED, LINEAR) for m in IDENTIFIED])
    names = [*(f"{by},\n{loads}" for by, loads in CAMPAIGNS), "not\nidentified", "second, joints\nlinear"]
    _shares(disturbed, every, names, f"arm with all that no model knows, {FEATURED} poses")
    _path(path, f.shown)
    for axes in (*panes[:, 0], disturbed):
        axes.set_ylabel("deflection removed [%]")
    known = dict(zip(*reversed(disturbed.get_legend_handles_labels()), strict=True))
    key(above, (list(known.values()), list(known)), columns=len(LOOKS))
    gains = {"least squares": f.gains.least_squares, "joints alone": f.gains.joints}
    say(
        figure,
        f"{f.arm}, {FEATURED} planned poses, weight and pull, error left: {beside(gains)}",
        "Title and above: true arms that bend as a model can. Dots: medians of all points, lines: 5 to 95 % "
        f"of them; {f.trials} trials, {f.force[0] / 1e3:g} to {f.force[1] / 1e3:g} kN.",
    )
    return figure


def _shares(axes: Axes, groups: Sequence[Sequence[Row]], names: Sequence[str], title: str) -> None:
    """What is left on a logarithmic axis, named by what is removed: upwards is better."""
    for k, own in enumerate(groups):
        _dots(axes, k, own)
    axes.set_xticks(range(len(names)), names)
    axes.set_title(title, fontsize="medium")
    axes.axhline(1, color=SOFT, linewidth=0.8, zorder=0)
    axes.set_yscale("log")
    axes.set_ylim(MOST * 1.2, LEAST / 1.2)
    axes.set_yticks(TICKS, [f"{100 * (1 - left):.3g}" for left in TICKS])
    axes.set_yticks([], minor=True)
    axes.set_xlim(-0.5, len(names) - 0.5)
    quiet(axes)


def _dots(axes: Axes, at: float, groups: Sequence[Row]) -> None:
    for k, own in enumerate(groups):
        look, x = LOOKS[own.name], at + APART * (k - (len(groups) - 1) / 2)
        worst, best = own.removed_percent.ends
        left = 1 - np.array([best, own.removed_percent.median, worst]) / 100
        low, middle, high = np.clip(left, LEAST, MOST)
        axes.plot((x, x), (low, high), color=look.hex, linewidth=2, alpha=0.6)
        axes.plot(
            x,
            middle,
            look.mark,
            color=look.hex,
            markerfacecolor=look.face,
            markersize=look.size(7),
            label=own.name,
        )


def _path(axes: Axes, own: Row) -> None:
    axes.plot(own.way_m, own.before_mm, "--", color=SOFT, label="not corrected")
    for model in (JOINTS, DEFAULT):
        axes.plot(own.way_m, own.after_mm[model], color=LOOKS[model].hex, label=f"corrected, {model}")
    axes.set_ylim(bottom=0)
    axes.set(xlabel="along the milling path [m]", ylabel="tool from where it was asked [mm]")
    title = f"milling under {own.force:.0f} N, {PLANNED} poses, {BOTH}, seed {own.seed}"
    axes.set_title(title, fontsize="medium")
    axes.legend(frameon=False, fontsize=SMALL)
    quiet(axes)
