"""Prediction error against load."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.studies.loaded_stiffness.summary import LOAD, NAMES, RMS, SHARE, LoadedReport
from testbench.studies.loaded_stiffness.trial import Method, Truth
from testbench.views.colours import GCO, LEAST_SQUARES, NOMINAL, hexadecimal
from testbench.views.figure import SOFT, log_ticks, page, quiet, say

METHODS: dict[Method, tuple[str, str]] = {
    "linear": (hexadecimal(LEAST_SQUARES), "o"),
    "secant": (hexadecimal(NOMINAL), "s"),
    "integrated": (hexadecimal(GCO), "D"),
}
"""Colour and marker."""
TRUTHS: dict[Truth, tuple[str, str]] = {
    "weightless": ("-", "weightless arm"),
    "own weight": ("--", "arm that sags under its own weight"),
}
"""Line and words."""


def loaded_stiffness(report: LoadedReport) -> Figure:
    """RMS error of Eq. (6) and (7) against the load: weightless solid, with the arm's own weight dashed."""
    figure = page(5.8)
    axes = figure.subplots()
    _lines(axes, report)
    loads = [LOAD.value(row) for row in report.tangent]
    log_ticks(axes, "x", loads[0], loads[-1])
    axes.set_xticks(loads, [f"{load:{LOAD.form}}" for load in loads])
    axes.set_xlabel(f"hung weight [{LOAD.unit}]")
    axes.set_ylabel(f"{RMS.heading} of the tool's deflection [{RMS.unit}]")
    axes.grid(axis="y", color=SOFT, alpha=0.2)
    quiet(axes)
    for method, (shade, marker) in METHODS.items():
        axes.plot([], [], color=shade, marker=marker, linewidth=2, label=NAMES[method])
    for style, words in TRUTHS.values():
        axes.plot([], [], style, color=SOFT, linewidth=2, label=words)
    axes.legend(loc="upper left", edgecolor="none", framealpha=1)
    heaviest = [(NAMES[method], report.line("weightless", method)[-1]) for method in METHODS]
    words = ", ".join(f"{name} {'exact' if row.exact else SHARE.cell(row) + ' %'}" for name, row in heaviest)
    say(
        figure,
        f"{report.arm} without weight under {LOAD.cell(heaviest[0][1])} {LOAD.unit}, error of what "
        f"it deflects: {words}",
        f"RMS over {report.poses} poses, from the true compliances; at the right ends as a share of the "
        "deflection.",
    )
    return figure


def _lines(axes: Axes, report: LoadedReport) -> None:
    """A line for each method and truth; words at the foot for what is exact."""
    drawn, names, exact = [], [], 0
    for truth, (style, whose) in TRUTHS.items():
        for method, (shade, marker) in METHODS.items():
            line = report.line(truth, method)
            if all(row.exact for row in line):
                note = f"{NAMES[method]}, {whose}: exact to rounding"
                place = (0.98, 0.03 + 0.05 * exact)
                axes.text(
                    *place, note, color=shade, transform=axes.transAxes, ha="right", backgroundcolor="white"
                )
                exact += 1
                continue
            error = [RMS.value(row) for row in line]
            load = [LOAD.value(row) for row in line]
            axes.plot(load, error, style, color=shade, marker=marker, markersize=5, linewidth=2)
            drawn += error
            names.append((error[-1], f"{SHARE.cell(line[-1])} %", shade))
    if drawn:
        log_ticks(axes, "y", max(min(drawn), RMS.rounding), max(drawn))
        _name_ends(axes, names)


def _name_ends(axes: Axes, ends: list[tuple[float, str, str]]) -> None:
    """Words beside the right end of every line of a logarithmic axis, pushed down where they would meet."""
    low, high = np.log(axes.get_ylim())
    place = math.inf
    for value, words, shade in sorted(ends, reverse=True):
        place = min((math.log(value) - low) / (high - low), place - 0.04)
        axes.text(1.01, place, words, color=shade, transform=axes.transAxes, ha="left", va="center")
