"""Corrections of drilling and milling: the error that they remove on the true elastic arm.

A trial is a true arm measured in every campaign, explained by every model, corrected and put to work. The
corrected joints go to the true arm in MuJoCo. The error is where its loaded tool then is, minus where the
unloaded tool is at the programmed joints.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Annotated

import numpy as np
import typer
from pydantic import Field

from testbench.arm.folder import find_arm
from testbench.correct.compensated import Compensated, compensate
from testbench.correct.newton import Aim
from testbench.data.dataset import Dataset, select_rows
from testbench.design.exchange import Feasibility
from testbench.design.planning import make_plan
from testbench.design.rows import MeasurementSetup, PlanSpecification, Tasks
from testbench.errors import Array, BenchError, Ids, NoEquilibrium
from testbench.files.write import csv_text
from testbench.identify.absolute.state import ArmState
from testbench.identify.posterior import (
    ArmModel,
    ModelOrigin,
    Posterior,
    elastic_state,
    model_of_compliances,
    model_of_estimate,
)
from testbench.identify.prior import Prior, scale_by_prior
from testbench.model.load import Load, read_body_masses, weight
from testbench.model.structure import all153
from testbench.plant.disturbance import TYPICAL_DISTURBANCES
from testbench.plant.equilibrium import ArmEquilibrium, solve_equilibrium, solve_unloaded_and_loaded
from testbench.plant.rigid_cell import Payload
from testbench.plant.shapes import elastic_frames, rigid_frames
from testbench.plant.tracker import Station
from testbench.plant.true_arms import (
    FAMILY_DESCRIPTIONS,
    FAMILY_NAME,
    FAMILY_TRUE_ARMS,
    disturb,
    true_arm_of_seed,
    with_exact_load,
)
from testbench.report.badge import of_rivals
from testbench.report.colours import CHOICE, MEASURED, TASK, Look, look
from testbench.report.figure import Figure, ranges
from testbench.report.markdown import Markdown
from testbench.report.report import Report, say
from testbench.report.scene import Layer, PageContent, PoseGroup, RunChart, Scene, arrow_scale
from testbench.report.scene import loads as load_arrows
from testbench.report.schema import Table, TableColumn, columns, pivot
from testbench.report.table import Row, Trials
from testbench.runs.rows import trial_rng
from testbench.runs.spread import span, spread
from testbench.studies.campaigns import seeds_of
from testbench.studies.panel import FORCE_RANGE, TIP, drawn, jobs, program, tasks
from testbench.studies.run import READ, headline, warnings
from testbench.studies.study import DEFAULT_WITHOUT_CONE, Everywhere, Run, Study, with_errors, without_cone
from testbench.workflows.campaign import (
    SECTION_6_AREA,
    LoadedPoses,
    Setup,
    read_markers,
    settle_both,
    true_cell,
)
from testbench.workflows.cell import Cell, build_cell
from testbench.workflows.model_names import WITHOUT_CONE
from testbench.workflows.models import (
    JOINTS_ONLY,
    PRIORS,
    UNCERTAINTY,
    Model,
    choose_model,
    fit_or_rigid,
    named_models,
    prior_of,
    with_priors,
    wrong_prior,
)
from testbench.workflows.own_estimator import Models
from testbench.workflows.plan_input import Checks, PoseConditions, build_checks, feasible, find_feasible_poses
from testbench.workflows.rows import FAILED, MM, UM

# --- Settings of the study of corrections, and what is made once for all trials -----------------------------

NAME = "compensation"
ARM = "kr500_l480"  #: The panel stands in its work area.
PAYLOAD, PULL, SLING = 460.3, 3000.0, 0.5
"""Hung mass [kg], pull of the rope along world y at the load point [N], and length of the sling [m]."""
RUNS = 2  #: In every pose.
SIGMA = 50e-6  #: Standard deviation of one reading along one axis [m].
STATION = (4.5, -2.5, 1.6)  #: Of the tracker [m].
PLANNED, RANDOM = "planned", "random"
WEIGHT, BOTH = "weight", "weight and pull"
"""What loads the arm while it is measured: in every pose the weight, or in every pose one of both."""
FEATURED = 12  #: Poses that the bars are about, and those of all campaigns of a disturbed arm.
IDEAL, LINEAR, REAL = "undisturbed", "linear joints", "disturbed"
"""How a true arm is disturbed: not at all; in all but that its joints are linear springs; in all."""
ARMS = (IDEAL, LINEAR, REAL)
NUMBERS, QUICK_NUMBERS = (6, 12, 20), (FEATURED,)
CANDIDATES, QUICK_CANDIDATES = 2000, 150
NOMINAL, PRIOR, PERFECT = "nominal", "prior alone", "perfect"
"""Not identified: the folder's values; the same as the prior has them, wrong; the true compliances."""
DEFAULT = "default"  #: What `identify` takes by default.
LEAST_SQUARES = "MLS56"
MODELS_WITHOUT_PRIOR = (JOINTS_ONLY, LEAST_SQUARES, "MGCO56")  #: Identified without a prior.
IDENTIFIED = (*MODELS_WITHOUT_PRIOR, DEFAULT_WITHOUT_CONE, DEFAULT)
MODELS = (NOMINAL, PRIOR, *IDENTIFIED, PERFECT)
DRAWN = (JOINTS_ONLY, DEFAULT)

