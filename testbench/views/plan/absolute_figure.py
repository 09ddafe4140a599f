"""Figure of a plan of absolute readings: error against the number of poses, top view."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.bench.absolute_plan_report import AbsolutePlanReport
from testbench.errors import Array
from testbench.views.figure import SOFT, log_ticks, page, quiet, say
from testbench.views.plan.figure import OURS, Top, below, top_view


def overview(report: AbsolutePlanReport, candidates: Array) -> Figure:
    """How many poses, and where they are: plan and feasible tools, (c, 3) [m]."""
    figure = page(6.4)
    left, right = figure.subplots(1, 2)
    _curve(left, report)
    plan = np.array([row.tool_m for row in report.plan])
    top_view(right, Top(plan, np.empty((0, 3)), candidates, np.array(report.base_m), report.tracker_m))
    for axes in (left, right):
        quiet(axes)
    say(
        figure,
        f"{report.arm}: {report.poses} poses promise a position error of {report.error_mm.expected:.3f} mm "
        "over the workspace",
        f"Expected RMS errors, {report.unknowns.total} unknowns. The plan is at least {report.percent} % "
        "efficient: no other poses of as many promise much less.",
    )
    return figure


def _curve(axes: Axes, report: AbsolutePlanReport) -> None:
    """Greedy plans as a line, random plans as a band, the plan as a point."""
    rows, error = report.curve, report.error_mm
    poses, low, high = (
        [getattr(row, key) for row in rows] for key in ("poses", "random_p10_mm", "random_p90_mm")
    )
    axes.fill_between(poses, low, high, color=SOFT, alpha=0.2, linewidth=0)
    middle = [row.random_median_mm for row in rows]
    axes.plot(poses, middle, "o--", color=SOFT, markersize=4, label="random poses: median, 10 to 90 %")
    best = [row.greedy_mm for row in rows]
    axes.plot(poses, best, color=OURS, linewidth=2, label="each pose the best next one")
    axes.plot([report.poses] * 2, [error.p05, error.p95], "_-", color=OURS, linewidth=2, markersize=9)
    label = "this plan, with its 90 % interval"
    axes.plot(
        report.poses, error.expected, "D", color=OURS, markersize=9, markeredgecolor="white", label=label
    )
    log_ticks(axes, "y", min(error.p05, *best), max(error.p95, *high))
    axes.grid(axis="y", color=SOFT, alpha=0.15)
    axes.set_xticks(poses)
    axes.set_xlabel("poses")
    axes.set_ylabel("expected position error [mm]")
    axes.set_title("What further poses bring", fontsize="medium")
    below(axes, 1)
