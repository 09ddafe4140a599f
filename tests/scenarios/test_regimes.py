"""The study of regimes as a stranger runs it: files, the map, what every cell must hold."""

import json
from pathlib import Path

import pytest
from pyarrow import parquet
from run_here import app_of, here

from testbench.studies.regimes.trial import Settings

ROOT = Path(__file__).resolve().parents[2]
APP = app_of(ROOT / "scenarios" / "regimes.py")
FILES = {
    "dataset.csv", "report.json", "report.md", "manifest.json", "regimes.png", "recording.rrd",
    "trials.parquet",
}  # fmt: skip
CELLS = {"gravity": 4 * 3 * 2, "full_pose": 4 * 2 * 2}
"""Structures, poses and levels of noise with --quick."""


def run(*args):
    return here(APP, *args)


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    out = tmp_path_factory.mktemp("quick")
    done = run("--seed", 4, "--seeds", 2, "--out", out, "--quick", "--workers", 1)
    assert done.returncode == 0, done.stderr
    return out, done


@pytest.fixture(scope="module")
def report(quick):
    return json.loads((quick[0] / "report.json").read_text())


@pytest.fixture(scope="module")
def rows(quick):
    return parquet.read_table(quick[0] / "trials.parquet").to_pylist()


def test_a_run_leaves_the_files_of_the_contract_and_says_where(quick):
    out, done = quick
    assert {p.name for p in out.iterdir()} == FILES
    assert done.stderr == ""
    for name in FILES - {"manifest.json"}:
        assert str(out / name) in done.stdout


def test_two_kinds_of_the_family_take_turns_in_every_cell(report, rows):
    assert [Settings().arms(seed) for seed in (4, 5)] == [["tubes", "off_20"], ["off_40", "cast"]]
    assert {(row["seed"], row["truth"]) for row in rows} == {
        (4, "tubes"), (4, "off_20"), (5, "off_40"), (5, "cast")
    }  # fmt: skip
    for kind, count in CELLS.items():
        assert len(report["cells"][kind]) == count
        assert all(cell["fits"] == 4 for cell in report["cells"][kind])


def test_where_the_cone_does_not_bind_it_does_nothing_to_what_is_seen(rows):
    """The trace weight of GCO is all that is left: in the fitted runs and with the same free directions."""
    free = [row for row in rows if row["prior"] == "none" and not row["binds"]]
    assert len(free) > 20
    for row in free:
        assert row["gco_um"] == pytest.approx(row["lent_um"], rel=0.02)
        assert row["gco_fitted_um"] == pytest.approx(row["ls_fitted_um"], rel=0.02)
    assert max(row["gco_um"] / row["ls_um"] for row in free) > 1.5  # what fills the free directions does


def test_a_conservative_least_squares_with_a_prior_is_gco(rows):
    for row in rows:
        if row["prior"] != "none" and not row["binds"]:
            assert row["gco_um"] == pytest.approx(row["ls_um"], rel=1e-3)


def test_another_truth_is_asked_for_and_an_unknown_one_refused(tmp_path):
    done = run("--quick", "--seeds", 1, "--truth", "joints", "--truth", "rust", "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "--truth: expected different ones of tubes, off_10" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()
