"""Which poses pay: plans by every criterion against random poses, verified by full simulation.

Plans are made once, from a prior that is wrong; every trial then measures them on the true arm with noise of
its own and identifies with a wrong prior of its own. Errors are those of true deflections where the robot
works and over the workspace.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from testbench.bench import Cell, Truth, build_cell, settle_both, stream
from testbench.candidates import Candidates, Conditions, build_checks, find, why_not
from testbench.dataset import Dataset
from testbench.design.observability import observability
from testbench.design.rows import Experiment, Ids, Load
from testbench.errors import Array
from testbench.evaluate import predict, score
from testbench.identify import Estimate, reduce
from testbench.identify.conic import optimum
from testbench.identify.prior import Metric, Prior, cad_prior, distorted, metric, rescaled
from testbench.identify.regularised import Strength, gco_with
from testbench.mjcf import GRAVITY
from testbench.planning import (
    Brief,
    Plan,
    Tasks,
    make_plan,
    promise,
    promise_of,
    task_rows,
    workspace_rows,
)
from testbench.plant import Equilibrium, Payload
from testbench.poses import WorkArea
from testbench.report import MM, Report, estimate_report, score_report
from testbench.station import Station
from testbench.structure import Structure, mgco68, template56
from testbench.tracker import Tracker, read_positions
from testbench.vjm import Vjm

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
        load: Index into the brief's loads, (poses,).
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


def brief_for(cell: Cell, ground: Ground, prior: Prior, poses: int) -> Brief:
    """The brief of a plan with one weight and the arm's own markers.

    Args:
        cell: The arm.
        ground: Tasks and workspace.
        prior: What the planner believes.
        poses: How many to measure.
    """
    study, structure = ground.study, STRUCTURES[PLANNED](cell)
    load = hung(cell, study.payload)
    return Brief(
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


def plan(cell: Cell, ground: Ground, brief: Brief, name: str, q: Array, seed: int) -> Plan:
    """A plan by a criterion.

    Args:
        cell: The arm.
        ground: For the conditions of a pose.
        brief: What it is for.
        name: Key of planning.CRITERIA.
        q: Feasible poses, (candidates, n) [rad].
        seed: Root of the search's randomness.
    """
    checks = build_checks(cell, conditions(ground.study))
    return make_plan(
        brief,
        name,
        q,
        lambda q: np.array([reason is None for reason in why_not(checks, q)], dtype=bool),
        stream(seed, 2),
    )


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
        brief = brief_for(cell, ground, prior, poses)
        start = clock()
        best = plan(cell, ground, brief, name, ground.candidates.q, ground.seed)
        seconds = clock() - start
        report = plan_report(brief, best) | {"criterion": name, "poses": poses, "seconds": seconds}
        found.append((Chosen(best.q, best.load), report))
    return found


def plan_report(brief: Brief, best: Plan) -> Report:
    """What a plan is certified for, and what it promises."""
    indices = observability(best.stock.problem, best.chosen)
    tasks, around = promise(best, task_rows(brief)), promise(best, workspace_rows(brief))
    return {
        "efficiency": best.efficiency,
        "examined": len(best.stock.q),
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


@dataclass(frozen=True)
class Bench:
    """The true arm, what is read of it and where predictions are judged.

    Attributes:
        cell: The arm.
        vjm: The model, perhaps with more markers.
        truth: Linear or not.
        sigma: Of one reading along one axis [m].
        tasks: Noise-free deflections in the tasks.
        workspace: The same over the workspace.
    """

    cell: Cell
    vjm: Vjm
    truth: Truth
    sigma: float
    tasks: Dataset
    workspace: Dataset


def build_bench(cell: Cell, ground: Ground, vjm: Vjm | None = None, truth: Truth = "nonlinear") -> Bench:
    """The true arm and its true deflections where predictions are judged.

    Args:
        cell: The arm.
        ground: Tasks and workspace.
        vjm: The model, if it has other markers than the arm.
        truth: "nonlinear" or "linear".
    """
    vjm, load = vjm or cell.vjm, hung(cell, ground.study.payload)
    rng = stream(ground.seed, 9)
    quiet = [
        measured(cell, cell.vjm, truth, q, load, ground.study.sigma, None, rng)
        for q in (ground.tasks, ground.workspace)
    ]
    return Bench(cell, vjm, truth, ground.study.sigma, *quiet)


def measured(
    cell: Cell,
    vjm: Vjm,
    truth: Truth,
    q: Array,
    load: Load,
    sigma: float,
    noise: float | None,
    rng: np.random.Generator,
) -> Dataset:
    """Runs of the true arm, every pose once.

    Args:
        cell: The arm.
        vjm: Its markers may be more than the arm's: the others are fixed to the tool.
        truth: "nonlinear" or "linear".
        q: Poses, (runs, n) [rad].
        load: The same in all, or one a run.
        sigma: By which the fit weights readings [m].
        noise: Standard deviation of a reading along an axis [m]; None for no noise.
        rng: Source of the noise.
    """
    runs = len(q)
    wrench = np.array(np.broadcast_to(load.wrench, (runs, 6)))
    point = np.array(np.broadcast_to(load.point, (runs, 3)))
    more = vjm.markers[len(cell.arm.markers) :]

    def read(state: Equilibrium) -> Array:
        extra = state.tool[:, None] + more @ state.rotation.swapaxes(1, 2)
        return read_positions(Tracker(noise or 0.0), np.hstack([state.markers, extra]), rng)

    ids = np.arange(runs) + 1
    before, after = settle_both(cell.plant, truth, q, wrench, point)
    return Dataset(
        markers=vjm.arm.markers,
        run=ids,
        pose=ids,
        q=q,
        wrench=wrench,
        point=point,
        before=read(before),
        after=read(after),
        sigma=sigma,
    )


def trials(ground: Ground, chosen: dict[tuple[str, int], Chosen], seeds: Sequence[int]) -> list[Report]:
    """Errors of every plan and of random poses, identified in every way, a report a seed.

    Args:
        ground: What all share.
        chosen: Poses by criterion and number.
        seeds: Roots of noise, of the identification's prior and of the random poses.
    """
    cell = build_cell(ground.folder)
    bench = build_bench(cell, ground)
    return [_trial(bench, ground, chosen, seed) for seed in seeds]


def _trial(bench: Bench, ground: Ground, chosen: dict[tuple[str, int], Chosen], seed: int) -> Report:
    metrics = metrics_of(bench.cell, wrong_prior(bench.cell, seed))
    errors: dict[str, dict[str, list[Report]]] = {fit: {} for fit in FITS}
    featured: list[Report] = []
    where: Report = {}
    quiet: Report = {}
    for name in (*ground.study.criteria, RANDOM):
        for poses in ground.study.poses:
            poses_chosen = (
                at_random(ground.candidates.q, poses, stream(seed, CHANCE + poses))
                if name == RANDOM
                else chosen[name, poses]
            )
            data = measure_plan(bench, ground, poses_chosen, stream(seed, NOISE + poses))
            for fit in FITS:
                estimate = identify(bench.vjm, metrics, fit, data)
                judged = judge(bench, estimate)
                errors[fit].setdefault(name, []).append({"poses": poses, **judged})
                if poses == ground.study.featured and fit == FITS[0]:
                    featured.append(_model(bench, f"{name}, {fit}", estimate, data))
                    where = where or pose_by_pose(bench, estimate)
                    calm = measure_plan(bench, ground, poses_chosen, None)
                    quiet[name] = judge(bench, identify(bench.vjm, metrics, fit, calm))["tasks_mm"]
    return {"seed": seed, "errors": errors, "models": featured, "where": where, "noise_free": quiet}


def measure_plan(bench: Bench, ground: Ground, chosen: Chosen, rng: np.random.Generator | None) -> Dataset:
    """Runs of a plan under its one weight, without noise if there is no source of it."""
    load, noise = hung(bench.cell, ground.study.payload), None if rng is None else bench.sigma
    source = rng or stream(0)  # of no effect without noise
    return measured(bench.cell, bench.vjm, bench.truth, chosen.q, load, bench.sigma, noise, source)


def metrics_of(cell: Cell, prior: Prior) -> dict[str, Metric]:
    """Every structure in the metric of a prior."""
    return {name: metric(prior, cell.vjm, build(cell)) for name, build in STRUCTURES.items()}


def identify(vjm: Vjm, metrics: dict[str, Metric], fit: str, data: Dataset) -> Estimate:
    """GCO of a structure, with the prior or without.

    Args:
        vjm: The model.
        metrics: Structures in the metric of the prior.
        fit: One of FITS.
        data: The runs.
    """
    own = metrics[fit.split(" ")[0]]
    regression = reduce(vjm, own.structure, data)
    if fit.endswith("prior"):
        return gco_with(regression, rescaled(own, regression), Strength(UNCERTAINTY))
    return optimum(regression)


def judge(bench: Bench, estimate: Estimate) -> Report:
    """RMS distance of predicted from true deflections [mm]."""
    return {
        "tasks_mm": _rms_mm(bench, estimate, bench.tasks),
        "workspace_mm": _rms_mm(bench, estimate, bench.workspace),
    }


def pose_by_pose(bench: Bench, estimate: Estimate) -> Report:
    """RMS distance over the markers of every task and every pose of the workspace [mm]."""
    found = {}
    for key, data in (("tasks_mm", bench.tasks), ("workspace_mm", bench.workspace)):
        error = predict(bench.cell.vjm, estimate, data) - data.deflection
        found[key] = (MM * np.sqrt(np.square(error).sum(axis=2).mean(axis=1))).tolist()
    return found


def _rms_mm(bench: Bench, estimate: Estimate, data: Dataset) -> float:
    return MM * score(predict(bench.cell.vjm, estimate, data), data.deflection).rms


def _model(bench: Bench, name: str, estimate: Estimate, data: Dataset) -> Report:
    """A row of the report's models: the tasks are its check set."""
    sets = {"identification": (bench.vjm, data), "check": (bench.cell.vjm, bench.tasks)}
    sets["workspace"] = (bench.cell.vjm, bench.workspace)
    scores = {
        key: score_report(score(predict(vjm, estimate, runs), runs.deflection))
        for key, (vjm, runs) in sets.items()
    }
    return {**estimate_report(name, estimate, estimate.solver_seconds), **scores, "paper": None}


