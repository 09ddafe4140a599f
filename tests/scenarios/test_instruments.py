"""The study of instruments as a stranger runs it: files, every instrument, what must hold in any trial."""

import pytest
from run_here import app_of_study, check_files, quick_study

from testbench.studies.campaign.instruments import ONE, THREE, TRACKER, USUAL

APP = app_of_study("instruments")
quick, report, rows = quick_study(APP, "--seed", 3, "--seeds", 1)


@pytest.fixture(scope="module")
def default(rows):
    return {row["instrument"]: row for row in rows if row["name"] == "ALL153 + prior"}


def test_a_run_leaves_the_files_of_the_contract_and_says_where(quick):
    check_files(quick, "instruments.png")


def test_every_instrument_is_read_in_the_same_poses(default, rows):
    assert {row["poses"] for row in rows} == {USUAL}
    assert {TRACKER, THREE, ONE, "camera, 100 um", "one draw-wire"} <= set(default)


def test_three_readings_of_a_pose_see_half_of_what_a_rigid_tool_shows_and_one_a_sixth(default):
    assert [default[name]["rank"] for name in (TRACKER, THREE, ONE)] == [6 * USUAL, 3 * USUAL, USUAL]


def test_all_instruments_stay_in_range(default):
    """The ballbar does so because a tenth of the weight hangs while it is read."""
    assert {row["read_percent"] for row in default.values()} == {100}


def test_the_dataset_is_that_of_the_gauges(quick):
    head = (quick[0] / "dataset.csv").read_text().splitlines()[0]
    assert "travel_after_m" in head
    assert "before_x_m" not in head


def test_the_verdict_compares_gauges_with_the_tracker(report, default):
    badge = report["badge"]
    assert {badge["winner"], badge["rival"]} == {THREE, TRACKER}
    ratio = default[badge["rival"]]["rms_um"] / default[badge["winner"]]["rms_um"]
    assert badge["factor"] == pytest.approx(ratio, rel=1e-3)
