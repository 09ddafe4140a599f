"""The trial store and its Parquet files: what is stored comes back, what is damaged or foreign is refused."""

import errno
import hashlib
import json
import math
import os
import zlib
from dataclasses import dataclass, replace
from typing import Literal
from unittest import mock

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from testbench.errors import BenchError, InputError
from testbench.trials.engine import do_chunk
from testbench.trials.experiment import Experiment
from testbench.trials.parquet import batches, open_trials, series
from testbench.trials.spread import Number, Share
from testbench.trials.store import (
    FILE,
    HEADER,
    MAGIC,
    WHOLE,
    open_store,
    pack,
    record,
    records,
    write_parquet,
)

TOY = Experiment("toy", {"load": {"mass": 2.0}, "poses": [1, 2]}, range(7, 12))


@dataclass(frozen=True)
class X:
    x: float


@dataclass(frozen=True)
class Fit:
    rms_mm: float
    rank: int | None


@dataclass(frozen=True)
class Full:
    pi: float
    least: float
    minus: float
    nan: float | None
    inf: float | int
    count: int
    yes: bool
    word: str
    none: float | None
    part: Literal["check", "workspace"]
    several: tuple[float, ...]
    names: tuple[str, ...] | None
    check: Fit
    workspace: Fit | None
    trials: Number
    holds: Share
    bounds: tuple[Number, ...] | None


FULL = Full(
    pi=math.pi, least=5e-324, minus=-0.0, nan=math.nan, inf=-math.inf, count=np.int64(-(2**63)),
    yes=np.bool_(True), word="a\nb, \u00b5m", none=None, part="check", several=(1.5, math.nan), names=None,
    check=Fit(0.1, None), workspace=None, trials=0.5, holds=True, bounds=(1.0, None),
)  # fmt: skip


def put(store, found):
    """Store rows by seed, as a chunk does."""
    chunk = do_chunk(lambda seeds: [found[s] for s in seeds], tuple(found))
    assert not chunk.problem, chunk.problem
    store.append(chunk.seeds, chunk.found)


def fill(folder, seeds, experiment=TOY, resume=False):
    """A run of some seeds; one that is whole leaves the whole file."""
    with open_store(folder, experiment, row=X, resume=resume) as store:
        for seed in seeds:
            put(store, {seed: [X(seed / 3)]})
        if store.count == len(experiment.seeds):
            write_parquet(store, folder)


def missing(folder, experiment=TOY):
    with open_store(folder, experiment, row=X, resume=True) as store:
        return list(store.missing())


