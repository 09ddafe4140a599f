"""Errors of named models seed by seed, from trials.parquet of a finished run, perhaps a stranger's."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
from pyarrow import parquet

from testbench.errors import InputError
from testbench.trials.parquet import batches, open_trials
from testbench.trials.rows import SEED

MOST = 2_000_000  #: Rows that are read.
NAME = "name"


@dataclass(frozen=True)
class Series:
    """One number of one model under one condition, by seed."""

    name: str  #: Of the model.
    key: str  #: Which number.
    by_seed: dict[int, float]


def series(path: Path, keys: Sequence[str]) -> list[Series]:
    """Numbers of models by seed, of every condition that the words of a row name.

    Args:
        path: trials.parquet; its rows have a column `name`, perhaps below another name.
        keys: Columns of numbers beside it, such as "workspace.rms_mm".

    Raises:
        InputError: When the file is damaged or too large.
    """
    try:
        with open_trials(path) as file:
            if file.metadata.num_rows > MOST:
                raise InputError(path, "", f"expected at most {MOST} rows, got {file.metadata.num_rows}")
            schema = file.schema_arrow
            under = _under(schema.names, keys)
            if under is None:
                return []
            wanted = [key for key in keys if under + key in schema.names]
            words = [f.name for f in schema if _is_text(f.type) and not f.name.startswith(under)]
            numbers = [under + key for key in wanted]
            rows = _rows(file, [SEED, under + NAME, *words, *numbers])
    except (OSError, ValueError, KeyError, TypeError, pa.ArrowException) as err:
        raise InputError(path, "", f"expected trials in Parquet: {err}") from err
    conditions = list(zip(rows[under + NAME], *(rows[word] for word in words), strict=True))
    return [
        Series(name, key, by_seed)
        for key, column in zip(wanted, numbers, strict=True)
        for name, by_seed in _grouped(conditions, rows[SEED], rows[column])
    ]


def _is_text(kind: pa.DataType) -> bool:
    return bool(pa.types.is_dictionary(kind) and pa.types.is_string(kind.value_type))


def _rows(file: parquet.ParquetFile, columns: Sequence[str]) -> dict[str, list[object]]:
    """Columns of all rows; each text is held once."""
    rows: dict[str, list[object]] = {name: [] for name in columns}
    texts: dict[object, object] = {}
    for batch in batches(file, columns):
        for name, cells in batch.items():
            rows[name] += [texts.setdefault(x, x) if isinstance(x, str) else x for x in cells]
    return rows


def _under(names: Sequence[str], keys: Sequence[str]) -> str | None:
    """What stands before `name` and the keys; None where no row has a model's numbers."""
    heads = [n.removesuffix(NAME) for n in names if n == NAME or n.endswith(f".{NAME}")]
    return next((head for head in heads if any(head + key in names for key in keys)), None)


def _grouped(
    conditions: Sequence[tuple[object, ...]], seeds: Sequence[object], values: Sequence[object]
) -> list[tuple[str, dict[int, float]]]:
    """Name and finite numbers by seed of every condition; none of one that a seed has twice."""
    found: dict[tuple[object, ...], dict[int, float]] = {}
    twice = set()
    for condition, seed, value in zip(conditions, seeds, values, strict=True):
        if not isinstance(value, float) or not isinstance(seed, int) or not math.isfinite(value):
            continue
        own = found.setdefault(condition, {})
        if seed in own:
            twice.add(condition)
        own[seed] = value
    return [(c[0], own) for c, own in found.items() if c not in twice and isinstance(c[0], str)]
