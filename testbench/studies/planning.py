"""Pose selection: plans by every criterion, made once for all trials, against random poses.

A trial measures every plan and random poses on the true arm, identifies the runs in every way, and judges the
models. It has noise, a wrong prior and random poses of its own.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from testbench.arm.folder import find_arm
from testbench.arm.mjcf import GRAVITY
from testbench.data.dataset import Dataset
from testbench.design.exchange import Feasibility
from testbench.design.forecast import forecast_fit, inflate_intervals
from testbench.design.planning import Observability, forecast_errors, make_plan, observability
from testbench.design.rows import MeasurementSetup, PlanSpecification, Tasks, task_rows, whitened_rows_by_load
from testbench.errors import Array
from testbench.files.write import csv_text
from testbench.identify.estimate import Estimate, deflections_of_models
from testbench.identify.prior import Prior, PriorUncertainty, scale_by_prior
from testbench.model.laws import remove_law_parameters
from testbench.model.load import weight
from testbench.model.structure import joints_only
from testbench.model.vjm import WorkArea, evaluate_chain
from testbench.plant.rigid_cell import Payload
from testbench.plant.tracker import Station
from testbench.plant.true_arms import FAMILY_NAME, FAMILY_TRUE_ARMS, true_arm_of_seed
from testbench.report.badge import of_rivals
from testbench.report.colours import GREY, SERIES, Look
from testbench.report.figure import Figure, forest, headed, sweeps
from testbench.report.planned_poses import OURS, UNSCALED, World
from testbench.report.report import Report, say
from testbench.report.scene import ModelLine, PageContent, PlaceMap, Scene
from testbench.report.schema import KNOWN, TRUE_ARM_LABELS, Table, TableColumn, columns
from testbench.report.table import Row, Trials, merged, number
from testbench.runs.rows import trial_rng
from testbench.runs.spread import ends, independent, middle, span, wins
from testbench.studies import campaigns
from testbench.studies.campaign.trial import Fits
from testbench.studies.campaigns import CampaignRow, campaign_rows
from testbench.studies.run import READ, headline, warnings
from testbench.studies.study import ArmFlag, Everywhere, Run, Study
from testbench.workflows.campaign import (
    SECTION_6_AREA,
    SECTION_6_WORKSPACE,
    Campaign,
    Setup,
    poses_with_weight,
    true_cell,
)
from testbench.workflows.campaign import measure_markers as read
from testbench.workflows.cell import Cell, build_cell
from testbench.workflows.model_names import FILLED
from testbench.workflows.models import (
    DEFAULT,
    JOINTS_ONLY,
    MODELS,
    PRIORS,
    SCALE,
    SHAPE,
    UNCERTAINTY,
    Model,
    fit_model,
    fit_or_rigid,
    has_failed,
    prior_of,
    with_priors,
    wrong_prior,
)
from testbench.workflows.own_estimator import Models
from testbench.workflows.plan_input import PoseConditions, build_checks, feasible, find_feasible_poses
from testbench.workflows.predicted_error import (
    Expected,
    forecast_summary,
    half_widths,
    least_squares,
    linear_fit_after,
)
from testbench.workflows.rows import MM

# --- Settings of the study of pose selection: sizes, where the robot works, how runs are identified ---------

NAME = "pose_selection"
RANDOM = "random"  #: Poses without a plan, beside the criteria of criteria.CRITERIA.
Angles = tuple[tuple[float, ...], ...]  #: Joint angles, (poses, n) [rad].
MODELS_WITHOUT_PRIOR = ("MGCO68", "MGCO56", JOINTS_ONLY)
#: How runs are identified.
FITS = (*(f"{name}{FILLED}" for name in MODELS_WITHOUT_PRIOR), *MODELS_WITHOUT_PRIOR)
#: The fit that plans are made for, and the same without its prior.
PLANNED, BARE = FITS[0], MODELS_WITHOUT_PRIOR[0]
INCUMBENT = JOINTS_ONLY  #: Six joint compliances by plain least squares.
WHOLE = DEFAULT  #: What `identify` does by default.


@dataclass(frozen=True)
class PlanningOptions:
    """Hold the flags of the study."""

    arm: ArmFlag = "kr500_l480"


@dataclass(frozen=True)
class Ground:
    """Say where the tracker stands and the robot works."""

    name: str  #: In words.
    station: tuple[float, float, float]  #: Of the tracker [m].
    area: WorkArea  #: Where predictions are wanted.


HOME = Ground("in front", (4.5, -2.5, 1.6), SECTION_6_AREA)
AWAY = Ground(
    "at the side", (-2.5, 4.0, 1.8), WorkArea((-0.9, 1.4, 0.9), (0.9, 2.4, 1.9), (0.0, 1.0, 0.0), np.pi / 4)
)
"""Where section 6 works, and another ground, on which nothing was tuned."""


@dataclass(frozen=True)
class Scope:
    """Describe what is tried."""

    payload: float = 460.3  #: Hung mass [kg].
    sigma: float = 50e-6  #: Standard deviation of one reading along one axis [m].
    ground: Ground = HOME  #: Where the tracker stands and the robot works.
    #: Numbers of poses, by the first criterion and at random.
    poses: tuple[int, ...] = (4, 6, 8, 12, 16, 20, 30, 40)
    fewer: tuple[int, ...] = (8, 12, 20)  #: Those of them by the other criteria.
    criteria: tuple[str, ...] = ("test", "I", "D", "A", "E", "G")  #: Keys of criteria.CRITERIA.
    candidates: int = 5000  #: Feasible poses to choose from.
    tasks: int = 20  #: Random poses of the work area where predictions are wanted.
    workspace: int = 200  #: Random poses all over the workspace.
    featured: int = 12  #: Number of poses that the report looks at closely.

    def numbers(self, name: str) -> tuple[int, ...]:
        """Return the numbers of poses by a criterion, or at random."""
        return self.poses if name in (self.criteria[0], RANDOM) else self.fewer


QUICK = Scope(
    poses=(9,),
    fewer=(9,),
    criteria=("test", "D"),
    candidates=60,
    tasks=6,
    workspace=30,
    featured=9,
)


@dataclass(frozen=True)
class PlannedRow:
    """Hold a plan, what it is certified for, and which error at the tasks it forecasts."""

    ground: str  #: Name of the ground that it is for.
    fit: str  #: Name of the fit that it is made for.
    criterion: str  #: Key of criteria.CRITERIA.
    poses: int  #: How many.
    q_rad: tuple[float, ...]  #: Their joint angles, one pose after the other, (poses * n,) [rad].
    seconds: float  #: Wall time of planning.
    efficiency_percent: float  #: At least, of the best that as many of the poses examined can reach.
    expected_tasks_mm: float
    observability: Observability


@dataclass(frozen=True)
class PlanningScene:
    """Hold what all plans and trials share: feasible poses, and where predictions are wanted."""

    candidates: Angles = ()  #: Feasible poses to choose from.
    tasks: Angles = ()  #: Poses where the robot works.
    workspace: Angles = ()  #: Poses all over the workspace.
    plans: tuple[PlannedRow, ...] = ()  #: By criterion and number of poses, then by fit.

    def plan(self, criterion: str, poses: int, fit: str) -> PlannedRow:
        """Return the plan by a criterion of so many poses for a fit.

        Args:
            criterion: The criterion.
            poses: Number of poses.
            fit: Name of the fit.

        Returns:
            The plan.
        """
        return next(p for p in self.plans if (p.criterion, p.poses, p.fit) == (criterion, poses, fit))


EMPTY = PlanningScene()


@dataclass(frozen=True)
class PlanningSettings:
    """Describe what is tried."""

    arm: str  #: Folder or name of the arm.
    seed: int  #: Root of the candidates, the tasks and the planner's prior; the first trial.
    scope: Scope  #: Sizes and numbers.
    #: Made of the rest by `study.prepare`; empty before.
    scene: Annotated[PlanningScene, Field(exclude=True)] = EMPTY
    away: Annotated[PlanningScene, Field(exclude=True)] = EMPTY  #: The same on the other ground.


def elsewhere(asked: PlanningSettings) -> PlanningSettings:
    """Return the settings on the other ground."""
    return replace(asked, scope=replace(asked.scope, ground=AWAY), scene=asked.away)


def _settings(options: PlanningOptions, quick: bool, seeds: range) -> PlanningSettings:
    """Make the settings of the flags."""
    find_arm(options.arm)
    return PlanningSettings(options.arm, seeds[0], QUICK if quick else Scope())


# --- One trial: every plan and random poses measured on the true arm, identified in every way, judged -------

NOISE, CHANCE = 100, 300  #: Streams of a seed for noise and for random poses, plus the number of poses.
Part = Literal["measured", "ground", "promise"]
"""The true arm; one of the family on a ground, with plans for the very fit; what came of a promise there."""


@dataclass(frozen=True)
class Bench:
    """Hold the true arm and where predictions are judged."""

    cell: Cell  #: The arm.
    asked: PlanningSettings  #: On its ground.
    tasks: Dataset  #: Noise-free deflections in the tasks under its one weight.
    workspace: Dataset  #: The same over the workspace.

    def off(self, estimates: Sequence[Estimate], data: Dataset) -> Array:
        """Subtract true from predicted deflections.

        Args:
            estimates: The estimates.
            data: True deflections.

        Returns:
            Differences, (estimates, poses, m, 3) [m].
        """
        return np.asarray(deflections_of_models(self.cell.vjm, estimates, data) - data.deflection)

    def errors_mm(self, estimates: Sequence[Estimate]) -> Iterator[tuple[float | None, float | None]]:
        """Compute RMS errors at the tasks and over the workspace [mm]; none of a failed estimator."""
        every = (_rms_mm(self.off(estimates, data), 1, 2).tolist() for data in (self.tasks, self.workspace))
        for estimate, tasks, workspace in zip(estimates, *every, strict=True):
            yield (None, None) if has_failed(estimate) else (tasks, workspace)


@dataclass(frozen=True)
class PlanErrorRow:
    """Hold RMS errors of one fit against the true deflection."""

    part: Part  #: What was measured.
    plan: str  #: Criterion of the plan, or "random".
    poses: int  #: How many were measured.
    fit: str  #: How they were identified.
    tasks_mm: float | None  #: At the tasks; of an estimator of one's own that failed none.
    workspace_mm: float | None = None  #: Over the workspace, where it is asked for.
    ground: str = ""  #: Name of the ground, of that part.
    expected: Expected | None = None  #: The promise that was tried.
    truth: str = ""  #: What a promise was tried on: one of FAMILY_TRUE_ARMS.
    prior: str = ""  #: One of wrong_prior.PRIORS.
    inside: float | None = None  #: Share of deflections along an axis inside the half widths of a promise.
    model: CampaignRow | None = None  #: Of the featured number of poses; the tasks are its check runs.
    #: Pose by pose of the workspace, of the featured plan for the tasks.
    each_place_mm: tuple[float, ...] | None = None
    status: str | None = None  #: Of the fit: "solved", or why not.
    data_file: str | None = None  #: dataset.csv: what the first trial measured of that plan.


def _trial(cell: Cell, asked: PlanningSettings, seed: int, own: Models) -> Iterator[PlanErrorRow]:
    """Make the rows of a seed; `asked` holds the plans."""
    yield from _of_plans(_build_bench(cell, asked), seed, own)
    for there in (asked, elsewhere(asked)):
        yield from _of_ground(cell, there, seed, own)


def _tried(cell: Cell, seed: int, own: Models) -> dict[str, Model]:
    """List the models of `FITS`, then the user's estimators, with the prior of a trial."""
    prior = wrong_prior(cell, seed)
    known = _fits(cell, prior)
    return {fit: known[fit] for fit in FITS} | {model.name: model for model in own(cell, prior)}