def files(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_every_kind_of_value_comes_back_bit_by_bit(tmp_path):
    with open_store(tmp_path, TOY, row=Full, resume=False) as store:
        put(store, {9: [FULL], 7: []})
    with open_store(tmp_path, TOY, row=Full, resume=True) as store:
        assert list(store.missing()) == [8, 10, 11]
        assert repr(list(store.trials())) == repr([(7, ()), (9, (replace(FULL, count=-(2**63), yes=True),))])


def test_columns_have_the_types_of_the_fields_even_without_a_value(tmp_path):
    with open_store(tmp_path, Experiment("toy", {}, range(1)), row=Full, resume=False) as store:
        put(store, {0: []})
        schema = pq.read_schema(write_parquet(store, tmp_path))
    kinds = {f.name: str(f.type).replace("element", "item") for f in schema}
    assert kinds == {
        "seed": "int64", "pi": "double", "least": "double", "minus": "double", "nan": "double",
        "inf": "double", "count": "int64", "yes": "bool", "word": "string", "none": "double",
        "part": "string", "several": "list<item: double>", "names": "list<item: string>",
        "check.rms_mm": "double", "check.rank": "int64",
        "workspace.rms_mm": "double", "workspace.rank": "int64", "trials": "double", "holds": "bool",
        "bounds": "list<item: double>",
    }  # fmt: skip


def test_parquet_does_not_depend_on_order_or_where_it_stopped(tmp_path):
    found = {s: [X(s / 3), X(math.nan)] for s in TOY.seeds}
    written = []
    for name, order in (("a", [7, 8, 9, 10, 11]), ("b", [10, 7, 11, 9, 8])):
        for own in (order[:3], order[3:]):
            with open_store(tmp_path / name, TOY, row=X, resume=own == order[3:]) as store:
                for seed in own:
                    put(store, {seed: found[seed]})
                if own == order[3:]:
                    written.append(write_parquet(store, tmp_path / name))
    assert written[0].read_bytes() == written[1].read_bytes()
    table = pq.read_table(written[0])
    assert table["seed"].to_pylist() == [s for s in TOY.seeds for _ in range(2)]
    assert [x for x in table["x"].to_pylist() if not math.isnan(x)] == [s / 3 for s in TOY.seeds]
    assert json.loads(table.schema.metadata[b"testbench"])["settings"] == TOY.scenario


def test_a_finished_run_is_resumed_with_all_its_trials_also_those_without_rows(tmp_path):
    rows = {7: [], 8: [FULL, replace(FULL, several=(), names=("a", "b"))], 9: [], 10: [FULL], 11: []}
    with open_store(tmp_path, TOY, row=Full, resume=False) as store:
        put(store, rows)
        write_parquet(store, tmp_path)
        before = list(store.trials())
    more = Experiment("toy", TOY.scenario, range(7, 14))
    with open_store(tmp_path, more, row=Full, resume=True) as store:
        assert list(store.missing()) == [12, 13]
        assert repr(list(store.trials())) == repr(before)
    assert [len(own) for _, own in before] == [len(own) for own in rows.values()]


def test_many_rows_go_through_several_row_groups(tmp_path, monkeypatch):
    """Of whole trials; read back in batches that cut trials."""
    monkeypatch.setattr("testbench.trials.parquet.GROUP", 1000)
    with open_store(tmp_path, TOY, row=X, resume=False) as store:
        put(store, {s: [X(1000 * s + k) for k in range(900)] for s in TOY.seeds})
        file = pq.ParquetFile(write_parquet(store, tmp_path))
        assert [len(rows) for _, rows in store.trials()] == [900] * 5
    assert [file.metadata.row_group(k).num_rows for k in range(3)] == [1800, 1800, 900]
    with open_store(tmp_path / "again", TOY, row=X, resume=False) as store:
        (tmp_path / WHOLE).rename(tmp_path / "again" / WHOLE)
        store.load(resume=True)
        assert [[row.x for row in rows] for _, rows in store.trials()] == [
            [1000 * s + k for k in range(900)] for s in TOY.seeds
        ]
    assert file.read()["x"].to_pylist() == [1000 * s + k for s in TOY.seeds for k in range(900)]


@pytest.mark.parametrize(
    ("rows", "problem"),
    [
        ([X(np.zeros(2))], "rows: x: expected a number, a word or None, got ndarray"),
        ([{"x": 1}], "rows: expected dataclasses, got dict"),
    ],
)
def test_rows_that_are_none_are_told_by_the_worker(rows, problem):
    chunk = do_chunk(lambda seeds: [rows for _ in seeds], (7,))
    assert chunk.problem == f"seeds 7 to 7: {problem}"


def test_work_that_forgets_a_seed_is_told():
    assert "expected rows for 2 trials, got 1" in do_chunk(lambda _: [[]], (7, 8)).problem


@pytest.mark.parametrize(
    ("row", "problem"),
    [
        (replace(FULL, count=1.5), "rows: count: expected int, got 1.5"),
        (replace(FULL, pi=True), "rows: pi: expected float, got True"),
        (replace(FULL, several=(1.0, "b")), "rows: several: expected a tuple of float, got 'b'"),
        (replace(FULL, count=2**63), "rows: count: expected int, got 9223"),
        (replace(FULL, part="chuck"), "rows: part: expected 'check' or 'workspace', got 'chuck'"),
        (replace(FULL, word=None), "rows: word: expected str, got None"),
        (X(1.0), "rows: expected the columns of one dataclass, they differ in bounds, check.rank"),
    ],
)
def test_rows_of_another_type_are_refused_and_what_is_stored_stays(tmp_path, row, problem):
    with open_store(tmp_path, TOY, row=Full, resume=False) as store:
        put(store, {7: [FULL]})
        with pytest.raises(BenchError, match=problem):
            put(store, {8: [row]})
        assert list(store.missing()) == [8, 9, 10, 11]
        assert [seed for seed, _ in store.trials()] == [7]


@dataclass(frozen=True)
class Listed:
    x: list


@dataclass(frozen=True)
class Mixed:
    x: float | str


@dataclass(frozen=True)
class Seeded:
    seed: int


@pytest.mark.parametrize("row", [Listed, Mixed, Seeded])
def test_dataclasses_that_are_no_table_are_refused(tmp_path, row):
    with pytest.raises(BenchError, match="expected"), open_store(tmp_path / "a", TOY, row=row, resume=False):
        pass
    assert not (tmp_path / "a").exists()


def opened(path):
    """Header and records of a store: seed, checksum, rows."""
    with path.open("rb") as file:
        file.seek(len(MAGIC))
        return [tuple(own) for _, *own in records(file)]


def closed(path, own):
    path.write_bytes(MAGIC + b"".join(record(seed, rows, sha256) for seed, sha256, rows in own))


def checksum(seed, rows, header=TOY.header):
    return hashlib.sha256(f"{json.dumps(header, sort_keys=True)}{seed} ".encode() + rows).digest()


def signed(text):
    return HEADER, hashlib.sha256(text).digest(), text


ONE, NOISE = pack({"x": [1.0]}), bytes(32)
EDITS = {
    "the seed": (lambda head, a, b: [head, a, (9, *b[1:])], "seed 9: expected what"),
    "swapped": (lambda head, a, b: [head, (7, *b[1:]), (8, *a[1:])], "seed 7: expected what"),
    "no header": (lambda _, a, b: [a, b], "it has no header"),
    "two headers": (lambda head, *own: [head, head, *own], "seed -1: expected what"),
    "an edited header": (lambda head, *own: [(*head[:2], head[2] + b" "), *own], "it has no header"),
    "a deep header": (lambda _, *own: [signed(b"[" * 100_000), *own], "expected a store of trials"),
    "a header of another type": (lambda _, *own: [signed(b"[]"), *own], "no table of keys"),
    "no text": (lambda *own: [*own, forged(zlib.compress(b"\xff"))], "expected a store of trials"),
    "not packed": (lambda *own: [*own, forged(b'{"x": [1.0]}')], "packed rows"),
    "cut": (lambda *own: [*own, forged(ONE[:-1])], "packed rows"),
    "more behind": (lambda *own: [*own, forged(ONE + b"!")], "packed rows"),
}
"""Edits of header and two trials, and what is said; tests/hostile/test_stores.py has more."""


def forged(rows):
    return 9, checksum(9, rows), rows


@pytest.mark.parametrize("edit", EDITS)
def test_a_store_that_was_edited_or_forged_is_one_line_and_left_alone(tmp_path, edit):
    fill(tmp_path, [7, 8])
    change, said = EDITS[edit]
    closed(tmp_path / FILE, change(*opened(tmp_path / FILE)))
    before = files(tmp_path)
    with pytest.raises(InputError, match=r"trials\.log") as caught:
        missing(tmp_path)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert files(tmp_path) == before


@pytest.mark.parametrize("cut", [-1, -60, None, 0])
@pytest.mark.parametrize("more", [b"", bytes(100)])
def test_what_a_kill_cut_short_is_done_again(tmp_path, cut, more):
    """In the last trial, before it, in the header, at the beginning; zeros behind it after a crash."""
    fill(tmp_path, [7, 8])
    data, head = (tmp_path / FILE).read_bytes(), len(MAGIC) + 20
    kept = data[:head] if cut is None else data[:cut] if cut else b""
    (tmp_path / FILE).write_bytes(kept + (more if cut else b""))
    if not (more and cut == -1):  # zeros in place of rows are no cut
        left = [8, 9, 10, 11] if cut in (-1, -60) else list(TOY.seeds)
        assert missing(tmp_path) == left
        fill(tmp_path, left, resume=True)
        assert set(files(tmp_path)) == {WHOLE}


def test_a_finished_run_that_was_edited_is_not_resumed(tmp_path):
    fill(tmp_path, TOY.seeds)
    said = {"command": "toy", "versions": {"testbench": "0"}}
    digests = {"sha256": {WHOLE: hashlib.sha256((tmp_path / WHOLE).read_bytes()).hexdigest()}}
    (tmp_path / "manifest.json").write_text(json.dumps(said | digests))
    assert missing(tmp_path) == []
    table = pq.read_table(tmp_path / WHOLE)
    edited = pa.Table.from_pylist([{**row, "x": 1.0} for row in table.to_pylist()], table.schema)
    pq.write_table(edited, tmp_path / WHOLE, write_page_checksum=True)
    before = files(tmp_path)
    with pytest.raises(InputError, match=r"trials\.parquet: expected what its run left"):
        missing(tmp_path)
    assert files(tmp_path) == before


PLACES = {
    "dangling": lambda path, own: path.symlink_to(own.with_name("none")),
    "hard link": lambda path, own: os.link(own, path),
    "sparse": lambda path, own: (path.touch(), os.truncate(path, 2**36)),
}


@pytest.mark.parametrize("resume", [False, True])
@pytest.mark.parametrize("kind", PLACES)
def test_what_is_no_store_is_one_line_and_left_alone(tmp_path, kind, resume):
    fill(tmp_path / "other", [7, 8])
    (tmp_path / "run").mkdir()
    PLACES[kind](tmp_path / "run" / FILE, tmp_path / "other" / FILE)
    before, status = files(tmp_path / "other"), (tmp_path / "run" / FILE).lstat()
    with pytest.raises(InputError, match=r"run/trials\.log: .*move it away"):
        fill(tmp_path / "run", [9], resume=resume)
    assert files(tmp_path / "other") == before
    assert list((tmp_path / "run").iterdir()) == [tmp_path / "run" / FILE]
    assert (tmp_path / "run" / FILE).lstat().st_mtime_ns == status.st_mtime_ns


@pytest.mark.parametrize("where", [90, -1, -100, None])
def test_a_damaged_whole_file_is_one_line_and_left_alone(tmp_path, where):
    fill(tmp_path, TOY.seeds)
    path = tmp_path / WHOLE
    data = bytearray(path.read_bytes())
    if where is None:
        data = bytearray(b"notes of mine")
    else:
        data[where] ^= 1
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"trials\.parquet: expected trials in Parquet") as caught:
        missing(tmp_path)
    assert "\n" not in str(caught.value)
    assert files(tmp_path) == {WHOLE: bytes(data)}


