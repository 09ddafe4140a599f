"""Figure of a measurement plan: error against the number of poses, error of every task, top view."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.bench.plan_report import PlanReport
from testbench.data.dataset import Mask
from testbench.errors import Array
from testbench.views.colours import MEASURED, NOMINAL, TASK, hexadecimal
from testbench.views.figure import SMALL, SOFT, log_ticks, page, quiet, say

OURS, WORK, TRACKER = (hexadecimal(colour) for colour in (NOMINAL, TASK, MEASURED))
MARGIN = 0.4  #: Space around everything in the top view [m].
APART = 0.06  #: Least distance of two numbers over the width of the top view [1].
NUMBERED = 20  #: Most poses whose number stands beside them.
NAMED = 40  #: Most tasks whose number stands on the axis.


def overview(report: PlanReport, candidates: Array) -> Figure:
    """How many poses, what the tasks get, where it all is: plan, tasks and feasible tools, (c, 3) [m]."""
    figure = page(9.8)
    above, below = figure.subfigures(2, 1, height_ratios=(1.7, 1))  # type: ignore[misc]  # stubs: one or several
    left, right = above.subplots(1, 2)
    centre = below.subplots()
    _poses(left, report)
    _tasks(centre, report)
    plan, tasks = (np.array([row.tool_m for row in rows]) for rows in (report.plan, report.tasks))
    pulled = np.array([row.pull_N is not None for row in report.plan])
    top_view(right, Top(plan, tasks, candidates, np.array(report.base_m), report.tracker_m, pulled))
    for axes in (left, centre, right):
        quiet(axes)
    error, share = report.error_mm.expected, report.certificate.percent
    say(
        figure,
        f"{report.arm}, {report.model}: {report.poses} poses promise an error of {error:.3f} mm at the tasks",
        f"Expected RMS errors of the tool under the load. The plan is at least {share} % efficient: no other "
        "poses of as many promise much less. Dashed: all tasks together.",
    )
    return figure


def _poses(axes: Axes, report: PlanReport) -> None:
    """Greedy plans as a line, random plans as a band, the plan as a point."""
    line = [(k, error) for k, error in enumerate(report.greedy_mm, start=1) if error is not None]
    random = {row.poses: row.bounded[1] for row in report.curve if row.bounded}
    low, middle, high = ([getattr(s, end) for s in random.values()] for end in ("p05", "median", "p95"))
    axes.fill_between(list(random), low, high, color=SOFT, alpha=0.2, linewidth=0)
    axes.plot(list(random), middle, "o--", color=SOFT, markersize=4, label="random poses: median, 10 to 90 %")
    axes.plot(*np.transpose(line), color=OURS, linewidth=2, label="each pose the best next one")
    error, poses = report.error_mm, report.poses
    axes.plot([poses] * 2, [error.p05, error.p95], "_-", color=OURS, linewidth=2, markersize=9, zorder=4)
    label = "this plan on the whole arm, with its 90 % interval"
    axes.plot(
        poses, error.expected, "D", color=OURS, markersize=9, markeredgecolor="white", zorder=4, label=label
    )
    target = report.advice.target_mm
    axes.axhline(target, color=SOFT, linestyle=":", zorder=1)
    axes.set_xlim(0, len(report.greedy_mm) + 1)
    axes.text(axes.get_xlim()[1], target, f"{target:g} mm ", ha="right", va="bottom", color=SOFT)
    shown = [value for _, value in line if value < 100 * error.p95]
    log_ticks(axes, "y", min(error.p05, *shown), max(target, error.p95, *shown, *high[:1]))
    axes.grid(axis="y", color=SOFT, alpha=0.15)
    axes.set_xlabel("poses")
    axes.set_ylabel("expected error at the tasks [mm]")
    axes.set_title("What each further pose brings", fontsize="medium")
    below(axes, 1)


def below(axes: Axes, columns: int) -> None:
    """The legend of some axes, below them."""
    place = (0.5, -0.13)
    axes.legend(frameon=False, fontsize=SMALL, loc="upper center", bbox_to_anchor=place, ncols=columns)


def _tasks(axes: Axes, report: PlanReport) -> None:
    """Errors of the tasks, the largest first."""
    rows, overall = report.worst, report.error_mm.expected
    errors = [row.error_mm for row in rows]
    x = np.arange(len(rows)) + 1
    width = max(0.6, min(5.0, 100 / len(rows)))
    axes.vlines(x, [e.p05 for e in errors], [e.p95 for e in errors], color=OURS, alpha=0.45, linewidth=width)
    axes.plot(
        x, [e.median for e in errors], "o", color=OURS, markersize=5 if len(rows) <= 3 * NUMBERED else 2
    )
    axes.axhline(overall, color=SOFT, linestyle="--", linewidth=1, zorder=1)
    axes.text(
        1.01, overall, f"all\n{overall:.3f}", transform=axes.get_yaxis_transform(), va="center", color=SOFT
    )
    axes.set_ylim(0, 1.05 * max(e.p95 for e in errors))
    axes.set_xlim(0.3, len(rows) + 0.7)
    few = len(rows) <= NAMED
    axes.set_xticks(x if few else [], [str(row.task) for row in rows] if few else [], fontsize=SMALL)
    axes.set_xlabel("task, the largest error first" if few else "tasks, the largest error first")
    axes.set_ylabel("expected error [mm]")
    axes.set_title("Every task, with its 90 % interval", fontsize="medium")


@dataclass(frozen=True)
class Top:
    """What is seen from above."""

    plan: Array  #: Tools of the plan, in its order, (poses, 3) [m].
    tasks: Array  #: Tools of the tasks, (tasks, 3) [m].
    candidates: Array  #: Tools of the feasible poses, (c, 3) [m].
    base: Array  #: Where the arm stands, (3,) [m].
    tracker: tuple[float, float, float] | None  #: Where the tracker stands [m].
    pulled: Mask | None = None  #: In which poses of the plan a force pulls, (poses,); None for none.


def top_view(axes: Axes, top: Top) -> None:
    """Tool positions seen from above."""
    plan, tasks, candidates = top.plan, top.tasks, top.candidates
    few, base = len(plan) <= NUMBERED, top.base[:2]
    places: list[Array] = [candidates[:, :2], tasks[:, :2], plan[:, :2], base[None]]
    grey = f"{len(candidates):,} feasible poses"
    axes.plot(*candidates[:, :2].T, ".", color=SOFT, alpha=0.3, markersize=3, label=grey, rasterized=True)
    if len(tasks):
        axes.plot(*tasks[:, :2].T, "s", color=WORK, markersize=5, label="tasks", zorder=3)
    pulled = np.zeros(len(plan), dtype=bool) if top.pulled is None else top.pulled
    label = "plan, numbered" if few else "plan"
    size = 5
    axes.plot(*plan[~pulled, :2].T, "o", color=OURS, markersize=size, label=label, zorder=4)
    if pulled.any():
        axes.plot(
            *plan[pulled, :2].T, "D", color=OURS, markersize=size * 0.75, label="plan, pulled", zorder=4
        )
    axes.plot(*base, "+", color="black", markersize=12, zorder=4, label="base")
    title = "Tool from above; visibility NOT checked"
    if top.tracker is not None:
        places.append(np.array([top.tracker[:2]]))
        axes.plot(*top.tracker[:2], "^", color=TRACKER, markersize=11, label="tracker", zorder=4)
        title = "Tool from above"
    every = np.vstack(places)
    (left, bottom), (right, top) = every.min(axis=0) - MARGIN, every.max(axis=0) + MARGIN
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axes.set_title(title, fontsize="medium")
    if few:
        _numbers(axes, plan[:, :2], APART * (right - left))
    below(axes, 2)


def _numbers(axes: Axes, places: Array, least: float) -> None:
    """The number of every pose in a disc on its place, moved aside where discs would cover one another."""
    turn = 2.4 * np.arange(len(places))  # poses at one place part by their numbers
    at = places + 1e-3 * least * np.column_stack([np.cos(turn), np.sin(turn)])
    for _ in range(300):
        way = at[:, None] - at[None]
        far = np.linalg.norm(way, axis=-1) + 2 * least * np.eye(len(at))
        push = np.maximum(least - far, 0) / far
        at += 0.25 * (push[..., None] * way).sum(axis=1)
    disc = {"boxstyle": "circle,pad=0.2", "facecolor": OURS, "edgecolor": "white", "linewidth": 0.6}
    for k, (place, own) in enumerate(zip(places, at, strict=True), start=1):
        axes.annotate(
            str(k),
            place,
            xytext=own,
            color="white",
            fontsize=SMALL,
            ha="center",
            va="center",
            zorder=5,
            bbox=disc,
            arrowprops={"arrowstyle": "-", "color": OURS, "shrinkA": 0, "shrinkB": 0},
        )
