"""Tasks of the bench as data, the entries, and a trial: every task of a seed, given to all entries.

A task never changes under its version. Poses, loads, the true arm, what disturbs it, the noise and the errors
of the prior come of the seed. Entries are files with a function `estimate`, among them those that stand in
every table; each is tried with the prior and without, beside the default.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from testbench.arm.folder import PACKAGE, find_arm
from testbench.data.dataset import Dataset
from testbench.data.series import select_rows
from testbench.errors import Array, BenchError
from testbench.files.write import csv_text
from testbench.identify import Regression
from testbench.identify.absolute.fit import CalibrationOptions, linearise_readings, select_and_solve
from testbench.identify.absolute.inner import apply_step, back_substitute, compliance_rows, factor_of
from testbench.identify.absolute.posterior import locate_series, model_of
from testbench.identify.absolute.scatter import residuals
from testbench.identify.estimate import Constraint, deflections, is_conservative, score
from testbench.identify.posterior import CONFIDENCE, quantile
from testbench.identify.prior import Prior, cad_prior
from testbench.identify.registered import register_dataset
from testbench.model.structure import Structure, all153
from testbench.model.vjm import chain, marker_points, observation
from testbench.plant.disturbance import Disturbances
from testbench.plant.tracker import trial_rng
from testbench.runs.spread import Number, Share
from testbench.studies.absolute.real import LINKS, SPRINGS, read
from testbench.studies.campaign.disturbed import ALL, disturbances, disturbed
from testbench.studies.campaign.trial import LEARNS, Cover, cover, covers, reread
from testbench.workflows.absolute import FRAME_POSES, evenly_spaced_rows
from testbench.workflows.absolute_truth import by_trackers
from testbench.workflows.cell import Cell, Scenario, build_cell, draw_poses, simulate_at, true_cell
from testbench.workflows.model_selection import with_priors
from testbench.workflows.models import named_models, without_compliances
from testbench.workflows.own_estimator import (
    MAX_COMPLIANCE,
    LimitOptions,
    check_reach,
    check_unchanged,
    parameters_of,
    read_estimators,
)
from testbench.workflows.own_process import SUFFIX, EstimatorSource, Limits, call_estimator
from testbench.workflows.perturbed_prior import prior_of
from testbench.workflows.plan_input import Place
from testbench.workflows.pose_campaign import FullPose, simulate_full_pose
from testbench.workflows.rows import FAILED, MM, NO_ERRORS, DatasetRow, ErrorRow, dataset_row, error_row

DEFAULT = "default"  #: What identify does by default, with the class's prior.
JOINTS = "joints"
FLOORS = (JOINTS, "least-squares", "ridge", "prior")
"""Files of `entries/` that stand in every table: to be worse is to be of no use."""
FOLDERS = (PACKAGE / "entries", PACKAGE.parent / "entries")
"""Where ours are: a wheel brings them inside the package."""


def read_entries(asked: Sequence[str], limits: Limits) -> tuple[EstimatorSource, ...]:
    """Read the floors, then the other entries, FILE.py or as `--estimator`; raises as `read_estimators`.

    Args:
        asked: Entries as the command line names them.
        limits: Limits of a call.

    Returns:
        The estimators.
    """
    folder = next((folder for folder in FOLDERS if folder.is_dir()), FOLDERS[-1])
    floors = [folder / f"{name}{SUFFIX}" for name in FLOORS]
    others = [text for text in asked if Path(text).resolve() not in floors]
    return read_estimators(
        [*map(_full, map(str, floors)), *map(_full, others)], limits, (DEFAULT,), "ENTRY.py"
    )


def _full(text: str) -> str:
    """An entry as `--estimator` has it: a file alone is called by its stem, or as it is named."""
    if not text.endswith(SUFFIX):
        return text
    return f"{text}:estimate" if "=" in text else f"{Path(text).stem}={text}:estimate"


HEAVY, SIX_AXES, REAL = "kr500_l480", "arm_6r", "ur10"
JUDGED = 100  #: Poses of a weight's deflections that judge, never measured.
SIGMA, PER_READING = 50e-6, 2**-0.5
"""Noise of a reading along an axis [m]; section 5.2 states that of a deflection, of two readings [1]."""
SECTION_5_2 = FullPose(
    arm=SIX_AXES,
    truth="nonlinear",
    sigma=25e-6 * PER_READING,
    sigma_rotation=250e-6 * PER_READING,
    least=9e-3,
    most=41e-3,
)

ELASTIC = CalibrationOptions(only=frozenset({SPRINGS, LINKS}))  #: What explains the UR10 beside geometry.
FAMILY = ("tubes", "off_10", "off_20", "off_40", "cast", "joints")
OTHERS = ("stiffer_3", "stiffer_10", "stiffer_30", "soft_link", "coupled", "far_joints")
WRONG = ("link", "joints", "axes", "uncoupled")


@dataclass(frozen=True)
class Task:
    """Describe what is measured, of which arms."""

    what: str  #: In words.
    poses: int  #: Measured.
    version: int = 1
    arm: str = HEAVY
    #: What hangs in every pose in turn, over the payload [1]; empty: six wrenches and full poses read.
    loads: tuple[float, ...] = (1.0, 1.0)
    arms: tuple[str, ...] = FAMILY  #: True ones, by seed in turn.
    disturbed: bool = False  #: Whether all disturbances are on.
    trackers: tuple[Place, ...] = ()  #: Where trackers stand whose frames nobody knows [m].
    priors: tuple[str, ...] = ("scaled",)  #: What is wrong with the prior, by seed in turn.


NEAR, ASIDE = (5.5, -2.0, 1.0), (5.0, 3.0, 1.4)
TASKS: Mapping[str, Task] = {
    "gravity-8": Task("a weight in 8 poses, twice", 8),
    "gravity-12": Task("a weight in 12 poses, twice", 12),
    "gravity-20": Task("a weight in 20 poses, twice", 20),
    "loads": Task("a third, two thirds and all of the weight in 8 poses", 8, loads=(1 / 3, 2 / 3, 1.0)),
    "section-5-2": Task(
        "six wrenches in 18 poses of the paper's arm, full poses", 18, arm=SIX_AXES, loads=()
    ),
    "disturbed": Task("every disturbance, 12 poses", 12, disturbed=True),
    "frame": Task("one tracker in an unknown frame, 12 poses", 12, trackers=(NEAR,)),
    "stations": Task("two trackers, disturbed arm, 12 poses", 12, disturbed=True, trackers=(NEAR, ASIDE)),
    "other-arms": Task("true arms of kinds held out of the family, 12 poses", 12, arms=OTHERS),
    "ur10": Task("a real UR10's own weight, poses of series C; series A judges", 200, arm=REAL, version=2),
    "wrong-prior": Task("a prior wrong in a part of it, 12 poses", 12, priors=WRONG),
}
"""By name."""


@dataclass(frozen=True)
class BenchProblem:
    """Hold what an entry is given, and what judges its answer."""

    cell: Cell  #: The arm; its model has the targets where they were found.
    data: Dataset | Regression  #: Readings, or their equations where frame and geometry were unknown too.
    prior: Prior  #: Of the class that has one.
    true_arm: str
    true: Array  #: Deflections that are never given, (runs, m, 3) [m].
    #: The same by parameters, (n,); a model's own law of joints counts where the estimate has one.
    predict: Callable[[Array], Array]
    truth: Dataset | None = None  #: Poses, loads and targets of these; None where no pair was read.

    @property
    def structure(self) -> Structure:
        """Return the structure of all links and joints."""
        return all153(self.cell.arm)


def problem(task: Task, cell: Cell, seed: int) -> BenchProblem:
    """Make a task with this seed.

    Args:
        task: The task.
        cell: The cell of its arm.
        seed: Seed of the trial.

    Returns:
        What an entry is given, and what judges it.
    """
    if task.arm == REAL:
        return _real(task, cell, seed)
    own, prior = task.arms[seed % len(task.arms)], task.priors[seed % len(task.priors)]
    true = true_cell(cell, own, seed)
    if task.loads:
        data, truth = _weight(task, true, seed)
    else:
        campaign = simulate_full_pose(true, SECTION_5_2, seed)
        data, truth = campaign.identification, campaign.truth
    if task.trackers:
        found = register_dataset(cell.vjm, data, "tracker")
        true, data = replace(true, vjm=found.vjm), found.data
    rows = observation_of(true, truth)
    return BenchProblem(
        true, data, prior_of(cell, prior, seed), own, truth.deflection, lambda pi: rows @ pi, truth
    )


def _real(task: Task, cell: Cell, seed: int) -> BenchProblem:
    """Random poses of series C train, every sixth of A judges; geometry and frames follow compliances."""
    _, (a, c) = read(1)
    train, prior = select_rows(c, trial_rng(seed).permutation(c.rows)[: task.poses]), cad_prior(cell.arm)
    linearised_readings = linearise_readings(cell.vjm, (train,), prior, ELASTIC)
    known = select_and_solve(linearised_readings, ELASTIC)
    assert known.active.elastic
    T = factor_of(known.active, linearised_readings.reduced, known.chosen.scales)
    judge = select_rows(a, np.arange(0, a.rows, 6))
    register = evenly_spaced_rows(judge, FRAME_POSES)
    rest = select_rows(judge, np.setdiff1d(np.arange(judge.rows), register))

    def off(pi: Array) -> Array:
        state = apply_step(linearised_readings.state, known.active, back_substitute(T, pi))
        placed = locate_series(model_of(replace(known, state=state)), judge, register)
        return -residuals(placed.state, rest)[:1].transpose(2, 0, 1)

    data = compliance_rows(T, known.active.elastic, int(linearised_readings.reduced.counts.sum()))
    return BenchProblem(cell, data, prior, REAL, np.zeros((rest.rows, 1, 3)), off)


def observation_of(cell: Cell, truth: Dataset) -> Array:
    """Compute how parameters of all links and joints move targets.

    Args:
        cell: The arm with its model and its truth.
        truth: True deflections.

    Returns:
        Rows of the observation matrix, (runs, m, 3, n).
    """
    where, points = chain(cell.vjm, truth.q), marker_points(cell.vjm, truth.markers)
    return observation(where, all153(cell.arm), truth.wrench, truth.point, points)


def _weight(task: Task, true: Cell, seed: int) -> tuple[Dataset, Dataset]:
    """A weight in poses of section 6, and its true deflections all over the workspace."""
    scenario = Scenario(
        arm=true.arm.name,
        truth="linear",  # for poses and loads alone
        noise=False,
        identification_poses=task.poses,
        identification_runs=task.poses * len(task.loads),
        check_poses=1,
        check_runs=1,
        workspace_poses=JUDGED,
    )
    campaign = simulate_at(true, scenario, seed, draw_poses(true, scenario, seed))
    runs = campaign.identification
    share: Array = np.array(task.loads)[np.arange(runs.runs) % len(task.loads)]
    loaded = replace(campaign, identification=replace(runs, wrench=share[:, None] * runs.wrench))
    clean, truth = disturbed(true, loaded, disturbances(1.0)[ALL] if task.disturbed else Disturbances(), seed)
    if task.trackers:
        return by_trackers(clean, task.trackers, seed), truth
    return reread(clean, SIGMA, trial_rng(seed, 1)), truth


DONE, SKIPPED = "done", "skipped: "
SKIP = "raised NotImplementedError: "  #: How an entry says that a task, or class, is none of its own.


@dataclass(frozen=True)
class BenchOptions(LimitOptions):
    """Hold the flags of the bench."""

    entries: Annotated[
        list[str] | None,
        typer.Argument(metavar="ENTRY.py...", help="Files with a function estimate: docs/own_estimator.md."),
    ] = None
    task: Annotated[list[str] | None, typer.Option(metavar="NAME", help="Only this task; repeatable.")] = None


@dataclass(frozen=True)
class BenchSettings:
    """Describe what is tried."""

    tasks: tuple[str, ...]  #: Names.
    versions: tuple[int, ...]  #: Of them.
    own: tuple[EstimatorSource, ...]  #: Entries.
    first: int  #: The first seed.


@dataclass(frozen=True)
class EntryRow:
    """Hold one answer."""

    name: str  #: Of the entry.
    structure: str  #: For its look.
    constraint: Constraint
    prior: bool  #: Its class: whether a prior was given.
    task: str
    true_arm: str
    deflection_mm: float  #: What was to be predicted, RMS: the error of who predicts nothing.
    status: str = DONE
    workspace: ErrorRow = NO_ERRORS  #: Against true deflections that were not given.
    conservative: Share | None = None
    cover: Cover | None = None  #: 95 % intervals; None where the entry gives none.
    cpu_seconds: Number = None  #: Processor time.
    measured: DatasetRow | None = None  #: The dataset of the first seed and task.
    data_file: str | None = None


def settings(options: BenchOptions, quick: bool, seeds: range) -> BenchSettings:
    """Make the settings of the flags; raises BenchError for a task or an entry that there is not.

    Args:
        options: Flags of the command line.
        quick: Whether the run is a small one.
        seeds: Seeds of the trials.

    Returns:
        The settings.
    """
    names = tuple(dict.fromkeys(options.task or TASKS))
    for name in names:
        if name not in TASKS:
            raise BenchError(f"--task: expected some of {', '.join(TASKS)}, got {name!r}")
    names = names[:2] if quick and not options.task else names
    estimator_sources = read_entries(options.entries or (), options.limits)
    return BenchSettings(names, tuple(TASKS[name].version for name in names), estimator_sources, seeds[0])


def trials(asked: BenchSettings, seeds: Sequence[int]) -> list[list[EntryRow]]:
    """Make the rows of some seeds, one per answer.

    Args:
        asked: Settings of the study.
        seeds: Seeds of the trials.

    Returns:
        Rows of every seed.
    """
    cells = {arm: build_cell(find_arm(arm)) for arm in {TASKS[name].arm for name in asked.tasks}}
    found: list[list[EntryRow]] = []
    check_unchanged(asked.own)
    for seed in seeds:
        made = [problem(TASKS[name], cells[TASKS[name].arm], seed) for name in asked.tasks]
        each = zip(asked.tasks, made, strict=True)
        rows = [row for name, own in each for row in _task(name, own, asked.own)]
        first = _with_data(rows[0], made[0]) if seed == asked.first else rows[0]
        found.append([first, *rows[1:]])
    return found


def _with_data(row: EntryRow, own: BenchProblem) -> EntryRow:
    """The same with what was given."""
    if isinstance(own.data, Dataset):
        return replace(row, measured=dataset_row(own.data), data_file=csv_text(own.data, own.cell.arm))
    text = StringIO()
    np.savetxt(text, np.column_stack(own.data.rows), delimiter=",")
    return replace(row, data_file=text.getvalue())


def _task(task: str, own: BenchProblem, entries: Sequence[EstimatorSource]) -> Iterator[EntryRow]:
    """Rows of a task, those without a prior first."""
    size = MM * score(own.predict(np.zeros(own.structure.n)), own.true).rms
    about = (task, own.true_arm, size)
    for prior in (None, own.prior):
        for k, entry in enumerate(entries, 1):
            row = EntryRow(entry.name, f"own {k}", "own", prior is not None, *about)
            yield _answered(row, own, entry, prior)
    yield _by_default(EntryRow(DEFAULT, LEARNS[0], "psd", True, *about), own)


def _by_default(row: EntryRow, own: BenchProblem) -> EntryRow:
    """What identify's default makes of it; of equations without laws of joints, which these do not tell."""
    [model] = with_priors(own.cell.arm, named_models(own.cell, LEARNS), own.prior)
    structure = own.structure if own.truth is None else model.structure
    start = time.process_time()
    estimate = model.estimator(own.cell.vjm, structure, own.data)  # type: ignore[arg-type]
    seconds = time.process_time() - start
    moved = deflections(own.cell.vjm, estimate, own.truth) if own.truth else own.predict(estimate.pi)
    return replace(
        row,
        workspace=error_row(score(moved, own.true)),
        conservative=estimate.conservative,
        cover=cover(own.cell, estimate, own.truth) if own.truth else None,
        cpu_seconds=seconds,
    )


