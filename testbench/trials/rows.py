"""A trial's rows as tables hold them: frozen dataclasses, nested ones as dotted columns, and back."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import TypeAdapter, ValidationError

from testbench.errors import BenchError

R = TypeVar("R")
Plain = float | int | str | bool | None
Value = Plain | tuple[Plain, ...]
Flat = dict[str, Value]  #: A row by column.
SEED = "seed"
LARGEST = 2**63  #: Integers lie below it: Parquet's have 64 bits.


@dataclass(frozen=True)
class Column:
    """Type of a column; each may hold None too."""

    kind: type  #: float, int, str or bool.
    several: bool = False  #: Whether a cell holds a tuple of them.


def columns(row: type, prefix: str = "") -> dict[str, Column]:
    """Columns of a dataclass of rows as `flatten` describes it, from the types of its fields.

    A dataclass beside plain types, as `Spread` in `Number`, is of summaries and no column; a share, which is
    a truth value or a float, is a truth value in the rows of a trial.

    Raises:
        BenchError: When a field has another type, or the name of the seed's column.
    """
    found: dict[str, Column] = {}
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
    """Of float | None both; of a Literal the types of its values."""
    if get_origin(annotation) in (Union, UnionType):
        return {own for part in get_args(annotation) for own in _alternatives(part)}
    return (
        {type(value) for value in get_args(annotation)} if get_origin(annotation) is Literal else {annotation}
    )


def _nested(kinds: set[Any]) -> type | None:
    """The dataclass that a field holds, perhaps beside None."""
    plain = kinds - {NoneType}
    return next(iter(plain)) if len(plain) == 1 and all(map(is_dataclass, plain)) else None


def _column(name: str, kinds: set[Any]) -> Column:
    several = [own for own in kinds if get_origin(own) is tuple]
    if several:
        kinds = {own for part in get_args(several[0]) if part is not ... for own in _alternatives(part)}
    plain = {own for own in kinds if own is not NoneType and not is_dataclass(own)}
    for wide, both in ((float, {float, int}), (bool, {float, bool})):
        plain = {wide} if plain == both else plain
    if len(plain) != 1 or not plain <= {float, int, str, bool}:
        raise BenchError(f"rows: {name}: expected a type of numbers or words, got {kinds}")
    return Column(plain.pop(), bool(several))


def flatten(row: object, prefix: str = "") -> Flat:
    """Columns of a row: `check.rms_mm` is the field rms_mm of the field check.

    A row is a dataclass of numbers, words, truth values, None, tuples of those, and such dataclasses or None;
    anything else raises BenchError.
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


def check_types(row: Flat, table: Mapping[str, Column]) -> None:
    """Refuse, by BenchError, a row with other columns, values of other types or integers above 64 bits."""
    if row.keys() != table.keys():
        differ = ", ".join(sorted(row.keys() ^ table.keys()))
        raise BenchError(f"rows: expected the columns of one dataclass, they differ in {differ}")
    for name, value in row.items():
        column = table[name]
        fits = (float, int) if column.kind is float else (column.kind,)
        cells: Sequence[object] = [value] if isinstance(value, Plain) else value
        parts = [own for own in cells if own is not None]
        large = [own for own in parts if isinstance(own, int) and not -LARGEST <= own < LARGEST]
        wrong = [own for own in parts if type(own) not in fits] or large
        if wrong or (parts and column.several == isinstance(value, Plain)):
            what = f"a tuple of {column.kind.__name__}" if column.several else column.kind.__name__
            raise BenchError(f"rows: {name}: expected {what}, got {(wrong or [value])[0]!r:.80}")


def _plain(name: str, value: object) -> Plain:
    plain = value.item() if isinstance(value, np.generic) else value
    if isinstance(plain, str):
        return plain.encode(errors="replace").decode()  # half a character, as of a file's name, is no text
    if plain is None or isinstance(plain, float | int):
        return plain
    raise BenchError(f"rows: {name}: expected a number, a word or None, got {type(plain).__name__}")


def restorer(kind: type[R]) -> Callable[[Mapping[str, Any]], R]:
    """What makes rows of a dataclass of the columns that `flatten` took them apart to.

    It raises BenchError when a column is missing, unknown or of another type.
    """
    adapter = TypeAdapter(kind)

    def restore(flat: Mapping[str, Any]) -> R:
        try:
            return adapter.validate_python(_nest(kind, flat, ""))
        except ValidationError as err:
            first = err.errors(include_url=False)[0]
            raise BenchError(f"rows: {'.'.join(map(str, first['loc']))}: {first['msg']}") from err

    return restore


def _nest(kind: type, flat: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    """Fields of a dataclass; a nested one that may be None is None where all its columns are."""
    found: dict[str, Any] = {}
    for field, kinds in _kinds(kind).items():
        if nested := _nested(kinds):
            own = _nest(nested, flat, f"{prefix}{field}.")
            found[field] = None if NoneType in kinds and _empty(own) else own
        elif prefix + field in flat:
            found[field] = flat[prefix + field]
    return found


def _empty(value: Any) -> bool:
    """Whether all columns of a nested dataclass are None."""
    return all(map(_empty, value.values())) if isinstance(value, dict) else value is None