def test_what_is_longer_than_can_be_read_back_is_not_stored(tmp_path, monkeypatch):
    monkeypatch.setattr("testbench.trials.store.LONGEST", 100)
    with open_store(tmp_path, TOY, row=X, resume=False) as store:
        with pytest.raises(BenchError, match="expected at most 100 bytes of a trial"):
            put(store, {7: [X(1 / 3)] * 6})
        assert store.count == 0


def forge_whole(folder, seeds, trials, header=None):
    """A whole file of these seeds' rows that claims so many trials."""
    about = {"testbench": header or json.dumps(TOY.header, sort_keys=True), "trials": trials}
    schema = pa.schema({"seed": pa.int64(), "x": pa.float64()}, about)
    pq.write_table(pa.table([seeds, np.ones(len(seeds))], schema=schema), folder / WHOLE)


@pytest.mark.parametrize(
    ("seeds", "header"),
    [
        ([7] * 200_000, None),
        ([8, 7], None),
        ([7, 8, 7], None),
        ([None, 8], None),
        ([7], "[" * 100_000),
    ],
)
def test_a_forged_whole_file_is_one_line(tmp_path, seeds, header):
    forge_whole(tmp_path, seeds, "3", header)
    with pytest.raises(InputError, match=r"trials\.parquet: expected trials in Parquet"):
        missing(tmp_path)


