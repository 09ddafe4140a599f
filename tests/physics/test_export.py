"""The identified geometry as URDF: written into files drawn in other frames, read by others, nothing lost."""

import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import mujoco
import numpy as np
import pytest
import ur_kinematics
import yaml
from own_urdf import own_urdf
from scipy.spatial.transform import Rotation
from serial_arms import write_arm

from testbench.errors import BenchError, InputError
from testbench.files.export import best_offsets, draft_new, draft_robot_urdf, export, export_offsets
from testbench.files.export_own import STAMP, frame_distance, nominal_rigid, random_joints, tool_poses
from testbench.identify.absolute.state import nominal_state
from testbench.identify.posterior import elastic_state
from testbench.model.kinematics import JointErrorTerms, build_vjm
from testbench.model.laws import add_joint_laws
from testbench.model.load import read_body_masses
from testbench.model.vjm import evaluate_chain, generalised_load, generalised_load_without_laws
from testbench.workflows.cell import build_cell

SHIFT, TURN, SLIDE = 0.5e-3, 1e-3, 0.5e-3  #: Planted errors [m], [rad], of a slide's offset [m].


def planted(arm, rng, *, ends=False):
    """An arm with errors of geometry everywhere, of base and tool only where asked for; springs and gears."""
    vjm, n = build_vjm(arm), arm.n_joints
    theta = np.zeros(arm.n_theta)
    inner = slice(0, n + 1) if ends else slice(1, n)
    links = theta[: 6 * n + 6].reshape(-1, 6)
    links[inner] = rng.uniform(-1, 1, (n + 1, 6))[inner] * ([SHIFT] * 3 + [TURN] * 3)
    theta[6 * n + 6 :] = [rng.uniform(-1, 1) * (SLIDE if j.prismatic else TURN) for j in arm.joints]
    errors = JointErrorTerms(orders=(1, 2), ratio=True)
    state = nominal_state(vjm, read_body_masses(arm), np.full(n, 50.0))
    gears = rng.uniform(-1e-4, 1e-4, (n, errors.n_coefficients))
    return replace(state, theta_0=theta, C_theta=arm.C_theta, error_terms=errors, error_coefficients=gears)


@pytest.fixture(scope="module")
def ur10():
    return build_cell("ur10").arm


@pytest.fixture(scope="module", params=["zZyXz", "zzZ", "zyzyzyz"])
def any_arm(request, tmp_path_factory):
    """Slides among hinges, parallel axes alone, seven hinges."""
    folder = write_arm(tmp_path_factory.mktemp("arm") / request.param, request.param)
    return build_cell(folder).arm


def poses_by_mujoco(text, link, names, q):
    """Poses of a link of a URDF in its first one, (poses, 4, 4), and what MuJoCo reads it as."""
    keep = 'fusestatic="false" discardvisual="true" boundmass="1e-6" boundinertia="1e-6"'
    text = text.replace("</robot>", f"<mujoco><compiler {keep}/></mujoco></robot>")
    model = mujoco.MjModel.from_xml_string(text)
    data, found = mujoco.MjData(model), np.tile(np.eye(4), (len(q), 1, 1))
    for pose, row in zip(found, q, strict=True):
        for name, value in zip(names, row, strict=True):
            data.joint(name).qpos = value
        mujoco.mj_kinematics(model, data)
        pose[:3] = np.column_stack([data.body(link).xmat.reshape(3, 3), data.body(link).xpos])
    return found, model


