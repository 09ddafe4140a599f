"""What pose selection leaves beside its report: dataset and recording of the featured plan, first seed."""

import numpy as np

from testbench.arm.library import find_arm
from testbench.bench.campaign import Cell, build_cell
from testbench.bench.rows import MM
from testbench.data.csvfile import write_csv
from testbench.data.dataset import Dataset
from testbench.design.rows import deflection_rows
from testbench.design.specification import promise_of
from testbench.errors import Array
from testbench.model.vjm import chain
from testbench.studies.pose_selection.figure import LOOKS
from testbench.studies.pose_selection.measure import Bench, build_bench
from testbench.studies.pose_selection.report import PoseReport
from testbench.studies.pose_selection.rows import Angles
from testbench.studies.pose_selection.settings import PLANNED, Settings
from testbench.studies.pose_selection.tables import PLAN, POSES, TASKS
from testbench.studies.pose_selection.trial import first_runs
from testbench.studies.pose_selection.ways import poses_of
from testbench.studies.study import Run
from testbench.trials.spread import Number, middle
from testbench.views.markdown import grid, line
from testbench.views.recording import PlanScene, Sweep, write_plan
from testbench.views.recording.sweep import points


def write(run: Run[Settings, PoseReport]) -> None:
    """dataset.csv and recording.rrd."""
    cell = build_cell(find_arm(run.settings.arm))
    bench = build_bench(cell, run.settings)
    first = first_runs(bench, run.settings, run.seeds[0])
    write_csv(first, tuple(j.name for j in cell.arm.joints), run.folder / "dataset.csv")
    write_plan(run.folder / "recording.rrd", scene(run, bench, first))


def scene(run: Run[Settings, PoseReport], bench: Bench, first: Dataset) -> PlanScene:
    """The featured plan: its poses, where errors remain, the curve of accuracy."""
    report, words, asked, spec = run.report, run.words, run.settings, bench.spec
    chosen = poses_of(asked, "test", spec.poses, run.seeds[0])
    ahead = deflection_rows(spec.experiment, chosen.q, spec.loads[0])
    error = MM * promise_of(spec, chosen.q, chosen.load, ahead).error
    moved = MM * np.sqrt(np.square(first.deflection).sum(axis=2).mean(axis=1))
    return PlanScene(
        cell=bench.cell,
        scenario=report.scenario,
        parameters=run.parameters,
        seed=run.seeds[0],
        station=asked.scope.station,
        loads_kg=(asked.scope.payload,),
        load=chosen.load,
        candidates=_tool(bench.cell, asked.scene.candidates),
        q=chosen.q,
        pose_words=[
            _pose_words(k + 1, *pose) for k, pose in enumerate(zip(chosen.q, moved, error, strict=True))
        ],
        deflection_mm=moved,
        error_mm=error,
        tasks=_tool(bench.cell, asked.scene.tasks),
        task_error_mm=_middles(report.where.tasks_mm),
        field=_tool(bench.cell, asked.scene.workspace),
        field_error_mm=_middles(report.where.workspace_mm),
        field_words="median error of the predicted deflection (mm)",
        summary=_summary(run),
        tables={
            "Answers": words.block("statements"),
            "Other ways to measure": grid(run.tables["variants"]),
            "Forecasts on arms drawn from the prior": grid(run.tables["forecasts"]),
        },
        sweep=sweep(run),
    )


def _summary(run: Run[Settings, PoseReport]) -> str:
    parts = [
        f"### {run.words.block('question')}",
        f"#### **{run.words.block('answer')}**",
        f"{run.report.dataset.poses} poses, RMS errors of {PLANNED.name}:",
        grid(run.tables["recorded"]),
    ]
    return "\n\n".join(parts)


def _tool(cell: Cell, q: Angles) -> Array:
    return chain(cell.vjm, np.array(q)).position


def _middles(values: tuple[Number, ...]) -> Array:
    return np.array([middle(v) for v in values])


def _pose_words(number: int, q: Array, moved: float, error: float) -> str:
    angles = ", ".join(f"{angle:.1f}" for angle in np.rad2deg(q))
    return (
        f"**Run {number}**: joints {angles} deg. Measured deflection {moved:.2f} mm RMS. Error to expect "
        f"after identification {error:.3f} mm."
    )


def sweep(run: Run[Settings, PoseReport]) -> Sweep:
    """Error at the tasks against the number of poses, a line a criterion."""
    report = run.report
    parts = [
        "### How many poses, chosen by which criterion?",
        f"#### **{line(run.words.block('number'))}**",
        f"Median error at the tasks, {TASKS.unit}:",
        grid(run.tables["medians"]),
    ]
    levels = [level for own in report.errors[PLANNED.name].values() for level in own]
    return Sweep(
        scenario=report.scenario,
        parameters=run.parameters,
        seed=run.seeds[0],
        question="",
        answer="",
        swept="poses",
        swept_unit="1",
        measured="RMS error at the tasks",
        unit=TASKS.unit,
        points=points(levels, PLAN, POSES, TASKS),
        colours={},
        looks=LOOKS,
        words="\n\n".join(parts),
    )
