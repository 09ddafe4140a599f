"""Candidates, tasks and plans by every criterion: made once for all trials."""

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.campaign.campaign import Cell, build_cell, stream
from testbench.campaign.candidates import Conditions, build_checks, feasible, find
from testbench.campaign.perturbed_prior import wrong_prior
from testbench.campaign.predicted_error import overall
from testbench.campaign.rows import MM
from testbench.data.station import Station
from testbench.design.observability import observability
from testbench.design.planning import make_plan, promise
from testbench.design.refine import Reach
from testbench.design.specification import Specification, task_rows, workspace_rows
from testbench.errors import Array
from testbench.plant import Payload
from testbench.studies.pose_selection import settings as s
from testbench.studies.pose_selection.settings import PLANNED, Settings
from testbench.studies.pose_selection.trial import specify
from testbench.studies.study import Everywhere

AWAY_STREAM = 20  #: Streams of the other ground, over those of the first.


Job = tuple[Settings, s.Fit, str, Specification]
"""A plan to be made: the study on its ground, the fit that it is for, the criterion, and all that as design
wants it."""


def prepare(asked: Settings, everywhere: Everywhere) -> Settings:
    """The scenes and all plans, the same for all trials; PoseError for too few feasible poses."""
    cell = build_cell(find_arm(asked.arm))
    asked = replace(asked, scene=_scene(cell, asked, 0))
    asked = replace(asked, away=_scene(cell, s.elsewhere(asked), AWAY_STREAM))
    rows = everywhere(partial(plan_rows, asked), len(_jobs(cell, asked)), s.PlanRow, "plans")
    home, away = (tuple(row for row in rows if row.ground == ground.name) for ground in (s.HOME, s.AWAY))
    return replace(asked, scene=replace(asked.scene, plans=home), away=replace(asked.away, plans=away))


def _scene(cell: Cell, asked: Settings, first: int) -> s.Scene:
    """Candidates, tasks and workspace of a ground; the streams of their randomness begin at `first`."""
    scope, rng = asked.scope, stream(asked.seed, first)
    areas = (scope.ground.area, scope.anywhere)
    inside, anywhere = (build_checks(cell, Conditions(area=area)) for area in areas)
    checks = build_checks(cell, _conditions(scope))
    found = find(checks, scope.candidates, stream(asked.seed, first + 1))
    return s.Scene(
        candidates=_plain(found.q),
        drawn=found.drawn,
        rejected=tuple(found.rejected.values()),
        tasks=_plain(find(inside, scope.tasks, rng).q),
        workspace=_plain(find(anywhere, scope.workspace, rng).q),
    )


def _plain(q: Array) -> s.Angles:
    return tuple(map(tuple, q.tolist()))


def _conditions(scope: s.Scope) -> Conditions:
    return Conditions(station=Station(scope.ground.station), payload=Payload(scope.payload))


def _jobs(cell: Cell, asked: Settings) -> list[Job]:
    scope, prior = asked.scope, wrong_prior(cell, asked.seed)
    own = specify(cell, asked, prior)
    levels = [(name, poses) for name in scope.criteria for poses in scope.numbers(name)]
    here: list[Job] = [(asked, PLANNED, name, replace(own, poses=poses)) for name, poses in levels]
    there = s.elsewhere(asked)
    grounds = [*((asked, fit) for fit in s.FITS if fit != PLANNED), *((there, fit) for fit in s.FITS)]
    return here + [(on, fit, "test", specify(cell, on, prior, fit)) for on, fit in grounds]


def plan_rows(asked: Settings, numbers: Sequence[int]) -> list[list[s.PlanRow]]:
    """Plans by their numbers, one list each; `asked` holds the scene."""
    cell = build_cell(find_arm(asked.arm))
    jobs = _jobs(cell, asked)
    return [[_plan_row(cell, asked.seed, jobs[k])] for k in numbers]


def _plan_row(cell: Cell, seed: int, job: Job) -> s.PlanRow:
    there, fit, criterion, spec = job
    start, checks = time.perf_counter(), build_checks(cell, _conditions(there.scope))
    reach, q = Reach(lambda q: feasible(checks, q)), np.array(there.scene.candidates)
    best = make_plan(spec, criterion, q, reach, stream(seed, 2))
    seconds = time.perf_counter() - start
    tasks = overall(promise(best, task_rows(spec)))
    return s.PlanRow(
        ground=there.scope.ground.name,
        fit=fit.name,
        criterion=criterion,
        poses=spec.poses,
        q_rad=tuple(best.q.ravel().tolist()),
        load=tuple(best.load.tolist()),
        seconds=seconds,
        efficiency_percent=100 * best.efficiency,
        examined=len(best.examined.q),
        expected_tasks_mm=tasks.expected,
        expected_tasks_p05_mm=tasks.p05,
        expected_tasks_p95_mm=tasks.p95,
        expected_workspace_mm=MM * promise(best, workspace_rows(spec)).overall,
        observability=observability(best.examined.problem, best.chosen),
    )