Angles = tuple[tuple[float, ...], ...]  #: Joint angles, (poses, n) [rad].


@dataclass(frozen=True)
class CompensationPlanRow:
    """Hold a planned campaign."""

    loads: str  #: What loads the arm, WEIGHT or BOTH.
    poses: int
    q_rad: tuple[float, ...]  #: Joint angles, one pose after the other, (poses * n,) [rad].
    load: tuple[int, ...]  #: Which of the loads acts in each, (poses,).


@dataclass(frozen=True)
class CompensationScene:
    """Hold what all trials share."""

    candidates: Angles = ()  #: Feasible poses to measure.
    program: Angles = ()  #: Programmed joints of all jobs, one job after the other.
    plans: tuple[CompensationPlanRow, ...] = ()


@dataclass(frozen=True)
class Way:
    """Describe how a model is identified; one that is not has a campaign of no poses."""

    by: str = ""  #: PLANNED or RANDOM.
    loads: str = ""  #: WEIGHT or BOTH.
    poses: int = 0

    @property
    def campaign(self) -> str:
        """Describe the campaign in words."""
        return f"{self.by}, {self.loads}" if self.by else "none"


NOWHERE = Way()
ADVISED = Way(PLANNED, BOTH, FEATURED)


@dataclass(frozen=True)
class CompensationOptions:
    """Hold the flags of the study."""

    arm: Annotated[str, typer.Option(metavar="ARM", help="Arm in front of the panel.")] = ARM


@dataclass(frozen=True)
class CompensationSettings:
    """Describe what is tried."""

    arm: str
    seed: int  #: Root of the candidates and of the planner's prior.
    numbers: tuple[int, ...] = NUMBERS  #: Poses of the campaigns.
    candidates: int = CANDIDATES  #: Feasible poses to choose from.
    #: Made of the rest by `prepare`; empty before.
    scene: Annotated[CompensationScene, Field(exclude=True)] = CompensationScene()

    def ways(self, arm: str) -> tuple[Way, ...]:
        """List the campaigns of one of ARMS."""
        if arm == LINEAR:
            return (ADVISED,)
        numbers = self.numbers if arm == IDEAL else (FEATURED,)
        return tuple(Way(*one) for one in product((PLANNED, RANDOM), (WEIGHT, BOTH), numbers))


def _settings(options: CompensationOptions, quick: bool, seeds: range) -> CompensationSettings:
    """Make the settings of the flags."""
    if find_arm(options.arm).resolve().name != ARM:
        raise BenchError(f"--arm: expected {ARM}, whose work area has the panel, got {options.arm!r}")
    if quick:
        return CompensationSettings(options.arm, seeds[0], QUICK_NUMBERS, QUICK_CANDIDATES)
    return CompensationSettings(options.arm, seeds[0])


AROUND = 50  #: Candidates that stand for the workspace, which no criterion here asks for.


