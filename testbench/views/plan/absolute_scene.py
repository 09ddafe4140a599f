"""A plan of absolute readings as a scene for the Rerun viewer; importing this module imports rerun."""

import numpy as np

from testbench.bench.absolute_plan import AbsolutePlanned
from testbench.bench.absolute_plan_report import AbsolutePlanReport
from testbench.bench.campaign import Cell
from testbench.errors import Array
from testbench.views.plan.absolute_tables import words
from testbench.views.plan.scene import BEST, LOOKS, RANDOM
from testbench.views.recording.error_maps import PlaceScene
from testbench.views.recording.plan_world import PlanScene
from testbench.views.recording.swept import Point, Sweep
from testbench.views.schema import Column


def scene(cell: Cell, planned: AbsolutePlanned, candidates: Array) -> PlanScene:
    """A plan and the error to expect over the workspace; tools of feasible poses, (c, 3) [m]."""
    report, text = planned.report, words(planned.report)
    return PlanScene(
        cell=cell,
        station=report.tracker_m,
        payload=np.full(len(report.plan), max(report.loads_kg, default=0.0)),
        candidates=candidates,
        q=planned.chosen.q,
        pose_words=[text.block("step", row=row) for row in report.plan],
        deflection_mm=np.array([row.expected_sag_mm for row in report.plan]),
        error_mm=np.array([row.expected_error_mm for row in report.plan]),
        map=PlaceScene(report.map),
        summary=text.summary(then=("statements", "hidden")),
        tables=f"### Poses in the order of measuring\n\n{text.block('poses')}",
        sweep=_sweep(report),
        sweep_words=f"### What do further poses bring?\n\n{text.block('curve')}",
    )


def _sweep(report: AbsolutePlanReport) -> Sweep:
    """Error over the workspace by the number of poses."""
    points: list[Point] = []
    for row in report.curve:
        points += [Point(row.poses, BEST, row.greedy_mm), Point(row.poses, RANDOM, row.random)]
    error = Column("", "expected position error", "mm")
    return Sweep(Column("poses", "poses"), error, points, LOOKS)
