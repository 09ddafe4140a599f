"""All trials of a run as one Parquet file: typed rows by seed, and whose they are in its metadata."""

import contextlib
import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, takewhile
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import parquet

from testbench.errors import InputError, open_file
from testbench.output.whole import whole_file
from testbench.trials.experiment import check_header
from testbench.trials.rows import SEED, Column, Table, count

GROUP = 2**15  #: Rows of a row group, at least: with those of one trial what is in memory at a time.
MOST = 100_000  #: Rows of a trial.
MOST_BYTES = 10**10  #: Of a file.
MOST_COLUMNS = 2000
MOST_OF_GROUP = 500_000_000  #: Bytes of a row group.
MOST_CELLS = 50_000_000  #: Of a row group: those of lists, too, of which equal ones take no bytes.
MOST_LETTERS = 100_000_000  #: Of the texts in as many rows as a row group has.
MOST_READ = 2_000_000  #: Rows that are read by seed.
NAME = "name"  #: Column of models.
TYPES = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}

Trial = tuple[int, Table]  #: Seed and rows by column.


def write_trials(
    path: Path, header: Mapping[str, Any], columns: Mapping[str, Column], held: int, trials: Iterable[Trial]
) -> None:
    """Write so many trials, of which some may have no rows, by seed: None becomes null, NaN stays NaN.

    Raises:
        InputError: When the file cannot be written; an earlier one then stands.
    """
    kinds = {name: pa.list_(TYPES[c.kind]) if c.several else TYPES[c.kind] for name, c in columns.items()}
    about = {"testbench": json.dumps(header, sort_keys=True), "trials": str(held)}
    schema = pa.schema({SEED: pa.int64(), **kinds}, about)
    with whole_file(path) as part, part.open("wb") as file:
        words = [name for name, column in columns.items() if column.kind is str]
        with parquet.ParquetWriter(file, schema, write_page_checksum=True, use_dictionary=words) as writer:
            for group in _groups(schema.names, trials):
                writer.write_table(pa.table(group, schema))
        file.flush()
        os.fsync(file.fileno())


def _groups(names: Iterable[str], trials: Iterable[Trial]) -> Iterator[Table]:
    """Columns of as many whole trials as make a row group."""
    group: Table = {name: [] for name in names}
    for seed, table in trials:
        group[SEED] += [seed] * count(table)
        for name, cells in table.items():
            group[name] += cells
        if len(group[SEED]) >= GROUP:
            yield group
            group = {name: [] for name in group}
    if group[SEED]:
        yield group


@contextlib.contextmanager
def open_trials(path: Path) -> Iterator[parquet.ParquetFile]:
    """A stranger's file of trials, after a look at what it says of its sizes.

    Raises:
        InputError: When it is no plain file.
        ValueError: When it says that it has other or more columns or larger row groups than trials have.
    """
    with open_file(path, MOST_BYTES):
        pass  # a plain file
    about = parquet.read_metadata(path)
    _check_sizes(about)
    columns = [about.schema.column(j) for j in range(about.num_columns)]
    texts = [column.path for column in columns if column.physical_type == "BYTE_ARRAY"]
    with parquet.ParquetFile(path, page_checksum_verification=True, read_dictionary=texts) as file:
        yield file


def _check_sizes(about: parquet.FileMetaData) -> None:
    if about.num_columns > MOST_COLUMNS:
        raise ValueError(f"expected at most {MOST_COLUMNS} columns, got {about.num_columns}")
    for field in about.schema.to_arrow_schema():
        kind = field.type.value_type if pa.types.is_list(field.type) else field.type
        if kind not in TYPES.values():
            raise ValueError(f"column {field.name[:80]}: expected numbers, words or truth values")
    for k in range(about.num_row_groups):
        group = about.row_group(k)
        columns = [group.column(j) for j in range(about.num_columns)]
        if sum(column.total_uncompressed_size for column in columns) > MOST_OF_GROUP:
            raise ValueError(f"row group {k + 1}: expected at most {MOST_OF_GROUP} bytes")
        if group.num_rows > GROUP + MOST or sum(column.num_values for column in columns) > MOST_CELLS:
            sizes = f"{GROUP + MOST} rows and {MOST_CELLS} cells"
            raise ValueError(f"row group {k + 1}: expected at most {sizes}")


