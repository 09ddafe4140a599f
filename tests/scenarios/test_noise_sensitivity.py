"""The study of noise as a stranger runs it: files, claims, resume, refusals."""

import pytest
from pyarrow import parquet
from run_here import app_of_study, check_files, here, is_refused, numbers_alone, quick_study

APP = app_of_study("noise_sensitivity")
LEVELS = (0.0, 25.0, 200.0)  # um
SIGMAS = [part for level in LEVELS for part in ("--sigma-um", level)]
FLAGS = ["--seed", 6, "--quick", "--workers", 1, *SIGMAS]
first, *_ = quick_study(APP, "--seed", 6, "--seeds", 1, *SIGMAS, less=numbers_alone)


@pytest.fixture(scope="module")
def before(first):
    """The rows of a finished run."""
    return parquet.read_table(first[0] / "trials.parquet").to_pylist()


@pytest.fixture(scope="module")
def quick(first, before):
    """The same run, resumed with one trial more."""
    done = here(APP, *FLAGS, "--seeds", 2, "--out", first[0], "--resume")
    assert done.returncode == 0, done.stderr
    return first[0], done


@pytest.fixture(scope="module")
def rows(quick):
    return parquet.read_table(quick[0] / "trials.parquet").to_pylist()


def test_a_run_leaves_the_files_of_the_contract_and_says_where(quick):
    check_files(quick, "noise_sensitivity.png")


def test_every_trial_is_in_the_parquet_file(rows):
    assert {row["seed"] for row in rows} == {6, 7}
    assert sum(row["part"] == "six_dof" for row in rows) == 2 * 15 * len(LEVELS)
    read_by = [row["name"] for row in rows if row["part"] == "instrument"]
    assert (read_by.count("MGCO56 + prior"), read_by.count("ALL153 + prior")) == (2 * 8, 2 * 2)
    assert {(row["seed"], row["true_arm"]) for row in rows} == {(6, "tubes"), (7, "off_10")}
    assert all(row["solved"] for row in rows if row["constraint"] != "free")
    names = [
        row["name"] for row in rows if (row["seed"], row["part"], row["sigma_um"]) == (6, "gravity", 25.0)
    ]
    held = ["MLS56, PSD of equal fit", "Ridge", "Clipped LS"]
    filled = ("Joints", "MLS56", "MGCO56", "MGCO68", "LS153", "ALL153")
    plain = ["Joints", "MLS32", "MLS56", *held, "MGCO47", "MGCO56", "MGCO68"]
    assert names == plain + [f"{name} + prior" for name in filled]


@pytest.fixture(scope="module")
def six_dof(rows):
    """Fits of section 5.2 by true arm, model and noise."""
    own = [row for row in rows if row["part"] == "six_dof"]
    return {(row["true_arm"], row["name"], row["sigma_um"]): row for row in own}


def test_error_grows_in_proportion_to_noise_where_the_template_holds_the_truth(six_dof):
    errors = [six_dof["tubes", "MLS32", x]["rms_um"] for x in LEVELS]
    assert errors[0] < 1e-3  # um: no noise, no error
    assert six_dof["off_10", "MLS32", 0.0]["rms_um"] > 100  # um: what no tube can be
    for value, level in zip(errors[1:], LEVELS[1:], strict=True):
        # orientation readings turn one after the other: not quite linear
        assert value / level == pytest.approx(errors[-1] / LEVELS[-1], rel=1e-3)


def test_least_squares_of_equal_fit_errs_as_least_squares_does_in_full_poses(six_dof):
    """Readings of full poses see all predictions: the free directions change nothing but the cone."""
    for sigma in LEVELS[1:]:
        plain, filled = (six_dof["tubes", name, sigma] for name in ("MLS56", "MLS56, PSD of equal fit"))
        assert filled["rms_um"] == pytest.approx(plain["rms_um"], rel=1e-6)
        assert plain["conservative"] == 0
        assert filled["conservative"] == 1 or sigma > 25  # more noise pulls what is seen out of the cone


def test_a_finished_run_is_resumed_with_more_trials_and_the_old_ones_stand(before, rows):
    assert {row["seed"] for row in before} == {6}
    assert {row["seed"] for row in rows} == {6, 7}
    assert sorted(map(repr, before)) == sorted(repr(row) for row in rows if row["seed"] == 6)


def test_resume_into_the_folder_of_other_settings_is_refused(quick):
    out, _ = quick
    is_refused(here(APP, *FLAGS, "--seeds", 2, "--out", out, "--resume", "--sigma-um", 50), "trials")
