"""`testbench new`: a robot's file becomes a folder in one command, or one line says why not."""

import csv
import random
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from oracles import pinocchio_urdf
from run_here import do, fine, is_refused
from strangers import ROBOTS, classes_mjcf, heavy_urdf, light_urdf, mounted_mjcf, sliding_mjcf

from testbench.arm.folder import load_arm
from testbench.files.robot.chain import read_chain
from testbench.model.kinematics import build_vjm
from testbench.model.vjm import body_poses, tool_poses
from testbench.plant.rigid_cell import build_rigid_cell, find_collisions
from testbench.workflows.arm_check import check
from testbench.workflows.new_arm import sentence

STRANGERS = light_urdf, heavy_urdf, classes_mjcf, mounted_mjcf, sliding_mjcf
BY_NAME = {"heavy": heavy_urdf, "classes": classes_mjcf, "sliding": sliding_mjcf}
FUZZED = 25


def test_a_robot_s_file_is_an_arm_in_one_command(tmp_path):
    flags = "--payload-kg", 3, "--tool", "0,0,0.1,0,0,45", "--load", "0,0,0.05"
    said = fine("new", tmp_path / "mine", "--from", light_urdf(tmp_path), *flags)
    assert "7 joints, tool at 'tool0'" in said
    assert "bodies merged into link_7: hand" in said
    assert "<!-- bodies merged into link_7: hand" in (tmp_path / "mine/rigid.xml").read_text()
    arm = load_arm(tmp_path / "mine")
    assert (arm.payload, arm.n_joints) == (3, 7)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["light_support", "mine"]


