"""Masses from joint torques: MuJoCo's gravity of an arm that weighs otherwise than its rigid.xml."""

import mujoco
import numpy as np
import pytest
from loads import hung, random_q

from testbench.campaign.absolute import of_masses
from testbench.data.series import Series
from testbench.identify.absolute.torques import CENTRE, LIMIT, MASS, fit_weights
from testbench.model.vjm import chain
from testbench.model.weights import own_weight, read_weights


def other_arm(cell, rng):
    """Every mass off by a Gaussian factor, every centre too."""
    model = cell.room.model.__copy__()
    factor = np.maximum(1 + MASS * rng.standard_normal(model.nbody), 0.2)
    model.body_mass *= factor
    model.body_ipos += CENTRE / 2 * rng.standard_normal((model.nbody, 3))
    return model


def true_torques(cell, model, q, wrench, point):
    """Generalised forces of gravity and of a wrench at the tool on the joints, (runs, n) [N m, N]."""
    data, found, tool = mujoco.MjData(model), [], cell.room.model.body(cell.arm.tool).id
    for run, pose in enumerate(q):
        data.qpos[cell.room.joints] = pose
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_rne(model, data, 0, data.qfrc_bias)
        force = np.zeros(model.nv)
        at = data.xpos[tool] + data.xmat[tool].reshape(3, 3) @ point[run]
        mujoco.mj_applyFT(model, data, wrench[run, :3], wrench[run, 3:], at, tool, force)
        found.append((force - data.qfrc_bias)[cell.room.joints])
    return np.array(found)


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
