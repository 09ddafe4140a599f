"""Candidates, tasks and plans by every criterion: made once for all trials."""

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.campaign import Cell, build_cell, stream
from testbench.bench.candidates import Candidates, Conditions, build_checks, feasible, find
from testbench.bench.plan_summary import overall
from testbench.bench.rows import MM
from testbench.bench.wrong_prior import wrong_prior
from testbench.data.station import Station
from testbench.design.observability import observability
from testbench.design.planning import Plan, make_plan, promise
from testbench.design.refine import Reach
from testbench.design.specification import Specification, task_rows, workspace_rows
from testbench.errors import Array
from testbench.plant import Payload
from testbench.studies.pose_selection.rows import Angles, Certificate, Indices, PlanRow, Scene
from testbench.studies.pose_selection.settings import Scope, Settings
from testbench.studies.pose_selection.ways import specify, variants
from testbench.studies.study import Everywhere

Job = tuple[str, str, Specification]
"""Criterion, variant (empty for the study's own way to measure), what the plan is for."""


def prepare(asked: Settings, everywhere: Everywhere) -> Settings:
    """The scene and all plans, the same for all trials; PoseError for too few feasible poses."""
    cell, scope, rng = build_cell(find_arm(asked.arm)), asked.scope, stream(asked.seed, 0)
    inside, anywhere = (build_checks(cell, Conditions(area=area)) for area in (scope.area, scope.anywhere))
    found = candidates(cell, scope, stream(asked.seed, 1))
    scene = Scene(
        candidates=_plain(found.q),
        drawn=found.drawn,
        rejected=tuple(found.rejected.values()),
        tasks=_plain(find(inside, scope.tasks, rng).q),
        workspace=_plain(find(anywhere, scope.workspace, rng).q),
    )
    asked = replace(asked, scene=scene)
    rows = everywhere(partial(plan_rows, asked), len(_jobs(cell, asked)), PlanRow, "plans")
    return replace(asked, scene=replace(scene, plans=tuple(rows)))


def _plain(q: Array) -> Angles:
    return tuple(map(tuple, q.tolist()))


def candidates(cell: Cell, scope: Scope, rng: np.random.Generator) -> Candidates:
    """Feasible poses to choose from."""
    return find(build_checks(cell, _conditions(scope)), scope.candidates, rng)


def _conditions(scope: Scope) -> Conditions:
    return Conditions(station=Station(scope.station), payload=Payload(scope.payload))


def _jobs(cell: Cell, asked: Settings) -> list[Job]:
    scope, own = asked.scope, specify(cell, asked, wrong_prior(cell, asked.seed))
    return [
        *((name, "", replace(own, poses=poses)) for name in scope.criteria for poses in scope.poses),
        *(("test", words, spec) for words, spec in variants(cell, asked, own).items()),
    ]


def plan_rows(asked: Settings, numbers: Sequence[int]) -> list[list[PlanRow]]:
    """Plans by their numbers, one list each; `asked` holds the scene."""
    cell, q, found = build_cell(find_arm(asked.arm)), np.array(asked.scene.candidates), []
    for criterion, variant, spec in map(_jobs(cell, asked).__getitem__, numbers):
        start = time.perf_counter()
        best = plan(cell, asked.scope, spec, criterion, (q, asked.seed))
        seconds = time.perf_counter() - start
        row = PlanRow(
            **vars(certificate(best)),
            criterion=criterion,
            variant=variant,
            poses=spec.poses,
            q_rad=tuple(best.q.ravel().tolist()),
            load=tuple(best.load.tolist()),
            seconds=seconds,
        )
        found.append([row])
    return found


def plan(cell: Cell, scope: Scope, spec: Specification, criterion: str, drawn: tuple[Array, int]) -> Plan:
    """A plan of poses among those drawn, (candidates, n) [rad], by a criterion, a key of planning.CRITERIA.

    Beside the poses `drawn` has the root of the search's randomness.
    """
    checks, (q, seed) = build_checks(cell, _conditions(scope)), drawn
    return make_plan(spec, criterion, q, Reach(lambda q: feasible(checks, q)), stream(seed, 2))


def certificate(best: Plan) -> Certificate:
    """What a plan is certified for, and what it forecasts."""
    indices = observability(best.examined.problem, best.chosen)
    spec = best.specification
    tasks, around = overall(promise(best, task_rows(spec))), promise(best, workspace_rows(spec))
    return Certificate(
        efficiency=best.efficiency,
        examined=len(best.examined.q),
        directions_seen=indices.seen,
        directions_of_loads=indices.of,
        expected_tasks_mm=tasks.expected,
        expected_tasks_p05_mm=tasks.p05,
        expected_tasks_p95_mm=tasks.p95,
        expected_workspace_mm=MM * around.overall,
        observability=Indices(indices.o1, indices.o2, indices.o3, indices.o4, indices.o5),
    )
