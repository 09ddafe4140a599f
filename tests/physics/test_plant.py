"""The truth side against theory and against MuJoCo's own time stepping."""

import shutil
import subprocess
import sys
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from loads import hung, random_q

from testbench.arm.folder import load_arm
from testbench.arm.stiffness import Tube, tube_compliance
from testbench.cli.elastic import write_elastic
from testbench.errors import InputError, NoEquilibrium
from testbench.plant import build_plant, settle, weightless


def at_pose(plant, q, theta=0.0):
    data = mujoco.MjData(plant.model)
    data.qpos[plant.joints] = q
    data.qpos[plant.theta] = theta
    return data


def softer(cell, factor):
    arm = cell.arm
    links = tuple(replace(link, compliance=factor * link.compliance) for link in arm.links)
    joints = tuple(replace(joint, compliance=factor * joint.compliance) for joint in arm.joints)
    return build_plant(replace(arm, links=links, joints=joints))


@pytest.mark.parametrize("name", ["kr500", "arm_6r"])
def test_tendon_springs_are_the_inverse_of_the_compliance(name, request):
    cell = request.getfixturevalue(name)
    data = at_pose(cell.plant, 0.0)
    K = np.empty((cell.arm.n_theta,) * 2)
    h = 1e-3  # passive forces are linear in theta: any step will do
    for k, address in enumerate(cell.plant.theta):
        data.qpos[cell.plant.theta] = 0
        data.qpos[address] = h
        mujoco.mj_fwdPosition(cell.plant.model, data)
        mujoco.mj_fwdVelocity(cell.plant.model, data)
        K[:, k] = -data.qfrc_passive[cell.plant.theta] / h
    scale = np.sqrt(np.diag(cell.arm.C_theta))
    unitless = K * np.outer(scale, scale)
    expected = np.linalg.inv(cell.arm.C_theta / np.outer(scale, scale))
    # relative to the largest entry of order one to ten; rounding of the inverse is 1e-15
    np.testing.assert_allclose(unitless, expected, rtol=0, atol=1e-12)


def test_a_link_bends_as_a_cantilever_under_a_tip_force(single_link):
    """One tube, MuJoCo's sum of springs, against L^3 / (3 E I) and L^2 / (2 E I)."""
    tube = Tube(0.3, 0.04, 0.03, 7e10, 0.33)
    link = replace(single_link.arm.links[0], compliance=tube_compliance(tube))
    plant = weightless(build_plant(replace(single_link.arm, links=(link,))))
    force = np.array([[0, 1.0, 0, 0, 0, 0]])
    rest, start = settle(plant, np.zeros((1, 0)), force), settle(plant, np.zeros((1, 0)))
    EI = 7e10 * np.pi * (0.04**4 - 0.03**4) / 64
    moved = (rest.tool - start.tool)[0]
    assert moved[1] == pytest.approx(0.3**3 / (3 * EI), rel=1e-5)  # a newton: second order is 1e-6
    assert rest.rotation[0, 1, 0] == pytest.approx(0.3**2 / (2 * EI), rel=1e-5)


def test_newton_residual_is_that_of_mujocos_full_forward_pass(kr500, rng):
    q = random_q(kr500, rng, 5)
    wrench, point = hung(kr500, 5)
    rest = settle(kr500.plant, q, wrench, point)
    assert rest.step.max() < 1e-9
    for i in range(5):
        data = at_pose(kr500.plant, q[i], rest.theta[i])
        mujoco.mj_forward(kr500.plant.model, data)
        frame = data.xmat[kr500.plant.tool].reshape(3, 3)
        where = data.xpos[kr500.plant.tool] + frame @ point[i]
        Q = data.qfrc_passive - data.qfrc_bias
        mujoco.mj_applyFT(kr500.plant.model, data, wrench[i, :3], np.zeros(3), where, kr500.plant.tool, Q)
        # a last step of 1e-9 m on a spring of 1e10 N/m leaves 10 N; it is 1e-5 of the 4.5 kN here
        assert np.abs(Q[kr500.plant.theta]).max() == pytest.approx(rest.residual[i], abs=1e-9)
        assert rest.residual[i] < 0.05
        assert data.nefc == 0  # no constraint: MuJoCo 4.0.0's sparse constraint solver is wrong


