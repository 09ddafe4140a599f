"""The truth against MuJoCo's own time stepping, each disturbance against theory; many poses, each alone."""

import logging
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace

import mujoco
import numpy as np
import pytest
from loads import hung, random_q

from testbench.arm.folder import Compensator, load_arm
from testbench.errors import BenchError, InputError, NoEquilibrium
from testbench.files.robot.write import write_elastic
from testbench.plant.build import build_plant, plant_from_model
from testbench.plant.disturbance import (
    FOUNDATION_COMPLIANCE,
    KR500_COMPENSATOR,
    TYPICAL_DISTURBANCES,
    Disturbances,
    GearErrors,
    GeometryErrors,
    NonlinearJoints,
    PoseDependence,
    SpringEffects,
    joint_deflection,
    joint_tangent_compliance,
)
from testbench.plant.equilibrium import (
    compensator_bodies,
    compensator_force,
    compensator_state,
    correct_steps_for_compensator,
    create_arm_copies,
    evaluate_bodies,
    solve_equilibrium,
    solve_linear_equilibrium,
    solve_unloaded_and_loaded,
    undeflected_configurations,
)
from testbench.plant.true_arms import disturb, with_exact_load


def unbalanced(plant, q, theta, wrench, point):
    """Largest generalised force that springs, weight and wrench leave [N, N m], and MuJoCo's constraints."""
    data = mujoco.MjData(plant.model)
    data.qpos[plant.joint_indices], data.qpos[plant.theta_indices] = q, theta
    mujoco.mj_forward(plant.model, data)
    where = data.xpos[plant.tool_body] + data.xmat[plant.tool_body].reshape(3, 3) @ point
    Q = data.qfrc_passive - data.qfrc_bias
    mujoco.mj_applyFT(plant.model, data, wrench[:3], wrench[3:], where, plant.tool_body, Q)
    return np.abs(Q[plant.theta_indices]).max(), data.nefc


def test_newton_leaves_no_force_in_mujocos_full_forward_pass(kr500, rng):
    q, load = random_q(kr500, rng, 5), hung(kr500, 5)
    rest = solve_equilibrium(kr500.plant, q, *load)
    for left, constraints in map(unbalanced, [kr500.plant] * 5, q, rest.theta, *load):
        assert left < 0.05  # 1e-5 of 4.5 kN
        assert constraints == 0  # MuJoCo 4.0.0's sparse constraint solver is wrong