def replanned(ground: Ground, seeds: Sequence[int]) -> list[Report]:
    """The featured plan made anew every time: other candidates, another wrong prior, other noise.

    Args:
        ground: Tasks, workspace, what is tried.
        seeds: Roots of all of that.
    """
    cell, found = build_cell(ground.folder), []
    bench, study = build_bench(cell, ground), ground.study
    for seed in seeds:
        prior, q = wrong_prior(cell, seed), candidates(cell, study, stream(seed, 3)).q
        brief = brief_for(cell, ground, prior, study.featured)
        best = plan(cell, ground, brief, "test", q, seed)
        guess = at_random(q, study.featured, stream(seed, 4))
        report = plan_report(brief, best)
        by_chance = promise_of(brief, guess.q, guess.load, task_rows(brief))
        for name, chosen in (("test", Chosen(best.q, best.load)), (RANDOM, guess)):
            data = measure_plan(bench, ground, chosen, stream(seed, 7))
            estimate = identify(bench.vjm, metrics_of(cell, prior), FITS[0], data)
            report[name] = judge(bench, estimate)
        found.append(report | {"expected_random_tasks_mm": MM * by_chance.overall})
    return found


def with_marker(vjm: Vjm, offset: tuple[float, float, float], name: str) -> Vjm:
    """The model with one more target fixed to the tool, at `offset` in its frame [m]."""
    arm = replace(vjm.arm, markers=(*vjm.arm.markers, name))
    return replace(vjm, arm=arm, markers=np.vstack([vjm.markers, offset]))
