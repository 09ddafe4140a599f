"""What must be confirmed of an arm, and what may be wrong with it: every doubt planted and named."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from spoil import swap

from testbench.cli.check import report
from testbench.files.robot.chain import read_chain
from testbench.model.vjm import evaluate_chain
from testbench.workflows.arm_check import check
from testbench.workflows.new_arm import UserInputs, elastic_toml, propose

MODELS = Path(__file__).parents[2] / "models"
TOML, XML = "elastic.toml", "rigid.xml"


@pytest.fixture(scope="module")
def sound():
    return check("kr500_l480")


def planted(tmp_path, *changes, name="kr500_l480"):
    """A copy of an arm with changes (file, pattern, new), checked."""
    folder = Path(shutil.copytree(MODELS / name, tmp_path / name))
    for file, pattern, new in changes:
        swap(pattern, new)(folder / file)
    return check(folder)


WRONG = r"""
tube length: link_2: its tube is 3.9 m long, its frames are 1.3 m apart
    elastic.toml: (?<=value = )1\.3(?=, unit) -> 3.9
tube length: link_2: its tube is 0.13 m long, its frames are 1.3 m apart
    elastic.toml: (?<=value = )1\.3(?=, unit) -> 0.13
beam axis: link_2: its beam axis points 90 deg off the next frame, 1.3 m away
    elastic.toml: (?<=name = "link_2"\naxis = )\[1.0, 0.0, 0.0\] -> [0.0, 0.0, 1.0]
tube diameter: link_6: its tube is 0.4 m thick and 0.12 m long
    elastic.toml: (?<=outer_diameter = \{ value = )0\.2(?=,) -> 0.4
tube diameter: link_2: its tube is 1.4 m thick, its drawn shape
    elastic.toml: (?<=outer_diameter = \{ value = )0\.34(?=,) -> 1.4
joint compliance: joint_5 is 120 times as soft as its neighbour joint_4
    elastic.toml: 0\.7e-6 -> 30e-6
sag: its 0.4603 kg move the tool by 0.00346 mm (median over the poses), expected 0.1 to 30 mm
    elastic.toml: 460\.3 -> 0.4603
points of the tool: load is 3.5 m from the tool, but the arm reaches only 3.37 m
    rigid.xml: (?<=<body name="load" pos=)"0.35 0.14 -0.08" -> "3.5 0.14 -0.08"
points of the tool: markers P1, P2, P3 lie on a line
    rigid.xml: (?<=<body name="P3" pos=)"0.16 -0.12 -0.40" -> "0.30 0.04 0.25"
mass: link_3 weighs 545,200 kg of the arm's
    rigid.xml: mass="545\.2" -> mass="545200"
mass: kg/m^3 in its collision shapes, expected 300 to 4000
    rigid.xml: mass="545\.2" -> mass="9545.2"
mass: link_3 weighs only 0.001 kg of the arm's
    rigid.xml: mass="545\.2" -> mass="0.001"
base: the first turning joint is 90 deg off the vertical: is the base tilted?
    rigid.xml: <body name="link_0"> -> <body name="link_0" quat="0.7071067811865476 0.7071067811865476 0 0">
base: the arm hangs 1 m below its base: is it overhead?
    rigid.xml: <body name="link_0"> -> <body name="link_0" quat="0 1 0 0">
"""
"""Name and words of a doubt; below it the file, the place, and what is written there."""


@pytest.mark.parametrize("wrong", re.findall(r"^(\w[\w ]*): (.*)\n    (.*?): (.*) -> (.*)$", WRONG, re.M))
def test_what_is_wrong_with_an_arm_is_named_with_its_numbers(tmp_path, wrong):
    name, words, *change = wrong
    found = planted(tmp_path, change)
    assert name in {doubt.name for doubt in found.doubts}
    assert any(words in doubt.sentence for doubt in found.doubts), found.doubts
    assert len(report(found).claims) == len(found.doubts)


@pytest.mark.parametrize("name", ["kr500_l480", "arm_6r", "single_link", "ur10"])
def test_our_arms_raise_no_doubt(name):
    assert check(name).doubts == []


def test_shares_of_the_sag_are_each_spring_s_alone_and_what_is_to_confirm_is_in_their_order(sound, tmp_path):
    """By superposition: the sag with one joint made rigid is the rest of it."""
    cell = sound.cell
    assert sound.sag.shares.sum() == pytest.approx(1)
    [weight] = [item for item in sound.items if item.words.startswith("joint_5's compliance")]
    where = evaluate_chain(cell.vjm, sound.sag.q)
    axis = where.J_theta[:3, 46].T  # joint 5 stands behind 42 of the links and four joints
    load = -9.81 * (
        axis[:, 2] + np.cross(where.J_theta[3:, 46].T, where.tool_rotation @ cell.vjm.load_point)[:, 2]
    )
    alone = 0.7e-6 * load[:, None] * axis
    whole = sound.sag.whole
    assert weight.share == pytest.approx(float((alone * whole).sum() / (whole * whole).sum()), rel=1e-9)
    shares = [item.share for item in sound.items]
    assert shares == sorted(shares, reverse=True)
    assert not any("payload" in item.words for item in sound.items)  # published
    unsure = (TOML, r'origin = "published", note = "as hangs in section 6"', 'origin = "estimated"')
    points = (TOML, r'(?<=markers = \["P1", "P2", "P3"\]\n)', 'to_confirm = ["load", "P2"]\n')
    found = planted(tmp_path, unsure, points).items
    assert found[0].words == "payload 460.3 kg, estimated: the deflection is proportional to it"
    assert any(item.words.startswith("load point load, estimated") for item in found)
    assert any(item.words.startswith("markers P2, estimated") for item in found)


def test_a_proposal_for_the_geometry_of_our_kr500_sags_within_three_times_as_it_does(tmp_path, sound):
    """Its shapes and a rated payload of 500 kg are all that the proposal knows of it."""
    folder = Path(shutil.copytree(MODELS / "kr500_l480", tmp_path / "proposed"))
    markers = tuple((name, np.zeros(3)) for name in ("P1", "P2", "P3"))  # their places stay in rigid.xml
    robot = read_chain(folder / XML, "tool")
    wishes = UserInputs(payload=500.0, markers=markers)
    (folder / TOML).write_text(elastic_toml(robot, wishes, propose(robot, wishes)), "utf-8")
    proposed = check(folder)
    assert proposed.doubts == []
    np.testing.assert_array_equal(proposed.sag.q, sound.sag.q)
    ratio = proposed.sag.size / sound.sag.size
    assert 1 / 3 < ratio.min() <= ratio.max() < 3
