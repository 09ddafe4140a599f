"""Trials of a study on disk: their plan, and the store that is resumed if plan and versions are the same.

A part is a Parquet file of a chunk of trials: whole or absent after a kill, a crash or a full disk. Trials
come back in the order of their seeds, however they came. Whoever opens a store has claimed the folder of the
run (`whole.claimed`).
"""

import contextlib
import hashlib
import json
import os
import platform
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Generic, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import parquet
from pydantic import TypeAdapter

from testbench.errors import BenchError, InputError, open_file
from testbench.plant.true_arms import true_arms
from testbench.runs import manifest as files
from testbench.runs.rows import SEED, flatten, nested
from testbench.runs.whole import folder_for, writing

FORMAT = "testbench trials 5"


@dataclass(frozen=True)
class TrialPlan:
    """Describe what is tried: a scenario and its seeds."""

    name: str  #: The scenario.
    scenario: Mapping[str, Any]  #: All that the results depend on beside the seed, as plain JSON data.
    seeds: range  #: Seeds of the trials, one after the other from the root: range(root, root + trials).

    @property
    def header(self) -> dict[str, Any]:
        """Return what the store's files say of the plan: plain finite JSON data, or BenchError.

        How many trials is not in it: a study may be resumed with more.
        """
        try:
            scenario = json.dumps(self.scenario, sort_keys=True, separators=(",", ":"), allow_nan=False)
        except (TypeError, ValueError) as err:
            raise BenchError(f"scenario: expected plain JSON data: {err}") from err
        return {
            "format": FORMAT,
            "scenario": self.name,
            "sha256": hashlib.sha256(scenario.encode()).hexdigest(),
            SEED: self.seeds[0],
            "versions": numeric_versions(),
            "settings": json.loads(scenario),
        }


def numeric_versions() -> dict[str, str]:
    """List the versions of Python, of packages that compute and of our sources, which may change results."""
    packages = {k: v for k, v in files.versions(true_arms).items() if k != "rerun-sdk"}
    python = ".".join(platform.python_version_tuple()[:2])  # without the number of the bug fix
    return {"python": python, **packages, "sources": files.sources()}


