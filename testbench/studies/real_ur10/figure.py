"""Models over the number of poses; the error of every joint over its angle, and its spectrum."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes

from testbench.report.columns import columns
from testbench.report.table import Row
from testbench.studies.real_ur10 import ladder
from testbench.studies.real_ur10.joints import FIRST
from testbench.trials.spread import middle
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
from testbench.views.figure import SOFT, Figure, body, key, over, page, quiet, say
from testbench.views.schema import Table

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
Draw = Callable[[Axes, Row], None]  #: Draws a joint.


def number_of_poses(numbers: Sequence[Row]) -> Figure:
    """Mean error over the number of random poses of C that train, judged on C and on A."""
    rows = [Row(row, fit=f"{row.name}, judged on {row.judged}") for row in numbers]
    styles = {row.fit: replace(LOOKS[row.name], prior=row.judged == "A") for row in rows}
    few = {row.fit: row for row in rows if row.poses == min(one.poses for one in rows)}
    first = [few[f"{model.name}, judged on C"] for model in (ladder.WAVES, ladder.JOINTS)]
    errors, springs = (middle(row.error.mean_mm) for row in first)
    return over(
        Table(columns("fit poses error.mean_mm"), rows, looks=styles),
        f"{first[0].poses} random poses of C, judged on others of C: {errors:.3f} mm with joint errors, "
        f"{springs:.3f} mm with joint springs",
        "Mean error, medians of the draws; bands: 5 to 95 % of the draws. Dashed and filled: judged on A.",
    )


def joint_errors(joints: Sequence[Row]) -> Figure:
    """The error of every joint over its angle, by either series where it was."""
    figure = _by_joint(joints, _curve, "joint angle [deg]", "its error [urad]")
    alike = [joint.correlation for joint in joints if joint.correlation is not None]
    words = f"correlation {min(alike):.2f} to {max(alike):.2f}" if alike else "nowhere both"
    say(
        figure,
        f"Error of every joint of a real UR10 by either series alone: {words}",
        f"Curves where each series was, orders from {FIRST} on. Number beside a name: correlation over the "
        "angles that both visited.",
    )
    return figure


def spectra(joints: Sequence[Row]) -> Figure:
    """Amplitude of every order of every joint, by either series alone and by both."""
    figure = _by_joint(joints, _spectrum, "order, periods a turn", "amplitude [urad]")
    size, order, largest = max(
        (amplitude, order, named(joint))
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


def _by_joint(joints: Sequence[Row], draw: Draw, across: str, up: str) -> Figure:
    """A pane a joint, one legend."""
    figure = page(6.5)
    part = body(figure)
    axes = part.subplots(2, 3, sharex=True, sharey=True)
    for ax, joint in zip(axes.flat, joints, strict=True):
        ax.set_title(named(joint), fontsize="medium")
        draw(ax, joint)
        quiet(ax)
    for ax in axes[1]:
        ax.set_xlabel(across)
    for ax in axes[:, 0]:
        ax.set_ylabel(up)
    key(part, axes[0, 1].get_legend_handles_labels(), columns=3)
    return figure


def _curve(axes: Axes, joint: Row) -> None:
    """The error over the angle where each series was."""
    for name, (colour, style, _) in SERIES.items():
        own = np.array(joint[f"curve_{name}_urad"], dtype=float)
        axes.plot(joint.angle_deg, own, style, color=colour, linewidth=1, label=f"by {name}")
    alike = "nowhere both" if joint.correlation is None else f"{joint.correlation:.2f}"
    axes.set_title(f"{named(joint)}: {alike}", fontsize="medium")
    axes.set_xlim(-180, 180)
    axes.set_xticks(range(-180, 181, 90))


def _spectrum(axes: Axes, joint: Row) -> None:
    """Bars by both series, marks by either alone."""
    orders = np.arange(1, len(joint.amplitude_both_urad) + 1)
    axes.bar(orders, joint.amplitude_both_urad, color=SOFT, alpha=0.4, label="by both")
    for name, (colour, _, mark) in SERIES.items():
        own = joint[f"amplitude_{name}_urad"]
        at = np.arange(1, len(own) + 1)
        axes.plot(at, own, mark, color=colour, markersize=3, label=f"by {name} alone")


def named(joint: Row) -> str:
    """What a joint is called: shoulder pan."""
    return str(joint.joint).removesuffix("_joint").replace("_", " ")
