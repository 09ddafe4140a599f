"""Set-based bounds: true, tight, proven, and infinite where nothing bounds."""

from dataclasses import replace

import numpy as np
import pytest

from testbench.bench.campaign import Scenario, simulate
from testbench.errors import BenchError
from testbench.identify import gco, least_squares, reduce
from testbench.identify.bounds import bounds, fit_set
from testbench.identify.estimate import is_conservative
from testbench.identify.prior import Prior, aggregate, cad_prior, metric
from testbench.identify.regularised import blocks_of, project
from testbench.identify.uncertainty import deflection_rows, resampler
from testbench.model.structure import Structure, all153, mgco68, template56
from testbench.model.vjm import chain, generalised_load


@pytest.fixture(scope="module")
def campaign(kr500):
    return simulate(kr500, Scenario(arm="kr500_l480", truth="linear", workspace_poses=4), 1)


def prepare(cell, structure, data):
    return reduce(cell.vjm, structure, data), metric(cad_prior(cell.arm), cell.vjm, structure)


def elsewhere(cell, structure, where, markers=1):
    points = cell.vjm.markers[:markers]
    return deflection_rows(cell.vjm, structure, where.q, where.wrench, where.point, targets=points)


def truth_of(cell, structure):
    return structure.entries(aggregate(cell.arm.C_theta, cell.vjm, structure))


def distance(models, x):
    return np.linalg.norm(models.rows @ x - models.centre)


@pytest.mark.parametrize("structure", [template56, mgco68, all153])
def test_bounds_hold_the_truth_and_are_proven_by_their_dual(kr500, campaign, structure):
    s = structure(kr500.arm)
    models = fit_set(*prepare(kr500, s, campaign.identification), 0.95, ceiling=10.0)
    rows = elsewhere(kr500, s, campaign.workspace)
    found = bounds(models, rows)
    assert {name for pair in found.status for name in pair} == {"solved"}
    y = rows @ truth_of(kr500, s)
    assert ((found.lower < y) & (y < found.upper)).all()
    # bounds are the dual's, their models are feasible: between them lies the optimum, to 10 nm of mm
    assert np.abs(found.gap).max() < 1e-8
    for k, pair in enumerate(found.models):
        for side, pi in enumerate(pair):
            x = np.linalg.solve(models.metric.L, pi)
            assert distance(models, x) <= models.radius * (1 + 1e-6)
            eigenvalues = np.concatenate([np.linalg.eigvalsh(X) for X in blocks_of(models.metric, x)])
            assert eigenvalues.min() > -1e-6
            assert eigenvalues.max() < 10 * (1 + 1e-6)
            assert rows[k] @ pi == pytest.approx((found.lower, found.upper)[side][k], abs=1e-8)


def test_no_feasible_model_found_by_sampling_lies_outside(kr500, campaign):
    """Models of the set by another way: segments between its members and from them into random directions."""
    s = template56(kr500.arm)
    models = fit_set(*prepare(kr500, s, campaign.identification), 0.95, ceiling=10.0)
    rows = elsewhere(kr500, s, campaign.workspace)
    found, rng = bounds(models, rows), np.random.default_rng(3)
    inside = np.linalg.solve(models.metric.L, found.models.reshape(-1, s.n).T).T
    x = inside.mean(axis=0)
    widest, tried = np.tile(rows @ models.metric.L @ x, (2, 1)), 0
    for _ in range(400):  # hit and run
        step = rng.standard_normal(s.n) * rng.choice([0.03, 0.3, 1.0])
        other = project(models.metric, x + step)
        stiff = max(np.linalg.eigvalsh(X)[-1] for X in blocks_of(models.metric, other))
        if distance(models, other) > models.radius or stiff > 10:
            other = x + rng.uniform(0, 1) * (inside[rng.integers(len(inside))] - x)
        assert distance(models, other) <= models.radius * (1 + 1e-6)
        x, tried = other, tried + 1
        y = rows @ models.metric.L @ x
        widest = np.array([np.minimum(widest[0], y), np.maximum(widest[1], y)])
    assert tried == 400
    assert (widest[0] >= found.lower - 1e-9).all()
    assert (widest[1] <= found.upper + 1e-9).all()
    assert (widest[1] - widest[0] > 0.1 * (found.upper - found.lower)).any()  # and the sampling went far


def test_bounds_hold_the_predictions_of_gco_and_of_conservative_least_squares(arm_6r, kr500, campaign):
    s = mgco68(kr500.arm)
    data = campaign.identification
    regression, m = prepare(kr500, s, data)
    estimate = gco(kr500.vjm, s, data)
    models = fit_set(regression, m, 0.95)
    rows = elsewhere(kr500, s, campaign.workspace)
    found, y = bounds(models, rows), rows @ estimate.pi
    assert ((found.lower <= y + 1e-9) & (y <= found.upper + 1e-9)).all()
    joints = Structure.of(kr500.arm, joints=["joint_2", "joint_3"])
    estimate = least_squares(kr500.vjm, joints, data)
    assert estimate.conservative
    models = fit_set(*prepare(kr500, joints, data), 0.95)
    rows = elsewhere(kr500, joints, campaign.workspace)
    found, y = bounds(models, rows), rows @ estimate.pi
    assert ((found.lower <= y) & (y <= found.upper)).all()


