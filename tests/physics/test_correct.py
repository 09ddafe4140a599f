"""The loaded tool, foretold and put right: MuJoCo's arm, limits of first order, what was not seen."""

from dataclasses import replace

import numpy as np
import pytest
from loads import correct
from unsure import AIM, FORCE, RIGID, TIP, Q, normal, state_of, unsure, unsure_everywhere

from testbench import Load, compensate, predict
from testbench.arm.mjcf import GRAVITY
from testbench.correct.newton import MIN_SINGULAR_VALUE, Aim, Target, equilibrium, programmed_target
from testbench.correct.predicted import (
    LoadedPoses,
    compliance_half_widths,
    largest_uncertainty,
    load_extent,
    motion_half_widths,
    motion_jacobian,
    relative_half_widths,
    stiffness,
)
from testbench.errors import BenchError, NoEquilibrium
from testbench.identify.absolute.align import Noise
from testbench.identify.posterior import (
    SECOND_ORDER_FACTOR,
    ModelOrigin,
    Posterior,
    elastic_state,
    model_of_compliances,
)
from testbench.model.load import massless_bodies, read_body_masses, resultant_wrench
from testbench.model.structure import all153
from testbench.model.vjm import evaluate_chain, tool_poses
from testbench.plant.equilibrium import solve_equilibrium
from testbench.plant.rigid_cell import find_collisions
from testbench.workflows.program import extrapolation_warnings

POSES = 60  #: Drawn all over the limits.
HUNG = Load(np.array([0, 0, -900.0, 0, 0, 0]), TIP)


@pytest.fixture(scope="module")
def state(kr500):
    return elastic_state(kr500.vjm, kr500.arm.C_theta, read_body_masses(kr500.arm))


def drawn(kr500, rng):
    """Poses all over the limits, singular ones among them, and forces of 1 to 3 kN."""
    q = rng.uniform(*kr500.arm.limits, (POSES, 6))
    force = rng.normal(size=(POSES, 3))
    force *= rng.uniform(1e3, 3e3, (POSES, 1)) / np.linalg.norm(force, axis=1, keepdims=True)
    return q, [Load(np.hstack([force, np.zeros((POSES, 3))]), TIP), HUNG]


def regular(kr500, q):
    """Poses in which turns of the tool cost joints little while its tip stays."""
    J = evaluate_chain(kr500.vjm, q).J_theta.transpose(2, 0, 1)[:, :, -6:].copy()
    R = tool_poses(kr500.vjm, q)[1]
    J[:, :3] += np.cross(J[:, 3:], (R @ TIP)[:, :, None], axisa=1, axisb=1, axisc=1)
    stay = np.linalg.svd(J[:, :3])[2][:, 3:].swapaxes(1, 2)
    return np.linalg.svd(J[:, 3:] @ stay)[1][:, -1] > 1.5 * MIN_SINGULAR_VALUE


def tip(true):
    return true.tool_positions + true.tool_rotations @ TIP


def test_mujoco_has_the_corrected_tool_on_the_unloaded_one(kr500, state):
    """To less than 1e-8 m, so that the loop itself is exact; away from singular poses its turn is met too."""
    q, loads = drawn(kr500, np.random.default_rng(5))
    q[0, 4] = 0.0  # a stretched wrist: joints 4 and 6 on one line
    found = correct(state, q, loads, programmed_target(state, q, "unloaded", TIP), AIM)
    assert found.solved.all()
    wrench, point = loads[0].wrench + loads[1].wrench, np.tile(TIP, (POSES, 1))
    true = solve_equilibrium(kr500.plant, found.q, wrench, point)
    assert np.abs(tip(true) - tip(solve_equilibrium(kr500.plant, q))).max() < 1e-8
    assert np.linalg.norm(found.position_error, axis=1).max() < 1e-9
    assert found.equilibrium_residual.max() < 1e-9
    uncorrected = np.abs(
        tip(solve_equilibrium(kr500.plant, q, wrench, point)) - tip(solve_equilibrium(kr500.plant, q))
    )
    assert np.median(uncorrected) > 3e-4
    turned = np.linalg.norm(found.rotation_error, axis=1)
    assert turned[regular(kr500, q)].max() < 1e-8
    assert 1e-6 < turned[0] < 5e-3
    assert np.abs(found.q - q).max() < 0.3  # at the stretched wrist a full turn would cost any motion


