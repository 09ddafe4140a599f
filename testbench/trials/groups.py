"""Rows of very many trials by group, as arrays: without a row or a word of its own for any of them.

A row of a study is a kilobyte in memory. Where a summary needs a few numbers of each, it asks for these.
"""

from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
import numpy.typing as npt
import pyarrow as pa
from pyarrow import parquet

from testbench.trials.store import TrialStore

R = TypeVar("R")
C = TypeVar("C")
Cells = npt.NDArray[np.generic]

BATCH = 2**19  #: Rows that are grouped at a time.
ROW = "#"  #: Their number: Arrow gives groups in an order of its own.


@dataclass(frozen=True)
class Whole(Generic[R]):
    """All trials of a run that has come to its end: seed and rows, in the order of the seeds."""

    store: TrialStore[R]
    path: Path  #: The same in Parquet.

    def __iter__(self) -> Iterator[tuple[int, Sequence[R]]]:
        return self.store.trials()


def by_group(
    trials: Iterable[tuple[int, Sequence[object]]], keys: Sequence[str], kind: type[C]
) -> dict[tuple[Hashable, ...], C]:
    """Columns of rows that are alike in others, in the order of the trials; groups as they first appear.

    Args:
        trials: Of a run that is `Whole`, or any.
        keys: Columns in which the rows of a group are alike.
        kind: A dataclass of arrays, named as the columns that are wanted: numbers (None is NaN), truth
            values or words, (rows,).
    """
    names = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    found: dict[tuple[Hashable, ...], list[list[Cells]]] = {}
    for batch in _batches(trials, [*keys, *names]):
        numbered = batch.append_column(ROW, pa.array(np.arange(len(batch))))
        asked = [(ROW, "min"), *((name, "list") for name in names)]
        groups = numbered.group_by(list(keys), use_threads=False).aggregate(asked).sort_by(f"{ROW}_min")
        cells = [groups[f"{name}_list"].combine_chunks() for name in names]
        for k, key in enumerate(zip(*(groups[name].to_pylist() for name in keys), strict=True)):
            found.setdefault(key, []).append([_array(own[k].values) for own in cells])
    return {key: kind(*map(np.concatenate, zip(*parts, strict=True))) for key, parts in found.items()}


def _batches(trials: Iterable[tuple[int, Sequence[object]]], names: Sequence[str]) -> Iterator[pa.Table]:
    if isinstance(trials, Whole):
        with parquet.ParquetFile(trials.path) as file:
            for batch in file.iter_batches(BATCH, columns=list(names)):
                yield pa.Table.from_batches([batch])
    else:
        rows = [row for _, own in trials for row in own]
        yield pa.table({name: [getattr(row, name) for row in rows] for name in names})


def _array(cells: pa.Array) -> Cells:
    """Numbers, truth values, or words, each of them there once."""
    if not pa.types.is_string(cells.type):
        return np.asarray(cells.to_numpy(zero_copy_only=False))
    coded = cells.dictionary_encode()
    return np.asarray(np.array(coded.dictionary.to_pylist(), dtype=object)[coded.indices.to_numpy()])
