"""The study of regimes as a stranger runs it: files, the map, what every cell must hold."""

from run_here import app_of_study, check_files, quick_study

from testbench.studies.campaign.grids import GridSettings

APP = app_of_study("regimes")
CELLS = {"gravity": 4 * 3 * 2, "full_pose": 4 * 2 * 2}
"""Structures, poses and levels of noise with --quick."""
quick, report, rows = quick_study(APP, "--seed", 4, "--seeds", 2)


def test_a_run_leaves_the_files_of_the_contract_and_says_where(quick):
    check_files(quick, "regimes.png")


def test_two_kinds_of_the_family_take_turns_in_every_cell(report, rows):
    assert [GridSettings(4).arms(seed) for seed in (4, 5)] == [["tubes", "off_20"], ["off_40", "cast"]]
    assert {(row["seed"], row["true_arm"]) for row in rows} == {
        (4, "tubes"), (4, "off_20"), (5, "off_40"), (5, "cast")
    }  # fmt: skip
    for kind, count in CELLS.items():
        own = [row for row in rows if (row["part"], row["uncertainty"]) == (kind, "none")]
        assert len(own) == 4 * 5 * count  # GCO, least squares in three ways, and joints alone
        assert len(report["cells"][kind]) == count