def test_a_new_urdf_is_the_model_to_mujoco_too(ur10, rng, tmp_path):
    state, out = planted(ur10, rng, ends=True), tmp_path / "new.urdf"
    draft = draft_new(state)
    done = export(state, draft, out)
    assert (done.read_back.poses, draft.frames.names[-1]) == (1000, "tool")
    assert max(done.read_back.position_um, done.read_back.rotation_urad) < 1e-4
    assert 0.1 < done.geometry_mm[0] < 5
    q, names = random_joints(state.vjm)[:30], [joint.name for joint in ur10.joints]
    found, model = poses_by_mujoco(out.read_text(), "tool", names, q)
    np.testing.assert_allclose(found, tool_poses(state.vjm, q, state.theta_0), rtol=0, atol=1e-10)
    np.testing.assert_allclose(model.body_mass[1:], state.body_masses.mass)
    np.testing.assert_allclose(model.body_ipos[1:], state.body_masses.centre_of_mass, atol=1e-12)
    np.testing.assert_allclose(model.jnt_range, ur10.limits.T, atol=1e-10)


def without_origins(text, names):
    """A URDF without our stamp and the origins of some joints."""
    text = text.replace(STAMP, "")
    for name in names:
        text = re.sub(rf'(<joint name="{name}"[^>]*>\s*)<origin[^>]*>', r"\1", text)
    return text


@pytest.mark.parametrize("ends", [False, True])
def test_an_own_urdf_keeps_all_but_the_origins_of_its_chain(ur10, rng, tmp_path, ends):
    """Other frames, turned axes, fixed links between, a tool chain, a gripper with fingers that mimic."""
    state, names = planted(ur10, rng, ends=ends), [joint.name for joint in ur10.joints]
    text, root, tip = own_urdf(state.vjm, rng)
    (file := tmp_path / "own.urdf").write_text(text)
    draft, out = draft_robot_urdf(state, file), tmp_path / "out" / "new.urdf"
    export(state, draft, out)
    assert draft.frames.names[-1] == "tool0"
    new = out.read_text()
    q = random_joints(state.vjm)[:50]
    expected = tool_poses(state.vjm, q, state.theta_0) @ tip
    far = frame_distance(root @ poses_by_mujoco(new, "tool0", names, q)[0], expected)
    assert max(far) < 1e-10
    changed = [*names, "to_flange"] if ends else names
    assert without_origins(new, changed) == without_origins(text, changed)
    assert file.read_text() == text
    drawn_, moved = (poses_by_mujoco(own, "l3", names, np.zeros((1, 6)))[0] for own in (text, new))
    assert frame_distance(drawn_, moved)[0] < 5e-3


def test_an_own_urdf_of_any_arm_is_read_back(any_arm, rng, tmp_path):
    """Exactly, though the robot's own right angles have six digits: those of the model count."""
    state = planted(any_arm, rng)
    (file := tmp_path / "own.urdf").write_text(own_urdf(state.vjm, rng, digits=6)[0])
    done = export(state, draft_robot_urdf(state, file), tmp_path / "new.urdf")
    assert max(done.read_back.position_um, done.read_back.rotation_urad) < 1e-4


def levers(axes, place, tool, wrench):
    """Force and moment of a tool's wrench at a place in its axes, (6,); what a twist there moves, (3, 6)."""
    force, moment = wrench[:3], wrench[3:]
    load = np.concatenate([axes.T @ force, axes.T @ (moment + np.cross(tool - place, force))])
    return load, np.hstack([axes, np.cross(axes.T, tool - place).T])


