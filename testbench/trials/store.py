"""The trial store: finished trials in a file that grows as they come, whatever stops the run.

A trial is whole or absent after a kill, a crash or a full disk; a lock of the kernel keeps a second run out;
trials come back in the order of their seeds, however they came. Each has a checksum of experiment, seed and
rows: edited numbers, swapped trials and those of another study are seen.
"""

import contextlib
import fcntl
import hashlib
import json
import os
import stat
import struct
import zlib
from array import array
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import BinaryIO, Generic, TypeVar

from testbench import files
from testbench.errors import BenchError, InputError
from testbench.output.manifest import read_manifest
from testbench.output.whole import folder_for, sync_names, writing
from testbench.trials.experiment import Experiment, check_header
from testbench.trials.rows import Table, check_types, columns, restorer

MAGIC = b"testbench trials 5\n"  #: Begins a file.
HEAD = struct.Struct(">qI32s")  #: Seed, length of what follows [byte], SHA-256.
HEADER = -1  #: In place of a seed: what the trials are of.
LONGEST = 2**24  #: Longest record, and text in it [byte]: a few packed ones could be of any length.
NONE = bytes(HEAD.size)  #: What some file systems leave at the end of a file after a crash.


def record(seed: int, data: bytes, sha256: bytes) -> bytes:
    """As it stands in the file."""
    return HEAD.pack(seed, len(data), sha256) + data


def records(file: BinaryIO) -> Iterator[tuple[int, int, bytes, bytes]]:
    """Place, seed, checksum and data of every whole record from here on; ValueError for what is none."""
    place = file.tell()
    while len(head := file.read(HEAD.size)) == HEAD.size and head != NONE:
        seed, size, sha256 = HEAD.unpack(head)
        if size > LONGEST:
            raise ValueError(f"a record of {size} bytes")
        if len(data := file.read(size)) < size:
            return
        yield place, seed, sha256, data
        place += HEAD.size + size


def read_at(file: int, place: int) -> bytes:
    """Data of the record at a place."""
    _, size, _ = HEAD.unpack(os.pread(file, HEAD.size, place))
    return os.pread(file, size, place + HEAD.size)


def stored_seeds(path: Path) -> list[int]:
    """Seeds of the trials in a file, perhaps of a run under way."""
    with path.open("rb") as file:
        file.seek(len(MAGIC))
        return [seed for _, seed, _, _ in records(file) if seed != HEADER]


def pack(table: Table) -> bytes:
    """Rows of a trial as bytes; BenchError when they are too many."""
    text = json.dumps(table, separators=(",", ":")).encode()
    if len(text) > LONGEST:
        raise BenchError(f"rows: expected at most {LONGEST} bytes of a trial, got {len(text)}")
    return zlib.compress(text)


def unpack(data: bytes) -> Table:
    """Rows of a trial; ValueError or RecursionError where the bytes are of something else."""
    opened = zlib.decompressobj()
    try:
        text = opened.decompress(data, LONGEST)
    except zlib.error as err:
        raise ValueError(f"packed rows: {err}") from err
    if not opened.eof or opened.unused_data:
        raise ValueError(f"packed rows: expected at most {LONGEST} bytes and no more behind them")
    found = json.loads(text.decode())
    if not isinstance(found, dict) or not all(isinstance(cells, list) for cells in found.values()):
        raise ValueError("packed rows: expected columns")
    return found


FILE, WHOLE = "trials.log", "trials.parquet"
"""Trials of a run that is under way, and of one that has come to its end."""
AWAY = "move it away to start afresh"

R = TypeVar("R")


