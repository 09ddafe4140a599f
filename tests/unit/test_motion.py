"""Joint moves in robots' languages: each file is read back by a small reader of that language."""

import re

import numpy as np
import pytest

from testbench.arm.folder import ArmJoint
from testbench.errors import BenchError
from testbench.files.languages import known_languages
from testbench.files.motion import Motion, format_of, write_moves

LEAST = 1e-7  #: What reading back may lose [deg, mm].
WORST = (
    'a "quote" {A1 99}\nEND\r\nPTP {A1 0}',
    ";FOLD x;%{PE}\tMoveAbsJ [[1,2",
    "ENDPROC\x0bENDMODULE",
    "Bohrung Ø8 – ünter 漢字\u2028movej([0,0,0,0,0,0])",
    "\\",
    "",
    "x" * 500,
)
"""Labels that would break out of a comment."""


def arm(kinds):
    """A joint a letter: h turns, s slides; names as a stranger gives them."""
    return tuple(
        ArmJoint(f"axis {k}\nEND;{x}", -7.0, 7.0, 1e-6, prismatic=x == "s") for k, x in enumerate(kinds)
    )


def moves(kinds, points=7):
    rng = np.random.default_rng(3)
    q = rng.uniform(-7, 7, (points, len(kinds)))
    q[0], q[1, 0] = 0.0, -1e-12
    return q


def shown(q, joints):
    return q * [joint.display_factor for joint in joints]


def read_krl(text):
    """A1 .., E1 .. of every PTP, by a reader that knows DEF, comments, calls of BAS, PTP and END."""
    lines = text.split("\r\n")
    assert re.fullmatch(r"DEF [A-Za-z]\w{0,23}\(\)", lines[0])
    assert lines[-2:] == ["END", ""]
    found = []
    for line in lines[1:-2]:
        if line.startswith("; ") or re.fullmatch(r"BAS\(#\w+,\d+\)", line):
            continue
        axes = re.fullmatch(r"PTP \{(.*)\}", line)
        assert axes, line
        found.append({a: float(x) for a, x in (pair.split(" ") for pair in axes[1].split(","))})
    return found


def read_rapid(text):
    """(robax, extax) of every MoveAbsJ."""
    lines = [line.strip() for line in text.split("\r\n")]
    module = re.fullmatch(r"MODULE ([A-Za-z]\w{0,31})", lines[0])
    assert lines[-3:] == ["ENDPROC", "ENDMODULE", ""]
    assert f"PROC run_{module[1]}()" in lines
    assert len(f"run_{module[1]}") <= 32
    found = []
    for line in lines[1:-3]:
        if line.startswith(("! ", "PROC ", "LOCAL CONST speeddata ")):
            continue
        move = re.fullmatch(r"MoveAbsJ \[\[(.*)\],\[(.*)\]\]\\NoEOffs,vMove,fine,tool0;", line)
        assert move, line
        found.append(tuple([float(x) for x in part.split(",")] for part in move.groups()))
    return found


def read_urscript(text):
    lines = text.split("\n")
    assert re.fullmatch(r"def [A-Za-z]\w*\(\):", lines[0])
    assert lines[-2:] == ["end", ""]
    found = []
    for line in lines[1:-2]:
        if line.startswith("  # "):
            continue
        move = re.fullmatch(r"  movej\(\[(.*)\], a=0.5, v=0.25\)", line)
        assert move, line
        found.append([float(x) for x in move[1].split(", ")])
    return np.array(found)


def written(tmp_path, name, kinds, labels=(), stem="part 1"):
    language, joints = known_languages()[name], arm(kinds)
    path = tmp_path / f"{stem}{language.suffix}"
    q = moves(kinds)
    write_moves(path, language, Motion(q, joints, labels, corrected=True))
    raw = path.read_bytes()
    assert re.match(language.begins.encode(), raw)
    assert raw.isascii()
    assert b"-0." not in re.sub(rb"-0\.0*[1-9]", b"", raw)  # no signed zero
    return raw.decode(), shown(q, joints)