def _answered(row: EntryRow, own: BenchProblem, entry: EstimatorSource, prior: Prior | None) -> EntryRow:
    """What an entry makes of it, or why it makes nothing."""
    try:
        answer = call_estimator(entry, (without_compliances(own.cell.vjm), own.structure, own.data, prior))
        pi = parameters_of(own.structure, answer.values)
        K = None if answer.covariance is None else covariance(answer.covariance, len(pi))
        check_reach(moved := own.predict(pi), own.cell.vjm)
    except BenchError as err:
        why = str(err)
        skips = why.startswith(SKIP)
        return replace(row, status=SKIPPED + why.removeprefix(SKIP) if skips else FAILED + why)
    half = half_widths(observation_of(own.cell, own.truth), K) if own.truth and K is not None else None
    return replace(
        row,
        workspace=error_row(score(moved, own.true)),
        conservative=is_conservative(own.structure, own.structure.matrix(pi)),
        cover=None if half is None else covers(moved, half, own.true),
        cpu_seconds=answer.cpu_seconds,
    )


def covariance(found: Array, n: int) -> Array:
    """Check the covariance of parameters; BenchError for what is none.

    Args:
        found: What the entry returned.
        n: Number of parameters.

    Returns:
        The covariance, (n, n).
    """
    if found.shape != (n, n):
        raise BenchError(f"wrong shape of the covariance: expected ({n}, {n}), got {found.shape}")
    if not np.isfinite(found).all() or (np.diag(found) < 0).any():
        raise BenchError("covariance: expected finite numbers and variances of at least 0")
    if np.abs(found).max() > MAX_COMPLIANCE:
        raise BenchError(f"covariance: expected at most {MAX_COMPLIANCE:g} in SI units, got a larger one")
    return (found + found.T) / 2


def half_widths(rows: Array, K: Array) -> Array:
    """Compute half widths of 95 % intervals of rows @ pi, where pi is normal.

    Args:
        rows: Rows, (..., n).
        K: Covariance of pi, (n, n).

    Returns:
        Half widths, (...).
    """
    z = quantile(np.inf, (1 + CONFIDENCE) / 2)
    return np.asarray(z * np.sqrt(((rows @ K) * rows).sum(axis=-1).clip(0)))
