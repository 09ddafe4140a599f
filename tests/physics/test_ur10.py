"""The UR10 as an arm: kinematics as published, joints as its controller commands them."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from testbench.campaign.campaign import build_cell
from testbench.data.read_series import read_series
from testbench.model.vjm import rotation, tool_pose

DH = [(0.1273, 0, 90), (0, -0.612, 0), (0, -0.5723, 0), (0.163941, 0, 90), (0.1157, 0, -90), (0.0922, 0, 0)]
"""d [m], a [m] and alpha [deg] of every joint, as published by Universal Robots."""


READINGS = Path(__file__).parents[2] / "models" / "ur10" / "readings"


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


@pytest.fixture(scope="module", params=[("series_A_every_8th", 1489), ("series_C", 2773)], ids=["A", "C"])
def readings(request, ur10):
    name, rows = request.param
    [series] = read_series(READINGS / f"{name}.csv", ur10.arm).series
    assert series.rows == rows
    return series


def left(x, position, orientation, read):
    """What a frame, (6,), and a place in the tool, (3,), leave of readings, (rows, 3) [m]."""
    return read - Rotation.from_rotvec(x[:3]).apply(position + orientation @ x[6:]) - x[3:6]


def test_frame_and_target_alone_explain_what_a_tracker_read_to_a_millimetre(ur10, readings):
    """A joint's sign, zero or place in the order, or a length, would leave centimetres."""
    some = slice(None, None, 20)
    position, orientation = tool_pose(ur10.vjm, readings.q)
    read, at = readings.position[:, 0], orientation @ ur10.vjm.markers[0] + position
    turn, _ = Rotation.align_vectors(read - read.mean(axis=0), at - at.mean(axis=0))
    start = [*turn.as_rotvec(), *(read - turn.apply(at)).mean(axis=0), *ur10.vjm.markers[0]]
    few = position[some], orientation[some], read[some]
    found = least_squares(lambda x: left(x, *few).ravel(), start, x_scale="jac").x
    error = np.linalg.norm(left(found, position, orientation, read), axis=1)
    assert error.mean() < 1e-3  # 0.8 and 0.9 mm; the geometry of the arm is nominal
    np.testing.assert_allclose(found[6:], ur10.vjm.markers[0], rtol=0, atol=2e-3)
    # gravity: both trackers were levelled, so the arm stood upright
    up = Rotation.from_rotvec(found[:3]).apply([0.0, 0.0, 1.0])
    assert np.rad2deg(np.arccos(up[2])) < 1


def test_orientations_are_the_targets_in_the_trackers_frame(ur10, readings):
    """One turn of the mount and one of the frame explain them to a tenth of a degree."""
    _, orientation = tool_pose(ur10.vjm, readings.q)
    flange, read = Rotation.from_matrix(orientation), Rotation.from_matrix(readings.rotation)
    # turns between poses, seen from the base and from the tracker, have the same axes but for the frame
    a = (flange[1:] * flange[:-1].inv()).as_rotvec()
    b = (read[1:] * read[:-1].inv()).as_rotvec()
    clear = np.linalg.norm(a, axis=1) < 2.5  # far from half a turn, where the axis changes its sign
    frame, _ = Rotation.align_vectors(b[clear], a[clear])
    mounts = (frame * flange).inv() * read
    apart = (mounts.mean().inv() * mounts).magnitude()
    assert np.rad2deg(np.sqrt(np.mean(apart**2))) < 0.15