@pytest.mark.parametrize(
    ("experiment", "problem"),
    [
        (Experiment("other", TOY.scenario, TOY.seeds), "scenario: the trials in this folder have 'toy'"),
        (Experiment("toy", {"load": {"mass": 2.0}}, TOY.seeds), "poses: .* \\[1, 2\\], this run has None"),
        (Experiment("toy", TOY.scenario, range(8, 12)), "root seed: .* have 7, this run has 8"),
    ],
)
@pytest.mark.parametrize("finished", [False, True])
def test_trials_of_something_else_are_not_resumed(tmp_path, experiment, problem, finished):
    fill(tmp_path, TOY.seeds if finished else [7, 8])
    before = files(tmp_path)
    with pytest.raises(InputError, match=problem):
        missing(tmp_path, experiment)
    assert files(tmp_path) == before


def test_a_fresh_run_keeps_off_a_stopped_one_and_replaces_a_finished_one(tmp_path):
    fill(tmp_path, [7, 8])
    with pytest.raises(InputError, match="holds 2 trials of a run that was stopped: --resume"):
        fill(tmp_path, [7])
    fill(tmp_path, [9, 10, 11], resume=True)
    finished = files(tmp_path)
    with open_store(tmp_path, TOY, row=X, resume=False) as store:
        assert store.count == 0
    assert files(tmp_path) == finished


