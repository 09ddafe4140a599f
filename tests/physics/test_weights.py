"""The arm's own weight on the virtual joints, against MuJoCo's generalised force of gravity."""

import mujoco
import numpy as np
import pytest
from serial_arms import write_arm

from testbench.arm.folder import load_arm
from testbench.errors import InputError
from testbench.model.vjm import chain
from testbench.model.weights import own_weight, read_weights, weight_columns

AGREE = 1e-12  # of the largest load; both sides are sums of a few products


def of_mujoco(model, q, joints, theta=None, bent=()):
    """Generalised force of gravity, (runs, nv); some joints bent by theta, (runs, n)."""
    data, found = mujoco.MjData(model), []
    for run, pose in enumerate(q):
        data.qpos[:] = 0
        data.qpos[joints] = pose
        if theta is not None:
            data.qpos[bent] += theta[run]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_rne(model, data, 0, data.qfrc_bias)
        found.append(-data.qfrc_bias)
    return np.array(found)


@pytest.mark.parametrize("size", [0.0, 0.3])
def test_own_weight_is_mujocos_on_every_virtual_joint(cell, size, rng):
    """Virtual joints bent by 0.3 m and 0.3 rad too."""
    model = cell.plant.model.__copy__()
    for link in cell.arm.links:
        model.body(f"{link.name}_end").mass[:] = 0  # a carrier is not of the arm
    q = rng.uniform(*cell.arm.limits, (20, cell.arm.n_joints))
    theta = size * rng.uniform(-1, 1, (20, cell.arm.n_theta))
    expected = of_mujoco(model, q, cell.plant.joints, theta, cell.plant.theta)
    load = own_weight(chain(cell.vjm, q, theta), read_weights(cell.arm))
    scale = np.abs(expected).max()
    np.testing.assert_allclose(load.T, expected[:, cell.plant.theta], rtol=0, atol=AGREE * scale)


def test_columns_times_masses_and_first_moments_are_the_load(cell, rng):
    q = rng.uniform(*cell.arm.limits, (20, cell.arm.n_joints))
    where = chain(cell.vjm, q, 0.1 * rng.uniform(-1, 1, (20, cell.arm.n_theta)))
    weights = read_weights(cell.arm)
    columns = weight_columns(where)
    load = own_weight(where, weights)
    summed = np.einsum("trbk,bk->tr", columns, weights.parameters)
    np.testing.assert_allclose(summed, load, rtol=0, atol=1e-12 * np.abs(load).max())
    assert not columns[:, :, 0].any()  # the base link bends nothing


FIXED = """<body name="motor" pos="0.1 0.2 0.3" euler="20 30 40"><inertial pos="0.1 -0.1 0.2" mass="3"
 diaginertia="0.1 0.1 0.1"/><body name="cover" pos="0 0.1 0" zaxis="1 2 3"><inertial pos="0.3 0 0.1"
 mass="0.5" diaginertia="0.1 0.1 0.1"/><geom class="drawn" size="0.1"/></body></body>"""
DRAWN = '<default><default class="drawn"><geom mass="0"/></default></default>'


def rewritten(folder, change):
    text = (folder / "rigid.xml").read_text(encoding="utf-8")
    (folder / "rigid.xml").write_text(change(text), encoding="utf-8")
    return load_arm(folder)


def test_bodies_fixed_to_a_link_weigh_with_it(tmp_path):
    folder = write_arm(tmp_path / "arm", "zyx", degrees=True)
    arm = rewritten(
        folder,
        lambda text: text.replace('<body name="link_3"', f'{FIXED}<body name="link_3"').replace(
            "<worldbody>", f"{DRAWN}<worldbody>"
        ),
    )
    model = mujoco.MjModel.from_xml_path(str(arm.rigid))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    weights, link = read_weights(arm), data.body("link_2")
    parts = [data.body(name).id for name in ("link_2", "motor", "cover")]
    mass = model.body_mass[parts]
    centre = mass @ (data.xipos[parts] - link.xpos) @ link.xmat.reshape(3, 3) / mass.sum()
    np.testing.assert_allclose(weights.mass[2], mass.sum(), rtol=1e-14)
    np.testing.assert_allclose(weights.centre[2], centre, rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("<compiler ", '<compiler inertiafromgeom="true" ', "expected masses in <inertial>"),
        ('<body name="P1"', '<body name="box"><geom size="0.1"/></body><body name="P1"', "'box'.*shapes"),
    ],
)
def test_masses_that_only_mujoco_could_weigh_are_refused(tmp_path, old, new, expected):
    arm = rewritten(write_arm(tmp_path / "arm", "zyx"), lambda text: text.replace(old, new, 1))
    with pytest.raises(InputError, match=expected):
        read_weights(arm)
