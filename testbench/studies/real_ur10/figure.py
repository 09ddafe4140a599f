"""The error of every joint over its angle, and its spectrum."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from testbench.report.table import Row
from testbench.studies.real_ur10 import ladder
from testbench.studies.real_ur10.joints import FIRST
from testbench.views.colours import (
    CHOICE,
    GCO,
    GREY,
    JOINTS,
    JOINTS_PRIOR,
    LEAST_SQUARES,
    MEASURED,
    Look,
    hexadecimal,
    look,
)
from testbench.views.figure import SOFT, Figure, body, key, page, quiet, say

LOOKS = {
    ladder.GEOMETRY.name: Look(GREY, 0, prior=True),
    ladder.JOINTS.name: Look(JOINTS, 2, prior=True),
    ladder.LINKS_LS.name: Look(LEAST_SQUARES, 1, prior=True),
    ladder.LINKS_GCO.name: look("ALL153", "psd"),
    ladder.LINKS_PRIOR.name: look("ALL153", "psd", prior=True),
    ladder.WAVES.name: Look(JOINTS_PRIOR, 0, prior=True),
    ladder.ALL.name: Look(GCO, 3, prior=True),
    ladder.CHOSEN.name: CHOICE,
}
"""Colour and marker of every model of the ladder, the same in figures and recordings."""
SERIES = {"A": (hexadecimal(MEASURED), "-", "o"), "C": ("#333333", "--", "x")}
"""Colour, line and marker of a series."""


def joint_errors(joints: Sequence[Row]) -> Figure:
    """The error of every joint over its angle, by either series where it was."""
    figure = page(6)
    part = body(figure)
    axes = part.subplots(2, 3, sharex=True, sharey=True)
    for ax, joint in zip(axes.flat, joints, strict=True):
        _curve(ax, joint)
    for ax in axes[1]:
        ax.set_xlabel("joint angle [deg]")
    for ax in axes[:, 0]:
        ax.set_ylabel("its error [urad]")
    key(part, axes[0, 1].get_legend_handles_labels(), columns=2)
    alike = [joint.correlation for joint in joints if joint.correlation is not None]
    words = f"correlation {min(alike):.2f} to {max(alike):.2f}" if alike else "nowhere both"
    say(
        figure,
        f"Error of every joint of a real UR10 by either series alone: {words}",
        f"Curves where each series was, orders from {FIRST} on. Number beside a name: correlation over the "
        "angles that both visited.",
    )
    return figure


def _curve(axes: Axes, joint: Row) -> None:
    """The error over the angle where each series was."""
    for name, (colour, style, _) in SERIES.items():
        own = np.array(joint[f"curve_{name}_urad"], dtype=float)
        axes.plot(joint.angle_deg, own, style, color=colour, linewidth=1, label=f"by {name}")
    alike = "nowhere both" if joint.correlation is None else f"{joint.correlation:.2f}"
    axes.set_title(f"{_named_joint(joint)}: {alike}", fontsize="medium")
    axes.set_xlim(-180, 180)
    axes.set_xticks(range(-180, 181, 90))
    quiet(axes)


def _named_joint(joint: Row) -> str:
    return str(joint.joint).removesuffix("_joint").replace("_", " ")


def spectra(joints: Sequence[Row]) -> Figure:
    """Amplitude of every order of every joint, by either series alone and by both."""
    figure = page(7)
    part = body(figure)
    axes = part.subplots(2, 3, sharex=True, sharey=True)
    for ax, joint in zip(axes.flat, joints, strict=True):
        orders = np.arange(1, len(joint.amplitude_both_urad) + 1)
        ax.bar(orders, joint.amplitude_both_urad, color=SOFT, alpha=0.4, label="by both")
        for name, (colour, _, mark) in SERIES.items():
            own = joint[f"amplitude_{name}_urad"]
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
        for joint in joints
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
