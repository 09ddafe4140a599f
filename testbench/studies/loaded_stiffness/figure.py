"""Figure of the study of Eq. (7): prediction error against load."""

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.views.figures import GREEN, GREY, ORANGE, PURPLE
from testbench.views.report import Report

LOADED_METHODS = {
    "linear": (ORANGE, "o", "Eq. (6), linear"),
    "secant": (PURPLE, "s", "Eq. (7) once, K_w at no load"),
    "integrated": (GREEN, "D", "Eq. (7) integrated"),
}
LOADED_TRUTHS = {
    "weightless": ("-", "weightless arm"),
    "own weight": ("--", "arm that sags under its own weight"),
}
"""Colour, marker and words of a method; line and words of a truth."""


def loaded_stiffness(report: Report, file: Path) -> None:
    """RMS error of Eq. (6) and (7) against the load: weightless solid, with the arm's own weight dashed."""
    figure = Figure(figsize=(8, 5.2), layout="constrained")
    axes = figure.subplots()
    axes.loglog()
    _loaded_lines(axes, report["rows"])
    axes.set_xticks(report["loads_N"], [f"{load / 1e3:.3g}" for load in report["loads_N"]])
    axes.set_xticks([], minor=True)
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_xlabel("hung weight [kN]")
    axes.set_ylabel("tool position error, RMS [um]")
    axes.grid(axis="y", color=GREY, alpha=0.2)
    axes.spines[["top", "right"]].set_visible(False)
    for shade, marker, words in LOADED_METHODS.values():
        axes.plot([], [], color=shade, marker=marker, linewidth=2, label=words)
    for style, words in LOADED_TRUTHS.values():
        axes.plot([], [], style, color=GREY, linewidth=2, label=words)
    axes.legend(loc="upper left", edgecolor="none", framealpha=1)
    figure.suptitle(
        f"{report['arm']}, {report['poses']} poses: error of the deflection predicted from true compliances\n"
        "(at the right as a share of the deflection)",
        fontsize="medium",
    )
    figure.savefig(file, dpi=120)


def _loaded_lines(axes: Axes, rows: list[Report]) -> None:
    """A line for each method and truth; words at the foot for what is rounding, decades below the others."""
    largest = max(1e3 * row["rms_mm"] for row in rows)
    notes, ends = 0, []
    for truth, (style, whose) in LOADED_TRUTHS.items():
        for method, (shade, marker, words) in LOADED_METHODS.items():
            line = [row for row in rows if (row["truth"], row["method"]) == (truth, method)]
            load, error = [row["load_N"] for row in line], [1e3 * row["rms_mm"] for row in line]
            if max(error) < 1e-5 * largest:
                note = f"{words}, {whose}: exact (within {max(error):.0e} um)"
                place = (0.98, 0.03 + 0.05 * notes)
                axes.text(*place, note, color=shade, transform=axes.transAxes, ha="right")
                notes += 1
            else:
                axes.plot(load, error, style, color=shade, marker=marker, markersize=5, linewidth=2)
                ends.append((error[-1], f"{line[-1]['rms_percent']:.2f} %", shade))
    _name_ends(axes, ends)


def _name_ends(axes: Axes, ends: list[tuple[float, str, str]]) -> None:
    """Words beside the right end of every line of a logarithmic axis, pushed down where they would meet."""
    low, high = np.log(axes.get_ylim())
    place = math.inf
    for value, words, shade in sorted(ends, reverse=True):
        place = min((math.log(value) - low) / (high - low), place - 0.035)
        axes.text(1.0, place, words, color=shade, transform=axes.transAxes, ha="left", va="center")