def test_elastic_arm_written_out_is_plain_mjcf_that_stands_still_never_over_the_rigid_one(kr500, tmp_path):
    write_elastic(kr500.arm, tmp_path / "elastic.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "elastic.xml"))
    assert (model.nv, model.ntendon) == (54, 42)
    data = mujoco.MjData(model)
    for _ in range(2000):
        mujoco.mj_step(model, data)
    assert np.abs(data.qvel).max() < 1e-6
    expected = solve_equilibrium(kr500.plant, np.zeros((1, 6))).tool_positions[0]
    np.testing.assert_allclose(data.body("tool").xpos, expected, rtol=0, atol=1e-7)
    arm = load_arm(shutil.copytree(kr500.arm.mjcf_path.parent, tmp_path / "arm"))
    before = arm.mjcf_path.read_bytes()
    with pytest.raises(InputError, match="outside the arm's own folder"):
        write_elastic(arm, arm.mjcf_path)
    assert arm.mjcf_path.read_bytes() == before


def test_what_mujoco_warns_of_is_for_who_listens_and_leaves_no_file(kr500, tmp_path, monkeypatch, caplog):
    monkeypatch.chdir(tmp_path)
    data = mujoco.MjData(kr500.plant.model)
    data.qpos[:] = np.nan
    mujoco.mj_step(kr500.plant.model, data)
    assert "huge value" in caplog.text
    assert list(tmp_path.iterdir()) == []
    assert [type(own) for own in logging.getLogger("testbench.plant").handlers] == [logging.NullHandler]


POSES = 41  # five times the arms side by side, and one


def loads(cell, rng):
    wrench, point = hung(cell, POSES, rng.uniform(0, 500, POSES))
    return random_q(cell, rng, POSES), wrench, point


def typical(plant, q, wrench, point):
    return solve_unloaded_and_loaded(
        disturb(plant, TYPICAL_DISTURBANCES, np.random.default_rng(1)), q, wrench, point
    )[1]


def assert_close(one, other):
    """To rounding, a millionth of the last Newton step: BLAS may round by where an array lies."""
    for field in fields(one):
        atol = 1e-6 if field.name == "residual" else 1e-13  # springs of 1e10 N/m
        np.testing.assert_allclose(getattr(one, field.name), getattr(other, field.name), rtol=0, atol=atol)


@pytest.mark.parametrize("settled", [solve_equilibrium, typical, solve_linear_equilibrium])
def test_poses_settle_alike_in_any_order_and_in_any_company(kr500, rng, monkeypatch, settled):
    runs, order = loads(kr500, rng), rng.permutation(POSES)
    expected = settled(kr500.plant, *runs)
    shuffled = settled(kr500.plant, *(part[order] for part in runs))
    assert_close(shuffled, replace(expected, **{k: v[order] for k, v in vars(expected).items()}))
    monkeypatch.setattr("testbench.plant.equilibrium.POSES_PER_BATCH", 7)
    assert_close(settled(kr500.plant, *runs), expected)
    monkeypatch.setattr("testbench.plant.build.ARMS_PER_MODEL", 1)
    assert_close(settled(plant_from_model(kr500.arm, kr500.plant.model), *runs), expected)


def test_threads_of_a_caller_find_the_same(kr500, rng):
    """They share the plant, and nothing that is written to."""
    runs = loads(kr500, rng)
    expected = typical(kr500.plant, *runs)
    with ThreadPoolExecutor(3) as pool:
        for found in pool.map(lambda _: typical(kr500.plant, *runs), range(4)):
            assert_close(found, expected)


@pytest.mark.parametrize("together", [2, 512])
def test_of_poses_without_equilibrium_the_first_is_named(kr500, monkeypatch, together):
    """The first buckles after many steps; the second, pulled by 1e9 N, is lost in one."""
    monkeypatch.setattr("testbench.plant.equilibrium.POSES_PER_BATCH", together)
    joints = list(kr500.arm.joints)
    joints[1] = replace(joints[1], compliance=6e-5)  # upright is a saddle
    plant = build_plant(replace(kr500.arm, joints=tuple(joints)))
    q = np.deg2rad(np.array([[0.0, 90, 0, 0, 0, 0]]) + np.arange(6)[:, None] * np.eye(6)[0])  # it hangs
    wrench, point = np.zeros((6, 6)), np.zeros((6, 3))
    wrench[4, 0] = 1e9
    with pytest.raises(NoEquilibrium, match=r"in 1 Newton steps.*q = \[4\.0, 90\.0"):
        solve_equilibrium(plant, q, wrench, point)
    q[3, 1] *= -1
    wrench[3, 2], point[3] = -4515.0, plant.load_point
    with pytest.raises(NoEquilibrium, match=r"buckle.* q = \[3\.0, -90\.0"):
        solve_equilibrium(plant, q, wrench, point)
    hanging = [0, 1, 2, 5]
    rest = solve_equilibrium(plant, q[hanging], wrench[hanging], point[hanging])
    left = map(unbalanced, [plant] * 4, q[hanging], rest.theta, wrench[hanging], point[hanging])
    assert max(left)[0] < 0.05


CLEAN = Disturbances(own_weight=True)


def disturbed(cell, disturbances, seed=1):
    return disturb(cell.plant, disturbances, np.random.default_rng(seed))


def assert_same(one, other):
    for field in fields(one):
        assert getattr(one, field.name).tobytes() == getattr(other, field.name).tobytes(), field.name


def test_an_undisturbed_arm_is_the_clean_one_and_errors_of_a_load_are_another_one_elsewhere(kr500, rng):
    """To the last bit; and it stays as it is when it is disturbed."""
    q, (wrench, point) = random_q(kr500, rng, 20), hung(kr500, 20)
    solve_equilibrium(disturbed(kr500, TYPICAL_DISTURBANCES), q)
    true = disturbed(kr500, replace(CLEAN, load_point_sigma=5e-3, mass_error=0.01))
    assert np.abs(true.load_point_error).max() > 1e-3
    clean, exact = disturbed(kr500, CLEAN), with_exact_load(true)
    for arm, pull, at in ((clean, 1, point), (true, 1.01, point + true.load_point_error), (exact, 1, point)):
        unloaded, loaded = solve_unloaded_and_loaded(arm, q, wrench, point)
        assert_same(unloaded, solve_equilibrium(kr500.plant, q))
        assert_same(loaded, solve_equilibrium(kr500.plant, q, pull * wrench, at))


def strut_length(plant, spring, qpos):
    """Length of a compensator, and how it grows with every coordinate, (nv,), by MuJoCo."""
    model, data, ends = plant.model, mujoco.MjData(plant.model), []
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    for name, where in (("link_1", spring.foot), ("link_2", spring.head)):
        body, J = data.body(name), np.zeros((3, model.nv))
        at = body.xpos + body.xmat.reshape(3, 3) @ where
        mujoco.mj_jac(model, data, J, None, at, body.id)
        ends.append((at, J))
    along = ends[1][0] - ends[0][0]
    return np.linalg.norm(along), along @ (ends[1][1] - ends[0][1]) / np.linalg.norm(along)


@pytest.mark.parametrize("stiffness", [None, KR500_COMPENSATOR.stiffness])
def test_the_compensator_pulls_along_its_length_and_stiffens_the_arm_it_holds(kr500, rng, stiffness):
    """On all 54 coordinates in a bent pose, by its stretch beyond the held one; there its stiffness."""
    spring, plant, row = (
        replace(KR500_COMPENSATOR, stiffness=stiffness),
        kr500.plant,
        create_arm_copies(kr500.plant),
    )
    k = spring.rate if stiffness is None else stiffness
    qpos = undeflected_configurations(plant, np.deg2rad([[10.0, -40, 60, 20, 30, 0]]))
    compensator = compensator_state(spring, plant, evaluate_bodies(row, qpos, compensator_bodies(plant)))
    (held, g), step = strut_length(plant, spring, qpos), rng.standard_normal(qpos.shape)
    (eased,) = correct_steps_for_compensator(compensator, step, np.arange(1))
    np.testing.assert_allclose(eased + k * (plant.C_qpos @ g) * (g @ eased), step[0], rtol=0, atol=1e-6)
    qpos[:, plant.theta_indices] = 1e-4 * rng.standard_normal(len(plant.theta_indices))
    (Q,) = compensator_force(
        compensator, plant, evaluate_bodies(row, qpos, compensator_bodies(plant)), np.arange(1)
    )
    length, g = strut_length(plant, spring, qpos)
    pull = spring.rate * (held - spring.rest_length) + k * (length - held)
    np.testing.assert_allclose(Q, -pull * g, rtol=0, atol=1e-9 * np.abs(Q).max())


def test_a_soft_foundation_moves_the_tool_as_a_rigid_body_on_it(kr500, rng):
    """Weightless arm, 1 N and 1 N m: twist of the base C_f times the wrench about its origin."""
    q = random_q(kr500, rng, 5)
    wrench, point = rng.standard_normal((5, 6)), 0.3 * rng.standard_normal((5, 3))
    scale = 3.0
    arms = [disturbed(kr500, Disturbances(foundation_factor=f)) for f in (0.0, scale)]
    (rest, rigid), (_, soft) = (solve_unloaded_and_loaded(arm, q, wrench, point) for arm in arms)
    at = rest.tool_positions + (rest.tool_rotations @ point[:, :, None])[:, :, 0]
    moment = wrench[:, 3:] + np.cross(at, wrench[:, :3])
    twist = scale * np.array(FOUNDATION_COMPLIANCE) * np.c_[wrench[:, :3], moment]
    expected = twist[:, :3] + np.cross(twist[:, 3:], rest.tool_positions)
    moved = soft.tool_positions - rigid.tool_positions
    # a newton bends the arm by 1e-6 m: second order is 1e-6; rounding of metres is 1e-8 of 1e-8 m
    np.testing.assert_allclose(moved, expected, rtol=0, atol=1e-5 * np.abs(expected).max())
    linear = solve_linear_equilibrium(arms[1], q, wrench, point)
    np.testing.assert_allclose(
        linear.tool_positions - rest.tool_positions,
        soft.tool_positions - rest.tool_positions,
        rtol=0,
        atol=1e-10,
    )


LAW = NonlinearJoints(
    compliance=np.array([0.075e-6, 0.15e-6, 0.7e-6, 0.7e-6]), stiffening=0.2, backlash=5e-5, hysteresis=3e-5
)
TORQUE = np.array([13e3, -4e3, 900.0, 40.0])  # the last within the play


def spring_torque(law, theta, torque):
    """What springs hold at their turns, friction beside them: by the polynomial itself."""
    x = law.compliance * torque
    friction = 0.0 if law.start_deflection is None else law.hysteresis
    slip = np.clip(theta - joint_deflection(replace(law, start_deflection=None), torque), -friction, friction)
    phi = theta - law.backlash * np.tanh(x / law.backlash) - slip
    return phi / law.compliance * (1 + law.stiffening * (phi / 1e-3) ** 2)


@pytest.mark.parametrize("before", [None, np.array([0.0, 0.0, 2e-3, 8e-5])])
def test_compliance_of_a_joint_is_the_slope_of_its_turn_whose_certificate_sees_a_nanoradian(before):
    """Springs by their polynomial, not by the root that was solved for; within its band friction holds."""
    law, h = replace(LAW, start_deflection=before), 1e-3
    expected = (joint_deflection(law, TORQUE + h) - joint_deflection(law, TORQUE - h)) / (2 * h)
    np.testing.assert_allclose(joint_tangent_compliance(law, TORQUE), expected, rtol=1e-6, atol=1e-15)
    moving, theta = joint_tangent_compliance(law, TORQUE) > 0, joint_deflection(law, TORQUE)
    assert (before is None) == moving[3]  # friction holds it
    np.testing.assert_allclose(spring_torque(law, theta, TORQUE), TORQUE, rtol=1e-9)
    for off in (1e-9, -1e-9):
        left = np.abs(spring_torque(law, theta + off, TORQUE) - TORQUE)
        outside = moving if before is None else moving & (off * np.sign(theta - before) < 0)  # others: within
        assert np.all(left[outside] > 0.9e-9 / law.compliance[outside])


def test_the_same_seed_gives_the_same_arm_and_a_switch_leaves_the_other_numbers_alone(kr500, rng):
    """All that disturbs it is in balance, on springs that MuJoCo has: no foundation counts twice."""
    q, arms = random_q(kr500, rng, 3), [disturbed(kr500, TYPICAL_DISTURBANCES, seed) for seed in (7, 7, 8)]
    one, same, other = (solve_unloaded_and_loaded(arm, q, *hung(kr500, 3))[1] for arm in arms)
    assert_same(one, same)
    assert np.abs(one.marker_positions - other.marker_positions).max() > 1e-6
    model, data, springs = arms[0].model, mujoco.MjData(arms[0].model), []
    for unit in np.eye(model.nv):
        data.qpos[:] = unit
        mujoco.mj_tendon(model, data)
        mujoco.mj_passive(model, data)
        springs.append(data.qfrc_passive.copy())
    free = np.setdiff1d(np.arange(model.nv), arms[0].joint_indices)
    K, C = -np.array(springs)[np.ix_(free, free)], arms[0].C_qpos[np.ix_(free, free)]
    np.testing.assert_allclose(C @ K, np.eye(len(free)), rtol=0, atol=1e-6)  # metres beside radians
    fewer = replace(TYPICAL_DISTURBANCES, geometry=None, foundation_factor=0.0, compensator=None)
    np.testing.assert_array_equal(disturbed(kr500, fewer, 7).joint_offset, arms[0].joint_offset)
    np.testing.assert_array_equal(disturbed(kr500, fewer, 7).load_point_error, arms[0].load_point_error)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Disturbances(backlash=-1e-5), "backlash: expected a finite number of at least 0"),
        (lambda: Disturbances(mass_error=-1.5), "mass_error: expected a finite number of at least -1"),
        (
            lambda: GeometryErrors(position_sigma=1e-3, angle_sigma=-1.0),
            "angle_sigma: expected a finite number",
        ),
        (lambda: GearErrors(max_order=-1), "max_order: expected 0 to 1000, got -1"),
        (lambda: Compensator((0, 0, 0), (0, 0, 1), -1.0, 0.5), "rate of the compensator"),
        (lambda: Compensator((0, 0), (0, 0, 1), 1.0, 0.5), r"foot of the compensator.*shape \(3\)"),
    ],
)
def test_impossible_disturbances_are_refused(build, message):
    with pytest.raises(BenchError, match=message):
        build()