def _fits(cell: Cell, prior: Prior) -> dict[str, Model]:
    """Make models by name: of `FITS` with a prior the readings set its scale; `WHOLE` learns more of it."""
    *plain, whole = (
        replace(MODELS[name](cell), name=name) for name in (*MODELS_WITHOUT_PRIOR, WHOLE.removesuffix(FILLED))
    )
    models = [
        *with_priors(cell.arm, plain, prior, PriorUncertainty(UNCERTAINTY)),
        *plain,
        *with_priors(cell.arm, [whole], prior),
    ]
    return {model.name: model for model in models}


def _of_plans(bench: Bench, seed: int, own: Models) -> Iterator[PlanErrorRow]:
    """Identify every plan and random poses in every way."""
    scope, models = bench.asked.scope, _tried(bench.cell, seed, own)
    levels = [(name, n) for name in (*scope.criteria, RANDOM) for n in scope.numbers(name)]
    runs = [measure(bench, _poses_of(bench.asked, name, n, seed), seed) for name, n in levels]
    for fit, model in models.items():
        estimates = [fit_or_rigid(bench.cell, model, one) for one in runs]
        found = zip(levels, runs, estimates, bench.errors_mm(estimates), strict=True)
        for (name, n), data, estimate, errors in found:
            row = PlanErrorRow("measured", name, n, fit, *errors, status=estimate.status)
            if (n, fit) == (scope.featured, PLANNED):
                row = _featured(bench, row, model, estimate, data)
                if (name, seed) == ("test", bench.asked.seed):
                    row = replace(row, data_file=csv_text(data, bench.cell.arm))
            yield row


