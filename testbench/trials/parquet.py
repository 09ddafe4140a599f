"""A Parquet file of trials: typed rows in the order of their seeds, and whose they are in its metadata.

It is written under another name and on the disk before it gets its own: there is no torn one. Every page has
a checksum.
"""

import contextlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain, groupby
from operator import itemgetter
from pathlib import Path
from typing import Any

import pyarrow as pa
from pyarrow import parquet

from testbench.errors import BenchError, InputError
from testbench.trials.rows import Column, Value, columns

SEED = "seed"
GROUP = 2048
"""Rows of a row group: what is in memory at a time."""
BATCH = 64
"""Rows that are read at a time, of each file."""
TYPES = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}

Trial = tuple[int, list[dict[str, Value]]]
"""Seed and flat rows."""


@dataclass(frozen=True)
class Table:
    """What the files of a run hold.

    Attributes:
        header: Of the experiment.
        columns: Of a row, without the seed.
    """

    header: Mapping[str, Any]
    columns: Mapping[str, Column]

    @classmethod
    def of(cls, header: Mapping[str, Any], row: type) -> "Table":
        """That of a dataclass."""
        return cls(header, columns(row))

    def schema(self, spans: Iterable[range], level: int) -> pa.Schema:
        """Columns and metadata: header, seeds as [first, count], how often the trials were put together."""
        fields = [(SEED, pa.int64())]
        for name, column in self.columns.items():
            fields.append((name, pa.list_(TYPES[column.kind]) if column.several else TYPES[column.kind]))
        about = {"testbench": self.header, "seeds": [[s[0], len(s)] for s in spans], "level": level}
        return pa.schema(fields, {key: json.dumps(value, sort_keys=True) for key, value in about.items()})

    def arrow(self, group: list[Trial], schema: pa.Schema) -> pa.Table:
        """Rows as Arrow's columns.

        Raises:
            BenchError: When a row has other columns, or a value is not of its column's type.
        """
        rows = [row for _, own in group for row in own]
        for row in rows:
            if row.keys() != self.columns.keys():
                differ = ", ".join(sorted(row.keys() ^ self.columns.keys()))
                raise BenchError(f"rows: expected the columns of one dataclass, they differ in {differ}")
        data = {SEED: pa.array([seed for seed, own in group for _ in own], pa.int64())}
        for name, column in self.columns.items():
            data[name] = _array(name, column, [row[name] for row in rows])
        return pa.table(data, schema=schema)


def _array(name: str, column: Column, values: list[Any]) -> pa.Array:
    plain = chain.from_iterable(v for v in values if v is not None) if column.several else values
    fits = {float, int} if column.kind is float else {column.kind}
    wrong = {type(v).__name__ for v in plain if v is not None and type(v) not in fits}
    if wrong:  # Arrow would take 1.5 as an integer
        raise BenchError(f"rows: {name}: expected {column.kind.__name__}, got {', '.join(sorted(wrong))}")
    kind = TYPES[column.kind]
    try:
        return pa.array(values, pa.list_(kind) if column.several else kind)
    except (ValueError, TypeError, OverflowError) as err:
        raise BenchError(f"rows: {name}: expected {column.kind.__name__}: {err}") from err


@dataclass(frozen=True)
class Part:
    """A file of trials.

    Attributes:
        path: The file.
        header: Of their experiment.
        spans: Their seeds, also of trials without rows.
        level: How often trials were put together in it.
    """

    path: Path
    header: Mapping[str, Any]
    spans: tuple[range, ...]
    level: int

    @property
    def count(self) -> int:
        """Trials in it."""
        return sum(map(len, self.spans))

    def trials(self) -> Iterator[Trial]:
        """They, in the order of their seeds, a few rows at a time in memory.

        Raises:
            InputError: When the file is damaged.
        """
        with _damage(self.path), _opened(self.path) as file:
            rows = chain.from_iterable(batch.to_pylist() for batch in file.iter_batches(BATCH))
            groups = ((seed, list(own)) for seed, own in groupby(rows, itemgetter(SEED)))
            ahead = next(groups, None)
            for seed in chain.from_iterable(self.spans):
                own: list[dict[str, Value]] = []
                if ahead is not None and ahead[0] == seed:
                    own = [{key: value for key, value in row.items() if key != SEED} for row in ahead[1]]
                    ahead = next(groups, None)
                yield seed, own
            if ahead is not None:
                raise ValueError(f"it holds rows of seed {ahead[0]}, which it does not name")


def read_part(path: Path) -> Part:
    """What a file of trials holds.

    Raises:
        InputError: When it is damaged, or holds something else.
    """
    with _damage(path), _opened(path) as file:
        for _ in file.iter_batches():  # every page against its checksum
            pass
        about = {key.decode(): value for key, value in file.schema_arrow.metadata.items()}
        header, seeds, level = (json.loads(about[key]) for key in ("testbench", "seeds", "level"))
        return Part(path, dict(header), tuple(range(first, first + n) for first, n in seeds), int(level))


def write_part(path: Path, table: Table, spans: Iterable[range], trials: Iterable[Trial], level: int) -> Part:
    """Write trials in the order in which they come, all or none.

    Args:
        path: The file; an earlier one is replaced.
        table: What it holds.
        spans: Seeds of the trials.
        trials: They.
        level: How often they were put together.

    Raises:
        BenchError: When a row is not of the table's type.
        InputError: When the file cannot be written.
    """
    spans = tuple(spans)
    schema = table.schema(spans, level)
    ahead = path.with_name(f".{path.name}.new")
    try:
        with ahead.open("wb") as file:
            with parquet.ParquetWriter(file, schema, write_page_checksum=True) as writer:
                for group in _groups(trials):
                    writer.write_table(table.arrow(group, schema))
            file.flush()
            os.fsync(file.fileno())
        ahead.replace(path)
        _sync(path.parent)
    except OSError as err:
        raise InputError(path, "", f"cannot be written: {err.strerror or err}") from err
    finally:
        ahead.unlink(missing_ok=True)
    return Part(path, table.header, spans, level)


def _groups(trials: Iterable[Trial]) -> Iterator[list[Trial]]:
    """Trials of GROUP rows; those of one may lie in two groups."""
    group: list[Trial] = []
    room = GROUP
    for seed, rows in trials:
        while len(rows) >= room:
            yield [*group, (seed, rows[:room])]
            rows, group, room = rows[room:], [], GROUP
        group.append((seed, rows))
        room -= len(rows)
    if room < GROUP:
        yield group


def _sync(folder: Path) -> None:
    """The name of a new file, too, has to be on the disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _opened(path: Path) -> parquet.ParquetFile:
    return parquet.ParquetFile(path, page_checksum_verification=True)


@contextlib.contextmanager
def _damage(path: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, KeyError, ValueError, TypeError, AttributeError, pa.ArrowException) as err:
        raise InputError(
            path, "", f"expected a whole file of trials: {err}; move it away, --resume does its trials again"
        ) from err
