"""Figures of pose selection: error against poses, criterion by criterion, and what else would help."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbench.studies.pose_selection.report import PoseReport
from testbench.studies.pose_selection.settings import BARE, INCUMBENT, PLANNED, RANDOM
from testbench.studies.pose_selection.tables import EXPECTED, JUDGED, PLAN, POSES, TASKS, VARIANT, WORKSPACE
from testbench.trials.spread import middle, span
from testbench.views.colours import GREY, SERIES, Look
from testbench.views.figure import SMALL, SOFT, Line, body, dots, draw_line, key, log_ticks, page, quiet, say
from testbench.views.gains import more
from testbench.views.schema import Column

CRITERIA = ("test", "I", "D", "A", "E", "G", RANDOM)
LOOKS = {
    name: Look(shade, 0 if name == RANDOM else k, prior=name == RANDOM)
    for k, (name, shade) in enumerate(zip(CRITERIA, (*SERIES[: len(CRITERIA) - 1], GREY), strict=True))
}
"""One a criterion, random poses dashed."""
BANDS = ("test", RANDOM)  #: Those whose spread is drawn.
CALLED = "Plans for the tasks (test) and by the criteria I, D, A, E, G."


def curves(report: PoseReport) -> Figure:
    """Error against the number of poses: at the tasks, over the workspace, without prior, by joints alone."""
    figure = page(8.6)
    part = body(figure)
    (left, centre), (right, last) = part.subplots(2, 2)
    _curve(left, report, PLANNED.name, TASKS, "at the tasks")
    _curve(centre, report, PLANNED.name, WORKSPACE, "over the workspace")
    _curve(right, report, BARE.name, TASKS, "at the tasks, identified without prior")
    _curve(last, report, INCUMBENT.name, TASKS, "at the tasks, joints alone by least squares")
    enough = report.recommendation.within_mm
    left.axhline(enough, color=SOFT, linewidth=0.8)
    left.text(
        1, enough, f"{enough:g} mm", transform=left.get_yaxis_transform(), color=SOFT, ha="right", va="bottom"
    )
    log_ticks(left, "y", min(enough, left.dataLim.ymin), max(enough, left.dataLim.ymax))
    key(part, left.get_legend_handles_labels(), columns=7)
    say(figure, _headline(report), f"RMS errors. {_reading(report, 'bands')} {CALLED}")
    return figure


def _headline(report: PoseReport) -> str:
    """Planned and random poses at the tasks."""
    own = report.gains.random
    ours, theirs = middle(own.ours_mm), middle(own.theirs_mm)
    return (
        f"{report.arm}, {PLANNED.name}: {report.dataset.poses} planned poses leave {ours:.3f} mm at the "
        f"tasks, random ones {theirs:.3f} mm, {more(own)}"
    )


def _reading(report: PoseReport, drawn: str) -> str:
    seeds, noise = report.seed, f"{report.dataset.sigma_um:g} um of noise"
    if isinstance(seeds, int):
        return f"One seed, {noise}."
    return f"Marks: medians, {drawn}: {span(len(seeds))} of {len(seeds)} seeds, {noise}."


def _curve(axes: Axes, report: PoseReport, fit: str, error: Column, words: str) -> None:
    for name, levels in report.errors[fit].items():
        draw_line(axes, POSES, error, Line(levels, LOOKS[name], name, band=name in BANDS))
    log_ticks(axes, "y", *axes.dataLim.intervaly)
    ticks = [level.poses for level in report.errors[fit][RANDOM]]
    axes.set_xscale("log")
    axes.set_xticks(ticks, [str(n) for n in ticks])
    axes.set_xticks([], minor=True)
    axes.set_xlabel("poses measured")
    axes.set_ylabel(f"RMS error, {error.heading} [{error.unit}]")
    axes.set_title(words, fontsize="medium")
    quiet(axes)


def featured(report: PoseReport) -> Figure:
    """The featured number of poses: every criterion, what could be done beyond, and where plans pay."""
    figure = page(7.6)
    above, below = figure.subfigures(2, 1)  # type: ignore[misc]  # stubs: one or several
    left, centre = above.subplots(1, 2)
    right, last = below.subplots(1, 2)
    _ratios(last, report)
    looks = [LOOKS[c.plan] for c in report.criteria]
    for axes, error in ((left, TASKS), (centre, WORKSPACE)):
        dots(axes, report.criteria, PLAN, error, looks)
        axes.set_title(f"{report.dataset.poses} poses by criterion, {error.heading}", fontsize="medium")
    dots(right, report.worth, VARIANT, JUDGED, [LOOKS["test"]] * len(report.worth))
    expected = [EXPECTED.value(row) for row in report.worth]
    right.plot(expected, range(len(expected)), "|", color=SOFT, markersize=16, label="forecast")
    right.set_title("what else would help; grey strokes: forecast", fontsize="medium")
    for axes in (left, centre, right):
        axes.set_xlim(left=0)
    say(
        figure,
        _headline(report),
        f"RMS errors of {PLANNED.name}. {_reading(report, 'lines')} {CALLED} Below right: plans made for "
        "each fit, medians; a plan pays left of 1.",
    )
    return figure


def _ratios(axes: Axes, report: PoseReport) -> None:
    """Planned over random error by fit and ground, filled at the tasks, hollow over the workspace."""
    rows = report.grounds
    for face, where in ((LOOKS["test"].hex, "tasks"), ("white", "workspace")):
        ratios = [getattr(row, where).ratio for row in rows]
        axes.plot(ratios, range(len(rows)), "o", color=LOOKS["test"].hex, markerfacecolor=face, label=where)
    axes.axvline(1, color=SOFT, linewidth=0.8)
    log_ticks(axes, "x", *axes.dataLim.intervalx)
    axes.set_yticks(range(len(rows)), [f"{row.fit}, {row.ground}" for row in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlabel("error, planned over random poses")
    axes.set_title("what a plan brings", fontsize="medium")
    axes.legend(frameon=False, fontsize=SMALL, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)
    quiet(axes)
