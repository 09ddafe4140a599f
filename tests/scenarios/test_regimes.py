"""The study of regimes as a stranger runs it: files, the map, what every cell must hold."""

import pytest
from run_here import app_of_study, check_files, here, quick_study

from testbench.studies.regimes.trial import Settings

APP = app_of_study("regimes")
CELLS = {"gravity": 4 * 3 * 2, "full_pose": 4 * 2 * 2}
"""Structures, poses and levels of noise with --quick."""
quick, report, rows = quick_study(APP, "--seed", 4, "--seeds", 2)


def test_a_run_leaves_the_files_of_the_contract_and_says_where(quick):
    check_files(quick, "regimes.png")


def test_no_pane_of_the_recording_is_blank_on_any_timeline(quick, blank_panes):
    assert blank_panes(quick[0] / "recording.rrd") == []


def test_two_kinds_of_the_family_take_turns_in_every_cell(report, rows):
    assert [Settings().arms(seed) for seed in (4, 5)] == [["tubes", "off_20"], ["off_40", "cast"]]
    assert {(row["seed"], row["true_arm"]) for row in rows} == {
        (4, "tubes"), (4, "off_20"), (5, "off_40"), (5, "cast")
    }  # fmt: skip
    for kind, count in CELLS.items():
        assert len(report["cells"][kind]) == count
        assert all(cell["fits"] == 4 for cell in report["cells"][kind])


def test_where_the_cone_does_not_bind_it_does_nothing_to_what_is_seen(rows):
    """The trace weight of GCO is all that is left: in the fitted runs and with the same free directions."""
    free = [row for row in rows if row["uncertainty"] == "none" and not row["binds"]]
    assert len(free) > 20
    for row in free:
        assert row["gco_um"] == pytest.approx(row["lent_um"], rel=0.02)
        assert row["gco_fitted_um"] == pytest.approx(row["ls_fitted_um"], rel=0.02)
    assert max(row["gco_um"] / row["ls_um"] for row in free) > 1.5  # what fills the free directions does


def test_a_conservative_least_squares_with_a_prior_is_gco(rows):
    for row in rows:
        if row["uncertainty"] != "none" and not row["binds"]:
            assert row["gco_um"] == pytest.approx(row["ls_um"], rel=1e-3)


def test_another_truth_is_asked_for_and_an_unknown_one_refused(tmp_path):
    done = here(
        APP, "--quick", "--seeds", 1, "--truth", "joints", "--truth", "rust", "--out", tmp_path / "out"
    )
    assert done.returncode == 2
    assert "--truth: expected different ones of tubes, off_10" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()
