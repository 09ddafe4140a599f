"""Bounds: true, tight, proven by their dual; bootstrap and posterior, infinite where nothing is seen."""

import tracemalloc
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from loads import rows_of

from testbench.campaign.campaign import Scenario, simulate
from testbench.campaign.pose_campaign import FullPose
from testbench.campaign.pose_campaign import simulate as simulate_full_pose
from testbench.data.dataset import in_order
from testbench.errors import BenchError
from testbench.identify import gco, intervals, least_squares, reduce, with_prior
from testbench.identify.metric import metric
from testbench.identify.posterior import linearise
from testbench.identify.prior import Prior, Strength, aggregate, cad_prior
from testbench.model.structure import Structure, all153, mgco68, template56
from testbench.studies.estimators.bootstrap import bootstrap, resampler
from testbench.studies.estimators.bounds import bounds, fit_set
from testbench.studies.identifiability.coverage import draw_conservative


@pytest.fixture(scope="module")
def campaign(kr500):
    return simulate(kr500, Scenario(arm="kr500_l480", truth="linear", workspace_poses=4), 1)


def prepare(cell, structure, data):
    return reduce(cell.vjm, structure, data), metric(cad_prior(cell.arm), cell.vjm, structure)


def truth_of(cell, structure):
    return structure.entries(aggregate(cell.arm.C_theta, cell.vjm, structure))


def distance(models, x):
    return np.linalg.norm(models.rows @ x - models.centre)


@pytest.mark.parametrize("structure", [mgco68, all153])
def test_bounds_hold_the_truth_and_are_proven_by_their_dual(kr500, campaign, structure):
    s = structure(kr500.arm)
    models = fit_set(*prepare(kr500, s, campaign.identification), 0.95)
    rows = rows_of(kr500, s, campaign.truth)
    found = bounds(models, rows)
    assert {name for pair in found.status for name in pair} == {"solved"}
    y = rows @ truth_of(kr500, s)
    assert ((found.lower < y) & (y < found.upper)).all()
    # bounds are the dual's, their models are feasible: between them lies the optimum, to 10 nm
    for k, pair in enumerate(found.models):
        for side, pi in enumerate(pair):
            x = np.linalg.solve(models.metric.L, pi)
            assert distance(models, x) <= models.radius * (1 + 1e-6)
            eigenvalues = np.concatenate([np.linalg.eigvalsh(X) for X in models.metric.matrices(x)])
            assert eigenvalues.min() > -1e-6
            assert eigenvalues.max() < 10 * (1 + 1e-6)
            assert rows[k] @ pi == pytest.approx((found.lower, found.upper)[side][k], abs=1e-8)


def test_bounds_of_a_small_set_are_those_of_its_ellipse(kr500, campaign):
    """Two joints far inside the cone: the support function of an ellipse, in closed form."""
    s = Structure.of(kr500.arm, joints=["joint_2", "joint_3"])
    models = fit_set(*prepare(kr500, s, campaign.identification), 0.9, ceiling=1000.0)
    rows = rows_of(kr500, s, campaign.truth)
    found = bounds(models, rows)
    a = rows @ models.metric.L
    x = np.linalg.solve(models.rows, models.centre)
    half = models.radius * np.linalg.norm(np.linalg.solve(models.rows.T, a.T), axis=0)
    np.testing.assert_allclose(found.upper, a @ x + half, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.lower, a @ x - half, rtol=1e-6, atol=1e-9)
    assert models.radius**2 == pytest.approx(4.605, abs=1e-3)  # chi squared, 2 degrees, 90 %


def test_data_that_no_conservative_model_fits_leave_an_empty_set(kr500, campaign):
    s = template56(kr500.arm)
    data = campaign.identification
    lifted = replace(data, after=2 * data.before - data.after)  # deflections against the load
    models = fit_set(*prepare(kr500, s, lifted), 0.95)
    assert models.empty
    found = bounds(models, rows_of(kr500, s, campaign.truth)[:2])
    assert found.status == (("empty", "empty"),) * 2
    assert np.isnan([found.lower, found.upper]).all()


