"""The featured plan of the study of pose selection, made ready for its recording."""

import numpy as np

from testbench.bench.campaign import Cell
from testbench.data.dataset import Dataset
from testbench.design.rows import deflection_rows
from testbench.design.specification import Specification, promise_of
from testbench.errors import Array
from testbench.model.vjm import chain
from testbench.studies.pose_selection import words as text
from testbench.studies.pose_selection.ground import FITS, RANDOM, Chosen, Ground
from testbench.studies.pose_selection.summary import high
from testbench.views.recording import PlanScene, Point, Sweep
from testbench.views.recording.style import GREENS, LOAD, MEASURED, NOISE, NOMINAL, ORANGES, Colour
from testbench.views.report import MM, Report, middle
from testbench.views.tables import grid

COLOURS: dict[str, Colour] = {
    "test": GREENS[0],
    "I": NOMINAL,
    "D": ORANGES[0],
    "G": LOAD,
    "A": GREENS[1],
    "E": MEASURED,
    RANDOM: NOISE,
}
"""A colour a criterion."""


def scene(
    cell: Cell, ground: Ground, specification: Specification, chosen: Chosen, first: Dataset, report: Report
) -> PlanScene:
    """The featured plan: its poses, where errors remain, the curve of accuracy.

    Args:
        cell: The arm.
        ground: Candidates, tasks, workspace.
        specification: That of the plan.
        chosen: The plan.
        first: Its runs, first seed.
        report: report.json.
    """
    promised = promise_of(
        specification,
        chosen.q,
        chosen.load,
        deflection_rows(specification.experiment, chosen.q, specification.loads[0]),
    )
    moved = MM * np.sqrt(np.square(first.deflection).sum(axis=2).mean(axis=1))
    error, where = MM * promised.error, report["where"]
    seeds = report["seed"]
    return PlanScene(
        cell=cell,
        scenario=report["scenario"],
        parameters=report["study"],
        seed=seeds if isinstance(seeds, int) else seeds[0],
        station=ground.study.station,
        loads_kg=(ground.study.payload,),
        load=chosen.load,
        candidates=_tool(cell, ground.candidates.q),
        q=chosen.q,
        pose_words=[
            _pose_words(k, q, mm, um)
            for k, (q, mm, um) in enumerate(zip(chosen.q, moved, error, strict=True))
        ],
        deflection_mm=moved,
        error_mm=error,
        tasks=_tool(cell, ground.tasks),
        task_error_mm=np.array([middle(v) for v in where["tasks_mm"]]),
        field=_tool(cell, ground.workspace),
        field_error_mm=np.array([middle(v) for v in where["workspace_mm"]]),
        field_words="median error of the predicted deflection (mm)",
        summary=_summary(report),
        tables={"Answers": "\n".join(f"- {line}" for line in text.statements(report))},
        sweep=_sweep(report),
    )


def _tool(cell: Cell, q: Array) -> Array:
    return chain(cell.vjm, q).position


def _pose_words(k: int, q: Array, moved: float, error: float) -> str:
    angles = ", ".join(f"{angle:.1f}" for angle in np.rad2deg(q))
    return (
        f"**Run {k + 1}**: joints {angles} deg. Measured deflection {moved:.2f} mm RMS; error to expect "
        f"after identification {error:.3f} mm."
    )


def _summary(report: Report) -> str:
    poses = report["dataset"]["poses"]
    head = ["plan", "tasks, mm", "95 %", "workspace, mm"]
    rows = []
    for name, own in report["errors"][FITS[0]].items():
        row = next(r for r in own if r["poses"] == poses)
        tasks = row["tasks_mm"]
        top = f"{high(tasks):.3f}" if isinstance(tasks, dict) else "-"
        rows.append([name, f"{middle(tasks):.3f}", top, f"{middle(row['workspace_mm']):.3f}"])
    first, second, *_ = text.statements(report)
    lines = "\n".join(grid(head, rows))
    return (
        f"### Which {poses} poses, to predict best where the robot works?\n\n#### **{first}**\n\n{second}\n\n"
        f"Median error, {FITS[0]}:\n\n{lines}"
    )


def _sweep(report: Report) -> Sweep:
    """Error at the tasks against the number of poses, a line a criterion."""
    errors = report["errors"][FITS[0]]
    points = []
    for name, rows in errors.items():
        for row in rows:
            value = row["tasks_mm"]
            ends = (value["p05"], value["p95"]) if isinstance(value, dict) else (value, value)
            points.append(Point(row["poses"], name, middle(value), *ends))
    first, second, *_ = text.statements(report)
    seeds = report["seed"]
    return Sweep(
        scenario=report["scenario"],
        parameters=report["study"],
        seed=seeds if isinstance(seeds, int) else seeds[0],
        question="How many poses, chosen by which criterion?",
        answer=second,
        swept="poses",
        swept_unit="1",
        measured="RMS error at the tasks",
        unit="mm",
        points=points,
        colours={name: COLOURS[name] for name in errors},
        remarks=first,
    )
