"""Runs that are too many to hold: blocks of them in a file without a name, which ends with the process."""

import io
import os
import tempfile
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from testbench.data.dataset import Dataset, Ids, in_order
from testbench.errors import Array, BenchError


@dataclass(frozen=True)
class _Block:
    first: int  #: Index of its first run.
    arrays: dict[str, tuple[int, int]]  #: Where each begins and ends in the file.
    bare: Dataset  #: The same without a run: names of markers, sigmas.


class Spool:
    """Blocks of runs in the order in which they were added."""

    def __init__(self) -> None:
        """An empty one."""
        self._file = tempfile.TemporaryFile(prefix="testbench-runs-")  # noqa: SIM115
        weakref.finalize(self, self._file.close)
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
        arrays: dict[str, tuple[int, int]] = {}
        for name in _arrays(data):
            begin = self._file.tell()
            try:
                np.save(self._file, getattr(data, name))
            except OSError as err:
                folder = tempfile.gettempdir()
                raise BenchError(f"{folder}: no room for the runs: {err.strerror}") from err
            arrays[name] = begin, self._file.tell()
        self._file.flush()
        self._blocks.append(_Block(self._runs, arrays, in_order(data, np.array([], dtype=int))))
        self._runs += data.runs

    def block(self, k: int) -> Dataset:
        """A block as it was added, for any thread."""
        own = self._blocks[k]
        file = self._file.fileno()
        found = {
            name: np.load(io.BytesIO(os.pread(file, end - begin, begin)))
            for name, (begin, end) in own.arrays.items()
        }
        return replace(own.bare, **found)


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
        first = self.spool.first(k)
        data = self.spool.block(k)
        return np.arange(first, first + data.runs), data if self.mend is None else self.mend(data)

    def pick(self, runs: Ids) -> Dataset:
        """Some of the runs by their indices, in rising order."""
        found = []
        for k in range(len(self)):
            every, data = self.block(k)
            own = np.isin(every, runs)
            if own.any():
                found.append(in_order(data, np.flatnonzero(own)))
        return together(found)


def together(parts: Sequence[Dataset]) -> Dataset:
    """Runs of several datasets of one campaign as one; a precision stands where one of them has it."""
    if any(p.precision is not None for p in parts):
        parts = [replace(p, precision=_precision(p)) for p in parts]
    optional = {
        name: np.concatenate([getattr(p, name) for p in parts])
        for name in ("rotation_before", "rotation_after", "precision")
        if getattr(parts[0], name) is not None
    }
    return replace(
        parts[0],
        run=np.concatenate([p.run for p in parts]),
        pose=np.concatenate([p.pose for p in parts]),
        q=np.concatenate([p.q for p in parts]),
        wrench=np.concatenate([p.wrench for p in parts]),
        point=np.concatenate([p.point for p in parts]),
        before=np.concatenate([p.before for p in parts]),
        after=np.concatenate([p.after for p in parts]),
        station=_stations(parts),
        rotation_before=optional.get("rotation_before"),
        rotation_after=optional.get("rotation_after"),
        precision=optional.get("precision"),
    )


def _stations(parts: Sequence[Dataset]) -> Ids | None:
    found = [p.station for p in parts if p.station is not None]
    return np.concatenate(found) if found else None


def _arrays(data: Dataset) -> list[str]:
    """Names of the fields that are arrays."""
    return [field.name for field in fields(data) if isinstance(getattr(data, field.name), np.ndarray)]


def _precision(data: Dataset) -> Array:
    if data.precision is not None:
        return data.precision
    return np.broadcast_to(np.eye(3) / (2 * data.sigma**2), (*data.before.shape, 3)).copy()
