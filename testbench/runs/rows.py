"""A trial's random numbers, and its rows by column, and back.

Rows are frozen dataclasses, nested ones dotted columns.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from typing import Any

import numpy as np

SEED = "seed"


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


def flatten(row: object, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Walk a dataclass to its values: `check.rms_mm` is the field rms_mm of the field check.

    Args:
        row: The dataclass.
        prefix: Text before every name.

    Yields:
        Name and value of a column; a nested dataclass that is None is one value.
    """
    for name, value in vars(row).items():
        if is_dataclass(value):
            yield from flatten(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def nested(flat: Mapping[str, Any]) -> Row:
    """Nest columns with dots in their names as rows within the row."""
    found = Row()
    for name, value in flat.items():
        *parts, last = name.split(".")
        row = found
        for part in parts:
            row = row.setdefault(part, Row())
        row[last] = value
    return found
