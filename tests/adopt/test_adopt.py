"""A stranger's robot made an arm of ours is the same robot, as Pinocchio and MuJoCo themselves read it."""

import mujoco
import numpy as np
import pytest
from oracles import mujoco_mjcf, mujoco_urdf, ours, random_q
from strangers import classes_mjcf, heavy_urdf, light_urdf, mounted_mjcf, sliding_mjcf

from testbench.arm.folder import load_arm
from testbench.files.robot.chain import read_chain
from testbench.files.robot.meshes import Meshes
from testbench.files.robot.write import DENSITY, drawn_mesh
from testbench.workflows.cell import build_cell
from testbench.workflows.new_arm import UserInputs, sentence, write_arm

ARMS = {
    light_urdf: (mujoco_urdf, "tool0", "a1 a2 a3 a4 a5 a6 a7"),
    heavy_urdf: (mujoco_urdf, "tool0", "joint_a1 joint_a2 joint_a3 joint_a4 joint_a5 joint_a6"),
    classes_mjcf: (mujoco_mjcf, "flange", "joint1 joint2 joint3 joint4 joint5 joint6 joint7"),
    mounted_mjcf: (mujoco_mjcf, "attachment_site", "j1 j2 j3 j4 j5 j6"),
    sliding_mjcf: (mujoco_mjcf, "tcp", "track turn lift tilt wrist"),
}


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    """Of every stranger its file, its chain and its arm's folder."""
    made = {}
    for robot in ARMS:
        home = tmp_path_factory.mktemp("robot")
        (home / "arm").mkdir()
        file = robot(home)
        chain = read_chain(file)
        write_arm(chain, UserInputs(), home / "arm")
        made[robot] = file, chain, home / "arm"
    return made


def notes(chain):
    return [sentence(note) for note in chain.notes]


@pytest.mark.parametrize("robot", ARMS)
def test_model_and_plant_place_and_weigh_the_arm_as_mujoco_reads_the_stranger_s_file(arms, robot):
    """Pinocchio reads a URDF for us, so its judge is MuJoCo.

    Positions are written to 1e-12 m, masses to nine digits; a part without mass weighs 1 mg.
    """
    file, chain, folder = arms[robot]
    library, tip, joints = ARMS[robot]
    names, q = random_q(folder)
    assert (chain.tip.name, names) == (tip, joints.split())
    theirs = library(file, tip, names, q)
    for own in ours(folder, q):
        assert np.abs(own.tips - theirs.tips).max() < 1e-9
        if robot is not heavy_urdf:  # which states no masses
            assert own.mass == pytest.approx(theirs.mass, rel=1e-7)
            assert np.abs(own.coms - theirs.coms).max() < 1e-7
            assert np.abs(own.inertia - theirs.inertia).max() < 1e-6 * np.abs(theirs.inertia).max()


def test_a_mount_belongs_to_the_base_where_it_stands(arms):
    file, chain, _ = arms[mounted_mjcf]
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    own = [model.body(name).id for name in ("plinth", "mount", "base")]
    com = model.body_mass[own] @ data.xipos[own] / model.body_mass[own].sum()
    base = chain.parts[0]
    assert base.name == "base"
    assert (base.pose @ np.append(base.com, 1))[:3] == pytest.approx(com)


def test_limits_are_the_file_s_and_those_without_get_a_turn_each_way_which_is_said(arms):
    _, chain, folder = arms[light_urdf]
    joints = load_arm(folder).joints
    assert (joints[2].lower, joints[2].upper) == (-2.2, 1.2)
    assert joints[6].upper == pytest.approx(2 * np.pi)
    assert any("no limits of a7" in note for note in notes(chain))
    _, chain, folder = arms[mounted_mjcf]
    joints = load_arm(folder).joints
    assert joints[0].lower == pytest.approx(np.deg2rad(-150))
    assert any("no limits of j5" in note for note in notes(chain))


def test_a_branch_is_frozen_and_weighs_on_the_part_that_carries_it(arms):
    """The hand of 0.7 kg and its fingers of 0.02 kg hang on the last link of 2 kg."""
    _, chain, _ = arms[light_urdf]
    assert chain.parts[-1].mass == pytest.approx(2 + 0.7 + 2 * 0.02)
    assert "bodies merged into link_7: hand, finger_1, finger_2" in notes(chain)
    assert "not between base and tool, so held at zero: finger_joint_1, finger_joint_2" in notes(chain)