def test_what_stands_beside_gives_the_models_deflections(ur10, rng, tmp_path):
    """Compliances, axes, places and masses of the JSON on the frames of the URDF: J C J^T w of the model."""
    state = replace(planted(ur10, rng), theta_0=np.zeros(ur10.n_theta))
    names = [joint.name for joint in ur10.joints]
    text, root, _ = own_urdf(state.vjm, rng)
    (file := tmp_path / "own.urdf").write_text(text)
    export(state, draft_robot_urdf(state, file), tmp_path / "new.urdf")
    said = json.loads((tmp_path / "new.json").read_text())
    q, wrench = random_joints(state.vjm)[:1], rng.uniform(-500, 500, (1, 6))
    where = evaluate_chain(state.vjm, q)
    load, tool = generalised_load(where, wrench, np.zeros((1, 3)))[:, 0], where.tool_position[0]
    links = ["base", *(f"l{k}" for k in range(1, 7))]
    at = {name: root @ poses_by_mujoco(text, name, names, q)[0][0] for name in links[1:]} | {"base": root}
    moved = np.zeros(3)
    for link in said["links"]:
        T = at[link["urdf_link"]]
        u, J = levers(T[:3, :3] @ link["axes"], T[:3, :3] @ link["at_m"] + T[:3, 3], tool, wrench[0])
        moved += J @ link["compliance"] @ u
    for joint, link in zip(said["joints"], links[1:], strict=True):
        e = next(e for e in ET.fromstring(text).findall("joint") if e.get("name") == joint["name"])
        axis = np.array(e.find("axis").get("xyz").split(), dtype=float)
        u, J = levers(at[link][:3, :3], at[link][:3, 3], tool, wrench[0])
        turn = np.concatenate([np.zeros(3), axis / np.linalg.norm(axis)])
        moved += J @ turn * joint["compliance"] * (turn @ u)
    np.testing.assert_allclose(moved, where.J_theta[:3, :, 0] @ state.C_theta @ load, rtol=1e-8)
    np.testing.assert_allclose(
        [j["sine"] + j["cosine"] + [j["ratio"]] for j in said["joints"]], state.error_coefficients
    )
    bodies = zip(links, said["weights"], where.body_frames, state.body_masses.centre_of_mass, strict=False)
    for link, weight, (p, R), centre in bodies:
        found = at[link] @ [*weight["centre_m"], 1]
        np.testing.assert_allclose(found[:3], p[:, 0] + R[..., 0] @ centre, atol=1e-8)


ELBOW = 'name="elbow_joint" type="continuous"'
AXIS = '<axis xyz="0.0 0.0 2.0"/>'


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('name="elbow_joint"', 'name="elbow"', "expected the joints of ur10, .* got .*, elbow, "),
        ("<robot name", "<mujoco name", "not well-formed"),
        ('<?xml version="1.0" ?>', '<!DOCTYPE x [<!ENTITY a "b">]>', "entities are not allowed"),
        ('<child link="l3"/>', "", "elbow_joint. is missing a parent and.or child link"),
        (AXIS, AXIS.replace("2.0", "-2.0"), r"up to [\d.e+]+ mm .* other joint zeros"),
        (AXIS, AXIS.replace("2.0", "nan"), "xyz: expected numbers"),
        (ELBOW, ELBOW.replace("continuous", "planar"), "is planar"),
        (ELBOW, ELBOW.replace("continuous", "prismatic"), "it slides; in ur10 it turns"),
    ],
)
def test_another_robot_or_a_broken_file_is_one_line(ur10, rng, tmp_path, old, new, said):
    state = planted(ur10, rng)
    text = own_urdf(state.vjm, rng)[0]
    assert old in text
    (file := tmp_path / "own.urdf").write_text(text.replace(old, new))
    with pytest.raises(InputError, match=said):
        draft_robot_urdf(state, file)


def test_what_cannot_be_written_leaves_nothing(ur10, rng, tmp_path):
    """The tool has moved and nothing fixed leads to it; the URDF is not what the model is; links couple."""
    state = planted(ur10, rng, ends=True)
    (file := tmp_path / "own.urdf").write_text(own_urdf(state.vjm, rng, tip=False)[0])
    with pytest.raises(InputError, match="expected a fixed joint that leads to 'l6'"):
        draft_robot_urdf(state, file)
    with pytest.raises(InputError, match="no link, body or site 'x' for the tip"):
        draft_robot_urdf(state, file, "x")
    draft = draft_new(state)
    wrong = draft_new(replace(state, theta_0=1.01 * state.theta_0))
    C = state.C_theta.copy()
    C[3, 8] = C[8, 3] = 1e-9
    coupled = replace(state, C_theta=C)
    for bad, made, said in ((state, wrong, "differs from the model by up to"), (coupled, draft, "between")):
        with pytest.raises(BenchError, match=said):
            export(bad, made, tmp_path / "out.urdf")
    assert [path.name for path in tmp_path.iterdir()] == ["own.urdf"]
    assert nominal_rigid(state.vjm).steps.shape == (6, 4, 4)


