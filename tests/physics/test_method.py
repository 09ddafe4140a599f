"""A method is a value: what it asks, believes and weighs; wild readings; an estimator of one's own."""

import re
from dataclasses import replace

import numpy as np
import pytest
from loads import axis_loads
from programs import block_matrices

from testbench import BenchError, Scenario, score, simulate
from testbench.identify import cone
from testbench.identify.equations import weighted_readings
from testbench.identify.estimate import ORIENTATION_READING, make_estimate
from testbench.identify.hierarchy import learn_prior
from testbench.identify.interior import least_squares_on_cone as psd_least_squares
from testbench.identify.method import (
    ROBUST_PRIOR_UNCERTAINTY,
    gco,
    least_squares,
    paper_gco,
    robust,
    with_prior,
)
from testbench.identify.prior import (
    PriorUncertainty,
    WeightedPrior,
    cad_prior,
    perturb_prior,
    prior_rows,
    rescale_to_data,
    scale_by_prior,
)
from testbench.identify.registration import PAIR_LOSS
from testbench.identify.regression import reduce
from testbench.identify.solve import (
    REJECTED_RESIDUAL,
    robust_residuals,
    solve,
    solve_with_prior,
    without_outliers,
)
from testbench.model.structure import all153, mgco68, template56
from testbench.model.vjm import tool_poses
from testbench.studies.campaign.noise_sensitivity import spoil
from testbench.studies.campaign.trial import TrialCase, fitted
from testbench.workflows.advice import advice
from testbench.workflows.fits import MeasuredRuns, fit_models
from testbench.workflows.models import (
    Model,
    fit_model,
    named_models,
    recommend,
    reduce_runs,
)

HALF = PriorUncertainty(0.5)


@pytest.fixture(scope="module")
def campaign(kr500):
    return simulate(kr500, Scenario(arm="kr500_l480", workspace_poses=10), 1)


@pytest.fixture(scope="module")
def prior(kr500):
    return perturb_prior(cad_prior(kr500.arm), scale=2, shape=0.3, rng=np.random.default_rng(5))


def rigid(vjm, structure, data):
    """An estimator of one's own: nothing moves but by a hair."""
    return make_estimate(
        reduce(vjm, structure, data), np.full(structure.n_parameters, 1e-12), method="a hair"
    )


def test_an_estimator_of_ones_own_sees_kinematics_without_compliances_and_poses_but_those_held_out(
    kr500, campaign
):
    seen = []

    def mine(vjm, structure, data):
        seen.append((vjm, len(np.unique(data.pose_id))))
        return rigid(vjm, structure, data)

    data, own = campaign.identification, Model("mine", template56(kr500.arm), mine)
    fitted(kr500, [own], [TrialCase(data, campaign.truth, {})])
    fit_model(kr500, own, data)
    models = [*named_models(kr500, ["MGCO47"]), own]
    found = recommend(kr500, models, data, reduce_runs(kr500, models, data))
    assert found.name == "MGCO47"
    assert [c.model_name for c in found.candidates] == ["MGCO47", "mine"]
    assert [poses for _, poses in seen] == [8] * 2 + [7] * 8  # every one of the eight left out once
    q = campaign.truth.q
    for vjm, _ in seen:
        assert np.isnan(np.diag(vjm.arm.C_theta)).all()
        np.testing.assert_array_equal(tool_poses(vjm, q)[0], tool_poses(kr500.vjm, q)[0])
    # a rigid arm's F_M is the RMS deflection over sqrt(2) sigma, fold by fold; a hair is 1e-4 of C
    moved = [data.deflection[data.pose_id == pose] for pose in np.unique(data.pose_id)]
    expected = [np.sqrt((d**2).sum() / d[..., 0].size) / (np.sqrt(2) * data.sigma) for d in moved]
    np.testing.assert_allclose(found.candidates[1].errors, expected, rtol=1e-3)


