"""The ladder, the number of poses, and the error of every joint over its angle."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.studies.real_ur10.joints import FIRST
from testbench.studies.real_ur10.ladder import TWO
from testbench.studies.real_ur10.looks import LOOKS
from testbench.studies.real_ur10.report import JointReport, RealReport
from testbench.trials.spread import ends, middle
from testbench.views.colours import MEASURED, hexadecimal
from testbench.views.figure import SMALL, SOFT, body, key, log_ticks, page, quiet, say
from testbench.views.gains import more

SPLITS = {"C to A": "<", "A to C": ">", "blocks": "o"}
"""Splits that are drawn, and their markers."""
WORDS = {
    "C to A": "trained on C, judged on A",
    "A to C": "trained on A, judged on C",
    "blocks": "both; blocks of joint space held out",
}
SERIES = {"A": (hexadecimal(MEASURED), "-"), "C": ("#333333", "--")}
"""Colour and line of a series."""
MARKED = {"A": "o", "C": "x"}
JUDGED = {"C": ("-", "other poses of C"), "A": ("--", "poses of A")}


def real_ur10(report: RealReport) -> Figure:
    """Above: mean error by model and split, and by number of poses. Below: what every joint does."""
    figure = page(10.4)
    above, below = np.asarray(figure.subfigures(2, 1, height_ratios=[1.15, 1]))
    left, right = above.subplots(1, 2, width_ratios=[1.2, 1])
    _ladder(left, report)
    _numbers(right, report)
    axes = np.asarray(below.subplots(2, 3, sharex=True, sharey=True))
    for ax, joint in zip(axes.flat, report.joints, strict=True):
        _curve(ax, joint)
    for ax in axes[1]:
        ax.set_xlabel("joint angle [deg]")
    for ax in axes[:, 0]:
        ax.set_ylabel("its error [urad]")
    key(below, axes[0, 1].get_legend_handles_labels(), columns=2)
    below.suptitle("Error of every joint by either series alone, with its correlation where both were")
    words = [f"{one.name} ({one.poses} poses)" for one in report.dataset]
    springs, errors = TWO
    own = report.gain(errors.name, springs.name, "blocks")
    say(
        figure,
        f"Positions of a real UR10 that were never fitted, mean: {middle(own.ours_mm):.3f} mm with joint "
        f"errors, {middle(own.theirs_mm):.3f} mm with joint springs, {more(own)}",
        f"Public readings, series {' and '.join(words)}, of July and November 2020. Bands: 5 to 95 % of the "
        "draws, of fewer than 20 their range. Numbers beside names: "
        "blocks of joint space held out. Below: orders from 3 on.",
    )
    return figure


def _ladder(axes: Axes, report: RealReport) -> None:
    """A line a model: its mean error by split."""
    for y, model in enumerate(report.models):
        look = LOOKS[model.name]
        for split, mark in SPLITS.items():
            if report.has(model.name, split):
                face = look.hex if split == "blocks" else "white"
                mean = report.mean(model.name, split)
                axes.plot(mean, y, mark, color=look.hex, markerfacecolor=face, markersize=9)
    for split, mark in SPLITS.items():
        face = SOFT if split == "blocks" else "white"
        axes.plot([], [], mark, color=SOFT, markerfacecolor=face, markersize=9, label=WORDS[split])
    axes.set_yticks(range(len(report.models)), [_named(report, model.name) for model in report.models])
    axes.set_ylim(len(report.models) - 0.5, -0.5)
    axes.set_xlim(0, None)
    axes.set_xlabel("mean error [mm]")
    axes.grid(axis="x", color=SOFT, alpha=0.2)
    axes.set_title("models", fontsize="medium")
    _below(axes)
    quiet(axes)


def _named(report: RealReport, model: str) -> str:
    return f"{model}  {report.mean(model, 'blocks'):.3f}"


def _numbers(axes: Axes, report: RealReport) -> None:
    """A line a model and judging series over the number of random poses of C."""
    found = []
    for judged, (style, words) in JUDGED.items():
        for model in TWO:
            line, look = report.line(model.name, judged), LOOKS[model.name]
            poses, mean = [one.poses for one in line], [middle(one.mean_mm) for one in line]
            low, high = np.array([ends(one.mean_mm) for one in line]).T
            found += [*low, *high]
            label = f"{model.name}, {words}"
            axes.plot(poses, mean, look.mark + style, color=look.hex, markersize=5, label=label)
            axes.fill_between(poses, low, high, color=look.hex, alpha=0.1, linewidth=0)
    log_ticks(axes, "y", min(found), max(found))
    log_ticks(
        axes, "x", min(one.poses for one in report.by_number), max(one.poses for one in report.by_number)
    )
    axes.set_xlabel("random poses of C that train")
    axes.set_ylabel("mean error [mm]")
    axes.grid(axis="y", color=SOFT, alpha=0.2)
    axes.set_title("number of poses", fontsize="medium")
    _below(axes)
    quiet(axes)


def _below(axes: Axes) -> None:
    """The legend of some axes, below them."""
    axes.legend(
        loc="upper center", bbox_to_anchor=(0.5, -0.14), edgecolor="none", fontsize=SMALL, handlelength=3.5
    )


def _curve(axes: Axes, joint: JointReport) -> None:
    """The error over the angle where each series was."""
    for name, (colour, style) in SERIES.items():
        curve = joint.curve_A_urad if name == "A" else joint.curve_C_urad
        own = np.array([np.nan if y is None else y for y in curve])
        axes.plot(joint.angle_deg, own, style, color=colour, linewidth=1, label=f"by {name}")
    alike = "nowhere both" if joint.alike is None else f"{joint.alike:.2f}"
    axes.set_title(f"{_named_joint(joint)}: {alike}", fontsize="medium")
    axes.set_xlim(-180, 180)
    axes.set_xticks(range(-180, 181, 90))
    quiet(axes)


def _named_joint(joint: JointReport) -> str:
    return joint.joint.removesuffix("_joint").replace("_", " ")


def spectra(report: RealReport) -> Figure:
    """Amplitude of every order of every joint, by either series alone and by both."""
    figure = page(7)
    part = body(figure)
    axes = part.subplots(2, 3, sharex=True, sharey=True)
    for ax, joint in zip(axes.flat, report.joints, strict=True):
        orders = np.arange(1, len(joint.amplitude_both_urad) + 1)
        ax.bar(orders, joint.amplitude_both_urad, color=SOFT, alpha=0.4, label="by both")
        for name, (colour, _) in SERIES.items():
            own = joint.amplitude_A_urad if name == "A" else joint.amplitude_C_urad
            mark = MARKED[name]
            ax.plot(
                np.arange(1, len(own) + 1), own, mark, color=colour, markersize=3, label=f"by {name} alone"
            )
        ax.set_title(_named_joint(joint), fontsize="medium")
        quiet(ax)
    for ax in axes[1]:
        ax.set_xlabel("order, periods a turn")
    for ax in axes[:, 0]:
        ax.set_ylabel("amplitude [urad]")
    key(part, axes[0, 0].get_legend_handles_labels(), columns=3)
    size, order, largest = max(
        (amplitude, order, _named_joint(joint))
        for joint in report.joints
        for order, amplitude in enumerate(joint.amplitude_both_urad, start=1)
        if order >= FIRST
    )
    say(
        figure,
        f"Joint errors of a real UR10: the largest is {size:.0f} urad, order {order} of {largest}",
        "Amplitudes of periodic errors by order, from the readings of series A, of series C, and of both. "
        f"Orders below {FIRST} mix with geometry and do not count in the title.",
    )
    return figure
