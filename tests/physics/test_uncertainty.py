"""Posterior and bootstrap uncertainty: against Monte Carlo, and infinite where the data see nothing."""

import tracemalloc
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from loads import rows_of
from reports import table_of

from testbench.campaign.campaign import Scenario, simulate
from testbench.campaign.pose_campaign import FullPose
from testbench.campaign.pose_campaign import simulate as simulate_full_pose
from testbench.data.dataset import in_order
from testbench.errors import BenchError
from testbench.identify import gco, intervals, least_squares, reduce, with_prior
from testbench.identify.least_squares import minimum_norm
from testbench.identify.metric import metric
from testbench.identify.posterior import linearise
from testbench.identify.prior import Strength, aggregate, cad_prior
from testbench.model.structure import Structure, all153, mgco68, template56
from testbench.studies.estimators.bootstrap import bootstrap, resampler
from testbench.studies.identifiability.coverage import Case, bounded, draw_conservative
from testbench.studies.identifiability.study import coverage


@pytest.fixture(scope="module")
def full_pose(arm_6r):
    """Template of 56 unknowns from full poses: 32 directions, every deflection seen."""
    campaign = simulate_full_pose(arm_6r, FullPose(arm="arm_6r", check_runs=4), 1)
    s = template56(arm_6r.arm)
    truth = s.entries(aggregate(arm_6r.arm.C_theta, arm_6r.vjm, s))
    where = campaign.check
    rows = rows_of(arm_6r, s, where, np.zeros((1, 3)))
    m = metric(cad_prior(arm_6r.arm), arm_6r.vjm, s)
    return Case("arm_6r", reduce(arm_6r.vjm, s, campaign.identification), m, truth, rows), campaign


@pytest.fixture(scope="module")
def gravity(kr500):
    return simulate(kr500, Scenario(arm="kr500_l480", truth="linear", workspace_poses=4), 1)


def test_resampled_rows_have_the_chi_squared_and_spread_of_the_readings(full_pose):
    case, _ = full_pose
    again, rng = resampler(case.regression), np.random.default_rng(1)
    drawn = [again(case.truth, rng) for _ in range(400)]
    for k, term in enumerate(case.regression.terms):
        chi2 = [
            term.equations / 3 * (np.sum((d.terms[k].R @ case.truth - d.terms[k].z) ** 2) + d.terms[k].rest)
            for d in drawn
        ]
        # mean of 400 chi squares of e degrees of freedom: standard error sqrt(2 e / 400); 4 of them
        assert np.mean(chi2) == pytest.approx(term.equations, abs=4 * np.sqrt(2 * term.equations / 400))
    sd = linearise(minimum_norm(drawn[0])).deviations(case.functionals)
    found = [case.functionals @ minimum_norm(d).pi for d in drawn]
    np.testing.assert_allclose(np.std(found, axis=0), sd, rtol=0.15)  # 4 standard errors of 3.5 %


def test_what_gravity_does_not_load_is_infinitely_uncertain(kr500, gravity):
    joint_1 = Structure.of(kr500.arm, joints=["joint_1", "joint_2"])
    sd = linearise(least_squares(kr500.vjm, joint_1, gravity.identification)).deviations(np.eye(2))
    assert np.isinf(sd[0])
    assert 0 < sd[1] < 1e-7
    s = all153(kr500.arm)
    estimate = least_squares(kr500.vjm, s, gravity.identification)
    linear = linearise(estimate)
    assert np.isinf(linear.deviations(np.eye(s.n))[s.labels.index("joint_1") - s.n_theta])
    assert np.isinf(linear.deviations(rows_of(kr500, s, gravity.truth))).mean() > 0.5
    data = gravity.identification
    seen = rows_of(kr500, s, data, kr500.vjm.markers)
    sd = linear.deviations(seen)
    # the measured deflections themselves: never worse than one reading, better for what they share
    assert (sd < 1.001 * np.sqrt(2) * data.sigma).all()
    two = np.vstack([rows_of(kr500, s, gravity.truth)[:1], seen[:1]])
    found = bootstrap(estimate, two, 0.5, draws=3, rng=np.random.default_rng(0))
    np.testing.assert_array_equal(np.isinf(found.upper), [True, False])


def test_bootstrap_is_near_linearised_where_the_cone_does_not_bind(arm_6r, full_pose):
    case, campaign = full_pose
    data, s = campaign.identification, case.regression.structure
    for method, draws, rtol in ((least_squares, 199, 0.3), (gco, 39, 0.7)):
        estimate = method(arm_6r.vjm, s, data)
        linear = linearise(estimate).intervals(case.functionals, 0.9)
        boot = bootstrap(estimate, case.functionals, 0.9, draws=draws, rng=np.random.default_rng(1))
        # order statistics of 199 and of 39 draws: 7 and 17 % of the width; 4 standard errors
        np.testing.assert_allclose(boot.upper - boot.lower, linear.upper - linear.lower, rtol=rtol)
        np.testing.assert_array_equal(boot.centre, linear.centre)


def test_bounds_cover_all_deflections_at_once(full_pose):
    case, _ = full_pose
    few = replace(case, functionals=case.functionals[:3])
    row = coverage(table_of([0], lambda _: [bounded(few, k) for k in range(20)]))
    assert row.all_covered >= 0.8  # at least 0.95 in truth: 20 draws have fewer with 0.03 %
    assert row.unbounded_percent == 0


def test_bad_input_is_named(arm_6r, kr500, full_pose, gravity):
    case, campaign = full_pose
    s = case.regression.structure
    estimate = least_squares(arm_6r.vjm, s, campaign.identification)
    linear = linearise(estimate)
    for confidence in (0.0, 1.0, -1.0, 95.0, np.nan):
        with pytest.raises(BenchError, match="confidence: expected a number between 0 and 1"):
            linear.intervals(case.functionals, confidence)
    run = partial(bootstrap, estimate, rng=np.random.default_rng(0))
    with pytest.raises(BenchError, match="draws: expected at least 39 for 95 %, got 38"):
        run(case.functionals, 0.95, draws=38)
    for rows in (np.ones((1, 5)), np.ones(s.n), np.full((1, s.n), np.nan)):
        with pytest.raises(BenchError, match="functionals"):
            linear.deviations(rows)
    other = metric(cad_prior(kr500.arm), kr500.vjm, mgco68(kr500.arm))
    with pytest.raises(BenchError, match="expected a conservative model among"):
        draw_conservative(other, Strength(50.0), np.random.default_rng(0))


def test_memory_of_intervals_grows_with_what_they_are_and_not_with_their_rows(kr500, gravity):
    s = all153(kr500.arm)
    estimate = with_prior(gco, cad_prior(kr500.arm), Strength(0.3))(kr500.vjm, s, gravity.identification)

    def peak(times):
        where = in_order(gravity.truth, np.tile(np.arange(gravity.truth.runs), times))
        tracemalloc.start()
        found = intervals(kr500.vjm, estimate, where)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most, found.centre.size

    few, many = peak(1500), peak(3000)
    rows = 8 * s.n * (many[1] - few[1])
    assert many[0] - few[0] < rows / 10
