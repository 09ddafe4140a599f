"""The trial store: finished trials in an SQLite file, committed as they come, whatever stops the run.

SQLite is what makes a trial whole or absent after a kill, a crash or a full disk, keeps a second run out and
gives trials back in the order of their seeds, however they came.
"""

import contextlib
import json
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Generic, TypeVar

from testbench.errors import BenchError, InputError
from testbench.output.scratch import folder_for
from testbench.trials.experiment import Experiment, check_header
from testbench.trials.rows import Flat, check_types, columns, restorer

FILE, WHOLE = "trials.sqlite", "trials.parquet"
"""Trials of a run that is under way, and of one that has come to its end."""
TABLES = (
    "CREATE TABLE about (header TEXT)",
    "INSERT INTO about VALUES ('{}')",
    "CREATE TABLE trials (seed INTEGER PRIMARY KEY, rows TEXT)",
)
FAULTS = {
    "SQLITE_BUSY": "another run is writing it: wait for it or choose another folder",
    "SQLITE_FULL": "cannot be written: the disk is full",
    "SQLITE_IOERR": "cannot be written",
    "SQLITE_CANTOPEN": "cannot be written",
    "SQLITE_READONLY": "cannot be written",
}

R = TypeVar("R")


class TrialStore(Generic[R]):
    """The stored trials of an experiment: a byte a trial in memory. Open one with `open_store`."""

    def __init__(
        self, path: Path, experiment: Experiment, row: type[R], database: sqlite3.Connection
    ) -> None:
        self.path = path
        self.experiment = experiment
        self.row = row
        self.columns = columns(row)
        self.header = experiment.header
        self.finished = False
        self._database = database
        self._done = bytearray(len(experiment.seeds))

    @property
    def count(self) -> int:
        """Trials of the experiment that are stored."""
        return self._done.count(1)

    def missing(self) -> Iterator[int]:
        """Seeds that are not stored, in order."""
        return (seed for seed, done in zip(self.experiment.seeds, self._done, strict=True) if not done)

    def trials(self) -> Iterator[tuple[int, tuple[R, ...]]]:
        """Stored trials in the order of the seeds: seed, and its rows as they were returned."""
        restore = restorer(self.row)
        for seed, rows in self.flat():
            try:
                yield seed, tuple(map(restore, rows))
            except BenchError as err:
                raise InputError(self.path, f"seed {seed}", str(err)) from err

    def flat(self) -> Iterator[tuple[int, list[Flat]]]:
        """Stored trials in the order of the seeds, one at a time in memory: seed and flat rows."""
        query = "SELECT seed, rows FROM trials WHERE seed <= ? ORDER BY seed"
        with _told(self.path):
            for seed, rows in self._database.execute(query, (self.experiment.seeds[-1],)):
                yield seed, json.loads(rows)

    def append(self, seeds: Sequence[int], found: Iterable[list[Flat]]) -> None:
        """Add finished trials' flat rows, from `chunk.do_chunk`; they are on the disk when this returns.

        Raises:
            BenchError: When rows are not of the store's type.
            InputError: When the file cannot be written; it then holds what it held before.
        """
        self._insert(zip(seeds, found, strict=True))
        self._mark(seeds)

    def load(self, *, resume: bool) -> None:
        """Find the trials of a run that was stopped or has ended; InputError where `open_store` says."""
        with _told(self.path):
            ((header,),) = self._database.execute("SELECT header FROM about")
            ((held,),) = self._database.execute("SELECT count(*) FROM trials")
            found = json.loads(header)
        if held and not resume:
            raise InputError(
                self.path,
                "",
                f"holds {held} trials of a run that was stopped: --resume goes on with it; choose another "
                "folder, or remove the file, to start afresh",
            )
        if held:
            check_header(self.path, found, self.header)
        elif resume and (whole := self.path.with_name(WHOLE)).exists():
            from testbench.trials.parquet import read_trials

            self._insert(read_trials(whole, self.header))
        with _told(self.path), self._database:
            self._database.execute("UPDATE about SET header = ?", (json.dumps(self.header),))
            self._mark(seed for (seed,) in self._database.execute("SELECT seed FROM trials"))

    def _insert(self, trials: Iterable[tuple[int, list[Flat]]]) -> None:
        with _told(self.path), self._database as transaction:
            lines = ((seed, json.dumps(self._checked(rows))) for seed, rows in trials)
            transaction.executemany("INSERT OR REPLACE INTO trials VALUES (?, ?)", lines)

    def _checked(self, rows: list[Flat]) -> list[Flat]:
        for row in rows:
            check_types(row, self.columns)
        return rows

    def _mark(self, seeds: Iterable[int]) -> None:
        for seed in seeds:
            if seed in self.experiment.seeds:
                self._done[seed - self.experiment.seeds[0]] = 1


def write_parquet(store: TrialStore[R], folder: Path) -> Path:
    """Write `trials.parquet`, the same bytes in whatever order the trials came; `parquet.write_trials`."""
    from testbench.trials.parquet import write_trials  # Arrow takes 0.2 s, which no worker should spend

    write_trials(folder / WHOLE, store.header, store.columns, store.count, store.flat())
    store.finished = store.count == len(store.experiment.seeds)
    return folder / WHOLE


@contextlib.contextmanager
def open_store(
    folder: Path, experiment: Experiment, *, row: type[R], resume: bool
) -> Iterator[TrialStore[R]]:
    """The trial store of a run's folder; once the block has ended well `trials.parquet` takes its place.

    To resume is to go on with the stored trials; without any it starts afresh.

    Raises:
        InputError: When another run writes it; when it cannot be written or is damaged; when it holds
            trials of something else (resume), or of a run that was stopped (no resume).
    """
    path = folder / FILE
    with folder_for(folder), contextlib.closing(_locked(path)) as database:
        try:
            store = TrialStore(path, experiment, row, database)
            store.load(resume=resume)
            yield store
            if store.finished and path.with_name(WHOLE).exists():
                path.unlink()
        finally:
            with contextlib.suppress(sqlite3.Error):  # a damaged one stays
                if database.execute("SELECT count(*) FROM trials").fetchone() == (0,):
                    path.unlink()


def _locked(path: Path) -> sqlite3.Connection:
    if path.exists() and not path.is_file():
        raise InputError(path, "", "expected a file, got a folder or a device")
    with _told(path):
        new, database = not path.exists(), sqlite3.connect(path, timeout=0)
        try:
            database.execute("PRAGMA locking_mode=EXCLUSIVE")
            with database:
                database.execute("BEGIN EXCLUSIVE")
                if database.execute("SELECT count(*) FROM sqlite_master").fetchone() == (0,):
                    for statement in TABLES:
                        database.execute(statement)
        except sqlite3.Error:
            database.close()
            if new and path.exists() and not path.stat().st_size:
                path.unlink()
            raise
    return database


@contextlib.contextmanager
def _told(path: Path) -> Iterator[None]:
    """What SQLite's failures mean."""
    try:
        yield
    except (sqlite3.Error, ValueError) as err:
        name = getattr(err, "sqlite_errorname", "")
        for fault, words in FAULTS.items():
            if name.startswith(fault):
                raise InputError(path, "", words) from err
        raise InputError(
            path, "", f"expected a store of trials: {err}: it is damaged; move it away to start afresh"
        ) from err
