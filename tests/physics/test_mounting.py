"""Absolute readings of arms that hang, stand on a wall or are tilted, by a folder that is upright."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from serial_arms import write_arm

from testbench.identify.absolute.fit import CalibrationOptions, calibrate
from testbench.identify.diagnosis.gravity import (
    DOWN,
    angle_between,
    mounting_by_own_weight,
    rotation_from_down,
    with_base_rotated,
)
from testbench.identify.diagnosis.hypotheses import describe
from testbench.identify.prior import cad_prior
from testbench.workflows.absolute_campaign import AbsoluteCampaign, simulate_series
from testbench.workflows.cell import build_cell

ONLY = CalibrationOptions(used_errors=frozenset({"joint springs"}), max_order=5)
TURNS = {"hangs": (180, 0, 0), "stands on a wall": (0, 90, 0), "is tilted": (12, 16, 0)}
"""Rotation vectors of the base [deg]."""


@pytest.fixture(scope="module")
def upright(tmp_path_factory):
    return build_cell(str(write_arm(tmp_path_factory.mktemp("upright") / "arm", "zyyxyx")))


def turned(turn, folder):
    """The same arm by a folder that says how it stands."""
    quat = " ".join(map(str, Rotation.from_rotvec(turn, degrees=True).as_quat(scalar_first=True)))
    poses = {"link_0": f'quat="{quat}"'}
    return build_cell(str(write_arm(folder / "arm", "zyyxyx", pose=lambda name: poses.get(name, ""))))


@pytest.mark.parametrize(
    "how", [pytest.param(how, marks=[pytest.mark.study] * (how != "hangs")) for how in TURNS]
)
def test_own_weight_tells_how_the_base_stands(upright, tmp_path, how):
    """With the direction of gravity, and the orientation that makes the folder right."""
    cell = turned(TURNS[how], tmp_path)
    series, _ = simulate_series(cell, AbsoluteCampaign(poses=40, targets=3), 1)
    prior = cad_prior(upright.arm)
    calibration = calibrate(upright.vjm, series, prior, ONLY)
    found = mounting_by_own_weight(calibration.state, calibration.series, prior)
    true = cell.vjm.base_pose[:3, :3].T @ DOWN
    assert how in describe(found, upright.arm).sentence
    assert (
        np.degrees(angle_between(found.size[:3], true)) < 2
    )  # a level tracker is off by half a degree, the fit too
    stands = Rotation.from_quat(found.size[3:], scalar_first=True).as_matrix()
    np.testing.assert_allclose(stands @ found.size[:3], DOWN, atol=1e-12)
    calibration = calibrate(cell.vjm, series, prior, ONLY)
    assert mounting_by_own_weight(calibration.state, calibration.series, prior) is None


def test_weights_along_g_are_those_of_an_arm_whose_base_is_turned(upright):
    """Also where g is along +z, and from a base that does not stand in the world itself."""
    for g in (np.array([0.0, 0, 1]), np.array([0.6, 0, -0.8]), np.array([0.0, -1, 0])):
        np.testing.assert_allclose(rotation_from_down(g) @ DOWN, g, atol=1e-12)
        np.testing.assert_allclose(with_base_rotated(upright.vjm, g).base_pose[:3, :3] @ g, DOWN, atol=1e-12)
