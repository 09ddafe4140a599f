"""The trial store: finished trials in `trials.parts` beside a run's results, whatever stops the run."""

import contextlib
import fcntl
import os
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar

from testbench.errors import BenchError, InputError
from testbench.trials.experiment import Experiment
from testbench.trials.rows import Value, restorer

if TYPE_CHECKING:  # Arrow takes 0.2 s to import, which no worker should spend
    from testbench.trials.parts import Parts

FOLDER, LOCK = "trials.parts", "lock"
LATEST = 1.0
"""Time after which a finished trial is on the disk, when trials come fast [s]."""
SHARE = 20
"""A part is written once that many times the time passed that the last one took."""

R = TypeVar("R")
Flat = Sequence[dict[str, Value]]


class TrialStore(Generic[R]):
    """The stored trials of an experiment: a byte a trial in memory, and a second of new ones.

    Open one with `open_store`.

    Args:
        experiment: What is tried.
        row: Dataclass of the rows.
        parts: What is on the disk.
    """

    def __init__(self, experiment: Experiment, row: type[R], parts: "Parts") -> None:
        self.experiment = experiment
        self.row = row
        self.parts = parts
        self._fresh: list[tuple[int, list[dict[str, Value]]]] = []
        self._due = -float("inf")
        self._done = bytearray(len(experiment.seeds))
        self._mark(parts.seeds(), True)

    @property
    def count(self) -> int:
        """Trials of the experiment that are stored."""
        return self._done.count(1)

    def missing(self) -> Iterator[int]:
        """Seeds that are not stored, in order."""
        return (seed for seed, done in zip(self.experiment.seeds, self._done, strict=True) if not done)

    def trials(self) -> Iterator[tuple[int, tuple[R, ...]]]:
        """Stored trials in the order of the seeds: seed, and its rows as they were returned."""
        self.flush()
        restore = restorer(self.row)
        for seed, rows in self.parts.trials():
            if seed in self.experiment.seeds:
                yield seed, tuple(map(restore, rows))

    def append(self, seeds: Sequence[int], found: Sequence[Flat]) -> None:
        """Add finished trials; within about a second they are on the disk.

        Args:
            seeds: Of the trials, not stored yet.
            found: Their flat rows, from `chunk.do_chunk`.

        Raises:
            BenchError: When rows are not of the store's type.
            InputError: When they cannot be written; what was on the disk stays.
        """
        self._fresh += [(seed, list(rows)) for seed, rows in zip(seeds, found, strict=True)]
        self._mark(seeds, True)
        if time.monotonic() >= self._due:
            self.flush()

    def flush(self) -> None:
        """Put on the disk what is not there yet; `append` says what it raises."""
        if not self._fresh:
            return
        start = time.monotonic()
        try:
            self.parts.add(self._fresh)
        except BenchError:
            self._mark((seed for seed, _ in self._fresh), False)
            self._fresh = []
            raise
        self._fresh = []
        end = time.monotonic()
        self._due = end + min(LATEST, SHARE * (end - start))

    def _mark(self, seeds: Iterable[int], done: bool) -> None:
        for seed in seeds:
            if seed in self.experiment.seeds:
                self._done[seed - self.experiment.seeds[0]] = done


def write_parquet(store: TrialStore[R], folder: Path) -> Path:
    """Write `trials.parquet`: rows in the order of their seeds, the same bytes in whatever order they came.

    None becomes null; NaN stays NaN. The header of the experiment is the metadata "testbench".

    Args:
        store: The trials, all of them.
        folder: Where to.

    Returns:
        The file.

    Raises:
        BenchError: When trials are missing.
        InputError: When the file cannot be written; an earlier one then stands.
    """
    store.flush()
    if store.count < len(store.experiment.seeds):
        raise BenchError(f"trials: expected all {len(store.experiment.seeds)} stored, got {store.count}")
    return store.parts.write_whole(folder, store.experiment.seeds)


@contextlib.contextmanager
def open_store(
    folder: Path, experiment: Experiment, *, row: type[R], resume: bool
) -> Iterator[TrialStore[R]]:
    """The trial store of a run's folder; its parts go once the block has ended well and left the whole file.

    Args:
        folder: The run's; made where it does not exist.
        experiment: What is tried.
        row: Dataclass of the rows; see `rows.columns`.
        resume: Whether to go on with the stored trials; without any it starts afresh.

    Raises:
        InputError: When another run writes it; when it cannot be written or is damaged; when it holds
            trials of something else (resume), or of a run that was stopped (no resume).
    """
    from testbench.trials.parquet import Table
    from testbench.trials.parts import Parts

    parts = Parts(folder / FOLDER, Table.of(experiment.header, row))
    with _locked(folder):
        if resume:
            parts.load()
        else:
            _refuse_unfinished(parts.folder)
        store = TrialStore(experiment, row, parts)
        try:
            yield store
        finally:
            store.flush()
        if store.count == len(experiment.seeds):
            parts.clear(experiment.seeds)


def _refuse_unfinished(folder: Path) -> None:
    from testbench.trials.parquet import read_part

    if held := sum(read_part(path).count for path in folder.glob("*.parquet")):
        raise InputError(
            folder,
            "",
            f"holds {held} trials of a run that was stopped: --resume goes on with it; choose another "
            "folder, or remove this one, to start afresh",
        )


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """One run at a time; without a part it leaves nothing behind."""
    fresh, parts = not folder.exists(), folder / FOLDER
    lock = parts / LOCK
    try:
        parts.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError as err:
        raise InputError(parts, "", f"cannot be written: {err.strerror}") from err
    try:
        _claim(lock, descriptor)
        try:
            yield
        finally:
            _tidy(parts)
    finally:
        os.close(descriptor)
        if fresh and not any(folder.iterdir()):
            folder.rmdir()


def _claim(lock: Path, descriptor: int) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        ours = lock.exists() and os.path.samestat(lock.stat(), os.fstat(descriptor))
    except BlockingIOError:
        ours = False
    if not ours:  # locked, or removed by the one that had locked it
        raise InputError(lock.parent, "", "another run is writing it: wait for it or choose another folder")


def _tidy(parts: Path) -> None:
    """Without a part nothing is left behind, unless it is not ours."""
    for torn in parts.glob(".*.parquet.new"):  # of a run that was killed
        torn.unlink()
    if not any(parts.glob("*.parquet")):
        (parts / LOCK).unlink()
        with contextlib.suppress(OSError):
            parts.rmdir()
