"""Many poses at once: each as if alone, and forces on bodies as MuJoCo itself says."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace

import mujoco
import numpy as np
import pytest

from testbench.errors import NoEquilibrium
from testbench.plant import TYPICAL, build_plant, disturb, settle, settle_linear, settle_pair
from testbench.plant.build import plant_of
from testbench.plant.state import evaluate, generalised_force, moved, open_row, place

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
    assert settle(plant, q[hanging], wrench[hanging], point[hanging]).residual.max() < 0.05


@pytest.mark.parametrize("name", ["link_0", "link_2", "tool"])
def test_force_on_a_body_and_its_motion_are_mujocos_own(kr500, rng, name):
    plant = kr500.plant
    model, data, body = plant.model, mujoco.MjData(plant.model), plant.model.body(name).id
    qpos, wrench = 0.1 * rng.standard_normal((11, model.nv)), 1000 * rng.standard_normal((11, 6))
    theta = rng.standard_normal((11, model.nv))
    state = evaluate(open_row(plant), qpos, (body,))
    at = place(state, body, np.array([0.3, -0.2, 0.1]))
    Q, (shift, turn) = generalised_force(plant, state, body, wrench, at), moved(plant, state, body, theta)
    for i in range(11):
        data.qpos[:] = qpos[i]
        mujoco.mj_forward(model, data)
        expected, J = np.zeros(model.nv), np.zeros((6, model.nv))
        mujoco.mj_applyFT(model, data, wrench[i, :3], wrench[i, 3:], at[i], body, expected)
        mujoco.mj_jacBody(model, data, J[:3], J[3:], body)
        # levers of metres, loads of 1e3 N, 54 joints: rounding is 1e-12
        np.testing.assert_allclose(Q[i], expected, rtol=0, atol=1e-9)
        np.testing.assert_allclose(np.hstack([shift[i], turn[i]]), J @ theta[i], rtol=0, atol=1e-12)
        np.testing.assert_allclose(state.weight[i], -data.qfrc_bias, rtol=0, atol=1e-9)
        np.testing.assert_allclose(-plant.K @ qpos[i], data.qfrc_passive, rtol=1e-9, atol=1e-3)  # 1e9 N
