"""The loaded tool put right: MuJoCo executes what the model commands."""

from dataclasses import replace

import numpy as np
import pytest
from loads import correct

import testbench as tb
from testbench.correct.compensated import compensate
from testbench.correct.newton import SMALL, Aim, Target, asked
from testbench.correct.rest import rest
from testbench.correct.uncertainty import Poses, half_widths
from testbench.errors import BenchError, NoEquilibrium
from testbench.identify.arm_model import About, bending, of_compliances, of_estimate
from testbench.identify.posterior import Posterior
from testbench.model.load import Load
from testbench.model.structure import all153
from testbench.model.vjm import chain, tool_pose
from testbench.model.weights import read_weights
from testbench.plant import collisions, settle

TIP = np.array([0.2, 0.0, 0.1])
POINTS = 60
AIM = Aim(point=tuple(TIP))
HUNG = Load(np.array([0, 0, -900.0, 0, 0, 0]), TIP)


@pytest.fixture(scope="module")
def state(kr500):
    return bending(kr500.vjm, kr500.arm.C_theta, read_weights(kr500.arm))


def drawn(kr500, rng):
    """Poses all over the limits, singular ones among them, and forces of 1 to 3 kN."""
    q = rng.uniform(*kr500.arm.limits, (POINTS, 6))
    force = rng.normal(size=(POINTS, 3))
    force *= rng.uniform(1e3, 3e3, (POINTS, 1)) / np.linalg.norm(force, axis=1, keepdims=True)
    return q, [Load(np.hstack([force, np.zeros((POINTS, 3))]), TIP), HUNG]


def regular(kr500, q):
    """Poses in which turns of the tool cost joints little while its tip stays."""
    J = chain(kr500.vjm, q).J_theta.transpose(2, 0, 1)[:, :, -6:].copy()
    R = tool_pose(kr500.vjm, q)[1]
    J[:, :3] += np.cross(J[:, 3:], (R @ TIP)[:, :, None], axisa=1, axisb=1, axisc=1)
    stay = np.linalg.svd(J[:, :3])[2][:, 3:].swapaxes(1, 2)
    return np.linalg.svd(J[:, 3:] @ stay)[1][:, -1] > 1.5 * SMALL


def test_an_arm_that_buckles_is_named(kr500, state):
    q = np.outer([0.2, 0.3], kr500.arm.limits[0])
    wrench = np.array([[0.0] * 6, [0, 0, -3e7, 0, 0, 0]])
    with pytest.raises(NoEquilibrium) as err:
        rest(state, q, [Load(wrench, kr500.vjm.load)])
    assert f"no static equilibrium at q = {kr500.arm.words(q[1])}" in str(err.value)


def test_a_load_of_another_number_of_poses_is_refused(kr500, state):
    with pytest.raises(BenchError, match="one for each of 2 poses"):
        rest(state, np.zeros((2, 6)), [Load(np.zeros((3, 6)), np.zeros(3))])


def tip(true):
    return true.tool + true.rotation @ TIP


def test_mujoco_has_the_corrected_tool_on_the_unloaded_one(kr500, state):
    """To less than 1e-8 m, so that the loop itself is exact; away from singular poses its turn is met too."""
    q, loads = drawn(kr500, np.random.default_rng(5))
    q[0, 4] = 0.0  # a stretched wrist: joints 4 and 6 on one line
    found = correct(state, q, loads, asked(state, q, "unloaded", TIP), AIM)
    assert found.solved.all()
    wrench, point = loads[0].wrench + loads[1].wrench, np.tile(TIP, (POINTS, 1))
    true = settle(kr500.plant, found.q, wrench, point)
    assert np.abs(tip(true) - tip(settle(kr500.plant, q))).max() < 1e-8
    assert np.linalg.norm(found.left, axis=1).max() < 1e-9
    assert found.balance.max() < 1e-9
    uncorrected = np.abs(tip(settle(kr500.plant, q, wrench, point)) - tip(settle(kr500.plant, q)))
    assert np.median(uncorrected) > 3e-4
    turned = np.linalg.norm(found.turned, axis=1)
    assert turned[regular(kr500, q)].max() < 1e-8
    assert 1e-6 < turned[0] < 5e-3
    assert np.abs(found.q - q).max() < 0.3  # at the stretched wrist a full turn would cost any motion


@pytest.mark.parametrize("hold", ["axis", "position"])
def test_what_is_free_makes_the_way_shorter(kr500, state, hold):
    q, loads = drawn(kr500, np.random.default_rng(7))
    target = asked(state, q, "unloaded", TIP)
    whole, freer = (
        correct(state, q, loads, target, AIM),
        correct(state, q, loads, target, replace(AIM, hold=hold)),
    )
    assert freer.solved.all()
    away = regular(kr500, q)
    assert (np.linalg.norm(freer.q - q, axis=1) <= np.linalg.norm(whole.q - q, axis=1) + 1e-9)[away].all()
    if hold == "axis":
        now, wanted = (rest(state, one, load).rotation[:, :, 0] for one, load in ((freer.q, loads), (q, ())))
        assert np.abs(np.cross(now, wanted))[away].max() < 1e-8


