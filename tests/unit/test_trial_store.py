"""The trial store and its Parquet file: what is stored comes back, what is damaged or foreign is refused."""

import json
import math

import numpy as np
import pyarrow.parquet as pq
import pytest

from testbench.errors import BenchError, InputError
from testbench.trials import Experiment, open_store, write_parquet
from testbench.trials.chunk import do_chunk
from testbench.trials.store import FILE

TOY = Experiment("toy", {"load": {"mass": 2.0}, "poses": [1, 2]}, range(7, 12))


def put(store, found):
    """Store rows by seed, as a chunk does."""
    chunk = do_chunk(lambda seeds: [found[s] for s in seeds], tuple(found))
    assert not chunk.problem, chunk.problem
    store.append(chunk.seeds, chunk.lines)


def fill(folder, seeds, study=TOY, resume=False):
    with open_store(folder, study, resume=resume) as store:
        put(store, {seed: [{"x": seed / 3}] for seed in seeds})


def missing(folder, study=TOY):
    with open_store(folder, study, resume=True) as store:
        return list(store.missing())


def test_every_kind_of_value_comes_back_bit_by_bit(tmp_path):
    row = {
        "pi": math.pi, "least": 5e-324, "minus": -0.0, "nan": math.nan, "inf": -math.inf,
        "count": np.int64(-(2**63)), "yes": np.bool_(True), "word": "a\nb, \u00b5m", "none": None,
    }  # fmt: skip
    with open_store(tmp_path, TOY, resume=False) as store:
        put(store, {9: [row], 7: []})
    with open_store(tmp_path, TOY, resume=True) as store:
        assert list(store.missing()) == [8, 10, 11]
        (seed, rows), (last, [back]) = store.trials()
    assert (seed, rows, last) == (7, [], 9)
    for name, value in row.items():
        assert repr(back[name]) == repr(value.item() if isinstance(value, np.generic) else value), name


def test_parquet_does_not_depend_on_the_order_of_trials(tmp_path):
    found = {s: [{"x": s if s % 2 else s / 3, "y": None}, {"z": math.nan}] for s in TOY.seeds}
    written = []
    for name, order in (("a", [7, 8, 9, 10, 11]), ("b", [10, 7, 11, 9, 8])):
        with open_store(tmp_path / name, TOY, resume=False) as store:
            for seed in order:
                put(store, {seed: found[seed]})
            written.append(write_parquet(store, tmp_path / name))
    assert written[0].read_bytes() == written[1].read_bytes()
    table = pq.read_table(written[0])
    assert {f.name: str(f.type) for f in table.schema} == {
        "seed": "int64", "x": "double", "y": "double", "z": "double",
    }  # fmt: skip
    rows = table.to_pylist()
    assert [row["seed"] for row in rows] == [7, 7, 8, 8, 9, 9, 10, 10, 11, 11]
    assert [row["x"] for row in rows[:3]] == [7.0, None, 8 / 3]
    assert all(math.isnan(row["z"]) for row in rows[1::2])
    assert json.loads(table.schema.metadata[b"testbench"])["settings"] == TOY.scenario


def test_many_rows_go_through_several_row_groups(tmp_path):
    with open_store(tmp_path, TOY, resume=False) as store:
        put(store, {s: [{"x": 1000 * s + k} for k in range(900)] for s in TOY.seeds})
        file = pq.ParquetFile(write_parquet(store, tmp_path))
    assert file.num_row_groups == 3
    assert file.read()["x"].to_pylist() == [1000 * s + k for s in TOY.seeds for k in range(900)]


def test_a_column_of_words_and_numbers_is_refused_and_an_earlier_file_stands(tmp_path):
    (tmp_path / "trials.parquet").write_text("earlier")
    with open_store(tmp_path, TOY, resume=False) as store:
        put(store, {7: [{"x": 1.0}], 8: [{"x": "one"}]})
        with pytest.raises(BenchError, match="column 'x': expected one type in all trials, got float64, str"):
            write_parquet(store, tmp_path)
    assert (tmp_path / "trials.parquet").read_text() == "earlier"
    assert {p.name for p in tmp_path.iterdir()} == {FILE, "trials.parquet"}


@pytest.mark.parametrize(
    ("rows", "problem"),
    [
        ([{"x": np.zeros(2)}], "got ndarray"),
        ([{"x": 2**63}], "x: expected integers of 64 bits, got one of 64"),
        ([{"seed": 1}], "names other than 'seed'"),
        ([{3: 1}], "got 3"),
        ([{"x": "\ud800"}], "surrogates"),
        ({"x": 1}, "expected a list of dicts"),
    ],
)
def test_rows_that_cannot_be_stored_are_told(rows, problem):
    chunk = do_chunk(lambda seeds: [rows for _ in seeds], (7,))
    assert not chunk.lines
    assert chunk.problem.startswith("seeds 7 to 7: ")
    assert problem in chunk.problem


def test_work_that_forgets_a_seed_is_told():
    assert "expected rows for 2 trials, got 1" in do_chunk(lambda _: [[]], (7, 8)).problem


@pytest.mark.parametrize("cut", [1, 5, 20])
def test_a_torn_last_line_is_cut_and_its_trial_done_again(tmp_path, cut):
    fill(tmp_path, [9, 7, 8])
    path = tmp_path / FILE
    whole = path.read_bytes()
    path.write_bytes(whole[:-cut])
    assert missing(tmp_path) == [8, 10, 11]
    fill(tmp_path, [8], resume=True)
    assert path.read_bytes() == whole


