"""The page of a plan of absolute readings: its poses, and the error to expect over the workspace."""

from dataclasses import replace

import numpy as np

from testbench.bench.absolute_plan import AbsolutePlanned
from testbench.bench.absolute_plan_report import AbsolutePlanReport
from testbench.bench.campaign import Cell
from testbench.errors import Array
from testbench.trials.spread import Spread
from testbench.views.page.charts import Line, RunChart
from testbench.views.page.page import Seen
from testbench.views.page.scene import Poses, Scene
from testbench.views.plan.absolute_tables import tables
from testbench.views.plan.page import (
    AT_POSES,
    LOOKS,
    MEDIAN,
    ORDER,
    OURS,
    SCALE,
    TENTH,
    THIS,
    around,
    intervals,
    place_map,
)
from testbench.views.plan.world import World
from testbench.views.schema import Column, Table, show

OVER = "Expected position error after calibration (mm)"


def seen(cell: Cell, planned: AbsolutePlanned, candidates: Array) -> Seen:
    """What the page of a plan of absolute readings draws; tools of feasible poses, (c, 3) [m]."""
    report = planned.report
    tools = np.array([row.tool_m for row in report.plan])
    world = World(cell, report.tracker_m, tools, np.empty((0, 3)), candidates)
    own = Line(THIS, OURS, *intervals(report.plan))
    return Seen(
        scene=Scene(cell, SCALE, [_plan(world, planned), around(world, report.map)]),
        map=place_map(report.map, 1, OVER),
        runs=[RunChart(AT_POSES, 0, [str(row.run) for row in report.plan], [own])],
        tables=_tables(report),
    )


def _plan(world: World, planned: AbsolutePlanned) -> Poses:
    q, rows = planned.chosen.q, planned.report.plan
    words = [
        f"Expected sag {row.expected_sag_mm:.2f} mm, position error after calibration "
        f"{show(row.error_mm)} mm. {world.cell.arm.words(one)}."
        for row, one in zip(rows, q, strict=True)
    ]
    names, layers = [f"Run {row.run}" for row in rows], world.measured(q, np.zeros((len(q), 3)))
    return world.around(Poses(ORDER, names, words, world.rigid(q), None, layers))


def _tables(report: AbsolutePlanReport) -> list[Table]:
    every, error, random = tables(report), report.error_mm, report.random_mm
    rows = [
        {"name": THIS, "error": Spread(error.expected, error.p05, error.p95)},
        {"name": TENTH, "error": random.p10_mm},
        {"name": MEDIAN, "error": random.median_mm},
    ]
    columns = (Column("name", "plan"), Column("error", "expected error over the workspace", "mm"))
    return [
        Table(columns, rows, "Beside others", THIS, headline="error", looks=LOOKS),
        replace(every["poses"], title="Poses in the order of measuring"),
        replace(every["curve"], title="Error over the workspace by the number of poses"),
    ]
