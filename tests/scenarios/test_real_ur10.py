"""The study of a real UR10: its files, and what its readings say whatever is drawn."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from checks import check_markdown
from run_here import app_of, here

ROOT = Path(__file__).resolve().parents[2]
FILES = {
    "report.json", "report.md", "manifest.json", "errors.csv", "trials.parquet", "real_ur10.png",
    "joint_errors.png", "spectra.png", "recording.rrd",
    "report.html",
}  # fmt: skip
STORE = {"trials.jsonl", "trials", "prepared"}
SPRINGS, WAVES = "+ joint springs", "+ joint errors"


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    out = tmp_path_factory.mktemp("quick")
    done = here(
        app_of(ROOT / "scenarios" / "real_ur10.py"), "--seed", 3, "--out", out, "--quick", "--workers", 1
    )
    assert done.returncode == 0, done.stderr
    return out, json.loads((out / "report.json").read_text())


def errors(report, model, split):
    """Of every series that judges."""
    return [line["error"] for line in report["ladder"] if (line["name"], line["split"]) == (model, split)]


def mean(report, model, split):
    own = errors(report, model, split)
    return sum(e["n"] * e["mean_mm"] for e in own) / sum(e["n"] for e in own)


def test_a_run_leaves_its_files_and_a_bench_that_reads_them_knows_its_models(quick):
    out, report = quick
    assert {p.name for p in out.iterdir()} - STORE == FILES
    check_markdown((out / "report.md").read_text())
    assert (report["scenario"], report["seed"], report["arm"]) == ("real_ur10", 3, "ur10")
    assert [model["name"] for model in report["models"]] == ["geometry", SPRINGS, WAVES]
    assert all(model["conservative"] and model["min_eigenvalue"] > -1e-15 for model in report["models"])
    for line in report["ladder"]:
        e = line["error"]
        assert 0 < e["mean_mm"] < e["rms_mm"] < e["p95_mm"] <= e["p99_mm"] <= e["max_mm"] < 10
        assert 0 < e["inside_95_percent"] <= 100


def test_no_pane_of_the_recording_is_blank_on_any_timeline(quick, blank_panes):
    assert blank_panes(quick[0] / "recording.rrd") == []


def test_joint_errors_halve_what_joint_springs_leave_where_the_joints_were(quick):
    """Errors of gears last: blocks of joint space that were never fitted show them too."""
    _, report = quick
    for split in ("blocks", "blocks, realigned"):
        assert mean(report, WAVES, split) < mean(report, SPRINGS, split) / 2
        assert mean(report, SPRINGS, split) < mean(report, "geometry", split)
    assert 0.3 < mean(report, SPRINGS, "blocks") < 0.7  # what calibrated arms of this kind are off by [mm]
    assert min(e["inside_95_percent"] for e in errors(report, WAVES, "blocks")) > 70


def test_either_series_alone_finds_the_same_errors_of_the_joints_months_apart(quick):
    """And of a joint that they turned through other angles nothing is said."""
    _, report = quick
    pan, *others = report["joints"]
    assert pan["strange_to_A_percent"] == 100
    assert pan["correlation"] is None
    assert min(joint["correlation"] for joint in others) > 0.6  # by chance: below 0.3 over so many waves
    for joint in report["joints"]:
        assert all(rms > 50 for rms in (joint["rms_A_urad"], joint["rms_C_urad"]))  # 0.1 mm at a metre is 100


def test_joint_errors_mend_the_springs_that_they_bias(quick):
    """The elbow's spring, 10 urad/(N m) by the whole public set, seems half as soft without them."""
    _, report = quick
    elbow = {one["name"]: one["urad_per_Nm"][2] for one in report["compliances"] if one["trained"] == "both"}
    assert elbow[SPRINGS] < 0.75 * elbow[WAVES]
    assert 7 < elbow[WAVES] < 14


def test_rows_of_errors_csv_are_the_positions_that_were_judged(quick):
    out, report = quick
    with (out / "errors.csv").open(newline="") as text:
        rows = list(csv.DictReader(text))
    for name, model in (("springs", SPRINGS), ("joint_errors", WAVES)):
        off = np.array([[float(row[f"{name}_{x}_um"]) for x in "xyz"] for row in rows])
        far = 1e-3 * np.linalg.norm(off, axis=1)
        assert len(far) == sum(e["n"] for e in errors(report, model, "blocks"))
        assert far.mean() == pytest.approx(mean(report, model, "blocks"), rel=1e-4)  # rounded to 0.01 um


def test_the_page_says_what_the_numbers_say(quick):
    out, report = quick
    text = (out / "report.md").read_text()
    share = 100 * (1 - mean(report, WAVES, "blocks") / mean(report, SPRINGS, "blocks"))
    assert f"Joint errors over joint springs: {share:.0f} % less in blocks" in text
    assert f"{mean(report, WAVES, 'blocks'):.3f} mm with periodic joint errors" in text
    known = [one for one in report["known"] if one["here_mm"] is None]
    assert len(known) == len(report["known"])  # other numbers of poses with --quick
