"""The study of Eq. (7) as a stranger runs it: its files, its numbers, its manners."""

import csv

import numpy as np
import pytest
from run_here import app_of_study, check_files, here, numbers_alone, quick_study

from testbench.model.structure import joints_only
from testbench.model.vjm import WorkArea, evaluate_chain, observation_matrix
from testbench.studies.paper.loaded_stiffness import joints_alone
from testbench.workflows.cell import clear_poses

APP = app_of_study("loaded_stiffness")
METHODS = ["linear", "secant", "integrated", "joints"]
POSES, LOADS = 30, [1000.0, 2154.43, 4641.59, 10_000.0]
quick, report, rows = quick_study(APP, "--seed", 3)


def rms(report, truth, method):
    """RMS errors by load [um]."""
    rows = report["rows"]
    return np.array([r["rms_um"] for r in rows if (r["truth"], r["method"]) == (truth, method)])


def test_a_run_leaves_its_files_and_says_where(quick, report):
    check_files(quick, "loaded_stiffness.png", data="errors.csv")
    assert (report["scenario"], report["seed"], report["arm"]) == ("loaded_stiffness", 3, "kr500_l480")
    assert report["poses"] == POSES
    np.testing.assert_allclose(report["loads_N"], LOADS, rtol=1e-5)
    assert len(report["rows"]) == len(LOADS) * 2 * len(METHODS)


def test_integrated_is_exact_and_eq_7_taken_once_lies_between(report):
    linear, secant, integrated, _ = (rms(report, "weightless", method) for method in METHODS)
    assert (integrated < 1e-4 * secant).all()
    assert (secant < linear).all()
    # second order in load: between loads a factor 2.15 apart, errors are 4.64 apart, up to third order
    np.testing.assert_allclose(linear[1:] / linear[:-1], 4.64, rtol=0.02)


def test_own_weight_leaves_every_method_an_error_in_proportion_to_the_load(report):
    linear, secant, integrated, _ = (rms(report, "own weight", method) for method in METHODS)
    assert (integrated < secant).all()
    assert (secant < linear).all()
    np.testing.assert_allclose(integrated[1:] / integrated[:-1], 2.154, rtol=0.02)
    # a part of the sag that joints cannot mimic
    assert all(2 < row["rms_percent"] < 20 for row in report["rows"] if row["method"] == "joints")


def test_rows_of_errors_csv_add_up_to_the_report(quick, report):
    with (quick[0] / "errors.csv").open(newline="") as text:
        lines = list(csv.DictReader(text))
    assert len(lines) == POSES * len(report["rows"])
    case = ("load_N", "truth", "method")
    for expected in report["rows"]:
        own = [row for row in lines if [row[key] for key in case] == [str(expected[key]) for key in case]]
        parts = np.array([[float(row[f"error_{x}_m"]) for x in "xyz"] for row in own])
        assert 1e6 * np.sqrt(np.mean((parts**2).sum(axis=1))) == pytest.approx(expected["rms_um"], rel=1e-12)
    assert {int(row["run"]) for row in lines} == set(range(1, POSES * len(LOADS) + 1))


def test_joints_alone_are_the_best_that_joints_can_do(kr500):
    rng = np.random.default_rng(4)
    q = clear_poses(kr500, WorkArea((-4.0, -4.0, 0.8), (4.0, 4.0, 4.0)), 12, rng)
    wrench, point = np.tile([0, 0, -5e3, 0, 0, 0], (12, 1)), np.tile(kr500.vjm.load_point, (12, 1))
    A = observation_matrix(
        evaluate_chain(kr500.vjm, q), joints_only(kr500.arm), wrench, point, np.zeros((1, 3))
    )[:, 0]
    moved = A @ [1e-6, 4e-7, 2e-6, 3e-6, 5e-6, 1e-6]
    np.testing.assert_allclose(joints_alone(kr500, q, wrench, point, moved), moved, rtol=1e-9, atol=1e-15)
    bent = moved + 1e-4 * rng.standard_normal(moved.shape)
    left = bent - joints_alone(kr500, q, wrench, point, bent)
    slope = np.einsum("rxp,rx->p", A, left)  # of half the sum of squares: zero at its minimum
    assert np.abs(slope).max() < 1e-10 * np.abs(np.einsum("rxp,rx->p", A, bent)).max()


def alone(out, *flags):
    with numbers_alone():
        done = here(APP, *flags, "--out", out, "--quick")
    assert done.returncode == 0, done.stderr
    return (out / "report.json").read_bytes()


def test_same_seed_gives_the_same_numbers_byte_for_byte_and_another_seed_others(quick, tmp_path):
    same, other = (alone(tmp_path / str(seed), "--seed", seed) for seed in (3, 4))
    assert same == (quick[0] / "report.json").read_bytes() != other
