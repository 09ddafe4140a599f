"""Made once for all trials: the robot's program, poses that could be measured, and plans among them."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.campaign.campaign import Cell, build_cell, stream
from testbench.campaign.candidates import Checks, Conditions, build_checks, feasible, find
from testbench.campaign.models import MODELS
from testbench.campaign.perturbed_prior import UNCERTAINTY, wrong_prior
from testbench.correct.inverse import joints_along
from testbench.data.station import Station
from testbench.design.planning import make_plan
from testbench.design.refine import Reach
from testbench.design.rows import Experiment
from testbench.design.specification import Specification
from testbench.errors import Array, BenchError
from testbench.identify.metric import metric
from testbench.model.load import Load, weight
from testbench.plant import Payload
from testbench.studies.compensation import settings as s
from testbench.studies.compensation.jobs import FORCE, TIP, Job, jobs, tasks
from testbench.studies.study import Everywhere

START = (0.3, -1.2, 1.6, 0.1, -0.4, 0.0)  #: Joints near the panel [rad].
AROUND = 50  #: Candidates that stand for the workspace, which no criterion here asks for.


def prepare(asked: s.Settings, everywhere: Everywhere) -> s.Settings:
    """The scene; PoseError for too few feasible poses."""
    cell = build_cell(find_arm(asked.arm))
    found = find(_checks(cell), asked.candidates, stream(asked.seed, 1)).q
    q = np.concatenate([program(cell, job) for job in jobs()])
    plain = [tuple(map(tuple, own.tolist())) for own in (found, q)]
    scene = s.Scene(candidates=plain[0], program=plain[1])
    asked = replace(asked, scene=scene)
    rows = everywhere(partial(plan_rows, asked), len(_planned(asked)), s.PlanRow, "plans")
    return replace(asked, scene=replace(scene, plans=tuple(rows)))


def _planned(asked: s.Settings) -> list[tuple[str, int]]:
    return list(product((s.WEIGHT, s.BOTH), asked.numbers))


def _checks(cell: Cell) -> Checks:
    payload = Payload(s.PAYLOAD, s.SLING)
    return build_checks(cell, Conditions(area=s.AREA, station=Station(s.STATION), payload=payload))


def program(cell: Cell, job: Job) -> Array:
    """Joints that a controller which knows the drawing alone takes, (points, n) [rad].

    Raises:
        BenchError: When a point is out of reach.
    """
    start, tip = np.array(START), np.array(TIP)
    found = joints_along(cell.vjm, job.position, job.rotation, start=start, point=tip)
    if not found.there.all():
        raise BenchError(f"{job.name}: {cell.arm.name} does not reach point {np.argmin(found.there) + 1}")
    return found.q


def loads(cell: Cell) -> tuple[Load, Load]:
    """The hung weight, and the pull of the rope."""
    return weight(cell.vjm, s.PAYLOAD), Load(np.array([0.0, s.PULL, 0.0, 0.0, 0.0, 0.0]), cell.vjm.load)


def plan_rows(asked: s.Settings, numbers: Sequence[int]) -> list[list[s.PlanRow]]:
    """Plans by their numbers, one list each; `asked` holds candidates and program."""
    cell = build_cell(find_arm(asked.arm))
    reach, found = Reach(partial(feasible, _checks(cell))), []
    for name, poses in map(_planned(asked).__getitem__, numbers):
        spec = specify(cell, asked, name, poses)
        best = make_plan(spec, "test", np.array(asked.scene.candidates), reach, stream(asked.seed, 2))
        found.append([s.PlanRow(name, poses, tuple(best.q.ravel().tolist()), tuple(best.load.tolist()))])
    return found


def specify(cell: Cell, asked: s.Settings, name: str, poses: int) -> Specification:
    """What a plan is for: the points of both jobs under forces of the middle of their range."""
    own = metric(wrong_prior(cell, asked.seed), cell.vjm, MODELS["ALL153"](cell).structure)
    return Specification(
        experiment=Experiment(cell.vjm, own, cell.vjm.markers, s.SIGMA),
        loads=loads(cell)[: 1 if name == s.WEIGHT else 2],
        tasks=tasks(np.array(asked.scene.program), [np.mean(FORCE) * job.typical for job in jobs()]),
        workspace=np.array(asked.scene.candidates[:AROUND]),
        uncertainty=UNCERTAINTY,
        poses=poses,
    )