def test_bounds_of_a_small_set_are_those_of_its_ellipse(kr500, campaign):
    """Two joints far inside the cone: the support function of an ellipse, in closed form."""
    s = Structure.of(kr500.arm, joints=["joint_2", "joint_3"])
    models = fit_set(*prepare(kr500, s, campaign.identification), 0.9)
    rows = elsewhere(kr500, s, campaign.workspace)
    found = bounds(models, rows)
    a = rows @ models.metric.L
    x = np.linalg.solve(models.rows, models.centre)
    half = models.radius * np.linalg.norm(np.linalg.solve(models.rows.T, a.T), axis=0)
    np.testing.assert_allclose(found.upper, a @ x + half, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.lower, a @ x - half, rtol=1e-6, atol=1e-9)
    assert models.radius**2 == pytest.approx(4.605, abs=1e-3)  # chi squared, 2 degrees, 90 %


def test_bounds_shrink_with_more_data_and_with_less_confidence(kr500, campaign):
    s = template56(kr500.arm)
    data = campaign.identification
    regression, m = prepare(kr500, s, data)
    rows = elsewhere(kr500, s, campaign.workspace)
    scenario = Scenario(
        arm="kr500_l480", truth="linear", workspace_poses=4, identification_runs=160, check_runs=60
    )
    often = simulate(kr500, scenario, 1).identification  # the same poses, each twenty times
    wide = bounds(fit_set(regression, m, 0.95, ceiling=10.0), rows)
    narrow = bounds(fit_set(regression, m, 0.5, ceiling=10.0), rows)
    more = bounds(fit_set(reduce(kr500.vjm, s, often), m, 0.95, ceiling=10.0), rows)
    assert (narrow.lower >= wide.lower - 1e-9).all()
    assert (narrow.upper <= wide.upper + 1e-9).all()
    size = [np.mean(b.upper - b.lower) for b in (wide, narrow)]
    assert size[1] < size[0]
    assert np.mean(more.upper - more.lower) < 0.8 * size[0]


def test_unbounded_is_found_and_a_ceiling_ends_it(kr500, campaign):
    s = all153(kr500.arm)
    regression, m = prepare(kr500, s, campaign.identification)
    joint_1 = np.zeros((1, s.n))
    joint_1[0, (s.a == s.labels.index("joint_1"))] = 1
    rows = np.vstack([joint_1, elsewhere(kr500, s, campaign.workspace)[:2]])
    free = bounds(fit_set(regression, m, 0.95), rows)
    assert free.lower[0] == pytest.approx(0, abs=1e-12)  # no conservative joint is below zero
    assert free.status[0] == ("solved", "unbounded")
    assert free.upper[0] == np.inf
    assert np.isinf(free.upper).all()
    sizes = []
    for ceiling in (10.0, 100.0, 1000.0):
        models = fit_set(regression, m, 0.95, ceiling=ceiling)
        held = bounds(models, rows)
        assert f"at most {ceiling:g} times CAD of kr500_l480" in held.name
        C_11 = kr500.arm.C_theta[s.labels.index("joint_1")] @ joint_row(s)
        assert held.upper[0] == pytest.approx(ceiling * C_11, rel=1e-6)
        sizes.append(held.upper[1:] - held.lower[1:])
    assert (sizes[1] > 3 * sizes[0]).all()  # it is the ceiling that bounds them
    assert (sizes[2] > 3 * sizes[1]).all()


def joint_row(s):
    row = np.zeros(s.n_theta)
    row[s.labels.index("joint_1")] = 1
    return row


def test_growing_compliance_frees_what_it_shares_a_row_with(kr500, campaign):
    """Unseen C_11 may grow, so |C_12|^2 <= C_11 C_22 says nothing; without it a bound would look finite."""
    s = mgco68(kr500.arm)
    regression, m = prepare(kr500, s, campaign.identification)
    models = fit_set(regression, m, 0.95)
    assert [W.shape[1] for W in models.face.held] == [3, 5, 5, 1, 1, 1, 1, 1]
    # growing rows of the base link give way to none of the loads that it felt
    data = campaign.identification
    u = generalised_load(chain(kr500.vjm, data.q), data.wrench, data.point)[:6]
    grown = np.linalg.qr(models.face.held[0], mode="complete")[0][:, 3:]
    X = grown @ grown.T
    column, row = np.tril_indices(6)
    x = np.r_[X[row, column] * np.where(row == column, 1, np.sqrt(2)), np.zeros(s.n - 21)]
    D, P = s.matrix(m.L @ x)[:6, :6], kr500.arm.C_theta[:6, :6]
    assert np.abs(u.T @ D @ u).max() < 1e-9 * np.abs(u.T @ P @ u).max()
    rows = elsewhere(kr500, s, campaign.workspace)
    found = bounds(models, rows)
    y = rows @ truth_of(kr500, s)
    assert ((found.lower <= y) & (y <= found.upper)).all()
    assert not any(name.startswith("not solved") for pair in found.status for name in pair)
    finite = np.isfinite(found.upper)
    assert finite.any()
    assert not finite.all()
    # what is finite is what ever higher ceilings tend to
    high = bounds(fit_set(regression, m, 0.95, ceiling=3000.0), rows[finite])
    assert (high.upper <= found.upper[finite] + 1e-8).all()


