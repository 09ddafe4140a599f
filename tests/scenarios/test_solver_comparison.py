"""The solver comparison as a stranger runs it: files, keys, who ends where."""

import json
import sys
from pathlib import Path

import pyarrow.parquet as parquet
import pytest
from checks import check_markdown
from run_here import app_of, here, numbers_alone

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "scenarios" / "solver_comparison.py"
FILES = {
    "dataset.csv", "report.json", "report.md", "manifest.json", "solver_comparison.png", "recording.rrd",
    "trials.parquet",
    "report.html",
}  # fmt: skip
SMALL = ["--quick", "--generations", "3", "--trial-points", "30", "--starts", "2", "--model", "MGCO56"]
SOLVER = {
    "key", "solver", "f_m", "excess_f_m", "f_m_excess_bound", "relative_excess_bound", "seconds",
    "seconds_to_1_percent", "ratio_to_conic", "conservative", "check_true", "status",
}  # fmt: skip


def run(*args):
    return here(app_of(SCRIPT), *args)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    out = tmp_path_factory.mktemp("small")
    done = run(*SMALL, "--seed", 3, "--out", out, "--workers", 1)
    assert done.returncode == 0, done.stderr
    return out, done, json.loads((out / "report.json").read_text())


def test_a_run_leaves_its_files_and_says_where(small):
    out, done, _ = small
    assert {p.name for p in out.iterdir()} == FILES
    check_markdown((out / "report.md").read_text())
    assert done.stderr == ""
    for name in ("report.md", "report.json", "solver_comparison.png", "dataset.csv"):
        assert name in done.stdout
    assert max(map(len, done.stdout.splitlines()[:-4])) <= 80


def test_report_has_its_keys(small):
    report = small[2]
    assert (report["scenario"], report["seed"], report["arm"]) == ("solver_comparison", [3, 4], "arm_6r")
    assert {"runs", "points", "deflection_min_mm", "deflection_max_mm", "sigma_um"} <= set(report["dataset"])
    assert (report["dataset"]["runs"], report["dataset"]["check_runs"]) == (108, 120)
    assert [row["key"] for row in report["solvers"]] == ["a", "a'", "b", "b'", "c", "d"]
    for row in report["solvers"]:
        assert set(row) >= SOLVER
        assert row["conservative"]
        assert set(row["f_m"]) >= {"median", "p05", "p95"}
        assert row["relative_excess_bound"]["p05"] >= 0
        assert set(row["check_true"]) >= {"rms_mm", "p95_mm"}
    assert set(report["local_minima"]) == {"m=6", "m=4", "m=3"}
    [model] = report["models"]
    assert (model["name"], model["status"], model["conservative"]) == ("MGCO56", "solved", True)
    assert {
        "f_m_floor",
        "duality_gap",
        "f_m_excess_bound",
        "solve_seconds",
        "check",
        "identification",
        "paper",
    } <= set(model)


def test_conic_program_is_never_above_any_other_solver(small):
    report = small[2]
    assert report["largest_relative_excess_of_d_over_any"] <= 1e-6
    others = [row for row in report["solvers"] if row["key"] != "d"]
    for row in others:
        assert row["relative_excess"]["p05"] >= -1e-6  # the trace beside F_M costs (d) up to 1e-7 of it
        # certified: nobody is farther from the least F_M than its bound says
        assert row["excess_f_m"]["p95"] <= row["f_m_excess_bound"]["p95"]


def test_what_is_found_does_not_depend_on_other_seeds(small, tmp_path):
    with numbers_alone():
        done = run(*SMALL, "--seed", 3, "--seeds", 1, "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    again = json.loads((tmp_path / "report.json").read_text())
    rows = [parquet.read_table(folder / "trials.parquet").to_pylist() for folder in (tmp_path, small[0])]
    alone, beside = ([row["solver.f_m"] for row in own if row["seed"] == 3] for own in rows)
    assert alone == beside
    assert again["local_minima"] == small[2]["local_minima"]


BAD_FLAGS = [
    (["--m", "7"], "--m"),
    (["--generations", "0"], "--generations"),
    (["--workers", "0"], "--workers"),
    (["--model", "MGCO99"], "no model 'MGCO99'; models are"),
    (["--model", "MLS56"], "expected one that GCO identifies"),
]


@pytest.mark.parametrize(("flags", "text"), BAD_FLAGS)
def test_bad_flags_are_one_line_exit_code_2_and_touch_nothing(flags, text, tmp_path):
    done = run("--out", tmp_path / "out", *flags)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("error: ")
    assert text in done.stderr
    assert not (tmp_path / "out").exists()


def test_scs_without_cvxpy_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cvxpy", None)  # as where it is not installed
    done = run("--scs", "--out", tmp_path / "out")
    assert done.returncode == 2
    assert done.stderr == "error: SCS is called through cvxpy, which is not installed: make bench\n"
    assert not (tmp_path / "out").exists()
