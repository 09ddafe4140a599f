"""The UR10 as an arm: kinematics as published, joints as its controller commands them."""

import numpy as np
import pytest

from testbench.bench.campaign import build_cell
from testbench.model.vjm import rotation, tool_pose

DH = [(0.1273, 0, 90), (0, -0.612, 0), (0, -0.5723, 0), (0.163941, 0, 90), (0.1157, 0, -90), (0.0922, 0, 0)]
"""d [m], a [m] and alpha [deg] of every joint, as published by Universal Robots."""


@pytest.fixture(scope="module")
def ur10():
    return build_cell("ur10")


def flange(q):
    """Pose of the flange by Denavit and Hartenberg, (4, 4)."""
    T = np.eye(4)
    for angle, (d, a, alpha) in zip(q, DH, strict=True):
        turned, step = np.eye(4), np.eye(4)
        turned[:3, :3] = rotation(np.array([0.0, 0.0, 1.0]), angle)
        step[:3, :3] = rotation(np.array([1.0, 0.0, 0.0]), np.deg2rad(alpha))
        step[:3, 3] = a, 0, d
        T = T @ turned @ step
    return T


def test_the_flange_is_where_the_published_denavit_hartenberg_parameters_place_it(ur10, rng):
    q = rng.uniform(*ur10.arm.limits, (50, 6))
    position, orientation = tool_pose(ur10.vjm, q)
    expected = np.array([flange(row) for row in q])
    np.testing.assert_allclose(position, expected[:, :3, 3], rtol=0, atol=1e-14)
    np.testing.assert_allclose(orientation, expected[:, :3, :3], rtol=0, atol=1e-13)
