"""Figures of identifiability: what the data give of every parameter; errors with and without a prior."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from testbench.views.figures import GREEN, GREY, ORANGE, PURPLE
from testbench.views.report import Report, middle

DIAGONAL = ("stretch", "deflection\ny", "deflection\nz", "torsion", "rotation\ny", "rotation\nz")
DARK_GREEN = "#00684C"
"""The data in words: the green of areas is too light for text."""
PRIOR_ALPHA = 0.35
"""The prior is the lighter grey, so that green stands out."""
CELL, NARROW, GAP = 0.9, 0.26, 0.35
"""Widths of a cell, of that of a coupling, and of the space between groups."""
HEIGHT = 0.78
COUPLINGS = [(a, b) for b in range(1, 7) for a in range(1, b)]


def shares(report: Report, file: Path) -> None:
    """A row a link, a cell a parameter; green is filled by the data, grey is left to the prior.

    Args:
        report: As `identifiability_report.to_dict` makes it.
        file: PNG to write.
    """
    rows = [block["component"] for block in report["blocks"]]
    figure = Figure(figsize=(11, 1.9 + 0.5 * len(rows)), layout="constrained")
    axes = figure.subplots()
    for k, component in enumerate(rows):
        _row(axes, -k, [p for p in report["parameters"] if p["component"] == component])
    start = _left((1, 2))
    end = start + NARROW * len(COUPLINGS)
    columns = [(*_left_width((i + 1, i + 1)), text) for i, text in enumerate(DIAGONAL)]
    for left, width, text in columns:
        axes.text(left + width / 2, 1.0, text, ha="center", va="bottom", fontsize="small")
    axes.text((start + end) / 2, 1.0, "couplings", ha="center", va="bottom", fontsize="small")
    for k, block in enumerate(report["blocks"]):
        middle = HEIGHT / 2 - k
        axes.text(-0.75, middle, block["component"], ha="right", va="center", fontsize="large")
        share = f"{100 * block['data_share']:.0f} %"
        axes.text(-0.12, middle, share, ha="right", va="center", fontsize="large", color=DARK_GREEN)
    axes.set_yticks([])
    axes.set_xticks([])
    axes.set_xlim(-1.6, end + 0.1)
    axes.set_ylim(0.6 - len(rows), 1.75)
    axes.spines[:].set_visible(False)
    decided = sum(p["decided_by"] == "prior" for p in report["parameters"])
    figure.suptitle(
        f"{report['structure']}: {report['seen']} of {report['unknowns']} directions seen; the prior decides "
        f"{decided} entries\nlost: {report['lost_to_structure']} to the structure, {report['lost_to_loads']} "
        f"to these loads, {report['lost_to_poses']} to too few poses",
        fontsize="large",
    )
    known = [
        Patch(color=GREEN, label="the data tell"),
        Patch(color=GREY, alpha=PRIOR_ALPHA, label=f"the prior tells ({report['prior']})"),
    ]
    figure.legend(handles=known, frameon=False, loc="outside lower center", ncols=2)
    figure.savefig(file, dpi=120)


def _left(entry: tuple[int, int]) -> float:
    a, b = entry
    if a == b:
        return a - 1.0
    return 6 + GAP + NARROW * COUPLINGS.index((min(entry), max(entry)))


def _left_width(entry: tuple[int, int]) -> tuple[float, float]:
    return _left(entry), CELL if entry[0] == entry[1] else 0.85 * NARROW


def _row(axes: Axes, bottom: float, parameters: list[dict[str, Any]]) -> None:
    for p in parameters:
        # a joint has one entry: a bar over the six columns of the diagonal
        left, width = _left_width(tuple(p["entry"])) if p["entry"] else (0.0, 5 + CELL)
        axes.add_patch(Rectangle((left, bottom), width, HEIGHT, color=GREY, alpha=PRIOR_ALPHA, linewidth=0))
        share = p["data_share"]
        filled = (width, share * HEIGHT) if p["entry"] else (share * width, HEIGHT)
        axes.add_patch(Rectangle((left, bottom), *filled, color=GREEN, linewidth=0))


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
