"""What the study of pose selection stands on: candidates, tasks, wrong priors, plans by every criterion."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.bench.campaign import Cell, build_cell, stream
from testbench.bench.candidates import Candidates, Conditions, build_checks, feasible, find
from testbench.data.station import Station
from testbench.design.observability import observability
from testbench.design.planning import Plan, make_plan, promise
from testbench.design.refine import Reach
from testbench.design.rows import Experiment, Ids, Load
from testbench.design.specification import Specification, Tasks, task_rows, workspace_rows
from testbench.errors import Array
from testbench.identify.metric import metric
from testbench.identify.prior import Prior, cad_prior, distorted
from testbench.model.poses import WorkArea
from testbench.model.structure import Structure, mgco68, template56
from testbench.plant import Payload
from testbench.views.report import MM, Report

NAME = "pose_selection"
RANDOM = "random"
SCALE, SHAPE = 2.0, 0.3
"""How wrong the priors are: common factor, and log-deviation of each axis's own."""
CHANCE, NOISE = 300, 100
"""Streams of a seed for random poses and for noise, plus the number of poses."""
UNCERTAINTY = 0.3
"""Relative uncertainty with which a prior is believed, in planning and in identifying [1]."""
AREA = WorkArea((1.7, -0.9, 1.1), (2.7, 0.9, 2.1), (1.0, 0.0, 0.0), np.pi / 4)
"""Where the robot works: that of section 6."""
ANYWHERE = WorkArea((-4.0, -4.0, 0.8), (4.0, 4.0, 4.0))

STRUCTURES: dict[str, Callable[[Cell], Structure]] = {
    "MGCO68": lambda cell: mgco68(cell.arm),
    "MGCO56": lambda cell: template56(cell.arm),
}
PLANNED = "MGCO68"
"""The structure that plans are made for."""
FITS = ("MGCO68 + prior", "MGCO56 + prior", "MGCO68", "MGCO56")
"""How the runs are identified: GCO, with the prior or without."""


@dataclass(frozen=True)
class Study:
    """What is tried.

    Attributes:
        payload: Hung mass [kg].
        sigma: Standard deviation of one reading along one axis [m].
        station: Of the tracker [m].
        poses: Numbers of poses.
        criteria: Keys of planning.CRITERIA.
        candidates: Feasible poses to choose from.
        tasks: Random poses of the work area where predictions are wanted.
        workspace: Random poses all over the workspace.
        area: Work area.
        anywhere: The workspace.
        featured: Number of poses that the report looks at closely.
        variants: How many of the other ways to measure are tried.
    """

    payload: float = 460.3
    sigma: float = 50e-6
    station: tuple[float, float, float] = (4.5, -2.5, 1.6)
    poses: tuple[int, ...] = (4, 6, 8, 12, 16, 20, 30, 40)
    criteria: tuple[str, ...] = ("test", "I", "D", "A", "E", "G")
    candidates: int = 5000
    tasks: int = 20
    workspace: int = 200
    area: WorkArea = AREA
    anywhere: WorkArea = ANYWHERE
    featured: int = 12
    variants: int = 6


@dataclass(frozen=True)
class Ground:
    """What all plans and trials share.

    Attributes:
        folder: Of the arm.
        study: What is tried.
        candidates: Feasible poses.
        tasks: Where predictions are wanted, (tasks, n) [rad].
        workspace: Where they are wanted too, (poses, n) [rad].
        seed: Root of the candidates, the tasks and the planner's prior.
    """

    folder: Path
    study: Study
    candidates: Candidates
    tasks: Array
    workspace: Array
    seed: int


@dataclass(frozen=True)
class Chosen:
    """Poses to measure, however they were chosen.

    Attributes:
        q: (poses, n) [rad].
        load: Index into the specification's loads, (poses,).
    """

    q: Array
    load: Ids


def lay_ground(cell: Cell, folder: Path, study: Study, seed: int) -> Ground:
    """Candidates, tasks and workspace.

    Args:
        cell: The arm.
        folder: Its folder.
        study: What is tried.
        seed: Root of randomness.

    Raises:
        PoseError: When too few feasible poses exist.
    """
    rng = stream(seed, 0)
    inside, anywhere = (build_checks(cell, Conditions(area=area)) for area in (study.area, study.anywhere))
    return Ground(
        folder=folder,
        study=study,
        candidates=candidates(cell, study, stream(seed, 1)),
        tasks=find(inside, study.tasks, rng).q,
        workspace=find(anywhere, study.workspace, rng).q,
        seed=seed,
    )


