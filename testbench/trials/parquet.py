"""All trials of a run as one Parquet file: typed rows by seed, and whose they are in its metadata."""

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain, groupby, islice, takewhile
from operator import itemgetter
from pathlib import Path
from typing import Any

import pyarrow as pa
from pyarrow import parquet

from testbench.errors import InputError
from testbench.output.whole import whole_file
from testbench.trials.experiment import check_header
from testbench.trials.rows import SEED, Column, Flat

GROUP = 2048  #: Rows of a row group: what is in memory at a time.
MOST = 100_000  #: Rows of a trial.
TYPES = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}

Trial = tuple[int, list[Flat]]  #: Seed and flat rows.


def write_trials(
    path: Path, header: Mapping[str, Any], columns: Mapping[str, Column], count: int, trials: Iterable[Trial]
) -> None:
    """Write `count` trials, of which some may have no rows, by seed: None becomes null, NaN stays NaN.

    Raises:
        InputError: When the file cannot be written; an earlier one then stands.
    """
    kinds = {name: pa.list_(TYPES[c.kind]) if c.several else TYPES[c.kind] for name, c in columns.items()}
    about = {"testbench": json.dumps(header, sort_keys=True), "trials": str(count)}
    schema = pa.schema({SEED: pa.int64(), **kinds}, about)
    with whole_file(path) as part, part.open("wb") as file:
        with parquet.ParquetWriter(file, schema, write_page_checksum=True) as writer:
            for group in _groups({SEED: seed, **row} for seed, rows in trials for row in rows):
                writer.write_table(pa.Table.from_pylist(group, schema))
        file.flush()
        os.fsync(file.fileno())


def _groups(rows: Iterator[Flat]) -> Iterator[list[Flat]]:
    while group := list(islice(rows, GROUP)):
        yield group


def read_trials(path: Path, header: Mapping[str, Any]) -> Iterator[Trial]:
    """Trials of a file of this experiment's header, a few rows at a time in memory.

    Raises:
        InputError: When it is damaged, or of another experiment.
    """
    try:
        with parquet.ParquetFile(path, page_checksum_verification=True) as file:
            about = file.schema_arrow.metadata
            check_header(path, json.loads(about[b"testbench"]), header)
            seeds = iter(range(header[SEED], header[SEED] + int(about[b"trials"])))
            rows = chain.from_iterable(batch.to_pylist() for batch in file.iter_batches(GROUP))
            last = header[SEED] - 1
            for seed, own in groupby(rows, itemgetter(SEED)):
                if type(seed) is not int or seed <= last:
                    raise ValueError(f"expected seeds that rise from {header[SEED]}, got {seed!r:.80}")
                last = seed
                yield from ((empty, []) for empty in takewhile(seed.__ne__, seeds))
                found = [{name: row[name] for name in row if name != SEED} for row in islice(own, MOST + 1)]
                if len(found) > MOST:
                    raise ValueError(f"expected at most {MOST} rows of a trial")
                yield seed, found
            yield from ((empty, []) for empty in seeds)
    except (OSError, KeyError, ValueError, TypeError, RecursionError) as err:
        raise InputError(
            path, "", f"expected trials in Parquet: {err}: it is damaged; move it away to start afresh"
        ) from err
