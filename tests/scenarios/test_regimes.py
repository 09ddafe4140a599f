"""The study of regimes as a stranger runs it: files, the map, what every cell must hold."""

import pytest
from run_here import app_of_study, check_files, quick_study

from testbench.studies.campaign.regimes import GridSettings

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
        own = [row for row in rows if row["part"] == kind]
        assert len(own) == 4 * 5 * count  # GCO, least squares in three ways, and joints alone
        assert len(report["cells"][kind]) == count


def unbound(rows):
    """Errors of the methods by structure and case, where the cone does not bind."""
    found = {}
    for row in rows:
        if not row["binds"]:
            keys = ("seed", "part", "true_arm", "structure", "poses", "sigma_um")
            found.setdefault(tuple(row[key] for key in keys), {})[row["name"]] = row["rms_um"]
    return list(found.values())


def test_where_the_cone_does_not_bind_it_does_nothing_to_what_is_seen(rows):
    """The trace weight of GCO is all that is left, with the same free directions."""
    free = unbound(rows)
    assert len(free) > 20
    for own in free:
        assert own["GCO"] == pytest.approx(own["same free directions"], rel=0.02)
    most = max(own["GCO"] / own["least squares"] for own in free)
    assert most > 1.5  # what fills the free directions does
