"""Runs that are too many to hold: blocks of them in a file without a name, which ends with the process."""

import os
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields, replace

import numpy as np

from testbench.data.dataset import Dataset, Ids, in_order
from testbench.errors import Array, BenchError

Stored = tuple[int, tuple[int, ...], "np.dtype[np.generic]"]
"""Where an array begins, its shape, and of what."""


@dataclass(frozen=True)
class _Block:
    first: int  #: Index of its first run.
    arrays: dict[str, Stored]
    bare: Dataset  #: The same without a run: names of markers, sigmas.


class Spool:
    """Blocks of runs in the order in which they were added."""

    def __init__(self) -> None:
        """An empty one."""
        self._file = tempfile.TemporaryFile(prefix="testbench-runs-")  # noqa: SIM115: as long as this
        self._blocks: list[_Block] = []
        self._runs = 0

    def first(self, k: int) -> int:
        """Index of the first run of a block."""
        return self._blocks[k].first

    def __len__(self) -> int:
        """How many blocks there are."""
        return len(self._blocks)

    def add(self, data: Dataset) -> None:
        """A block more; BenchError where the disk is full."""
        arrays: dict[str, Stored] = {}
        for name in (field.name for field in fields(data)):
            value = getattr(data, name)
            if isinstance(value, np.ndarray):
                arrays[name] = self._file.tell(), value.shape, value.dtype
                try:
                    self._file.write(np.ascontiguousarray(value).data)
                except OSError as err:
                    raise BenchError(f"{tempfile.gettempdir()}: no room for the runs: {err.strerror}") from err
        self._file.flush()
        self._blocks.append(_Block(self._runs, arrays, in_order(data, np.array([], dtype=int))))
        self._runs += data.runs

    def block(self, k: int) -> Dataset:
        """A block as it was added, for any thread."""
        own = self._blocks[k]
        return replace(own.bare, **{name: self._read(*stored) for name, stored in own.arrays.items()})

    def _read(self, begin: int, shape: tuple[int, ...], of: "np.dtype[np.generic]") -> Array:
        size = int(np.prod(shape)) * of.itemsize
        return np.frombuffer(os.pread(self._file.fileno(), size, begin), of).reshape(shape)


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

    def block(self, k: int) -> tuple[Ids, Dataset]:
        """A block: indices of its runs, and these."""
        first = self.spool.first(k)
        data = self.spool.block(k)
        return np.arange(first, first + data.runs), data if self.mend is None else self.mend(data)

    def pick(self, runs: Ids) -> Dataset:
        """Some of the runs by their indices, in rising order."""
        found = []
        for k in range(len(self.spool)):
            every, data = self.block(k)
            own = np.isin(every, runs)
            if own.any():
                found.append(in_order(data, np.flatnonzero(own)))
        return together(found)


def together(parts: Iterable[Dataset]) -> Dataset:
    """Runs of several datasets of one campaign as one; a precision stands where one of them has it."""
    parts = list(parts)
    if any(p.precision is not None for p in parts):
        parts = [replace(p, precision=_precision(p)) for p in parts]
    arrays = [f.name for f in fields(parts[0]) if isinstance(getattr(parts[0], f.name), np.ndarray)]
    return replace(parts[0], **{name: np.concatenate([getattr(p, name) for p in parts]) for name in arrays})


def _precision(data: Dataset) -> Array:
    if data.precision is not None:
        return data.precision
    return np.broadcast_to(np.eye(3) / (2 * data.sigma**2), (*data.before.shape, 3)).copy()
