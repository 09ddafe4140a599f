"""The battery itself: sound inputs pass, and what a command must not do is seen."""

from dataclasses import replace

import pytest


def test_sound_inputs_pass_and_change_the_output_alone(attack, lab):
    attack(lab, "check", "arm").done()
    made = attack(lab, "simulate", "arm", "poses.csv", "--payload-kg", "1", "--out", "new.csv")
    made.done("new.csv")
    assert made.changed == ("new.csv",)
    attack(lab, "check", "nothing").refused("nothing")


def test_what_no_refusal_may_do_is_seen(attack, lab):
    found = attack(lab, "check", "nothing")
    said = [{"err": f"error: {text}\n"} for text in ("x\nerror: y", "\x1b[2J")] + [{"err": "Traceback\n"}]
    for other in (*said, {"code": 0}, {"changed": ("data.csv",)}, {"peak": 3 * 10**9}):
        with pytest.raises(AssertionError):
            replace(found, **other).refused()
