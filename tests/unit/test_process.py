"""Process forces along a path: directions of a circle, of corners, of points where the tool waits."""

import numpy as np
import pytest

from testbench.correct.predicted import path_tangents, process_wrench
from testbench.errors import BenchError

UP = np.array([0.0, 0.0, 1.0])


def test_on_a_circle_the_feed_is_tangential_and_the_cross_force_points_to_the_centre():
    """Counterclockwise seen against the spindle, left of the feed is inwards."""
    phi = np.linspace(0, 2 * np.pi, 361)
    out = np.column_stack([np.cos(phi), np.sin(phi), 0 * phi])
    wrench = process_wrench(np.tile([-3.0, 2.0, -5.0], (361, 1)), 0.3 * out, np.tile(UP, (361, 1)))
    expected = -3 * np.cross(UP, out) - 2 * out - 5 * UP
    np.testing.assert_allclose(wrench[1:-1, :3], expected[1:-1], rtol=0, atol=1e-12)
    assert np.abs(wrench[[0, -1], :3] - expected[[0, -1]]).max() < 3 * np.radians(0.51)  # half a step
    assert not wrench[:, 3:].any()


def test_where_the_tool_waits_the_way_around_counts(rng):
    path, times = np.cumsum(rng.normal(size=(9, 3)), axis=0), [3, 1, 2, 1, 1, 4, 1, 1, 2]
    once = path_tangents(path, np.ones(9, dtype=bool))
    waits = path_tangents(np.repeat(path, times, axis=0), np.ones(16, dtype=bool))
    np.testing.assert_array_equal(waits, np.repeat(once, times, axis=0))
    np.testing.assert_allclose(np.linalg.norm(once, axis=1), 1, rtol=0, atol=1e-15)


def test_a_corner_is_halved_whatever_the_steps_are_and_ends_of_a_cut_follow_the_cut():
    path = np.array([[0, 0, 0.3], [0, 0, 0], [0.2, 0, 0], [0.2, 0.001, 0], [0.2, 0.001, 0.3]])
    feed = path_tangents(path, np.array([False, True, True, True, False]))
    half = np.array([1, 1, 0]) / np.sqrt(2)
    expected = [[0, 0, -1], [1, 0, 0], half, [0, 1, 0], [0, 0, 1]]
    np.testing.assert_allclose(feed, expected, rtol=0, atol=1e-12)


def test_drilling_needs_no_way():
    along, same = np.array([[0, 0, -900.0]] * 2), np.zeros((2, 3))
    np.testing.assert_array_equal(process_wrench(along, same, np.tile(UP, (2, 1)))[:, 2], -900)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ([[0, 0, 0]] * 3, "line 7: no direction for its feed force"),
        ([[0, 0, 0], [1, 0, 0], [0, 0, 0]], "line 8: no direction for its feed force"),
        ([[0, 0, 0], [0, 0, 1], [0, 0, 2]], "line 7: no direction for its cross force: .* along the spindle"),
    ],
)
def test_a_force_without_a_direction_is_named(path, message):
    along, spindle = np.tile([1.0, 1.0, 0.0], (3, 1)), np.tile(UP, (3, 1))
    with pytest.raises(BenchError, match=message):
        process_wrench(along, np.array(path, dtype=float), spindle, ["line 7", "line 8", "line 9"])