def test_a_prior_is_in_the_scale_of_the_data_its_strength_given_learnt_or_fixed_beside_outliers(
    kr500, campaign, prior
):
    s, data = template56(kr500.arm), campaign.identification
    regression, own = reduce(kr500.vjm, s, data), scale_by_prior(prior, kr500.vjm, s)
    for method in (gco, least_squares):
        estimate = with_prior(method, prior, HALF)(kr500.vjm, s, data)
        by_hand = solve(regression, method.constraint, WeightedPrior(rescale_to_data(own, regression), HALF))
        np.testing.assert_array_equal(estimate.pi, by_hand.pi)
        assert (estimate.constraint, estimate.weighted_prior.uncertainty) == (method.constraint, HALF)
    learnt = with_prior(gco, prior)(kr500.vjm, s, data).weighted_prior
    by_hand = learn_prior(regression, own)
    assert learnt.uncertainty == by_hand.uncertainty
    np.testing.assert_array_equal(learnt.scaling.L, by_hand.scaling.L)
    assert robust(with_prior(gco, prior))(kr500.vjm, s, data).weighted_prior.uncertainty == PriorUncertainty(
        ROBUST_PRIOR_UNCERTAINTY
    )


def failing(vjm, structure, data):
    raise ValueError("singular")


def of_few(vjm, structure, data):
    """Fails where a pose is held out."""
    if len(np.unique(data.pose_id)) < 8:
        raise ValueError("too few\nposes")
    return rigid(vjm, structure, data)


def infinite(vjm, structure, data):
    return replace(rigid(vjm, structure, data), C_theta=np.full((48, 48), np.nan))


def of_folder(vjm, structure, data):
    """Takes what the folder says, which is the true arm where links are tubes."""
    return make_estimate(
        reduce(vjm, structure, data), structure.parameters_of(vjm.arm.C_theta), method="mine"
    )


def test_an_estimator_of_ones_own_is_named_as_such_checked_and_runs_as_it_is(kr500, campaign, prior):
    """Neither least squares nor GCO; conservative is looked at, not believed; a NaN is no score."""
    data, structure = campaign.identification, template56(kr500.arm)
    found = make_estimate(reduce(kr500.vjm, structure, data), -np.ones(structure.n_parameters), method="mine")
    assert found.constraint == "own"
    assert not found.conservative
    with pytest.raises(TypeError, match="conservative"):
        replace(found, conservative=True)
    moved = data.deflection.copy()
    moved[0, 0, 0] = np.nan
    with pytest.raises(BenchError, match=r"predicted .m.: expected finite numbers"):
        score(moved, data.deflection)
    for combine in (robust, lambda own: with_prior(own, prior)):
        with pytest.raises(BenchError, match="rigid: your own estimator cannot be given a"):
            combine(rigid)


@pytest.mark.parametrize(
    ("estimator", "why"),
    [
        (failing, "ValueError: singular"),
        (of_few, "ValueError: too few poses"),
        (infinite, "expected 56 finite parameters, got shape (56,)"),
        (lambda *_: None, "expected an Estimate, got NoneType"),
        (of_folder, "pi [m/N, rad/(N m), rad/N]: expected finite numbers"),
    ],
)
def test_one_estimator_that_fails_does_not_cost_the_others(kr500, campaign, estimator, why):
    own = Model("mine", template56(kr500.arm), estimator)
    runs = MeasuredRuns("runs.csv", campaign.identification, campaign.identification, None)
    found = fit_models(kr500, [*named_models(kr500, ["Joints"]), own], runs, lambda: 0.0)
    assert [m.name for m in found.fits.models] == ["Joints"]
    [failed] = found.fits.failed
    assert failed.name == "mine"
    assert failed.status.startswith(f"failed: {why}")
    assert not found.fits.doubts
    if estimator is not of_few:  # alone it has no rival, and nothing is held out
        with pytest.raises(BenchError, match=re.escape(f"mine: its estimator failed: {why}")):
            fit_models(kr500, [own], runs, lambda: 0.0)


@pytest.mark.parametrize(("times", "doubted"), [(1.0, []), (1.2, []), (1.96, ["noise"]), (5.0, ["noise"])])
def test_noise_that_is_stated_far_too_large_is_doubted(kr500, campaign, times, doubted):
    """A U95 in place of a standard deviation, by F_M below what noise alone leaves; 20 % more is not far."""
    data = campaign.identification
    runs = MeasuredRuns("runs.csv", *[replace(data, sigma=times * data.sigma)] * 2, None)
    found = fit_models(kr500, named_models(kr500, ["Joints", "MLS56"]), runs, lambda: 0.0)
    said = "is sigma too large (default 50 um; is it a U95?)"
    assert [doubt.name for doubt in found.fits.doubts if said in doubt.sentence] == doubted
    assert len(found.fits.doubts) == len(doubted)


