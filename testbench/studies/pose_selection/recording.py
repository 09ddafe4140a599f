"""What pose selection leaves beside its report: dataset and recording of the featured plan, first seed."""

from dataclasses import replace

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import Cell, build_cell
from testbench.bench.error_places import Meaning, error_places, places_at
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
from testbench.studies.pose_selection.rows import Angles, Where
from testbench.studies.pose_selection.settings import PLANNED, Settings
from testbench.studies.pose_selection.tables import PLAN, POSES, TASKS
from testbench.studies.pose_selection.trial import first_runs
from testbench.studies.pose_selection.ways import poses_of
from testbench.studies.study import Run
from testbench.trials.spread import middle
from testbench.views.markdown import grid, line
from testbench.views.recording.error_maps import PlaceScene
from testbench.views.recording.plan import write_plan
from testbench.views.recording.plan_world import PlanScene
from testbench.views.recording.stream import Header
from testbench.views.recording.swept import Sweep, points

ERROR = Meaning("error", "of the predicted deflection, median over the trials", "median")


def write(run: Run[Settings, PoseReport]) -> None:
    """dataset.csv and recording.rrd."""
    cell = build_cell(find_arm(run.settings.arm))
    bench = build_bench(cell, run.settings)
    first = first_runs(bench, run.settings, run.seeds[0])
    write_csv(first, cell.arm, run.folder / "dataset.csv")
    header = Header(run.report.scenario, run.parameters, run.seeds[0])
    write_plan(run.folder / "recording.rrd", header, scene(run, bench, first))


def scene(run: Run[Settings, PoseReport], bench: Bench, first: Dataset) -> PlanScene:
    """The featured plan: its poses, where errors remain, the curve of accuracy."""
    where, words, asked, spec = run.report.where, run.words, run.settings, bench.spec
    chosen = poses_of(asked, "test", spec.poses, run.seeds[0])
    ahead = deflection_rows(spec.experiment, chosen.q, spec.loads[0])
    error = MM * promise_of(spec, chosen.q, chosen.load, ahead).error
    moved = MM * np.sqrt(np.square(first.deflection).sum(axis=2).mean(axis=1))
    number = f"{run.report.dataset.poses} poses, RMS errors of {PLANNED.name}:"
    tables = {
        "Answers": words.block("statements"),
        "Other ways to measure": grid(run.tables["variants"]),
        "Forecasts on arms drawn from the prior": grid(run.tables["forecasts"]),
    }
    levels = [level for own in run.report.errors[PLANNED.name].values() for level in own]
    y = replace(TASKS, heading="RMS error at the tasks")
    return PlanScene(
        cell=bench.cell,
        station=asked.scope.ground.station,
        payload=np.full(spec.poses, asked.scope.payload),
        candidates=_tool(bench.cell, asked.scene.candidates),
        q=chosen.q,
        pose_words=[
            _pose_words(k + 1, *pose) for k, pose in enumerate(zip(chosen.q, moved, error, strict=True))
        ],
        deflection_mm=moved,
        error_mm=error,
        map=_map(bench, asked, where),
        summary=words.summary(number, run.tables["recorded"], then=()),
        tables="\n\n".join(f"### {name}\n\n{text}" for name, text in tables.items()),
        sweep=Sweep(replace(POSES, unit=""), y, points(levels, PLAN, POSES, TASKS), LOOKS),
        sweep_words="### How many poses, chosen by which criterion?\n\n"
        f"#### **{line(words.block('number'))}**\n\nMedian error at the tasks, {TASKS.unit}:\n\n"
        f"{grid(run.tables['medians'])}",
    )


def _map(bench: Bench, asked: Settings, where: Where) -> PlaceScene:
    """Errors over the workspace and at the tasks."""
    spec, q = bench.spec, np.array(asked.scene.workspace)
    ahead = deflection_rows(spec.experiment, q, spec.loads[0]) @ spec.experiment.metric.expected
    moved = np.linalg.norm(ahead, axis=1) / np.sqrt(ahead.shape[1] / 3)
    at = places_at(bench.cell.arm, q, _tool(bench.cell, asked.scene.workspace), moved)
    name = PLANNED.name
    found = error_places(at, {name: [middle(v) for v in where.workspace_mm]}, means=ERROR)
    tasks = _tool(bench.cell, asked.scene.tasks), np.array([middle(v) for v in where.tasks_mm])
    return PlaceScene(found, tasks={name: tasks})


def _tool(cell: Cell, q: Angles) -> Array:
    return chain(cell.vjm, np.array(q)).position


def _pose_words(number: int, q: Array, moved: float, error: float) -> str:
    angles = ", ".join(f"{angle:.1f}" for angle in np.rad2deg(q))
    return (
        f"**Run {number}**: joints {angles} deg. Measured deflection {moved:.2f} mm RMS. Error to expect "
        f"after identification {error:.3f} mm."
    )
