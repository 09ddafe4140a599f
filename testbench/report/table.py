"""Trials as one table: rows of a group become medians with their spread, two models ratios."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from testbench.errors import Ids
from testbench.runs.rows import Row as Row
from testbench.runs.rows import finite as finite
from testbench.runs.rows import nested
from testbench.runs.spread import Spread, spread

Cells = npt.NDArray[Any]
MODEL, TRIAL = "name", "seed"
"""Columns that say of which model and of which trial a row is."""
SHARED = "shared_trial"  #: Column of the trial that several cases share, where `TRIAL` names a case.
DRAWN = ("values", "interval")  #: Of a spread what is drawn of it: only tables have it in report.json.
SPREAD = {own.name for own in fields(Spread)} - {*DRAWN}  #: What else it has.


@dataclass(frozen=True)
class Trials:
    """Hold the rows of all trials by column, in the order of the seeds.

    Numbers that are missing are NaN, all else that is missing None; lists are cells as they are.
    """

    whole: Mapping[str, Cells]  #: Columns, as they were read.
    rows: Ids | None = None  #: Which rows of these are selected; None for all.

    @property
    def columns(self) -> dict[str, Cells]:
        """Return all columns by name."""
        return {name: self[name] for name in self.whole}

    @classmethod
    def read(cls, path: Path) -> "Trials":
        """Read what a run wrote: trials.parquet, nested fields as dotted columns."""
        from pyarrow import parquet  # here: commands have no trials

        with parquet.ParquetFile(path) as file:
            table = file.read(use_threads=False)
        return cls({name: _cells(table[name].combine_chunks()) for name in table.column_names})

    def __len__(self) -> int:
        if self.rows is not None:
            return len(self.rows)
        return len(next(iter(self.whole.values()), ()))

    def __contains__(self, name: object) -> bool:
        return name in self.whole

    def __getitem__(self, name: str) -> Cells:
        if name not in self.whole:
            raise KeyError(f"no column {name!r}; columns are {', '.join(self.whole)}")
        return self.whole[name] if self.rows is None else self.whole[name][self.rows]

    def pick(self, rows: Cells) -> "Trials":
        """Select rows by a mask, or by their numbers."""
        every = np.arange(len(self)) if self.rows is None else self.rows
        return replace(self, rows=every[rows])

    def where(self, **alike: Any) -> "Trials":
        """Select rows that have these values; of a tuple or set one of them."""
        found = np.ones(len(self), dtype=bool)
        for name, value in alike.items():
            cells = self[name]
            some = isinstance(value, tuple | set | frozenset)
            each = [np.asarray(cells == own, dtype=bool) for own in (value if some else [value])]
            found &= np.any(each, axis=0)
        return self.pick(found)

    def keep(self, *names: str) -> "Trials":
        """Select some columns; a name that ends with a dot is all that begin with it."""
        return replace(self, whole={name: own for name, own in self.whole.items() if _named(name, names)})

    def drop(self, *names: str) -> "Trials":
        """Drop columns."""
        return replace(self, whole={name: own for name, own in self.whole.items() if not _named(name, names)})

    def inside(self, name: str) -> "Trials":
        """Select columns whose names begin with this one and a dot, without both."""
        start = f"{name}."
        own = self.keep(start).whole
        return replace(self, whole={key.removeprefix(start): cells for key, cells in own.items()})

    def add(self, **more: Any) -> "Trials":
        """Add columns, or replace those of the same names."""
        return Trials(self.columns | {name: np.asarray(cells) for name, cells in more.items()})

    def values(self, name: str) -> list[Any]:
        """List what a column holds, each once, as it first appears."""
        return list(dict.fromkeys(self[name].tolist()))

    def keys(self, *by: str) -> Iterator[tuple[Any, ...]]:
        """Yield what tells each row apart in some columns; a number that is missing is None."""
        columns = [[None if own != own else own for own in self[name].tolist()] for name in by]
        return (tuple(own[k] for own in columns) for k in range(len(self)))

    def groups(self, *by: str) -> Iterator[tuple[tuple[Any, ...], "Trials"]]:
        """Group rows that are alike in some columns, as they first appear; of none all rows."""
        rows: dict[tuple[Any, ...], list[int]] = {}
        for k, key in enumerate(self.keys(*by)):
            rows.setdefault(key, []).append(k)
        for key, own in rows.items():
            yield key, self.pick(np.array(own))


def merged(trials: Trials, *by: str) -> list[Row]:
    """Merge all trials that are alike in some columns: see `number`; without columns all in one row.

    Args:
        trials: Rows of the trials.
        by: Names of the columns.

    Returns:
        The rows.
    """
    found = []
    for _, own in trials.groups(*by):
        labels = own[SHARED] if SHARED in own.whole else None
        found.append(nested({name: number(own[name], labels) for name in own.drop(SHARED).whole}))
    return found


def number(cells: Cells, trials: Cells | None = None) -> Any:
    """Merge the values of all trials, or of all cases, of which several share one of these trials.

    What is the same in all stays. Numbers become their median with 5th and 95th percentile, truth values
    the share that holds, lists of numbers lists of such; of sentences those that all have stay, words stand
    one after another. None where one is missing.

    Args:
        cells: The values.
        trials: Labels of their trials; None where each has its own.

    Returns:
        One value.
    """
    if cells.dtype.kind in "fi":
        return _middle(cells, trials)
    values = cells.tolist()
    if all(value == values[0] for value in values[1:]):
        return values[0]
    if all(isinstance(value, bool) for value in values):
        return sum(values) / len(values)
    lists = [value for value in values if isinstance(value, tuple)]
    if not lists:
        return " | ".join(sorted({str(value) for value in values}))
    if all(isinstance(word, str) for own in lists for word in own):
        return [word for word in lists[0] if all(word in own for own in lists)]
    return [number(np.array(own, dtype=float)) for own in zip(*lists, strict=True)]


def _middle(cells: Cells, trials: Cells | None) -> Any:
    if np.isnan(cells).any():
        return None
    first = cells[0].item()
    return first if (cells == first).all() else spread(cells, trials)


def shared(trials: Trials, models: Sequence[str]) -> Cells | None:
    """Return labels of the trials of `aligned` that cases share, (trials,); None if each has its own.

    Args:
        trials: Rows of the trials.
        models: Names of the models.

    Returns:
        The labels.
    """
    return aligned(trials, models, SHARED)[:, 0] if SHARED in trials else None


def aligned(trials: Trials, models: Sequence[str], value: str) -> Cells:
    """Collect one quantity of several models in the trials that all of them have.

    Args:
        trials: Rows of the trials.
        models: Names of the models.
        value: Column of the quantity.

    Returns:
        The quantity, (trials, models).
    """
    found: list[dict[Any, float]] = []
    for model in models:
        own = trials.where(**{MODEL: model})
        found.append(dict(zip(own[TRIAL].tolist(), own[value], strict=True)))
    keys = [key for key in found[0] if all(key in other for other in found[1:])]
    return np.array([[own[key] for own in found] for key in keys]).reshape(len(keys), len(models))


def matched(rows: Trials, others: Trials, value: str, by: Sequence[str]) -> Cells:
    """Look up one quantity of the other row that is alike in some columns, row by row; KeyError without one.

    Args:
        rows: The rows.
        others: The other rows.
        value: Column of the quantity.
        by: Columns that are alike.

    Returns:
        The quantity, (rows,).
    """
    place = {key: k for k, key in enumerate(others.keys(*by))}
    ours = [*rows.keys(*by)]
    if {*ours} - place.keys():
        raise KeyError(f"rows without another one that is alike in {', '.join(by)}")
    return np.asarray(others[value][[place[key] for key in ours]])


def find(rows: Sequence[Row], **alike: Any) -> Row:
    """Find the first of some rows that has these values; StopIteration where none has.

    Args:
        rows: The rows.
        alike: Values by column.

    Returns:
        The row.
    """
    return next(row for row in rows if all(row[name] == value for name, value in alike.items()))


def rows(value: Any) -> Any:
    """Make rows of JSON data: every table of keys a row, every spread one, what is drawn of it too."""
    if not isinstance(value, Mapping):
        return [rows(own) for own in value] if isinstance(value, list | tuple) else value
    if not {"median", "p05", "p95"} <= value.keys() <= {*SPREAD, *DRAWN}:
        return Row({key: rows(own) for key, own in value.items()})
    read: dict[str, Any] = {key: math.nan if own is None else own for key, own in value.items()}
    return Spread(**read | {key: tuple(value[key]) for key in DRAWN if key in value})


def plain(value: Any) -> Any:
    """Convert numbers, words and what holds them to JSON data: what is not finite is null."""
    if isinstance(value, Mapping):
        return {key: plain(own) for key, own in value.items()}
    if isinstance(value, Spread):
        return {key: plain(own) for key, own in vars(value).items() if key in SPREAD}
    if isinstance(value, list | tuple | set | frozenset | np.ndarray):
        return [plain(own) for own in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return plain(vars(value)) if hasattr(value, "__dict__") and not isinstance(value, str) else value


def _named(name: str, names: Sequence[str]) -> bool:
    return any(name == own or (own.endswith(".") and name.startswith(own)) for own in names)


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