def _prepare(
    asked: CompensationSettings, everywhere: Everywhere[CompensationPlanRow]
) -> CompensationSettings:
    """Make the scene; PoseError for too few feasible poses."""
    cell = build_cell(find_arm(asked.arm))
    found = find_feasible_poses(_checks(cell), asked.candidates, trial_rng(asked.seed, 1)).q
    q = np.concatenate([program(cell, job) for job in jobs()])
    plain = [tuple(map(tuple, own.tolist())) for own in (found, q)]
    scene = CompensationScene(candidates=plain[0], program=plain[1])
    asked = replace(asked, scene=scene)
    rows = everywhere(partial(_plan_row, asked), len(_planned(asked)), CompensationPlanRow)
    return replace(asked, scene=replace(scene, plans=tuple(rows)))


def _planned(asked: CompensationSettings) -> list[tuple[str, int]]:
    return list(product((WEIGHT, BOTH), asked.numbers))


def _checks(cell: Cell) -> Checks:
    payload = Payload(PAYLOAD, SLING)
    return build_checks(cell, PoseConditions(area=SECTION_6_AREA, station=Station(STATION), payload=payload))


def loads(cell: Cell) -> tuple[Load, Load]:
    """Make the hung weight, and the pull of the rope."""
    return weight(cell.vjm, PAYLOAD), Load(np.array([0.0, PULL, 0.0, 0.0, 0.0, 0.0]), cell.vjm.load_point)


def _plan_row(asked: CompensationSettings, k: int) -> CompensationPlanRow:
    """Make a plan by its number."""
    cell, (name, poses) = build_cell(find_arm(asked.arm)), _planned(asked)[k]
    reach, spec = Feasibility(partial(feasible, _checks(cell))), _specify(cell, asked, name, poses)
    best = make_plan(spec, "test", np.array(asked.scene.candidates), reach, trial_rng(asked.seed, 2))
    return CompensationPlanRow(name, poses, tuple(best.q.ravel().tolist()), tuple(best.load_index.tolist()))


def _specify(cell: Cell, asked: CompensationSettings, name: str, poses: int) -> PlanSpecification:
    """Specify what a plan is for: the points of both jobs under forces of the middle of their range."""
    scaling = scale_by_prior(
        wrong_prior(cell, asked.seed), cell.vjm, named_models(cell, ("ALL153",))[0].structure
    )
    return PlanSpecification(
        setup=MeasurementSetup(cell.vjm, scaling, cell.vjm.markers, SIGMA),
        loads=loads(cell)[: 1 if name == WEIGHT else 2],
        tasks=tasks(np.array(asked.scene.program), [np.mean(FORCE_RANGE) * job.typical for job in jobs()]),
        workspace_poses=np.array(asked.scene.candidates[:AROUND]),
        prior_uncertainty=UNCERTAINTY,
        n_poses=poses,
    )


# --- One trial ----------------------------------------------------------------------------------------------

AIM = Aim(tool_point=TIP)  #: The whole pose of the tool is put right.
SETUP = Setup(arm=ARM, truth="nonlinear", sigma=SIGMA)
DIGITS = 7  #: Of a distance in millimetres.
HIDDEN, CHOSEN, PROCESS, NOISE = 20, 30, 50, 1000
"""Streams of a seed: disturbances, random poses, forces of the process, noise (plus the campaign)."""
LINEAR_JOINTS = replace(TYPICAL_DISTURBANCES, stiffening=0.0, backlash=0.0, hysteresis=0.0)
Settle = Callable[[Array, Array, Array], tuple[ArmEquilibrium, ArmEquilibrium]]
"""The arm unloaded and loaded, in poses (runs, n), under wrenches (runs, 6) at points (runs, 3)."""


