"""The bench: which estimator predicts best, task by task: ratios of errors with intervals, ranks.

Tasks of the bench as data, the entries, and a trial: every task of a seed, given to all entries.

A task never changes under its version. Poses, loads, the true arm, what disturbs it, the noise and the errors
of the prior come of the seed. Entries are files with a function `estimate`, among them those that stand in
every table; each is tried with the prior and without, beside the default.
"""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from io import StringIO
from itertools import product
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from scipy.stats import rankdata

from testbench.arm.folder import PACKAGE_FOLDER, find_arm
from testbench.data.dataset import Dataset, select_rows
from testbench.errors import Array, BenchError
from testbench.files.write import csv_text
from testbench.identify.absolute.align import residuals
from testbench.identify.absolute.evidence import (
    apply_step,
    back_substitute,
    compliance_equations,
    triangular_factor_with_priors,
)
from testbench.identify.absolute.fit import CalibrationOptions, linearise_readings, select_and_solve
from testbench.identify.absolute.posterior import fit_frame_and_mount
from testbench.identify.base_frame import register_dataset
from testbench.identify.estimate import Constraint, deflections, is_conservative, score
from testbench.identify.posterior import CONFIDENCE, student_quantile
from testbench.identify.prior import Prior, cad_prior
from testbench.identify.regression import Regression
from testbench.model.structure import Structure, all153
from testbench.model.vjm import evaluate_chain, marker_positions, observation_matrix
from testbench.plant.disturbance import Disturbances
from testbench.report.badge import MIN_PAIRS, Badge
from testbench.report.colours import look_of
from testbench.report.figure import Figure, forest
from testbench.report.figures_fit import cost_figure
from testbench.report.markdown import Markdown
from testbench.report.report import Report, say
from testbench.report.schema import Table, columns
from testbench.report.table import Row, Trials, number
from testbench.runs.rows import trial_rng
from testbench.runs.spread import MIN_PERCENTILE_TRIALS, TAIL, Number, Share, redrawn, spread
from testbench.studies.absolute.real import LINKS, SPRINGS, read
from testbench.studies.campaign.model_error import ALL, disturbances, disturbed
from testbench.studies.campaign.report import dataset
from testbench.studies.campaign.trial import LEARNS, Cover, cover, covers, reread
from testbench.studies.campaigns import seeds_of
from testbench.studies.run import READ, headline
from testbench.studies.study import Study
from testbench.workflows.absolute import FRAME_POSES, evenly_spaced_rows
from testbench.workflows.absolute_campaign import by_trackers
from testbench.workflows.campaign import (
    FullPose,
    Scenario,
    draw_poses,
    simulate_at,
    simulate_full_pose,
    true_cell,
)
from testbench.workflows.cell import Cell, build_cell
from testbench.workflows.model_names import in_words
from testbench.workflows.models import named_models, prior_of, with_priors, without_compliances
from testbench.workflows.own_estimator import (
    MAX_COMPLIANCE,
    SUFFIX,
    EstimatorSource,
    LimitOptions,
    Limits,
    Models,
    call_estimator,
    check_reach,
    check_unchanged,
    parameters_of,
    read_estimators,
)
from testbench.workflows.plan_input import Place
from testbench.workflows.rows import FAILED, MM, NO_ERRORS, DatasetRow, ErrorRow, dataset_row, error_row

# --- Tasks of the bench as data, the entries, and a trial: every task of a seed, given to all entries -------

DEFAULT = "default"  #: What identify does by default, with the class's prior.
JOINTS = "joints"
FLOORS = (JOINTS, "least-squares", "ridge", "prior")
"""Files of `entries/` that stand in every table: to be worse is to be of no use."""
FOLDERS = (PACKAGE_FOLDER / "entries", PACKAGE_FOLDER.parent / "entries")
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

