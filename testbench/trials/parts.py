"""The folder of a run's finished trials: a file a second, put together when many."""

import heapq
from collections.abc import Iterable, Iterator
from itertools import chain
from operator import itemgetter
from pathlib import Path

from testbench.errors import InputError
from testbench.trials.experiment import check_header
from testbench.trials.parquet import Part, Table, Trial, read_part, write_part

FILE = "trials.parquet"
"""All trials, in the run's folder, once they are whole."""
FAN = 50
"""Files of one level that are put together into one of the next: few files, and a row is seldom copied."""


class Parts:
    """Stored trials of a run: those of its parts, and those of an earlier whole file that are of the same.

    Args:
        folder: Of the parts, in the run's folder.
        table: What they hold.
    """

    def __init__(self, folder: Path, table: Table) -> None:
        self.folder = folder
        self.table = table
        self.parts: list[Part] = []
        self.whole: Part | None = None

    def load(self) -> None:
        """Find what a stopped or a finished run has left.

        Raises:
            InputError: When a part is damaged or of another experiment; the whole file, if there are no
                parts: it may be another run's, which this one was to replace.
        """
        self.parts = [read_part(path) for path in sorted(self.folder.glob("*.parquet"))]
        for part in self.parts:
            check_header(part.path, part.header, self.table.header)
        path = self.folder.parent / FILE
        if path.exists():
            try:
                whole = read_part(path)
                check_header(path, whole.header, self.table.header)
            except InputError:
                if not self.parts:
                    raise
            else:
                self.whole = whole

    def seeds(self) -> Iterator[int]:
        """Of all stored trials, perhaps some twice."""
        return chain.from_iterable(chain.from_iterable(part.spans) for part in self._all())

    def trials(self) -> Iterator[Trial]:
        """All stored trials in the order of their seeds."""
        return _merged(self._all())

    def add(self, trials: list[Trial]) -> None:
        """Store trials; they are on the disk when this returns.

        Raises:
            InputError: When they cannot be written.
        """
        own = sorted(trials, key=itemgetter(0))
        self._write(spans(seed for seed, _ in own), own, level=0)
        level = 0
        while len(many := [part for part in self.parts if part.level == level]) >= FAN:
            level += 1
            seeds = heapq.merge(*(chain.from_iterable(part.spans) for part in many))
            self._write(spans(seeds), _merged(many), level)
            self.parts = [part for part in self.parts if part not in many]
            for part in many:
                part.path.unlink()

    def write_whole(self, folder: Path, seeds: range) -> Path:
        """Write the whole file: the same bytes, in whatever order and parts the trials came."""
        trials = (trial for trial in self.trials() if trial[0] in seeds)
        return write_part(folder / FILE, self.table, [seeds], trials, level=0).path

    def clear(self, seeds: range) -> None:
        """Remove the parts if the whole file is there."""
        path = self.folder.parent / FILE
        whole = read_part(path) if path.exists() else None
        if whole and (whole.header, whole.spans) == (self.table.header, (seeds,)):
            for part in self.folder.glob("*.parquet"):
                part.unlink()

    def _all(self) -> list[Part]:
        return [*self.parts, *([self.whole] if self.whole else [])]

    def _write(self, seeds: Iterable[range], trials: Iterable[Trial], level: int) -> None:
        last = max((int(part.path.stem) for part in self.parts), default=0)
        path = self.folder / f"{last + 1:08}.parquet"
        self.parts.append(write_part(path, self.table, seeds, trials, level))


def spans(seeds: Iterable[int]) -> list[range]:
    """Ascending seeds, some perhaps twice, as ranges."""
    found: list[range] = []
    for seed in seeds:
        if found and seed <= found[-1].stop:
            found[-1] = range(found[-1].start, max(seed + 1, found[-1].stop))
        else:
            found.append(range(seed, seed + 1))
    return found


def _merged(parts: Iterable[Part]) -> Iterator[Trial]:
    """Trials of all, in the order of their seeds; those that stand twice are the same."""
    last = -1
    for seed, rows in heapq.merge(*(part.trials() for part in parts), key=itemgetter(0)):
        if seed != last:
            yield seed, rows
        last = seed
