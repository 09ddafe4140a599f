"""A trial: every task of a seed, with the prior and without, given to all entries and to the default."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from io import StringIO
from typing import Annotated

import numpy as np
import typer

from testbench.arm.folder import find_arm
from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError
from testbench.files.write import csv_text
from testbench.identify.estimate import Constraint, deflections, is_conservative, score
from testbench.identify.posterior import CONFIDENCE, quantile
from testbench.identify.prior import Prior
from testbench.runs.spread import Number, Share
from testbench.studies.bench.tasks import DEFAULT, TASKS, BenchProblem, observation_of, problem, read_entries
from testbench.studies.campaign.trial import LEARNS, Cover, cover, covers
from testbench.workflows.cell import build_cell
from testbench.workflows.evaluation import without_compliances
from testbench.workflows.model_selection import with_priors
from testbench.workflows.models import named_models
from testbench.workflows.own_estimator import (
    MAX_COMPLIANCE,
    LimitOptions,
    check_reach,
    check_unchanged,
    parameters_of,
)
from testbench.workflows.own_process import EstimatorSource, call_estimator
from testbench.workflows.rows import FAILED, MM, NO_ERRORS, DatasetRow, ErrorRow, dataset_row, error_row

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
