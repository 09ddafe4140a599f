"""Figure of a measurement plan: error against the number of poses, error of every task, top view."""

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.errors import Array
from testbench.views.figures import GREEN, GREY, ORANGE, PURPLE
from testbench.views.plan_text import UNCHECKED, answer
from testbench.views.report import Report

MARGIN = 0.4
"""Space around everything in the top view [m]."""
NUMBERED = 20
"""Most poses whose number stands beside them."""


def overview(report: Report, candidates: Array, file: Path) -> None:
    """Three panels, read from left to right: how many poses, what the tasks get, where it all is.

    Args:
        report: As `plan_report.report` makes it.
        candidates: Tool positions of the feasible poses, (c, 3) [m].
        file: PNG to write.
    """
    figure = Figure(figsize=(16, 5.6), layout="constrained")
    left, centre, right = figure.subplots(1, 3, width_ratios=(1.15, 1, 1.05))
    _poses(left, report)
    _tasks(centre, report)
    _top(right, report, candidates)
    for axes in (left, centre, right):
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(f"{report['arm']}, {report['model']}: {answer(report)}", fontsize="large")
    figure.savefig(file, dpi=120)


def _poses(axes: Axes, report: Report) -> None:
    """Greedy plans as a line, random plans as a band, the plan as a point."""
    line = [(k, error) for k, error in enumerate(report["greedy_mm"], start=1) if error is not None]
    rows = [row for row in report["curve"] if None not in row.values()]
    x = [row["poses"] for row in rows]
    low, middle, high = ([row[f"random_{key}_mm"] for row in rows] for key in ("p10", "median", "p90"))
    axes.fill_between(x, low, high, color=ORANGE, alpha=0.2, linewidth=0)
    axes.plot(x, middle, "o--", color=ORANGE, markersize=4, label="random poses: median, 10 to 90 %")
    axes.plot(*np.transpose(line), color=GREEN, linewidth=2, label="each pose the best next one")
    error, poses = report["error_mm"], report["poses"]
    span = [[error["expected"] - error["p05"]], [error["p95"] - error["expected"]]]
    axes.errorbar(
        [poses], [error["expected"]], yerr=span, fmt="D", color=GREEN, markersize=9,
        markeredgecolor="white", capsize=4, zorder=4, label="this plan, with its 90 % interval",
    )  # fmt: skip
    target = report["advice"]["target_mm"]
    axes.axhline(target, color=GREY, linestyle=":", zorder=1)
    axes.set_xlim(0, max(x[-1] if x else 0, line[-1][0]) + 1)
    axes.text(axes.get_xlim()[1], target, f"{target:g} mm ", ha="right", va="bottom", color=GREY)
    axes.set_yscale("log")
    shown = [value for _, value in line if value < 100 * error["expected"]]
    axes.set_ylim(0.7 * min(error["p05"], *shown), 1.3 * max(target, error["p95"], *shown, *high[:1]))
    _plain_ticks(axes)
    axes.set_xlabel("poses")
    axes.set_ylabel("expected error at the tasks [mm]")
    axes.set_title("What each further pose brings", fontsize="medium")
    axes.legend(frameon=False, fontsize="small", loc="upper right")


def _plain_ticks(axes: Axes) -> None:
    """1, 2, 5 on a logarithmic axis, as plain numbers."""
    low, high = axes.get_ylim()
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    ticks = [m * 10.0**d for d in decades for m in (1, 2, 5) if low <= m * 10.0**d <= high]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_yticks([], minor=True)
    axes.grid(axis="y", color=GREY, alpha=0.15)


def _tasks(axes: Axes, report: Report) -> None:
    """Errors of the tasks, the largest first."""
    rows = sorted(report["tasks"], key=lambda row: -row["expected_error_mm"])
    low, middle, high = (
        np.array([row[f"expected_error{key}_mm"] for row in rows]) for key in ("_p05", "", "_p95")
    )
    x = np.arange(len(rows)) + 1
    axes.vlines(x, low, high, color=GREEN, alpha=0.45, linewidth=max(0.6, min(5.0, 100 / len(rows))))
    axes.plot(x, middle, "o", color=GREEN, markersize=5 if len(rows) <= 60 else 2)
    axes.axhline(report["error_mm"]["expected"], color=GREY, linestyle="--", linewidth=1)
    note = f"all tasks {report['error_mm']['expected']:.3f}"
    axes.text(len(rows) + 0.5, report["error_mm"]["expected"], note, ha="right", va="bottom", color=GREY)
    axes.set_ylim(0, 1.05 * float(high.max()))
    axes.set_xlim(0.3, len(rows) + 0.7)
    if len(rows) <= 40:
        axes.set_xticks(x, [str(row["task"]) for row in rows], fontsize="x-small")
        axes.set_xlabel("task, the largest error first")
    else:
        axes.set_xlabel("tasks, the largest error first")
    axes.set_ylabel("expected error [mm]")
    axes.set_title("Every task, with its 90 % interval", fontsize="medium")


def _top(axes: Axes, report: Report, candidates: Array) -> None:
    """Tool positions seen from above."""
    plan = np.array([row["tool_m"] for row in report["plan"]])
    tasks = np.array([row["tool_m"] for row in report["tasks"]])
    words = f"{len(candidates):,} feasible poses"
    axes.plot(*candidates[:, :2].T, ".", color=GREY, alpha=0.18, markersize=2, label=words, rasterized=True)
    axes.plot(*tasks[:, :2].T, "s", color=ORANGE, markersize=5, alpha=0.9, label="tasks", zorder=3)
    many = len(plan) > NUMBERED
    size = 5 if many else 13
    axes.plot(*plan[:, :2].T, "o", color=GREEN, markersize=size, label="plan, in its order", zorder=4)
    for k, place in enumerate(plan[:, :2] if not many else [], start=1):
        axes.annotate(str(k), place, color="white", fontsize="x-small", ha="center", va="center", zorder=5)
    base = np.array(report["base_m"][:2])
    axes.plot(*base, "+", color="black", markersize=12, zorder=4)
    axes.annotate("base", (base[0], base[1]), xytext=(6, 6), textcoords="offset points", fontsize="small")
    everything = np.vstack([candidates[:, :2], tasks[:, :2], base])
    if report["tracker_m"] is not None:
        station = np.array(report["tracker_m"][:2])
        axes.plot(*station, "^", color=PURPLE, markersize=11, label="tracker", zorder=4)
        everything = np.vstack([everything, station])
    low, high = everything.min(axis=0) - MARGIN, everything.max(axis=0) + MARGIN
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    title = "Tool from above" if report["tracker_m"] is not None else f"Tool from above; {UNCHECKED}"
    axes.set_title(title, fontsize="medium")
    axes.legend(frameon=False, fontsize="small", loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)
