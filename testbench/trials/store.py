"""The trial store: finished trials in an SQLite file, committed as they come, whatever stops the run.

SQLite is what makes a trial whole or absent after a kill, a crash or a full disk, keeps a second run out and
gives trials back in the order of their seeds, however they came. Each has a checksum of its experiment, its
seed and its rows: edited numbers, swapped trials and those of another study are seen.
"""

import contextlib
import hashlib
import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Generic, TypeVar

from testbench import files
from testbench.errors import BenchError, InputError
from testbench.output.manifest import read_manifest
from testbench.output.scratch import folder_for, sweep, writing
from testbench.trials.experiment import Experiment, check_header
from testbench.trials.packed import pack, unpack
from testbench.trials.rows import SEED, Table, check_types, columns, restorer
from testbench.trials.storefile import AWAY, check_plain, open_file, remove_file, told

FILE, WHOLE = "trials.sqlite", "trials.parquet"
"""Trials of a run that is under way, and of one that has come to its end."""

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
        self.taken = 0  #: Trials that a finished run beside it holds too.
        self._database = database
        self._done = bytearray(len(experiment.seeds))
        self._key = hashlib.sha256(json.dumps(self.header, sort_keys=True).encode())

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
        for seed, table in self.tables():
            try:
                yield seed, restore(table)
            except BenchError as err:
                raise InputError(self.path, f"seed {seed}", str(err)) from err

    def tables(self) -> Iterator[tuple[int, Table]]:
        """Stored trials in the order of the seeds, one at a time in memory: seed and rows by column."""
        query = "SELECT seed, CAST(rows AS BLOB) FROM trials WHERE seed BETWEEN ? AND ? ORDER BY seed"
        with _told(self.path):
            for seed, rows in self._database.execute(query, (self.header[SEED], self.experiment.seeds[-1])):
                yield seed, unpack(rows)

    def append(self, seeds: Sequence[int], found: Iterable[Table]) -> None:
        """Add finished trials' rows, from `chunk.do_chunk`; they are on the disk when this returns.

        Raises:
            BenchError: When rows are not of the store's type.
            InputError: When the file cannot be written; it then holds what it held before.
        """
        self._insert(zip(seeds, found, strict=True))
        self._mark(seeds)

    def load(self, *, resume: bool) -> None:
        """Find the trials of a run that was stopped or has ended; InputError where `open_store` says."""
        with _told(self.path):
            [(header,)] = self._database.execute("SELECT header FROM about").fetchmany(2)
            ((held,),) = self._database.execute("SELECT count(*) FROM trials")
            if not isinstance(header, str) or not isinstance(found := json.loads(header), dict):
                raise ValueError("its header is no table of keys")
        if held and not resume:
            raise InputError(
                self.path,
                "",
                f"holds {held} trials of a run that was stopped: --resume goes on with it; choose another "
                "folder, or remove the file, to start afresh",
            )
        if held:
            check_header(self.path, found, self.header)
            self._mark(self._verified())
            return
        whole = self.path.with_name(WHOLE)
        if resume and os.path.lexists(whole):
            self._insert(self._of_whole(whole))
        with _told(self.path), self._database:
            self._database.execute("UPDATE about SET header = ?", (json.dumps(self.header),))
            self._mark(seed for (seed,) in self._database.execute("SELECT seed FROM trials"))
        self.taken = self.count

    def _verified(self) -> Iterator[int]:
        """Seeds of the stored trials; InputError where one is not as it was stored, by a run of this kind."""
        with _told(self.path):
            query = "SELECT seed, CAST(rows AS BLOB), sha256 FROM trials"
            for seed, rows, sha256 in self._database.execute(query):
                if not isinstance(rows, bytes) or sha256 != self._sha256(seed, rows):
                    problem = "expected what was stored, its checksum is of something else: it was edited or"
                    raise InputError(self.path, f"seed {seed}", f"{problem} is damaged; {AWAY}")
                self._check_rows(self.path, seed, unpack(rows))
                yield seed

    def _of_whole(self, whole: Path) -> Iterator[tuple[int, Table]]:
        """Trials of a run that has come to its end."""
        from testbench.trials.parquet import read_trials

        check_plain(whole)
        wanted = read_manifest(whole.parent).sha256.get(WHOLE)
        if wanted is not None and files.digest(whole) != wanted:
            problem = "expected what its run left, by manifest.json: it was edited or is damaged"
            raise InputError(whole, "", f"{problem}; {AWAY}")
        for seed, rows in read_trials(whole, self.header):
            if seed not in self.experiment.seeds:
                return  # they rise from its first one
            self._check_rows(whole, seed, rows)
            yield seed, rows

    def _check_rows(self, path: Path, seed: int, table: Table) -> None:
        """Refuse what are no rows of this study."""
        try:
            check_types(table, self.columns)
        except BenchError as err:
            raise InputError(path, f"seed {seed}", str(err)) from err

    def _sha256(self, seed: int, rows: bytes) -> bytes:
        """Of a trial of this experiment."""
        own = self._key.copy()
        own.update(f"{seed} ".encode() + rows)
        return own.digest()

    def _insert(self, trials: Iterable[tuple[int, Table]]) -> None:
        with _told(self.path), self._database as transaction:
            lines = ((seed, rows, self._sha256(seed, rows)) for seed, rows in self._packed(trials))
            transaction.executemany("INSERT OR REPLACE INTO trials VALUES (?, ?, ?)", lines)

    def _packed(self, trials: Iterable[tuple[int, Table]]) -> Iterator[tuple[int, bytes]]:
        for seed, table in trials:
            check_types(table, self.columns)
            yield seed, pack(table)

    def _mark(self, seeds: Iterable[int]) -> None:
        for seed in seeds:
            if seed in self.experiment.seeds:
                self._done[seed - self.experiment.seeds[0]] = 1


def write_parquet(store: TrialStore[R], folder: Path) -> Path:
    """Write `trials.parquet`, the same bytes in whatever order the trials came; `parquet.write_trials`."""
    from testbench.trials.parquet import write_trials  # Arrow takes 0.2 s, which no worker should spend

    write_trials(folder / WHOLE, store.header, store.columns, store.count, store.tables())
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
    with contextlib.ExitStack() as stack:
        stack.enter_context(folder_for(folder))
        with writing(path):
            sweep(folder)
        database = stack.enter_context(contextlib.closing(open_file(path)))
        store = None
        try:
            store = TrialStore(path, experiment, row, database)
            store.load(resume=resume)
            yield store
            if store.finished and path.with_name(WHOLE).exists():
                remove_file(path)
        finally:
            with contextlib.suppress(sqlite3.Error):  # a damaged one stays
                ((held,),) = database.execute("SELECT count(*) FROM trials")
                if held <= (store.taken if store else 0):
                    remove_file(path)


@contextlib.contextmanager
def _told(path: Path) -> Iterator[None]:
    """What SQLite's failures mean."""
    try:
        yield
    except (sqlite3.Error, ValueError, RecursionError) as err:  # JSON that is too deep
        raise told(path, err) from err
