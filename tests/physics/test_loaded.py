"""The loaded arm: Eq. (7) against differences and MuJoCo, own weight, masses from torques of another arm."""

import re

import mujoco
import numpy as np
import pytest
from loads import GRAVITY, at_rest, hung, random_q
from serial_arms import write_arm
from spoil import swap

from testbench import Series, load_arm
from testbench.errors import BenchError, InputError, NoEquilibrium
from testbench.identify.absolute.choose import (
    CENTRE_DEVIATION,
    MASS_DEVIATION,
    MAX_MASS_DEVIATIONS,
    fit_link_masses,
)
from testbench.identify.regression import non_redundant_structure, rank
from testbench.model import load as loaded
from testbench.model.load import own_weight_load, read_body_masses
from testbench.model.structure import template56
from testbench.model.vjm import evaluate_chain, observation_matrix
from testbench.plant.build import weightless
from testbench.plant.equilibrium import PoseBatch, create_arm_copies, solve_equilibrium
from testbench.plant.equilibrium import newton_matrix as plant_tangent
from testbench.workflows.absolute import of_masses

HEAVIEST = {"kr500": 10_000.0, "arm_6r": 40_000.0, "slides": 3_000.0}
"""Most that the arm carries in every pose [N]: the light arm's virtual joints then turn by 0.2 rad."""


def random_wrench(rng, runs, force, moment):
    part = rng.standard_normal((runs, 6)) * np.repeat([force, moment], 3)
    return part, rng.uniform(-0.4, 0.4, (runs, 3))  # well off the tool's centre


def test_the_plants_tangent_by_differences_is_that_of_k_w(cell, rng):
    """I - C_theta K_w of Eq. (7), by which the plant takes its steps and finds that an arm buckles."""
    plant, q = weightless(cell.plant), random_q(cell, rng, 3)
    most = HEAVIEST[cell.arm.name.removesuffix("_l480")]
    wrench, point = random_wrench(rng, 3, most / 10, most / 10)  # of a force alone it would be symmetric
    theta, row = solve_equilibrium(plant, q, wrench, point).theta, create_arm_copies(plant)
    K_w = loaded.geometric_stiffness(evaluate_chain(cell.vjm, q, theta), wrench, point)
    qpos = np.zeros((3, plant.model.nv))
    qpos[:, plant.joint_indices], qpos[:, plant.theta_indices] = q, theta
    for i in range(3):
        poses = PoseBatch(plant, qpos[i, None], wrench[i, None], point[i, None], plant.compliance(q[i, None]))
        found = plant_tangent(poses, row, qpos[i], 0)[np.ix_(plant.theta_indices, plant.theta_indices)]
        expected = cell.arm.C_theta @ K_w[i]
        size = np.abs(expected).max()  # 1e-9 of the springs' tangent, of which the load's is 1 %
        np.testing.assert_allclose(np.eye(len(found)) - found, expected, rtol=0, atol=1e-7 * size)


@pytest.mark.parametrize("share", [0.1, 0.46, 1.0])
def test_model_and_plant_come_to_rest_in_the_same_place(cell, share, rng):
    """Pinocchio's chain with steps of its springs, MuJoCo's with springs as tendons: one equilibrium."""
    plant, q = weightless(cell.plant), random_q(cell, rng, 40)
    wrench, point = hung(cell, 40, share * HEAVIEST[cell.arm.name.removesuffix("_l480")] / GRAVITY)
    rest = solve_equilibrium(plant, q, wrench, point)
    theta = at_rest(cell, cell.arm.C_theta, q, wrench, point)
    # the plant stops at a step of 1e-9, which gains a factor of four or more
    np.testing.assert_allclose(theta, rest.theta, rtol=0, atol=1e-9)
    moved = loaded.nonlinear_deflection(cell.vjm, q, theta, cell.vjm.markers)
    np.testing.assert_allclose(
        moved, rest.marker_positions - solve_equilibrium(plant, q).marker_positions, rtol=0, atol=1e-8
    )


def inverted_pendulum(cell):
    """Joint 2 alone elastic, the load straight above it: pose, point, C_theta, height, compliance."""
    q = np.deg2rad([[0.0, -90, 0, 0, 0, 0]])
    where, C_theta = evaluate_chain(cell.vjm, q), np.zeros_like(cell.arm.C_theta)
    joint_2 = 6 * 7 + 1
    compliance = cell.arm.joints[1].compliance
    C_theta[joint_2, joint_2] = compliance
    height, above = 2.0, cell.vjm.base_pose[:3, 3] + [0.5, 0, 1.045 + 2.0]
    point = (above - where.tool_position[0]) @ where.tool_rotation[0]
    return q, point[None], C_theta, height, compliance