@pytest.mark.parametrize(
    ("kinds", "order"),
    [
        ("hhhhhh", "A1 A2 A3 A4 A5 A6"),
        ("hhhhhhh", "A1 A2 A3 A4 A5 A6 E1"),
        ("hhhhhhhh", "A1 A2 A3 A4 A5 A6 E1 E2"),
        ("shhhhhh", "E1 A1 A2 A3 A4 A5 A6"),
        ("shhhhhhs", "E1 A1 A2 A3 A4 A5 A6 E2"),
        ("hhsh", "A1 A2 A3 A4"),
    ],
)
def test_krl_and_rapid_give_back_every_joint_at_its_axis(tmp_path, kinds, order):
    axes = order.split()
    text, expected = written(tmp_path, "krl", kinds, WORST)
    found = read_krl(text)
    assert "; point 1: a " in text
    assert "; point 8" not in text
    assert all(set(point) == set(axes) for point in found)
    np.testing.assert_allclose([[p[a] for a in axes] for p in found], expected, rtol=0, atol=LEAST)
    text, expected = written(tmp_path, "rapid", kinds, WORST)
    for (robot, beside), point in zip(read_rapid(text), expected, strict=True):
        have = {f"A{k}": x for k, x in enumerate(robot, 1)} | {f"E{k}": x for k, x in enumerate(beside, 1)}
        np.testing.assert_allclose([have.pop(a) for a in axes], point, rtol=0, atol=LEAST)
        assert all(x == (0 if a[0] == "A" else 9e9) for a, x in have.items())  # there is no such axis
        assert len(robot) == len(beside) == 6


def test_urscript_gives_back_six_joints_and_refuses_other_arms(tmp_path):
    text, expected = written(tmp_path, "urscript", "hhhhhh", WORST)
    np.testing.assert_allclose(np.degrees(read_urscript(text)), expected, rtol=0, atol=LEAST)
    for kinds in ("hhhhhhh", "hhhhh", "shhhhh"):
        with pytest.raises(BenchError, match="6 joints that turn"):
            written(tmp_path, "urscript", kinds)


READERS = {"krl": read_krl, "rapid": read_rapid, "urscript": read_urscript}
WORDS = {"krl": {"end", "ptp"}, "rapid": {"main", "mod"}, "urscript": {"end", "movej"}}
"""Words of a language among the names that are tried."""
ODD = ["7 Löcher; DEF", "end", "PTP", "_", "main", "movej", "a" * 200, "漢", "$x", "mod"]
TAKEN = {
    "krl": "sin E6POS strlen",
    "rapid": "tool0 wobj0 VMOVE num speeddata bool fine z0 z50 v1000 vmax MoveAbsJ MoveLDO CRobT ERR_NAME",
    "urscript": "get_inverse_kin movel set_tcp d2r pi write_output_integer_register end_force_mode None",
}
"""Names that the controller has, or the program."""
FREE = ("Zaun", "z", "value", "drill_1", "numbers", "home")


@pytest.mark.parametrize("name", READERS)
def test_every_name_is_made_legal_and_none_is_what_the_controller_has(tmp_path, name):
    taken = TAKEN[name].split()
    for stem in (*ODD, *taken, *FREE):
        text, _ = written(tmp_path, name, "hhhhhh", stem=stem)
        assert len(READERS[name](text)) == 7
        word = re.split(r"[\s(]", text)[1]
        assert word.lower() not in WORDS[name]
        assert stem in ODD or word == (f"p_{stem}" if stem in taken else stem)


def test_a_format_is_that_of_the_suffix(tmp_path):
    found = [format_of(tmp_path / f"x.{suffix}") for suffix in ("csv", "src", "MOD", "script")]
    assert found == ["csv", "krl", "rapid", "urscript"]
    with pytest.raises(BenchError, match="rapid"):
        format_of(tmp_path / "x.txt")


@pytest.mark.parametrize("name", READERS)
def test_what_cannot_be_a_program_leaves_no_file(tmp_path, name):
    """A joint may be beyond its limits by what a file rounds."""
    joints, path, q = arm("hhhhhh"), tmp_path / "x", np.zeros((3, 6))
    q[1, 4] = 7.0 + 5e-7
    write_moves(path, known_languages()[name], Motion(q, joints))
    path.unlink()
    beyond = r"point 3, axis 3\nEND;h: expected -401\.07.. to 401\.07.. deg, got"
    for q, labels, own, said in (
        (np.diag([0, 0, -7.1]) @ np.eye(3, 6, k=1), (), joints, beyond),
        (np.full((2, 6), np.nan), (), joints, "."),
        (np.zeros((2, 5)), (), joints, "."),
        (np.zeros((2, 6)), ("one",), joints, "."),
        (np.zeros((1, 13)), (), arm("h" * 13), "joints"),
    ):
        with pytest.raises(BenchError, match=said):
            write_moves(path, known_languages()[name], Motion(q, own, labels))
    assert not list(tmp_path.iterdir())
