"""The page of a plan: its poses with tracker and loads, errors to expect at tasks and over the workspace."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.bench.absolute_plan_report import AbsolutePoseRow
from testbench.bench.baselines import JOINTS
from testbench.bench.campaign import Cell
from testbench.bench.error_places import ErrorPlaces
from testbench.bench.plan import Planned
from testbench.bench.plan_report import PlanReport, PoseRow, Row
from testbench.data.dataset import Ids
from testbench.errors import Array
from testbench.trials.spread import Spread
from testbench.views.colours import GREY, NOMINAL, TASK, Look, look
from testbench.views.page.charts import Line, PlaceMap, RunChart
from testbench.views.page.page import Seen
from testbench.views.page.scene import Poses, Scene
from testbench.views.picked import of_all, picked
from testbench.views.plan.tables import tables
from testbench.views.plan.world import World, places
from testbench.views.schema import Column, Table, show

OURS, OTHERS, WORK = Look(NOMINAL, 0, prior=True), Look(GREY, 0, prior=False), Look(TASK, 1, prior=True)
THIS, TENTH, MEDIAN = "this plan", "random poses, best tenth", "random poses, median"
ALONE = "joints alone"
LOOKS = {THIS: OURS, ALONE: look(JOINTS, "none"), TENTH: OTHERS, MEDIAN: OTHERS}
NOWHERE = "no bound"
SCALE = "Nothing is magnified; loads are arrows of one length."
AT_TASKS = "Expected error at each task, 90 % intervals (mm)"
AT_POSES = "Expected error in each planned pose, 90 % intervals (mm)"
ORDER = "Plan, in the order of measuring"
OVER = "Expected error after identification, under the first load (mm)"


def seen(cell: Cell, planned: Planned, candidates: Array) -> Seen:
    """What the page of a plan draws; tools of feasible poses, (c, 3) [m]."""
    report = planned.report
    plan, work = (np.array([row.tool_m for row in rows]) for rows in (report.plan, report.tasks))
    world = World(cell, report.tracker_m, plan, work, candidates)
    errors = np.array([row.expected_error_mm for row in report.tasks])
    some = picked(errors, np.arange(len(errors)))
    tasks, note = [report.tasks[k] for k in some], of_all(len(some), len(errors), "tasks")
    task, pose = Line("task", WORK, *intervals(tasks)), Line(THIS, OURS, *intervals(report.plan))
    groups = _plan(world, planned), _tasks(world, planned, some), around(world, report.map)
    return Seen(
        scene=Scene(cell, SCALE, groups),
        map=place_map(report.map, 2, OVER),
        runs=[
            RunChart(AT_TASKS, 1, [str(row.task) for row in tasks], [task], note=note),
            RunChart(AT_POSES, 0, [str(row.run) for row in report.plan], [pose]),
        ],
        tables=_tables(report),
    )


def intervals(rows: Sequence[Row | AbsolutePoseRow]) -> tuple[Array, tuple[Array, Array]]:
    """Errors to expect, and the ends of their intervals [mm]."""
    keys = ("expected_error_mm", "expected_error_p05_mm", "expected_error_p95_mm")
    middle, low, high = (np.array([getattr(row, key) for row in rows]) for key in keys)
    return middle, (low, high)


def _plan(world: World, planned: Planned) -> Poses:
    q, rows = planned.plan.q, planned.report.plan
    force = np.array([row.pull_N or [0, 0, -GRAVITY * row.load_kg] for row in rows])
    names, words = [f"Run {row.run}" for row in rows], [_said(world.cell, row) for row in rows]
    return world.around(Poses(ORDER, names, words, world.rigid(q), None, world.measured(q, force)))


def _said(cell: Cell, row: PoseRow) -> str:
    return (
        f"{'Hang ' if row.pull_N is None else ''}{row.load}. Expected deflection "
        f"{row.expected_deflection_mm:.2f} mm, error of its prediction {show(row.error_mm)} mm. "
        f"{cell.arm.words(np.array(row.q))}."
    )


def _tasks(world: World, planned: Planned, some: Ids) -> Poses:
    q, rows = planned.plan.specification.tasks.q[some], [planned.report.tasks[k] for k in some]
    words = [
        f"Expected deflection {row.expected_deflection_mm:.2f} mm, error of its prediction "
        f"{show(row.error_mm)} mm. {world.cell.arm.words(one)}."
        for row, one in zip(rows, q, strict=True)
    ]
    pulled, first = world.pulled(q, np.array([row.force_N for row in rows])), _worst(rows)
    names = [f"Task {row.task}" for row in rows]
    return world.around(Poses("Tasks", names, words, world.rigid(q), None, pulled, first))


def _worst(rows: Sequence[Row]) -> int:
    return int(np.argmax([row.expected_error_mm for row in rows]))


def around(world: World, found: ErrorPlaces) -> Poses:
    """The arm all over the workspace, in the order of the report."""
    names, q = found.compared, np.array(found.q)
    every = zip(*(found.errors(name).tolist() for name in names), strict=True)
    words = [
        f"Expected error: {', '.join(map(_error, names, mm))}. {joints}."
        for mm, joints in zip(every, found.joints, strict=True)
    ]
    return places(world, q, words, 0)


def _error(name: str, mm: float) -> str:
    return f"{name} {NOWHERE if np.isnan(mm) else f'{mm:.3f} mm'}"


def place_map(found: ErrorPlaces, group: int, title: str) -> PlaceMap:
    """Errors to expect, a map a model; `group` is that of the places in the scene."""
    names = found.compared
    lines = [Line(name, OURS if name == names[-1] else _look(name), found.errors(name)) for name in names]
    without = NOWHERE if any(map(found.unbounded, names)) else ""
    return PlaceMap(title, group, np.array(found.position_m), lines, "Where it will err", without)


def _look(name: str) -> Look:
    return look(name, "none")


def _tables(report: PlanReport) -> list[Table]:
    every = tables(report)
    return [
        _others(report),
        replace(every["poses"], title="Poses in the order of measuring"),
        replace(every["tasks"], title="Tasks of the largest errors"),
        replace(every["curve"], title="Error at the tasks by the number of poses"),
    ]


def _others(report: PlanReport) -> Table:
    """The plan beside joints alone and random poses; of a model that is not the whole arm in two columns."""
    error, random = report.error_mm, report.random_plans
    own = {"name": THIS, "error": Spread(error.expected, error.p05, error.p95), "model": random.planned_mm}
    alone = {"name": ALONE, "error": report.joints_alone_mm}
    others = [{"name": TENTH, "model": random.best_tenth_mm}, {"name": MEDIAN, "model": random.median_mm}]
    columns = [Column("name", "plan"), Column("error", "expected error at the tasks", "mm")]
    if math.isclose(random.planned_mm, error.expected, rel_tol=1e-3):
        others = [{"name": row["name"], "error": row["model"]} for row in others]
    else:
        columns.append(Column("model", f"were the arm {report.model} and nothing else", "mm"))
    rows = [own, *others, alone]
    return Table(tuple(columns), rows, "Beside others", THIS, headline="error", looks=LOOKS)