def test_what_is_drawn_stands_where_the_file_has_it_in_metres(arms):
    """A tetrahedron of 100 x 60 x 200 mm behind its own origin."""
    _, chain, folder = arms[light_urdf]
    shape = next(s for s in chain.parts[3].shapes if s.visual)
    turn = np.array([[np.cos(0.2), 0, np.sin(0.2)], [0, 1, 0], [-np.sin(0.2), 0, np.cos(0.2)]])
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.06, 0], [0, 0, 0.2]]) @ turn.T + [0, 0.01, -0.02]
    gap = np.linalg.norm(shape.surface[0][:, None] - corners, axis=2).min(axis=0)
    assert gap.max() < 1e-8
    assert shape.rgba == pytest.approx([1, 0.4, 0, 1])
    assert sum(p.stat().st_size for p in folder.rglob("*.*")) < 20_000


@pytest.mark.parametrize("kind", ["obj", "stl"])
def test_a_mesh_with_an_umlaut_in_latin_1_is_read(tmp_path, kind):
    corners = ((0, 0, 0), (1, 0, 0), (0, 1, 0))
    if kind == "obj":
        text = "# Körper\n" + "".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "f 1 2 3\n"
    else:
        loop = "".join(f"vertex {x} {y} {z}\n" for x, y, z in corners)
        text = f"solid Körper\nfacet normal 0 0 1\nouter loop\n{loop}endloop\nendfacet\nendsolid Körper\n"
    (tmp_path / f"a.{kind}").write_bytes(text.encode("latin-1"))
    assert Meshes().load(tmp_path / f"a.{kind}").faces.shape == (1, 3)


def test_a_mirrored_mesh_is_not_inside_out(tmp_path):
    file = light_urdf(tmp_path)
    file.write_text(file.read_text().replace('scale="0.001 0.001 0.001"', 'scale="0.001 -0.001 0.001"'))
    vertices, faces = read_chain(file).parts[1].shapes[0].surface
    a, b, c = vertices[faces].transpose(1, 2, 0)
    volume = np.vecdot(a.T, np.cross(b.T, c.T)).sum() / 6
    assert volume == pytest.approx(0.1 * 0.06 * 0.2 / 6, rel=1e-6)


def test_an_arm_without_masses_is_weighed_by_the_volume_of_its_boxes(arms):
    _, chain, _ = arms[heavy_urdf]
    link = chain.parts[2]
    assert not link.weighed
    assert link.mass == pytest.approx(DENSITY * 0.4 * 0.4 * 1.4)
    assert link.com == pytest.approx([0.1, 0, 0.1])
    assert np.diag(link.inertia) == pytest.approx(
        link.mass / 12 * np.array([0.4**2 + 1.4**2] * 2 + [2 * 0.4**2])
    )
    assert any(note.startswith("no mass in the file: 1200 kg/m^3") for note in notes(chain))


def test_hulls_that_keep_others_away_weigh_nothing(tmp_path):
    """A fixed link that only collides, around one that is drawn, as FR3 arms have it; a drawn one weighs."""
    file, mass = heavy_urdf(tmp_path), {}
    text = file.read_text()
    for kind in ("", "collision", "visual"):
        ball = kind and f'<{kind}><geometry><sphere radius="0.3"/></geometry></{kind}>'
        link = f"""<link name="around">{ball}</link><joint name="s" type="fixed"><parent link="link_2"/>
            <child link="around"/></joint></robot>"""
        file.write_text(text.replace("</robot>", link))
        mass[kind] = read_chain(file).mass
    assert mass["collision"] == pytest.approx(mass[""])
    assert mass["visual"] == pytest.approx(mass[""] + DENSITY * 4 / 3 * np.pi * 0.3**3, rel=0.05)


def test_fixed_links_of_the_file_and_its_free_things_are_no_links_of_the_arm(arms):
    _, chain, folder = arms[classes_mjcf]
    assert [link.name for link in load_arm(folder).links] == [f"link{k}" for k in range(8)]
    assert "not of this arm, so left out: cube" in notes(chain)
    assert any("actuator, equality, keyframe" in note for note in notes(chain))