def _featured(
    bench: Bench, row: PlanErrorRow, model: Model, estimate: Estimate, data: Dataset
) -> PlanErrorRow:
    """Add to a row of the featured number of poses its model, and errors pose by pose."""
    name = f"{row.plan}, {row.fit}"
    setup, tasks = _setup_of(bench.asked), bench.tasks
    campaign = Campaign(setup, bench.asked.seed, data, data, tasks, tasks, bench.workspace)
    fits = Fits({name: [estimate]}, {name: estimate.solver_seconds}, [name] if model.filled else [])
    [own] = campaign_rows(bench.cell, campaign, fits, "tubes", placed=False)
    row = replace(row, model=own)
    if row.plan != "test":
        return row
    off = bench.off([estimate], bench.workspace)[0]
    return replace(row, each_place_mm=tuple(_rms_mm(off, 1).tolist()))


def _of_ground(cell: Cell, asked: PlanningSettings, seed: int, own: Models) -> Iterator[PlanErrorRow]:
    """Compare plans for the very fit with random poses, on one ground, the true arm one of the family.

    An estimator of one's own has the plan for `PLANNED`.
    """
    n = asked.scope.featured
    ground = asked.scope.ground.name
    models = _tried(cell, seed, own)
    bench = _build_bench(true_cell(cell, true_arm_of_seed(FAMILY_NAME, seed), seed), asked)
    drawn = _poses_of(asked, RANDOM, n, seed)
    chance = measure(bench, drawn, seed)
    yield from _of_promise(bench, seed, (RANDOM, drawn, chance))
    for fit, model in models.items():
        chosen = _poses_of(asked, "test", n, seed, fit if fit in FITS else PLANNED)
        data = measure(bench, chosen, seed)
        if fit == PLANNED:
            yield from _of_promise(bench, seed, ("test", chosen, data))
        both = [fit_or_rigid(bench.cell, model, runs) for runs in (data, chance)]
        for name, errors, estimate in zip(("test", RANDOM), bench.errors_mm(both), both, strict=True):
            yield PlanErrorRow("ground", name, n, fit, *errors, ground, status=estimate.status)