@pytest.mark.parametrize("hold", ["axis", "position"])
def test_what_is_free_makes_the_way_shorter(kr500, state, hold):
    q, loads = drawn(kr500, np.random.default_rng(7))
    target = programmed_target(state, q, "unloaded", TIP)
    whole, freer = (correct(state, q, loads, target, aim) for aim in (AIM, replace(AIM, corrected_part=hold)))
    assert freer.solved.all()
    away = regular(kr500, q)
    assert (np.linalg.norm(freer.q - q, axis=1) <= np.linalg.norm(whole.q - q, axis=1) + 1e-9)[away].all()
    if hold == "axis":
        now, wanted = (
            equilibrium(state, one, load).rotation[:, :, 0] for one, load in ((freer.q, loads), (q, ()))
        )
        assert np.abs(np.cross(now, wanted))[away].max() < 1e-8


def test_out_of_reach_is_not_called_solved(kr500, state):
    q = np.tile([0.1, -1.2, 1.6, 0.2, 0.5, 0.0], (2, 1))
    target = programmed_target(state, q, "unloaded", TIP)
    far = Target(target.position + np.array([[0.0, 0, 0], [9.0, 0, 0]]), target.rotation)
    found = correct(state, q, [], far, AIM)
    assert found.solved.tolist() == [True, False]
    assert np.linalg.norm(found.position_error[1]) > 1


@pytest.fixture(scope="module")
def sure(kr500, state):
    """The arm, known without a doubt."""
    pi = all153(kr500.arm).parameters_of(state.C_theta)
    return model_of_compliances(
        state, all153(kr500.arm), normal(pi, np.zeros((1, 153))), ModelOrigin("known")
    )


def test_a_joint_stops_at_its_limit_and_the_others_keep_the_tip(kr500, state, sure):
    lower, _ = kr500.arm.limits
    q = np.tile([0.3, -1.2, 1.6, 0.3, 0.0, 0.1], (3, 1))
    q[:, 4] = lower[4] + np.array([0.0, 1e-5, 0.1])
    load = [Load(np.array([0, 0, 2e3, 0, 0, 0]), TIP)]
    found = compensate(sure, q, load, AIM)
    assert found.at_limit[:, 4].tolist() == [True, True, False]
    assert found.corrected.all()
    assert (found.q >= lower).all()
    met = equilibrium(state, found.q, load).position_of(TIP) - equilibrium(state, q).position_of(TIP)
    assert np.abs(met).max() < 1e-9
    assert (np.linalg.norm(found.rotation_error, axis=1) > 1e-6).tolist() == [True, True, False]


def test_a_correction_into_the_floor_is_refused_and_the_point_stays(kr500, sure):
    """An upward force is put right by going down, where the arm is a few micrometres above the floor."""
    q = np.array([[0.3, -0.8, 1.2, 0.3, 0.6, 0.1]])
    clear, touches = q[0, 1], 0.2
    for _ in range(20):
        q[0, 1] = (clear + touches) / 2
        clear, touches = (clear, q[0, 1]) if find_collisions(kr500.room, q)[0] else (q[0, 1], touches)
    q[0, 1] = clear
    up = [Load(np.array([0, 0, 3e3, 0, 0, 0]), TIP)]
    found = compensate(sure, q, up, AIM, kr500.room)
    assert found.refusals[0].reason == "collision"
    assert np.array_equal(found.q, q)
    assert np.array_equal(found.error_after, found.error_before)
    q[0, 1] = touches  # what touches before may touch after: nothing new is in the way
    assert compensate(sure, q, up, AIM, kr500.room).corrected.all()
    assert compensate(sure, q, [Load(-up[0].wrench, TIP)], AIM, kr500.room).corrected.all()


FEW = 12


def sure_of(structure, state, unseen=None):
    """A belief of 1 % in every entry, and rows that nothing has seen."""
    pi = structure.parameters_of(state.C_theta)
    rows = np.zeros((0, structure.n_parameters)) if unseen is None else unseen
    return Posterior(pi, np.diag(0.01 * np.abs(pi)), rows, np.abs(pi) + 1e-30)


