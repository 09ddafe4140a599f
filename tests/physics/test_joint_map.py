"""Joints that follow others: pendants that count otherwise, palletisers, mimics and equalities."""

import csv
import re
import shutil
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from serial_arms import write_arm
from unsure import unsure

import testbench as tb
from testbench.arm.folder import ArmJoint, build_joint_map
from testbench.correct.compensated import joints_along_path
from testbench.correct.newton import Aim
from testbench.data.dataset import series_from_runs
from testbench.design.exchange import Feasibility, PoseSearch
from testbench.errors import InputError
from testbench.files.export import draft_new, export
from testbench.files.program import read_poses
from testbench.files.robot.chain import read_chain
from testbench.files.write import write_program, write_series
from testbench.model.structure import all153
from testbench.model.vjm import rotation_vectors_between, tool_poses
from testbench.plant.equilibrium import solve_equilibrium
from testbench.plant.shapes import rigid_frames
from testbench.runs.rows import trial_rng
from testbench.workflows.cell import build_cell
from testbench.workflows.new_arm import UserInputs
from testbench.workflows.new_arm import write_arm as write_own
from testbench.workflows.plan import nearest_turn, search
from testbench.workflows.plan import workspace_poses as workspace
from testbench.workflows.plan_numbers import numbers, write_poses
from testbench.workflows.program import correct_program, more_columns

SETTINGS = tb.PlanSettings(loads_kg=(60.0,), poses=4, candidates_wanted=30)
ROUND_TRIP = 1e-12  #: Of joints from files to the chain and back [rad, m].
PENDANT = """
[joints]
joint_1 = { joint_1 = -1 }
joint_3 = { joint_3 = 1, joint_2 = -1, offset_deg = 10 }
"""
"""A pendant that counts joint 3 from the horizontal, with another zero, and turns joint 1 the other way."""


def stated(folder, table):
    """An arm's folder with a table more, before its links."""
    file = folder / "elastic.toml"
    file.write_text(file.read_text().replace("[[link]]", f"{table}[[link]]", 1))
    return folder


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """An arm of six joints, and the same whose pendant counts three of them otherwise."""
    folder = tmp_path_factory.mktemp("both")
    plain = write_arm(folder / "plain" / "arm", "zyyxyx")
    shutil.copytree(plain, folder / "pendant" / "arm")
    return build_cell(plain), build_cell(stated(folder / "pendant" / "arm", PENDANT))


def counted(q):
    """Joints as PENDANT counts them, of those of the chain, written out by hand."""
    found = np.array(q)
    found[..., 0] = -found[..., 0]
    found[..., 2] += found[..., 1] - np.radians(10)
    return found


def columns(path, names, scale=1.0):
    with path.open() as file:
        return scale * np.array([[float(row[name]) for name in names] for row in csv.DictReader(file)])


def written(file, names, q, mass):
    """A program of joints under a mass, [rad] in degrees."""
    rows = [[*names, "mass_kg"], *(map(repr, [*row, mass]) for row in np.degrees(q).tolist())]
    file.write_text("\n".join(map(",".join, rows)))
    return file


RAD, DEG = ([f"joint_{k}_{unit}" for k in range(1, 7)] for unit in ("rad", "deg"))


