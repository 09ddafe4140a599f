"""The battery itself: sound inputs pass, and what a command must not do is seen."""

from dataclasses import replace

import pytest


def test_sound_inputs_pass_and_change_the_output_alone(attack, lab):
    attack(lab, "check", "arm").done()
    made = attack(lab, "simulate", "arm", "poses.csv", "--payload-kg", "1", "--out", "new.csv")
    made.done("new.csv")
    assert made.changed == ("new.csv",)
    attack(lab, "check", "nothing").refused("nothing")


@pytest.mark.parametrize(
    "other",
    [
        {"code": 0},
        {"err": "error: x\nerror: y\n"},
        {"err": "Traceback\n"},
        {"err": "error: \x1b[2J\n"},
        {"changed": ("data.csv",)},
        {"peak": 3 * 10**9},
    ],
)
def test_what_no_refusal_may_do_is_seen(attack, lab, other):
    found = attack(lab, "check", "nothing")
    with pytest.raises(AssertionError):
        replace(found, **other).refused()
