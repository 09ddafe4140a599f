"""Rows that are too many to hold: blocks of them in a file without a name, which ends with the process."""

import io
import os
import tempfile
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from testbench.data.dataset import Dataset, arrays, in_order, with_arrays
from testbench.data.series import Series
from testbench.errors import Array, BenchError, Ids

SHOWN = 600  #: Runs that are looked at one by one, evenly out of all.

Held = TypeVar("Held", Dataset, Series)


class Spool:
    """Blocks of runs in the order in which they were added; for any thread."""

    def __init__(self) -> None:
        """An empty one."""
        self._file = tempfile.TemporaryFile(prefix="testbench-runs-")  # noqa: SIM115
        weakref.finalize(self, self._file.close)
        #: Each without a row, and where each of its arrays begins and ends in the file.
        self._blocks: list[tuple[Dataset, dict[str, tuple[int, int]]]] = []
        self._first = [0]

    def __len__(self) -> int:
        """How many blocks there are."""
        return len(self._blocks)

    def add(self, block: Dataset) -> None:
        """A block more; BenchError where the disk is full."""
        places: dict[str, tuple[int, int]] = {}
        for name, own in arrays(block).items():
            begin = self._file.tell()
            try:
                np.save(self._file, own)
            except OSError as err:
                folder = tempfile.gettempdir()
                raise BenchError(f"{folder}: no room for the runs: {err.strerror}") from err
            places[name] = begin, self._file.tell()
        self._file.flush()
        self._blocks.append((in_order(block, np.array([], dtype=int)), places))
        self._first.append(self._first[-1] + len(block.q))

    def __getitem__(self, k: int) -> Dataset:
        """A block as it was added, by its number."""
        (bare, places), file = self._blocks[k], self._file.fileno()
        found = {
            name: np.load(io.BytesIO(os.pread(file, end - begin, begin)))
            for name, (begin, end) in places.items()
        }
        return with_arrays(bare, found)

    def places(self, k: int) -> Ids:
        """Of the rows of a block, among all."""
        return np.arange(*self._first[k : k + 2])


@dataclass(frozen=True, eq=False)
class Campaign:
    """All runs of a file, block by block; what is held of each is whose it is and what acts."""

    spool: Spool
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
        return self.spool.places(k), data if self.mend is None else self.mend(data)

    def pick(self, runs: Ids) -> Dataset:
        """Some of the runs by their indices, in rising order."""
        found = []
        for k in range(len(self)):
            every, data = self.block(k)
            own = np.isin(every, runs)
            if own.any():
                found.append(in_order(data, own))
        return together(found)


def some(runs: Ids) -> Ids:
    """So many of the runs that can be looked at one by one, evenly, the first and the last among them."""
    return np.asarray(runs[np.linspace(0, len(runs) - 1, min(SHOWN, len(runs))).round().astype(int)])


def together(parts: Sequence[Held]) -> Held:
    """Rows of several parts of one campaign as one; a precision stands where one of them has it."""
    if any(p.precision is not None for p in parts):
        parts = [replace(p, precision=_precision(p)) for p in parts]
    return with_arrays(
        parts[0], {name: np.concatenate([getattr(p, name) for p in parts]) for name in arrays(parts[0])}
    )


def _precision(data: Dataset | Series) -> Array:
    """Inverse covariance of every deflection or position, (rows, m, 3, 3) [1/m^2]."""
    if data.precision is not None:
        return data.precision
    readings, of_each = (data.before, 2) if isinstance(data, Dataset) else (data.position, 1)
    return np.broadcast_to(np.eye(3) / (of_each * data.sigma**2), (*readings.shape, 3)).copy()
