"""A plan as a scene for the Rerun viewer; importing this module imports rerun."""

import numpy as np

from testbench.bench.campaign import Cell
from testbench.bench.plan import Planned
from testbench.model.vjm import chain
from testbench.views.plan_page import one_page
from testbench.views.plan_text import advice, answer, certificate, step_words
from testbench.views.recording import PlanScene, Point, Sweep
from testbench.views.report import MM, Report

NAME = "testbench plan"
BEST, RANDOM = "planned one by one", "random"


def scene(cell: Cell, planned: Planned, report: Report, parameters: object) -> PlanScene:
    """The scene of a plan, its tasks, and the error to expect all over the workspace.

    Args:
        cell: The arm.
        planned: The plan and what it promises.
        report: The same as `plan_report.report` makes it.
        parameters: What was asked for, as plain data.
    """
    wish, plan, errors = planned.wish, planned.plan, planned.workspace.error
    known = np.isfinite(errors)
    return PlanScene(
        cell=cell,
        scenario=NAME,
        parameters=parameters,
        seed=wish.seed,
        station=None if wish.station is None else wish.station.position,
        loads_kg=wish.loads,
        load=plan.load,
        candidates=chain(cell.vjm, planned.found.q).position,
        q=plan.q,
        pose_words=step_words(report),
        deflection_mm=MM * planned.deflection,
        error_mm=MM * planned.poses.error,
        tasks=chain(cell.vjm, wish.tasks.q).position,
        task_error_mm=MM * planned.tasks.error,
        field=chain(cell.vjm, planned.specification.workspace).position[known],
        field_error_mm=MM * errors[known],
        field_words="expected error after identification (mm)",
        summary="\n\n".join(
            ["### Which poses to measure?", f"#### **{answer(report)}**", certificate(report), advice(report)]
        ),
        tables={"The plan": one_page(report)},
        sweep=_sweep(report, wish.seed, parameters),
    )


def _sweep(report: Report, seed: int, parameters: object) -> Sweep | None:
    """Error at the tasks over the number of poses; without a prior few poses leave it without a bound."""
    rows = [row for row in report["curve"] if None not in row.values()]
    if not rows:
        return None
    keys = {
        BEST: ("greedy_mm",) * 3,
        RANDOM: ("random_median_mm", "random_p10_mm", "random_p90_mm"),
    }
    return Sweep(
        scenario=NAME,
        parameters=parameters,
        seed=seed,
        question="What does each further pose bring?",
        answer=advice(report),
        swept="poses",
        swept_unit="1",
        measured="expected error at the tasks",
        unit="mm",
        points=[
            Point(row["poses"], name, *(row[key] for key in line))
            for name, line in keys.items()
            for row in rows
        ],
        colours={},
        remarks="The spread of random plans is their best and worst tenth.",
    )
