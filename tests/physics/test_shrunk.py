"""Least squares held down without a cone: ridge by cross-validation over all readings, and clipped."""

import numpy as np
import pytest

from testbench.campaign.campaign import Scenario, simulate
from testbench.identify import least_squares, make_estimate, reduce
from testbench.identify.evaluate import all_deflections
from testbench.model.structure import template56
from testbench.studies.estimators.shrunk import RIDGES, clipped, ridge


@pytest.fixture(scope="module")
def seen(kr500):
    """Runs, the unknowns, and their equations as they stand in the file, in standard deviations."""
    data = simulate(kr500, Scenario(arm="kr500_l480", workspace_poses=1), 3).identification
    beams = template56(kr500.arm)
    regression = reduce(kr500.vjm, beams, data)
    each = [make_estimate(regression, 1e-6 * e, method="one") for e in np.eye(beams.n)]
    sigma = np.sqrt(2) * data.sigma * 1e-6
    A = all_deflections(kr500.vjm, each, data)[:, data.seen].reshape(beams.n, -1).T / sigma
    return data, beams, A, 1e-6 * data.deflection[data.seen].ravel() / sigma


def test_ridge_leaves_each_reading_out_in_turn_by_its_weight(kr500, seen):
    """Generalised cross-validation of all equations by the hat matrix, not of those that are reduced."""
    data, beams, A, y = seen
    A = A / np.linalg.norm(A, axis=0).clip(1e-9 * np.linalg.norm(A, axis=0).max())
    largest = np.linalg.norm(A, 2) ** 2

    def fit(size):
        return np.linalg.solve(A.T @ A + size * largest * np.eye(beams.n), A.T)

    def score(size):
        hat = A @ fit(size)
        return np.sum((y - hat @ y) ** 2) / (len(y) - np.trace(hat)) ** 2

    best = min(RIDGES, key=score)
    found = ridge(kr500.vjm, beams, data)
    moved = all_deflections(kr500.vjm, [found], data)[0][data.seen].ravel()
    expected = A @ fit(best) @ y * np.sqrt(2) * data.sigma
    np.testing.assert_allclose(moved, expected, rtol=0, atol=1e-6 * np.abs(expected).max())
    assert found.constraint == "ridge"


def test_clipping_makes_the_nearest_conservative_matrix_of_every_block(kr500, seen):
    data, beams, _, _ = seen
    plain, held = (method(kr500.vjm, beams, data) for method in (least_squares, clipped))
    assert (plain.conservative, held.conservative, held.f_m > plain.f_m) == (False, True, True)
    for block in beams.blocks:
        C, X = (own.C_theta[np.ix_(block, block)] for own in (plain, held))
        left = X - C  # positive semi-definite, and orthogonal to what is kept
        assert np.linalg.eigvalsh(left)[0] >= -1e-12 * np.abs(C).max()
        assert abs(np.sum(left * X)) <= 1e-9 * np.sum(C**2)