@pytest.fixture(scope="module")
def model(kr500, state):
    """The true compliances, as a model."""
    structure = all153(kr500.arm)
    return model_of_compliances(
        state, structure, sure_of(structure, state), ModelOrigin("truth", largest_force=2000.0)
    )


@pytest.fixture(scope="module")
def poses(kr500):
    return np.random.default_rng(11).uniform(*(0.6 * kr500.arm.limits), (FEW, 6))


@pytest.fixture(scope="module")
def load():
    rng = np.random.default_rng(12)
    wrench = rng.normal(size=(FEW, 6)) * [2e3, 2e3, 2e3, 1e2, 1e2, 1e2]
    return Load(wrench, 0.2 * rng.normal(size=(FEW, 3)))


def weightless(model):
    return replace(model, state=replace(model.state, body_masses=massless_bodies(model.arm)))


def test_deflections_are_those_of_the_true_arm(kr500, model, poses, load):
    """Markers and tool, loaded minus unloaded, own weight in both."""
    found = predict(model, poses, [load])
    true = [solve_equilibrium(kr500.plant, poses, w, load.point) for w in (0 * load.wrench, load.wrench)]
    before, after = (
        np.concatenate([one.tool_positions[:, None], one.marker_positions], axis=1) for one in true
    )
    assert np.abs(found.deflection - (after - before)).max() < 1e-9
    assert np.abs(found.position[:, 0] - true[1].tool_positions).max() < 1e-9
    assert np.abs(found.rotation - true[1].tool_rotations).max() < 1e-9


def test_the_linear_prediction_is_the_limit_of_small_loads(model, poses, load):
    """Of a weightless arm: what is left out falls with the square of the load."""
    light, off = weightless(model), []
    for share in (0.1, 0.01):
        small = [Load(share * load.wrench, load.point)]
        bent, linear = (predict(light, poses, small, linear=on) for on in (False, True))
        off.append(
            [np.abs(getattr(bent, x) - getattr(linear, x)).max() for x in ("deflection", "rotation_vector")]
        )
        assert (linear.half_width >= bent.half_width).all()
    np.testing.assert_allclose(np.divide(*off), 100, rtol=0.05)


def test_the_ellipsoid_is_the_tangent_of_the_equilibrium_as_sure_as_under_its_forces(model, poses, load):
    """A newton more along every principal axis; without own weight, whose K_w is left out."""
    hung = Load(np.array([0, 0, -460.3 * GRAVITY, 0, 0, 0]), model.vjm.load_point)
    for own, most in ((weightless(model), 1e-6), (model, 0.01)):
        found = stiffness(own, poses, [hung])
        C = found.compliance[:, :3, :3]
        for k in range(3):
            axis = found.principal_axes[:, :, k]
            push = Load(np.hstack([axis, 0 * axis]), np.zeros(3))
            pull = replace(push, wrench=-push.wrench)
            more, less = (equilibrium(own.state, poses, [hung, one]).position for one in (push, pull))
            moved = (more - less) / 2
            assert np.abs(moved - np.matvec(C, axis)).max() < most * found.displacement_per_force.max()
            assert (
                np.abs(moved - found.displacement_per_force[:, k, None] * axis).max()
                < most * found.displacement_per_force.max()
            )
    assert (np.diff(found.principal_stiffness, axis=1) >= 0).all()
    tool = stiffness(model, poses[:2])
    halves = compliance_half_widths(model, poses[:2], tool, 700.0)
    for k, q in enumerate(poses[:2, None]):
        for axis, half in zip(tool.principal_axes[k].T, halves[k], strict=True):
            pushed = LoadedPoses(q, [Load(np.r_[700 * axis, 0, 0, 0], np.zeros(3))])
            assert half == pytest.approx(
                motion_half_widths(model, pushed, LoadedPoses(q), np.zeros((1, 3))).max()
            )