def batches(file: parquet.ParquetFile, columns: Sequence[str]) -> Iterator[dict[str, list[Any]]]:
    """Some columns, as many rows at a time as a row group has.

    Raises:
        ValueError: When their texts are longer than those of trials: a word is stored once, however often
            it is used.
    """
    for batch in file.iter_batches(GROUP, columns=list(columns)):
        letters = 0
        for column in batch.columns:
            cells = column.flatten() if pa.types.is_list(column.type) else column
            if pa.types.is_dictionary(cells.type):
                lengths = pc.binary_length(cells.dictionary).cast(pa.int64())
                letters += pc.sum(lengths.take(cells.indices)).as_py() or 0
        if letters > MOST_LETTERS:
            raise ValueError(f"expected texts of at most {MOST_LETTERS} letters in {len(batch)} rows")
        yield batch.to_pydict()


def read_trials(path: Path, header: Mapping[str, Any]) -> Iterator[Trial]:
    """Trials of a file of this experiment's header, a few rows at a time in memory.

    Raises:
        InputError: When it is damaged, or of another experiment.
    """
    try:
        with open_trials(path) as file:
            about = file.schema_arrow.metadata
            check_header(path, json.loads(about[b"testbench"]), header)
            seeds = iter(range(header[SEED], header[SEED] + int(about[b"trials"])))
            last = header[SEED] - 1
            for seed, table in _whole(_parts(file)):
                if type(seed) is not int or seed <= last:
                    raise ValueError(f"expected seeds that rise from {header[SEED]}, got {seed!r:.80}")
                last = seed
                yield from ((empty, {}) for empty in takewhile(seed.__ne__, seeds))
                yield seed, table
            yield from ((empty, {}) for empty in seeds)
    except (OSError, KeyError, ValueError, TypeError, RecursionError, pa.ArrowException) as err:
        raise InputError(
            path, "", f"expected trials in Parquet: {err}: it is damaged; move it away to start afresh"
        ) from err


def _parts(file: parquet.ParquetFile) -> Iterator[Trial]:
    """Seeds and their rows as they stand, cut where one seed ends or a batch does."""
    for columns in batches(file, file.schema_arrow.names):
        start = 0
        for seed, own in groupby(columns.pop(SEED)):
            end = start + sum(1 for _ in own)
            yield seed, {name: cells[start:end] for name, cells in columns.items()}
            start = end


def _whole(parts: Iterable[Trial]) -> Iterator[Trial]:
    """Parts of the same seed, one behind the other, as one."""
    for seed, own in groupby(parts, lambda part: part[0]):
        table: Table = {}
        for _, more in own:
            table = {name: table.get(name, []) + cells for name, cells in more.items()}
            if count(table) > MOST:
                raise ValueError(f"expected at most {MOST} rows of a trial")
        yield seed, table


@dataclass(frozen=True)
class Series:
    """One number of one model under one condition, by seed."""

    name: str  #: Of the model.
    key: str  #: Which number.
    by_seed: dict[int, float]


def series(path: Path, keys: Sequence[str]) -> list[Series]:
    """Numbers of models by seed, of every condition that the words of a row name, perhaps a stranger's.

    Args:
        path: trials.parquet; its rows have a column `name`, perhaps below another name.
        keys: Columns of numbers beside it, such as "workspace.rms_mm".

    Raises:
        InputError: When the file is damaged or too large.
    """
    found: dict[tuple[str, tuple[Any, ...]], dict[int, float]] = {}
    try:
        with open_trials(path) as file:
            if file.metadata.num_rows > MOST_READ:
                problem = f"expected at most {MOST_READ} rows, got {file.metadata.num_rows}"
                raise InputError(path, "", problem)
            names = file.schema_arrow.names
            heads = [n.removesuffix(NAME) for n in names if n == NAME or n.endswith(f".{NAME}")]
            under = next((head for head in heads if any(head + key in names for key in keys)), "")
            wanted = [key for key in keys if heads and under + key in names]
            texts = [f.name for f in file.schema_arrow if pa.types.is_dictionary(f.type)]
            words = [under + NAME, *(name for name in texts if not name.startswith(under))]
            columns = [SEED, *words, *(under + key for key in wanted)] if wanted else []
            for batch in batches(file, columns) if wanted else ():
                conditions = list(zip(*(batch[word] for word in words), strict=True))
                for key in wanted:
                    for row in zip(conditions, batch[SEED], batch[under + key], strict=True):
                        _put(found.setdefault((key, row[0]), {}), *row[1:])
    except (OSError, ValueError, KeyError, TypeError, pa.ArrowException) as err:
        raise InputError(path, "", f"expected trials in Parquet: {err}") from err
    return [
        Series(condition[0], key, own)
        for key in keys
        for (of, condition), own in found.items()
        if of == key and own and isinstance(condition[0], str) and not any(map(math.isnan, own.values()))
    ]


def _put(own: dict[int, float], seed: object, value: object) -> None:
    """A finite number; NaN where a seed has two."""
    if isinstance(value, float) and isinstance(seed, int) and math.isfinite(value):
        own[seed] = math.nan if seed in own else value
