"""A trial's rows as tables hold them: frozen dataclasses, nested ones as dotted columns, and back."""

from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np
from pydantic import TypeAdapter, ValidationError

from testbench.errors import BenchError

R = TypeVar("R")
Plain = float | int | str | bool | None
Value = Plain | tuple[Plain, ...]


def flatten(row: object, prefix: str = "") -> dict[str, Value]:
    """Columns of a row: `check.rms_mm` is the field rms_mm of the field check.

    Args:
        row: A dataclass of numbers, words, truth values, None, tuples of those, and such dataclasses.
        prefix: Of the columns' names.

    Raises:
        BenchError: When a field holds something else.
    """
    found: dict[str, Value] = {}
    for field in fields(row):  # type: ignore[arg-type]
        name, value = prefix + field.name, getattr(row, field.name)
        if is_dataclass(value):
            found |= flatten(value, f"{name}.")
        elif isinstance(value, tuple):
            found[name] = tuple(_plain(name, v) for v in value)
        else:
            found[name] = _plain(name, value)
    return found


def _plain(name: str, value: object) -> Plain:
    plain = value.item() if isinstance(value, np.generic) else value
    if plain is None or isinstance(plain, float | int | str):
        return plain
    raise BenchError(f"rows: {name}: expected a number, a word or None, got {type(plain).__name__}")


def restorer(kind: type[R]) -> Callable[[Mapping[str, Any]], R]:
    """What makes rows of the columns that `flatten` took them apart to; it checks their types.

    Args:
        kind: The dataclass.

    Returns:
        A function; it raises BenchError when a column is missing, unknown or of another type.
    """
    adapter = TypeAdapter(kind)

    def restore(columns: Mapping[str, Any]) -> R:
        nested: dict[str, Any] = {}
        for name, value in columns.items():
            *path, last = name.split(".")
            place = nested
            for part in path:
                place = place.setdefault(part, {})
            place[last] = value
        try:
            return adapter.validate_python(nested)
        except ValidationError as err:
            first = err.errors(include_url=False)[0]
            raise BenchError(f"rows: {'.'.join(map(str, first['loc']))}: {first['msg']}") from err

    return restore
