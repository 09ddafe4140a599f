"""Set-based bounds: true, tight, proven by their dual."""

from dataclasses import replace

import numpy as np
import pytest
from loads import rows_of

from testbench.campaign.campaign import Scenario, simulate
from testbench.errors import BenchError
from testbench.identify import reduce
from testbench.identify.metric import metric
from testbench.identify.prior import Prior, aggregate, cad_prior
from testbench.model.structure import Structure, all153, mgco68, template56
from testbench.studies.estimators.bootstrap import resampler
from testbench.studies.estimators.bounds import bounds, fit_set


@pytest.fixture(scope="module")
def campaign(kr500):
    return simulate(kr500, Scenario(arm="kr500_l480", truth="linear", workspace_poses=4), 1)


def prepare(cell, structure, data):
    return reduce(cell.vjm, structure, data), metric(cad_prior(cell.arm), cell.vjm, structure)


def truth_of(cell, structure):
    return structure.entries(aggregate(cell.arm.C_theta, cell.vjm, structure))


def distance(models, x):
    return np.linalg.norm(models.rows @ x - models.centre)


@pytest.mark.parametrize("structure", [template56, mgco68, all153])
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


def test_the_set_holds_the_truth_as_often_as_it_says(kr500, campaign):
    """|A (truth - LS)|^2 <= quantile, 60 datasets: the bounds hold all functionals where this holds."""
    s = mgco68(kr500.arm)
    regression, m = prepare(kr500, s, campaign.identification)
    truth, rng = truth_of(kr500, s), np.random.default_rng(4)
    again, x = resampler(regression), np.linalg.solve(m.L, truth_of(kr500, s))
    found = []
    for _ in range(60):
        models = fit_set(again(truth, rng), m, 0.8)
        found.append(distance(models, x))
    r = len(models.rows)
    # chi squared of r degrees: standard error of its mean sqrt(2 r / 60), of the share sqrt(0.16 / 60); 4 of
    # each
    assert np.mean(np.square(found)) == pytest.approx(r, abs=4 * np.sqrt(2 * r / 60))
    assert np.mean(np.array(found) <= models.radius) == pytest.approx(0.8, abs=0.21)


def test_data_that_no_conservative_model_fits_leave_an_empty_set(kr500, campaign):
    s = template56(kr500.arm)
    data = campaign.identification
    lifted = replace(data, after=2 * data.before - data.after)  # deflections against the load
    models = fit_set(*prepare(kr500, s, lifted), 0.95)
    assert models.empty
    found = bounds(models, rows_of(kr500, s, campaign.truth)[:2])
    assert found.status == (("empty", "empty"),) * 2
    assert np.isnan([found.lower, found.upper]).all()


def test_without_a_load_the_ceiling_alone_bounds(kr500, campaign):
    """One joint, C between zero and k P: a bound in closed form."""
    s = Structure.of(kr500.arm, joints=["joint_2"])
    idle = replace(campaign.identification, wrench=np.zeros_like(campaign.identification.wrench))
    regression, m = prepare(kr500, s, idle)
    for ceiling in (2.0, 10.0):
        found = bounds(fit_set(regression, m, 0.95, ceiling=ceiling), np.array([[0.0], [3.0]]))
        P = kr500.arm.C_theta[s.a, s.a][0]
        np.testing.assert_allclose(found.lower, 0, atol=1e-7 * P)
        np.testing.assert_allclose(found.upper, [0, 3 * ceiling * P], rtol=1e-7, atol=1e-7 * P)


def test_bad_input_is_named(kr500, campaign):
    s = template56(kr500.arm)
    regression, m = prepare(kr500, s, campaign.identification)
    for confidence in (0.0, 1.0, -0.5, 95.0, np.nan):
        with pytest.raises(BenchError, match="confidence: expected a number between 0 and 1"):
            fit_set(regression, m, confidence)
    for ceiling in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(BenchError, match="ceiling: expected a finite number above 0"):
            fit_set(regression, m, 0.95, ceiling=ceiling)
    with pytest.raises(BenchError, match="metric: expected one of MGCO56"):
        fit_set(regression, metric(cad_prior(kr500.arm), kr500.vjm, mgco68(kr500.arm)), 0.95)
    with pytest.raises(BenchError, match="expected shape"):
        metric(Prior("small", np.eye(6)), kr500.vjm, s)
    with pytest.raises(BenchError, match="functionals"):
        bounds(fit_set(regression, m, 0.95), np.ones((1, 7)))