def check_header(path: Path, found: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    """Refuse to go on with trials of something else: InputError names what differs in their header.

    Args:
        path: The file, for the message.
        found: Header of the stored trials.
        wanted: Header of this run.
    """
    pairs = {
        "format": (found.get("format"), wanted["format"]),
        "scenario": (found.get("scenario"), wanted["scenario"]),
        **_differences("", found.get("settings"), wanted["settings"]),
        "sha256 of the settings": (found.get("sha256"), wanted["sha256"]),
        "root seed": (found.get(SEED), wanted[SEED]),
        **_differences("version of ", found.get("versions"), wanted["versions"]),
    }
    for name, (have, want) in pairs.items():
        if have != want:
            raise InputError(
                path,
                "",
                f"{name}: {_shown(have)} in the stored trials, {_shown(want)} in this run; "
                "resume with the same settings, or choose another folder",
            )


def _shown(value: object) -> str:
    """Write a value of a header for a message."""
    return "not set" if value is None else repr(value)


def _differences(prefix: str, have: object, want: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    """Pairs of values by key, of both sides."""
    known = have if isinstance(have, dict) else {}
    return {f"{prefix}{key}": (known.get(key), want.get(key)) for key in sorted({*known, *want})}


GROUP = 2**15  #: Rows of a row group.
MAX_BYTES = 10**10  #: Of a file.
MAX_UNPACKED = 2 * 10**10  #: Bytes of all columns of a file.
MAX_COMPARED_ROWS = 2_000_000  #: Rows whose numbers are compared by seed.
MODEL = "name"  #: Column of models.
TYPES = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}


def column_types(row: type, prefix: str = "") -> dict[str, pa.DataType]:
    """Choose the types of the columns of a dataclass of rows, see `flatten`, from the types of its fields.

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
    found: dict[str, pa.DataType] = {}
    for name, hint in get_type_hints(row).items():
        kinds = _alternatives(hint)
        several = [own for own in kinds if get_origin(own) is tuple]
        if len(kinds) == 1 and is_dataclass(own := next(iter(kinds))):
            found |= column_types(own, f"{prefix}{name}.")  # type: ignore[arg-type]  # no instance of it
        elif several:
            found[prefix + name] = pa.list_(_column_type(_alternatives(get_args(several[0])[0])))
        else:
            found[prefix + name] = _column_type(kinds)
    if SEED in found:
        raise BenchError(f"{row.__name__}: expected columns with names other than {SEED!r}")
    return found


def _alternatives(annotation: Any) -> set[Any]:
    """Of float | None the float."""
    kinds = get_args(annotation) if get_origin(annotation) in (Union, UnionType) else (annotation,)
    return {*kinds} - {NoneType}


def _column_type(kinds: set[Any]) -> pa.DataType:
    """Type of cells that are of one of some types, without None."""
    plain = {type(get_args(own)[0]) if get_origin(own) is Literal else own for own in kinds}
    plain = {own for own in plain if not is_dataclass(own)}
    for wide, both in ((float, {float, int}), (bool, {float, bool})):
        plain = {wide} if plain == both else plain
    if len(plain) != 1 or not plain <= TYPES.keys():
        raise BenchError(f"rows: expected a type of numbers or words, got {kinds}")
    return TYPES[plain.pop()]


def arrow_table(row: type, trials: Iterable[tuple[int, Sequence[object]]]) -> pa.Table:
    """Collect the rows of trials in one table: None becomes null, NaN stays NaN.

    Args:
        row: Dataclass of a row.
        trials: Seed and rows of each, of which some may have none.

    Returns:
        The table.

    Raises:
        BenchError: When rows are not of that dataclass, or cells not of their column's type.
    """
    schema = pa.schema({SEED: pa.int64(), **column_types(row)})
    flat = []
    for seed, rows in trials:
        if wrong := {type(own).__name__ for own in rows if type(own) is not row}:
            raise BenchError(f"rows: expected {row.__name__}, got {', '.join(sorted(wrong))}")
        flat += [{SEED: seed, **dict(flatten(own))} for own in rows]
    found = []
    for field in schema:
        cells = [own.get(field.name) for own in flat]
        try:
            found.append(pa.array(cells, field.type))
            if pa.types.is_integer(field.type) and found[-1].to_pylist() != cells:
                raise OverflowError("a fraction cannot be stored in an integer column")
        except (pa.ArrowException, OverflowError, UnicodeEncodeError) as err:
            raise BenchError(f"rows: {field.name}: expected {field.type}: {err}") from err
    return pa.table(found, schema=schema)


def labelled(table: pa.Table, **about: Any) -> pa.Table:
    """Replace the metadata of a table.

    Args:
        table: The table.
        about: Metadata, plain JSON data.

    Returns:
        The table with the new metadata.
    """
    return table.replace_schema_metadata(
        {key: json.dumps(value, sort_keys=True) for key, value in about.items()}
    )


def write_trials(path: Path, table: pa.Table) -> None:
    """Write a table of trials; the same rows give the same bytes, and a kill leaves no half of them.

    Args:
        path: Path of the file.
        table: Rows of the trials.

    Raises:
        InputError: When the file cannot be written; an earlier one then stands.
    """
    part = path.with_name(f"{path.name}.part")
    words = [field.name for field in table.schema if pa.types.is_string(field.type)]
    with writing(path):
        try:
            with part.open("wb") as file:
                parquet.write_table(
                    table, file, row_group_size=GROUP, write_page_checksum=True, use_dictionary=words
                )
                file.flush()
                os.fsync(file.fileno())
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)


@contextmanager
def _opened(path: Path) -> Iterator[parquet.ParquetFile]:
    """Open a file of trials after a look at its size; InputError where the block finds it damaged."""
    try:
        with open_file(path, MAX_BYTES):
            pass  # a plain file
        with parquet.ParquetFile(path, page_checksum_verification=True) as file:
            about = file.metadata
            unpacked = sum(about.row_group(k).total_byte_size for k in range(about.num_row_groups))
            if unpacked > MAX_UNPACKED:
                raise ValueError(f"expected at most {MAX_UNPACKED} bytes unpacked, got {unpacked}")
            yield file
    except (OSError, KeyError, ValueError, TypeError, RecursionError, pa.ArrowException) as err:
        problem = f"expected trials in Parquet: {err}: it is damaged; move it away to start afresh"
        raise InputError(path, "", problem) from err


def read_about(path: Path, *keys: str) -> list[Any]:
    """Read entries of a file's metadata.

    Args:
        path: Path of the file.
        keys: Keys of the entries.

    Returns:
        Their values.

    Raises:
        InputError: When it is damaged, or no file of trials.
    """
    with _opened(path) as file:
        about = file.schema_arrow.metadata or {}
        return [json.loads(about[key.encode()]) for key in keys]


def read_trials(path: Path, schema: pa.Schema) -> pa.Table:
    """Read a file of trials.

    Args:
        path: A file of `write_trials`.
        schema: Of the trials, from `arrow_table`.

    Returns:
        Rows of the trials.

    Raises:
        InputError: When it is damaged, or has other columns.
    """
    with _opened(path) as file:
        found = file.read(use_threads=False)
        if not found.schema.equals(schema):
            differ = sorted({*found.schema.names} ^ {*schema.names}) or ["types of columns"]
            raise ValueError(f"expected the columns of this study; these differ: {', '.join(differ)}")
        return found


def series(path: Path, keys: Mapping[str, str]) -> dict[tuple[str, str], list[dict[int, float]]]:
    """Read numbers of models by seed, of every condition that the words of a row name.

    Args:
        path: trials.parquet, perhaps of another study than ours.
        keys: Columns of the numbers beside that of the model's name, each by what it is called.

    Returns:
        Finite numbers by seed, a condition each, by model and what they are called.

    Raises:
        InputError: When the file is damaged.
    """
    found: dict[tuple[str, str], list[dict[int, float]]] = {}
    with _opened(path) as file:
        if file.metadata.num_rows > MAX_COMPARED_ROWS:
            raise ValueError(f"expected at most {MAX_COMPARED_ROWS} rows, got {file.metadata.num_rows}")
        schema = file.schema_arrow
        texts = [own.name for own in schema if pa.types.is_string(own.type)]
        heads = [name.removesuffix(MODEL) for name in texts if f".{name}".endswith(f".{MODEL}")]
        under = next((head for head in heads if any(head + key in schema.names for key in keys.values())), "")
        wanted = {own: under + key for own, key in keys.items() if heads and under + key in schema.names}
        words = [under + MODEL, *(name for name in texts if not name.startswith(under))] if wanted else []
        cells = file.read([SEED, *words, *wanted.values()], use_threads=False)
        for name, key in wanted.items():
            known = cells.filter(pc.is_finite(pc.field(key)))
            conditions = known.group_by(words, use_threads=False).aggregate([(SEED, "list"), (key, "list")])
            for row in conditions.to_pylist():
                seeds, numbers = row[f"{SEED}_list"], row[f"{key}_list"]
                if len({*seeds}) == len(seeds):  # else the words do not name all of the condition
                    own = found.setdefault((row[under + MODEL], name), [])
                    own.append(dict(zip(seeds, numbers, strict=True)))
    return found


PARTS, WHOLE = "trials", "trials.parquet"
"""Folder with the trials of a run that is under way, and file of one that has come to its end."""
HEADER, SEEDS = "testbench", "seeds"
"""Keys of a part's metadata: what the trials are of, and which they are."""

R = TypeVar("R")


def part_seeds(part: Path) -> list[int]:
    """Read which trials a part holds; InputError where it is none."""
    return [int(seed) for seed in read_about(part, SEEDS)[0]]


class TrialStore(Generic[R]):
    """Store the trials of an experiment. Open one with `open_store`."""

    def __init__(self, folder: Path, experiment: TrialPlan, row: type[R]) -> None:
        self.parts = folder / PARTS
        self.experiment = experiment
        self.row = row
        self.header = experiment.header
        self.schema = arrow_table(row, []).schema
        self.done: set[int] = set()
        self.held = False  #: Whether there are trials that no finished run beside the parts has.
        self.finished = False

    @property
    def count(self) -> int:
        """Count the trials of the experiment that are stored."""
        return len(self.done)

    def missing(self) -> list[int]:
        """List the seeds that are not stored, in order."""
        return [seed for seed in self.experiment.seeds if seed not in self.done]

    def rows(self) -> list[R]:
        """Return stored rows as they were returned, in the order of the seeds."""
        flat = self.table().drop_columns(SEED).to_pylist()
        return TypeAdapter(list[self.row]).validate_python(list(map(nested, flat)))  # type: ignore[name-defined]

    def table(self) -> pa.Table:
        """Return stored rows of the experiment as a table, in the order of the seeds."""
        parts = [read_trials(path, self.schema) for path in self.parts.glob("*.parquet")]
        seeds, seed = self.experiment.seeds, pc.field(SEED)
        table = pa.concat_tables([self.schema.empty_table(), *parts])
        return table.filter((seed >= seeds[0]) & (seed <= seeds[-1])).sort_by(SEED)

    def append(self, seeds: Sequence[int], found: Iterable[Sequence[object]]) -> None:
        """Add finished trials' rows, from `engine.do_chunk`; they are on the disk when this returns.

        Args:
            seeds: Seeds of the trials.
            found: Rows of every seed.

        Raises:
            BenchError: When rows are not of the store's type.
            InputError: When the part cannot be written; the store then holds what it held before.
        """
        self._write(seeds, arrow_table(self.row, zip(seeds, found, strict=True)))
        self.held = True

    def load(self, *, resume: bool) -> None:
        """Find the trials of a run that was stopped or has ended; InputError where `open_store` says."""
        parts, whole = sorted(self.parts.glob("*.parquet")), self.parts.with_name(WHOLE)
        self.held = bool(parts)
        if parts:
            held = [seed for path in parts for seed in part_seeds(path)]
            if not resume:
                problem = f"holds {len(held)} trials of a stopped run: --resume continues it"
                afresh = "to start again, choose another folder or remove this one"
                raise InputError(self.parts, "", f"{problem}; {afresh}")
            check_header(self.parts, read_about(parts[0], HEADER)[0], self.header)
            self.done = set(held) & set(self.experiment.seeds)
        elif resume and os.path.lexists(whole):
            theirs, count = read_about(whole, HEADER, "trials")
            check_header(whole, theirs, self.header)
            self._write(range(theirs[SEED], theirs[SEED] + count), read_trials(whole, self.schema))

    def _write(self, seeds: Sequence[int], table: pa.Table) -> None:
        about = {HEADER: self.header, SEEDS: list(seeds)}
        write_trials(self.parts / f"{seeds[0]}.parquet", labelled(table, **about))
        self.done |= set(seeds) & set(self.experiment.seeds)


def write_parquet(store: TrialStore[R], folder: Path) -> Path:
    """Write `trials.parquet`, the same bytes in whatever order the trials came.

    Args:
        store: The stored trials.
        folder: Folder of the file.

    Returns:
        Path of the file.
    """
    about = {HEADER: store.header, "trials": store.count}
    write_trials(folder / WHOLE, labelled(store.table(), **about))
    store.finished = store.count == len(store.experiment.seeds)
    return folder / WHOLE


@contextlib.contextmanager
def open_store(folder: Path, experiment: TrialPlan, *, row: type[R], resume: bool) -> Iterator[TrialStore[R]]:
    """Open the trial store of a run's folder; once the block has ended well `trials.parquet` takes its place.

    To resume is to go on with the stored trials; without any it starts afresh.

    Args:
        folder: Folder of the run.
        experiment: Scenario and seeds.
        row: Dataclass of a row.
        resume: Whether stored trials are kept.

    Yields:
        The store.

    Raises:
        InputError: When it cannot be written or is damaged; when it holds trials of something else (resume),
            or of a run that was stopped (no resume).
    """
    store = TrialStore(folder, experiment, row)
    with folder_for(store.parts):
        try:
            store.load(resume=resume)
            yield store
            if store.finished and store.parts.with_name(WHOLE).exists():
                store.held = False
        finally:
            if not store.held:
                shutil.rmtree(store.parts, ignore_errors=True)