def test_a_study_can_be_resumed_with_more_trials_or_fewer(tmp_path):
    fill(tmp_path, TOY.seeds)
    more = Experiment("toy", TOY.scenario, range(7, 14))
    assert missing(tmp_path, more) == [12, 13]
    fill(tmp_path, [13], more, resume=True)
    with pytest.raises(InputError, match="holds 6 trials of a run that was stopped"):
        fill(tmp_path, [7])
    fewer = Experiment("toy", TOY.scenario, range(7, 9))
    with open_store(tmp_path, fewer, row=X, resume=True) as store:
        assert [seed for seed, _ in store.trials()] == [7, 8]
        assert pq.read_table(write_parquet(store, tmp_path))["seed"].to_pylist() == [7, 8]


def test_one_run_at_a_time_writes_a_folder(tmp_path):
    with (
        open_store(tmp_path, TOY, row=X, resume=False),
        pytest.raises(InputError, match="another run is writing it"),
        open_store(tmp_path, TOY, row=X, resume=True),
    ):
        pass
    assert not files(tmp_path)


def test_a_full_disk_loses_nothing_that_is_stored(tmp_path):
    with open_store(tmp_path, TOY, row=X, resume=False) as store:
        put(store, {7: [X(1.0)]})
        full = [9, OSError(errno.ENOSPC, "No space left on device")]
        with (
            mock.patch("os.pwrite", side_effect=full),
            pytest.raises(InputError, match=r"trials\.log: cannot be written: No space left"),
        ):
            put(store, {8: [X(k / 7) for k in range(4000)]})
        assert store.count == 1
        put(store, {9: [X(2.0)]})
    assert missing(tmp_path) == [8, 10, 11]


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    (tmp_path / "file").touch()
    with (
        pytest.raises(InputError, match="cannot be written"),
        open_store(tmp_path / "file", TOY, row=X, resume=False),
    ):
        pass


@pytest.mark.parametrize("seeds", [range(0), range(0, 10, 2), range(-1, 3), range(2**63, 2**63 + 2)])
def test_seeds_are_consecutive_and_fit_parquet(seeds):
    with pytest.raises(BenchError, match="seeds: expected"):
        Experiment("toy", {}, seeds)


@pytest.mark.parametrize("scenario", [{"x": math.nan}, {"x": {1, 2}}])
def test_a_scenario_is_plain_data(tmp_path, scenario):
    with pytest.raises(BenchError, match="scenario: expected plain JSON data"):
        fill(tmp_path, [7], Experiment("toy", scenario, range(7, 12)))


def test_a_text_that_is_stored_once_and_used_without_end_is_refused(tmp_path):
    """A few hundred kB that are gigabytes once every row has its text."""
    many, path = 20_000, tmp_path / WHOLE
    word = pa.DictionaryArray.from_arrays(np.zeros(many, np.int32), ["x" * 200_000])
    table = pa.table({"seed": np.arange(many), "name": word, "workspace.rms_mm": np.ones(many)})
    pq.write_table(table, path, store_schema=False)
    with pytest.raises(InputError, match="expected texts of at most"):
        series(path, ["workspace.rms_mm"])


ODD = {
    "bytes": (pa.array([b"x"] * 9, pa.binary()), "column name: expected numbers, words or truth values"),
    "a struct": (pa.array([{"n": "x"}] * 9), "column name: expected numbers, words or truth values"),
    "lists of lists": (pa.array([[["x"]]] * 9), "column name: expected numbers, words or truth values"),
    "lists of a long text": (pa.array([["x" * 200]] * 9), "expected texts of at most 1000 letters"),
    "a long list": (pa.array([[0.0] * 200] * 9), "row group 1: expected at most .* 1000 cells"),
}


@pytest.mark.parametrize("name", ODD)
def test_columns_that_unpack_to_more_than_they_say_are_refused(tmp_path, monkeypatch, name):
    monkeypatch.setattr("testbench.trials.parquet.MOST_LETTERS", 1000)
    monkeypatch.setattr("testbench.trials.parquet.MOST_CELLS", 1000)
    cells, said = ODD[name]
    pq.write_table(pa.table({"seed": range(9), "name": cells}), tmp_path / WHOLE)
    with pytest.raises(ValueError, match=said), open_trials(tmp_path / WHOLE) as file:
        list(batches(file, ["seed", "name"]))
