"""The trial store: finished trials in `trials.jsonl`, appended as they come, whatever stops the run."""

import contextlib
import fcntl
import json
import os
import stat
from array import array
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from testbench.errors import InputError
from testbench.trials.lines import (
    Experiment,
    Row,
    Rows,
    check_header,
    check_trial,
    corrupt,
    read_lines,
    write_line,
)
from testbench.trials.rows import restorer

FILE = "trials.jsonl"
FINISHED = "finished"
"""Key of the line behind the last trial of a study that came to its end."""


class TrialStore:
    """The stored trials of a study: where in the file each is, 8 bytes a trial in memory.

    Open one with `open_store`.

    Args:
        path: The file.
        study: What is tried.
        descriptor: Of the open file, locked.
        row: Type of the rows, None for flat dictionaries.
    """

    def __init__(self, path: Path, study: Experiment, descriptor: int, row: type | None = None) -> None:
        self.path = path
        self.row = row
        self.study = study
        self._descriptor = descriptor
        self._starts = array("q", bytes(8 * len(study.seeds)))  # 0, where the header is: not stored
        self._end = 0

    @property
    def count(self) -> int:
        """Trials of the study that are stored."""
        return len(self._starts) - self._starts.count(0)

    def missing(self) -> Iterator[int]:
        """Seeds that are not stored, in order."""
        return (seed for seed, start in zip(self.study.seeds, self._starts, strict=True) if not start)

    def trials(self) -> Iterator[tuple[int, list[Any]]]:
        """Stored trials in the order of the seeds: seed, and its rows as they were returned."""
        restore: Callable[[Row], Any] = restorer(self.row) if self.row else dict
        for seed, rows in self.flat():
            yield seed, [restore(row) for row in rows]

    def flat(self) -> Iterator[tuple[int, Rows]]:
        """Stored trials of the study in the order of the seeds, one at a time in memory.

        Yields:
            Seed and rows.
        """
        with self.path.open("rb") as file:
            for seed, start in zip(self.study.seeds, self._starts, strict=True):
                if start:
                    file.seek(start)
                    yield seed, json.loads(file.readline())["rows"]

    def append(self, seeds: Sequence[int], lines: Sequence[bytes]) -> None:
        """Add finished trials; they are on the disk when this returns.

        Args:
            seeds: Of the trials, not stored yet.
            lines: A line each, from `chunk.do_chunk`.

        Raises:
            InputError: When the file cannot be written; it then holds what it held before.
        """
        if not self._end:  # nothing is touched before there is a result
            self._write(write_line(self.study.header))
        start = self._end
        self._write(b"".join(lines))
        for seed, line in zip(seeds, lines, strict=True):
            self._starts[seed - self.study.seeds[0]] = start
            start += len(line)

    def load(self) -> None:
        """Find the trials that are stored, and cut a torn last line.

        Raises:
            InputError: When they are of another study, or the file is damaged.
        """
        root, size = self.study.seeds[0], len(self._starts)
        with self.path.open("rb") as file:
            for line in read_lines(self.path, file):
                self._end = line.end
                if line.number == 1:
                    check_header(self.path, line.entry, self.study)
                elif FINISHED not in line.entry:
                    place = check_trial(self.path, line, root) - root
                    if place < size and self._starts[place]:
                        raise corrupt(self.path, line.number, f"seed {root + place} for the second time")
                    if place < size:
                        self._starts[place] = line.start
        with _writing(self.path):
            os.ftruncate(self._descriptor, self._end)

    def refuse_unfinished(self) -> None:
        """Keep a fresh run from replacing the trials of one that was stopped.

        Raises:
            InputError: When there are such trials.
        """
        held, finished = -1, True
        with self.path.open("rb") as file:
            for line in read_lines(self.path, file):
                finished = FINISHED in line.entry
                held += not finished
        if held > 0 and not finished:
            raise InputError(
                self.path,
                "",
                f"holds {held} trials of a run that was stopped: --resume goes on with it; choose another "
                "folder, or remove the file, to start afresh",
            )

    def finish(self) -> None:
        """Note that all is done: a later run without --resume may replace the file."""
        self._write(write_line({FINISHED: self.count}))

    def _write(self, data: bytes) -> None:
        with _writing(self.path):
            try:
                os.ftruncate(self._descriptor, self._end)
                _write_all(self._descriptor, data, self._end)
                os.fsync(self._descriptor)
            except OSError:
                os.ftruncate(self._descriptor, self._end)
                raise
        self._end += len(data)


@contextlib.contextmanager
def open_store(
    folder: Path, study: Experiment, *, resume: bool, row: type | None = None
) -> Iterator[TrialStore]:
    """The trial store of a run's folder; marked as finished when the block ends well with all trials.

    Around `files.whole_folder`, the mark means that the report is there too.

    Args:
        folder: The run's; made where it does not exist.
        study: What is tried.
        row: Type of the rows, None for flat dictionaries.
        resume: Whether to go on with the stored trials; without any it starts afresh.

    Raises:
        InputError: When another run writes it; when it cannot be written or is damaged; when it holds
            trials of another study (resume), or of a run that was stopped (no resume).
    """
    path, fresh = folder / FILE, not folder.exists()
    with _writing(path):
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    try:
        _claim(path, descriptor)
        store = TrialStore(path, study, descriptor, row)
        if resume:
            store.load()
        else:
            store.refuse_unfinished()
        yield store
        if store.count == len(study.seeds):
            store.finish()
    finally:
        if not os.fstat(descriptor).st_size:
            path.unlink(missing_ok=True)
        os.close(descriptor)
        if fresh and not any(folder.iterdir()):
            folder.rmdir()


def _claim(path: Path, descriptor: int) -> None:
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        raise InputError(path, "", "expected a file, got a folder or a device")
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as err:
        raise InputError(path, "", "another run is writing it: wait for it or choose another folder") from err


def _write_all(descriptor: int, data: bytes, offset: int) -> None:
    view = memoryview(data)
    while view:
        written = os.pwrite(descriptor, view, offset)
        view, offset = view[written:], offset + written


@contextlib.contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as err:
        raise InputError(path, "", f"cannot be written: {err.strerror}") from err