ELASTIC = CalibrationOptions(used_errors=frozenset({SPRINGS, LINKS}))
"""What explains the UR10 beside geometry."""
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
    "ur10": Task("a real UR10's own weight, poses of series C, judged on series A", 200, arm=REAL, version=2),
    "wrong-prior": Task("a prior that is partly wrong, 12 poses", 12, priors=WRONG),
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
        registered = register_dataset(cell.vjm, data, "tracker")
        true, data = replace(true, vjm=registered.vjm), registered.data
    rows = _observation_of(true, truth)
    return BenchProblem(
        true, data, prior_of(cell, prior, seed), own, truth.deflection, lambda pi: rows @ pi, truth
    )


def _real(task: Task, cell: Cell, seed: int) -> BenchProblem:
    """Random poses of series C train, every sixth of A judges; geometry and frames follow compliances."""
    _, (a, c) = read(1)
    train, prior = select_rows(c, trial_rng(seed).permutation(c.n_rows)[: task.poses]), cad_prior(cell.arm)
    linearised_readings = linearise_readings(cell.vjm, (train,), prior, ELASTIC)
    known = select_and_solve(linearised_readings, ELASTIC)
    assert known.active_unknowns.compliance_prior
    T = triangular_factor_with_priors(
        known.active_unknowns, linearised_readings.reduced_readings, known.selection.error_scales
    )
    judge = select_rows(a, np.arange(0, a.n_rows, 6))
    register = evenly_spaced_rows(judge, FRAME_POSES)
    rest = select_rows(judge, np.setdiff1d(np.arange(judge.n_rows), register))

    def off(pi: Array) -> Array:
        state = apply_step(linearised_readings.state, known.active_unknowns, back_substitute(T, pi))
        placed = fit_frame_and_mount(replace(known, state=state).model(), judge, register)
        return -residuals(placed.state, rest)[:1].transpose(2, 0, 1)

    data = compliance_equations(
        T, known.active_unknowns.compliance_prior, int(linearised_readings.reduced_readings.n_equations.sum())
    )
    return BenchProblem(cell, data, prior, REAL, np.zeros((rest.n_rows, 1, 3)), off)


def _observation_of(cell: Cell, truth: Dataset) -> Array:
    """Compute how parameters of all links and joints move targets.

    Args:
        cell: The arm with its model and its truth.
        truth: True deflections.

    Returns:
        Rows of the observation matrix, (runs, m, 3, n).
    """
    where, points = evaluate_chain(cell.vjm, truth.q), marker_positions(cell.vjm, truth.markers)
    return observation_matrix(where, all153(cell.arm), truth.wrench, truth.point, points)


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
    share: Array = np.array(task.loads)[np.arange(runs.n_runs) % len(task.loads)]
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
        typer.Argument(metavar="ENTRY.py...", help="Files with a function estimate (docs/own_estimator.md)."),
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


def _settings(options: BenchOptions, quick: bool, seeds: range) -> BenchSettings:
    """Make the settings of the flags; raises BenchError for a task or an entry that there is not."""
    names = tuple(dict.fromkeys(options.task or TASKS))
    for name in names:
        if name not in TASKS:
            raise BenchError(f"--task: expected some of {', '.join(TASKS)}, got {name!r}")
    names = names[:2] if quick and not options.task else names
    estimator_sources = read_entries(options.entries or (), options.limits)
    return BenchSettings(names, tuple(TASKS[name].version for name in names), estimator_sources, seeds[0])


def _cells(asked: BenchSettings) -> dict[str, Cell]:
    """Build the arms of all tasks, by name; BenchError where an entry's file has changed."""
    check_unchanged(asked.own)
    return {arm: build_cell(find_arm(arm)) for arm in {TASKS[name].arm for name in asked.tasks}}


def _trial(arms: Mapping[str, Cell], asked: BenchSettings, seed: int, _: Models) -> list[EntryRow]:
    """Make the rows of a seed, one per answer."""
    made = [problem(TASKS[name], arms[TASKS[name].arm], seed) for name in asked.tasks]
    rows = [row for name, own in zip(asked.tasks, made, strict=True) for row in _task(name, own, asked.own)]
    return [_with_data(rows[0], made[0]), *rows[1:]] if seed == asked.first else rows


