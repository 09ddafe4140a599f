"""The study of absolute calibration: a quick run, and what its rows and words are made of."""

import numpy as np
import pytest
from run_here import app_of_study, check_files, quick_study

from testbench.arm.folder import load_arm
from testbench.files.read_series import read_series
from testbench.studies.absolute.simulated import CHOSEN, DRAWN, STUDY, AbsoluteOptions

APP = app_of_study("absolute_calibration")
quick, report, rows = quick_study(APP, "--seed", 304, "--seeds", 1)


def test_a_run_leaves_the_files_of_the_contract_and_says_where(quick):
    check_files(quick, "absolute_calibration.png")
    [read] = read_series(quick[0] / "dataset.csv", load_arm("ur10")).series
    assert read.n_rows == 20


def test_every_trial_has_the_rows_that_its_questions_need(rows, report):
    true = {row["true_arm"] for row in rows}
    assert true == {"real", "no joint errors", "rigid links", "kinder", "nastier"}
    assert {row["readings"] for row in rows} == {20}
    poses = {row["campaign"]: row["poses"] for row in rows}
    assert poses == {"absolute alone": 20, "mixed": 15, "pairs alone": 10}
    assert (report["arms"], report["dataset"]["runs"]) == (["ur10"], 20)


def test_what_is_drawn_are_the_errors_of_the_first_trial(rows):
    drawn = {row["name"]: row for row in rows if row["off_um"]}
    assert tuple(drawn) == DRAWN
    off = np.reshape(drawn[CHOSEN]["off_um"], (100, -1)) / 1e3
    assert np.sqrt((off**2).sum(axis=1).mean()) == pytest.approx(drawn[CHOSEN]["error_mm"], rel=1e-3)


def test_arms_take_turns_and_many_poses_are_rare():
    asked = STUDY.settings(AbsoluteOptions(), False, range(1))
    assert [asked.arm_of(seed) for seed in range(4)] == ["ur10", "kr500_l480"] * 2
    assert [seed for seed in range(16) if 1000 in asked.numbers_of(seed)] == [0, 1, 8, 9]
