"""The public dataset: the same bytes for any workers, no arm in two splits, read back by anybody."""

import hashlib
import json
import re
from collections import Counter

import numpy as np
import pytest
from build_dataset import GRID, ROUNDS, build, kind_of, split_of
from pyarrow import parquet
from run_here import ROOT, held

import testbench as tb
from testbench.plant.true_arms import FAMILY_TRUE_ARMS
from testbench.workflows.campaign import draw_poses, simulate_at, true_cell
from testbench.workflows.cell import build_cell
from testbench.workflows.load_dataset import SCENARIO, TABLES
from testbench.workflows.models import PRIORS, prior_of

SAMPLE = ROOT / "docs/dataset_sample"
CODE = re.findall(r"```python\n(.*?)```", (ROOT / "docs/dataset.md").read_text(encoding="utf-8"), re.DOTALL)
SEED = 7


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    out = tmp_path_factory.mktemp("public") / "set"
    build(out, range(SEED, SEED + GRID), 1)
    return out


def digests(folder):
    paths = (path for path in folder.rglob("*") if path.is_file())
    return {p.relative_to(folder).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in paths}


@pytest.mark.study
def test_manifest_and_croissant_have_the_digests_of_all_files(made):
    known = digests(made)
    del known["manifest.json"]
    assert json.loads((made / "manifest.json").read_text())["sha256"] == known
    croissant = json.loads((made / "croissant.json").read_text())
    said = {own["@id"]: own["sha256"] for own in croissant["distribution"]}
    assert said.items() == {(k, v) for k, v in known.items() if k != "croissant.json"}


@pytest.mark.study
def test_a_campaign_is_read_back_bit_by_bit(made):
    number = 4 * len(PRIORS) + 3  # the fifth kind, the fourth prior
    own = tb.load_dataset(made)[number]
    cell, seed = build_cell("kr500_l480"), SEED + number
    true = true_cell(cell, list(FAMILY_TRUE_ARMS)[4], SEED + number - 3)
    known = simulate_at(true, SCENARIO, seed, draw_poses(true, SCENARIO, seed))
    for name in ("measured", "identification", "check", "check_true", "truth"):
        found, wanted = getattr(own.campaign, name), getattr(known, name)
        for field, values in vars(wanted).items():
            assert np.array_equal(getattr(found, field), values), (name, field)
    assert np.array_equal(own.prior.C_theta, prior_of(cell, list(PRIORS)[3], seed).C_theta)
    assert own.campaign.seed == seed


def test_no_arm_is_in_two_splits_and_every_cell_of_the_grid_is_there():
    arms = parquet.read_table(SAMPLE / "truth_arms.parquet").to_pydict()
    splits, numbers = {}, {}
    for links, joints, split, arm in zip(
        arms["links"], arms["joints"], arms["split"], arms["arm"], strict=True
    ):
        splits.setdefault((*links, *joints), set()).add(split)
        numbers.setdefault((*links, *joints), set()).add(arm)
    assert all(len(own) == 1 for own in splits.values())
    assert all(len(own) == 1 for own in numbers.values())
    assert len(splits) == len(set(arms["arm"])) == len(FAMILY_TRUE_ARMS)
    assert {*arms["split"]} == {"train", "dev", "test"}
    grid = zip(arms["true_arm"], arms["prior_error"], strict=True)
    assert {*grid} == {(kind, error) for kind in FAMILY_TRUE_ARMS for error in PRIORS}
    readings = parquet.read_table(SAMPLE / "readings.parquet").to_pydict()
    assert dict(zip(readings["campaign"], readings["split"], strict=True)) == dict(
        zip(arms["campaign"], arms["split"], strict=True)
    )


def test_arms_of_all_rounds_are_shared_out_as_the_card_says():
    every = range(0, GRID * ROUNDS, len(PRIORS))
    for kind in FAMILY_TRUE_ARMS:
        splits = Counter(split_of(first) for first in every if kind_of(first) == kind)
        assert splits == ({"train": 100} if kind == "tubes" else {"train": 70, "dev": 10, "test": 20})