def _with_data(row: EntryRow, own: BenchProblem) -> EntryRow:
    """The same with what was given."""
    if isinstance(own.data, Dataset):
        return replace(row, measured=dataset_row(own.data), data_file=csv_text(own.data, own.cell.arm))
    text = StringIO()
    np.savetxt(text, np.column_stack(own.data.weighted_equations), delimiter=",")
    return replace(row, data_file=text.getvalue())


def _task(task: str, own: BenchProblem, entries: Sequence[EstimatorSource]) -> Iterator[EntryRow]:
    """Rows of a task, those without a prior first."""
    size = MM * score(own.predict(np.zeros(own.structure.n_parameters)), own.true).rms
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
    half = half_widths(_observation_of(own.cell, own.truth), K) if own.truth and K is not None else None
    return replace(
        row,
        workspace=error_row(score(moved, own.true)),
        conservative=is_conservative(own.structure, own.structure.C_theta_of(pi)),
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
    z = student_quantile(np.inf, (1 + CONFIDENCE) / 2)
    return np.asarray(z * np.sqrt(((rows @ K) * rows).sum(axis=-1).clip(0)))


# --- The bench: which estimator predicts best, task by task: ratios of errors with intervals, ranks ---------

DECIMALS = 6  #: Of a logarithm of errors: entries nearer than that have one rank.
ERROR = "workspace.rms_mm"
Errors = Mapping[str, Array]  #: Of every entry, arm by arm, (arms,) [mm].


def _incumbent(prior: bool) -> str:
    """Name whom a class has to beat: the default of `identify`, without a prior Joints-only."""
    return DEFAULT if prior else JOINTS


def _begins(rows: Trials, words: str) -> Array:
    """Tell which rows have a status that begins with some words.

    Args:
        rows: Rows of the trials.
        words: First words of the status.

    Returns:
        True for such a row, (rows,).
    """
    return np.array([status.startswith(words) for status in rows["status"].tolist()], dtype=bool)


def errors(rows: Trials) -> dict[str, Array]:
    """Collect errors in one task and class, (arms,) [mm]; who fails errs by the whole deflection.

    To skip is to fail, but for who skips every arm: such entries are left out.
    """
    found = {}
    for (name,), group in rows.groups("name"):
        done = group["status"] == DONE
        if done.any() or not _begins(group, SKIPPED).all():
            found[name] = np.fmin(group[ERROR], group["deflection_mm"])
    return found


def overall(tasks: Sequence[Errors]) -> dict[str, Array]:
    """Compute geometric means over tasks of those that take part in all of them, (arms,) [mm]."""
    names = [name for name in tasks[0] if all(name in own for own in tasks)]
    return {name: np.exp(np.mean([np.log(own[name]) for own in tasks], axis=0)) for name in names}


def standings(found: Errors, rival: str) -> list[Row]:
    """Rank entries, the best first: errors over the rival's, rank, whether they are tied.

    Both by geometric means over the arms; intervals of 95 % by resampling arms.

    Args:
        found: Errors by entry.
        rival: Name of the rival.

    Returns:
        A row per entry.
    """
    names = list(found)
    L = np.log(np.array([found[name] for name in names])) - np.log(found[rival])
    arms = L.shape[1]
    drawn = redrawn(arms) @ L.T / arms  # (draws, names)
    ranks = rankdata(drawn.round(DECIMALS), method="min", axis=1)
    own = rankdata(L.mean(axis=1).round(DECIMALS), method="min")
    ends = np.exp(np.quantile(drawn, (TAIL, 1 - TAIL), axis=0))
    places = np.quantile(ranks, (TAIL, 1 - TAIL), axis=0, method="nearest")
    board: list[Row] = []
    for k in L.mean(axis=1).argsort(kind="stable").tolist():
        place, size = [int(own[k]), *places[:, k].astype(int).tolist()], float(np.exp(L[k].mean()))
        low, high = ends[:, k].tolist()
        row = Row(zip(("rank", "rank_low", "rank_high"), place, strict=True), name=names[k], trials=arms)
        row |= {"ratio": size, "ratio_low": low, "ratio_high": high}
        row |= {"tied": None if names[k] == rival else low <= 1 <= high, "over": spread(np.exp(L[k]))}
        shown = _with(*map("{:.3g}".format, (size, low, high)))
        row |= {"standing": _with(*map(str, place)), "over_default": shown}
        board.append(row)
    return board


def _with(value: str, low: str, high: str) -> str:
    """A number and its interval, where that has a width."""
    return f"{value} ({low} to {high})" if low != high else value


def _quantities(rows: Trials) -> Row:
    """Summarise what an entry did beside its ratio, over arms, or over arms and tasks."""
    done, failed = rows.where(status=DONE), int(_begins(rows, FAILED).sum() + _begins(rows, SKIPPED).sum())
    known = done.pick(np.isfinite(done["cover.covered_percent"].astype(float)))
    return Row(
        rms_mm=number(done[ERROR]) if len(done) else None,
        p95_mm=number(done["workspace.p95_mm"]) if len(done) else None,
        conservative=float(np.mean(done["conservative"].astype(bool))) if len(done) else None,
        covered_percent=float(known["cover.covered_percent"].mean()) if len(known) else None,
        half_mm=float(np.median(known["cover.half_mm"])) if len(known) else None,
        over_ideal=float(np.median(known["cover.half_mm"] / known["cover.ideal_mm"])) if len(known) else None,
        cpu_seconds=float(np.median(done["cpu_seconds"])) if len(done) else None,
        failed=f"{failed} of {len(rows)}" if failed else None,
    )


CLASSES = {True: "with prior", False: "without prior"}
BOARD = "name standing over_default tied conservative covered_percent over_ideal failed cpu_seconds"
SCORES = (
    "task given name standing over_default tied rms_mm p95_mm conservative covered_percent half_mm failed "
    "cpu_seconds"
)
SHORT = "name with_prior without_prior"


def _report(asked: BenchSettings, seeds: range, trials: Trials) -> Report:
    """Rank the entries over all tasks, and in each."""
    simulated = [name for name in asked.tasks if TASKS[name].arm != REAL] or asked.tasks
    boards = {words: _standings(trials, simulated, prior) for prior, words in CLASSES.items()}
    board = boards[CLASSES[True]]
    f = Row(
        seed=seeds_of(seeds),
        trials=len(seeds),
        tasks=[Row(task=name, **vars(TASKS[name])) for name in asked.tasks],
        dataset=dataset(trials),
        board=boards,
        scores=[
            Row(row, task=name, given=CLASSES[prior])
            for name, prior in product(asked.tasks, CLASSES)
            for row in _standings(trials, [name], prior)
        ],
        failures=_failures(trials),
        models=[Row(row, check=None, paper=None, workspace=Row(rms_mm=row.rms_mm)) for row in board],
    )
    best = next(row for row in board if row.name != DEFAULT)
    badge, tables = _badge(best, board, len(seeds)), _tables(f)
    failed: Counter[str] = Counter()
    for row in f.failures:
        failed[row.name] += row["count"]
    return Report(
        scenario=STUDY.name,
        question=Markdown("Which estimator predicts an arm's deflections best?"),
        title=say(
            "{tasks:counted task}, {trials:counted true arm} each; errors of deflection",
            tasks=len(f.tasks),
            trials=f.trials,
        ),
        answer=headline(badge, tables["with_prior"]),
        claims=[say("{name} failed {n:counted time}.", name=name, n=n) for name, n in failed.items()],
        numbers=f,
        tables=tables,
        body=[*tables, READ],
        badge=badge,
    )


def _badge(best: Row, board: Sequence[Row], arms: int) -> Badge:
    """The default beside the best of the others, by the numbers of the table."""
    low = best.ratio_low
    high = best.ratio_high
    names = (DEFAULT, best.name)
    factor = best.ratio
    ties = tuple(row.name for row in board if row.tied)
    if factor < 1:
        low, high, names, factor = 1 / high, 1 / low, names[::-1], 1 / factor
    if arms < MIN_PAIRS:
        return Badge(*names, factor, None, arms, "undecided", "arm")
    return Badge(*names, factor, (low, high), arms, "holds" if low > 1 else "tie", "arm", ties=ties)


def _errors(trials: Trials, tasks: Sequence[str], *, prior: bool) -> Errors:
    return overall([errors(trials.where(task=name, prior=prior)) for name in tasks])


def _standings(trials: Trials, tasks: Sequence[str], prior: bool) -> list[Row]:
    """The best first, over some tasks."""
    rows = trials.where(task=tuple(tasks), prior=prior)
    found = standings(_errors(trials, tasks, prior=prior), _incumbent(prior))
    return [_row(rows, row) for row in found]


def _row(rows: Trials, standing: Row) -> Row:
    trials = rows.where(name=standing.name)
    looked = {key: trials[key].tolist()[0] for key in ("structure", "constraint", "prior")}
    return Row(standing, **_quantities(trials), **looked)


def _failures(trials: Trials) -> list[Row]:
    """Every way in which an entry failed, and how often."""
    lost = trials.pick(_begins(trials, FAILED))
    keys = zip(*(lost[key].tolist() for key in ("name", "prior", "status")), strict=True)
    return [
        Row(name=name, given=CLASSES[bool(prior)], status=status, count=n)
        for (name, prior, status), n in Counter(keys).items()
    ]


def _tables(f: Row) -> dict[str, Table]:
    board, plain = (f.board[words] for words in CLASSES.values())
    every = {row.name: Row(row, with_prior=None, without_prior=None) for row in [*board, *plain]}
    for key, rows in (("with_prior", board), ("without_prior", plain)):
        for row in rows:
            every[row.name] |= {key: row.over_default}
    title = f"Error divided by the incumbent's: the default with prior, {JOINTS} without prior"
    return {
        "short": Table(columns(SHORT), [*every.values()], title),
        "with_prior": Table(columns(BOARD), board, "all tasks, with prior", headline="over_default"),
        "without_prior": Table(columns(BOARD), plain, "all tasks, without prior", headline="over_default"),
        "scores": Table(columns(SCORES), f.scores, "task by task", headline="over_default"),
        "tasks": Table(columns("task version poses what"), f.tasks, "tasks"),
        "failures": Table(columns("name given status count"), f.failures, "failures"),
    }


def _figures(found: Report) -> Mapping[str, Figure]:
    """Draw the ratios arm by arm."""
    f = Row(found.numbers)
    board = f.board[CLASSES[True]]
    table = found.led(Table(columns("name over"), board))
    words = "Error over that of the default, arm by arm over all tasks; dotted: the default."
    known = {row.name: look_of(row) for row in board}
    return {
        "bench.png": forest(table, {"over": "all simulated tasks, with prior"}, found.title, words, 1.0),
        "time.png": cost_figure(board, known, f"error over that of {in_words(DEFAULT)}"),
    }


STUDY = Study(
    name="bench",
    about="Rank your estimators beside others, and the default of identify, in frozen tasks.",
    options=BenchOptions,
    settings=_settings,
    seeds=(MIN_PERCENTILE_TRIALS, 2),
    row=EntryRow,
    trial=_trial,
    shared=_cells,
    report=_report,
    printed=("short",),
    figures=_figures,
    arms=lambda settings: [
        find_arm(arm) for arm in dict.fromkeys(TASKS[name].arm for name in settings.tasks)
    ],
    size=2,
    own=lambda settings: settings.own,
)
