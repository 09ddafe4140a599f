"""Runs that are too many to hold: blocks of them in a file without a name, which ends with the process."""

import io
import os
import tempfile
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.data.dataset import Dataset, Ids, arrays, in_order, with_arrays
from testbench.errors import Array, BenchError


@dataclass(frozen=True)
class _Block:
    first: int  #: Index of its first run.
    places: dict[str, tuple[int, int]]  #: Where each of its arrays begins and ends in the file.
    bare: Dataset  #: The same without a run: names of markers, sigmas.


class Spool:
    """Blocks of runs in the order in which they were added."""

    def __init__(self) -> None:
        """An empty one."""
        self._file = tempfile.TemporaryFile(prefix="testbench-runs-")  # noqa: SIM115
        weakref.finalize(self, self._file.close)
        self._blocks: list[_Block] = []
        self._runs = 0

    def __len__(self) -> int:
        """How many blocks there are."""
        return len(self._blocks)

    def add(self, data: Dataset) -> None:
        """A block more; BenchError where the disk is full."""
        places: dict[str, tuple[int, int]] = {}
        for name, own in arrays(data).items():
            begin = self._file.tell()
            try:
                np.save(self._file, own)
            except OSError as err:
                folder = tempfile.gettempdir()
                raise BenchError(f"{folder}: no room for the runs: {err.strerror}") from err
            places[name] = begin, self._file.tell()
        self._file.flush()
        self._blocks.append(_Block(self._runs, places, in_order(data, np.array([], dtype=int))))
        self._runs += data.runs

    def block(self, k: int) -> tuple[Ids, Dataset]:
        """A block as it was added, for any thread: indices of its runs, and these."""
        own, file = self._blocks[k], self._file.fileno()
        found = {
            name: np.load(io.BytesIO(os.pread(file, end - begin, begin)))
            for name, (begin, end) in own.places.items()
        }
        data = with_arrays(own.bare, found)
        return np.arange(own.first, own.first + data.runs), data


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
        every, data = self.spool.block(k)
        return every, data if self.mend is None else self.mend(data)

    def pick(self, runs: Ids) -> Dataset:
        """Some of the runs by their indices, in rising order."""
        found = []
        for k in range(len(self)):
            every, data = self.block(k)
            own = np.isin(every, runs)
            if own.any():
                found.append(in_order(data, own))
        return together(found)


def together(parts: Sequence[Dataset]) -> Dataset:
    """Runs of several datasets of one campaign as one; a precision stands where one of them has it."""
    if any(p.precision is not None for p in parts):
        parts = [replace(p, precision=_precision(p)) for p in parts]
    return with_arrays(
        parts[0], {name: np.concatenate([getattr(p, name) for p in parts]) for name in arrays(parts[0])}
    )


def _precision(data: Dataset) -> Array:
    if data.precision is not None:
        return data.precision
    return np.broadcast_to(np.eye(3) / (2 * data.sigma**2), (*data.before.shape, 3)).copy()