def test_an_exported_arm_has_its_laws_beside_the_urdf_as_its_words_say(kr500, tmp_path):
    arm, q = kr500.arm, random_joints(kr500.vjm)[:12]
    C, vjm = np.diag(np.r_[np.diag(arm.C_theta), np.linspace(0.1, 1.9, 19)]), add_joint_laws(kr500.vjm)
    state = elastic_state(vjm, C, read_body_masses(kr500.arm))
    export(state, draft_new(state), tmp_path / "arm.urdf")
    said = json.loads((tmp_path / "arm.json").read_text())
    where = evaluate_chain(vjm, q)
    u = generalised_load_without_laws(
        where, np.tile([300.0, -200, -3000, 0, 0, 90], (12, 1)), np.tile(vjm.load_point, (12, 1))
    )[42:]
    turned = C[48:, 48:] @ vjm.joint_laws.unit_deflections(where, u)
    turned = turned[:18].reshape(3, 6, -1).sum(axis=0) + np.outer(np.eye(6)[1], turned[18])
    step = 1e-6 * np.eye(6)[1]
    lever = (strut_length(vjm, q + step) - strut_length(vjm, q - step)) / 2e-6
    r = lever / np.linalg.norm(np.cross(vjm.joint_axes[1], arm.compensator.head))
    before = vjm.joint_laws.torques_before_load(where)
    for row, joint, tau_0, tau, own in zip(said["joints"], arm.joints, before, u, turned, strict=True):
        x_0, x_1, s = joint.compliance * tau_0, joint.compliance * (tau_0 + tau), row["laws"]
        f_0, f_1 = (
            np.array([min(np.roots([1e5, 0, 1, -x]), key=lambda f: abs(f.imag)).real for x in some])
            for some in (x_0, x_1)
        )
        found = s["stiffening"] * (f_1 - x_1 - f_0 + x_0)
        found += s["backlash"] * 5e-5 * (np.tanh(x_1 / 5e-5) - np.tanh(x_0 / 5e-5))
        found -= s["friction"] * 3e-5 * np.clip((x_1 - x_0) / 3e-5, -1, 1)
        found -= s.get("compensator", 0) * (x_1 - x_0) * 0.3 * r**2 / (1 + 0.3 * r**2)
        np.testing.assert_allclose(found, own, rtol=0, atol=1e-12)
    assert "f + 100000 f^3 = x (stiffening), s 5e-05 (tanh" in said["words"]["laws"]
    assert "-s (x_1 - x_0) 0.3 r^2 / (1 + 0.3 r^2)" in said["words"]["laws"]


def strut_length(vjm, q):
    (foot, R_1), (joint, R_2) = evaluate_chain(vjm, q).body_frames[1:3]
    spring = vjm.arm.compensator
    return np.linalg.norm(foot + spring.foot @ R_1 - joint - spring.head @ R_2, axis=0)


def ur10_yaml():
    """The nominal kinematics of a UR10, as its maker's description has them."""
    rows = {
        "shoulder": [0, 0, 0.1273, 0, 0, 0],
        "upper_arm": [0, 0, 0, np.pi / 2, 0, 0],
        "forearm": [-0.612, 0, 0, 0, 0, 0],
        "wrist_1": [-0.5723, 0, 0.163941, 0, 0, 0],
        "wrist_2": [0, -0.1157, -2.373046667922381e-11, np.pi / 2, 0, 0],
        "wrist_3": [0, 0.0922, -1.891053610911353e-11, np.pi / 2, np.pi, np.pi],
    }
    lines = ["# é of the factory", "kinematics:"]
    for name, row in rows.items():
        lines += [f"  {name}:  # a joint", *(f"    {k}: {v}" for k, v in zip(UR_KEYS, row, strict=True))]
    return "\n".join([*lines, "  hash: calib_17227329492635474227", ""])


