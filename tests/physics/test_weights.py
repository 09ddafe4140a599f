"""The arm's own weight on its joints against MuJoCo's gravity, and masses from torques of another arm."""

import mujoco
import numpy as np
import pytest
from loads import hung, random_q
from serial_arms import write_arm

from testbench.arm.folder import load_arm
from testbench.campaign.absolute import of_masses
from testbench.data.series import Series
from testbench.errors import InputError
from testbench.identify.absolute.torques import CENTRE, LIMIT, MASS, fit_weights
from testbench.model.vjm import chain
from testbench.model.weights import own_weight, read_weights

AGREE = 1e-12  # of the largest load; both sides are sums of a few products


def forces(model, qpos, body=0, wrench=None, point=None):
    """Generalised forces of gravity, and of a wrench at a point of a body, (runs, nv) [N m, N]."""
    data, found = mujoco.MjData(model), []
    for run, pose in enumerate(qpos):
        data.qpos[:] = pose
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_rne(model, data, 0, data.qfrc_bias)
        found.append(-data.qfrc_bias)
        if body:
            at = data.xpos[body] + data.xmat[body].reshape(3, 3) @ point[run]
            mujoco.mj_applyFT(model, data, wrench[run, :3], wrench[run, 3:], at, body, found[-1])
    return np.array(found)


def test_own_weight_is_mujocos_on_every_virtual_joint(cell, rng):
    """Virtual joints bent by 0.3 m and 0.3 rad too."""
    model = cell.plant.model.__copy__()
    for link in cell.arm.links:
        model.body(f"{link.name}_end").mass[:] = 0  # a carrier is not of the arm
    qpos = np.zeros((20, model.nv))
    qpos[:, cell.plant.joints] = q = random_q(cell, rng, 20)
    qpos[10:, cell.plant.theta] = 0.3 * rng.uniform(-1, 1, (10, cell.arm.n_theta))
    expected = forces(model, qpos)[:, cell.plant.theta]
    load = own_weight(chain(cell.vjm, q, qpos[:, cell.plant.theta]), read_weights(cell.arm))
    np.testing.assert_allclose(load.T, expected, rtol=0, atol=AGREE * np.abs(expected).max())


FIXED = """<body name="motor" pos="0.1 0.2 0.3" euler="20 30 40"><inertial pos="0.1 -0.1 0.2" mass="3"
 diaginertia="0.1 0.1 0.1"/><body name="cover" pos="0 0.1 0" zaxis="1 2 3"><inertial pos="0.3 0 0.1"
 mass="0.5" diaginertia="0.1 0.1 0.1"/><geom class="drawn" size="0.1"/></body></body>"""
DRAWN = '<default><default class="drawn"><geom mass="0"/></default></default>'


def rewritten(folder, *changes):
    text = (folder / "rigid.xml").read_text(encoding="utf-8")
    for old, new in changes:
        text = text.replace(old, new, 1)
    (folder / "rigid.xml").write_text(text, encoding="utf-8")
    return load_arm(folder)


def test_bodies_fixed_to_a_link_weigh_with_it(tmp_path):
    folder = write_arm(tmp_path / "arm", "zyx", degrees=True)
    link_3 = '<body name="link_3"'
    arm = rewritten(folder, (link_3, FIXED + link_3), ("<worldbody>", f"{DRAWN}<worldbody>"))
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
    arm = rewritten(write_arm(tmp_path / "arm", "zyx"), (old, new))
    with pytest.raises(InputError, match=expected):
        read_weights(arm)


def other_arm(cell, rng):
    """Every mass off by a Gaussian factor, every centre too."""
    model = cell.room.model.__copy__()
    factor = np.maximum(1 + MASS * rng.standard_normal(model.nbody), 0.2)
    model.body_mass *= factor
    model.body_ipos += CENTRE / 2 * rng.standard_normal((model.nbody, 3))
    return model


def true_torques(cell, model, q, wrench, point):
    """Generalised forces of gravity and of a wrench at the tool on the joints, (runs, n) [N m, N]."""
    qpos, joints = np.zeros((len(q), model.nv)), cell.room.joints
    qpos[:, joints] = q
    return forces(model, qpos, model.body(cell.arm.tool).id, wrench, point)[:, joints]


def with_torques(q, wrench, point, torque):
    rows = len(q)
    ids, origin = np.arange(rows), np.zeros((rows, 1, 3))
    return Series("s", ("P1",), "f", "t", ids, ids, q, wrench, point, origin, 1e-4, torque=torque)


def rms(x):
    return np.sqrt((x**2).mean())


@pytest.mark.parametrize("name", ["kr500", "slides"])
@pytest.mark.parametrize("sign", [1, -1])
def test_wrong_masses_are_mended_to_the_noise_of_the_torques(name, sign, request, rng):
    """300 poses, half with a payload, of either sign, with offsets and every twentieth torque wild."""
    cell = request.getfixturevalue(name)
    model, weights = other_arm(cell, rng), read_weights(cell.arm)
    q, (wrench, point) = random_q(cell, rng, 600), hung(cell, 600, 20.0)
    wrench[::2] = 0
    exact = true_torques(cell, model, q, wrench, point)
    sigma = 0.01 * rms(exact)
    torque = sign * (exact + sigma * rng.standard_normal(exact.shape))
    torque += 20 * sigma * rng.standard_normal(exact.shape[1])
    torque[rng.random(exact.shape) < 0.05] += 50 * sigma
    parts = tuple(with_torques(q[s], wrench[s], point[s], torque[s]) for s in (slice(100), slice(100, 300)))
    found = fit_weights(cell.vjm, weights, parts)

    def error(found):
        straight = chain(cell.vjm, q[301::2])
        n = cell.arm.n_joints
        new = true_torques(cell, model, q[301::2], 0 * wrench[301::2], point[301::2])
        return rms(own_weight(straight, found)[-n:].T - new)

    assert error(found.weights) < 0.3 * sigma < 3 * sigma < error(weights)
    assert found.motors == (sign == -1)
    assert ("the weight's" in of_masses(found)) == (sign == 1)


def test_torques_that_are_not_of_the_weight_change_no_mass(kr500, rng):
    """Joints in another order; and none at all."""
    weights = read_weights(kr500.arm)
    q, (wrench, point) = random_q(kr500, rng, 200), hung(kr500, 200, 0.0)
    exact = true_torques(kr500, kr500.room.model, q, wrench, point)
    found = fit_weights(kr500.vjm, weights, (with_torques(q, wrench, point, exact[:, ::-1]),))
    assert found.weights is weights
    assert "order of joints" in of_masses(found)
    assert fit_weights(kr500.vjm, weights, (with_torques(q, wrench, point, None),)) is None


def test_what_no_mass_explains_stays_in_bounds_and_is_said(kr500, rng):
    """A load that nobody wrote down: a few hundred kilograms look like heavy links, a tonne like none."""
    weights = read_weights(kr500.arm)
    q = random_q(kr500, rng, 200)

    def fit(unknown):
        wrench, point = hung(kr500, 200, unknown)
        torque = true_torques(kr500, kr500.room.model, q, wrench, point)
        return fit_weights(kr500.vjm, weights, (with_torques(q, 0 * wrench, point, torque),))

    found = fit(250.0)
    assert (np.abs(found.weights.mass / weights.mass - 1) < LIMIT * MASS + 1e-9).all()
    assert "as far from rigid.xml as is allowed: link_" in of_masses(found)
    found = fit(1000.0)
    assert found.weights is weights
    assert "payload?" in of_masses(found)
