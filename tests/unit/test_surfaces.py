"""Surfaces, outlines and quaternions of what is drawn, against scipy."""

from collections import Counter

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from scipy.special import stdtrit

from testbench.identify.posterior import PRIOR_STUDENT_DOF, student_quantile
from testbench.plant.shapes import primitive_surface, quaternions_from_rotations
from testbench.report.run_figure import AT_ONCE, _hull

SIZES = {
    "box": [0.1, 0.2, 0.3],
    "cylinder": [0.2, 0.2, 0.5],
    "capsule": [0.2, 0.2, 0.4],
    "sphere": [0.3, 0.3, 0.3],
    "ellipsoid": [0.1, 0.2, 0.5],
}


@pytest.mark.parametrize("kind", SIZES)
def test_the_surface_of_a_primitive_is_its_convex_hull_closed_and_outward(kind):
    corners, faces = primitive_surface(kind, np.array(SIZES[kind]))
    hull = ConvexHull(corners)
    a, b, c = corners[faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a) / 2
    assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(hull.area, rel=1e-12)
    assert (np.vecdot(normals, a) > 0).all()  # the centre is inside
    assert np.vecdot(normals, a).sum() / 3 == pytest.approx(hull.volume, rel=1e-12)
    places = corners.round(12) + 0.0
    edges = Counter((tuple(places[face[k]]), tuple(places[face[k - 1]])) for face in faces for k in range(3))
    assert all(edges[end, start] == 1 for start, end in edges)  # each is that of one neighbour, backwards


def test_quaternions_are_those_of_scipy_half_turns_too():
    turns = Rotation.random(500, random_state=7).as_matrix()
    half = [np.eye(3), *(2 * np.outer(x, x) - np.eye(3) for x in np.eye(3))]
    R = np.concatenate([turns, half])
    ours, theirs = quaternions_from_rotations(R), Rotation.from_matrix(R).as_quat()
    same = np.sign(np.vecdot(ours, theirs))[:, None]  # a quaternion and its negative are one turn
    np.testing.assert_allclose(same * ours, theirs, atol=1e-15)
    assert quaternions_from_rotations(R.reshape(4, -1, 3, 3)).shape == (4, 126, 4)


@pytest.mark.parametrize("count", [300, 3 * AT_ONCE])
def test_an_outline_is_the_convex_hull_but_for_edges_that_turn_by_less_than_a_degree(count):
    flat = np.random.default_rng(3).normal(size=(count, 2)) * [1.0, 0.1]
    hull, drawn = flat[ConvexHull(flat).vertices], _hull(flat)
    assert {*map(tuple, drawn)} <= {*map(tuple, hull)}
    angles = np.linspace(0, 2 * np.pi, 3600)
    ways = np.array([np.cos(angles), np.sin(angles)])
    lost = (hull @ ways).max(axis=0) - (drawn @ ways).max(axis=0)
    assert 0 <= lost.min() <= lost.max() < np.tan(np.deg2rad(0.5)) * np.ptp(flat, axis=0).max()
    x, y = drawn.T
    assert np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) > 0  # counterclockwise


@pytest.mark.parametrize("p", [1e-6, 0.3, 0.95, 0.975, 0.999])
def test_the_quantile_of_four_degrees_of_freedom_is_that_of_scipy(p):
    assert student_quantile(PRIOR_STUDENT_DOF, p) == pytest.approx(stdtrit(4.0, p), rel=1e-12)