def test_bad_input_is_named(kr500, campaign):
    s, other = template56(kr500.arm), metric(cad_prior(kr500.arm), kr500.vjm, mgco68(kr500.arm))
    regression, m = prepare(kr500, s, campaign.identification)
    estimate = least_squares(kr500.vjm, s, campaign.identification)
    linear, rng = linearise(estimate), np.random.default_rng(0)
    for confidence in (0.0, 1.0, -0.5, 95.0, np.nan):
        for of in (partial(fit_set, regression, m), partial(linear.intervals, np.eye(s.n))):
            with pytest.raises(BenchError, match="confidence: expected a number between 0 and 1"):
                of(confidence)
    for ceiling in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(BenchError, match="ceiling: expected a finite number above 0"):
            fit_set(regression, m, 0.95, ceiling=ceiling)
    with pytest.raises(BenchError, match="metric: expected one of MGCO56"):
        fit_set(regression, other, 0.95)
    with pytest.raises(BenchError, match="expected shape"):
        metric(Prior("small", np.eye(6)), kr500.vjm, s)
    for rows in (np.ones((1, 5)), np.ones(s.n), np.full((1, s.n), np.nan)):
        for of in (linear.deviations, partial(bounds, fit_set(regression, m, 0.95))):
            with pytest.raises(BenchError, match="functionals"):
                of(rows)
    with pytest.raises(BenchError, match="draws: expected at least 39 for 95 %, got 38"):
        bootstrap(estimate, np.eye(s.n), 0.95, draws=38, rng=rng)
    with pytest.raises(BenchError, match="expected a conservative model among"):
        draw_conservative(other, Strength(50.0), rng)


@pytest.fixture(scope="module")
def full_pose(arm_6r):
    """Template of 56 unknowns from full poses: 32 directions, every deflection seen."""
    campaign = simulate_full_pose(arm_6r, FullPose(arm="arm_6r", check_runs=4), 1)
    s = template56(arm_6r.arm)
    rows = rows_of(arm_6r, s, campaign.check, np.zeros((1, 3)))
    return reduce(arm_6r.vjm, s, campaign.identification), truth_of(arm_6r, s), rows, campaign.identification


def test_resampled_rows_have_the_chi_squared_of_the_readings(full_pose):
    regression, truth, *_ = full_pose
    again, rng = resampler(regression), np.random.default_rng(1)
    drawn = [again(truth, rng) for _ in range(400)]
    for k, term in enumerate(regression.terms):
        left = [np.sum((d.terms[k].R @ truth - d.terms[k].z) ** 2) + d.terms[k].rest for d in drawn]
        # mean of 400 chi squares of e degrees of freedom: standard error sqrt(2 e / 400); 4 of them
        limit = 4 * np.sqrt(2 * term.equations / 400)
        assert term.equations / 3 * np.mean(left) == pytest.approx(term.equations, abs=limit)


def test_what_gravity_does_not_load_is_infinitely_uncertain(kr500, campaign):
    joint_1 = Structure.of(kr500.arm, joints=["joint_1", "joint_2"])
    sd = linearise(least_squares(kr500.vjm, joint_1, campaign.identification)).deviations(np.eye(2))
    assert np.isinf(sd[0])
    assert 0 < sd[1] < 1e-7
    s = all153(kr500.arm)
    estimate = least_squares(kr500.vjm, s, campaign.identification)
    linear = linearise(estimate)
    assert np.isinf(linear.deviations(np.eye(s.n))[s.labels.index("joint_1") - s.n_theta])
    assert np.isinf(linear.deviations(rows_of(kr500, s, campaign.truth))).mean() > 0.5
    data = campaign.identification
    seen = rows_of(kr500, s, data, kr500.vjm.markers)
    sd = linear.deviations(seen)
    # the measured deflections themselves: never worse than one reading, better for what they share
    assert (sd < 1.001 * np.sqrt(2) * data.sigma).all()
    two = np.vstack([rows_of(kr500, s, campaign.truth)[:1], seen[:1]])
    found = bootstrap(estimate, two, 0.5, draws=3, rng=np.random.default_rng(0))
    np.testing.assert_array_equal(np.isinf(found.upper), [True, False])


def test_bootstrap_is_near_linearised_where_the_cone_does_not_bind(arm_6r, full_pose):
    regression, _, rows, data = full_pose
    for method, draws, rtol in ((least_squares, 199, 0.3), (gco, 39, 0.7)):
        estimate = method(arm_6r.vjm, regression.structure, data)
        linear = linearise(estimate).intervals(rows, 0.9)
        boot = bootstrap(estimate, rows, 0.9, draws=draws, rng=np.random.default_rng(1))
        # order statistics of 199 and of 39 draws: 7 and 17 % of the width; 4 standard errors
        np.testing.assert_allclose(boot.upper - boot.lower, linear.upper - linear.lower, rtol=rtol)
        np.testing.assert_array_equal(boot.centre, linear.centre)


def test_memory_of_intervals_grows_with_what_they_are_and_not_with_their_rows(kr500, campaign):
    s = all153(kr500.arm)
    estimate = with_prior(gco, cad_prior(kr500.arm), Strength(0.3))(kr500.vjm, s, campaign.identification)

    def peak(times):
        where = in_order(campaign.truth, np.tile(np.arange(campaign.truth.runs), times))
        tracemalloc.start()
        found = intervals(kr500.vjm, estimate, where)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most, found.centre.size

    few, many = peak(500), peak(1000)
    rows = 8 * s.n * (many[1] - few[1])
    assert many[0] - few[0] < rows / 10