def test_a_torn_header_is_no_store(tmp_path):
    fill(tmp_path, [7])
    whole = (tmp_path / FILE).read_bytes()
    (tmp_path / FILE).write_bytes(whole[:40])
    assert missing(tmp_path) == list(TOY.seeds)
    assert not (tmp_path / FILE).exists()


@pytest.mark.parametrize(
    ("number", "line", "problem"),
    [
        (3, b"{", "line 3: no JSON object"),
        (2, b"\x00\xff", "line 2: no JSON object"),
        (2, b"[" * 100_000, "line 2: no JSON object"),
        (2, b"[1]", "line 2: no JSON object"),
        (1, b"{}", "line 1: expected format 'testbench trials 1', got None"),
        (2, b'{"seed":"7","rows":[]}', "line 2: seed: expected an integer from 7 on, got 7"),
        (2, b'{"seed":true,"rows":[]}', "line 2: seed: expected an integer from 7 on, got True"),
        (2, b'{"seed":6,"rows":[]}', "line 2: seed: expected an integer from 7 on, got 6"),
        (3, b'{"seed":7,"rows":[]}', "line 3: seed 7 for the second time"),
        (2, b'{"seed":7}', "line 2: rows: expected a list of dicts"),
        (2, b'{"seed":7,"rows":[{"x":{}}]}', "line 2: rows: x: expected a number"),
        (2, b'{"seed":7,"rows":[{"x":' + b"9" * 5000 + b"}]}", "line 2: no JSON object"),
    ],
)
def test_a_damaged_store_is_refused_by_line_and_left_alone(tmp_path, number, line, problem):
    fill(tmp_path, [7, 8])
    path = tmp_path / FILE
    lines = path.read_bytes().splitlines()
    lines[number - 1] = line
    damaged = b"\n".join(lines) + b"\n"
    path.write_bytes(damaged)
    with pytest.raises(InputError) as caught:
        missing(tmp_path)
    assert problem in str(caught.value)
    assert "\n" not in str(caught.value)
    assert path.read_bytes() == damaged


@pytest.mark.parametrize(
    ("study", "problem"),
    [
        (Experiment("other", TOY.scenario, TOY.seeds), "scenario: the trials in this folder have 'toy'"),
        (
            Experiment("toy", {**TOY.scenario, "poses": [1]}, TOY.seeds),
            "poses: the trials in this folder",
        ),
        (
            Experiment("toy", {"load": {"mass": 2.0}}, TOY.seeds),
            "poses: .* have \\[1, 2\\], this run has None",
        ),
        (Experiment("toy", TOY.scenario, range(8, 12)), "root seed: .* have 7, this run has 8"),
    ],
)
def test_trials_of_something_else_are_not_resumed(tmp_path, study, problem):
    fill(tmp_path, [7, 8])
    before = (tmp_path / FILE).read_bytes()
    with pytest.raises(InputError, match=problem):
        missing(tmp_path, study)
    assert (tmp_path / FILE).read_bytes() == before


def test_trials_of_another_version_are_not_resumed(tmp_path):
    fill(tmp_path, [7])
    path = tmp_path / FILE
    path.write_text(path.read_text().replace('"numpy":"', '"numpy":"0.'))
    with pytest.raises(InputError, match=r"version of numpy: the trials in this folder have '0\."):
        missing(tmp_path)


def test_a_fresh_run_keeps_off_a_stopped_one_and_replaces_a_finished_one(tmp_path):
    fill(tmp_path, [7, 8])
    with pytest.raises(InputError, match="holds 2 trials of a run that was stopped: --resume"):
        fill(tmp_path, [7])
    fill(tmp_path, [9, 10, 11], resume=True)
    finished = (tmp_path / FILE).read_bytes()
    with open_store(tmp_path, TOY, resume=False) as store:
        assert store.count == 0
    assert (tmp_path / FILE).read_bytes() == finished  # until there is a result, nothing is replaced
    fill(tmp_path, [8])
    assert missing(tmp_path) == [7, 9, 10, 11]


def test_a_study_can_be_resumed_with_more_trials_or_fewer(tmp_path):
    fill(tmp_path, TOY.seeds)
    more = Experiment("toy", TOY.scenario, range(7, 14))
    assert missing(tmp_path, more) == [12, 13]
    with open_store(tmp_path, Experiment("toy", TOY.scenario, range(7, 9)), resume=True) as store:
        assert [seed for seed, _ in store.trials()] == [7, 8]
    fill(tmp_path, [13], more, resume=True)
    with pytest.raises(InputError, match="holds 6 trials of a run that was stopped"):
        fill(tmp_path, [7])


def test_one_run_at_a_time_writes_a_folder(tmp_path):
    with open_store(tmp_path, TOY, resume=False) as store:
        put(store, {7: []})
        with (
            pytest.raises(InputError, match="another run is writing it"),
            open_store(tmp_path, TOY, resume=True),
        ):
            pass


def test_a_run_without_a_result_leaves_no_store(tmp_path):
    with pytest.raises(RuntimeError, match="early"), open_store(tmp_path / "new", TOY, resume=False):
        raise RuntimeError("early")
    assert not (tmp_path / "new").exists()


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    (tmp_path / "file").touch()
    with (
        pytest.raises(InputError, match="cannot be written"),
        open_store(tmp_path / "file", TOY, resume=False),
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