def test_what_nothing_has_seen_is_infinite_and_nothing_else(kr500, model, poses):
    """The first joint was not seen: a load along its axis, at a bent arm too, needs it not."""
    structure = model.structure
    first = np.eye(structure.n_parameters)[[structure.parameters_of(np.diag(np.arange(48) == 42)).argmax()]]
    blind = replace(model, posterior=sure_of(structure, model.state, first))
    forces = np.array([0, 0, -4500.0, 0, 0, 0]), np.array([0, 4500.0, 0, 0, 0, 0])
    down, aside = (predict(blind, poses, [Load(force, model.vjm.load_point)]) for force in forces)
    assert np.isinf(aside.half_width[:, :, :2]).any(axis=2).all()
    assert np.isfinite(down.half_width).all()
    assert (
        down.largest_half_width > 0.002 * down.deflection_length
    ).all()  # every entry is sure to 1 %, curvature is of that size
    assert (down.largest_half_width < 0.05 * down.deflection_length).all()


def test_scatter_counts_in_positions_and_what_a_linear_model_leaves_out_once_or_twice(model, poses, load):
    """Scatter cancels in a deflection. Of known compliances nothing else is open; a fit put it elsewhere."""
    assert np.isinf(predict(model, poses, [load]).position_half_width).all()
    calm, rough = (predict(replace(model, noise=Noise(scatter)), poses, [load]) for scatter in (0.0, 3e-4))
    more = rough.position_half_width**2 - calm.position_half_width**2
    np.testing.assert_allclose(more, (1.96 * 3e-4) ** 2, rtol=1e-3)
    assert np.array_equal(rough.half_width, calm.half_width)
    known = replace(
        model, posterior=replace(model.posterior, covariance_root=np.zeros((1, len(model.posterior.mean))))
    )
    straight, bent = (predict(known, poses, [load], linear=linear) for linear in (True, False))
    left_out = np.abs(straight.deflection - bent.deflection)
    for found, times in ((bent, 1), (straight, SECOND_ORDER_FACTOR)):
        np.testing.assert_allclose(found.half_width, times * left_out, rtol=0.05, atol=5e-3 * left_out.max())


POINTS = 8


@pytest.fixture(scope="module")
def known(kr500):
    return unsure(kr500)


@pytest.fixture(scope="module")
def absolute(kr500):
    return unsure_everywhere(kr500)


@pytest.mark.parametrize(
    "column", [3, 12, 29, 30, 32, 33, *range(36, 54, 4), *range(37, 54, 4), 54, 60, 130, 204, 206]
)
def test_rows_are_how_positions_move_with_what_is_unsure(absolute, column):
    """Of geometry, joint errors and compliances: differences of the bent arm's tip, but for second order."""
    q = Q[None]
    row = motion_jacobian(absolute, LoadedPoses(q, [FORCE]), None, TIP[None])[0, 0, :, column]
    x, tips = absolute.unknowns.values(absolute.state), []
    step = 1e-5 if column < RIGID else 1e-3 * max(abs(x[column]), 1e-7)
    for sign in (1, -1):
        moved = x.copy()
        moved[column] += sign * step
        tips.append(equilibrium(state_of(absolute, moved), q, [FORCE]).position_of(TIP)[0])
    slope = (tips[0] - tips[1]) / (2 * step)
    assert np.abs(slope - row).max() < 0.03 * np.abs(slope).max() + 1e-6


def test_what_points_share_goes_with_a_frame_that_is_fitted_to_them(absolute):
    q = Q + np.random.default_rng(6).uniform(-0.1, 0.1, (POINTS, 6))
    q[:, 0] = 0.3
    stand = LoadedPoses(q, [FORCE])
    whole = motion_half_widths(absolute, stand, None, TIP[None])[:, 0]
    left = relative_half_widths(absolute, stand, TIP)
    assert np.median(left) < 0.6 * np.median(whole)
    base = np.zeros((1, len(absolute.posterior.covariance_root[0])))
    base[0, 3:6] = 1e-3  # a turn of link 1's end, joint 1 at rest: all go round as one
    turned = replace(absolute, posterior=normal(absolute.posterior.mean, base))
    assert relative_half_widths(turned, stand, TIP).max() < 1e-6
    assert motion_half_widths(turned, stand, None, TIP[None]).max() > 1e-3
    noisy = relative_half_widths(replace(absolute, noise=Noise(3e-4)), stand, TIP)
    np.testing.assert_allclose(noisy, np.hypot(left, 1.96 * 3e-4), rtol=1e-4)


