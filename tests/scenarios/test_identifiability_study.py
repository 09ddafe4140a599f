"""The study of identifiability as a stranger runs it: its files, its contract, its claims."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "scenarios" / "identifiability.py"
FILES = {
    "dataset.csv", "report.json", "report.md", "manifest.json", "identifiability.png", "shares.png",
    "recording.rrd",
}  # fmt: skip


def run(*args):
    command = [sys.executable, str(SCRIPT), *map(str, args)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=180)


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    out = tmp_path_factory.mktemp("quick")
    done = run("--seed", 2, "--seeds", 1, "--out", out, "--quick", "--workers", 1)
    assert done.returncode == 0, done.stderr
    return out, done


@pytest.fixture(scope="module")
def report(quick):
    return json.loads((quick[0] / "report.json").read_text())


def test_a_run_leaves_the_files_of_the_contract_and_says_where(quick):
    out, done = quick
    assert {p.name for p in out.iterdir()} == FILES
    assert done.stderr == ""
    for name in FILES - {"manifest.json"}:
        assert str(out / name) in done.stdout


def test_only_least_squares_is_ever_not_conservative(report):
    for m in [*report["models"], *report["nonlinear"]]:
        assert m["status"] == "solved", m["name"]
        if "LS" not in m["name"]:
            assert m["conservative"] is True, m["name"]


def test_a_wrong_prior_beats_none_and_its_scale_does_not_matter(report):
    rms = {m["name"]: m["workspace"]["rms_mm"] for m in report["models"]}
    assert 3 * rms["MGCO68, GCO + prior"] < rms["MGCO68"]
    assert rms["MGCO68, GCO + prior"] < rms["MGCO68, least trace"]
    low, high = (row["MGCO68, GCO + prior"] for row in report["scales"])
    assert low == pytest.approx(high, rel=1e-3)


def test_report_says_what_the_data_see_how_sure_it_is_and_what_outliers_cost(quick, report):
    seen = report["seen"]
    assert seen["unknowns"] == 68
    assert report["outliers"]["robust_mm"] < 1.2 * report["outliers"]["clean_mm"]
    for name, row in report["coverage"].items():
        # ten datasets: their own standard error, and never more than ten points off
        assert row["covered"] > 0.95 - max(4 * row["standard_error"], 0.1), name
    words = (quick[0] / "report.md").read_text()
    for heading in ("Number of poses", "Scale of the prior", "Coverage of 95 % intervals"):
        assert heading in words
    assert sum(v is True for v in report["choice"]["chosen"].values()) == 1


@pytest.mark.parametrize(
    ("flags", "text"),
    [
        (["--seeds", "0"], "--seeds"),
        (["--arm", "no/such/arm"], "no/such/arm: expected a folder"),
        (["--arm", str(ROOT / "models" / "single_link")], "found 0 of 11 poses"),
    ],
)
def test_bad_flags_are_one_line_exit_code_2_and_touch_nothing(flags, text, tmp_path):
    (tmp_path / "report.json").write_text("earlier")
    done = run("--out", tmp_path, "--quick", *flags)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert text in done.stderr
    assert (tmp_path / "report.json").read_text() == "earlier"