def test_out_of_reach_is_not_called_solved(kr500, state):
    q = np.array([[0.1, -1.2, 1.6, 0.2, 0.5, 0.0], [0.1, -1.2, 1.6, 0.2, 0.5, 0.0]])
    target = asked(state, q, "unloaded", TIP)
    far = Target(target.position + np.array([[0.0, 0, 0], [9.0, 0, 0]]), target.rotation)
    found = correct(state, q, [], far, AIM)
    assert found.solved.tolist() == [True, False]
    assert np.linalg.norm(found.left[1]) > 1


def test_an_absolute_model_is_put_where_the_drawing_has_the_tool(kr500, state):
    """Errors of geometry and own weight are put right too."""
    rng = np.random.default_rng(8)
    wrong = replace(state, theta_0=state.theta_0 + 5e-4 * rng.normal(size=state.theta_0.shape))
    q, loads = drawn(kr500, rng)
    target = asked(wrong, q, "drawn", TIP)
    found = correct(wrong, q, loads, target, AIM)
    met = rest(wrong, found.q, loads).at(TIP)
    position, R = tool_pose(kr500.vjm, q)
    assert found.solved.all()
    assert np.abs(met - position - R @ TIP).max() < 1e-9


@pytest.fixture(scope="module")
def known(kr500, state):
    """The arm, known without a doubt."""
    structure = all153(kr500.arm)
    pi = structure.entries(state.C_theta)
    sure = Posterior.normal(pi, np.zeros((1, len(pi))))
    return of_compliances(state, structure, sure, About("known"))


def test_a_joint_stops_at_its_limit_and_the_others_keep_the_tip(kr500, state, known):
    lower, _ = kr500.arm.limits
    q = np.tile([0.3, -1.2, 1.6, 0.3, 0.0, 0.1], (3, 1))
    q[:, 4] = lower[4] + np.array([0.0, 1e-5, 0.1])
    load = [Load(np.array([0, 0, 2e3, 0, 0, 0]), TIP)]
    found = compensate(known, q, load, AIM)
    assert found.held[:, 4].tolist() == [True, True, False]
    assert found.corrected.all()
    assert (found.q >= lower).all()
    met = rest(state, found.q, load).at(TIP) - rest(state, q).at(TIP)
    assert np.abs(met).max() < 1e-9
    assert (np.linalg.norm(found.turned, axis=1) > 1e-6).tolist() == [True, True, False]


def test_a_correction_into_the_floor_is_refused_and_the_point_stays(kr500, known):
    """An upward force is put right by going down, where the arm is a few micrometres above the floor."""
    q = np.array([[0.3, -0.8, 1.2, 0.3, 0.6, 0.1]])
    clear, touches = q[0, 1], 0.2
    for _ in range(20):
        q[0, 1] = (clear + touches) / 2
        clear, touches = (clear, q[0, 1]) if collisions(kr500.room, q)[0] else (q[0, 1], touches)
    q[0, 1] = clear
    up = [Load(np.array([0, 0, 3e3, 0, 0, 0]), TIP)]
    found = compensate(known, q, up, AIM, kr500.room)
    assert found.refused[0].why == "collision"
    assert np.array_equal(found.q, q)
    assert np.array_equal(found.after, found.before)
    q[0, 1] = touches  # what touches before may touch after: nothing new is in the way
    assert compensate(known, q, up, AIM, kr500.room).corrected.all()
    assert compensate(known, q, [Load(-up[0].wrench, TIP)], AIM, kr500.room).corrected.all()


def test_half_widths_are_those_of_the_estimate(kr500):
    """Rows of the bent arm in place of those of the unbent one change them by a few per cent at most."""
    campaign = tb.simulate(kr500, seed=11)
    method = tb.with_prior(tb.gco, tb.cad_prior(kr500.arm))
    estimate = method(kr500.vjm, tb.MODELS["ALL153"](kr500).structure, campaign.identification)
    model = of_estimate(kr500.vjm, estimate, read_weights(kr500.arm))
    q = campaign.truth.q[:40]
    load = [Load(campaign.truth.wrench[:40], campaign.truth.point[:40])]
    half = half_widths(model, Poses(q, load), Poses(q), kr500.vjm.markers)
    own = tb.intervals(kr500.vjm, estimate, campaign.truth)
    assert np.allclose(half, ((own.upper - own.lower) / 2)[:40], rtol=0.1)  # linear at the unbent arm
    with pytest.raises(BenchError, match="expected an absolute model"):
        half_widths(model, Poses(q, load), None, kr500.vjm.markers)