@pytest.mark.parametrize("mass", [0.0, 460.3])
def test_newton_finds_where_time_stepping_comes_to_rest(kr500, mass):
    q = np.deg2rad([[20.0, -80, 95, 10, -30, 15]])
    wrench, point = hung(kr500, 1, mass)
    rest = settle(kr500.plant, q, wrench, point)
    model, data = kr500.plant.model, at_pose(kr500.plant, q[0])
    for _ in range(3000):
        mujoco.mj_step1(model, data)
        data.qfrc_applied[:] = 0
        if mass:
            frame = data.xmat[kr500.plant.tool].reshape(3, 3)
            where = data.xpos[kr500.plant.tool] + frame @ point[0]
            mujoco.mj_applyFT(
                model, data, wrench[0, :3], np.zeros(3), where, kr500.plant.tool, data.qfrc_applied
            )
        mujoco.mj_step2(model, data)
    assert np.abs(data.qvel).max() < 1e-8  # at rest
    assert np.abs(data.qpos[kr500.plant.joints] - q[0]).max() < 1e-9  # the brakes hold
    np.testing.assert_allclose(data.qpos[kr500.plant.theta], rest.theta[0], rtol=0, atol=2e-9)


def test_the_elastic_arm_is_never_written_over_the_rigid_one(kr500, tmp_path):
    arm = load_arm(shutil.copytree(kr500.arm.rigid.parent, tmp_path / "arm"))
    before = arm.rigid.read_bytes()
    with pytest.raises(InputError, match="outside the arm's own folder"):
        write_elastic(arm, arm.rigid)
    assert arm.rigid.read_bytes() == before


def test_a_softer_arm_needs_the_tangent_and_still_settles(kr500):
    """Forty times softer: theta <- C Q(theta) gains a factor of three a step and would need 15 steps."""
    plant = softer(kr500, 40.0)
    q = np.deg2rad([[0.0, -60, 70, 0, 30, 0]])
    rest = settle(plant, q)
    assert rest.step[0] < 1e-9
    assert rest.iterations[0] < 12
    assert rest.residual[0] < 0.05
    assert np.abs(rest.theta).max() > 0.02


def test_an_arm_too_soft_for_its_load_is_an_error_that_names_the_pose(kr500):
    plant = softer(kr500, 1000.0)
    q = np.deg2rad([[0.0, -90, 90, 0, 0, 0]])
    wrench, point = hung(kr500, 1)
    with pytest.raises(NoEquilibrium, match=r"-90\.0, 90\.0.*too soft for its load, or buckled"):
        settle(plant, q, wrench, point)


def test_elastic_arm_written_out_is_plain_mjcf_that_stands_still(kr500, tmp_path):
    write_elastic(kr500.arm, tmp_path / "elastic.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "elastic.xml"))
    assert (model.nv, model.ntendon) == (54, 42)
    data = mujoco.MjData(model)
    for _ in range(2000):
        mujoco.mj_step(model, data)
    assert np.abs(data.qvel).max() < 1e-6
    expected = settle(kr500.plant, np.zeros((1, 6))).tool[0]
    np.testing.assert_allclose(data.body("tool").xpos, expected, rtol=0, atol=1e-7)


def test_what_mujoco_warns_of_is_logged_and_leaves_no_file(kr500, tmp_path, monkeypatch, caplog):
    monkeypatch.chdir(tmp_path)
    data = mujoco.MjData(kr500.plant.model)
    data.qpos[:] = np.nan
    mujoco.mj_step(kr500.plant.model, data)
    assert "huge value" in caplog.text
    assert list(tmp_path.iterdir()) == []


UNSTABLE = """
import mujoco
from testbench.cli.elastic import write_elastic
from testbench.plant import build_plant
ball = "<body><freejoint/><geom size='1'/></body>"
model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{ball}</worldbody></mujoco>")
data = mujoco.MjData(model)
data.qvel[:] = 1e300
mujoco.mj_step(model, data)
assert data.warning[mujoco.mjtWarning.mjWARN_BADQVEL].number == 1
"""


def test_a_warning_of_mujoco_leaves_no_file_and_no_words(tmp_path):
    code = [sys.executable, "-c", UNSTABLE]
    done = subprocess.run(code, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout + done.stderr == ""
    assert list(tmp_path.iterdir()) == []
