"""A plan as a scene for the Rerun viewer; importing this module imports rerun."""

import numpy as np

from testbench.bench.campaign import Cell
from testbench.bench.plan import Planned
from testbench.bench.plan_report import PlanReport
from testbench.errors import Array
from testbench.views.colours import GREY, NOMINAL, Look
from testbench.views.plan.tables import words
from testbench.views.recording.error_maps import PlaceScene
from testbench.views.recording.plan_world import PlanScene
from testbench.views.recording.swept import Point, Sweep
from testbench.views.schema import Column

BEST, RANDOM = "each pose the best next one", "random poses, 10 to 90 %"
LOOKS = {BEST: Look(NOMINAL, 0, prior=False), RANDOM: Look(GREY, 1, prior=False)}


def scene(cell: Cell, planned: Planned, candidates: Array) -> PlanScene:
    """A plan, its tasks and the error to expect over the workspace; tools of feasible poses, (c, 3) [m]."""
    report, text = planned.report, words(planned.report)
    at = np.array([row.tool_m for row in report.tasks])
    expected = np.array([row.expected_error_mm for row in report.tasks])
    sweep = _sweep(report)
    return PlanScene(
        cell=cell,
        station=report.tracker_m,
        payload=np.array([row.load_kg for row in report.plan]),
        pull=np.array([row.pull_N or np.zeros(3) for row in report.plan]) if report.pulls_n else None,
        candidates=candidates,
        q=planned.plan.q,
        pose_words=[text.block("step", row=row) for row in report.plan],
        deflection_mm=np.array([row.expected_deflection_mm for row in report.plan]),
        error_mm=np.array([row.expected_error_mm for row in report.plan]),
        map=PlaceScene(report.map, tasks={report.map.compared[-1]: (at, expected)}),
        summary=text.summary(),
        tables=f"### Poses in the order of measuring\n\n{text.block('poses')}\n\n"
        f"### Tasks\n\n{text.block('tasks')}",
        sweep=sweep,
        sweep_words=f"### What does each further pose bring?\n\n{text.block('curve')}" if sweep else "",
    )


def _sweep(report: PlanReport) -> Sweep | None:
    """Error at the tasks over the number of poses; without a prior few poses leave it without a bound."""
    points: list[Point] = []
    for row in report.curve:
        if row.bounded:
            best, others = row.bounded
            points += [Point(row.poses, BEST, best), Point(row.poses, RANDOM, others)]
    error = Column("", "expected error at the tasks", "mm")
    return Sweep(Column("poses", "poses"), error, points, LOOKS) if points else None