def test_the_sample_is_what_the_code_makes():
    """Its numbers, not its bytes: another processor has other last digits."""
    here_made = tb.load_dataset(SAMPLE)
    assert len(here_made) == GRID
    own, cell = here_made[-1], build_cell("kr500_l480")
    seed = own.campaign.seed
    true = true_cell(cell, list(FAMILY_TRUE_ARMS)[-1], seed - len(PRIORS) + 1)
    known = simulate_at(true, SCENARIO, seed, draw_poses(true, SCENARIO, seed))
    assert np.allclose(own.campaign.measured.after, known.measured.after, rtol=0, atol=1e-9)
    assert np.allclose(own.campaign.truth.deflection, known.truth.deflection, rtol=0, atol=1e-9)
    assert sum(path.stat().st_size for path in SAMPLE.rglob("*") if path.is_file()) < 2e6
    known = digests(SAMPLE)
    del known["manifest.json"]
    assert json.loads((SAMPLE / "manifest.json").read_text())["sha256"] == known
    assert "dirty" not in (SAMPLE / "README.md").read_text()


@pytest.mark.parametrize("code", CODE, ids=["testbench", "pandas", "pyarrow"])
def test_the_lines_of_the_page_read_the_sample(code, monkeypatch, capsys):
    if "pandas" in code:
        pytest.importorskip("pandas", reason="pip install pandas: no lock has it")
    assert code.count("\n") <= 10
    monkeypatch.chdir(ROOT / "docs")
    exec(compile(code, "dataset.md", "exec"), {})
    assert capsys.readouterr().out


def test_croissant_names_every_column():
    records = json.loads((SAMPLE / "croissant.json").read_text())["recordSet"]
    found = {own["name"]: [field["name"] for field in own["field"]] for own in records}
    schemas = {table.removesuffix(".parquet"): parquet.read_schema(SAMPLE / table).names for table in TABLES}
    assert found == schemas


def damaged(folder, name):
    (folder / name).write_bytes(b"PAR1 no PAR1")


def without_marker(folder, name):
    table = parquet.read_table(folder / name)
    parquet.write_table(table.drop_columns(["marker"]), folder / name)


def out_of_order(folder, name):
    table = parquet.read_table(folder / name)
    parquet.write_table(table.take(list(range(len(table)))[::-1]), folder / name)


def half(folder, name):
    table = parquet.read_table(folder / name)
    parquet.write_table(table.slice(0, 63 * 6), folder / name)


@pytest.mark.parametrize(
    ("harm", "name", "said"),
    [
        (
            lambda folder, name: (folder / name).unlink(),
            "campaigns.parquet",
            "expected the folder of the public dataset, with campaigns.parquet",
        ),
        (damaged, "truth_deflections.parquet", "expected a table in Parquet"),
        (without_marker, "readings.parquet", "column marker: this column is missing"),
        (out_of_order, "readings.parquet", "expected P1, P2, P3 in turn"),
        (half, "readings.parquet", "campaign 6: expected its prior, readings"),
    ],
)
def test_a_wrong_file_is_one_line(tmp_path, harm, name, said):
    for path in SAMPLE.rglob("*"):
        if path.is_file():
            (tmp_path / path.relative_to(SAMPLE)).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / path.relative_to(SAMPLE)).write_bytes(path.read_bytes())
    harm(tmp_path, name)
    with pytest.raises(tb.BenchError) as told:
        tb.load_dataset(tmp_path)
    assert said in str(told.value)
    assert "\n" not in str(told.value)


def test_a_wrong_number_of_campaigns_and_a_folder_of_others_are_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    for folder, count, said in (
        (tmp_path / "set", GRID + 1, f"--campaigns: expected a multiple of {GRID}"),
        (tmp_path, GRID, "notes.txt"),
    ):
        before = held(tmp_path)
        with pytest.raises(tb.BenchError, match=said):
            build(folder, range(SEED, SEED + count))
        assert held(tmp_path) == before