def test_stiffness_falls_to_zero_at_the_buckling_load_of_theory_beyond_which_a_pose_is_named(kr500, arm_6r):
    """An inverted pendulum of height h on a spring k: stiffness k - P h, critical load P = k / h."""
    q, point, C_theta, height, compliance = inverted_pendulum(kr500)
    critical = 1 / (compliance * height)
    for share in (0.0, 0.5, 0.9):
        wrench = np.array([[0, 0, -share * critical, 0, 0, 0]])
        theta = at_rest(kr500, C_theta, q, wrench, point)
        where = evaluate_chain(kr500.vjm, q, theta)
        K_w = loaded.geometric_stiffness(where, wrench, point)
        sideways = loaded.loaded_compliance(loaded.load_jacobian(where, point), C_theta, K_w)[0, 0, 0]
        # a dozen roundings, magnified ten times by the nearness of buckling
        expected = height**2 * compliance / (1 - share)
        np.testing.assert_allclose(sideways, expected, rtol=1e-13)
    for share in (1.001, 3.0):
        wrench = np.array([[1.0, 0, -share * critical, 0, 0, 0]])  # a newton tells it where to fall
        with pytest.raises(NoEquilibrium, match=r"-90\.0.*buckled"):
            at_rest(kr500, C_theta, q, wrench, point)
    q = np.deg2rad([[0.0, 0, 0, 0, 0, 0], [0.0, 10, 0, 0, 0, 0]])
    wrench, point = hung(arm_6r, 2, 1e5)
    wrench[0] = 0
    with pytest.raises(NoEquilibrium, match=r"no static equilibrium at .*10\.0.*too soft"):
        at_rest(arm_6r, arm_6r.arm.C_theta, q, wrench, point)


def test_wrong_shapes_say_what_was_expected(kr500):
    arm, vjm = kr500.arm, kr500.vjm
    q, wrench, point, theta = np.zeros((2, 6)), np.zeros((2, 6)), np.zeros((2, 3)), np.zeros((2, 48))
    where, K_w = evaluate_chain(vjm, q), np.zeros((2, 48, 48))
    J = loaded.load_jacobian(where, point)
    for text, call in {
        r"q \[rad, m\]: expected shape \(any, 6\), got \(2, 5\)": lambda: evaluate_chain(vjm, q[:, :5]),
        r"theta \[m, rad\]: expected shape \(2, 48\), got \(1, 48\)": lambda: evaluate_chain(
            vjm, q, theta[:1]
        ),
        r"wrench .*\(2, 6\), got \(1, 6\)": lambda: loaded.geometric_stiffness(where, wrench[:1], point),
        r"point .*\(2, 3\), got \(3,\)": lambda: loaded.geometric_stiffness(where, wrench, point[0]),
        r"point .*\(2, 3\), got \(1, 3\)": lambda: loaded.load_jacobian(where, point[:1]),
        r"J_theta .*\(any, 6, any\), got \(6, 48\)": lambda: loaded.loaded_compliance(J[0], arm.C_theta, K_w),
        r"C_theta .*\(48, 48\), got \(42, 42\)": lambda: loaded.loaded_compliance(J, np.eye(42), K_w),
        r"K_w .*\(2, 48, 48\), got \(48, 48\)": lambda: loaded.loaded_compliance(J, arm.C_theta, K_w[0]),
        r"targets .*\(any, 3\), got \(3,\)": lambda: loaded.nonlinear_deflection(vjm, q, theta, np.zeros(3)),
        r"targets .*got \(1, 2\)": lambda: loaded.first_order_deflection(where, theta, np.zeros((1, 2))),
        r"K_w .*got \(1, 48, 48\)": lambda: loaded.one_step_theta(where, arm.C_theta, wrench, point, K_w[:1]),
    }.items():
        with pytest.raises(BenchError, match=text):
            call()


@pytest.mark.parametrize("name", ["kr500", "arm_6r"])
def test_algebraic_reduction_finds_the_32_parameters_of_mls32(name, request, rng):
    cell = request.getfixturevalue(name)
    full = template56(cell.arm)
    reduced = non_redundant_structure(cell.vjm, full, name="MLS32")
    assert (reduced.name, reduced.n_parameters) == ("MLS32", 32)
    where, load = evaluate_chain(cell.vjm, random_q(cell, rng, 30)), random_wrench(rng, 30, 1000, 1000)
    A, B = (
        observation_matrix(where, s, *load, cell.vjm.markers).reshape(-1, s.n_parameters)
        for s in (full, reduced)
    )
    assert rank(B) == rank(A)  # and so every prediction of the 56 can be had from the 32
    assert rank(np.hstack([A, B])) == rank(B)


FIXED = """<body name="motor" pos="0.1 0.2 0.3" euler="20 30 40"><inertial pos="0.1 -0.1 0.2" mass="3"
 diaginertia="0.1 0.1 0.1"/><body name="cover" pos="0 0.1 0" zaxis="1 2 3"><inertial pos="0.3 0 0.1"
 mass="0.5" diaginertia="0.1 0.1 0.1"/><geom class="drawn" size="0.1"/></body></body>"""