@dataclass(frozen=True)
class JobsRow:
    """Hold all jobs of one trial, corrected by one model."""

    true_arm: str
    arm: str  #: How it is disturbed, one of ARMS.
    by: str  #: How poses were chosen, PLANNED or RANDOM; empty for a model that is not identified.
    loads: str  #: What loaded the arm, WEIGHT or BOTH; the same.
    poses: int  #: How many were measured; 0 for the same.
    name: str  #: Of the model.
    chosen: str | None  #: Of the default: what it chose.
    #: Distance of the loaded tool from where it was asked, not corrected, point by point, (points,) [mm].
    before_mm: tuple[float, ...]
    after_mm: tuple[float, ...]  #: The same, corrected.
    inside: int  #: Components of what is left that lie in their 95 % interval, of those that have a bound.
    of: int  #: So many have one; 0 for a model that has no intervals.
    unseen: int  #: And so many have none, as the readings say nothing of them.
    buckled: bool  #: Whether the model had no equilibrium under the process; nothing is corrected then.
    status: str = "solved"  #: Or why not; of an estimator of one's own that failed, why: it corrects nothing.
    #: Where the tool is off, not corrected, then corrected, (2, points, 3) in a row [mm]; of what is drawn of
    #: the first trial.
    off_mm: tuple[float, ...] | None = None
    data_file: str | None = None  #: dataset.csv of the first trial; the same.


@dataclass(frozen=True)
class CorrectionModel:
    """Hold a model to correct by."""

    way: Way
    name: str
    model: ArmModel
    chosen: str | None = None  #: Of the default: what it chose.
    status: str = "solved"


def _trial(cell: Cell, asked: CompensationSettings, seed: int, own: Models) -> list[JobsRow]:
    """Make the rows of a seed; `asked` holds the scene."""
    truth = true_arm_of_seed(FAMILY_NAME, seed)
    work = tasks_of(asked, seed)
    rows = []
    true, prior = true_cell(cell, truth, seed), prior_in_turn(cell, seed)
    for arm in ARMS:
        ways, (measured, working) = asked.ways(arm), true_arm(true, seed, arm)
        data = dict(zip(ways, measure(true, measured, asked, ways, seed), strict=True))
        fits = _known(true, prior) + _identified(true, data, prior, own(true, prior))
        orders = [order(fit, work) for fit in fits]
        before, *after = execute(working, work, orders)
        for fit, command, off in zip(fits, orders, after, strict=True):
            row = row_of(fit, command, before, off)
            shown = (seed, arm, fit.way) == (asked.seed, IDEAL, ADVISED) and fit.name in DRAWN
            if shown:
                off_mm = tuple(np.round(MM * np.stack([before, off]), DIGITS).ravel().tolist())
                row = replace(row, off_mm=off_mm, data_file=csv_text(data[fit.way], cell.arm))
            rows.append(replace(row, true_arm=truth, arm=arm))
    return rows