UR_KEYS = "x y z roll pitch yaw".split()


def flow(text):
    """The same YAML in braces, each frame in short lines."""
    content = yaml.safe_load(text)["kinematics"]
    whole = yaml.safe_dump({"kinematics": content}, default_flow_style=None, sort_keys=False, width=40)
    return f"# é of the factory\n{whole}"


@pytest.mark.parametrize(
    "style",
    [str, flow, lambda text: f"# own\nkinematics: {json.dumps(yaml.safe_load(text)['kinematics'])}\n"],
    ids=["block", "flow in short lines", "braces and quotes"],
)
def test_kinematics_of_a_ur_driver_are_the_model(ur10, rng, tmp_path, style):
    """Read back by a reader of its own, z the axis of every joint; all but 36 numbers stays as it was."""
    state, text = planted(ur10, rng), style(ur10_yaml())
    (file := tmp_path / "my_robot.yaml").write_text(text, encoding="utf-8")
    draft = ur_kinematics.draft(state, file)
    export(state, draft, tmp_path / "new.yaml")
    new = (tmp_path / "new.yaml").read_text(encoding="utf-8")
    rows, q = yaml.safe_load(new)["kinematics"], random_joints(state.vjm)[:50]
    T = np.tile(draft.frames.root, (len(q), 1, 1))
    for k, name in enumerate(["shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"]):
        x, y, z, *turns = (rows[name][key] for key in UR_KEYS)
        step, turn = np.eye(4), np.tile(np.eye(4), (len(q), 1, 1))
        step[:3, :3], step[:3, 3] = Rotation.from_euler("xyz", turns).as_matrix(), [x, y, z]
        turn[:, :3, :3] = Rotation.from_rotvec(q[:, [k]] * [0, 0, 1]).as_matrix()
        T = T @ step @ turn
    assert max(frame_distance(T, tool_poses(state.vjm, q, state.theta_0) @ draft.frames.tip)) < 1e-10
    assert frame_distance(T, tool_poses(state.vjm, q) @ draft.frames.tip)[0] > 1e-4
    numbers = re.compile(r"(?<=: )[-+.\de]+")
    assert numbers.sub("", new.partition("\n")[2]) == numbers.sub("", text)
    assert rows["hash"] == "calib_17227329492635474227"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace("x: 0\n", "x: .inf\n", 1), "with a number at shoulder.x"),
        (lambda text: re.sub(r": [-\d.e]+$", ": 3", text, flags=re.M), "from the tool of the nominal ur10"),
        (lambda text: f"# {ur_kinematics.STAMP}\n{text}", "wrote it; expected the robot's own file"),
    ],
)
def test_wrong_kinematics_of_a_ur_driver_are_one_line(ur10, rng, tmp_path, change, said):
    (file := tmp_path / "my_robot.yaml").write_text(change(ur10_yaml()), encoding="utf-8")
    with pytest.raises(InputError, match=said):
        ur_kinematics.draft(planted(ur10, rng), file)


MACHINE = "DEFDAT $MACHINE PUBLIC\r\nREAL $MAMES[12]\r\n" + "".join(
    f"$MAMES[{k}]={x} ;\xfc\r\n" for k, x in enumerate([0.0, -90.0, 90.0, 0, 1e-1, -0.5, 7], start=1)
)
MOC = "MOC:CFG_1.0:6:1::\n#\nMOTOR_CALIB:\n\n" + "".join(
    f'      -name "rob1_{k}" -com_offset 1.57 -valid_com_offset \\\n  -cal_offset {k}.2 -valid_cal_offset\n\n'
    for k in range(1, 7)
)
MOC += '#\nARM:\n      -name "rob1_1" -cal_offset 9\n'
COUPLED = np.diag([-101.0, 120, 98.5, 80, -79, 50]) + np.eye(6, k=-1) * [0, 0, 0, 0, 3, 1]