def conditions(study: Study) -> Conditions:
    """What a measured pose must satisfy."""
    return Conditions(station=Station(study.station), payload=Payload(study.payload))


def candidates(cell: Cell, study: Study, rng: np.random.Generator) -> Candidates:
    """Feasible poses to choose from."""
    return find(build_checks(cell, conditions(study)), study.candidates, rng)


def hung(cell: Cell, mass: float, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Load:
    """A weight at the load point or beside it.

    Args:
        cell: The arm.
        mass: [kg].
        offset: In the tool's frame, (3,) [m].
    """
    return Load(np.array([0, 0, -GRAVITY * mass, 0, 0, 0]), cell.vjm.load + offset)


def specification_for(cell: Cell, ground: Ground, prior: Prior, poses: int) -> Specification:
    """The specification of a plan with one weight and the arm's own markers.

    Args:
        cell: The arm.
        ground: Tasks and workspace.
        prior: What the planner believes.
        poses: How many to measure.
    """
    study, structure = ground.study, STRUCTURES[PLANNED](cell)
    load = hung(cell, study.payload)
    return Specification(
        experiment=Experiment(cell.vjm, metric(prior, cell.vjm, structure), cell.vjm.markers, study.sigma),
        loads=(load,),
        tasks=Tasks(ground.tasks, load),
        workspace=ground.workspace,
        uncertainty=UNCERTAINTY,
        poses=poses,
    )


def wrong_prior(cell: Cell, seed: int) -> Prior:
    """A CAD prior with errors of its own."""
    return distorted(cad_prior(cell.arm), scale=SCALE, shape=SHAPE, rng=stream(seed, 5))


def plan(cell: Cell, ground: Ground, specification: Specification, name: str, q: Array, seed: int) -> Plan:
    """A plan by a criterion.

    Args:
        cell: The arm.
        ground: For the conditions of a pose.
        specification: What it is for.
        name: Key of planning.CRITERIA.
        q: Feasible poses, (candidates, n) [rad].
        seed: Root of the search's randomness.
    """
    checks = build_checks(cell, conditions(ground.study))
    return make_plan(specification, name, q, Reach(lambda q: feasible(checks, q)), stream(seed, 2))


def plans(
    ground: Ground, clock: Callable[[], float], jobs: Sequence[tuple[str, int]], numbers: Sequence[int]
) -> list[tuple[Chosen, Report]]:
    """Plans of some jobs, in a process of their own.

    Args:
        ground: What all share.
        clock: Wall time [s].
        jobs: Criterion and number of poses.
        numbers: Which of them.
    """
    cell = build_cell(ground.folder)
    prior = wrong_prior(cell, ground.seed)
    found = []
    for number in numbers:
        name, poses = jobs[number]
        specification = specification_for(cell, ground, prior, poses)
        start = clock()
        best = plan(cell, ground, specification, name, ground.candidates.q, ground.seed)
        seconds = clock() - start
        report = plan_report(specification, best) | {"criterion": name, "poses": poses, "seconds": seconds}
        found.append((Chosen(best.q, best.load), report))
    return found


def plan_report(specification: Specification, best: Plan) -> Report:
    """What a plan is certified for, and what it promises."""
    indices = observability(best.examined.problem, best.chosen)
    tasks, around = promise(best, task_rows(specification)), promise(best, workspace_rows(specification))
    return {
        "efficiency": best.efficiency,
        "examined": len(best.examined.q),
        "directions_seen": indices.seen,
        "directions_of_loads": indices.of,
        "expected_tasks_mm": MM * tasks.overall,
        "expected_tasks_p05_mm": MM * tasks.overall_low,
        "expected_tasks_p95_mm": MM * tasks.overall_high,
        "expected_workspace_mm": MM * around.overall,
        "observability": {key: getattr(indices, key) for key in ("o1", "o2", "o3", "o4", "o5")},
    }


def at_random(q: Array, poses: int, rng: np.random.Generator) -> Chosen:
    """Feasible poses without a plan."""
    return Chosen(q[rng.choice(len(q), poses, replace=False)], np.zeros(poses, dtype=int))