def prior_in_turn(cell: Cell, seed: int) -> Prior:
    """Choose the prior of a seed: every truth of the family meets every prior once in turn.

    Args:
        cell: The arm with its model and its truth.
        seed: Seed of the trial.

    Returns:
        The prior.
    """
    return prior_of(cell, list(PRIORS)[seed // len(FAMILY_TRUE_ARMS) % len(PRIORS)], seed)


def tasks_of(asked: CompensationSettings, seed: int) -> Tasks:
    """Make the jobs of a trial, each under a force of its own.

    Args:
        asked: Settings of the study.
        seed: Seed of the trial.

    Returns:
        The tasks.
    """
    rng = trial_rng(seed, PROCESS)
    return tasks(np.array(asked.scene.program), [drawn(job, rng) for job in jobs()])


def true_arm(cell: Cell, seed: int, arm: str) -> tuple[Settle, Settle]:
    """Make the arm of the cell's truth, one of ARMS, as it is measured and as it works.

    At work a weight unlike the recorded one is no force of the process.

    Args:
        cell: The arm with its model and its truth.
        seed: Seed of the trial.
        arm: One of ARMS.

    Returns:
        What settles the arm in both.
    """
    if arm == IDEAL:
        own = partial(settle_both, cell.plant, "nonlinear")
        return own, own
    plant = disturb(
        cell.plant, LINEAR_JOINTS if arm == LINEAR else TYPICAL_DISTURBANCES, trial_rng(seed, HIDDEN)
    )
    return partial(solve_unloaded_and_loaded, plant), partial(
        solve_unloaded_and_loaded, with_exact_load(plant)
    )


def chosen(asked: CompensationSettings, way: Way, seed: int) -> tuple[Array, Ids]:
    """Choose poses to measure, and which load acts in each.

    Fewer random poses are the first of more, with the loads by turns.

    Args:
        asked: Settings of the study.
        way: How the model is identified.
        seed: Seed of the trial.

    Returns:
        Poses, (poses, n) [rad], and loads, (poses,).
    """
    scene = asked.scene
    if way.by == PLANNED:
        plan = next(p for p in scene.plans if (p.loads, p.poses) == (way.loads, way.poses))
        return np.array(plan.q_rad).reshape(way.poses, -1), np.array(plan.load)
    every = trial_rng(seed, CHOSEN).choice(len(scene.candidates), max(asked.numbers), replace=False)
    load = np.zeros(way.poses, dtype=int) if way.loads == WEIGHT else np.arange(way.poses) % 2
    return np.array(scene.candidates)[every[: way.poses]], load


def measure(
    cell: Cell, settle: Settle, asked: CompensationSettings, ways: Sequence[Way], seed: int
) -> list[Dataset]:
    """Read campaigns, every pose RUNS times.

    Args:
        cell: The arm with its model and its truth.
        settle: Settles the arm.
        asked: Settings of the study.
        ways: The campaigns.
        seed: Seed of the trial.

    Returns:
        Readings of every campaign.
    """
    wrench, point = (np.stack([getattr(one, key) for one in loads(cell)]) for key in ("wrench", "point"))
    every = [chosen(asked, way, seed) for way in ways]
    q, load = (np.concatenate([np.repeat(own[k], RUNS, axis=0) for own in every]) for k in (0, 1))
    pose = np.concatenate([np.repeat(np.arange(way.poses) + 1, RUNS) for way in ways])
    settled = settle(q, wrench[load], point[load])
    first = 0
    found = []
    for k, way in enumerate(ways):
        runs = slice(first, first := first + RUNS * way.poses)
        loaded = LoadedPoses(q[runs], pose[runs], wrench[load[runs]], point[load[runs]])
        before, after = (select_rows(rest, runs) for rest in settled)
        found.append(read_markers(cell, SETUP, loaded, (before, after), trial_rng(seed, NOISE + k)))
    return found


def _known(cell: Cell, prior: Prior) -> list[CorrectionModel]:
    """Make models that nobody identified: the folder's, the prior, and the true one."""
    weights = read_body_masses(cell.arm)
    every = {NOMINAL: cell.arm.C_theta, PRIOR: prior.C_theta, PERFECT: cell.plant.arm.C_theta}
    return [
        CorrectionModel(NOWHERE, name, _certain_model(elastic_state(cell.vjm, C, weights), name))
        for name, C in every.items()
    ]


def _certain_model(state: ArmState, name: str) -> ArmModel:
    """Make an arm model without uncertainty from all its compliances."""
    structure = all153(state.vjm.arm)
    pi = structure.parameters_of(state.C_theta)
    return model_of_compliances(
        state,
        structure,
        Posterior.from_covariance_root(pi, np.zeros((0, structure.n_parameters))),
        ModelOrigin(name),
    )


def _identified(
    cell: Cell, campaigns: Mapping[Way, Dataset], prior: Prior, more: Sequence[Model]
) -> list[CorrectionModel]:
    """Identify all models, and more, from all campaigns."""
    weights, correction_models = read_body_masses(cell.arm), []
    plain, filled = (
        named_models(cell, MODELS_WITHOUT_PRIOR),
        with_priors(cell.arm, [without_cone(cell)], prior),
    )
    for model in (*plain, *filled, *more):
        for way, runs in campaigns.items():
            estimate = fit_or_rigid(cell, model, runs)
            correction_models.append(
                CorrectionModel(
                    way, model.name, model_of_estimate(cell.vjm, estimate, weights), status=estimate.status
                )
            )
    for way, runs in campaigns.items():
        name, estimate = choose_model(cell, runs, prior)
        correction_models.append(
            CorrectionModel(
                way,
                DEFAULT,
                model_of_estimate(cell.vjm, estimate, weights),
                name,
                estimate.status,
            )
        )
    return correction_models


def order(fit: CorrectionModel, work: Tasks) -> Compensated | None:
    """Compute the joints that a model commands.

    Args:
        fit: The model.
        work: The tasks.

    Returns:
        The correction; None, for the program's, where the model failed or has the arm buckle.
    """
    if fit.status.startswith(FAILED):
        return None
    try:
        return compensate(fit.model, work.q, [work.load], AIM)
    except NoEquilibrium:
        return None


def execute(working: Settle, work: Tasks, orders: Sequence[Compensated | None]) -> Array:
    """Compute errors of the tool's tip, not corrected, then corrected by each order, (n, points, 3) [m].

    Args:
        working: Settles the arm at work.
        work: The tasks.
        orders: Corrections; None for the program's joints.

    Returns:
        The distances, (n, points, 3) [m].
    """
    n = 1 + len(orders)
    q = np.concatenate(
        [work.q, *(work.q if compensated is None else compensated.q for compensated in orders)]
    )
    rest, loaded = working(q, *(np.tile(part, (n, 1)) for part in (work.load.wrench, work.load.point)))
    start, end = (
        equilibrium.tool_positions + np.matvec(equilibrium.tool_rotations, np.array(TIP))
        for equilibrium in (rest, loaded)
    )
    return np.asarray(end.reshape(n, -1, 3) - start[: len(work.q)])


def row_of(fit: CorrectionModel, order: Compensated | None, before: Array, after: Array) -> JobsRow:
    """Make the row of one fit, of no named arm.

    Args:
        fit: The model.
        order: Its correction; None for none.
        before: Errors before, (points, 3) [m].
        after: Errors after, (points, 3) [m].

    Returns:
        The row.
    """
    half = np.zeros((0, 3)) if order is None or fit.way == NOWHERE else order.error_half_width
    bounded = np.isfinite(half)
    return JobsRow(
        **{"true_arm": "", "arm": "", **vars(fit.way), "name": fit.name, "chosen": fit.chosen},
        status=fit.status,
        before_mm=_distances(before),
        after_mm=_distances(after),
        inside=int((bounded & (np.abs(after[: len(half)]) <= half)).sum()),
        of=int(bounded.sum()),
        unseen=int((~bounded).sum()),
        buckled=order is None,
    )


def _distances(off: Array) -> tuple[float, ...]:
    return tuple(np.round(MM * np.linalg.norm(off, axis=1), DIGITS).tolist())


# --- The report ---------------------------------------------------------------------------------------------

PART = 0.9  #: Share removed that cases are counted at.
LOOKS = {
    JOINTS_ONLY: look("Joints", "none"),
    LEAST_SQUARES: look("MLS56", "none"),
    "MGCO56": look("MGCO56", "psd"),
    DEFAULT_WITHOUT_CONE: look(WITHOUT_CONE, "none", prior=True),
    DEFAULT: CHOICE,
}
"""How models are drawn."""
DRAWN_AS = {
    "no correction": Look(MEASURED, 1, prior=True),
    "Joints-only": LOOKS[JOINTS_ONLY],
    "the default model": LOOKS[DEFAULT],
}
"""How the tool is drawn, not corrected and corrected by each model; what wins is last."""
LONGEST = 0.3  #: Most errors as they are drawn [m].
FOUND = (
    "name arm campaign poses removed_percent worst_percent nine_percent worse before.median_mm "
    "after.median_mm after.p95_mm after.most_mm covered_percent unseen_percent buckled"
)
BY_ARM = "true_arm name trials removed_percent worst_percent worse after.median_mm covered_percent"


def _report(asked: CompensationSettings, seeds: range, trials: Trials) -> Report:
    """Report over all truths, and truth by truth for the campaign that is advised."""
    advised = trials.where(**vars(ADVISED))
    met = [name for name in FAMILY_TRUE_ARMS if name in advised.values("true_arm")]
    chosen = trials.where(name=DEFAULT)["chosen"].tolist()
    left = advised.where(arm=REAL)
    left = left.add(left_mm=np.median(np.array([*left["after_mm"]]), axis=1))
    f = Row(
        seed=seeds_of(seeds),
        trials=len(seeds),
        arm=find_arm(asked.arm).resolve().name,
        payload=PAYLOAD,
        pull=PULL,
        runs=RUNS,
        sigma_um=UM * SIGMA,
        force=FORCE_RANGE,
        points={job.name: len(job.position) for job in jobs()},
        featured=ADVISED.poses,
        numbers=asked.numbers,
        truths={name: FAMILY_DESCRIPTIONS[name] for name in met},
        groups=_groups(asked, trials),
        by_truth=[
            Row(g, true_arm=name) for name in met for g in _groups(asked, advised.where(true_arm=name))
        ],
        chosen=[Row(name=name, fits=chosen.count(name)) for name in sorted(set(chosen))],
        dataset=Row(runs=RUNS * ADVISED.poses, points=ADVISED.poses, sigma_um=UM * SIGMA),
    )
    badge = of_rivals(left, DEFAULT, [LEAST_SQUARES, JOINTS_ONLY, DEFAULT_WITHOUT_CONE], "left_mm")
    way = (REAL, ADVISED.campaign, ADVISED.poses)
    ours = [g for g in f.groups if (g.arm, g.campaign, g.poses) == way]
    return Report(
        scenario=NAME,
        question=Markdown(
            "How much of the deflection under drilling and milling does a correction remove? How does this "
            "depend on the model and on the campaign?"
        ),
        title=say(
            "{arm}, {points[drilling]} drilled and {points[milling]} milled points, {force[0]:g} to "
            "{force[1]:g} N; noise {sigma_um:g} um; {trials:counted trial}",
            f,
        ),
        answer=headline(badge, Table(_error_columns("name"), ours)),
        claims=warnings(trials.where(arm=REAL)),
        numbers=f,
        tables=_tables(f),
        body=["both", "truths", READ],
        badge=badge,
    )


def _error_columns(keys: str) -> tuple[TableColumn, ...]:
    """Columns, and behind them what a correction leaves."""
    *others, left = columns(f"{keys} after.median_mm")
    return (*others, replace(left, heading="error after correction"))


def _groups(asked: CompensationSettings, trials: Trials) -> list[Row]:
    """By disturbance, campaign and model, in the order of the report."""
    groups = dict(trials.groups("arm", "by", "loads", "poses", "name"))
    return [
        _group(way, own)
        for arm in ARMS
        for way in (NOWHERE, *asked.ways(arm))
        for name in (*MODELS, *_user_estimator_names(trials))
        if (own := groups.get((arm, *vars(way).values(), name)))
    ]


def _user_estimator_names(trials: Trials) -> list[str]:
    """Name the user's estimators."""
    return [name for name in trials.values("name") if name not in MODELS]


def _group(way: Way, own: Trials) -> Row:
    """A model by a campaign; cases are points of trials."""
    before, after = (np.array([*own[key]]) for key in ("before_mm", "after_mm"))
    shares = 1 - after / before
    bounded, unseen = own["of"].sum(), own["unseen"].sum()
    return Row(
        {key: own[key][0] for key in ("arm", "by", "loads", "name")},
        campaign=way.campaign,
        poses=way.poses,
        trials=len(own),
        cases=shares.size,
        before=_sizes(before),
        after=_sizes(after),
        removed_percent=spread(100 * shares.ravel(), np.repeat(np.arange(len(own)), shares.shape[1])),
        worst_percent=100 * shares.min(),
        nine_percent=100 * float(np.mean(shares >= PART)),
        worse=int((shares < 0).sum()),
        covered_percent=100 * own["inside"].sum() / bounded if bounded else None,
        unseen_percent=100 * unseen / (unseen + bounded) if unseen + bounded else None,
        buckled=int(own["buckled"].sum()),
    )


def _sizes(mm: Array) -> Row:
    """How far the loaded tool is from where it was asked, (trials, points): over the trials, and at most."""
    medians, p95 = map(spread, np.percentile(mm, (50, 95), axis=1))
    return Row(median_mm=medians, p95_mm=p95, most_mm=float(mm.max()))


def _tables(f: Row) -> dict[str, Table]:
    """Share removed by campaign; all numbers; the advised campaign by true arm."""
    title = "share of a disturbed arm's deflection removed, median over all points, %"
    own = [g for g in f.groups if g.arm == REAL and g.poses == f.featured]
    campaign, model, share = columns("campaign name removed_percent")
    by_arm = [g for g in f.by_truth if g.arm == REAL and g.name in (JOINTS_ONLY, DEFAULT)]
    words = f"disturbed arms of each kind: {f.featured} planned poses with weight and pull"
    return {
        "short": pivot(Table((), own, title), campaign, model, replace(share, exact=True)),
        "both": Table(columns(FOUND), f.groups, "both jobs"),
        "truths": Table(columns(BY_ARM), by_arm, words),
    }


def _figures(found: Report) -> dict[str, Figure]:
    """Draw what is left by campaign of as many poses as are featured, the arm disturbed and undisturbed."""
    f = Row(found.numbers)
    groups = [g for g in f.groups if g.poses == f.featured]
    own = [name for name in dict.fromkeys(g.name for g in groups) if name not in LOOKS]
    looks = LOOKS | {name: look(f"own {k}", "own", prior=True) for k, name in enumerate(own, 1)}
    panes = {
        title: Table(_error_columns("campaign name"), [g for g in groups if g.arm == arm], looks=looks)
        for title, arm in (("disturbed arm", REAL), ("arm that bends as a model can", IDEAL))
    }
    return {
        "compensation.png": ranges(
            panes,
            f"{f.arm}: error of the tool after correction, {f.featured} poses",
            f"Median point of a trial; dots: medians, lines: {span(f.trials)} of {f.trials} trials, "
            f"{f.force[0]:g} to {f.force[1]:g} N.",
        )
    }


def _seen(run: Run[CompensationSettings]) -> PageContent:
    """Draw the jobs of the first trial: the tool without correction and with, the arm undisturbed."""
    seed, rows = run.seeds[0], run.first.where(arm=IDEAL, **vars(ADVISED))
    true, work = (
        true_cell(build_cell(find_arm(run.settings.arm)), true_arm_of_seed(FAMILY_NAME, seed), seed),
        tasks_of(run.settings, seed),
    )
    every = [np.reshape(rows.where(name=name)["off_mm"][0], (2, -1, 1, 3)) / MM for name in DRAWN]
    off = dict(zip(DRAWN_AS, (every[0][0], *(both[1] for both in every)), strict=True))
    before = off["no correction"]
    M = arrow_scale(before, LONGEST)
    where = np.concatenate([job.position for job in jobs()])[:, None]
    labels = [f"{job.name.capitalize()} {k + 1}" for job in jobs() for k in range(len(job.position))]
    bent, rest = (
        solve_equilibrium(true.plant, work.q, *load) for load in ((work.load.wrench, work.load.point), ())
    )
    tip = (where + M * before)[:, 0]
    poses = PoseGroup(
        name="Jobs",
        names=labels,
        words=[""] * len(labels),
        rigid=rigid_frames(true.room, work.q),
        bent=elastic_frames(true.plant, work.q, M * (bent.theta - rest.theta)),
        layers=[
            Layer("intended tool position, all points", TASK, "dots", where[None, :, 0]),
            *load_arrows(tip, work.load.wrench[:, :3], true.vjm.reach),
        ],
    )
    drawn, lines = with_errors(poses, where, off, DRAWN_AS, M)
    chart = RunChart("How far the tool is off at each point, arm undisturbed (mm)", 0, "point", labels, lines)
    return PageContent(
        scene=Scene(true, f"Errors and bending of the undisturbed arm x {M:g}.", [drawn]), runs=[chart]
    )


STUDY = Study(
    name=NAME,
    about="Correct a drilling pattern and a milling path by identified models; judge them on the true arm.",
    options=CompensationOptions,
    settings=_settings,
    seeds=(100, 6),
    arms=lambda settings: [find_arm(settings.arm)],
    row=JobsRow,
    trial=_trial,
    report=_report,
    printed=("short",),
    figures=_figures,
    write=_seen,
    prepare=_prepare,
    models="name",
)
