"""A trial's random numbers, and its rows by column, and back.

Rows are frozen dataclasses, nested ones dotted columns.
"""

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import TypeAdapter, ValidationError

from testbench.arm.document import first_invalid_value
from testbench.errors import BenchError

R = TypeVar("R")
Plain = float | int | str | bool | None
Value = Plain | tuple[Plain, ...]
Flat = dict[str, Value]  #: A row by column.
Table = dict[str, list[Value]]  #: Rows of a trial: the cells of every column.
SEED = "seed"
MAX_INTEGER = 2**63  #: Integers lie below it: Parquet's have 64 bits.


def trial_rng(seed: int, trial: int = 0) -> np.random.Generator:
    """Make the random numbers of one trial, independent of order, workers and restarts.

    Args:
        seed: Root of all randomness.
        trial: Number of the trial.

    Returns:
        The generator.
    """
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=(trial,))))


class Row(dict[str, Any]):
    """Hold numbers by name, as reports have them; `row.check.rms_mm` is a table's column `check.rms_mm`."""

    def __getattr__(self, name: str) -> Any:
        if name in self:
            return self[name]
        raise AttributeError(f"no column {name!r}; columns are {', '.join(self)}")


def finite(value: float | None) -> float | None:
    """Return a number, None for infinity and none."""
    return float(value) if value is not None and math.isfinite(value) else None


@dataclass(frozen=True)
class ColumnType:
    """Describe the type of a column."""

    kind: type  #: float, int, str or bool.
    several: bool  #: Whether a cell holds a tuple of them, perhaps None among them.


def columns(row: type, prefix: str = "") -> dict[str, ColumnType]:
    """Describe the columns of a dataclass of rows, as `flatten` makes them, from the types of its fields.

    A dataclass beside plain types, as `Spread` in `Number`, is of summaries and no column; a share, which is
    a truth value or a float, is a truth value in the rows of a trial.

    Args:
        row: The dataclass.
        prefix: Text before every name.

    Returns:
        Type of every column by its name.

    Raises:
        BenchError: When a field has another type, or the name of the seed's column.
    """
    found: dict[str, ColumnType] = {}
    for field, kinds in _kinds(row).items():
        nested = _nested(kinds)
        name = prefix + field
        found |= columns(nested, f"{name}.") if nested else {name: _column(name, kinds)}
    if SEED in found:
        raise BenchError(f"{row.__name__}: expected columns with names other than {SEED!r}")
    return found


@cache
def _kinds(row: Hashable) -> dict[str, set[Any]]:
    """Types that each field may have."""
    hints = get_type_hints(row)
    return {field.name: _alternatives(hints[field.name]) for field in fields(row)}  # type: ignore[arg-type]


def _alternatives(annotation: Any) -> set[Any]:
    """Of float | None both."""
    if get_origin(annotation) in (Union, UnionType):
        return {own for part in get_args(annotation) for own in _alternatives(part)}
    return {annotation}


def _nested(kinds: set[Any]) -> type | None:
    """The dataclass that a field holds, perhaps beside None."""
    plain = kinds - {NoneType}
    return next(iter(plain)) if len(plain) == 1 and all(map(is_dataclass, plain)) else None


def _column(name: str, kinds: set[Any]) -> ColumnType:
    several = [own for own in kinds if get_origin(own) is tuple]
    if several:
        kinds = {own for part in get_args(several[0]) if part is not ... for own in _alternatives(part)}
    words = {word for own in kinds if get_origin(own) is Literal for word in get_args(own)}
    plain = {own for own in kinds if get_origin(own) is not Literal} | set(map(type, words))
    plain = {own for own in plain if own is not NoneType and not is_dataclass(own)}
    for wide, both in ((float, {float, int}), (bool, {float, bool})):
        plain = {wide} if plain == both else plain
    if len(plain) != 1 or not plain <= {float, int, str, bool}:
        raise BenchError(f"rows: {name}: expected a type of numbers or words, got {kinds}")
    return ColumnType(plain.pop(), bool(several))


def flatten(row: object, prefix: str = "") -> Flat:
    """Make the columns of a row: `check.rms_mm` is the field rms_mm of the field check.

    A row is a dataclass of numbers, words, truth values, None, tuples of those, and such dataclasses or None;
    anything else raises BenchError.

    Args:
        row: The row.
        prefix: Text before every name.

    Returns:
        Value by column.
    """
    found: Flat = {}
    kind: type = type(row)
    for field, kinds in _kinds(kind).items():
        name, value = prefix + field, getattr(row, field)
        if is_dataclass(value):
            found |= flatten(value, f"{name}.")
        elif value is None and (nested := _nested(kinds)):
            found |= dict.fromkeys(columns(nested, f"{name}."))
        elif isinstance(value, tuple):
            found[name] = tuple(_plain(name, v) for v in value)
        else:
            found[name] = _plain(name, value)
    return found


def tabled(rows: Sequence[object]) -> Table:
    """Make columns of the rows of a trial; BenchError where they are not of one dataclass, see `flatten`."""
    flat = [flatten(row) for row in rows]
    for row in flat:
        if row.keys() != flat[0].keys():
            differ = ", ".join(sorted(row.keys() ^ flat[0].keys()))
            raise BenchError(f"rows: expected rows with the same columns, but some lack {differ}")
    return {name: [row[name] for row in flat] for name in flat[0]} if flat else {}


def count(table: Table) -> int:
    """Count the rows of a trial."""
    return len(next(iter(table.values()))) if table else 0


def _plain(name: str, value: object) -> Plain:
    plain = value.item() if isinstance(value, np.generic) else value
    if isinstance(plain, str):
        return plain.encode(errors="replace").decode()  # half a character, as of a file's name, is no text
    if plain is None or isinstance(plain, float | int):
        return plain
    raise BenchError(f"rows: {name}: expected a number, a word or None, got {type(plain).__name__}")


def restored(kind: type[R], table: Table) -> list[R]:
    """Restore rows from their columns.

    Args:
        kind: Dataclass of a row.
        table: Cells by column.

    Returns:
        The rows.

    Raises:
        BenchError: When a cell is none that the row may have.
    """
    try:
        return TypeAdapter(list[kind]).validate_python(_nest(kind, table, ""))  # type: ignore[valid-type]
    except ValidationError as err:
        keys, _, problem = first_invalid_value(err)
        raise BenchError(f"rows: {'.'.join(map(str, keys))}: {problem}") from err


def _nest(kind: type, table: Table, prefix: str) -> list[dict[str, Any]]:
    """Fields of a dataclass, row by row; a nested one that may be None is None where all its columns are."""
    found: dict[str, Sequence[Any]] = {}
    for field, kinds in _kinds(kind).items():
        if nested := _nested(kinds):
            own = _nest(nested, table, f"{prefix}{field}.")
            found[field] = [None if _empty(row) else row for row in own] if NoneType in kinds else own
        else:
            found[field] = table[prefix + field]
    return [dict(zip(found, row, strict=True)) for row in zip(*found.values(), strict=True)]


def _empty(value: Any) -> bool:
    """Whether all columns of a nested dataclass are None."""
    return all(map(_empty, value.values())) if isinstance(value, dict) else value is None
