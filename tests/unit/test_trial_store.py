"""The trial store and its Parquet files: what is stored comes back, what is damaged or foreign is refused."""

import errno
import json
import math
from dataclasses import dataclass, make_dataclass, replace
from typing import Literal
from unittest import mock

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from testbench.errors import BenchError, InputError
from testbench.runs import store as stores
from testbench.runs.engine import do_chunk
from testbench.runs.spread import Number, Share
from testbench.runs.store import PARTS, WHOLE, TrialPlan, open_store, series, write_parquet

TOY = TrialPlan("toy", {"load": {"mass": 2.0}, "poses": [1, 2]}, range(7, 12))


@dataclass(frozen=True)
class X:
    x: float


@dataclass(frozen=True)
class Fit:
    rms_mm: float
    rank: int | None


KINDS = {
    "pi": (float, math.pi, "double"),
    "least": (float, 5e-324, "double"),
    "minus": (float, -0.0, "double"),
    "nan": (float | None, math.nan, "double"),
    "inf": (float | int, -math.inf, "double"),
    "count": (int, np.int64(-(2**63)), "int64"),
    "yes": (bool, np.bool_(True), "bool"),
    "word": (str, "a\nb, \u00b5m", "string"),
    "part": (Literal["check", "workspace"], "check", "string"),
    "several": (tuple[float, ...], (1.5, math.nan), "list<item: double>"),
    "names": (tuple[str, ...] | None, None, "list<item: string>"),
    "trials": (Number, 0.5, "double"),
    "holds": (Share, True, "bool"),
    "bounds": (tuple[Number, ...] | None, (1.0, None), "list<item: double>"),
    "check": (Fit, Fit(0.1, None), ""),
    "workspace": (Fit | None, None, ""),
}
"""Fields: their types, a value, and the type of the column."""
Full = make_dataclass("Full", [(name, kind) for name, (kind, *_) in KINDS.items()], frozen=True)
FULL = Full(*(value for _, value, _ in KINDS.values()))


def cells(seed, row):
    """A row of the table, by hand: what nests has its own columns, numbers are Python's, tuples lists."""
    own = {"seed": seed, **vars(row), "count": -(2**63), "yes": True}
    own = {name: list(value) if isinstance(value, tuple) else value for name, value in own.items()}
    for name in ("check", "workspace"):
        fit = own.pop(name) or Fit(None, None)
        own |= {f"{name}.rms_mm": fit.rms_mm, f"{name}.rank": fit.rank}
    return own


def put(store, found):
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
        return store.missing()


