"""One trial: every plan and random poses measured on the true arm, identified in every way, judged.

Every trial has noise, a wrong prior and random poses of its own.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from testbench.arm.folder import find_arm
from testbench.data.dataset import Dataset
from testbench.design.forecast import forecast_on, inflate_intervals
from testbench.design.planning import Observability
from testbench.design.rows import MeasurementSetup, Specification, Tasks, measured_rows
from testbench.errors import Array
from testbench.files.write import csv_text
from testbench.identify.estimate import Estimate, all_deflections
from testbench.identify.metric import Prior, Strength, scale_by_prior
from testbench.model.laws import without_laws
from testbench.model.load import weight
from testbench.model.vjm import WorkArea, chain
from testbench.plant.tracker import trial_rng
from testbench.plant.true_arms import FAMILY, TRUTHS, true_arm_of_seed
from testbench.studies.campaign.trial import Fits
from testbench.studies.campaigns import CampaignRow, campaign_rows
from testbench.workflows.campaign_flags import ArmFlag
from testbench.workflows.cell import Campaign, Cell, Setup, poses_with_weight, true_cell
from testbench.workflows.cell import measure_markers as read
from testbench.workflows.model_names import FILLED
from testbench.workflows.models import (
    DEFAULT,
    JOINTS,
    MODELS,
    PRIORS,
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
from testbench.workflows.predicted_error import (
    Expected,
    forecast_summary,
    half_widths,
    joints_alone,
    linear_fit_after,
)
from testbench.workflows.rows import MM

# --- Settings of the study of pose selection: sizes, where the robot works, how runs are identified ---------

NAME = "pose_selection"
RANDOM = "random"  #: Poses without a plan, beside the criteria of criteria.CRITERIA.
Angles = tuple[tuple[float, ...], ...]  #: Joint angles, (poses, n) [rad].
MODELS_WITHOUT_PRIOR = ("MGCO68", "MGCO56", JOINTS)
#: How runs are identified.
FITS = (*(f"{name}{FILLED}" for name in MODELS_WITHOUT_PRIOR), *MODELS_WITHOUT_PRIOR)
#: The fit that plans are made for, and the same without its prior.
PLANNED, BARE = FITS[0], MODELS_WITHOUT_PRIOR[0]
INCUMBENT = JOINTS  #: Six joint compliances by plain least squares.
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


HOME = Ground(
    "in front", (4.5, -2.5, 1.6), WorkArea((1.7, -0.9, 1.1), (2.7, 0.9, 2.1), (1.0, 0.0, 0.0), np.pi / 4)
)
AWAY = Ground(
    "at the side", (-2.5, 4.0, 1.8), WorkArea((-0.9, 1.4, 0.9), (0.9, 2.4, 1.9), (0.0, 1.0, 0.0), np.pi / 4)
)
"""Where section 6 works, and another ground, on which nothing was tuned."""
ANYWHERE = WorkArea((-4.0, -4.0, 0.8), (4.0, 4.0, 4.0))  #: The workspace.


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


def settings(options: PlanningOptions, quick: bool, seeds: range) -> PlanningSettings:
    """Make the settings of the flags.

    Args:
        options: Flags of the command line.
        quick: Whether the run is a small one.
        seeds: Seeds of the trials.

    Returns:
        The settings.
    """
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
        return np.asarray(all_deflections(self.cell.vjm, estimates, data) - data.deflection)

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
    truth: str = ""  #: What a promise was tried on: one of truths.TRUTHS.
    prior: str = ""  #: One of wrong_prior.PRIORS.
    inside: float | None = None  #: Share of deflections along an axis inside the half widths of a promise.
    model: CampaignRow | None = None  #: Of the featured number of poses; the tasks are its check runs.
    each_task_mm: tuple[float, ...] | None = None  #: Task by task, of the featured plan for the tasks.
    each_place_mm: tuple[float, ...] | None = None  #: Pose by pose of the workspace; the same.
    status: str | None = None  #: Of the fit: "solved", or why not.
    data_file: str | None = None  #: dataset.csv: what the first trial measured of that plan.


def trial(cell: Cell, asked: PlanningSettings, seed: int, own: Models) -> Iterator[PlanErrorRow]:
    """Make the rows of a seed; `asked` holds the plans.

    Args:
        cell: The arm with its model and its truth.
        asked: Settings of the study.
        seed: Seed of the trial.
        own: Estimators of the user.

    Yields:
        The rows.
    """
    yield from _of_plans(_build_bench(cell, asked), seed, own)
    for there in (asked, elsewhere(asked)):
        yield from _of_ground(cell, there, seed, own)


def tried(cell: Cell, seed: int, own: Models) -> dict[str, Model]:
    """List the models of `FITS`, then the user's estimators, with the prior of a trial.

    Args:
        cell: The arm with its model and its truth.
        seed: Seed of the trial.
        own: Estimators of the user.

    Returns:
        Models by name.
    """
    prior = wrong_prior(cell, seed)
    known = fits(cell, prior)
    return {fit: known[fit] for fit in FITS} | {model.name: model for model in own(cell, prior)}


def fits(cell: Cell, prior: Prior) -> dict[str, Model]:
    """Make models by name: of `FITS` with a prior the readings set its scale; `WHOLE` learns more of it.

    Args:
        cell: The arm with its model and its truth.
        prior: The prior.

    Returns:
        Models by name.
    """
    *plain, whole = (
        replace(MODELS[name](cell), name=name) for name in (*MODELS_WITHOUT_PRIOR, WHOLE.removesuffix(FILLED))
    )
    models = [
        *with_priors(cell.arm, plain, prior, Strength(UNCERTAINTY)),
        *plain,
        *with_priors(cell.arm, [whole], prior),
    ]
    return {model.name: model for model in models}


def _of_plans(bench: Bench, seed: int, own: Models) -> Iterator[PlanErrorRow]:
    """Identify every plan and random poses in every way."""
    scope, models = bench.asked.scope, tried(bench.cell, seed, own)
    levels = [(name, n) for name in (*scope.criteria, RANDOM) for n in scope.numbers(name)]
    runs = [measure(bench, poses_of(bench.asked, name, n, seed), seed) for name, n in levels]
    for fit, model in models.items():
        estimates = [fit_or_rigid(bench.cell, model, one) for one in runs]
        found = zip(levels, runs, estimates, bench.errors_mm(estimates), strict=True)
        for (name, n), data, estimate, errors in found:
            row = PlanErrorRow("measured", name, n, fit, *errors, status=estimate.status)
            if (n, fit) == (scope.featured, PLANNED):
                row = featured(bench, row, model, estimate, data)
                if (name, seed) == ("test", bench.asked.seed):
                    row = replace(row, data_file=csv_text(data, bench.cell.arm))
            yield row


def featured(
    bench: Bench, row: PlanErrorRow, model: Model, estimate: Estimate, data: Dataset
) -> PlanErrorRow:
    """Add to a row of the featured number of poses its model, and errors pose by pose.

    Args:
        bench: The true arm and where predictions are judged.
        row: The row.
        model: The model.
        estimate: The estimate.
        data: Measured runs.

    Returns:
        The row.
    """
    name = f"{row.plan}, {row.fit}"
    setup, tasks = _setup_of(bench.asked), bench.tasks
    campaign = Campaign(setup, bench.asked.seed, data, data, tasks, tasks, bench.workspace)
    fits = Fits({name: [estimate]}, {name: estimate.solver_seconds}, [name] if model.filled else [])
    [own] = campaign_rows(bench.cell, campaign, fits, "tubes", placed=False)
    row = replace(row, model=own)
    if row.plan != "test":
        return row
    return replace(
        row,
        each_task_mm=tuple(_rms_mm(bench.off([estimate], tasks)[0], 1).tolist()),
        each_place_mm=tuple(_rms_mm(bench.off([estimate], bench.workspace)[0], 1).tolist()),
    )


def _of_ground(cell: Cell, asked: PlanningSettings, seed: int, own: Models) -> Iterator[PlanErrorRow]:
    """Compare plans for the very fit with random poses, on one ground, the true arm one of the family.

    An estimator of one's own has the plan for `PLANNED`.
    """
    n, ground, models = asked.scope.featured, asked.scope.ground.name, tried(cell, seed, own)
    bench = _build_bench(true_cell(cell, true_arm_of_seed(FAMILY, seed), seed), asked)
    drawn = poses_of(asked, RANDOM, n, seed)
    chance = measure(bench, drawn, seed)
    yield from _of_promise(bench, seed, (RANDOM, drawn, chance))
    for fit, model in models.items():
        chosen = poses_of(asked, "test", n, seed, fit if fit in FITS else PLANNED)
        data = measure(bench, chosen, seed)
        if fit == PLANNED:
            yield from _of_promise(bench, seed, ("test", chosen, data))
        both = [fit_or_rigid(bench.cell, model, runs) for runs in (data, chance)]
        for name, errors, estimate in zip(("test", RANDOM), bench.errors_mm(both), both, strict=True):
            yield PlanErrorRow("ground", name, n, fit, *errors, ground, status=estimate.status)


def prior_in_turn(seed: int) -> str:
    """Name the prior of a seed: another one each time that a truth comes round."""
    return list(PRIORS)[(seed + seed // len(TRUTHS)) % len(PRIORS)]


def _of_promise(bench: Bench, seed: int, measured: tuple[str, Array, Dataset]) -> Iterator[PlanErrorRow]:
    """Compare what was promised of all links and joints, and of joints alone, with what came.

    `measured` are the name of a plan, its poses, and what was read there.
    """
    (plan, q, data), cell, settings, name = measured, bench.cell, bench.asked, prior_in_turn(seed)
    prior, tasks = prior_of(cell, name, seed), bench.tasks
    whole, models = specify(cell, settings, prior, WHOLE), fits(cell, prior)
    for fit, spec in ((WHOLE, whole), (INCUMBENT, joints_alone(whole, prior))):
        after = linear_fit_after(spec, prior, partial(measured_rows, q=q, load=np.zeros(len(q), dtype=int)))
        promise = forecast_on(after, whole.tasks.q, whole.tasks.load)
        [off] = bench.off([fit_model(cell, models[fit], data)], tasks)
        own = (off @ chain(cell.vjm, tasks.q).rotation).reshape(len(off), -1)  # along the tool's axes
        yield PlanErrorRow(
            "promise",
            plan,
            len(q),
            fit,
            tasks_mm=float(_rms_mm(off, 0, 1)),
            ground=settings.scope.ground.name,
            expected=forecast_summary(inflate_intervals(promise)),
            truth=true_arm_of_seed(FAMILY, seed),
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


def specify(cell: Cell, asked: PlanningSettings, prior: Prior, fit: str = PLANNED) -> Specification:
    """Specify the featured number of poses under one weight, with the arm's markers, planned for a fit.

    Without a prior of its own a fit's unknowns are still in units of the planner's.

    Args:
        cell: The arm with its model and its truth.
        asked: Settings of the study.
        prior: The prior.
        fit: Name of the fit.

    Returns:
        The specification.
    """
    scope, scene, load = asked.scope, asked.scene, weight(cell.vjm, asked.scope.payload)
    scaling = scale_by_prior(prior, cell.vjm, without_laws(fits(cell, prior)[fit].structure))
    return Specification(
        experiment=MeasurementSetup(cell.vjm, scaling, cell.vjm.markers, scope.sigma),
        loads=(load,),
        tasks=Tasks(np.array(scene.tasks), load),
        workspace=np.array(scene.workspace),
        uncertainty=UNCERTAINTY if fit.endswith(FILLED) else None,
        poses=scope.featured,
    )


def poses_of(asked: PlanningSettings, name: str, poses: int, seed: int, fit: str = PLANNED) -> Array:
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