DRAWN = '<default><default class="drawn"><geom mass="0"/></default></default>'


def rewritten(folder, *changes):
    for old, new in changes:
        swap(re.escape(old), new)(folder / "rigid.xml")
    return load_arm(folder)


def test_bodies_fixed_to_a_link_weigh_with_it(tmp_path):
    folder = write_arm(tmp_path / "arm", "zyx", degrees=True)
    link_3 = '<body name="link_3"'
    arm = rewritten(folder, (link_3, FIXED + link_3), ("<worldbody>", f"{DRAWN}<worldbody>"))
    model = mujoco.MjModel.from_xml_path(str(arm.mjcf_path))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    weights, link = read_body_masses(arm), data.body("link_2")
    parts = [data.body(name).id for name in ("link_2", "motor", "cover")]
    mass = model.body_mass[parts]
    centre = mass @ (data.xipos[parts] - link.xpos) @ link.xmat.reshape(3, 3) / mass.sum()
    np.testing.assert_allclose(weights.mass[2], mass.sum(), rtol=1e-14)
    np.testing.assert_allclose(weights.centre_of_mass[2], centre, rtol=0, atol=1e-14)


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
        read_body_masses(arm)


def other_arm(cell, rng):
    """Every mass off by a Gaussian factor, every centre too."""
    model = cell.room.model.__copy__()
    factor = np.maximum(1 + MASS_DEVIATION * rng.standard_normal(model.nbody), 0.2)
    model.body_mass *= factor
    model.body_ipos += CENTRE_DEVIATION / 2 * rng.standard_normal((model.nbody, 3))
    return model


def true_torques(cell, model, q, wrench, point):
    """Generalised forces of gravity and of a wrench at the tool on the joints, (runs, n) [N m, N]."""
    data, tool, found = mujoco.MjData(model), model.body(cell.arm.tool).id, []
    for run, pose in enumerate(q):
        data.qpos[cell.room.joint_addresses] = pose
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_rne(model, data, 0, data.qfrc_bias)
        forces, at = -data.qfrc_bias, data.xpos[tool] + data.xmat[tool].reshape(3, 3) @ point[run]
        mujoco.mj_applyFT(model, data, wrench[run, :3], wrench[run, 3:], at, tool, forces)
        found.append(forces[cell.room.joint_addresses])
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
    model, weights = other_arm(cell, rng), read_body_masses(cell.arm)
    q, (wrench, point) = random_q(cell, rng, 600), hung(cell, 600, 20.0)
    wrench[::2] = 0
    exact = true_torques(cell, model, q, wrench, point)
    sigma = 0.01 * rms(exact)
    torque = sign * (exact + sigma * rng.standard_normal(exact.shape))
    torque += 20 * sigma * rng.standard_normal(exact.shape[1])
    torque[rng.random(exact.shape) < 0.05] += 50 * sigma
    parts = tuple(with_torques(q[s], wrench[s], point[s], torque[s]) for s in (slice(100), slice(100, 300)))
    found = fit_link_masses(cell.vjm, weights, parts)

    def error(found):
        straight = evaluate_chain(cell.vjm, q[301::2])
        n = cell.arm.n_joints
        new = true_torques(cell, model, q[301::2], 0 * wrench[301::2], point[301::2])
        return rms(own_weight_load(straight, found)[-n:].T - new)

    assert error(found.body_masses) < 0.3 * sigma < 3 * sigma < error(weights)
    assert found.are_motor_torques == (sign == -1)
    assert ("the torques of the weight" in of_masses(found)) == (sign == 1)


def test_torques_that_are_not_of_the_weight_change_no_mass_and_none_beyond_its_bounds(kr500, rng):
    """In another order; none; an unstated load, of 250 kg like heavy links, of a tonne like nothing."""
    weights = read_body_masses(kr500.arm)
    q, (wrench, point) = random_q(kr500, rng, 200), hung(kr500, 200, 0.0)
    exact = true_torques(kr500, kr500.room.model, q, wrench, point)
    found = fit_link_masses(kr500.vjm, weights, (with_torques(q, wrench, point, exact[:, ::-1]),))
    assert found.body_masses is weights
    assert "order of joints" in of_masses(found)
    assert fit_link_masses(kr500.vjm, weights, (with_torques(q, wrench, point, None),)) is None

    def fit(unknown):
        wrench, point = hung(kr500, 200, unknown)
        torque = true_torques(kr500, kr500.room.model, q, wrench, point)
        return fit_link_masses(kr500.vjm, weights, (with_torques(q, 0 * wrench, point, torque),))

    found = fit(250.0)
    assert (
        np.abs(found.body_masses.mass / weights.mass - 1) < MAX_MASS_DEVIATIONS * MASS_DEVIATION + 1e-9
    ).all()
    assert "by the largest allowed amount: link_" in of_masses(found)
    found = fit(1000.0)
    assert found.body_masses is weights
    assert "the unit and the payload" in of_masses(found)