def files(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_every_kind_of_value_comes_back_bit_by_bit_while_a_run_goes_on_and_behind_its_end(tmp_path):
    """Trials without rows too."""
    rows = {7: [], 8: [FULL, replace(FULL, several=(), names=("a", "b"))], 9: [], 10: [FULL], 11: []}
    expected = repr([cells(seed, row) for seed, own in rows.items() for row in own])
    with open_store(tmp_path, TOY, row=Full, resume=False) as store:
        put(store, {seed: rows[seed] for seed in (10, 7, 9)})
    with open_store(tmp_path, TOY, row=Full, resume=True) as store:
        assert store.missing() == [8, 11]
        put(store, {seed: rows[seed] for seed in (11, 8)})
        assert repr(store.table().to_pylist()) == expected
        write_parquet(store, tmp_path)
    more = TrialPlan("toy", TOY.scenario, range(7, 14))
    with open_store(tmp_path, more, row=Full, resume=True) as store:
        assert store.missing() == [12, 13]
        assert repr(store.table().to_pylist()) == expected


def test_columns_have_the_types_of_the_fields_even_without_a_value(tmp_path):
    with open_store(tmp_path, TrialPlan("toy", {}, range(1)), row=Full, resume=False) as store:
        put(store, {0: []})
        schema = pq.read_schema(write_parquet(store, tmp_path))
    kinds = {f.name: str(f.type).replace("element", "item") for f in schema}
    fit = {"rms_mm": "double", "rank": "int64"}
    fits = {f"{part}.{name}": fit[name] for part in ("check", "workspace") for name in fit}
    assert kinds == {"seed": "int64"} | fits | {
        name: column for name, (*_, column) in KINDS.items() if column
    }


def test_parquet_does_not_depend_on_order_or_where_it_stopped(tmp_path, monkeypatch):
    monkeypatch.setattr("testbench.runs.store.GROUP", 1000)
    found = {s: [X(1000 * s + k) for k in range(900)] for s in TOY.seeds}
    written = []
    for name, order in (("a", [7, 8, 9, 10, 11]), ("b", [10, 7, 11, 9, 8])):
        for own in (order[:3], order[3:]):
            with open_store(tmp_path / name, TOY, row=X, resume=own == order[3:]) as store:
                for seed in own:
                    put(store, {seed: found[seed]})
                if own == order[3:]:
                    written.append(write_parquet(store, tmp_path / name))
    assert written[0].read_bytes() == written[1].read_bytes()
    file = pq.ParquetFile(written[0])
    assert [file.metadata.row_group(k).num_rows for k in range(5)] == [1000, 1000, 1000, 1000, 500]
    table = file.read()
    assert table["seed"].to_pylist() == [s for s in TOY.seeds for _ in range(900)]
    assert table["x"].to_pylist() == [row.x for rows in found.values() for row in rows]
    assert json.loads(table.schema.metadata[b"testbench"])["settings"] == TOY.scenario
    with open_store(tmp_path / "a", TOY, row=X, resume=True) as store:
        assert store.rows() == [row for rows in found.values() for row in rows]


def test_rows_of_another_number_of_trials_are_told_by_the_worker():
    assert "expected rows for 1 trials, got 2" in do_chunk(lambda _: [[], []], (7,)).problem


@pytest.mark.parametrize(
    ("row", "problem"),
    [
        (replace(FULL, count=1.5), "rows: count: expected int64: .*fraction"),
        (replace(FULL, several=(1.0, "b")), "rows: several: expected list<.*>: .*'b'"),
        (replace(FULL, count=2**63), "rows: count: expected int64: "),
        (replace(FULL, word=1), "rows: word: expected string: "),
        (replace(FULL, pi=np.zeros(2)), "rows: pi: expected double: .*ndarray"),
        (X(1.0), "rows: expected Full, got X"),
        ({"pi": 1.0}, "rows: expected Full, got dict"),
    ],
)
def test_rows_of_another_type_are_refused_and_what_is_stored_stays(tmp_path, row, problem):
    with open_store(tmp_path, TOY, row=Full, resume=False) as store:
        put(store, {7: [FULL]})
        with pytest.raises(BenchError, match=problem):
            put(store, {8: [row]})
        assert store.missing() == [8, 9, 10, 11]
        assert len(store.table()) == 1


@pytest.mark.parametrize("field", [("x", list), ("x", float | str), ("seed", int)])
def test_dataclasses_that_are_no_table_are_refused(tmp_path, field):
    row, out = make_dataclass("Row", [field], frozen=True), tmp_path / "a"
    with pytest.raises(BenchError, match="expected"), open_store(out, TOY, row=row, resume=False):
        pass
    assert not out.exists()


@pytest.mark.parametrize("spoil", ["cut", "noise", "foreign"])
def test_a_damaged_part_is_refused_and_stays(tmp_path, spoil):
    fill(tmp_path, [7, 8])
    part = tmp_path / PARTS / "8.parquet"
    data = part.read_bytes()
    if spoil == "foreign":
        pq.write_table(pa.table({"seed": [8], "x": [1.0]}), part)
    else:
        part.write_bytes(data[:-9] if spoil == "cut" else b"PAR1" + bytes(999) + b"PAR1")
    with pytest.raises(InputError, match=r"8\.parquet: expected trials in Parquet: .* damaged"):
        missing(tmp_path)
    part.write_bytes(data)
    assert missing(tmp_path) == [9, 10, 11]


def test_a_part_that_a_kill_cut_short_is_done_again(tmp_path):
    fill(tmp_path, [7, 8])
    part = tmp_path / PARTS / "8.parquet"
    part.with_name("8.parquet.part").write_bytes(part.read_bytes()[:-9])
    part.unlink()
    assert missing(tmp_path) == [8, 9, 10, 11]
    fill(tmp_path, [8, 9, 10, 11], resume=True)
    assert set(files(tmp_path)) == {WHOLE}


OTHERS = [
    (TrialPlan("other", TOY.scenario, TOY.seeds), "scenario: 'toy' in the stored trials"),
    (
        TrialPlan("toy", {"load": {"mass": 2.0}}, TOY.seeds),
        "poses: \\[1, 2\\] in the stored trials, not set in",
    ),
    (TrialPlan("toy", TOY.scenario, range(8, 12)), "root seed: 7 in the stored trials, 8 in this run"),
]


@pytest.mark.parametrize("seeds", [TOY.seeds, [7, 8]], ids=["finished", "stopped"])
def test_trials_of_something_else_are_not_resumed(tmp_path, seeds):
    fill(tmp_path, seeds)
    before = files(tmp_path)
    for experiment, problem in OTHERS:
        with pytest.raises(InputError, match=problem):
            missing(tmp_path, experiment)
        assert files(tmp_path) == before


def test_a_run_keeps_off_a_stopped_one_and_is_resumed_with_more_trials_or_fewer(tmp_path):
    """A finished one is replaced, once there are trials."""
    fill(tmp_path, [7, 8])
    with pytest.raises(InputError, match="holds 2 trials of a stopped run: --resume"):
        fill(tmp_path, [7])
    fill(tmp_path, [9, 10, 11], resume=True)
    finished = files(tmp_path)
    with open_store(tmp_path, TOY, row=X, resume=False) as store:
        assert store.count == 0
    assert files(tmp_path) == finished
    more = TrialPlan("toy", TOY.scenario, range(7, 14))
    assert missing(tmp_path, more) == [12, 13]
    fill(tmp_path, [13], more, resume=True)
    with pytest.raises(InputError, match="holds 6 trials of a stopped run"):
        fill(tmp_path, [7])
    fewer = TrialPlan("toy", TOY.scenario, range(7, 9))
    with open_store(tmp_path, fewer, row=X, resume=True) as store:
        assert store.rows() == [X(7 / 3), X(8 / 3)]
        assert pq.read_table(write_parquet(store, tmp_path))["seed"].to_pylist() == [7, 8]


def test_a_full_disk_loses_nothing_that_is_stored(tmp_path):
    full = OSError(errno.ENOSPC, "No space left on device")
    with open_store(tmp_path, TOY, row=X, resume=False) as store:
        put(store, {7: [X(1.0)]})
        with (
            mock.patch("os.fsync", side_effect=full),
            pytest.raises(InputError, match=r"trials/8\.parquet: cannot be written: No space left"),
        ):
            put(store, {8: [X(k / 7) for k in range(4000)]})
        put(store, {9: [X(2.0)]})
    assert missing(tmp_path) == [8, 10, 11]


def test_a_scenario_is_plain_data(tmp_path):
    for x in (math.nan, {1, 2}):
        with pytest.raises(BenchError, match="scenario: expected plain JSON data"):
            fill(tmp_path, [7], TrialPlan("toy", {"x": x}, range(7, 12)))


@pytest.mark.parametrize(
    ("limit", "said"), [("MAX_UNPACKED", "999 bytes unpacked"), ("MAX_COMPARED_ROWS", "999 rows")]
)
def test_a_table_of_trials_too_large_is_refused(tmp_path, monkeypatch, limit, said):
    """As `compare` reads one that somebody handed in: zeros pack to almost nothing."""
    rows = pa.table({"name": ["A"] * 1000, "seed": list(range(1000)), "rms_mm": [0.0] * 1000})
    pq.write_table(rows, tmp_path / WHOLE)
    keys = {"RMS": "rms_mm"}
    assert series(tmp_path / WHOLE, keys)
    monkeypatch.setattr(stores, limit, 999)
    with pytest.raises(InputError, match=f"expected at most {said}"):
        series(tmp_path / WHOLE, keys)
