"""What the page and the recording draw: the featured plan on the arm, and where errors remain."""

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.bench.campaign import Cell
from testbench.bench.rows import MM
from testbench.commands.plan_drawn import ORDER, OURS, SCALE, World
from testbench.design.rows import deflection_rows
from testbench.design.specification import promise_of
from testbench.errors import Array
from testbench.model.vjm import chain
from testbench.studies.pose_selection.measure import Bench, poses_of
from testbench.studies.pose_selection.settings import PLANNED, Angles, Settings
from testbench.studies.study import Run
from testbench.trials.spread import middle
from testbench.views.scene import Line, PlaceMap, RunChart, Scene, Seen

ERRORS = "Error to expect after identification, in each planned pose (mm)"
OVER = "Error of the predicted deflection, median over the trials (mm)"


def drawn(run: Run[Settings], bench: Bench) -> Seen:
    """The featured plan: its poses with what is hung, and the workspace with the errors that remain."""
    asked, spec, cell = run.settings, bench.spec, bench.cell
    chosen = poses_of(asked, "test", spec.poses, run.seeds[0])
    ahead = deflection_rows(spec.experiment, chosen.q, spec.loads[0])
    error = MM * promise_of(spec, chosen.q, chosen.load, ahead).error
    tasks, all_over = _tool(cell, asked.scene.tasks), np.array(asked.scene.workspace)
    world = World(
        cell, asked.scope.ground.station, _tool(cell, chosen.q), tasks, _tool(cell, asked.scene.candidates)
    )
    force = np.tile([0.0, 0.0, -GRAVITY * asked.scope.payload], (spec.poses, 1))
    words = {
        f"Run {k}": f"Error to expect after identification {mm:.3f} mm. {cell.arm.words(q)}."
        for k, (q, mm) in enumerate(zip(chosen.q, error, strict=True), start=1)
    }
    plan = world.poses(ORDER, words, chosen.q, world.measured(chosen.q, force))
    left = np.array([middle(value) for value in run.report.numbers["where"].workspace_mm])
    texts = [f"Error {mm:.3f} mm. {cell.arm.words(q)}." for q, mm in zip(all_over, left, strict=True)]
    line = Line(PLANNED.name, OURS, left)
    return Seen(
        scene=Scene(cell, SCALE, [plan, world.all_over(all_over, texts, int(left.argmax()))]),
        map=PlaceMap(OVER, 1, _tool(cell, all_over), [line]),
        runs=[RunChart(ERRORS, 0, [str(k) for k in range(1, spec.poses + 1)], [Line("plan", OURS, error)])],
    )


def _tool(cell: Cell, q: Angles | Array) -> Array:
    return chain(cell.vjm, np.array(q)).position
