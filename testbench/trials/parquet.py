"""Stored trials as one Parquet file, the same bytes whatever the order in which they came."""

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from testbench.errors import BenchError, InputError
from testbench.trials.lines import SEED, Rows
from testbench.trials.store import TrialStore

FILE = "trials.parquet"
GROUP = 2048
"""Rows of a row group: what is in memory at a time."""
NAMES = {bool: "bool", int: "int64", float: "float64", str: "string"}


def write_parquet(store: TrialStore, folder: Path) -> Path:
    """Write `trials.parquet`: rows in the order of their seeds, the store's header as metadata "testbench".

    Integers and floats in one column become floats; None, and what a row lacks, become null; NaN stays NaN.

    Args:
        store: The trials.
        folder: Where to.

    Returns:
        The file.

    Raises:
        BenchError: When a column holds both words and numbers.
        InputError: When the file cannot be written; an earlier one then stands.
    """
    import pyarrow as pa  # 0.2 s that no worker should spend
    from pyarrow import parquet

    columns = _columns(store.flat())
    schema = pa.schema(
        [(name, _type(kind)) for name, kind in columns.items()],
        metadata={"testbench": json.dumps(store.study.header, sort_keys=True)},
    )
    file = folder / FILE
    part = file.with_name(f"{FILE}.part")
    try:
        with parquet.ParquetWriter(part, schema) as writer:
            for group in _groups(store.flat()):
                table = {n: [_cast(row.get(n), kind) for row in group] for n, kind in columns.items()}
                writer.write_table(pa.table(table, schema=schema))
        part.replace(file)
    except OSError as err:
        raise InputError(file, "", f"cannot be written: {err.strerror or err}") from err
    finally:
        part.unlink(missing_ok=True)
    return file


def _columns(trials: Iterable[tuple[int, Rows]]) -> dict[str, str]:
    """Type of every column, in the order in which the seeds bring them up."""
    kinds: dict[str, set[str]] = {SEED: {"int64"}}
    for _, rows in trials:
        for row in rows:
            for name, value in row.items():
                kinds.setdefault(name, set()).update([] if value is None else [_kind(value)])
    return {name: _common(name, found) for name, found in kinds.items()}


def _kind(value: Any) -> str:
    if isinstance(value, list):
        return f"{NAMES[type(value[0])]} list" if value else "string list"
    return NAMES[type(value)]


def _type(kind: str) -> Any:
    import pyarrow as pa

    plain = pa.type_for_alias(kind.removesuffix(" list"))
    return pa.list_(plain) if kind.endswith(" list") else plain


def _common(name: str, kinds: set[str]) -> str:
    if len(kinds) <= 1:
        return next(iter(kinds), "float64")
    if kinds == {"int64", "float64"}:
        return "float64"
    raise BenchError(f"column {name!r}: expected one type in all trials, got {', '.join(sorted(kinds))}")


def _cast(value: Any, kind: str) -> Any:
    return float(value) if kind == "float64" and value is not None else value


def _groups(trials: Iterable[tuple[int, Rows]]) -> Iterator[list[dict[str, Any]]]:
    """Rows with their seeds; a trial's rows may lie in two groups."""
    group: list[dict[str, Any]] = []
    for seed, rows in trials:
        for row in rows:
            group.append({SEED: seed, **row})
            if len(group) == GROUP:
                yield group
                group = []
    if group:
        yield group
