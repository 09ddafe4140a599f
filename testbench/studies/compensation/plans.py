"""Made once for all trials: the robot's programs, poses that could be measured, and plans among them."""

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
from testbench.design.specification import Specification, Tasks
from testbench.errors import Array, BenchError
from testbench.identify.metric import metric
from testbench.model.load import Load, weight
from testbench.plant import Payload
from testbench.studies.compensation.jobs import TIP, Job, jobs, typical, wrenches
from testbench.studies.compensation.settings import (
    AREA,
    BOTH,
    FORCE,
    PAYLOAD,
    PULL,
    SIGMA,
    SLING,
    STATION,
    WEIGHT,
    Angles,
    PlanRow,
    Settings,
)
from testbench.studies.study import Everywhere

START = (0.3, -1.2, 1.6, 0.1, -0.4, 0.0)  #: Joints near the panel [rad].
AROUND = 50  #: Candidates that stand for the workspace, which no criterion here asks for.


def prepare(asked: Settings, everywhere: Everywhere) -> Settings:
    """The scene; PoseError for too few feasible poses."""
    cell = build_cell(find_arm(asked.arm))
    found = find(_checks(cell), asked.candidates, stream(asked.seed, 1))
    drilling, milling = (_plain(program(cell, one)) for one in jobs())
    scene = replace(asked.scene, candidates=_plain(found.q), drilling=drilling, milling=milling)
    asked = replace(asked, scene=scene)
    rows = everywhere(partial(plan_rows, asked), len(_planned(asked)), PlanRow, "plans")
    return replace(asked, scene=replace(scene, plans=tuple(rows)))


def _plain(q: Array) -> Angles:
    return tuple(map(tuple, q.tolist()))


def _planned(asked: Settings) -> list[tuple[str, int]]:
    return list(product((WEIGHT, BOTH), asked.numbers))


def _checks(cell: Cell) -> Checks:
    payload = Payload(PAYLOAD, SLING)
    return build_checks(cell, Conditions(area=AREA, station=Station(STATION), payload=payload))


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
    return weight(cell.vjm, PAYLOAD), Load(np.array([0.0, PULL, 0.0, 0.0, 0.0, 0.0]), cell.vjm.load)


def plan_rows(asked: Settings, numbers: Sequence[int]) -> list[list[PlanRow]]:
    """Plans by their numbers, one list each; `asked` holds candidates and programs."""
    cell, checks, found = build_cell(find_arm(asked.arm)), None, []
    for name, poses in map(_planned(asked).__getitem__, numbers):
        checks = checks or _checks(cell)
        spec = specify(cell, asked, name, poses)
        reach = Reach(partial(feasible, checks))
        best = make_plan(spec, "test", np.array(asked.scene.candidates), reach, stream(asked.seed, 2))
        found.append([PlanRow(name, poses, tuple(best.q.ravel().tolist()), tuple(best.load.tolist()))])
    return found


def specify(cell: Cell, asked: Settings, name: str, poses: int) -> Specification:
    """What a plan is for: the points of both jobs under forces of the middle of their range."""
    prior, every = wrong_prior(cell, asked.seed), jobs()
    q = np.concatenate([asked.scene.drilling, asked.scene.milling])
    wrench = np.concatenate([wrenches(one, np.mean(FORCE) * typical(one)) for one in every])
    own = metric(prior, cell.vjm, MODELS["ALL153"](cell).structure)
    return Specification(
        experiment=Experiment(cell.vjm, own, cell.vjm.markers, SIGMA),
        loads=loads(cell)[: 1 if name == WEIGHT else 2],
        tasks=Tasks(q, Load(wrench, np.array(TIP)).over(len(q))),
        workspace=np.array(asked.scene.candidates[:AROUND]),
        uncertainty=UNCERTAINTY,
        poses=poses,
    )