def test_an_arm_without_link_2_has_no_compensator(single_link):
    with pytest.raises(BenchError, match="links 1 and 2, single_link has 1 links"):
        disturbed(single_link, TYPICAL_DISTURBANCES)


def with_springs(cell, **springs):
    return replace(cell.plant, spring_effects=SpringEffects(**springs))


def test_links_that_follow_the_pose_rest_where_an_arm_of_the_links_of_that_pose_rests(kr500, rng):
    """Scaled along each axis by the definition, and built anew: springs of MuJoCo's own in each pose."""
    q, links = random_q(kr500, rng, 3), len(kr500.arm.links)
    phase = rng.uniform(-3, 3, links)
    follows = PoseDependence(rng.normal(0, 0.5, (links, 6)), rng.standard_normal((links, 6)), phase)
    plant, (wrench, point) = with_springs(kr500, pose_dependence=follows), hung(kr500, 3)
    together = solve_equilibrium(plant, q, wrench, point), solve_linear_equilibrium(plant, q, wrench, point)
    for pose in range(3):
        s = np.sin(follows.phase_per_joint @ q[pose] + follows.phase)
        roots = [
            np.diag(np.exp(own * share / 2))
            for own, share in zip(s, follows.log_compliance_change, strict=True)
        ]
        scaled = [
            replace(link, compliance=D @ link.compliance @ D)
            for link, D in zip(kr500.arm.links, roots, strict=True)
        ]
        arm = build_plant(replace(kr500.arm, links=tuple(scaled)))
        for found, find in zip(together, (solve_equilibrium, solve_linear_equilibrium), strict=True):
            alone = find(arm, q[pose : pose + 1], wrench[:1], point[:1])
            np.testing.assert_allclose(
                found.marker_positions[pose], alone.marker_positions[0], rtol=0, atol=1e-9
            )
    stiff = solve_equilibrium(kr500.plant, q, wrench, point)
    assert np.abs(together[0].marker_positions - stiff.marker_positions).max() > 1e-4


