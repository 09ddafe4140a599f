"""Candidates, tasks and plans by every criterion: made once for all trials."""

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from testbench.arm.folder import find_arm
from testbench.design.baselines import observability
from testbench.design.planning import forecast_errors, make_plan
from testbench.design.refine import Feasibility
from testbench.design.rows import task_rows
from testbench.plant.site import Payload
from testbench.plant.tracker import Station, trial_rng
from testbench.studies.planning import settings as s
from testbench.studies.planning.settings import FITS, PLANNED, PlanningSettings
from testbench.studies.planning.trial import specify
from testbench.studies.study import Everywhere
from testbench.workflows.candidates import PoseConditions, build_checks, feasible, find
from testbench.workflows.cell import Cell, build_cell
from testbench.workflows.perturbed_prior import wrong_prior
from testbench.workflows.predicted_error import forecast_summary

AWAY_STREAM = 20  #: Streams of the other ground, over those of the first.

Job = tuple[PlanningSettings, str, str, int]
"""A plan to be made: the study on its ground, the fit that it is for, the criterion, how many poses."""


def prepare(asked: PlanningSettings, everywhere: Everywhere) -> PlanningSettings:
    """Make the scenes and all plans, the same for all trials; PoseError for too few feasible poses.

    Args:
        asked: Settings of the study.
        everywhere: Does pieces of work on all cores.

    Returns:
        The settings with their scenes.
    """
    cell = build_cell(find_arm(asked.arm))
    asked = replace(asked, scene=_scene(cell, asked, 0))
    asked = replace(asked, away=_scene(cell, s.elsewhere(asked), AWAY_STREAM))
    rows = everywhere(partial(plan_rows, asked), len(_jobs(asked)), s.PlannedRow, "plans")
    home, away = (tuple(row for row in rows if row.ground == ground.name) for ground in (s.HOME, s.AWAY))
    return replace(asked, scene=replace(asked.scene, plans=home), away=replace(asked.away, plans=away))


def _scene(cell: Cell, asked: PlanningSettings, first: int) -> s.PlanningScene:
    """Candidates, tasks and workspace of a ground; the streams of their randomness begin at `first`."""
    scope, rng = asked.scope, trial_rng(asked.seed, first)
    drawn = (
        (_conditions(scope), scope.candidates, trial_rng(asked.seed, first + 1)),
        (PoseConditions(area=scope.ground.area), scope.tasks, rng),
        (PoseConditions(area=s.ANYWHERE), scope.workspace, rng),
    )
    found = (find(build_checks(cell, conditions), count, own).q for conditions, count, own in drawn)
    candidates, tasks, workspace = (tuple(map(tuple, q.tolist())) for q in found)
    return s.PlanningScene(candidates, tasks, workspace)


def _conditions(scope: s.Scope) -> PoseConditions:
    return PoseConditions(station=Station(scope.ground.station), payload=Payload(scope.payload))


def _jobs(asked: PlanningSettings) -> list[Job]:
    scope, there = asked.scope, s.elsewhere(asked)
    grounds = [*((asked, fit) for fit in FITS if fit != PLANNED), *((there, fit) for fit in FITS)]
    return [
        *((asked, PLANNED, name, poses) for name in scope.criteria for poses in scope.numbers(name)),
        *((on, fit, "test", scope.featured) for on, fit in grounds),
    ]


def plan_rows(asked: PlanningSettings, numbers: Sequence[int]) -> list[list[s.PlannedRow]]:
    """Make plans by their numbers, one list each; `asked` holds the scene.

    Args:
        asked: Settings of the study.
        numbers: Numbers of the plans.

    Returns:
        The plans.
    """
    cell, jobs = build_cell(find_arm(asked.arm)), _jobs(asked)
    return [[_plan_row(cell, jobs[k])] for k in numbers]


def _plan_row(cell: Cell, job: Job) -> s.PlannedRow:
    there, fit, criterion, poses = job
    spec = replace(specify(cell, there, wrong_prior(cell, there.seed), fit), poses=poses)
    start, checks = time.perf_counter(), build_checks(cell, _conditions(there.scope))
    reach, q = Feasibility(lambda q: feasible(checks, q)), np.array(there.scene.candidates)
    best = make_plan(spec, criterion, q, reach, trial_rng(there.seed, 2))
    return s.PlannedRow(
        ground=there.scope.ground.name,
        fit=fit,
        criterion=criterion,
        poses=poses,
        q_rad=tuple(best.q.ravel().tolist()),
        seconds=time.perf_counter() - start,
        efficiency_percent=100 * best.efficiency,
        expected_tasks_mm=forecast_summary(forecast_errors(best, task_rows(spec))).expected,
        observability=observability(best.examined.problem, best.chosen),
    )
