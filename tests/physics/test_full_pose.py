"""Campaigns of section 5: loads, readings, check runs, and what both methods make of them."""

import numpy as np
import pytest
from loads import rotation_observation
from scipy.spatial.transform import Rotation

from testbench.campaign.campaign import Scenario
from testbench.campaign.campaign import simulate as calibrate
from testbench.campaign.evaluation import identify
from testbench.campaign.models import named_models
from testbench.campaign.pose_campaign import FullPose, random_wrenches, simulate
from testbench.errors import PoseError
from testbench.identify.evaluate import deflections
from testbench.model.structure import all153
from testbench.model.vjm import chain, observation

PAPER = {"arm": "arm_6r", "least": 9e-3, "most": 41e-3}


def clock():
    return 0.0


def test_campaign_is_that_of_section_5_2(arm_6r):
    campaign = simulate(arm_6r, FullPose(**PAPER), 1)
    data = campaign.identification
    assert (data.runs, len(np.unique(data.pose)), campaign.check.runs) == (108, 18, 120)
    for pose in np.unique(data.pose):
        runs = data.pose == pose
        np.testing.assert_array_equal(data.wrench[runs], 1000 * np.eye(6))
        assert len(np.unique(data.q[runs], axis=0)) == 1
    size = np.linalg.norm(campaign.truth.deflection, axis=-1)
    assert 9e-3 <= size.min() < size.max() <= 41e-3
    assert len(np.unique(campaign.check.q, axis=0)) == 120
    assert campaign.drawn >= 120


def test_noise_of_a_deflection_is_root_two_of_a_readings(arm_6r):
    scenario = FullPose(**PAPER, check_runs=1000, sigma=40e-6, sigma_rotation=300e-6)
    campaign = simulate(arm_6r, scenario, 3)
    error = campaign.check.deflection - campaign.truth.deflection
    turn = (
        Rotation.from_rotvec(campaign.truth.rotation).inv() * Rotation.from_rotvec(campaign.check.rotation)
    ).as_rotvec()
    # 3000 components: the standard error of their RMS is 1.3 %
    assert np.sqrt(np.mean(error**2)) == pytest.approx(np.sqrt(2) * 40e-6, rel=0.05)
    assert np.sqrt(np.mean(turn**2)) == pytest.approx(np.sqrt(2) * 300e-6, rel=0.05)


def test_true_check_deflections_are_those_of_the_same_runs_without_noise(kr500, arm_6r):
    """Of section 6 and of 5.2; the noise hides nothing but itself in the error against readings."""
    for cell, made, scenario in (
        (kr500, calibrate, Scenario(arm="kr500_l480", workspace_poses=1)),
        (arm_6r, simulate, FullPose(**PAPER)),
    ):
        noisy, calm = (made(cell, scenario.model_copy(update={"noise": n}), 3) for n in (True, False))
        np.testing.assert_array_equal(noisy.check_true.deflection, calm.check.deflection)
        np.testing.assert_array_equal(noisy.check_true.q, noisy.check.q)
        assert np.abs(noisy.check.deflection - noisy.check_true.deflection).max() > scenario.sigma
        [result] = identify(cell, noisy, named_models(cell, ["MGCO56"]), clock)
        error = deflections(cell.vjm, result.estimate, noisy.check) - noisy.check_true.deflection
        rms = np.sqrt((error**2).sum(axis=-1).mean())
        assert result.check_true.rms == pytest.approx(rms, rel=1e-9) != pytest.approx(result.check.rms)


def test_noise_free_linear_runs_are_what_the_model_of_the_truth_predicts(arm_6r):
    """MuJoCo's first order against Pinocchio's Eq. (12), positions and rotations."""
    data = simulate(arm_6r, FullPose(**PAPER, noise=False), 4).identification
    s = all153(arm_6r.arm)
    C = s.entries(arm_6r.arm.C_theta)
    args = (chain(arm_6r.vjm, data.q), s, data.wrench, data.point)
    moved = observation(*args, arm_6r.vjm.markers) @ C
    turned = (rotation_observation(*args) @ C)[:, 0]
    np.testing.assert_allclose(data.deflection, moved, rtol=0, atol=1e-12)
    np.testing.assert_allclose(data.rotation, turned, rtol=0, atol=1e-12)


def test_random_wrenches_have_their_magnitudes_in_all_directions(rng):
    wrench = random_wrenches(2000, 100.0, 7.0, rng)
    np.testing.assert_allclose(np.linalg.norm(wrench[:, :3], axis=1), 100, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(wrench[:, 3:], axis=1), 7, rtol=1e-12)
    # mean direction of 2000 unit vectors: 1/sqrt(3 * 2000) an axis, five of them
    assert np.abs(wrench[:, :3].mean(axis=0)).max() < 5 * 100 / np.sqrt(6000)


def test_deflections_out_of_reach_say_how_many_were_drawn(arm_6r):
    with pytest.raises(
        PoseError, match=r"found 0 of 120 check runs with a deflection of 900 to 1000 mm among"
    ):
        simulate(arm_6r, FullPose(arm="arm_6r", least=0.9), 1)
