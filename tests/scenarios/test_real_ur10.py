"""The study of a real UR10: its files, and what its readings say whatever is drawn."""

import csv

import numpy as np
import pytest
from run_here import app_of_study, check_files, quick_study

SPRINGS, WAVES, SHARED = "+ joint springs", "+ joint errors", "+ common pattern"
quick, report, rows = quick_study(app_of_study("real_ur10"), "--seed", 3)


def errors(report, model, split):
    """Of every series that judges."""
    return [line["error"] for line in report["ladder"] if (line["name"], line["split"]) == (model, split)]


def mean(report, model, split):
    own = errors(report, model, split)
    return np.average([e["mean_mm"] for e in own], weights=[e["n"] for e in own])


def test_a_run_leaves_its_files_and_means_of_its_ladder(quick, report, blank_panes):
    check_files(quick, "real_ur10.png", data="errors.csv")
    assert blank_panes(quick[0] / "recording.rrd") == []
    assert (report["scenario"], report["seed"], report["arm"]) == ("real_ur10", 3, "ur10")
    assert [model["name"] for model in report["models"]] == ["geometry", SPRINGS, WAVES, SHARED]
    assert all(model["conservative"] and model["min_eigenvalue"] > -1e-15 for model in report["models"])
    for line in report["ladder"]:
        e = line["error"]
        assert 0 < e["mean_mm"] < e["rms_mm"] < e["p95_mm"] <= e["max_mm"] < 10
        assert 0 < e["coverage_95"] <= 1
    means = {model["name"]: model["blocks_mm"] for model in report["models"]}
    assert means[SHARED] == pytest.approx(mean(report, SHARED, "blocks"))


def test_joint_errors_halve_what_joint_springs_leave_where_the_joints_were(report):
    """Errors of gears last: blocks of joint space that were never fitted show them too."""
    for split in ("blocks", "blocks, realigned"):
        assert mean(report, WAVES, split) < mean(report, SPRINGS, split) / 2
        assert mean(report, SPRINGS, split) < mean(report, "geometry", split)
    assert 0.3 < mean(report, SPRINGS, "blocks") < 0.7  # what calibrated arms of this kind are off by [mm]
    assert min(e["coverage_95"] for e in errors(report, WAVES, "blocks")) > 0.7


def test_either_series_alone_finds_the_same_errors_of_the_joints_months_apart(report):
    """And of a joint that they turned through other angles nothing is said."""
    pan, *others = report["joints"]
    assert pan["strange_to_A_percent"] == 100
    assert pan["correlation"] is None
    assert min(joint["correlation"] for joint in others) > 0.6  # by chance: below 0.3 over so many waves
    for joint in report["joints"]:
        assert all(rms > 50 for rms in (joint["rms_A_urad"], joint["rms_C_urad"]))  # 0.1 mm at a metre is 100


def test_joint_errors_mend_the_springs_that_they_bias(report):
    """The elbow's spring, 10 urad/(N m) by the whole public set, seems half as soft without them."""
    elbow = {one["name"]: one["urad_per_Nm"][2] for one in report["compliances"] if one["trained"] == "both"}
    assert elbow[SPRINGS] < 0.75 * elbow[SHARED]
    assert 7 < elbow[SHARED] < 14


def test_rows_of_errors_csv_are_the_positions_that_were_judged(quick, report):
    with (quick[0] / "errors.csv").open(newline="") as text:
        found = list(csv.DictReader(text))
    for name, model in (("springs", SPRINGS), ("joint_errors", SHARED)):
        off = np.array([[float(row[f"{name}_{x}_um"]) for x in "xyz"] for row in found])
        far = 1e-3 * np.linalg.norm(off, axis=1)
        assert len(far) == sum(e["n"] for e in errors(report, model, "blocks"))
        assert far.mean() == pytest.approx(mean(report, model, "blocks"), rel=1e-4)  # rounded to 0.01 um


def test_joints_share_a_pattern_that_tells_of_angles_that_a_series_lacks(report):
    """Of a sixth of the rows C's are enough to find it."""
    for split in ("C to A", "C and 50 of A to A", "C and 50 planned of A to A"):
        assert mean(report, SHARED, split) < 0.97 * mean(report, WAVES, split)
        [error] = errors(report, SHARED, split)
        assert error["coverage_95"] > 0.8
