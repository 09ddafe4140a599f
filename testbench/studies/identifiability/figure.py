"""Errors over the workspace with and without a prior."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.views.figures import GREEN, GREY, ORANGE, PURPLE
from testbench.views.report import Report, middle


def errors(report: Report, file: Path) -> None:
    """Error over the workspace: by method, against the number of poses, against the prior's scale."""
    figure = Figure(figsize=(14, 5), layout="constrained")
    left, centre, right = figure.subplots(1, 3, width_ratios=(1.2, 1, 1))
    right.sharey(centre)
    _by_method(left, report["models"])
    solid = {"MGCO56, GCO + prior": (GREEN, "o-"), "MGCO68, GCO + prior": (PURPLE, "s-")}
    dotted = {"MLS56": (ORANGE, "o:"), "MGCO56": (GREEN, "o:"), "MGCO68": (PURPLE, "s:")}
    _lines(centre, report["poses"], "poses", dotted | solid)
    _lines(right, report["scales"], "scale", solid)
    centre.set_xlabel("poses identified from")
    right.set_xlabel("prior softer than the truth by this factor")
    right.set_xscale("log")
    scales = [row["scale"] for row in report["scales"]]
    right.set_xticks(scales, [f"{scale:g}" for scale in scales])
    right.set_xticks([], minor=True)
    seeds, prior = report["seed"], report["prior"]
    spread = "" if isinstance(seeds, int) else f"; median and 5 to 95 % of {len(seeds)} seeds"
    figure.suptitle(
        f"RMS error over the workspace [mm], {report['arm']}, {report['dataset']['poses']} poses; "
        f"CAD prior {prior['scale']:g} times too soft, {prior['shape_percent']:g} % wrong in shape{spread}",
        fontsize="medium",
    )
    figure.savefig(file, dpi=120)


def _by_method(axes: Axes, rows: list[Report]) -> None:
    y = np.arange(len(rows))[::-1]
    for place, row in zip(y, rows, strict=True):
        value = row["workspace"]["rms_mm"]
        low, high = (value["p05"], value["p95"]) if isinstance(value, dict) else (value, value)
        shade = ORANGE if "LS" in row["name"] else GREEN
        axes.plot([low, high], [place, place], color=GREY)
        axes.plot(middle(value), place, "o", color=shade, markersize=7)
        axes.text(1.15 * high, place, f"{middle(value):.3g}", va="center", fontsize="small", color=shade)
    axes.set_yticks(y, [row["name"] for row in rows], fontsize="small")
    axes.set_xscale("log")
    axes.set_title("least squares orange, GCO green", fontsize="medium")
    axes.spines[["top", "right"]].set_visible(False)


def _lines(axes: Axes, rows: list[Report], key: str, names: dict[str, tuple[str, str]]) -> None:
    x = [row[key] for row in rows]
    for name, (shade, style) in names.items():
        values = [row[name] for row in rows]
        axes.plot(x, [middle(v) for v in values], style, color=shade, label=name)
        if isinstance(values[0], dict):
            low, high = [v["p05"] for v in values], [v["p95"] for v in values]
            axes.fill_between(x, low, high, color=shade, alpha=0.12)
    axes.set_yscale("log")
    axes.legend(frameon=False, fontsize="x-small")
    axes.spines[["top", "right"]].set_visible(False)