def test_the_advice_on_xacro_works_without_ros(tmp_path):
    """The command as printed, of a file that includes another package's; never over the file itself."""
    pytest.importorskip("xacrodoc")  # absent where .venv is older than requirements.lock
    text = heavy_urdf(tmp_path).read_text()
    home, other = tmp_path / "ws/my robot", tmp_path / "ws/parts"
    for folder, name in ((home, "mine"), (other, "parts"), (tmp_path / "ws/more", "more")):
        (folder / "urdf").mkdir(parents=True)
        (folder / "package.xml").write_text(f"<package><name>{name}</name></package>")
    xacro = 'xmlns:xacro="http://ros.org/wiki/xacro"'
    inside = text.replace('<robot name="heavy">', f'<robot {xacro}><xacro:macro name="arm" params="deep">')
    inside = inside.replace('upper="1.5"', 'upper="${deep * 3}"').replace(
        "</robot>", "</xacro:macro></robot>"
    )
    called = '<xacro:include filename="$(find more)/deep.xacro"/>'
    (other / "arm.xacro").write_text(inside.replace("<xacro:macro", f"{called}<xacro:macro", 1))
    deep = '<xacro:property name="deep" value="0.4"/>'
    (tmp_path / "ws/more/deep.xacro").write_text(f"<robot {xacro}>{deep}</robot>")
    file = home / "urdf/robot.urdf.xacro"
    called = '<xacro:include filename="$(find parts)/arm.xacro"/><xacro:arm deep="${deep}"/>'
    file.write_text(f'<robot name="r" {xacro}>{called}</robot>')
    said = is_refused(do("new", tmp_path / "mine", "--from", file))
    command = re.search("pip install xacrodoc; (xacrodoc .*); arguments", said)[1]
    plain = {"PATH": f"{Path(sys.executable).parent}:/usr/bin:/bin"}
    done = subprocess.run(command, shell=True, env=plain, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    fine("new", tmp_path / "mine", "--from", file.with_name("robot_expanded.urdf"))
    assert load_arm(tmp_path / "mine").limits[1] == pytest.approx([1.2] * 6)


def test_an_arm_that_exists_is_not_touched(tmp_path):
    (tmp_path / "mine").mkdir()
    assert "exists already" in is_refused(do("new", tmp_path / "mine", "--from", heavy_urdf(tmp_path)))
    assert not list((tmp_path / "mine").iterdir())


def with_rods(folder, flange):
    """The heavy arm with rods on link 3 that follow joint 2: their branch is longer than the wrist."""
    text = heavy_urdf(folder).read_text().replace("tool0", flange)
    box = '<geometry><box size="3 3 0.02"/></geometry>'
    for k, before in enumerate(("link_3", "rod_1", "rod_2", "rod_3"), start=1):
        rod = f"""<link name="rod_{k}"><visual>{box}</visual><collision>{box}</collision></link>
            <joint name="rod_joint_{k}" type="revolute"><parent link="{before}"/><child link="rod_{k}"/>
            <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
            <mimic joint="joint_a2"/></joint></robot>"""
        text = text.replace("</robot>", rod)
    file = folder / "rods.urdf"
    file.write_text(text)
    return file


@pytest.mark.parametrize("flange", ["tool0", "mount"])
def test_rods_that_follow_a_joint_do_not_cut_the_wrist_off_and_touch_nothing(tmp_path, flange):
    """What is drawn where it is not hinders no pose and thickens no tube."""
    said = fine("new", tmp_path / "mine", "--from", with_rods(tmp_path, flange), "--payload-kg", 300)
    assert f"6 joints, tool at '{flange}'" in said
    names = ", ".join(f"rod_joint_{k}" for k in range(1, 5))
    assert f"not between base and tool, so held at zero: {names}" in said
    still = "not checked for collisions, because their joints are held at zero"
    assert f"{still}: rod_1, rod_2, rod_3, rod_4" in said
    assert "hulls that touch" not in said
    assert (load_arm(tmp_path / "mine").limits[:, 2] == (-2, 1.5)).all()
    fine("new", tmp_path / "bare", "--from", tmp_path / "heavy.urdf", "--payload-kg", 300)
    mine, bare = ((tmp_path / name / "elastic.toml").read_text() for name in ("mine", "bare"))
    assert mine.replace(f"'{flange}'", "'tool0'") == bare


def test_a_parallelogram_is_a_chain_whose_rod_follows_joint_2(tmp_path):
    """Pinocchio's reading of the file, the rod at minus joint 2, is the arm's at the six joints of files."""
    rod = """<link name="held"/><joint name="rod" type="revolute"><origin xyz="0 0 1.25"/>
        <parent link="link_2"/><child link="held"/><axis xyz="0 1 0"/>
        <limit lower="-3" upper="3" effort="1" velocity="1"/>
        <mimic joint="joint_a2" multiplier="-1"/></joint></robot>"""
    text = heavy_urdf(tmp_path).read_text().replace("</robot>", rod)
    own = '<origin xyz="0 0 1.25"/> <parent link="link_2"/><child link="link_3"/>'
    text = text.replace(own, '<parent link="held"/><child link="link_3"/>')
    (file := tmp_path / "rod.urdf").write_text(text)
    (tmp_path / "free.urdf").write_text(re.sub("<mimic[^>]*>", "", text))
    names = [f"joint_a{k}" for k in range(1, 7)]
    said = fine("new", tmp_path / "mine", "--from", file)
    assert f"7 joints (files have 6: {', '.join(names)})" in said
    assert "joints that follow others, as [joints] of elastic.toml says: rod = -joint_a2" in said
    q = np.random.default_rng(2).uniform(-1, 1, (5, 6))
    theirs = pinocchio_urdf(tmp_path / "free.urdf", "tool0", [*names, "rod"], np.c_[q, -q[:, 1]]).tips
    arm = load_arm(tmp_path / "mine")
    p, R = tool_poses(build_vjm(arm), arm.to_chain_joints(q))
    np.testing.assert_allclose(theirs[:, :3, 3], p, atol=1e-9)
    np.testing.assert_allclose(theirs[:, :3, :3], R, atol=1e-9)


def test_rods_hinder_no_pose_of_a_robot_that_states_no_collision_shapes(tmp_path):
    """Hulls of what is drawn collide there: those of rods, which stand where the arm goes, do not."""
    files = with_rods(tmp_path, "tool0"), tmp_path / "heavy.urdf"
    rooms = []
    for file in files:
        file.write_text(re.sub("<collision>.*?</collision>", "", file.read_text(), flags=re.DOTALL))
        fine("new", tmp_path / file.stem, "--from", file, "--payload-kg", 300)
        rooms.append(build_rigid_cell(load_arm(tmp_path / file.stem)))
    lower, upper = rooms[0].arm.limits
    q = np.random.default_rng(0).uniform(lower, upper, (50, 6))
    mine, bare = (find_collisions(room, q) for room in rooms)
    assert mine == bare
    assert None in bare


@pytest.mark.parametrize("limits", ['effort="0" velocity="2"', 'effort="0" velocity="0"', ""])
def test_a_joint_that_is_locked_at_zero_is_no_joint_of_the_arm(tmp_path, limits):
    """Zeros everywhere are of an exporter that knows no limits: then ours stand in."""
    text, free = heavy_urdf(tmp_path).read_text(), 'lower="-2" upper="1.5" effort="0" velocity="2"'
    begins = text.index('name="joint_a4"')
    locked = f'lower="0" upper="0" {limits}'
    for changed, said in (
        (text[:begins] + text[begins:].replace(free, locked, 1), "5 joints"),
        (text.replace(free, locked), "6 joints"),
    ):
        file = tmp_path / f"{said[0]}.urdf"
        file.write_text(changed)
        chain = read_chain(file)
        noted = " ".join(map(sentence, chain.notes))
        assert f"{chain.n_joints} joints" == said
        assert ("limits of 0 to 0, so held at zero: joint_a4" in noted) == (said[0] == "5")
        assert ("-360 to 360 deg is assumed" in noted) == (said[0] == "6")


def test_a_gripper_whose_fingers_follow_one_of_them_is_no_part_of_the_arm(tmp_path):
    """No flange by name: the fingers that follow show that the last branch is a gripper."""
    file = light_urdf(tmp_path)
    file.write_text(file.read_text().replace("tool0", "mount"))
    chain = read_chain(file)
    assert (chain.n_joints, chain.tip.name) == (7, "hand")


@pytest.mark.parametrize(
    "name", ["left/end_effector_link", "tool_frame", "ee_link", "arm_tcp", "flange-link"]
)
def test_the_frame_of_the_tool_is_known_by_its_name(tmp_path, name):
    """Beside another bare frame on the last link."""
    text = heavy_urdf(tmp_path).read_text().replace("tool0", name)
    camera = """<link name="camera_link"/><joint name="c" type="fixed"><parent link="link_6"/>
        <child link="camera_link"/></joint></robot>"""
    (tmp_path / "named.urdf").write_text(text.replace("</robot>", camera))
    chain = read_chain(tmp_path / "named.urdf")
    assert (chain.n_joints, chain.tip.name) == (6, name)


def test_a_gripper_of_one_jaw_is_no_joint_of_the_arm(tmp_path):
    """Nothing but the name of its joint tells the jaw from a seventh axis."""
    text = heavy_urdf(tmp_path).read_text().replace("tool0", "mount")
    jaw = """<link name="mover"/><joint name="{}" type="revolute"><origin xyz="0.2 0 0"/>
        <parent link="link_6"/><child link="mover"/><axis xyz="0 1 0"/>
        <limit lower="-1" upper="0" effort="1" velocity="1"/></joint>"""
    for name, found in (("jointGripper", (6, "mount")), ("joint_a7", (7, "mover"))):
        file = tmp_path / f"{name}.urdf"
        file.write_text(text.replace("</robot>", jaw.format(name) + "</robot>"))
        chain = read_chain(file)
        assert (chain.n_joints, chain.tip.name) == found
        held = "not between base and tool, so held at zero: jointGripper" in map(sentence, chain.notes)
        assert held == (name == "jointGripper")


@pytest.mark.parametrize(
    ("rpy", "axis", "long"),
    [
        ("0 0 0", "-1 0 0", 0.04),
        ("0 -1.5708 0", "-1 0 0", 0.04),
        ("0 0 3.14159", "1 0 0", 1.2),  # a gripper
        ("0.4 0.5 0.6", "1 0 0", 0.04),
    ],
)
def test_load_and_markers_lie_beyond_a_flange_in_the_last_joint(tmp_path, rpy, axis, long):
    """tool0 in joint 6, its shape sideways: outward is away from joint 5, however frames and axis point."""
    text = heavy_urdf(tmp_path).read_text()
    last = text.index('<child link="link_6"/>')
    text = text[:last] + text[last:].replace('<axis xyz="-1 0 0"/>', f'<axis xyz="{axis}"/>', 1)
    spot = '<joint name="t" type="fixed"><origin xyz="{}" rpy="{}"/>'
    assert spot.format("0.1 0 0", "0 1.57 0") in text
    assert 'size="0.04 0.2 0.2"' in text
    text = text.replace('size="0.04 0.2 0.2"', f'size="{long} 0.2 0.2"')
    file = tmp_path / "wrist.urdf"
    file.write_text(text.replace(spot.format("0.1 0 0", "0 1.57 0"), spot.format("0 0 0", rpy)))
    fine("new", tmp_path / "mine", "--from", file, "--payload-kg", 100)
    found = check(tmp_path / "mine")
    vjm = found.cell.vjm
    (wrist, _), (joint, _), (tool, turn) = body_poses(vjm, np.zeros((1, 6)))[-3:]
    out = (joint[0] - wrist[0]) / np.linalg.norm(joint[0] - wrist[0])
    load, *markers = [(tool[0] + turn[0] @ p - joint[0]) @ out for p in (vjm.load_point, *vjm.markers)]
    drawn = 0.1 + long / 2  # the end of the box of link 6
    np.testing.assert_allclose(markers, drawn, atol=2e-3)
    assert load == pytest.approx(drawn + 0.05 * vjm.reach, abs=2e-3)
    doubted = [doubt.sentence for doubt in found.doubts if doubt.name == "flange"]
    inside = [
        f"tool is inside link_6 as drawn, {1e3 * drawn:.0f} mm from its end: is that where the tool is?"
    ]
    assert doubted == (inside if long > 1 else [])


def test_guesses_are_doubted(tmp_path):
    """A payload that nobody states; tubes not drawn; a tool in its link, markers behind the flange."""
    file = heavy_urdf(tmp_path)
    text = file.read_text().replace('size="0.9 0.2 0.2"', 'size="0.1 0.2 0.2"')
    for size in ("0.4 0.4 1.4", "0.8 0.3 0.3"):
        assert f'size="{size}"' in text
        text = text.replace(f'size="{size}"', 'size="0 0 0"')
    file.write_text(text)
    markers = [
        flag for k in range(3) for flag in ("--marker", f"P{k}={0.1 * (k == 0)},{0.1 * (k == 1)},-0.3")
    ]
    fine("new", tmp_path / "mine", "--from", file, *markers, "--tool", "0,0,-0.2")
    checked = check(tmp_path / "mine")
    unsure = [item.words for item in checked.items if "tube diameters" in item.words]
    assert {"link_2", "link_3", "link_4"} <= {words.partition("'")[0] for words in unsure}
    assert [name for name in checked.cell.arm.markers if checked.doubted(name)] == ["P0", "P1", "P2"]
    found = [doubt.sentence for doubt in checked.doubts]
    for said in (
        r"its payload of \d+ kg is only estimated \(.*",
        r"tool is inside link_6 as drawn, 2\d\d mm from its end: .*",
        r"P0 is \d+ mm behind the flange: .*",
    ):
        assert any(re.fullmatch(said, sentence) for sentence in found), (said, found)
    text = (tmp_path / "mine/elastic.toml").read_text()
    assert text.count("its shape covers 100 of 900 mm, so from payload and reach") == 1
    assert text.count("no shape, so from payload and reach") == 2
    fine("new", tmp_path / "stated", "--from", heavy_urdf(tmp_path), "--payload-kg", 300)
    assert not {"payload", "flange"} & {d.name for d in check(tmp_path / "stated").doubts}


def test_the_payload_names_the_links_that_have_no_mass(tmp_path):
    file = light_urdf(tmp_path)
    text = file.read_text()
    start = text.index('<link name="link_3">')
    bare = text[:start] + re.sub("<inertial>.*?</inertial>", "", text[start:], count=1)
    file.write_text(bare)
    fine("new", tmp_path / "mine", "--from", file)
    assert "the file has no mass of link_3" in (tmp_path / "mine/elastic.toml").read_text()


def test_two_arms_ask_for_a_tip_and_limits_in_another_unit_are_said(tmp_path):
    text = heavy_urdf(tmp_path).read_text()
    inner = re.search("<robot[^>]*>(.*)</robot>", text, re.DOTALL)[1]
    inner = re.sub(r'(name|link)="(\w+)"', r'\1="other_\2"', inner)
    both = '<joint name="both" type="fixed"><parent link="base_link"/><child link="other_base_link"/></joint>'
    (tmp_path / "two.urdf").write_text(text.replace("</robot>", f"{inner}{both}</robot>"))
    said = "expected one arm, got two of 6 joints"
    assert said in is_refused(do("new", tmp_path / "mine", "--from", tmp_path / "two.urdf"))
    fine("new", tmp_path / "mine", "--from", tmp_path / "two.urdf", "--tip", "other_tool0")
    (tmp_path / "far.urdf").write_text(text.replace('lower="-2" upper="1.5"', 'lower="-120" upper="90"', 1))
    words = fine("new", tmp_path / "far", "--from", tmp_path / "far.urdf")
    assert "limits beyond 1440 deg, whose numbers may be degrees, not radians: joint_a1" in words


def test_joints_that_mimic_each_other_in_a_circle_are_refused(tmp_path):
    text = heavy_urdf(tmp_path).read_text()
    for joint, other in (("joint_a3", "joint_a4"), ("joint_a4", "joint_a3")):
        start = f'name="{joint}" type="revolute">'
        text = text.replace(start, f'{start}<mimic joint="{other}"/>')
    (tmp_path / "circle.urdf").write_text(text)
    said = "it mimics itself: joint_a3 mimics joint_a4 mimics joint_a3"
    assert said in is_refused(do("new", tmp_path / "mine", "--from", tmp_path / "circle.urdf"))


def test_limits_that_no_axis_can_have_are_said_with_their_numbers(tmp_path):
    """Not as limits that the file does not state: those of a slide in mm are lost."""
    text = heavy_urdf(tmp_path).read_text()
    slide = text.replace('name="joint_a1" type="revolute"', 'name="joint_a1" type="prismatic"')
    for numbers, said in (
        (
            'lower="0" upper="6500"',
            "limits of joint_a1 in the file, 0 to 6500 m, are ignored (are they mm?)",
        ),
        ('lower="0" upper="650"', "limits beyond 50 m, whose numbers may be mm: joint_a1"),
    ):
        (tmp_path / "rail.urdf").write_text(slide.replace('lower="-2" upper="1.5"', numbers, 1))
        assert said in " ".join(map(sentence, read_chain(tmp_path / "rail.urdf").notes))
    (tmp_path / "far.urdf").write_text(
        text.replace('lower="-2" upper="1.5"', 'lower="-1e16" upper="1e16"', 1)
    )
    words = " ".join(map(sentence, read_chain(tmp_path / "far.urdf").notes))
    assert "limits of joint_a1 in the file, -1e+16 to 1e+16 rad, are ignored: -360 to 360 deg" in words
    assert "no limits" not in words


@pytest.mark.parametrize("encoding", ["ISO-8859-1", "UTF-16", "UTF-8"])
def test_a_file_is_read_in_the_encoding_that_it_states_and_in_a_namespace(encoding, tmp_path):
    text = heavy_urdf(tmp_path).read_text()
    plain = read_chain(tmp_path / "heavy.urdf")
    named = text.replace("joint_a2", "Hüfte").replace("<robot ", '<robot xmlns="http://www.ros.org" ', 1)
    (file := tmp_path / "stated.urdf").write_bytes(
        f'<?xml version="1.0" encoding="{encoding}"?>\n{named}'.encode(encoding)
    )
    chain = read_chain(file)
    assert any("'Hüfte' is H_fte" in sentence(note) for note in chain.notes)
    for own, other in zip(chain.parts, plain.parts, strict=True):
        np.testing.assert_array_equal(own.pose, other.pose)
    file.write_bytes(f"<!-- für -->{text}".encode("latin-1"))
    assert "byte 7: expected UTF-8" in is_refused(do("new", tmp_path / "mine", "--from", file))


def test_springs_and_compensated_gravity_of_an_mjcf_are_said(tmp_path):
    file = classes_mjcf(tmp_path)
    text = file.read_text().replace('<joint name="joint2"/>', '<joint name="joint2" stiffness="900"/>')
    file.write_text(text.replace('<body name="link2"', '<body gravcomp="1" name="link2"'))
    words = " ".join(map(sentence, read_chain(file).notes))
    assert "springs in the file are left out: joint2; describe a balancer's spring in [compensator]" in words
    assert "gravcomp in the file is left out, so these bodies have their weight: link2" in words


@pytest.mark.parametrize(
    ("links", "kind", "said"),
    [(20, "revolute", "expected 3 to 9 moving joints"), (600, "fixed", "<joint>: expected at most 500")],
)
def test_a_robot_of_more_links_than_any_has_is_one_line(tmp_path, links, kind, said):
    text = "".join(f'<link name="l{k}"/>' for k in range(links + 1))
    for k in range(links):
        ends = f'<parent link="l{k}"/><child link="l{k + 1}"/>'
        text += f'<joint name="j{k}" type="{kind}">{ends}</joint>'
    (tmp_path / "long.urdf").write_text(f'<robot name="long">{text}</robot>')
    assert said in is_refused(do("new", tmp_path / "mine", "--from", tmp_path / "long.urdf"))


def test_what_describes_no_links_is_no_urdf(tmp_path):
    (tmp_path / "groups.srdf").write_text('<robot name="r"><group name="arm"/></robot>')
    said = is_refused(do("new", tmp_path / "mine", "--from", tmp_path / "groups.srdf"))
    assert "expected links in the URDF, got none; is it an SRDF" in said


with (ROBOTS / "wrong.tsv").open(encoding="utf-8", newline="") as table:
    WRONG = list(csv.DictReader(table, delimiter="\t", quoting=csv.QUOTE_NONE))


@pytest.mark.parametrize("change", WRONG, ids=lambda row: f"{row['robot']} {row['said'] or row['new']}")
def test_a_wrong_description_of_a_robot_is_one_line_and_leaves_nothing(change, tmp_path):
    """Those without a word are sound: five joints are an arm as well, and a comment is nothing."""
    file = BY_NAME[change["robot"]](tmp_path)
    text = file.read_text()
    assert change["old"] in text
    file.write_text(text.replace(change["old"], change["new"]) if change["old"] else text)
    before = {*tmp_path.iterdir()}
    done = do("new", tmp_path / "mine", "--from", file, *change["flags"].split())
    if change["said"]:
        assert change["said"] in is_refused(done)
        assert {*tmp_path.iterdir()} == before
    else:
        assert done.returncode == 0


@pytest.mark.attack
def test_whatever_the_file_holds_nothing_but_an_arm_or_one_line_comes_of_it(tmp_path):
    """Truncated, overwritten, with huge numbers, exchanged names, lost and doubled elements, odd meshes."""
    rng, made = random.Random(20), 0
    for k in range(FUZZED):
        home = tmp_path / str(k)
        home.mkdir()
        file = STRANGERS[k % len(STRANGERS)](home)
        file.write_text(mutated(file.read_text(), rng))
        for mesh in home.rglob("*.stl"):
            mesh.write_bytes(mesh.read_bytes()[: rng.choice([0, 83, 100, 284, 284, 284])])
        done = do("new", home / "arm", "--from", file)
        if done.returncode:
            assert str(home) in is_refused(done)  # the file at fault
        assert (home / "arm").exists() == (done.returncode == 0)
        assert not list(home.glob(".*"))
        made += done.returncode == 0
        shutil.rmtree(home)
    assert 0.1 * FUZZED < made < 0.9 * FUZZED  # the mutations neither break all nor none


def mutated(text, rng):
    """The text with one fault."""
    numbers = list(re.finditer(r'(?<=[" ])-?\d+\.?\d*(?=[" ])', text))
    words = list(re.finditer(r'(?<==")[A-Za-z_/0-9]+(?=")', text))
    tags = list(re.finditer(r"<[^>]+>", text))
    kind = rng.randrange(6)
    spot = rng.choice([numbers, words, tags, tags, tags, tags][kind])
    new_text = [
        rng.choice(["1e308", "-1e300", "nan", "inf", "0", "-1", "1e-300", "1_0", "", "9" * 400]),
        rng.choice([rng.choice(words).group(), "../../etc/passwd", "/dev/zero", "", "a" * 500, "tool", "P1"]),
        "",
        spot.group() * 2,
        rng.choice(['<composite count="999 999 999"/>', "<x>" * 300, '<geom type="mesh" mesh="q"/>']),
        chr(rng.choice([0, 34, 60, 255, 0x2028])),
    ][kind]
    end = len(text) if kind == 4 and rng.random() < 0.5 else spot.end()
    return text[: spot.start()] + new_text + text[end:]


DH = [
    (0, 0, 0.5, 0),
    (-90, 0.1, 0.02, -90),
    (0, 0.7, 0, 0),
    (-90, 0.15, 0.8, 0),
    (90, 0, 0, 0),
    (-90, 0.03, 0.1, 0),
]
"""Rows alpha [deg], a, d [m], theta [deg] of six joints."""


def turned(axis, angle, along):
    """A turn about x (0) or z (2) with a way along that axis, (4, 4)."""
    pose = np.eye(4)
    c, s = np.cos(angle), np.sin(angle)
    pose[:3, :3] = [[1, 0, 0], [0, c, -s], [0, s, c]] if axis == 0 else [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    pose[axis, 3] = along
    return pose


@pytest.mark.parametrize("modified", [True, False])
def test_a_dh_table_as_a_urdf_is_the_robot_that_its_convention_says(tmp_path, modified):
    """Origins as docs/robot_files.md has them, constant angles in [joints]: the rows' product is the tool."""
    (tmp_path / "dh.csv").write_text("alpha,a,d,theta\n0,0,487,0\n")
    said = is_refused(do("new", tmp_path / "A", "--from", tmp_path / "dh.csv"))
    assert "expected a URDF or MJCF" in said
    assert "a DH table as URDF is in docs/robot_files.md" in said
    rows = [(np.radians(alpha), a, d, np.radians(theta)) for alpha, a, d, theta in DH]
    if modified:
        origins = [((a, -d * np.sin(alpha), d * np.cos(alpha)), alpha) for alpha, a, d, _ in rows]
    else:
        origins = [((a, 0, d), alpha) for alpha, a, d, _ in rows]
    origins = [*origins, ((0, 0, 0), 0.0)] if modified else [((0, 0, 0), 0.0), *origins]
    mass = '<inertial><mass value="9"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    text = f'<robot name="dh"><link name="l0">{mass}</link>'
    for k, (at, alpha) in enumerate(origins, start=1):
        kind, name = ("fixed", "tool0") if k == 7 else ("revolute", f"l{k}")
        xyz = " ".join(f"{float(x)!r}" for x in at)
        text += f"""<link name="{name}">{mass if k < 7 else ""}</link><joint name="j{k}" type="{kind}">
            <parent link="l{k - 1}"/><child link="{name}"/><axis xyz="0 0 1"/>
            <origin xyz="{xyz}" rpy="{float(alpha)!r} 0 0"/><limit lower="-3" upper="3"/></joint>"""
    (file := tmp_path / "dh.urdf").write_text(f"{text}</robot>")
    fine("new", tmp_path / "mine", "--from", file, "--payload-kg", 10)
    elastic = tmp_path / "mine" / "elastic.toml"
    table = "[joints]\nj2 = { j2 = 1, offset_deg = -90 }\n\n[[link]]"
    elastic.write_text(elastic.read_text().replace("[[link]]", table, 1))
    arm, q = load_arm(tmp_path / "mine"), np.random.default_rng(4).uniform(-1, 1, (5, 6))
    p, R = tool_poses(build_vjm(arm), arm.to_chain_joints(q))
    for k, own in enumerate(q):
        pose = np.eye(4)
        for (alpha, a, d, theta), angle in zip(rows, own, strict=True):
            x, z = turned(0, alpha, a), turned(2, theta + angle, d)
            pose = pose @ (x @ z if modified else z @ x)
        np.testing.assert_allclose(p[k], pose[:3, 3], atol=1e-9)
        np.testing.assert_allclose(R[k], pose[:3, :3], atol=1e-9)
