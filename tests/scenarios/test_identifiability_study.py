"""The study of identifiability as a stranger runs it: its files, its contract, its claims."""

import numpy as np
import pytest
from run_here import app_of_study, check_files, quick_study

from testbench.arm.folder import load_arm
from testbench.files.read_pairs import read_csv

APP = app_of_study("identifiability")
SEEDS = 3
"""One more than have a campaign."""
quick, report, rows = quick_study(APP, "--seed", 2, "--seeds", SEEDS, "--campaigns", 1)


def test_a_run_leaves_the_files_of_the_contract_and_says_where(quick):
    check_files(quick, "identifiability.png", "coverage.png")


def test_the_dataset_is_that_of_the_first_seed_and_the_report_counts_it(quick, report):
    data = read_csv(quick[0] / "dataset.csv", load_arm("kr500_l480"))
    counted = report["dataset"]
    assert (data.n_runs, data.n_points, round(1e6 * data.sigma)) == (counted["runs"], counted["points"], 50)
    assert counted["deflection_max_mm"] == pytest.approx(1e3 * np.linalg.norm(data.deflection, axis=-1).max())


def test_every_row_is_stored_and_the_report_counts_them(rows, report):
    fits = [row for row in rows if row["intervals.name"] is None]
    assert {row["seed"] for row in fits} == {2}
    assert {row["seed"] for row in rows} == {2, 3, 4}
    linear = {row["fit.name"]: row for row in fits if row["fit.part"] == "linear"}
    told = {m["name"]: m["rms_um"] for m in report["models"]}
    assert list(told) == [name for name in linear if name in told]
    assert told == {name: linear[name]["fit.rms_um"] for name in told}
    # a completion that does not exist is least squares once more
    assert {linear[name]["fit.constraint"] for name in linear.keys() - told.keys()} <= {"free"}
    for found in report["cells"]["coverage"]:
        name = found["interval"]
        own = [row["intervals.inside"] for row in rows if row["intervals.name"] == name]
        few = found["kind"] in ("learnt", "believed")  # of the family there are two datasets
        assert found["datasets"] == len(own) == (2 if few else SEEDS)
        widths = {tuple(row["intervals.width_um"]) for row in rows if row["intervals.name"] == name}
        assert len(widths) == len(own)  # every dataset has a seed of its own
        share = 100 * sum(map(sum, own)) / found["intervals"]
        assert found["covered_percent"] == pytest.approx(share, rel=1e-12)


def test_more_poses_help_and_eight_are_the_campaign_itself(report):
    few, many = (row for row in report["cells"]["poses"] if row["name"] == "MGCO68")
    assert (few["poses"], many["poses"]) == (8, 20)
    whole = next(m for m in report["models"] if m["name"] == "MGCO68")
    assert few["rms_um"] == pytest.approx(whole["rms_um"], rel=1e-9)  # solved beside other datasets
    assert many["rms_um"] < few["rms_um"]
