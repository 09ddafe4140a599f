"""The trial store: finished trials in parts, a Parquet file per chunk, whatever stops the run.

A part is whole or absent after a kill, a crash or a full disk. A lock keeps a second run out. Trials come
back in the order of their seeds, however they came.
"""

import contextlib
import os
import shutil
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Generic, TypeVar

import pyarrow as pa
import pyarrow.compute as pc
from filelock import FileLock, Timeout

from testbench.errors import InputError
from testbench.runs.whole import folder_for, writing
from testbench.runs.experiment import TrialPlan, check_header
from testbench.runs.parquet import arrow_table, labelled, read_about, read_trials, write_trials
from testbench.runs.rows import SEED, Table, columns, restored

PARTS, WHOLE = "trials", "trials.parquet"
"""Folder with the trials of a run that is under way, and file of one that has come to its end."""
LOCK = ".lock"  #: File beside the parts, locked by the run that writes them.
HEADER, SEEDS = "testbench", "seeds"
"""Keys of a part's metadata: what the trials are of, and which they are."""

R = TypeVar("R")


def part_seeds(part: Path) -> list[int]:
    """Read which trials a part holds; InputError where it is none."""
    return [int(seed) for seed in read_about(part, SEEDS)[0]]


class TrialStore(Generic[R]):
    """The stored trials of an experiment. Open one with `open_store`."""

    def __init__(self, folder: Path, experiment: TrialPlan, row: type[R]) -> None:
        self.parts = folder / PARTS
        self.experiment = experiment
        self.row = row
        self.header = experiment.header
        self.columns = columns(row)
        self.schema = arrow_table(self.columns, []).schema
        self.done: set[int] = set()
        self.held = False  #: Whether there are trials that no finished run beside the parts has.
        self.finished = False

    @property
    def count(self) -> int:
        """Trials of the experiment that are stored."""
        return len(self.done)

    def missing(self) -> list[int]:
        """Seeds that are not stored, in order."""
        return [seed for seed in self.experiment.seeds if seed not in self.done]

    def rows(self) -> list[R]:
        """Stored rows as they were returned, in the order of the seeds."""
        return restored(self.row, self.table().drop_columns(SEED).to_pydict())

    def table(self) -> pa.Table:
        """Stored rows of the experiment, in the order of the seeds."""
        parts = [read_trials(path, self.schema) for path in self.parts.glob("*.parquet")]
        seeds, seed = self.experiment.seeds, pc.field(SEED)
        table = pa.concat_tables([self.schema.empty_table(), *parts])
        return table.filter((seed >= seeds[0]) & (seed <= seeds[-1])).sort_by(SEED)

    def append(self, seeds: Sequence[int], found: Iterable[Table]) -> None:
        """Add finished trials' rows, from `engine.do_chunk`; they are on the disk when this returns.

        Raises:
            BenchError: When rows are not of the store's type.
            InputError: When the part cannot be written; the store then holds what it held before.
        """
        self._write(seeds, arrow_table(self.columns, zip(seeds, found, strict=True)))
        self.held = True

    def load(self, *, resume: bool) -> None:
        """Find the trials of a run that was stopped or has ended; InputError where `open_store` says."""
        parts, whole = sorted(self.parts.glob("*.parquet")), self.parts.with_name(WHOLE)
        self.held = bool(parts)
        if parts:
            held = [seed for path in parts for seed in part_seeds(path)]
            if not resume:
                problem = f"holds {len(held)} trials of a run that was stopped: --resume goes on with them"
                afresh = "to start afresh, choose another folder or remove this one"
                raise InputError(self.parts, "", f"{problem}; {afresh}")
            check_header(self.parts, read_about(parts[0], HEADER)[0], self.header)
            self.done = set(held) & set(self.experiment.seeds)
        elif resume and os.path.lexists(whole):
            theirs, count = read_about(whole, HEADER, "trials")
            check_header(whole, theirs, self.header)
            self._write(range(theirs[SEED], theirs[SEED] + count), read_trials(whole, self.schema))

    def _write(self, seeds: Sequence[int], table: pa.Table) -> None:
        about = {HEADER: self.header, SEEDS: list(seeds)}
        write_trials(self.parts / f"{seeds[0]}.parquet", labelled(table, **about))
        self.done |= set(seeds) & set(self.experiment.seeds)


def write_parquet(store: TrialStore[R], folder: Path) -> Path:
    """Write `trials.parquet`, the same bytes in whatever order the trials came."""
    about = {HEADER: store.header, "trials": store.count}
    write_trials(folder / WHOLE, labelled(store.table(), **about))
    store.finished = store.count == len(store.experiment.seeds)
    return folder / WHOLE


@contextlib.contextmanager
def open_store(
    folder: Path, experiment: TrialPlan, *, row: type[R], resume: bool
) -> Iterator[TrialStore[R]]:
    """Open the trial store of a run's folder; once the block has ended well `trials.parquet` takes its place.

    To resume is to go on with the stored trials; without any it starts afresh.

    Raises:
        InputError: When another run writes it; when it cannot be written or is damaged; when it holds
            trials of something else (resume), or of a run that was stopped (no resume).
    """
    store = TrialStore(folder, experiment, row)
    with folder_for(store.parts), _locked(store.parts):
        try:
            store.load(resume=resume)
            yield store
            if store.finished and store.parts.with_name(WHOLE).exists():
                store.held = False
        finally:
            if not store.held:
                shutil.rmtree(store.parts, ignore_errors=True)


@contextlib.contextmanager
def _locked(parts: Path) -> Iterator[None]:
    """Keep other runs out of a folder.

    Raises:
        InputError: When one writes it.
    """
    lock = FileLock(parts / LOCK)
    with writing(parts):
        try:
            lock.acquire(timeout=0)
        except Timeout as err:
            problem = "another run is writing it: wait for it or choose another folder"
            raise InputError(parts, "", problem) from err
    try:
        yield
    finally:
        lock.release()