def test_readings_in_pendant_joints_identify_the_arm_alike(both, tmp_path):
    """MuJoCo's arm read by one tracker: two files, of which one is in pendant joints, and one model."""
    scenario = tb.Scenario(arm="arm", identification_poses=8, check_poses=3, workspace_poses=10)
    runs = [tb.simulate(cell, scenario, seed=3) for cell in both]
    np.testing.assert_array_equal(runs[0].measured.q, runs[1].measured.q)
    np.testing.assert_array_equal(*(search(cell, SETTINGS).q for cell in both))
    files = [tmp_path / "plain.csv", tmp_path / "pendant.csv"]
    for cell, own, file in zip(both, runs, files, strict=True):
        tb.write_csv(own.identification, cell.arm, file)
    written = [columns(file, RAD) for file in files]
    np.testing.assert_allclose(written[1], counted(written[0]), rtol=0, atol=ROUND_TRIP)
    assert np.abs(written[1] - written[0]).max() > 0.5
    read = [tb.read_csv(file, cell.arm) for file, cell in zip(files, both, strict=True)]
    np.testing.assert_allclose(read[1].q, read[0].q, rtol=0, atol=ROUND_TRIP)
    truth = runs[0].truth
    found = []
    for cell, data in zip(both, read, strict=True):
        fit = tb.with_prior(tb.gco, tb.cad_prior(cell.arm))(cell.vjm, all153(cell.arm), data)
        found.append(tb.deflections(cell.vjm, fit, truth))
    assert np.abs(found[0]).max() > 1e-4
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-9)
    series = [
        tb.read_series(file, cell.arm)
        for file, cell in zip(absolute(both, read, tmp_path), both, strict=True)
    ]
    for one, other in zip(*(own.series for own in series), strict=True):
        np.testing.assert_allclose(one.q, other.q, rtol=0, atol=ROUND_TRIP)
        np.testing.assert_allclose(one.torque, other.torque, rtol=1e-12)
        assert one.torque is not None


def absolute(both, read, folder):
    """The readings of two arms as absolute ones, with torques of their chains, written by each."""
    torque = trial_rng(5).normal(size=read[0].q.shape)
    for name, cell, data in zip(("plain", "pendant"), both, read, strict=True):
        [one] = series_from_runs(data, name, name)
        write_series(folder / f"{name}_abs.csv", cell.arm, replace(one, torque=np.tile(torque, (2, 1))))
    return [folder / f"{name}_abs.csv" for name in ("plain", "pendant")]


