"""Section 5.2 as a stranger runs it: its files, its contract, its claims."""

import numpy as np
import pytest
from run_here import ROOT, app_of_study, check_files, quick_study

from testbench.arm.folder import load_arm
from testbench.files.read_pairs import read_csv

APP = app_of_study("six_dof_arm")
COMPLETED = "MLS56, PSD of equal fit"
MODELS = {
    "MLS56": 56, "MLS32": 32, "MGCO147": 147, "MGCO69": 69, "MGCO56": 56, "Joints": 6, COMPLETED: 56,
    "Ridge": 56, "Clipped LS": 56,
}  # fmt: skip
quick, report, rows = quick_study(APP, "--seed", 3, "--seeds", 2)


def test_a_run_leaves_the_files_of_the_contract_and_the_first_seeds_runs_with_orientations(quick):
    check_files(quick, "six_dof_arm.png")
    data = read_csv(quick[0] / "dataset.csv", load_arm(ROOT / "models" / "arm_6r"))
    assert (data.n_runs, data.rotation_before is None) == (108, False)
    assert data.sigma == pytest.approx(25e-6 / np.sqrt(2), rel=1e-12)
    assert data.sigma_rotation == pytest.approx(250e-6 / np.sqrt(2), rel=1e-12)


def test_report_has_tables_i_and_ii_for_both_truths(report):
    assert (report["scenario"], report["seed"], report["truth"]) == ("six_dof_arm", [3, 4], "linear")
    data = report["dataset"]
    assert (data["runs"], data["poses"], data["check_runs"]) == (108, 18, 120)
    assert {m["name"]: m["parameters"] for m in report["models"]} == MODELS
    for m in [own for both in report["models"] for own in (both, both["nonlinear"])]:
        assert m["conservative"] is (m["constraint"] not in ("none", "ridge") or m["name"] == "Joints")
        assert m["status"] == "solved"
        assert set(m) >= {"identification", "check", "check_true"}
    errors = report["map"]["error_mm"]
    assert {name: len(mm) for name, mm in errors.items()} == dict.fromkeys(MODELS, 120)


def test_least_squares_is_conservative_with_the_same_fit_and_predicts_the_same(report):
    models = {m["name"]: m for m in report["models"]}
    plain, completed = models["MLS56"], models[COMPLETED]
    assert (plain["conservative"], completed["conservative"]) == (False, True)
    assert completed["f_m"]["median"] == pytest.approx(plain["f_m"]["median"], rel=1e-7)
    same = [m["check_true"]["rms_mm"]["median"] for m in (plain, completed)]
    assert same[1] == pytest.approx(same[0], rel=1e-6)  # the rest of MLS56 moves no prediction
    assert [(t["free"], t["also_conservative"], t["seeds"]) for t in report["ties"]] == [(24, 2, 2)] * 2


def test_order_m_falls_to_the_optimum(report):
    assert report["order"]["seeds"] == [3]
    for name in ("MGCO69", "MGCO56"):
        rows = report["order"][name]
        assert [row["m"] for row in rows] == [1, 2, 3, 4, 5, 6]
        excess = np.array([row["f_m_over_optimum"] for row in rows])
        assert (excess > 1 - 1e-7).all()  # the conic optimum is certified to 1e-5 and reached to 1e-8
        assert excess[-1] < 1 + 1e-5
        assert all(row["conservative"] for row in rows)
    assert report["order"]["MGCO69"][0]["f_m_over_optimum"] > 2
