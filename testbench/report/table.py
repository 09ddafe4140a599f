"""Trials as one table: rows of a group become medians with their spread, two models ratios."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from testbench.trials.gain import Gain, gained
from testbench.trials.rows import flatten
from testbench.trials.spread import spread, twins_once

Cells = npt.NDArray[Any]
MODEL, TRIAL = "name", "seed"
"""Columns that say of which model and of which trial a row is."""
BEYOND = 1e100  #: No number of a trial is as large.


class Row(dict[str, Any]):
    """Numbers by column; `row.check.rms_mm` is the column `check.rms_mm` of a table."""

    def __getattr__(self, name: str) -> Any:
        if name in self:
            return self[name]
        raise AttributeError(f"no column {name!r}; columns are {', '.join(self)}")


@dataclass(frozen=True)
class Trials:
    """Rows of all trials by column, in the order of the seeds.

    Numbers that are missing are NaN, all else that is missing None; lists are cells as they are.
    """

    columns: Mapping[str, Cells]  #: As many cells each.

    @classmethod
    def read(cls, path: Path) -> "Trials":
        """What a run wrote: trials.parquet, nested fields as dotted columns.

        Raises:
            ValueError: When a number is one that no trial can have.
        """
        from pyarrow import parquet  # here: commands have no trials

        table = parquet.read_table(path, use_threads=False)
        columns = {name: table[name].combine_chunks() for name in table.column_names}
        for name, cells in columns.items():
            if pa.types.is_floating(cells.type) and not (np.abs(cells.drop_null().to_numpy()) < BEYOND).all():
                raise ValueError(f"{name} has a number that no trial can have")
        return cls({name: _cells(cells) for name, cells in columns.items()})

    @classmethod
    def of(cls, trials: Sequence[tuple[int, Sequence[object]]]) -> "Trials":
        """The same of rows that are in memory, by seed."""
        rows = [{TRIAL: seed, **flatten(row)} for seed, own in trials for row in own]
        table = pa.Table.from_pylist([{k: _listed(v) for k, v in row.items()} for row in rows])
        return cls({name: _cells(table[name].combine_chunks()) for name in table.column_names})

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __getitem__(self, name: str) -> Cells:
        if name not in self.columns:
            raise KeyError(f"no column {name!r}; columns are {', '.join(self.columns)}")
        return self.columns[name]

    def pick(self, rows: Cells) -> "Trials":
        """Rows by a mask, or by their numbers."""
        return Trials({name: cells[rows] for name, cells in self.columns.items()})

    def where(self, **alike: Any) -> "Trials":
        """Rows that have these values; of a tuple or set one of them."""
        found = np.ones(len(self), dtype=bool)
        for name, value in alike.items():
            cells = self[name]
            some = isinstance(value, tuple | set | frozenset)
            found &= np.isin(cells, list(value)) if some else np.asarray(cells == value, dtype=bool)
        return self.pick(found)

    def keep(self, *names: str) -> "Trials":
        """Some columns; a name that ends with a dot is all that begin with it."""
        return Trials({name: own for name, own in self.columns.items() if _named(name, names)})

    def drop(self, *names: str) -> "Trials":
        """All other columns."""
        return Trials({name: own for name, own in self.columns.items() if not _named(name, names)})

    def inside(self, name: str) -> "Trials":
        """Columns whose names begin with this one and a dot, without both."""
        start = f"{name}."
        return Trials({own.removeprefix(start): cells for own, cells in self.keep(start).columns.items()})

    def add(self, **more: Any) -> "Trials":
        """With more columns, or others of the same names."""
        return Trials({**self.columns, **{name: np.asarray(cells) for name, cells in more.items()}})

    def values(self, name: str) -> list[Any]:
        """What a column holds, each once, as it first appears."""
        return list(dict.fromkeys(self[name].tolist()))

    def groups(self, *by: str) -> Iterator[tuple[tuple[Any, ...], "Trials"]]:
        """Rows that are alike in some columns, groups as they first appear; of none all rows."""
        codes = np.zeros(len(self), dtype=int)
        for name in by:
            known = {value: k for k, value in enumerate(self.values(name))}
            own = np.array([known[value] for value in self[name].tolist()], dtype=int)
            codes = codes * max(len(known), 1) + own
        _, first, codes = np.unique(codes, return_index=True, return_inverse=True)
        ordered, ends = np.argsort(codes, kind="stable"), np.cumsum(np.bincount(codes))
        parts = np.split(ordered, ends[:-1]) if len(ordered) else []
        keys = [self[name][first].tolist() for name in by]
        for k in np.argsort(first):
            yield tuple(own[k] for own in keys), self.pick(parts[k])


def merged(trials: Trials, *by: str) -> list[Row]:
    """A row for all trials that are alike in some columns: see `number`; without columns one row for all."""
    return [
        nested({name: number(cells) for name, cells in own.columns.items()}) for _, own in trials.groups(*by)
    ]


def number(cells: Cells) -> Any:
    """One value for those of all trials.

    What is the same in all stays. Numbers become their median with 5th and 95th percentile, truth values
    the share that holds, lists of numbers lists of such; sentences stand each once, words one after another.
    None where one is missing.
    """
    if cells.dtype.kind in "fi":
        return _middle(cells)
    values = cells.tolist()
    if all(value == values[0] for value in values[1:]):
        return values[0]
    if all(isinstance(value, bool) for value in values):
        return sum(values) / len(values)
    lists = [value for value in values if isinstance(value, tuple)]
    if not lists:
        return " | ".join(sorted({str(value) for value in values}))
    if all(isinstance(word, str) for own in lists for word in own):
        return list(twins_once(lists))
    return [number(np.array(own, dtype=float)) for own in zip(*lists, strict=True)]


def _middle(cells: Cells) -> Any:
    if np.isnan(cells).any():
        return None
    first = cells[0].item()
    return first if (cells == first).all() else spread(cells)


def paired(trials: Trials, ours: str, theirs: str, value: str, scale: float = 1.0) -> Gain | None:
    """Two models in the same trials by one error [mm once it is scaled]; None where one is not there.

    Args:
        trials: A row a model and trial.
        ours: Name of one model.
        theirs: Name of the other.
        value: Column of the error.
        scale: Its unit over mm [1].
    """
    both = aligned(trials, (ours, theirs), value)
    if ours == theirs or not len(both):
        return None
    a, b = (scale * both).T.tolist()
    return gained(ours, theirs, a, b)


def aligned(trials: Trials, models: Sequence[str], value: str, by: Sequence[str] = (TRIAL,)) -> Cells:
    """One quantity of several models in the trials that all of them have, (trials, models)."""
    found: list[dict[tuple[Any, ...], float]] = []
    for model in models:
        own = trials.where(**{MODEL: model})
        found.append(dict(zip(_keys(own, by), own[value], strict=True)))
    shared = [key for key in found[0] if all(key in other for other in found[1:])]
    return np.array([[own[key] for own in found] for key in shared]).reshape(len(shared), len(models))


def matched(rows: Trials, others: Trials, value: str, by: Sequence[str]) -> Cells:
    """One quantity of the other row that is alike in some columns, row by row; KeyError without one."""
    known = dict(zip(_keys(others, by), others[value], strict=True))
    return np.array([known[key] for key in _keys(rows, by)])


def _keys(rows: Trials, by: Sequence[str]) -> Iterator[tuple[Any, ...]]:
    return zip(*(rows[name].tolist() for name in by), strict=True)


def nested(flat: Mapping[str, Any]) -> Row:
    """Columns with dots in their names as rows within the row; a row of nothing but None is None."""
    found = Row()
    for name, value in flat.items():
        *parts, last = name.split(".")
        own = found
        for part in parts:
            own = own.setdefault(part, Row())
        own[last] = value
    return found


def find(rows: Sequence[Row], **alike: Any) -> Row:
    """The first of some rows that has these values; StopIteration where none has."""
    return next(row for row in rows if all(row[name] == value for name, value in alike.items()))


def rows(value: Any) -> Any:
    """JSON data with every table of keys as a row."""
    if isinstance(value, Mapping):
        return Row({key: rows(own) for key, own in value.items()})
    return [rows(own) for own in value] if isinstance(value, list | tuple) else value


def plain(value: Any) -> Any:
    """Numbers, words and what holds them as JSON data: what is not finite is null."""
    if isinstance(value, Mapping):
        return {key: plain(own) for key, own in value.items()}
    if isinstance(value, list | tuple | set | frozenset | np.ndarray):
        return [plain(own) for own in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return plain(vars(value)) if hasattr(value, "__dict__") and not isinstance(value, str) else value


def _named(name: str, names: Sequence[str]) -> bool:
    return any(name == own or (own.endswith(".") and name.startswith(own)) for own in names)


def _listed(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _cells(column: pa.Array) -> Cells:
    """Numbers and truth values as they are, words each once in memory, lists as tuples."""
    kind = column.type
    if pa.types.is_floating(kind) or (pa.types.is_integer(kind) and not column.null_count):
        return np.asarray(column.to_numpy(zero_copy_only=False))
    if pa.types.is_integer(kind):
        return np.asarray(column.cast(pa.float64()).to_numpy(zero_copy_only=False))
    if pa.types.is_boolean(kind) and not column.null_count:
        return np.asarray(column.to_numpy(zero_copy_only=False), dtype=bool)
    if pa.types.is_string(kind):
        coded = column.dictionary_encode()
        words = np.array([*coded.dictionary.to_pylist(), None], dtype=object)
        return np.asarray(words[coded.indices.fill_null(len(words) - 1).to_numpy()])
    found = np.empty(len(column), dtype=object)
    found[:] = [tuple(value) if isinstance(value, list) else value for value in column.to_pylist()]
    return found