STRENGTH, DELTA = PriorUncertainty(0.3), PAIR_LOSS.threshold


def readings(cell, seed, truth="linear"):
    return simulate(cell, Scenario(arm="kr500_l480", truth=truth, workspace_poses=1), seed).identification


def rough(cell, structure, seed):
    """The CAD prior, 2 times wrong in scale and 30 % in shape."""
    wrong = perturb_prior(cad_prior(cell.arm), scale=2, shape=0.3, rng=np.random.default_rng([seed, 7]))
    return scale_by_prior(wrong, cell.vjm, structure)


def robustly(cell, structure, data, constraint="psd", units=None):
    """The fit without outliers, by a metric as it is where there is one."""
    weighted_prior = None if units is None else WeightedPrior(units, STRENGTH)
    return without_outliers(cell.vjm, data, reduce(cell.vjm, structure, data), constraint, weighted_prior)


def found(fit):
    return {(reading.run, reading.marker) for reading in fit.rejected_readings}


@pytest.mark.parametrize("constraint", ["none", "psd"])
def test_reweighing_ends_where_no_model_is_better(kr500, constraint):
    """Of least squares the gradient of the loss is zero; of GCO PSD in every block, and orthogonal to X.

    The loss is Huber's of every reading's residual beside the prior's penalty; a rough prior, spoiled runs.
    """
    s, (data, _) = mgco68(kr500.arm), spoil(readings(kr500, 1), 0.05, 1e-3, np.random.default_rng(1))
    units = rough(kr500, s, 1)
    own = weighted_readings(kr500.vjm, s, data)
    regression = reduce(kr500.vjm, s, data)
    A, y, (B, c) = own.A @ units.L, own.y, prior_rows(units, STRENGTH)
    length, status = robust_residuals(kr500.vjm, own, regression, constraint, WeightedPrior(units, STRENGTH))
    assert status == "solved"
    weight = np.sqrt(np.minimum(1, DELTA / np.maximum(length, DELTA)))
    rows, right = np.vstack([(weight[:, None, None] * A).reshape(-1, s.n_parameters), B]), weight[:, None] * y
    x, _ = psd_least_squares(rows, np.r_[right.ravel(), c], units.block_orders if constraint == "psd" else ())
    left, off = A @ x - y, B @ x - c
    found = np.linalg.norm(left, axis=1)
    np.testing.assert_allclose(found, length, rtol=0, atol=1e-4)
    loss = np.where(found <= DELTA, found**2 / 2, DELTA * (found - DELTA / 2)).sum() + off @ off / 2
    pull = np.minimum(1, DELTA / np.maximum(found, 1e-300))[:, None] * left
    gradient, scale = np.einsum("ikn,ik->n", A, pull) + B.T @ off, 1e-5 * loss
    if constraint == "none":
        assert np.abs(gradient).max() < scale
    x = cone.clip_negative_eigenvalues(x, units.block_orders)
    for X, S in zip(block_matrices(units, x), block_matrices(units, gradient), strict=True):
        assert np.linalg.eigvalsh(S)[0] > -scale
        assert abs((S * X).sum()) < scale


def test_where_nothing_is_rejected_the_robust_fit_is_the_plain_one_to_the_last_digit(kr500):
    s, data, pairs, same = template56(kr500.arm), readings(kr500, 0), [], 0
    units, regression = rough(kr500, s, 0), reduce(kr500.vjm, s, data)
    for constraint, method in (("psd", paper_gco), ("none", least_squares)):
        pairs.append((robustly(kr500, s, data, constraint), method(kr500.vjm, s, data)))
        by_hand = solve(regression, constraint, WeightedPrior(units, STRENGTH))
        pairs.append((robustly(kr500, s, data, constraint, units), by_hand))
    for own, plain in pairs:
        assert own.method == f"{plain.method}, Huber loss"
        assert len(own.rejected_readings) <= 1
        if not own.rejected_readings:
            assert advice(own) == advice(plain)
            np.testing.assert_array_equal(own.pi, plain.pi)
            same += 1
    # 0.14 of 135 sound readings lie beyond the 99.9 % quantile
    assert same >= 3