@pytest.mark.parametrize("text", [MACHINE, MOC], ids=["KUKA", "ABB"])
def test_offsets_of_joints_in_a_controllers_file_are_the_model(ur10, rng, tmp_path, text):
    """Of an arm that has nothing else, by degrees: the controller's own sums with the new numbers give it."""
    o = np.array([0, *np.radians([3.0, -5, 0.2, 1]), 0])
    theta = np.zeros(ur10.n_theta)
    theta[-6:] = o
    state = replace(planted(ur10, rng), theta_0=theta, C_theta=np.zeros_like(ur10.C_theta))
    state = replace(state, error_coefficients=np.zeros_like(state.error_coefficients))
    (file := tmp_path / "in.txt").write_bytes(text.encode("latin-1"))
    gears = COUPLED.ravel() if text is MOC else ()
    best, off = export_offsets(state, file, tmp_path / "out.txt", gears)
    new = (tmp_path / "out.txt").read_bytes().decode("latin-1")
    number = r"-?[\d.e-]+(?=[ \n\\])"
    key = r"\$MAMES\[\d\]=" if text is MACHINE else r"-cal_offset "
    old, found = (np.array(re.findall(key + f"({number})", both), dtype=float)[:6] for both in (text, new))
    if text is MACHINE:  # at the notch the axis is where it was, and is called as it is now
        np.testing.assert_allclose(np.radians(found - old), o, rtol=0, atol=1e-9)
    else:  # the motors stand as they did; q = q_0 + M^-1 (motor - cal_offset)
        motor = old + COUPLED @ rng.uniform(-1, 1, 6)
        turns = (motor - found) - (motor - old) - COUPLED @ o
        np.testing.assert_allclose(turns, 2 * np.pi * np.round(turns / (2 * np.pi)), rtol=0, atol=1e-7)
        assert np.abs(found).max() <= 2 * np.pi
    assert off < 1e-9
    assert best.corrected_mm[1] < 1e-6 < best.drawn_mm[0]
    assert "0.000 mm RMS, 0.000 at most: lengths and tilts of axes" in new
    ours = re.compile(r"[;#] (testbench export|not in the offsets|\d\.\d{3} mm RMS).*\s")
    assert re.sub(key + number, "", ours.sub("", new)) == re.sub(key + number, "", text)


def test_offsets_are_the_best_and_what_they_leave_is_told_by_kind(ur10, rng):
    """Offsets planted beside other errors are found again; those leave what they left without them."""
    state, turned = planted(ur10, rng), np.array([0, 3, 4, 5, -6, 0]) * 1e-2
    q, theta = random_joints(state.vjm)[:60], state.theta_0.copy()
    theta[-6:] += turned
    theta[:6], theta[36:39] = 1e-3, 2e-3  # base and tool, which are measured anew
    found, more = best_offsets(state, q), best_offsets(replace(state, theta_0=theta), q)
    np.testing.assert_allclose(more.offsets - found.offsets, turned, rtol=0, atol=2e-4)
    assert more.drawn_mm[0] > 10 * found.drawn_mm[0] > 10 * found.corrected_mm[0] > 0
    assert more.corrected_mm[0] == pytest.approx(found.corrected_mm[0], rel=0.02)
    kinds = "own weight", "periodic errors of the joints", "errors in proportion to the angle"
    assert list(found.left) == ["lengths and tilts of axes", *kinds, "payload, if there is one"]
    for kind, size in found.left.items():
        assert more.left[kind] == pytest.approx(size, rel=0.05), kind
    light = replace(state.vjm, arm=replace(state.vjm.arm, payload=None))  # offsets are of the unloaded arm
    np.testing.assert_allclose(best_offsets(replace(state, vjm=light), q).offsets, found.offsets, atol=1e-9)
