"""The study of model error as a stranger runs it: files, contract, claims."""

import pytest
from run_here import app_of_study, check_files, quick_study

from testbench.plant.disturbance import Disturbances
from testbench.studies.campaign.model_error import STUDY, DisturbanceSettings, disturbances

APP = app_of_study("model_error")
SOME = ("own weight", "payload mass", "payload centre")  #: Of the disturbances.
ONLY = [part for name in SOME for part in ("--only", name)]
quick, report, rows = quick_study(APP, "--seed", 2, "--seeds", 2, "--arms", "coupled", *ONLY)


def test_a_run_leaves_the_files_of_the_contract_and_says_where(quick):
    check_files(quick, "model_error.png")


def test_every_disturbance_is_switched_on_alone_and_all_together():
    none = vars(Disturbances())
    on = {
        name: [key for key, value in vars(case).items() if value != none[key]]
        for name, case in disturbances(1.0).items()
    }
    assert (on.pop("none"), len(on.pop("all together"))) == ([], 10)
    assert {len(fields) for fields in on.values()} == {1}


def test_payload_errors_spoil_the_model_and_not_the_arm(report, rows):
    for case in ("none", "payload mass", "payload centre"):
        assert {row["moved_um"] for row in rows if row["case"] == case and row["part"] == "family"} == {0}
    assert min(row["moved_um"] for row in rows if row["case"] == "own weight") > 0
    [centre] = [row for row in report["cells"]["ranking"] if row["case"] == "payload centre"]
    assert centre["added_um"]["median"] != 0


def test_kinds_beside_the_family_are_disturbed_in_every_way_and_sizes_are_of_the_same_arm():
    """Twice the disturbances by --scale, and beside the family, are the same arm and readings."""
    asked = {"workspace": 5, "only": ("backlash", "soft foundation"), "arms": ("coupled",)}
    [rows] = STUDY.work(DisturbanceSettings("kr500_l480", 2, **asked))([2])
    beside = {(r.true_arm, r.size, r.name): r for r in rows if r.part == "beside"}
    names = ("Joints", "MLS56 + prior", "ALL153 + prior")
    own = next(r.true_arm for r in rows if r.part == "family")
    assert beside.keys() == {
        (*arm, name) for arm in [(own, 0.5), (own, 2.0), ("coupled", 1.0)] for name in names
    }
    [twice] = STUDY.work(DisturbanceSettings("kr500_l480", 2, scale=2.0, workspace=5, only=asked["only"]))(
        [2]
    )
    for row in twice:
        if row.part == "family" and row.case == "all together" and row.sigma_um and row.name in names:
            assert row.rms_um == pytest.approx(beside[own, 2.0, row.name].rms_um, rel=1e-6)
    once = {r.name: r for r in rows if r.part == "family" and r.case == "all together" and r.sigma_um}
    assert all(abs(once[name].rms_um / beside[own, 2.0, name].rms_um - 1) > 1e-3 for name in names)
    coupled = beside["coupled", 1.0, "Joints"].deflection_um
    assert abs(coupled / once["Joints"].deflection_um - 1) > 1e-3


def test_intervals_are_judged_where_there_is_noise(rows):
    for row in rows:
        judged = row["cover.covered_percent"] is not None
        wanted = row["name"] in ("ALL153 + prior", "Joints + prior") and row["sigma_um"] > 0
        assert judged == wanted
        assert row["deflection_um"] > 1000