def test_before_and_after_are_foretold_minus_asked_and_zero_where_nothing_acts(kr500, known):
    q, wrench = np.array([Q, Q]), np.array([np.zeros(6), FORCE.wrench])
    found = compensate(known, q, [Load(wrench, np.array([TIP, TIP]))], AIM)
    assert np.array_equal(found.q[0], q[0])
    assert not np.array_equal(found.q[1], q[1])
    half = motion_half_widths(known, LoadedPoses(found.q, [Load(wrench, TIP)]), LoadedPoses(q), TIP[None])[
        :, 0
    ]
    np.testing.assert_allclose(found.error_half_width, half, rtol=1e-9)  # of the joints that are commanded
    rests = solve_equilibrium(kr500.plant, q, wrench, np.array([TIP, TIP])), solve_equilibrium(kr500.plant, q)
    np.testing.assert_allclose(found.error_before, tip(rests[0]) - tip(rests[1]), atol=1e-8)
    again = correct(known.state, q, [], programmed_target(known.state, q, "drawn", TIP), AIM)
    sagged = compensate(known, q, [], replace(AIM, joint_meaning="drawn"))
    assert sagged.error_before[0, 2] < -1e-3  # own weight
    assert np.array_equal(sagged.q, again.q)
    assert (sagged.error_half_width[0] > 1e-5).any()  # compliances are unsure by a tenth


def test_the_part_that_is_named_is_the_one_whose_knowledge_helps(kr500, known):
    """Two joints whose errors cancel leave nothing open between them, however unsure each is by itself."""
    q = Q + np.random.default_rng(7).uniform(-0.2, 0.2, (POINTS, 6))
    pi, columns = known.posterior.mean, len(known.posterior.mean)
    joint = {name: columns - 6 + k for k, name in enumerate(j.name for j in kr500.arm.joints)}
    root = np.zeros((1, columns))
    root[0, joint["joint_2"]] = 1e-7
    open_ = largest_uncertainty(
        replace(known, posterior=normal(pi, root)), q, [FORCE], TIP, of_positions=False
    )
    assert (open_.name, open_.is_joint) == ("joint_2", True)
    assert open_.variance_share == pytest.approx(1)
    unseen = np.zeros((1, columns))
    unseen[0, joint["joint_1"]] = 1
    blind = replace(known, posterior=normal(pi, root, unseen))
    assert largest_uncertainty(blind, q, [FORCE], TIP, of_positions=False).name == "joint_1"
    both = np.zeros((2, columns))
    both[0, joint["joint_2"]] = both[1, joint["joint_3"]] = 1e-7
    alike = largest_uncertainty(
        replace(known, posterior=normal(pi, both)), q, [FORCE], TIP, of_positions=False
    )
    assert alike is None or alike.name in ("joint_2", "joint_3")


TURNING = Load(np.array([100.0, 0, 0, 0, 50.0, 0]), np.zeros(3))


@pytest.mark.parametrize(
    ("origin", "load", "said"),
    [
        ({"largest_force": np.linalg.norm(FORCE.wrench[:3]) / 2, "largest_moment": 1e9}, FORCE,
         "is 2.0 times the largest one"),
        ({"largest_force": 0.0, "largest_moment": 0.0}, FORCE, "under own weight only"),
        ({"largest_force": 200.0, "largest_moment": 10.0}, TURNING,  # each with its own largest
         "a moment of 50 N m is 5.0 times the largest one"),
        ({}, FORCE, None),
        ({}, "twice the payload", "2.0 times the payload"),
    ],
)  # fmt: skip
def test_loads_beyond_those_of_the_identification_and_the_payload_are_said(known, origin, load, said):
    if load == "twice the payload":
        load = Load(np.array([0, 0, -2 * 9.81 * known.arm.payload, 0, 0, 0]), TIP)
    own = replace(known, origin=ModelOrigin("made up", **origin))
    words = extrapolation_warnings(load_extent(own, Q[None], [load]))
    assert len(words) == (said is not None)
    assert said is None or said in words[0]