def test_rejected_readings_are_listed_with_their_distance_and_runs_without_any_left_are_named(kr500):
    data, s = readings(kr500, 1), mgco68(kr500.arm)
    off = np.zeros_like(data.after)
    off[4, 1] = [0, 0, 3e-3]
    off[6] = [0, 0, 20e-3]  # the tracker was pushed between the two readings
    fit = robustly(kr500, s, replace(data, after=data.after + off), "psd", rough(kr500, s, 1))
    first, *others = fit.rejected_readings
    assert (first.run, first.marker) == (data.run_id[4], data.markers[1])
    assert {(one.run, one.marker) for one in others} == {(data.run_id[6], name) for name in data.markers}
    assert first.residual == pytest.approx(3e-3, abs=4 * np.sqrt(3) * 50e-6)  # noise and fit: 4 sd
    assert first.residual_over_sigma == pytest.approx(first.residual / (np.sqrt(2) * 50e-6))
    assert fit.regression.n_equations == 3 * (45 - 4)
    said = advice(fit)
    assert f"4 of 45 readings are rejected: they lie beyond {REJECTED_RESIDUAL} standard deviations" in said
    assert any(f"all readings of run {data.run_id[6]} are rejected:" in words for words in said)


@pytest.mark.study
def test_too_many_rejections_too_few_left_and_a_search_that_did_not_converge_are_said(kr500, monkeypatch):
    data, s = readings(kr500, 2, "nonlinear"), mgco68(kr500.arm)
    units = rough(kr500, s, 2)
    fit = robustly(kr500, s, replace(data, sigma=20e-6), "psd", units)  # it is 50 um
    assert any("too many to be outliers: sigma too small" in said for said in advice(fit))
    with pytest.raises(BenchError, match=r"equations left for 4\d directions: sigma too small"):
        robustly(kr500, s, replace(data, sigma=1e-6), "psd", units)
    flipped = replace(data, before=data.after, after=data.before)  # no conservative model moves that way
    with pytest.raises(BenchError, match="45 of 45 readings rejected"):
        robustly(kr500, s, flipped, "psd", units)
    monkeypatch.setattr(
        "testbench.identify.solve.solve_with_prior",
        lambda *args: replace(solve_with_prior(*args), status="not solved: why"),
    )
    s = template56(kr500.arm)
    fit = robustly(kr500, s, readings(kr500, 4), "none", rough(kr500, s, 4))
    assert fit.status == "not solved: why (search for outliers)"


def test_a_wild_orientation_is_rejected_as_such(arm_6r, rng):
    data = axis_loads(arm_6r, rng, poses=20)
    off = np.zeros_like(data.rotation_after)
    off[[10, 50]] = [5e-3, 0, 0]  # 14 standard deviations
    spoiled = replace(data, rotation_after=data.rotation_after + off)
    s = all153(arm_6r.arm)
    units = scale_by_prior(cad_prior(arm_6r.arm), arm_6r.vjm, s)
    fit = robustly(arm_6r, s, spoiled, "psd", units)
    assert {(data.run_id[10], ORIENTATION_READING), (data.run_id[50], ORIENTATION_READING)} <= found(fit)
    assert len(fit.rejected_readings) <= 4  # of 238 sound readings 0.2 lie beyond the 99.9 % quantile
    kinds = [term.n_equations for term in fit.regression.terms]
    assert sum(kinds) == 3 * (2 * data.n_runs - len(fit.rejected_readings))
    assert fit.f_m < 1.2 * fit.f_m_floor  # the prior holds some of the rank


def test_spoiling_moves_as_many_readings_as_asked_and_too_many_are_refused(kr500, rng, monkeypatch):
    data, s = readings(kr500, 1), template56(kr500.arm)
    spoiled, mask = spoil(data, 0.1, 1e-3, rng)
    assert mask.sum() == round(0.1 * 45)
    moved = np.linalg.norm(spoiled.deflection - data.deflection, axis=-1)
    np.testing.assert_allclose(moved, 1e-3 * mask, atol=1e-15)
    monkeypatch.setattr("testbench.identify.equations.MAX_ROBUST_READINGS", 44)
    with pytest.raises(BenchError, match="expected at most 44 readings, got 45"):
        robustly(kr500, s, data, "none")
