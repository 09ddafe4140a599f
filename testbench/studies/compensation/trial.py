"""One trial: a true arm measured in every campaign, explained by every model, corrected and put to work.

The corrected joints go to the true arm in MuJoCo. The error is where its loaded tool then is, minus where the
unloaded tool is at the programmed joints.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from testbench.arm.folder import find_arm
from testbench.correct.compensated import Compensated, compensate
from testbench.correct.newton import Aim
from testbench.data.dataset import Dataset, in_order
from testbench.design.rows import Tasks
from testbench.errors import Array, Ids, NoEquilibrium
from testbench.files.write import csv_text
from testbench.identify.absolute.state import ArmState
from testbench.identify.arm_model import (
    ArmModel,
    ModelOrigin,
    elastic_state,
    model_of_compliances,
    model_of_estimate,
)
from testbench.identify.posterior import Posterior
from testbench.identify.prior import Prior
from testbench.model.load import read_weights
from testbench.model.structure import all153
from testbench.plant.disturbance import TYPICAL
from testbench.plant.disturbed import disturb, exactly_loaded
from testbench.plant.equilibrium import ArmEquilibrium, solve_unloaded_and_loaded
from testbench.plant.tracker import trial_rng
from testbench.plant.true_arms import FAMILY, TRUTHS, true_arm_of_seed
from testbench.studies.compensation.settings import (
    ADVISED,
    ARM,
    ARMS,
    DEFAULT,
    DRAWN,
    IDEAL,
    LINEAR,
    MODELS_WITHOUT_PRIOR,
    NOMINAL,
    NOWHERE,
    PERFECT,
    PLANNED,
    PRIOR,
    RUNS,
    SIGMA,
    TIP,
    WEIGHT,
    CompensationSettings,
    Way,
    drawn,
    jobs,
    loads,
    tasks,
)
from testbench.studies.study import without_cone
from testbench.workflows.cell import (
    Cell,
    LoadedPoses,
    Setup,
    build_cell,
    read_markers,
    settle_both,
    true_cell,
)
from testbench.workflows.model_selection import choose_model, with_priors
from testbench.workflows.models import Model, fit_or_rigid, named_models
from testbench.workflows.own_estimator import Models, estimator_models
from testbench.workflows.own_process import EstimatorSource
from testbench.workflows.perturbed_prior import PRIORS, prior_of
from testbench.workflows.rows import FAILED, MM

AIM = Aim(point=TIP)  #: The whole pose of the tool is put right.
SETUP = Setup(arm=ARM, truth="nonlinear", sigma=SIGMA)
DIGITS = 7  #: Of a distance in millimetres.
HIDDEN, CHOSEN, PROCESS, NOISE = 20, 30, 50, 1000
"""Streams of a seed: disturbances, random poses, forces of the process, noise (plus the campaign)."""
LINEAR_JOINTS = replace(TYPICAL, stiffening=0.0, backlash=0.0, hysteresis=0.0)
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


def trials(
    asked: CompensationSettings, seeds: Sequence[int], own: Sequence[EstimatorSource] = ()
) -> list[list[JobsRow]]:
    """Make the rows of some seeds; `asked` holds the scene.

    Args:
        asked: Settings of the study.
        seeds: Seeds of the trials.
        own: Estimators of the user.

    Returns:
        Rows of every seed.
    """
    cell = build_cell(find_arm(asked.arm))
    models = estimator_models(own)
    return [_trial(cell, asked, seed, models) for seed in seeds]


def _trial(cell: Cell, asked: CompensationSettings, seed: int, own: Models) -> list[JobsRow]:
    truth, work, rows = true_arm_of_seed(FAMILY, seed), tasks_of(asked, seed), []
    true, prior = true_cell(cell, truth, seed), prior_in_turn(cell, seed)
    for arm in ARMS:
        ways, (measured, working) = asked.ways(arm), true_arm(true, seed, arm)
        data = dict(zip(ways, measure(true, measured, asked, ways, seed), strict=True))
        fits = known(true, prior) + identified(true, data, prior, own(true, prior))
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
    return prior_of(cell, list(PRIORS)[seed // len(TRUTHS) % len(PRIORS)], seed)


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
    plant = disturb(cell.plant, LINEAR_JOINTS if arm == LINEAR else TYPICAL, trial_rng(seed, HIDDEN))
    return partial(solve_unloaded_and_loaded, plant), partial(
        solve_unloaded_and_loaded, exactly_loaded(plant)
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
    settled, first, found = settle(q, wrench[load], point[load]), 0, []
    for k, way in enumerate(ways):
        runs = slice(first, first := first + RUNS * way.poses)
        loaded = LoadedPoses(q[runs], pose[runs], wrench[load[runs]], point[load[runs]])
        before, after = (in_order(rest, runs) for rest in settled)
        found.append(read_markers(cell, SETUP, loaded, (before, after), trial_rng(seed, NOISE + k)))
    return found


def known(cell: Cell, prior: Prior) -> list[CorrectionModel]:
    """Make models that nobody identified: the folder's, the prior, and the true one.

    Args:
        cell: The arm with its model and its truth.
        prior: The prior.

    Returns:
        The models.
    """
    weights = read_weights(cell.arm)
    every = {NOMINAL: cell.arm.C_theta, PRIOR: prior.C_theta, PERFECT: cell.plant.arm.C_theta}
    return [
        CorrectionModel(NOWHERE, name, certain_model(elastic_state(cell.vjm, C, weights), name))
        for name, C in every.items()
    ]


def certain_model(state: ArmState, name: str) -> ArmModel:
    """Make an arm model without uncertainty from all its compliances.

    Args:
        state: The calibrated arm.
        name: Name of the model.

    Returns:
        The model.
    """
    structure = all153(state.vjm.arm)
    pi = structure.entries(state.C_theta)
    return model_of_compliances(
        state, structure, Posterior.normal(pi, np.zeros((0, structure.n))), ModelOrigin(name)
    )


def identified(
    cell: Cell, campaigns: Mapping[Way, Dataset], prior: Prior, more: Sequence[Model] = ()
) -> list[CorrectionModel]:
    """Identify all models, and more, from all campaigns.

    Args:
        cell: The arm with its model and its truth.
        campaigns: Readings by campaign.
        prior: The prior.
        more: Other models.

    Returns:
        The models.
    """
    weights, correction_models = read_weights(cell.arm), []
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
        chosen_model = choose_model(cell, runs, prior)
        correction_models.append(
            CorrectionModel(
                way,
                DEFAULT,
                model_of_estimate(cell.vjm, chosen_model.estimate, weights),
                chosen_model.name,
                chosen_model.estimate.status,
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
        equilibrium.tool + np.matvec(equilibrium.rotation, np.array(TIP)) for equilibrium in (rest, loaded)
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
    half = np.zeros((0, 3)) if order is None or fit.way == NOWHERE else order.half_width
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