class TrialStore(Generic[R]):
    """The stored trials of an experiment: eight bytes a trial in memory. Open one with `open_store`."""

    def __init__(self, path: Path, experiment: Experiment, row: type[R], file: int) -> None:
        self.path = path
        self.experiment = experiment
        self.row = row
        self.columns = columns(row)
        self.header = experiment.header
        self.finished = False
        self.held = 0  #: Trials in the file, perhaps more than are asked for.
        self.taken = 0  #: Those that a finished run beside it holds too.
        self._file, self._end = file, 0
        self._places = array("q", bytes(8 * len(experiment.seeds)))
        self._key = hashlib.sha256(json.dumps(self.header, sort_keys=True).encode())

    @property
    def count(self) -> int:
        """Trials of the experiment that are stored."""
        return len(self._places) - self._places.count(0)

    def missing(self) -> Iterator[int]:
        """Seeds that are not stored, in order."""
        return (seed for seed, place in zip(self.experiment.seeds, self._places, strict=True) if not place)

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
        with _told(self.path):
            for seed, place in zip(self.experiment.seeds, self._places, strict=True):
                if place:
                    yield seed, unpack(read_at(self._file, place))

    def append(self, seeds: Sequence[int], found: Iterable[Table]) -> None:
        """Add finished trials' rows, from `engine.do_chunk`; they are on the disk when this returns.

        Raises:
            BenchError: When rows are not of the store's type.
            InputError: When the file cannot be written; it then holds what it held before.
        """
        self._insert(zip(seeds, found, strict=True))

    def load(self, *, resume: bool) -> None:
        """Find the trials of a run that was stopped or has ended; InputError where `open_store` says."""
        with _told(self.path), open(self._file, "rb", closefd=False) as file:
            begins = file.read(len(MAGIC))
            if not MAGIC.startswith(begins):
                raise InputError(self.path, "", f"expected a store of trials of this version; {AWAY}")
            self._read(records(file) if begins == MAGIC else iter(()), resume=resume)
        with writing(self.path):
            os.ftruncate(self._file, self._end)  # what was cut short goes
            if not self.held:
                self._begin()
                whole = self.path.with_name(WHOLE)
                if resume and os.path.lexists(whole):
                    self._insert(self._of_whole(whole))
                self.taken = self.held

    def _read(self, found: Iterator[tuple[int, int, bytes, bytes]], *, resume: bool) -> None:
        """Places of the trials in the file; InputError where one is not as it was stored, by such a run."""
        first = next(found, None)
        if first is None:
            return
        place, seed, sha256, data = first
        if seed != HEADER or hashlib.sha256(data).digest() != sha256:
            raise ValueError("it has no header")
        if not isinstance(header := json.loads(data), dict):
            raise ValueError("its header is no table of keys")
        for place, seed, sha256, data in found:
            self.held += 1
            if resume and self.held == 1:
                check_header(self.path, header, self.header)
            if resume:
                if sha256 != self._sha256(seed, data):
                    problem = "expected what was stored, its checksum is of something else: it was edited or"
                    raise InputError(self.path, f"seed {seed}", f"{problem} is damaged; {AWAY}")
                self._check_rows(self.path, seed, unpack(data))
                self._mark(seed, place)
            self._end = place + len(record(seed, data, sha256))
        if self.held and not resume:
            problem = f"holds {self.held} trials of a run that was stopped: --resume goes on with it; choose"
            raise InputError(self.path, "", f"{problem} another folder, or remove the file, to start afresh")

    def _begin(self) -> None:
        """An empty file of this experiment."""
        header = json.dumps(self.header).encode()
        self._write(MAGIC + record(HEADER, header, hashlib.sha256(header).digest()))
        sync_names(self.path.parent)

    def _of_whole(self, whole: Path) -> Iterator[tuple[int, Table]]:
        """Trials of a run that has come to its end."""
        from testbench.trials.parquet import read_trials

        _check_plain(whole)
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
        """All of some trials, or none."""
        end, held = self._end, self.held
        try:
            for seed, table in trials:
                check_types(table, self.columns)
                rows, place = pack(table), self._end
                self._write(record(seed, rows, self._sha256(seed, rows)))
                self._mark(seed, place)
                self.held += 1
            with writing(self.path):
                os.fsync(self._file)
        except BaseException:
            os.ftruncate(self._file, end)
            self._end, self.held = end, held
            for k, place in enumerate(self._places):
                self._places[k] = 0 if place >= end else place
            raise

    def _write(self, data: bytes) -> None:
        with writing(self.path):
            start = self._end
            while self._end < start + len(data):
                self._end += os.pwrite(self._file, data[self._end - start :], self._end)

    def _mark(self, seed: int, place: int) -> None:
        if seed in self.experiment.seeds:
            self._places[seed - self.experiment.seeds[0]] = place


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
    with folder_for(folder):
        made = not os.path.lexists(path)
        with _opened(path) as file:
            store = None
            try:
                store = TrialStore(path, experiment, row, file)
                store.load(resume=resume)
                made = True
                yield store
                if store.finished and path.with_name(WHOLE).exists():
                    store.taken = store.held
            finally:
                if made and (store is None or store.held <= store.taken):
                    path.unlink(missing_ok=True)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[int]:
    """The file, locked; made where there is none.

    Raises:
        InputError: When something else stands there, which is left as it is; when another run writes it, or
            it cannot be written.
    """
    if os.path.lexists(path):
        _check_plain(path)
    with writing(path):
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o666)
    try:
        with writing(path):
            status, ours = os.fstat(file), _locked(file)
            ours = ours and os.path.lexists(path) and os.path.samestat(status, path.lstat())
        if not ours:
            problem = "another run is writing it: wait for it or choose another folder"
            raise InputError(path, "", problem)
        if status.st_nlink > 1:
            raise InputError(path, "", f"has {status.st_nlink} names (hard links), expected one; {AWAY}")
        yield file
    finally:
        os.close(file)


def _locked(file: int) -> bool:
    """Whether an open file is ours from now on; so it is where there are no locks."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True


def _check_plain(path: Path) -> None:
    """Refuse a link, a folder and a device."""
    if not stat.S_ISREG(path.lstat().st_mode):
        raise InputError(path, "", f"expected a file, got a link, a folder or a device; {AWAY}")


@contextlib.contextmanager
def _told(path: Path) -> Iterator[None]:
    """What is stored and no trial is told."""
    try:
        yield
    except OSError as err:
        raise InputError(path, "", f"cannot be read: {err.strerror}") from err
    except (ValueError, RecursionError) as err:  # JSON that is too deep
        raise InputError(path, "", f"expected a store of trials: {err}: it is damaged; {AWAY}") from err
