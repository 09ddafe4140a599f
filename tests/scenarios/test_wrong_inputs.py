"""The study of wrong inputs as a stranger runs it: files, what is planted, what is said of it."""

import pytest
from run_here import app_of_study, check_files, check_refused, quick_study

from testbench.bench.campaign import stream
from testbench.studies.wrong_inputs.before import noticed
from testbench.studies.wrong_inputs.faults import FAULTS
from testbench.studies.wrong_inputs.sound import sound
from testbench.studies.wrong_inputs.trial import Options, row, settings

APP = app_of_study("wrong_inputs")
PLANTED = {303: "kilograms", 304: "frame_tilted"}
"""By turns: one fault a trial."""
FLAGS = [word for fault in ("frame_tilted", "kilograms") for word in ("--fault", fault)]
quick, report, rows = quick_study(APP, "--seed", 303, "--seeds", 2, *FLAGS)


@pytest.fixture(scope="module")
def hung(kr500, arm_6r):
    """A sound set of a KR 500 in the base's frame, one hung mass."""
    found = sound({"kr500_l480": kr500, "arm_6r": arm_6r}, 303)
    assert (found.cell.arm.name, found.loads, found.tracker) == ("kr500_l480", "hung", False)
    return found


def planted(own, fault):
    return FAULTS[fault].plant(own, stream(303, 40))


def test_a_run_leaves_the_files_of_the_contract_and_says_where(quick):
    check_files(quick, "wrong_inputs.png")


def test_every_trial_is_a_sound_set_and_its_faults(rows, report):
    assert [(own["seed"], own["case"]) for own in rows] == [
        (seed, case) for seed, fault in PLANTED.items() for case in ("sound", fault)
    ]
    for own in rows:
        assert own["right"] == (
            own["first"] in FAULTS[own["case"]].names if own["case"] in FAULTS else not own["first"]
        )
    assert report["right"]["of"] == report["alarms"]["of"] == 2
    assert report["shown"] == 303
    assert report["dataset"]["runs"] == rows[0]["measured.runs"]


def test_faults_are_planted_in_the_first_trials_by_turns_with_quick():
    asked = settings(Options(planted=3), quick=False, seeds=range(7, 20))
    assert [len(asked.planted_in(seed)) for seed in range(7, 12)] == [len(FAULTS)] * 3 + [0] * 2
    by_turns = settings(Options(), quick=True, seeds=range(7, 20))
    each = [by_turns.planted_in(seed) for seed in range(7, 7 + by_turns.turns)]
    assert sorted(fault for own in each for fault in own) == sorted(FAULTS)


def test_a_set_is_judged_by_its_first_doubt(hung):
    """A fault that is named by the doubts of another is not named right, and one that is none is silent."""
    equal = planted(hung, "equal")
    right, wrong = row("equal_once", equal), row("kilograms", equal)
    assert (right.first, right.right, right.anywhere) == ("equal", True, True)
    assert (wrong.first, wrong.right, wrong.anywhere) == ("equal", False, False)
    alarm, silent = row("sound", equal), row("equal", hung)
    assert (alarm.right, silent.right) == (False, False)
    assert silent.first is None


def test_the_two_checks_before_see_what_they_saw(hung):
    """Far readings and moves against the force, and not what they never saw."""
    seen = {
        fault: noticed(own.cell, own.data)
        for fault in ("axes", "swapped", "force_sign", "kilograms", "joint_zero", "noise")
        for own in [planted(hung, fault)]
    }
    assert [fault for fault, own in seen.items() if own] == ["axes", "swapped", "force_sign"]
    assert not noticed(hung.cell, hung.data)


@pytest.mark.parametrize(
    ("twice", "said"), [("rust", "different ones of frame_tilted"), ("names", "got 'names'")]
)
def test_faults_that_are_unknown_or_asked_for_twice_are_refused(tmp_path, twice, said):
    check_refused(APP, tmp_path / "out", ["--fault", twice, "--fault", twice], said)
