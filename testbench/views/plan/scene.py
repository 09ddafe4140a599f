"""A plan as a scene for the Rerun viewer; importing this module imports rerun."""

from collections.abc import Mapping

import numpy as np

from testbench.bench.campaign import Cell
from testbench.bench.plan import Planned
from testbench.bench.plan_report import PlanReport
from testbench.bench.rows import MM
from testbench.errors import Array
from testbench.model.vjm import chain
from testbench.views.colours import GREY, NOMINAL
from testbench.views.plan.tables import words
from testbench.views.recording import PlanScene, Point, Sweep

NAME = "testbench plan"
BEST, RANDOM = "each pose the best next one", "random poses, 10 to 90 %"


def scene(cell: Cell, planned: Planned, candidates: Array, parameters: Mapping[str, object]) -> PlanScene:
    """The scene of a plan, its tasks, and the error to expect all over the workspace.

    Args:
        cell: The arm.
        planned: The plan and what it promises.
        candidates: Tool positions of the feasible poses, (c, 3) [m].
        parameters: What was asked for, as plain data.
    """
    report, errors, text = planned.report, planned.workspace.error, words(planned.report)
    known = np.isfinite(errors)
    summary = [f"### {text.block('question')}", f"#### **{text.block('answer')}**", text.block("statements")]
    return PlanScene(
        cell=cell,
        scenario=NAME,
        parameters=parameters,
        seed=report.seed,
        station=report.tracker_m,
        loads_kg=report.loads_kg,
        load=planned.plan.load,
        candidates=candidates,
        q=planned.plan.q,
        pose_words=[text.block("step", row=row) for row in report.plan],
        deflection_mm=np.array([row.expected_deflection_mm for row in report.plan]),
        error_mm=np.array([row.expected_error_mm for row in report.plan]),
        tasks=np.array([row.tool_m for row in report.tasks]),
        task_error_mm=np.array([row.expected_error_mm for row in report.tasks]),
        field=chain(cell.vjm, planned.plan.specification.workspace).position[known],
        field_error_mm=MM * errors[known],
        field_words="expected error after identification (mm)",
        summary="\n\n".join(summary),
        tables={"Poses in the order of measuring": text.block("poses"), "Tasks": text.block("tasks")},
        sweep=_sweep(report, text.block("curve")),
    )


def _sweep(report: PlanReport, text: str) -> Sweep | None:
    """Error at the tasks over the number of poses; without a prior few poses leave it without a bound."""
    points = []
    for row in report.curve:
        if row.bounded:
            best, random = row.bounded
            points.append(Point(row.poses, BEST, best, best, best))
            points.append(Point(row.poses, RANDOM, random.median, random.p05, random.p95))
    if not points:
        return None
    return Sweep(
        scenario=NAME,
        parameters={},
        seed=report.seed,
        swept="poses",
        swept_unit="1",
        measured="expected error at the tasks",
        unit="mm",
        points=points,
        colours={BEST: NOMINAL, RANDOM: GREY},
        words=f"### What does each further pose bring?\n\n{text}",
    )