def test_a_force_that_is_held_has_no_moment_about_the_tools_origin(known):
    lever = np.cross(tool_poses(known.vjm, Q[None])[1][0] @ TIP, FORCE.wrench[:3])
    held = Load(np.concatenate([FORCE.wrench[:3], -lever]), TIP)
    assert load_extent(known, Q[None], [held]).moment < 1e-9


def test_the_resultant_of_loads_is_the_sum_of_their_forces_moments_and_levers(kr500, rng):
    """By hand, about the tool's origin, a load a pose and one for all."""
    R = tool_poses(kr500.vjm, np.array([Q, -Q]))[1]
    each = Load(rng.normal(size=(2, 6)), rng.normal(size=(2, 3)))
    same = Load(rng.normal(size=6), rng.normal(size=3))
    expected = [
        sum(
            np.r_[w[:3], w[3:] + np.cross(R[k] @ p, w[:3])]
            for w, p in ((each.wrench[k], each.point[k]), (same.wrench, same.point))
        )
        for k in range(2)
    ]
    np.testing.assert_allclose(resultant_wrench(R, [each, same]), expected, rtol=0, atol=1e-12)


#: Near a stretched elbow and wrist: how a path was once torn between two ways to take a point.
TORN = [0.679164, -1.850984, 0.144721, 0.827372, 0.01697, -0.264587]
TO = [0.679618, -1.851264, 0.144247, 0.827643, 0.016682, -0.264803]


@pytest.mark.parametrize(
    ("shares", "name"),
    [((0.6, 0.49), "a"), ((0.6, 0.51), None), ((0.49, 0.1), None), ((0.3, 0.55), "b")],
    ids=["half of all and a fifth more", "two alike", "less than half", "the second"],
)
def test_the_part_that_is_named_leaves_clearly_more_open_than_the_next(known, monkeypatch, shares, name):
    told = {"a": shares[0], "b": shares[1], "c": 0.0}
    monkeypatch.setattr("testbench.correct.predicted._variance_shares", lambda *_: told)
    found = largest_uncertainty(known, Q[None], [FORCE], TIP, of_positions=False)
    assert (found and found.name) == name
    assert found is None or (found.variance_share, found.is_joint) == (told[name], False)


@pytest.mark.parametrize("hold", ["pose", "axis", "position"])
def test_points_that_are_close_have_corrections_that_are_close(known, hold):
    q = np.linspace(TORN, TO, 60)
    load = [Load(np.array([2434.54, 1322.173, 1151.032, 0, 0, 0]), np.array([0.3, 0.1, 0.1]))]
    aim = Aim(hold, tool_point=(0.3, 0.1, 0.1))
    found = correct(
        known.state, q, load, programmed_target(known.state, q, "unloaded", np.array(aim.tool_point)), aim
    )
    assert found.solved.all()
    assert np.abs(np.diff(found.q - q, axis=0)).max() < 1e-3


def test_an_aim_that_is_none_no_points_what_a_model_does_not_know_and_buckling_are_refused(
    known, kr500, state
):
    for one in (
        {"corrected_part": "positon"},
        {"joint_meaning": "taught"},
        {"spindle_axis": (2.0, 0, 0)},
        {"tool_point": (300.0, 0, 0)},
    ):
        with pytest.raises(BenchError, match="aim"):
            Aim(**one)
    with pytest.raises(BenchError, match="at least one point"):
        compensate(known, np.zeros((0, 6)), [])
    with pytest.raises(BenchError, match="one for each of 2 poses"):
        equilibrium(known.state, np.zeros((2, 6)), [Load(np.zeros((3, 6)), np.zeros(3))])
    with pytest.raises(BenchError, match="need a model of absolute readings"):
        motion_half_widths(known, LoadedPoses(Q[None], [FORCE]), None, TIP[None])
    q = np.outer([0.2, 0.3], kr500.arm.limits[0])
    wrench = np.array([[0.0] * 6, [0, 0, -3e7, 0, 0, 0]])
    with pytest.raises(NoEquilibrium) as err:
        equilibrium(state, q, [Load(wrench, kr500.vjm.load_point)])
    assert f"no static equilibrium at q = {kr500.arm.pose_text(q[1])}" in str(err.value)