@pytest.mark.parametrize("law", [{}, {"stiffening": 0.1, "backlash": 5e-5, "hysteresis": 3e-5}])
def test_a_torque_on_a_coupled_joint_turns_the_others_by_their_whole_matrix(kr500, rng, law):
    own = np.array([joint.compliance for joint in kr500.arm.joints])
    between = np.zeros((6, 6))
    between[range(1, 6), range(5)] = between[range(5), range(1, 6)] = 0.4 * np.sqrt(own[1:] * own[:-1])
    plant = with_springs(kr500, joint_coupling=between)
    plant = replace(plant, disturbances=replace(plant.disturbances, **law))
    (wrench, point), q = hung(kr500, 3), random_q(kr500, rng, 3)
    before, rest = solve_unloaded_and_loaded(plant, q, wrench, point)
    data, n = mujoco.MjData(plant.model), 6 * len(kr500.arm.links)
    for pose in range(3):
        data.qpos[plant.joint_indices], data.qpos[plant.theta_indices] = q[pose], rest.theta[pose]
        mujoco.mj_forward(plant.model, data)
        Q = -data.qfrc_bias
        where = data.xpos[plant.tool_body] + data.xmat[plant.tool_body].reshape(3, 3) @ point[pose]
        mujoco.mj_applyFT(plant.model, data, wrench[pose, :3], wrench[pose, 3:], where, plant.tool_body, Q)
        linear = (np.diag(own) + between) @ Q[plant.joint_spring_indices]
        turns = NonlinearJoints(own, *(law.values() or (0, 0, 0)), start_deflection=before.theta[pose, n:])
        np.testing.assert_allclose(
            rest.theta[pose, n:], joint_deflection(turns, linear / own), rtol=0, atol=1e-9
        )


def test_friction_that_slips_bit_by_bit_is_many_plays_side_by_side():
    """The mean over plays of half widths spread evenly from 0 to H; its slope is that of its turn."""
    H, before, h = np.array([2e-4, 1e-4, 5e-5, 4e-4]), np.array([0.0, 0.0, 2e-3, 8e-5]), 1e-3
    law = replace(LAW, start_deflection=before, hysteresis=0.0, max_slip_half_width=H)
    widths = (np.arange(20_000) + 0.5)[:, None] / 20_000 * H
    target = joint_deflection(replace(law, start_deflection=None), TORQUE)
    plays = np.clip(before, target - widths, target + widths)
    np.testing.assert_allclose(joint_deflection(law, TORQUE), plays.mean(axis=0), rtol=0, atol=1e-11)
    expected = (joint_deflection(law, TORQUE + h) - joint_deflection(law, TORQUE - h)) / (2 * h)
    np.testing.assert_allclose(joint_tangent_compliance(law, TORQUE), expected, rtol=1e-5)
    # some of its plays move
    assert (
        0
        < joint_tangent_compliance(law, TORQUE)[3]
        < joint_tangent_compliance(replace(law, start_deflection=None), TORQUE)[3]
    )