def prior_in_turn(seed: int) -> str:
    """Name the prior of a seed: another one each time that a truth comes round."""
    return list(PRIORS)[(seed + seed // len(FAMILY_TRUE_ARMS)) % len(PRIORS)]


def _of_promise(bench: Bench, seed: int, measured: tuple[str, Array, Dataset]) -> Iterator[PlanErrorRow]:
    """Compare what was promised of all links and joints, and of joints alone, with what came.

    `measured` are the name of a plan, its poses, and what was read there.
    """
    plan, q, data = measured
    cell = bench.cell
    settings = bench.asked
    name = prior_in_turn(seed)
    prior, tasks = prior_of(cell, name, seed), bench.tasks
    whole, models = _specify(cell, settings, prior, WHOLE), _fits(cell, prior)
    for fit, spec in (
        (WHOLE, whole),
        (INCUMBENT, least_squares(whole, prior, joints_only(cell.arm))),
    ):
        after = linear_fit_after(
            spec, prior, partial(whitened_rows_by_load, q=q, load_index=np.zeros(len(q), dtype=int))
        )
        promise = forecast_fit(after, whole.tasks.q, whole.tasks.load)
        [off] = bench.off([fit_model(cell, models[fit], data)], tasks)
        along_tool = off @ evaluate_chain(cell.vjm, tasks.q).tool_rotation
        own = along_tool.reshape(len(off), -1)
        yield PlanErrorRow(
            "promise",
            plan,
            len(q),
            fit,
            tasks_mm=float(_rms_mm(off, 0, 1)),
            ground=settings.scope.ground.name,
            expected=forecast_summary(inflate_intervals(promise)),
            truth=true_arm_of_seed(FAMILY_NAME, seed),
            prior=name,
            inside=float((np.abs(own) <= half_widths(promise)).mean()),
        )


def _rms_mm(off: Array, *over: int) -> Array:
    """Compute RMS lengths of vectors over some axes.

    Args:
        off: Vectors, (..., 3) [m].
        over: The axes.

    Returns:
        RMS [mm].
    """
    return np.asarray(MM * np.sqrt(np.square(off).sum(axis=-1).mean(axis=over)))


def _build_bench(cell: Cell, asked: PlanningSettings) -> Bench:
    """Make the true arm and its deflections where predictions are judged."""
    tasks, workspace = (_read(cell, asked, np.array(q)) for q in (asked.scene.tasks, asked.scene.workspace))
    return Bench(cell, asked, tasks, workspace)


def measure(bench: Bench, q: Array, seed: int) -> Dataset:
    """Read noisy runs of the true arm, every pose once under the weight.

    Args:
        bench: The true arm and where predictions are judged.
        q: Poses, (poses, n) [rad, m].
        seed: Seed of the trial.

    Returns:
        The readings.
    """
    return _read(bench.cell, bench.asked, q, trial_rng(seed, NOISE + len(q)))


def _read(cell: Cell, asked: PlanningSettings, q: Array, rng: np.random.Generator | None = None) -> Dataset:
    loaded = poses_with_weight(cell, q, np.arange(len(q)) + 1, asked.scope.payload)
    return read(cell, _setup_of(asked), loaded, rng)


def _setup_of(asked: PlanningSettings) -> Setup:
    """Describe what is measured, as every campaign does."""
    return Setup(arm=asked.arm, truth="nonlinear", sigma=asked.scope.sigma)


def _specify(cell: Cell, asked: PlanningSettings, prior: Prior, fit: str) -> PlanSpecification:
    """Specify the featured number of poses under one weight, with the arm's markers, planned for a fit.

    Without a prior of its own a fit's unknowns are still in units of the planner's.
    """
    scope = asked.scope
    scene = asked.scene
    load = weight(cell.vjm, asked.scope.payload)
    scaling = scale_by_prior(prior, cell.vjm, remove_law_parameters(_fits(cell, prior)[fit].structure))
    return PlanSpecification(
        setup=MeasurementSetup(cell.vjm, scaling, cell.vjm.markers, scope.sigma),
        loads=(load,),
        tasks=Tasks(np.array(scene.tasks), load),
        workspace_poses=np.array(scene.workspace),
        prior_uncertainty=UNCERTAINTY if fit.endswith(FILLED) else None,
        n_poses=scope.featured,
    )


def _poses_of(asked: PlanningSettings, name: str, poses: int, seed: int, fit: str = PLANNED) -> Array:
    """Return the poses of a plan, or random ones of a trial.

    Args:
        asked: Settings of the study.
        name: Name of the plan, or RANDOM.
        poses: Number of poses.
        seed: Seed of the trial.
        fit: Name of the fit.

    Returns:
        Poses, (poses, n) [rad].
    """
    if name != RANDOM:
        return np.reshape(asked.scene.plan(name, poses, fit).q_rad, (poses, -1))
    q = np.array(asked.scene.candidates)
    return np.asarray(q[trial_rng(seed, CHANCE + poses).choice(len(q), poses, replace=False)])


# --- Plans, made once for all trials ------------------------------------------------------------------------

AWAY_STREAM = 20  #: Streams of the other ground, over those of the first.

Job = tuple[PlanningSettings, str, str, int]
"""A plan to be made: the study on its ground, the fit that it is for, the criterion, how many poses."""


def _prepare(asked: PlanningSettings, everywhere: Everywhere[PlannedRow]) -> PlanningSettings:
    """Make the scenes and all plans, the same for all trials; PoseError for too few feasible poses."""
    cell = build_cell(find_arm(asked.arm))
    asked = replace(asked, scene=_scene(cell, asked, 0))
    asked = replace(asked, away=_scene(cell, elsewhere(asked), AWAY_STREAM))
    rows = everywhere(partial(_plan_row, asked), len(_jobs(asked)), PlannedRow)
    home, away = (tuple(row for row in rows if row.ground == ground.name) for ground in (HOME, AWAY))
    return replace(asked, scene=replace(asked.scene, plans=home), away=replace(asked.away, plans=away))


def _scene(cell: Cell, asked: PlanningSettings, first: int) -> PlanningScene:
    """Candidates, tasks and workspace of a ground; the streams of their randomness begin at `first`."""
    scope, rng = asked.scope, trial_rng(asked.seed, first)
    drawn = (
        (_conditions(scope), scope.candidates, trial_rng(asked.seed, first + 1)),
        (PoseConditions(area=scope.ground.area), scope.tasks, rng),
        (PoseConditions(area=SECTION_6_WORKSPACE), scope.workspace, rng),
    )
    found = (
        find_feasible_poses(build_checks(cell, conditions), count, own).q for conditions, count, own in drawn
    )
    candidates, tasks, workspace = (tuple(map(tuple, q.tolist())) for q in found)
    return PlanningScene(candidates, tasks, workspace)


def _conditions(scope: Scope) -> PoseConditions:
    return PoseConditions(station=Station(scope.ground.station), payload=Payload(scope.payload))


def _jobs(asked: PlanningSettings) -> list[Job]:
    scope, there = asked.scope, elsewhere(asked)
    grounds = [*((asked, fit) for fit in FITS if fit != PLANNED), *((there, fit) for fit in FITS)]
    return [
        *((asked, PLANNED, name, poses) for name in scope.criteria for poses in scope.numbers(name)),
        *((on, fit, "test", scope.featured) for on, fit in grounds),
    ]


def _plan_row(asked: PlanningSettings, k: int) -> PlannedRow:
    """Make a plan by its number; `asked` holds the scene."""
    cell, (there, fit, criterion, poses) = build_cell(find_arm(asked.arm)), _jobs(asked)[k]
    spec = replace(_specify(cell, there, wrong_prior(cell, there.seed), fit), n_poses=poses)
    start, checks = time.perf_counter(), build_checks(cell, _conditions(there.scope))
    reach, q = Feasibility(lambda q: feasible(checks, q)), np.array(there.scene.candidates)
    best = make_plan(spec, criterion, q, reach, trial_rng(there.seed, 2))
    return PlannedRow(
        ground=there.scope.ground.name,
        fit=fit,
        criterion=criterion,
        poses=poses,
        q_rad=tuple(best.q.ravel().tolist()),
        seconds=time.perf_counter() - start,
        efficiency_percent=100 * best.efficiency,
        expected_tasks_mm=forecast_summary(forecast_errors(best, task_rows(spec))).expected,
        observability=observability(best.candidates.problem, best.chosen_indices),
    )


# --- The report ---------------------------------------------------------------------------------------------

CRITERIA = "plan efficiency_percent expected_tasks_mm tasks_mm workspace_mm"
POSES = "plan poses tasks_mm workspace_mm expected_tasks_mm efficiency_percent"
TARGET_ERROR_MM = 0.1  #: Error at the tasks that a campaign is to reach [mm].
KEPT = "promised count inside_90 below above inside_95 over_promised"
GROUNDS = "ground fit judged planned_mm random_mm over_random planned_better better_than_joints seeds"
KEPT_BY: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "poses": ("plan", {"test": "planned"}),
    "tasks": ("ground", {}),
    "truth": ("truth", TRUE_ARM_LABELS),
    "prior": ("prior", {}),
}
"""What promises are told by: column, and what its words are called."""
PLACES = {"tasks_mm": "at the tasks", "workspace_mm": "over the workspace"}
PLAN_LABELS = KNOWN["plan"].called  #: What readers call the plans by each criterion, and random poses.
LOOKS = {
    **{PLAN_LABELS[name]: Look(SERIES[k], k, prior=False) for k, name in enumerate(Scope.criteria)},
    PLAN_LABELS[RANDOM]: Look(GREY, 0, prior=True),
}
"""Colour and mark of the plans by each criterion, random poses dashed."""


def _report(asked: PlanningSettings, seeds: range, trials: Trials) -> Report:
    """Report errors by criterion and number of poses, where planning pays, and whether promises hold."""
    f = _numbers(asked, seeds, trials)
    n, rivals = asked.scope.featured, [row.plan for row in f.criteria if row.plan != "test"]
    own = trials.where(part="measured", poses=n, fit=PLANNED)
    own = own.add(name=[PLAN_LABELS[name] for name in own["plan"].tolist()])
    badge = of_rivals(own, PLAN_LABELS["test"], [PLAN_LABELS[name] for name in rivals], "tasks_mm")
    # Over the workspace another criterion may be better.
    badge = badge and replace(badge, what="task error")
    criteria = Table(
        columns(CRITERIA),
        f.criteria,
        f"Plans of {n} poses by what they minimise",
        headline="tasks_mm",
        looks=LOOKS,
    )
    return Report(
        scenario=NAME,
        question=say("Which {n} poses give the best predictions where the robot works?", n=n),
        title=say(
            "{arm} under {payload_kg:g} kg, noise {dataset.sigma_um:g} um, {study.candidates} candidates; "
            "non-linear truth, {seeds}",
            f | {"study": Row(vars(f.study))},
            seeds=campaigns.seeds_label(f.seed),
        ),
        answer=headline(badge, criteria),
        claims=warnings(trials.where(part="measured"), "fit"),
        numbers=f,
        tables={
            "criteria": criteria,
            "grounds": Table(
                columns(GROUNDS),
                f.grounds,
                "Where planning lowers the error: two work areas (ground), and one plan for each fit",
            ),
            "kept": Table(
                columns(KEPT),
                [*f.kept, f.kept_joints],
                "Predicted and true errors on arms of the family, with wrong priors",
            ),
            "enough": Table(
                columns("plan fewest"),
                [Row(plan=name, fewest=n) for name, n in f.recommendation.fewest.items()],
                f"Poses that keep the tasks within {1000 * TARGET_ERROR_MM:g} um in 95 % of the trials",
            ),
            "poses": Table(
                columns(POSES),
                [row for row in f.errors if row.fit == PLANNED],
                f"Errors by number of poses, identified as {PLANNED}",
                headline="tasks_mm",
            ),
        },
        body=["criteria", "enough", "grounds", "kept", "poses", READ],
        badge=badge,
    )


def _numbers(asked: PlanningSettings, seeds: range, trials: Trials) -> Row:
    """Every number of report.json."""
    scope, n = asked.scope, asked.scope.featured
    measured, promises = trials.where(part="measured"), trials.where(part="promise")
    featured = measured.where(poses=n)
    models = [row.model for row in merged(featured.where(fit=PLANNED).keep("plan", "model."), "plan")]
    first = featured.where(plan="test", fit=PLANNED)
    errors = merged(measured.keep("fit", "plan", "poses", *PLACES), "fit", "plan", "poses")
    for row in errors:
        plan = None if row.plan == RANDOM else asked.scene.plan(row.plan, row.poses, PLANNED)
        row |= {key: plan and getattr(plan, key) for key in ("efficiency_percent", "expected_tasks_mm")}
    [each] = merged(first.keep("each_place_mm"))
    planned, own = [row for row in errors if row.fit == PLANNED], (*scope.criteria, RANDOM)
    [data] = merged(first.inside("model.measured"))
    return Row(
        seed=campaigns.seeds_of(seeds),
        arm=find_arm(asked.arm).resolve().name,
        payload_kg=scope.payload,
        prior=Row(scale=SCALE, shape_percent=100 * SHAPE, believed_within_percent=100 * UNCERTAINTY),
        tracker_m=scope.ground.station,
        dataset=Row(data, runs=n, poses=n, points=int(data.points), tasks=scope.tasks),
        models=[Row(model, parameters=int(model.parameters), paper=None) for model in models],
        where=each,
        plans=[plan for plan in asked.scene.plans if plan.fit == PLANNED],
        errors=errors,
        recommendation=Row(
            within_mm=TARGET_ERROR_MM, fewest=Row({name: _fewest(planned, name) for name in own})
        ),
        kept=list(_all_kept(promises.where(fit=WHOLE))),
        kept_joints=_kept(INCUMBENT, promises.where(fit=INCUMBENT)),
        grounds=list(_grounds(trials.where(part="ground"))),
        study=scope,
        criteria=[row for row in planned if row.poses == n],
    )


def _fewest(levels: Sequence[Row], plan: str) -> int | None:
    """The fewest poses that keep tasks within TARGET_ERROR_MM in 95 % of the trials, of few trials in all."""
    return next(
        (row.poses for row in levels if row.plan == plan and ends(row.tasks_mm)[1] <= TARGET_ERROR_MM), None
    )


def _all_kept(promises: Trials) -> Iterator[Row]:
    """All promises, then those of each plan, ground, truth and prior."""
    yield _kept("all", promises)
    for what, (column, called) in KEPT_BY.items():
        groups = {called.get(name, name): trials for (name,), trials in promises.groups(column)}
        for name in sorted(groups):
            yield _kept(f"{what}: {name}", groups[name])


def _kept(promised: str, own: Trials) -> Row:
    """Shares of 90 % intervals that hold the error, of errors beside them, of 95 % intervals that hold."""
    error = own["tasks_mm"]
    below, above = (float(np.mean(x)) for x in (error < own["expected.p05"], error > own["expected.p95"]))
    return Row(
        promised=promised,
        count=len(own),
        inside_90=1 - below - above,
        independent=independent((error >= own["expected.p05"]) & (error <= own["expected.p95"]), own["seed"]),
        below=below,
        above=above,
        inside_95=float(np.mean(own["inside"])),
        over_promised=number(error / own["expected.expected"], own["seed"]),
    )


def _grounds(rows: Trials) -> Iterator[Row]:
    """Every fit with its own plan on both grounds, beside random poses and beside joints alone."""
    for (ground,), here in rows.groups("ground"):
        for fit in here.values("fit"):
            ways = (("test", fit), (RANDOM, fit), ("test", INCUMBENT))
            seeds = {*here.where(fit=fit)["seed"].tolist()}
            own = [here.where(plan=plan, fit=name, seed=seeds) for plan, name in ways]
            for key, where in PLACES.items():
                plan, chance, joints = (way[key] for way in own)
                yield Row(
                    ground=ground,
                    fit=fit,
                    judged=where,
                    planned_mm=number(plan),
                    random_mm=number(chance),
                    over_random=float(np.median(plan) / np.median(chance)),
                    planned_better=wins(plan, chance),
                    better_than_joints=wins(plan, joints),
                    seeds=len(plan),
                )


def _figures(found: Report) -> dict[str, Figure]:
    """Draw errors by number of poses, with and without the prior; of one number by criterion."""
    f = Row(found.numbers)
    answer = f"Errors after {f.dataset.poses} poses, planned and random"
    reading = f"RMS errors, {f.arm}, {f.dataset.sigma_um:g} um of noise."
    if len(f.study.poses) == 1:
        note = f"{reading} Fit: {PLANNED}. Dotted line: random poses."
        return {
            "pose_selection.png": forest(found.tables["criteria"], PLACES, answer, note, PLAN_LABELS[RANDOM])
        }
    own = [fit for fit in dict.fromkeys(row.fit for row in f.errors) if fit not in FITS]
    plan, poses = columns("plan poses")
    panes = {
        f"{PLACES[key]}{words}": Table(
            (plan, poses, TableColumn(key, "RMS error", "mm")),
            [row for row in f.errors if row.fit == fit],
            looks=LOOKS,
        )
        for fit, key, words in (
            (PLANNED, "tasks_mm", ""),
            (PLANNED, "workspace_mm", ""),
            (BARE, "tasks_mm", ", identified without prior"),
            (INCUMBENT, "tasks_mm", ", Joints-only by least squares"),
            *((fit, "tasks_mm", f", {fit}") for fit in own),
        )
    }
    seeds = len(f.seed) if isinstance(f.seed, list) else 1
    figure = sweeps(
        panes,
        answer,
        f"{reading} Lines: medians of {seeds} seeds. Bands: {span(seeds)}.",
        (PLAN_LABELS["test"], PLAN_LABELS[RANDOM]),
    )
    return {"pose_selection.png": headed(figure, "", found.winner)}


def _write(run: Run[PlanningSettings]) -> PageContent:
    """Draw the featured plan, and where errors remain."""
    settings, cell = run.settings, build_cell(find_arm(run.settings.arm))
    n, scene = settings.scope.featured, settings.scene
    q, places = _poses_of(settings, "test", n, settings.seed), np.array(scene.workspace)
    left = np.array([middle(value) for value in run.report.numbers["where"].each_place_mm])
    at = [
        evaluate_chain(cell.vjm, np.array(own)).tool_position
        for own in (q, scene.tasks, scene.candidates, places)
    ]
    world = World(cell, settings.scope.ground.station, at[0], at[1], at[2])
    force = np.tile([0.0, 0.0, -GRAVITY * settings.scope.payload], (n, 1))
    named = {f"Run {k}": f"Joints at {cell.arm.pose_text(own)}." for k, own in enumerate(q, start=1)}
    rest = [
        f"Error {mm:.3f} mm. Joints at {cell.arm.pose_text(own)}."
        for own, mm in zip(places, left, strict=True)
    ]
    order = f"In the order of measuring: {PLAN_LABELS['test']}"
    plan = world.poses(order, named, q, world.measured(q, force), ordered=True)
    over = "Error of the predicted deflection, median over the trials (mm)"
    return PageContent(
        scene=Scene(cell, UNSCALED, [plan, world.all_over(places, rest, int(left.argmax()))]),
        map=PlaceMap(over, 1, at[3], [ModelLine(PLAN_LABELS["test"], OURS, left)]),
    )


STUDY = Study(
    name=NAME,
    about="Plan 4 to 40 poses by six criteria, measure them, identify, and judge where the robot works.",
    options=PlanningOptions,
    settings=_settings,
    seeds=(100, 2),
    row=PlanErrorRow,
    trial=_trial,
    report=_report,
    printed=("criteria",),
    figures=_figures,
    write=_write,
    prepare=_prepare,
    models="fit",
)
