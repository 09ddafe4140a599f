"""The truth side against MuJoCo's own time stepping; many poses at once: each as if alone."""

import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace

import mujoco
import numpy as np
import pytest
from loads import hung, random_q

from testbench.arm.folder import load_arm
from testbench.cli.elastic import write_elastic
from testbench.errors import InputError, NoEquilibrium
from testbench.plant import TYPICAL, build_plant, disturb, settle, settle_linear, settle_pair
from testbench.plant.build import plant_of


def at_pose(plant, q, theta=0.0):
    data = mujoco.MjData(plant.model)
    data.qpos[plant.joints] = q
    data.qpos[plant.theta] = theta
    return data


def unbalanced(plant, q, theta, wrench, point):
    """Largest generalised force that springs, weight and wrench leave [N, N m], and MuJoCo's constraints."""
    data = at_pose(plant, q, theta)
    mujoco.mj_forward(plant.model, data)
    where = data.xpos[plant.tool] + data.xmat[plant.tool].reshape(3, 3) @ point
    Q = data.qfrc_passive - data.qfrc_bias
    mujoco.mj_applyFT(plant.model, data, wrench[:3], wrench[3:], where, plant.tool, Q)
    return np.abs(Q[plant.theta]).max(), data.nefc


def test_newton_leaves_no_force_in_mujocos_full_forward_pass(kr500, rng):
    q = random_q(kr500, rng, 5)
    wrench, point = hung(kr500, 5)
    rest = settle(kr500.plant, q, wrench, point)
    for i in range(5):
        left, constraints = unbalanced(kr500.plant, q[i], rest.theta[i], wrench[i], point[i])
        assert left < 0.05  # 1e-5 of 4.5 kN
        assert constraints == 0  # MuJoCo 4.0.0's sparse constraint solver is wrong


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


POSES = 41  # five times the arms side by side, and one


def loads(cell, rng):
    q = rng.uniform(*cell.arm.limits, (POSES, cell.arm.n_joints))
    wrench = np.zeros((POSES, 6))
    wrench[:, 2] = -rng.uniform(0, 5000, POSES)
    return q, wrench, np.tile(cell.plant.load, (POSES, 1))


def loaded(plant, q, wrench, point):
    return settle(plant, q, wrench, point)


def typical(plant, q, wrench, point):
    return settle_pair(disturb(plant, TYPICAL, np.random.default_rng(1)), q, wrench, point)[1]


def assert_same(one, other):
    """To rounding, a millionth of the last Newton step: BLAS may round by where an array lies."""
    for field in fields(one):
        atol = 1e-6 if field.name == "residual" else 1e-13  # springs of 1e10 N/m
        np.testing.assert_allclose(getattr(one, field.name), getattr(other, field.name), rtol=0, atol=atol)


@pytest.mark.parametrize("settled", [loaded, typical, settle_linear])
def test_poses_settle_alike_in_any_order_and_in_any_company(kr500, rng, monkeypatch, settled):
    runs, order = loads(kr500, rng), rng.permutation(POSES)
    expected = settled(kr500.plant, *runs)
    shuffled = settled(kr500.plant, *(part[order] for part in runs))
    assert_same(shuffled, replace(expected, **{k: v[order] for k, v in vars(expected).items()}))
    monkeypatch.setattr("testbench.plant.equilibrium.TOGETHER", 7)
    assert_same(settled(kr500.plant, *runs), expected)
    monkeypatch.setattr("testbench.plant.build.ABREAST", 1)
    assert_same(settled(plant_of(kr500.arm, kr500.plant.model), *runs), expected)


def test_threads_of_a_caller_find_the_same(kr500, rng):
    """They share the plant, and nothing that is written to."""
    runs = loads(kr500, rng)
    expected = typical(kr500.plant, *runs)
    with ThreadPoolExecutor(3) as pool:
        for found in pool.map(lambda _: typical(kr500.plant, *runs), range(9)):
            assert_same(found, expected)


@pytest.mark.parametrize("together", [2, 512])
def test_of_poses_without_equilibrium_the_first_is_named(kr500, monkeypatch, together):
    """The first buckles after many steps; the second, pulled by 1e9 N, is lost in one."""
    monkeypatch.setattr("testbench.plant.equilibrium.TOGETHER", together)
    joints = list(kr500.arm.joints)
    joints[1] = replace(joints[1], compliance=6e-5)  # upright is a saddle
    plant = build_plant(replace(kr500.arm, joints=tuple(joints)))
    q = np.deg2rad(np.array([[0.0, 90, 0, 0, 0, 0]]) + np.arange(6)[:, None] * np.eye(6)[0])  # it hangs
    wrench, point = np.zeros((6, 6)), np.zeros((6, 3))
    wrench[4, 0] = 1e9
    with pytest.raises(NoEquilibrium, match=r"in 1 Newton steps.*q = \[4\.0, 90\.0"):
        settle(plant, q, wrench, point)
    q[3, 1] *= -1
    wrench[3, 2], point[3] = -4515.0, plant.load
    with pytest.raises(NoEquilibrium, match=r"buckle.* q = \[3\.0, -90\.0"):
        settle(plant, q, wrench, point)
    hanging = [0, 1, 2, 5]
    rest = settle(plant, q[hanging], wrench[hanging], point[hanging])
    left = map(unbalanced, [plant] * 4, q[hanging], rest.theta, wrench[hanging], point[hanging])
    assert max(left)[0] < 0.05
