"""Least squares completed to the nearest conservative model of equal fit; held down by ridge or clipping."""

from dataclasses import replace

import numpy as np
import pytest

from testbench.campaign.advice import advice
from testbench.campaign.campaign import Scenario
from testbench.campaign.campaign import simulate as calibrate
from testbench.campaign.identifiability import imagined
from testbench.campaign.pose_campaign import FullPose, simulate
from testbench.errors import BenchError
from testbench.identify import (
    completed_least_squares,
    least_squares,
    make_estimate,
    reduce,
    robust,
    with_prior,
)
from testbench.identify.cone import psd_part
from testbench.identify.conic import sensitivity_units
from testbench.identify.evaluate import all_deflections, deflections
from testbench.identify.least_squares import NONE
from testbench.identify.prior import cad_prior
from testbench.model.structure import free36, joints_only, mgco147, template56
from testbench.studies.estimators.shrunk import RIDGES, clipped, ridge

SECTION_5_2 = FullPose(arm="arm_6r", least=9e-3, most=41e-3, check_runs=10)
SEEDS = range(1, 3)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("make", [template56, mgco147])
def test_of_section_5_2_most_models_of_least_squares_are_conservative_at_no_cost_in_fit(arm_6r, make, seed):
    data, structure = simulate(arm_6r, SECTION_5_2, seed).identification, make(arm_6r.arm)
    plain, filled = (fit(arm_6r.vjm, structure, data) for fit in (least_squares, completed_least_squares))
    assert not plain.conservative
    assert filled.conservative
    assert (filled.status, filled.constraint) == ("solved", "free")
    assert filled.f_m == pytest.approx(plain.f_m, rel=1e-7)
    moved = [deflections(arm_6r.vjm, e, data) for e in (plain, filled)]
    np.testing.assert_allclose(*moved, rtol=0, atol=1e-10)  # of millimetres: readings agree to 1e-7
    assert np.abs(filled.pi - plain.pi).max() > 0.1 * np.abs(plain.pi).max()  # and yet another model


@pytest.mark.parametrize("seed", SEEDS)
def test_no_conservative_model_of_equal_fit_is_nearer(arm_6r, seed):
    """Dykstra's alternating projections on the models of equal fit and on the cone end at the same one."""
    s = template56(arm_6r.arm)
    data = simulate(arm_6r, SECTION_5_2, seed).identification
    plain, filled = (fit(arm_6r.vjm, s, data) for fit in (least_squares, completed_least_squares))
    unit = sensitivity_units(plain.regression) / np.where(s.mirrored, np.sqrt(2), 1)  # pi = unit svec(X)
    rows = np.vstack([term.R for term in plain.regression.terms]) * unit
    seen = np.linalg.svd(rows)[2][: plain.regression.rank]
    start, found = plain.pi / unit, filled.pi / unit

    def in_cone(x):
        X = s.matrix(x / np.where(s.mirrored, np.sqrt(2), 1))
        for block in s.blocks:
            X[np.ix_(block, block)] = psd_part(X[np.ix_(block, block)])
        return s.entries(X) * np.where(s.mirrored, np.sqrt(2), 1)

    x, correction = start.copy(), np.zeros_like(start)
    for _ in range(500):
        y = in_cone(x + correction)
        correction += x - y
        x = y - seen.T @ (seen @ (y - start))
    distance = np.linalg.norm(found - start)
    assert np.linalg.norm(x - start) == pytest.approx(distance, rel=1e-6)
    assert np.linalg.norm(x - found) < 1e-3 * distance


def test_a_seen_compliance_below_zero_leaves_no_conservative_model(kr500):
    """Joint 3 softens against the load, and no free direction touches it; joint 1 is the free one."""
    structure = joints_only(kr500.arm)
    true = np.array([1.0, 1.0, -0.5, 1.0, 1.0, 1.0]) * 1e-6
    data = deflected(kr500, structure, true)
    plain, filled = (fit(kr500.vjm, structure, data) for fit in (least_squares, completed_least_squares))
    assert plain.regression.rank == structure.n - 1
    np.testing.assert_allclose(filled.pi, np.r_[0, true[1:]], rtol=0, atol=1e-12)
    assert not filled.conservative
    assert NONE in filled.status
    assert any(NONE in said for said in advice(filled))
    right = completed_least_squares(kr500.vjm, structure, deflected(kr500, structure, np.abs(true)))
    assert right.conservative
    assert right.status == "solved"


def deflected(cell, structure, pi):
    """The runs of a campaign with the readings that these parameters make."""
    runs = calibrate(cell, Scenario(arm="kr500_l480", truth="linear", workspace_poses=1), 1).identification
    estimate = least_squares(cell.vjm, structure, runs)
    made = replace(estimate, pi=pi, C_theta=structure.matrix(pi))
    return replace(imagined(runs), after=deflections(cell.vjm, made, runs))


def test_it_takes_no_prior_and_looks_for_outliers_as_least_squares_does(arm_6r):
    with pytest.raises(BenchError, match="with a prior no direction is free"):
        with_prior(completed_least_squares, cad_prior(arm_6r.arm))
    structure, data = mgco147(arm_6r.arm), simulate(arm_6r, SECTION_5_2, 1).identification
    after = data.after.copy()
    after[7] += 0.01
    data = replace(data, after=after)
    plain, filled = (
        robust(fit)(arm_6r.vjm, structure, data) for fit in (least_squares, completed_least_squares)
    )
    assert {r.run for r in filled.rejected} == {r.run for r in plain.rejected} == {8}
    assert filled.conservative
    assert filled.f_m == pytest.approx(plain.f_m, rel=1e-7)
    with pytest.raises(BenchError, match="symmetric"):
        completed_least_squares(arm_6r.vjm, free36(arm_6r.arm), data)


@pytest.fixture(scope="module")
def seen(kr500):
    """Runs, the unknowns, and their equations as they stand in the file, in standard deviations."""
    data = calibrate(kr500, Scenario(arm="kr500_l480", workspace_poses=1), 3).identification
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
