"""Rows that are too many to hold: blocks of them in a file without a name, which ends with the process."""

import io
import os
import tempfile
import weakref
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from testbench.data.dataset import Dataset, arrays, in_order, joined, with_arrays
from testbench.data.series import Series
from testbench.errors import Array, BenchError, Ids

SHOWN = 600  #: Runs that are looked at one by one, evenly out of all.

Held = TypeVar("Held", Dataset, Series)


class _Spool:
    """Blocks of runs in the order in which they were added; for any thread."""

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile(prefix="testbench-runs-")  # noqa: SIM115
        weakref.finalize(self, self._file.close)
        #: Each without a row, and where its arrays begin and end in the file.
        self._blocks: list[tuple[Dataset, int, int]] = []

    def __len__(self) -> int:
        return len(self._blocks)

    def add(self, block: Dataset) -> None:
        """A block more; BenchError where the disk is full."""
        begin = self._file.tell()
        try:
            for own in arrays(block).values():
                np.save(self._file, own)
            self._file.flush()
        except OSError as err:
            folder = tempfile.gettempdir()
            raise BenchError(f"{folder}: no room for the runs: {err.strerror}") from err
        self._blocks.append((in_order(block, np.array([], dtype=int)), begin, self._file.tell()))

    def __getitem__(self, k: int) -> Dataset:
        bare, begin, end = self._blocks[k]
        file = io.BytesIO(os.pread(self._file.fileno(), end - begin, begin))
        return with_arrays(bare, {name: np.load(file) for name in arrays(bare)})


@dataclass(frozen=True, eq=False)
class Campaign:
    """All runs of a file, block by block; what is held of each is whose it is and what acts."""

    spool: _Spool
    first: Ids  #: Of every block the first run, by its index.
    run: Ids  #: Identifier of every run, (runs,).
    pose: Ids  #: Of its pose, (runs,).
    level: Array  #: Length of its force and moment, (runs, 2) [N, N m].
    mend: Callable[[Dataset], Dataset] | None = None  #: What has to be done to a block before it is used.

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self.run)

    def __len__(self) -> int:
        """How many blocks there are."""
        return len(self.spool)

    def block(self, k: int) -> tuple[Ids, Dataset]:
        """A block: indices of its runs, and these."""
        data = self.spool[k]
        return self.first[k] + np.arange(data.runs), data if self.mend is None else self.mend(data)

    def pick(self, runs: Ids) -> Dataset:
        """Some of the runs by their indices, in rising order."""
        blocks = ((np.isin(every, runs), data) for every, data in map(self.block, range(len(self))))
        return together([in_order(data, own) for own, data in blocks if own.any()])


def spooled(blocks: Iterable[Dataset]) -> Campaign:
    """Runs as a campaign, one block after the other; BenchError where the disk is full."""
    spool, held = _Spool(), list[tuple[Ids, Ids, Array]]()
    for data in blocks:
        level = np.linalg.norm(data.wrench.reshape(-1, 2, 3), axis=2)
        held.append((data.run, data.pose, level))
        spool.add(data)
    first = np.cumsum([0, *(len(run) for run, *_ in held)])
    run, pose, level = (np.concatenate(own) for own in zip(*held, strict=True))
    return Campaign(spool, first, run, pose, level)


def some(runs: Ids) -> Ids:
    """So many of the runs that can be looked at one by one, evenly, the first and the last among them."""
    return np.asarray(runs[np.linspace(0, len(runs) - 1, min(SHOWN, len(runs))).round().astype(int)])


def together(parts: Sequence[Held]) -> Held:
    """Rows of several parts of one campaign as one; a precision stands where one of them has it."""
    if any(p.precision is not None for p in parts):
        parts = [replace(p, precision=_precision(p)) for p in parts]
    return joined(parts)


def _precision(data: Dataset | Series) -> Array:
    """Inverse covariance of every deflection or position, (rows, m, 3, 3) [1/m^2]."""
    if data.precision is not None:
        return data.precision
    readings, of_each = (data.before, 2) if isinstance(data, Dataset) else (data.position, 1)
    return np.broadcast_to(np.eye(3) / (of_each * data.sigma**2), (*readings.shape, 3)).copy()