def test_what_stands_beside_the_arm_is_not_weighed_with_it(tmp_path):
    file, table = mounted_mjcf(tmp_path), '<body name="table" pos="3 0 0"><geom size="0.2"/></body>'
    file.write_text(file.read_text().replace("</worldbody>", f"{table}</worldbody>"))
    [said] = [note for note in notes(read_chain(file)) if "computes masses from the geoms" in note]
    assert "link_6" in said
    assert "table" not in said


def test_a_tip_may_be_named_and_what_lies_behind_it_is_frozen(arms):
    file, _, _ = arms[classes_mjcf]
    assert read_chain(file, "pinch").tip.name == "pinch"
    short = read_chain(file, "link5")
    assert short.n_joints == 5
    assert any("held at zero: joint6, joint7, left_joint" in note for note in notes(short))


def test_names_that_no_column_can_have_are_made_fit_and_said(arms, tmp_path):
    _, chain, _ = arms[light_urdf]
    assert chain.parts[0].name == "base_link"
    assert any("'base/link' is base_link" in note for note in notes(chain))
    file = classes_mjcf(tmp_path)
    file.write_text(file.read_text().replace('"pinch"', '"p/inch"'))
    assert [site.name for site in read_chain(file).parts[-1].sites] == ["p_inch"]


def test_a_mesh_that_cannot_be_read_costs_a_note_and_the_collision_mesh_is_drawn(tmp_path):
    file = light_urdf(tmp_path)
    text = file.read_text().replace("meshes/link.stl", "meshes/gone.dae", 1)
    file.write_text(text)
    chain = read_chain(file)
    assert any("gone.dae" in note for note in notes(chain))
    (tmp_path / "arm").mkdir()
    write_arm(chain, UserInputs(), tmp_path / "arm")
    assert 'class="visual" rgba' in (tmp_path / "arm/rigid.xml").read_text()
    assert build_cell(tmp_path / "arm").arm.n_joints == 7


def test_a_part_has_the_colour_of_its_largest_piece(tmp_path):
    file, blue = light_urdf(tmp_path), '<material name="b"><color rgba="0 0 1 1"/></material>'
    mesh = 'filename="package://light_support/meshes/link.stl" scale="1e-4 1e-4 1e-4"'
    piece = f"<visual><geometry><mesh {mesh}/></geometry>{blue}</visual>"
    file.write_text(file.read_text().replace("<visual>", f"{piece}<visual>", 1))
    part = read_chain(file).parts[1]
    assert len(part.shapes) == 3
    assert drawn_mesh(part)[1] == pytest.approx([1, 0.4, 0, 1])


def test_what_is_fixed_to_a_link_does_not_hide_that_its_mesh_is_gone(tmp_path):
    file = light_urdf(tmp_path)
    whole, _ = drawn_mesh(read_chain(file).parts[1])
    plate = """<link name="plate"><visual><geometry><box size="0.01 0.01 0.01"/></geometry></visual></link>
        <joint name="p" type="fixed"><parent link="link_1"/><child link="plate"/></joint></robot>"""
    file.write_text(
        file.read_text().replace("meshes/link.stl", "meshes/gone.dae", 1).replace("</robot>", plate)
    )
    part = read_chain(file).parts[1]
    assert [s.kind for s in part.shapes if s.visual] == ["mesh", "box"]
    np.testing.assert_allclose(drawn_mesh(part)[0][0], whole[0])


def test_equal_masses_of_all_links_are_placeholders(tmp_path):
    file = light_urdf(tmp_path)
    text = file.read_text()
    for k in range(7):
        text = text.replace(f'<mass value="{5 - k / 2}"/>', '<mass value="2"/>')
    for light in ("0.7", "0.02"):
        text = text.replace(f'<mass value="{light}"/>', '<mass value="2"/>')
    file.write_text(text)
    chain = read_chain(file)
    assert any("every link weighs 2 kg" in note for note in notes(chain))
    assert chain.parts[1].mass == pytest.approx(DENSITY * 0.1 * 0.06 * 0.2 / 6, rel=1e-6)