def test_units_of_the_prior_do_not_matter_without_a_ceiling(kr500, campaign):
    s = template56(kr500.arm)
    regression = reduce(kr500.vjm, s, campaign.identification)
    rows = elsewhere(kr500, s, campaign.workspace)
    found = []
    for scale in (0.5, 2.0):
        prior = Prior("scaled", scale * kr500.arm.C_theta)
        found.append(bounds(fit_set(regression, metric(prior, kr500.vjm, s), 0.95), rows))
    both = np.isfinite(found[0].upper) & np.isfinite(found[1].upper)
    assert both.any()
    np.testing.assert_allclose(found[0].upper[both], found[1].upper[both], rtol=1e-3)


def test_the_set_holds_the_truth_as_often_as_it_says(kr500, campaign):
    """|A (truth - LS)|^2 <= quantile, 60 datasets: the bounds hold all functionals where this holds."""
    s = mgco68(kr500.arm)
    regression, m = prepare(kr500, s, campaign.identification)
    truth, rng = truth_of(kr500, s), np.random.default_rng(4)
    again, x = resampler(regression), np.linalg.solve(m.L, truth_of(kr500, s))
    found = []
    for _ in range(60):
        # the ceiling spares the search for what grows; it does not enter the distance
        models = fit_set(again(truth, rng), m, 0.8, ceiling=10.0)
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
    found = bounds(models, elsewhere(kr500, s, campaign.workspace)[:2])
    assert found.status == (("empty", "empty"),) * 2
    assert np.isnan([found.lower, found.upper]).all()


def test_no_load_bounds_nothing(kr500, campaign):
    s = template56(kr500.arm)
    data = campaign.identification
    idle = replace(data, wrench=np.zeros_like(data.wrench))
    regression, m = prepare(kr500, s, idle)
    rows = np.vstack([np.zeros(s.n), elsewhere(kr500, s, campaign.workspace)[0]])
    found = bounds(fit_set(regression, m, 0.95), rows)
    assert (found.lower[0], found.upper[0]) == (0, 0)
    assert found.upper[1] == np.inf
    assert np.isfinite(bounds(fit_set(regression, m, 0.95, ceiling=2.0), rows).upper).all()


def test_misfit_is_told(kr500, campaign):
    s = Structure.of(kr500.arm, joints=["joint_2"])
    wrong = fit_set(*prepare(kr500, s, campaign.identification), 0.95)
    assert wrong.misfit < 1e-6
    assert fit_set(*prepare(kr500, mgco68(kr500.arm), campaign.identification), 0.95).misfit > 1e-3


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
        bounds(fit_set(regression, m, 0.95, ceiling=10.0), np.ones((1, 7)))


def test_models_that_reach_a_bound_are_conservative_up_to_the_solver(kr500, campaign):
    s = mgco68(kr500.arm)
    models = fit_set(*prepare(kr500, s, campaign.identification), 0.95, ceiling=10.0)
    found = bounds(models, elsewhere(kr500, s, campaign.workspace)[:2])
    for pi in found.models.reshape(-1, s.n):
        C = s.matrix(models.metric.L @ project(models.metric, np.linalg.solve(models.metric.L, pi)))
        assert all(is_conservative(C[np.ix_(i, i)]) for i in s.blocks)
        np.testing.assert_allclose(s.entries(C), pi, atol=1e-6 * np.abs(pi).max())


def test_two_threads_find_the_same_bounds(kr500, campaign):
    s = template56(kr500.arm)
    models = fit_set(*prepare(kr500, s, campaign.identification), 0.95, ceiling=10.0)
    rows = elsewhere(kr500, s, campaign.workspace)[:5]
    one, two = bounds(models, rows), bounds(models, rows, workers=2)
    assert one.status == two.status
    np.testing.assert_allclose(two.lower, one.lower, rtol=0, atol=1e-9)
    np.testing.assert_allclose(two.upper, one.upper, rtol=0, atol=1e-9)
    with pytest.raises(BenchError, match="workers: expected at least 1"):
        bounds(models, rows, workers=0)
