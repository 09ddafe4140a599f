"""Figures of pose selection: error against poses, criterion by criterion, and what else would help."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.views.figures import GREEN, GREY, ORANGE, PURPLE
from testbench.views.report import Report, middle

SKY, BROWN, OLIVE = "#56B4E9", "#B07A48", "#8A8F2A"
LINES: dict[str, tuple[str, str]] = {
    "random": (GREY, "s--"),
    "E": (BROWN, "v:"),
    "A": (OLIVE, "^:"),
    "G": (PURPLE, "P:"),
    "D": (ORANGE, "D-"),
    "I": (SKY, "o-"),
    "test": (GREEN, "o-"),
}
"""Colour and style of every criterion; the last one is on top."""
TICKS = (0.02, 0.03, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20)
"""Of the axis of errors [mm]."""
BANDS = ("random", "test")
FIT, BARE = "MGCO68 + prior", "MGCO68"


def curves(report: Report, file: Path) -> None:
    """Error against the number of poses: at the tasks and over the workspace, and at the tasks without prior.

    Args:
        report: report.json of the study.
        file: PNG to write.
    """
    figure = Figure(figsize=(14, 5), layout="constrained")
    left, centre, right = figure.subplots(1, 3)
    _curve(left, report, FIT, "tasks_mm", "at the tasks")
    _curve(centre, report, FIT, "workspace_mm", "over the workspace")
    _curve(right, report, BARE, "tasks_mm", "at the tasks, identified without prior")
    left.axhline(report["recommendation"]["aim_mm"], color=GREY, linewidth=0.8)
    left.annotate(
        f"{report['recommendation']['aim_mm']:g} mm",
        (1, report["recommendation"]["aim_mm"]),
        xycoords=("axes fraction", "data"),
        ha="right",
        va="bottom",
        color=GREY,
    )
    low, high = (f(axes.dataLim.intervaly[k] for axes in (left, centre)) for f, k in ((min, 0), (max, 1)))
    for axes in (left, centre):
        axes.set_ylim(0.9 * low, 1.1 * high)
    right.set_ylim(0.9 * right.dataLim.ymin, 1.1 * right.dataLim.ymax)
    figure.legend(*left.get_legend_handles_labels(), frameon=False, loc="outside lower center", ncols=7)
    left.set_ylabel("RMS error of predicted deflection [mm]")
    seeds = report["seed"]
    spread = "" if isinstance(seeds, int) else f"; median, bands 5 to 95 % of {len(seeds)} seeds"
    figure.suptitle(
        f"{report['arm']}: GCO of 68 unknowns from planned and from random poses, non-linear truth, "
        f"{report['dataset']['sigma_um']:g} um{spread}",
        fontsize="medium",
    )
    figure.savefig(file, dpi=120)


def _curve(axes: Axes, report: Report, fit: str, key: str, words: str) -> None:
    for name, (shade, style) in LINES.items():
        rows = report["errors"][fit].get(name)
        if rows is None:
            continue
        x, values = [row["poses"] for row in rows], [row[key] for row in rows]
        axes.plot(x, [middle(v) for v in values], style, color=shade, label=name, markersize=5)
        if name in BANDS and isinstance(values[0], dict):
            ends = [v["p05"] for v in values], [v["p95"] for v in values]
            axes.fill_between(x, *ends, color=shade, alpha=0.15, linewidth=0)
    ticks = [row["poses"] for row in report["errors"][fit]["random"]]
    axes.set_yscale("log")
    axes.set_yticks(TICKS, [f"{tick:g}" for tick in TICKS])
    axes.set_yticks([], minor=True)
    axes.set_xscale("log")
    axes.set_xticks(ticks, [str(n) for n in ticks])
    axes.set_xticks([], minor=True)
    axes.set_xlabel("poses measured")
    axes.set_title(words, fontsize="medium")
    axes.spines[["top", "right"]].set_visible(False)


def featured(report: Report, file: Path) -> None:
    """The featured number of poses: every criterion, and what could be done beyond the plan.

    Args:
        report: report.json of the study.
        file: PNG to write.
    """
    figure = Figure(figsize=(13, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1))
    poses = report["dataset"]["poses"]
    names = list(reversed(report["errors"][FIT]))
    rows = {name: next(r for r in report["errors"][FIT][name] if r["poses"] == poses) for name in names}
    for key, shade, marker, words in (
        ("tasks_mm", GREEN, "o", "at the tasks"),
        ("workspace_mm", SKY, "s", "over the workspace"),
    ):
        _dots(left, [rows[name][key] for name in names], shade, marker, words)
    left.set_yticks(range(len(names)), names)
    left.set_title(f"{poses} poses by criterion", fontsize="medium")
    left.legend(frameon=False, fontsize="small", loc="upper left", bbox_to_anchor=(0, -0.12), ncols=2)
    variants = list(reversed(report["worth"]))
    _dots(right, [row["judged"]["tasks_mm"] for row in variants], GREEN, "o", "simulated, at the tasks")
    promised = [row["expected_tasks_mm"] for row in variants]
    right.plot(promised, range(len(variants)), "|", color=ORANGE, markersize=16, label="promised")
    right.set_yticks(range(len(variants)), [row["variant"] for row in variants], fontsize="small")
    right.set_title("what else would help", fontsize="medium")
    right.legend(frameon=False, fontsize="small", loc="upper left", bbox_to_anchor=(0, -0.12), ncols=2)
    for axes in (left, right):
        axes.set_xlim(left=0)
        axes.set_xlabel("RMS error [mm]")
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(f"{report['arm']}: {FIT}, non-linear truth; bars 5 to 95 %", fontsize="medium")
    figure.savefig(file, dpi=120)


def _dots(axes: Axes, values: list[object], shade: str, marker: str, words: str) -> None:
    shift = 0.12 if marker == "s" else 0.0
    for k, value in enumerate(values):
        if isinstance(value, dict):
            axes.plot([value["p05"], value["p95"]], [k - shift] * 2, color=shade, alpha=0.5)
    places = np.arange(len(values)) - shift
    axes.plot([middle(v) for v in values], places, marker, color=shade, label=words)