@pytest.mark.study
def test_plans_are_the_same_poses_in_pendant_joints(both, tmp_path):
    """Searched, refined and ordered in joints of the chain; from tasks that a pendant counted."""
    plans = []
    for cell in both:
        q = cell.arm.draw_poses(trial_rng(8), 3)
        settings = tb.PlanSettings(loads_kg=(8.0,), poses=5, candidates_wanted=40)
        plans.append(tb.plan(cell, q, settings))
    np.testing.assert_allclose(plans[1].plan.q, plans[0].plan.q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(plans[1].forecast.rms_error, plans[0].forecast.rms_error, rtol=1e-6)
    arm = both[1].arm
    write_poses(numbers(plans[1]), arm.file_joints, tmp_path / "plan.csv")
    found = columns(tmp_path / "plan.csv", RAD)
    np.testing.assert_allclose(found, counted(plans[1].plan.q), rtol=0, atol=ROUND_TRIP)
    assert np.abs(columns(tmp_path / "plan.csv", DEG, np.pi / 180) - found).max() < 1e-6
    np.testing.assert_allclose(
        read_poses(tmp_path / "plan.csv", arm), plans[1].plan.q, rtol=0, atol=ROUND_TRIP
    )


def test_programs_are_corrected_alike_and_come_out_in_pendant_joints(both, tmp_path):
    """Every table gives the joints back as this pendant counts them."""
    way = np.linspace([0.2, -0.6, 0.9, 0.1, -0.4, 0.3], [0.5, -0.3, 0.6, 0.3, -0.6, 0.1], 7)
    found = []
    for cell, q, name in zip(both, (way, counted(way)), ("plain", "pendant"), strict=True):
        program = tb.read_program(written(tmp_path / f"{name}.csv", DEG, q, 9.0), cell.arm)
        np.testing.assert_allclose(program.q, way, rtol=0, atol=ROUND_TRIP)
        found.append(correct_program(unsure(cell), program, Aim()))
    q = found[0].found.q
    assert np.abs(q - way).max() > 1e-4
    np.testing.assert_allclose(found[1].found.q, q, rtol=0, atol=1e-10)
    arm, wanted = both[1].arm, np.degrees(counted(found[1].found.q))
    write_program(tmp_path / "c.csv", found[1].program, found[1].found.q, more_columns(found[1]))
    np.testing.assert_allclose(columns(tmp_path / "c.csv", DEG), wanted, rtol=0, atol=1e-10)
    moved = columns(tmp_path / "c.csv", [f"correction_{name}" for name in DEG])
    np.testing.assert_allclose(moved, wanted - np.degrees(counted(way)), rtol=0, atol=1e-9)
    again = tb.read_program(tmp_path / "c.csv", arm).q
    np.testing.assert_allclose(again, found[1].found.q, rtol=0, atol=ROUND_TRIP)


MOVES = {
    # A level of two joints that follow, as URDF has them; of one, by an equality of joints, or of tendons.
    "joint": '<joint name="level" joint1="tilt" joint2="lift" polycoef="-0.2 -1 0 0 0"/>',
    "tendon": '<tendon name="level" tendon1="sum" polycoef="0.1 0 0 0 0"/>',
}


def palletiser(equality, *, extra=""):
    """An MJCF of a lifting arm whose hand follows; zeros of joints lie beside where the file draws them."""
    limits = 'range="-1.2 1.2"'
    y = f'axis="0 1 0" {limits}'
    weight = '<inertial pos="0.2 0 0" mass="{}" diaginertia="1 1 1"/>'
    return f"""<mujoco model="pal"><compiler angle="radian" autolimits="true"/><worldbody>
    <body name="foot">{weight.format(200)}
     <body name="turret" pos="0 0 0.5">{weight.format(100)}<joint name="turn" axis="0 0 1" {limits}/>
      <body name="boom" pos="0.3 0 0.2">{weight.format(80)}<joint name="lift" ref="0.3" {y}/>
       <body name="stick" pos="0 0 1.1">{weight.format(60)}<joint name="x" {y}/>
        <body name="wrist" pos="1.2 0 0">{weight.format(15)}<joint name="tilt" axis="0 1 0" ref="-0.1"
          range="-3 3"/>
         <body name="hand" pos="0.2 0 -0.1">{weight.format(10)}<joint name="spin" axis="0 0 1" {limits}/>
          <site name="tool0" pos="0 0 -0.15"/></body></body></body></body>
      <body name="rod" pos="0 0.2 0">{weight.format(5)}<joint name="rod" axis="0 1 0" {limits}/></body>
     </body></body></worldbody>
    <tendon><fixed name="sum"><joint joint="lift" coef="1"/><joint joint="x" coef="1"/>
     <joint joint="tilt" coef="1"/></fixed></tendon>
    <equality>{equality}<joint joint1="rod" joint2="lift" polycoef="0 1 2 0 0"/></equality>
    {extra}</mujoco>"""


def arm_of(text, folder, name="pal.xml"):
    """The arm that `testbench new` makes of a robot's file."""
    (file := folder / name).write_text(text)
    (folder / "made").mkdir()
    notes = write_own(read_chain(file), UserInputs(payload=80.0), folder / "made")
    return build_cell(folder / "made"), notes


@pytest.mark.parametrize("kind", MOVES)
def test_mujoco_finds_equalities_kept_in_all_poses_of_file_joints(tmp_path, kind):
    """MuJoCo's own residual of the stranger's equalities, and its place of the tool."""
    text = palletiser(MOVES[kind])
    cell, notes = arm_of(text, tmp_path)
    arm = cell.arm
    assert [joint.name for joint in arm.file_joints] == ["turn", "lift", "x", "spin"]
    assert any(note.startswith("joints that follow others") for note in notes)
    model = mujoco.MjModel.from_xml_string(text)
    data, q = mujoco.MjData(model), arm.to_file_joints(arm.draw_poses(trial_rng(4), 20))
    p, _ = tool_poses(cell.vjm, arm.to_chain_joints(q))
    own = [model.joint(joint.name).qposadr[0] for joint in arm.joints]
    for k, pose in enumerate(arm.to_chain_joints(q)):
        data.qpos[:] = model.qpos0
        data.qpos[own] = pose
        mujoco.mj_forward(model, data)
        level = data.efc_pos[(data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY) & (data.efc_id == 0)]
        assert np.abs(level).max() < ROUND_TRIP
        np.testing.assert_allclose(p[k], data.site("tool0").xpos, rtol=0, atol=1e-9)
    np.testing.assert_allclose(arm.to_file_joints(arm.to_chain_joints(q)), q, rtol=0, atol=ROUND_TRIP)


def test_a_joint_may_follow_one_behind_it():
    """The joint that the file joint names stays free, so that an exported mimic says the same."""
    arm = [ArmJoint(name, -1.0, 1.0, 1e-6) for name in ("a", "b", "c")]
    found = build_joint_map(arm, {"a": {"c": -0.5}}, {"a": 0.1})
    assert found.file_joint_names == ("b", "c")
    assert found.free_joints.tolist() == [1, 2]
    assert found.followed_joint(0) == (2, -0.5, 0.1)
    np.testing.assert_allclose(found.to_chain_joints(np.array([0.3, 0.4])), [-0.1, 0.3, 0.4], atol=1e-15)


def test_motors_say_which_joints_others_follow(tmp_path):
    motors = "".join(f'<motor joint="{name}"/>' for name in ("turn", "lift", "tilt", "spin"))
    cell, _ = arm_of(palletiser(MOVES["tendon"], extra=f"<actuator>{motors}</actuator>"), tmp_path)
    assert [joint.name for joint in cell.arm.file_joints] == ["turn", "lift", "tilt", "spin"]


def test_what_ties_no_joint_of_the_arm_is_left_out_as_before(tmp_path):
    """A leader's weld, a part in the hand, a coupling of branches: not the arm's own tendon."""
    more = """<worldbody><body name="leader" mocap="true"/><body name="part"><freejoint/>
        <geom size="0.1"/></body></worldbody><equality><weld body1="leader" body2="hand"/>
        <weld body1="part" body2="hand"/></equality>"""
    plain, notes = arm_of(palletiser("", extra=more), tmp_path)
    assert plain.arm.joint_map is None
    assert any(note.startswith("not needed") and "equality, tendon" in note for note in notes)
    (other := tmp_path / "other").mkdir()
    cell, notes = arm_of(palletiser(MOVES["tendon"]), other)
    assert cell.arm.joint_map is not None
    assert not any("tendon" in note for note in notes)


@pytest.mark.parametrize(
    ("equality", "said"),
    [
        ('<joint joint1="tilt" joint2="lift" polycoef="0 1 0.5 0 0"/>', "joint equality '1' is not linear"),
        (
            '<connect name="bar" body1="rod" body2="stick" anchor="0 0 0"/>',
            "connect 'bar' closes a loop over the joint 'lift', so the arm is no chain",
        ),
        ('<weld body1="wrist" body2="turret"/>', "weld '1' closes a loop over the joint 'lift'"),
        (
            '<joint joint1="tilt" joint2="lift" polycoef="0 1 0 0 0"/>'
            '<joint joint1="tilt" polycoef="0.2 0 0 0 0"/><joint joint1="lift" polycoef="0 0 0 0 0"/>',
            "contradict each other: no joint positions satisfy all",
        ),
    ],
)
def test_what_is_no_chain_is_refused_in_one_line(tmp_path, equality, said):
    (file := tmp_path / "pal.xml").write_text(palletiser(equality))
    with pytest.raises(InputError) as found:
        read_chain(file)
    assert said in str(found.value)
    assert "\n" not in str(found.value)


def mimics():
    """A palletiser's URDF of six joints in the chain: two follow, of which one by three halves of another."""
    joints = [
        ("a1", "0 0 0.6", "0 0 1", ""),
        ("a2", "0.3 0 0.3", "0 1 0", ""),
        ("a3", "0 0 1.2", "0 1 0", ""),
        ("lv2", "1.4 0 0", "0 1 0", '<mimic joint="a2" multiplier="-1"/>'),
        ("lv3", "0 0 0", "0 1 0", '<mimic joint="a3" multiplier="-1" offset="0.25"/>'),
        ("a4", "0.2 0 -0.2", "0 0 -1", ""),
    ]
    mass = '<inertial><mass value="{}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    text = f'<robot name="level"><link name="foot">{mass.format(200)}</link>'
    for k, (name, at, axis, mimic) in enumerate(joints):
        before = joints[k - 1][0] + "_l" if k else "foot"
        low, high = (-0.9, 1.1) if name == "lv3" else (-1.4, 1.4)
        text += f"""<link name="{name}_l">{mass.format(90 - 12 * k)}</link>
            <joint name="{name}" type="revolute"><parent link="{before}"/>
            <child link="{name}_l"/><origin xyz="{at}"/><axis xyz="{axis}"/>
            <limit lower="{low}" upper="{high}" effort="1" velocity="1"/>{mimic}</joint>"""
    return (
        text
        + """<link name="tool0"/><joint name="end" type="fixed"><parent link="a4_l"/>
        <child link="tool0"/><origin xyz="0 0 -0.1"/></joint></robot>"""
    )


@pytest.fixture(scope="module")
def level(tmp_path_factory):
    return arm_of(mimics(), tmp_path_factory.mktemp("level"), "level.urdf")[0]


def tilt(R):
    """Angle between tools' z axes and that of the hand at zero, which mimics hold, (poses,) [rad]."""
    axis = np.array([np.sin(0.25), 0, np.cos(0.25)])
    heading = R[:, :, 2] - R[:, [2], 2] * np.array([0, 0, 1.0])
    assert np.abs(np.linalg.norm(heading, axis=1) - axis[0]).max() < 1e-9
    return np.abs(R[:, 2, 2] - axis[2])


def test_a_hand_held_by_mimics_keeps_its_tilt_in_mujoco_and_in_the_model(level):
    """For any of the four joints that the URDF names; limits of one that follows bound the one it follows."""
    arm = level.arm
    assert [joint.name for joint in arm.file_joints] == ["a1", "a2", "a3", "a4"]
    assert (arm.n_joints, len(arm.links)) == (6, 7)
    np.testing.assert_allclose(arm.limits[:, 2], [0.25 - 1.1, 0.25 + 0.9], atol=1e-12)
    q = np.random.default_rng(6).uniform(*arm.limits[:, [0, 1, 2, 5]], (30, 4))
    frames = rigid_frames(level.room, arm.to_chain_joints(q))
    tool = frames.rotations[:, level.room.model.body(arm.tool).id]
    assert tilt(tool).max() < 1e-9
    assert tilt(tool_poses(level.vjm, arm.to_chain_joints(q))[1]).max() < 1e-9
    np.testing.assert_allclose(arm.to_file_joints(arm.to_chain_joints(q)), q, rtol=0, atol=ROUND_TRIP)
    for j, own in enumerate(np.radians(arm.distance_to_limits(arm.to_chain_joints(q))).T):
        ends = [arm.to_chain_joints(q + s * own[:, None] * np.eye(4)[j]) for s in (-1, 1)]
        beyond = [np.maximum(arm.limits[0] - end, end - arm.limits[1]).max(axis=1) for end in ends]
        assert np.abs(np.max(beyond, axis=0)).max() < 1e-9  # so far, and no farther
    moved = arm.to_chain_joints(q) + 0.1 * np.eye(6)[3]
    np.testing.assert_array_equal(arm.with_dependent_joints(moved), arm.to_chain_joints(q))


def test_a_palletiser_is_corrected_by_its_file_joints_alone(level, tmp_path):
    """MuJoCo's loaded tool is where the unloaded one was; what four joints cannot turn back is told."""
    arm, mass = level.arm, 80.0
    way = np.linspace([0.1, 0.2, -0.2, 0.4], [0.5, 0.5, 0.1, 0.1], 6)
    names = [f"{joint.name}_deg" for joint in arm.file_joints]
    program = tb.read_program(written(tmp_path / "way.csv", names, way, mass), arm)
    found = correct_program(unsure(level), program, Aim())
    q = found.found.q
    assert found.found.corrected.all()
    np.testing.assert_allclose(arm.to_chain_joints(arm.to_file_joints(q)), q, rtol=0, atol=ROUND_TRIP)
    point = np.tile(level.vjm.load_point, (len(q), 1))
    wrench = np.tile([0, 0, -9.81 * mass, 0, 0, 0], (len(q), 1))
    rest = arm.to_chain_joints(way)
    true, sagged = (solve_equilibrium(level.plant, own, wrench, point) for own in (q, rest))
    before = solve_equilibrium(level.plant, rest)
    off = sagged.tool_positions - before.tool_positions
    assert np.linalg.norm(off, axis=1).min() > 5e-4
    assert np.abs(true.tool_positions - before.tool_positions).max() < 1e-8
    left = rotation_vectors_between(true.tool_rotations, before.tool_rotations)
    assert np.linalg.norm(left, axis=1).min() > 1e-5
    np.testing.assert_allclose(found.found.rotation_error, left, rtol=0, atol=1e-7)


def possible(arm, q):
    """Poses lie where the file joints can be, within the limits."""
    np.testing.assert_allclose(arm.with_dependent_joints(q), q, rtol=0, atol=ROUND_TRIP)
    assert ((q >= arm.limits[0] - 1e-9) & (q <= arm.limits[1] + 1e-9)).all()


def test_candidates_and_ways_of_a_palletiser_are_poses_that_it_has(level):
    """Poses that are drawn, varied in a search, or found for poses of the tool."""
    arm = level.arm
    q = search(level, SETTINGS).q
    assert len(q) == 30
    tries = PoseSearch(
        lambda q, _: q, 4, arm.limits, Feasibility(lambda q: q), trial_rng(7), arm.with_dependent_joints
    )
    for some in (q, tries.draw_around(q, np.full((30, 1), 0.5)), workspace(level, SETTINGS)):
        possible(arm, some)
    way = arm.to_chain_joints(np.linspace([0.1, 0.2, -0.2, 0.4], [0.5, 0.5, 0.1, 0.1], 9))
    position, rotation = tool_poses(level.vjm, way)
    found = joints_along_path(level.vjm, position, rotation)
    assert found.converged.all()
    possible(arm, found.q)
    wound = arm.to_chain_joints(np.array([[0.2, 0.3, 0.1, 0.2]]))
    np.testing.assert_array_equal(nearest_turn(wound, arm), wound)


def test_a_new_urdf_says_which_joints_mimic(level, tmp_path):
    """It is read back as the same palletiser, its hand as level."""
    state = unsure(level).state
    export(state, draft_new(state), tmp_path / "again.urdf")
    arm = read_chain(tmp_path / "again.urdf").joint_map
    assert arm is not None
    np.testing.assert_allclose(arm.L, level.arm.joint_map.L, atol=1e-9)
    np.testing.assert_allclose(arm.q_0, level.arm.joint_map.q_0, atol=1e-9)


WRONG = {
    "joint_9 = { joint_1 = 1 }": "expected one of the joints joint_1, joint_2",
    "joint_1 = { offset_mm = 3, joint_1 = 1 }": "expected offset_deg of this joint, got offset_mm",
    "joint_1 = { joint_2 = 1 }\njoint_2 = { x = 1, y = 1 }": "dependent rows",
    "joint_2 = { joint_2 = 2000 }": "expected coefficients up to 1000",
    "joint_2 = { joint_2 = true }": "expected a number, got True",
}


@pytest.mark.parametrize("row", WRONG)
def test_a_table_that_is_no_map_is_refused(tmp_path, row):
    folder = stated(write_arm(tmp_path / "arm", "zyyxyx"), f"[joints]\n{row}\n")
    with pytest.raises(InputError, match=re.escape(WRONG[row])) as found:
        tb.load_arm(folder)
    assert str(found.value).count("elastic.toml") == 1


def test_rows_that_say_nothing_leave_the_arm_as_it_is(tmp_path):
    table = "[joints]\njoint_2 = { joint_2 = 1, offset_deg = 0 }\n"
    arm = tb.load_arm(stated(write_arm(tmp_path / "arm", "zyyxyx"), table))
    assert arm.joint_map is None
    assert arm.file_joints is arm.joints
    q = arm.draw_poses(trial_rng(1), 4)
    assert arm.to_file_joints(q) is q
    assert arm.with_dependent_joints(q) is q
