"""Joints along a path of the tool, judged by the forward kinematics: there, continuous, within limits."""

import numpy as np
import pytest
from serial_arms import write_arm

from testbench.correct.compensated import POSE_TOLERANCE, joints_along_path, solve_inverse_kinematics
from testbench.correct.newton import Target
from testbench.model.vjm import rotation_matrices, tool_poses
from testbench.workflows.cell import build_cell


@pytest.fixture(scope="session")
def seven(tmp_path_factory):
    """An arm of seven hinges."""
    return build_cell(write_arm(tmp_path_factory.mktemp("arm") / "seven", "zyzyzyz"))


def planted(vjm, rng, points):
    """Joints of a smooth path between two random poses, (points, n), all within limits."""
    lower, upper = vjm.arm.limits
    first, last = rng.uniform(0.8 * lower, 0.8 * upper, (2, vjm.arm.n_joints))
    way = (last - first) * min(1, 1.5 / np.abs(last - first).max())
    t = np.linspace(0, 1, points)[:, None]
    bent = 0.1 * np.sin(2 * np.pi * t * rng.integers(1, 4, vjm.arm.n_joints))
    return np.clip(first + t * way + bent, lower, upper)


@pytest.mark.parametrize("name", ["kr500", "arm_6r", "ur10", "slides", "seven"])
def test_a_path_of_the_tool_gives_joints_back_without_a_jump(name, request, rng):
    """From the first joints on one branch is followed; near singular poses wrists turn fast, yet steadily.

    Five axes follow a path of their own; seven follow it with motion to spare.
    """
    vjm, point = request.getfixturevalue(name).vjm, np.array([0.1, -0.05, 0.2])
    for _ in range(2):
        q = planted(vjm, rng, 500)
        position, R = tool_poses(vjm, q)
        found = joints_along_path(vjm, position + R @ point, R, start=q[0], point=point)
        assert found.converged.all()
        for own, wanted in zip(tool_poses(vjm, found.q), (position, R), strict=True):
            np.testing.assert_allclose(own, wanted, rtol=0, atol=1e-10)  # rounding alone is 1e-15 m
        assert ((found.q >= vjm.arm.limits[0]) & (found.q <= vjm.arm.limits[1])).all()
        assert np.abs(np.diff(found.q, axis=0)).max() < 0.3 or name == "seven"
    if name in ("kr500", "arm_6r", "ur10"):  # a configuration for the whole path is found without a start
        assert joints_along_path(vjm, position[::9], R[::9]).converged.all()


def test_points_out_of_reach_are_named_with_what_is_missing(kr500):
    """A line outwards leaves the workspace and comes back: the gap grows by what the line goes beyond."""
    vjm = kr500.vjm
    q0 = np.radians([10.0, -60, 70, 20, 50, 30])
    (p,), (R,) = tool_poses(vjm, q0[None])
    out = np.concatenate([np.linspace(0, 3, 61), np.linspace(3, 0, 61)])
    path = p + out[:, None] * np.array([1.0, 0, 0])
    found = joints_along_path(vjm, path, np.tile(R, (122, 1, 1)), start=q0)
    lost = ~found.converged
    assert not lost[[0, -1]].any()
    first, last = np.flatnonzero(lost)[[0, -1]]
    assert lost[first : last + 1].all()
    assert (found.distance_error[lost] + found.angle_error[lost] > POSE_TOLERANCE).all()
    assert found.distance_error[60] == pytest.approx(3 - out[first], abs=0.5)
    np.testing.assert_allclose(found.q[-1], q0, rtol=0, atol=1e-8)


def test_a_joint_at_its_limit_stays_there_and_through_a_stretched_wrist_joints_are_steady(kr500):
    """A tool turns about joint 6 by more than that can; joint 5 goes through zero, and just beside it."""
    vjm = kr500.vjm
    upper = vjm.arm.limits[1][5]
    q = np.tile(np.radians([10.0, -60, 70, 20, 50, 0]), (40, 1))
    q[:, 5] = upper + np.linspace(-0.5, 0.5, 40)
    position, R = tool_poses(vjm, q)
    found = solve_inverse_kinematics(vjm, Target(position, R), np.tile(q[0], (40, 1)))
    np.testing.assert_array_equal(found.converged, q[:, 5] <= upper)
    assert (found.q <= vjm.arm.limits[1]).all()
    q = np.tile(np.radians([10.0, -60, 70, 20, 0, 30]), (101, 1))
    q[:, 4] = np.linspace(-0.3, 0.3, 101)
    position, R = tool_poses(vjm, q)
    found = joints_along_path(vjm, position, R, start=q[0])
    np.testing.assert_allclose(found.q, q, rtol=0, atol=1e-6)
    beside = rotation_matrices(np.array([0.0, 1e-4, 0.0])) @ R
    found = joints_along_path(vjm, position, beside, start=q[0])
    assert found.converged.all()
