"""A method is a value: what it asks, believes and weighs; and an estimator of one's own runs as it is."""

import re
from dataclasses import replace

import numpy as np
import pytest

from testbench.campaign.campaign import Scenario, simulate
from testbench.campaign.evaluation import identify, of_model
from testbench.campaign.fits import Runs, fit
from testbench.campaign.model_selection import DEFAULT, choose, default_models, recommend
from testbench.campaign.models import Model, is_least_squares, named_models
from testbench.errors import BenchError
from testbench.identify import gco, least_squares, make_estimate, reduce, robust, with_prior
from testbench.identify.evaluate import score
from testbench.identify.hierarchy import learn
from testbench.identify.method import ROBUST_UNCERTAINTY
from testbench.identify.metric import Belief, metric, rescaled
from testbench.identify.prior import Strength, cad_prior, distorted
from testbench.identify.solve import solve
from testbench.model.structure import template56
from testbench.model.vjm import tool_pose

HALF = Strength(0.5)


@pytest.fixture(scope="module")
def campaign(kr500):
    return simulate(kr500, Scenario(arm="kr500_l480", workspace_poses=10), 1)


@pytest.fixture(scope="module")
def prior(kr500):
    return distorted(cad_prior(kr500.arm), scale=2, shape=0.3, rng=np.random.default_rng(5))


def rigid(vjm, structure, data):
    """An estimator of one's own: nothing moves but by a hair."""
    return make_estimate(reduce(vjm, structure, data), np.full(structure.n, 1e-12), method="a hair")


def test_an_estimator_of_ones_own_takes_neither_prior_nor_robust_loss(prior):
    for combine in (robust, lambda own: with_prior(own, prior)):
        with pytest.raises(BenchError, match="rigid: an estimator of your own runs as it is"):
            combine(rigid)


def test_an_estimator_of_ones_own_sees_kinematics_without_compliances_and_poses_but_those_held_out(
    kr500, campaign
):
    seen = []

    def mine(vjm, structure, data):
        seen.append((vjm, len(np.unique(data.pose))))
        return rigid(vjm, structure, data)

    data, own = campaign.identification, Model("mine", template56(kr500.arm), mine)
    identify(kr500, campaign, [own], lambda: 0.0)
    of_model(kr500, own, data)
    found = recommend(kr500, [*named_models(kr500, ["MGCO47"]), own], data)
    assert found.name == "MGCO47"
    assert [c.name for c in found.candidates] == ["MGCO47", "mine"]
    assert [poses for _, poses in seen] == [8] * 2 + [7] * 8  # every one of the eight left out once
    q = campaign.truth.q
    for vjm, _ in seen:
        assert np.isnan(np.diag(vjm.arm.C_theta)).all()
        np.testing.assert_array_equal(tool_pose(vjm, q)[0], tool_pose(kr500.vjm, q)[0])
    # a rigid arm's F_M is the RMS deflection over sqrt(2) sigma, fold by fold; a hair is 1e-4 of C
    moved = [data.deflection[data.pose == pose] for pose in np.unique(data.pose)]
    expected = [np.sqrt((d**2).sum() / d[..., 0].size) / (np.sqrt(2) * data.sigma) for d in moved]
    np.testing.assert_allclose(found.candidates[1].errors, expected, rtol=1e-3)


def test_the_default_gives_way_to_joints_alone_only_where_these_are_clearly_better(kr500, campaign):
    data, cad = campaign.identification, cad_prior(kr500.arm)
    chosen = choose(kr500, data, cad)
    assert (chosen.name, chosen.estimate.of_compliances.structure.n) == (DEFAULT, 153)
    assert chosen.why.startswith("the default; in cross-validation no rival")
    found = recommend(kr500, default_models(kr500, cad), data)
    by_name = {c.name: c.errors for c in found.candidates}
    assert found.name == DEFAULT
    assert by_name["MLS56"].mean() > by_name[DEFAULT].mean()


def test_a_prior_is_in_the_scale_of_the_data_its_strength_given_learnt_or_fixed_beside_outliers(
    kr500, campaign, prior
):
    s, data = template56(kr500.arm), campaign.identification
    regression, own = reduce(kr500.vjm, s, data), metric(prior, kr500.vjm, s)
    for method in (gco, least_squares):
        estimate = with_prior(method, prior, HALF)(kr500.vjm, s, data)
        by_hand = solve(regression, method.constraint, Belief(rescaled(own, regression), HALF))
        np.testing.assert_array_equal(estimate.pi, by_hand.pi)
        assert (estimate.constraint, estimate.belief.strength) == (method.constraint, HALF)
    learnt = with_prior(gco, prior)(kr500.vjm, s, data).belief
    by_hand = learn(regression, own)
    assert learnt.strength == by_hand.strength
    np.testing.assert_array_equal(learnt.metric.L, by_hand.metric.L)
    assert robust(with_prior(gco, prior))(kr500.vjm, s, data).belief.strength == Strength(ROBUST_UNCERTAINTY)


def failing(vjm, structure, data):
    raise ValueError("singular")


def of_few(vjm, structure, data):
    """Fails where a pose is held out."""
    if len(np.unique(data.pose)) < 8:
        raise ValueError("too few\nposes")
    return rigid(vjm, structure, data)


def infinite(vjm, structure, data):
    return replace(rigid(vjm, structure, data), C_theta=np.full((48, 48), np.nan))


def of_folder(vjm, structure, data):
    """Takes what the folder says, which is the true arm where links are tubes."""
    return make_estimate(reduce(vjm, structure, data), structure.entries(vjm.arm.C_theta), method="mine")


def test_an_estimator_of_ones_own_is_named_as_such_and_checked(kr500, campaign):
    """Neither least squares nor GCO; conservative is looked at, not believed; a NaN is no score."""
    data, structure = campaign.identification, template56(kr500.arm)
    found = make_estimate(reduce(kr500.vjm, structure, data), -np.ones(structure.n), method="mine")
    assert found.constraint == "own"
    assert not is_least_squares(found.structure.name, found.constraint, prior=False)
    assert not found.conservative
    with pytest.raises(TypeError, match="conservative"):
        replace(found, conservative=True)
    moved = data.deflection.copy()
    moved[0, 0, 0] = np.nan
    with pytest.raises(BenchError, match=r"score: predicted .m.: expected finite numbers"):
        score(moved, data.deflection)


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
    runs = Runs("runs.csv", campaign.identification, campaign.identification, None)
    found = fit(kr500, [*named_models(kr500, ["Joints"]), own], runs, lambda: 0.0)
    assert [m.name for m in found.fits.models] == ["Joints"]
    [failed] = found.fits.failed
    assert failed.name == "mine"
    assert failed.status.startswith(f"failed: {why}")
    assert not found.fits.doubts
    if estimator is not of_few:  # alone it has no rival, and nothing is held out
        with pytest.raises(BenchError, match=re.escape(f"mine: its estimator failed: {why}")):
            fit(kr500, [own], runs, lambda: 0.0)


@pytest.mark.parametrize(("times", "doubted"), [(1.0, []), (1.2, []), (1.96, ["noise"]), (5.0, ["noise"])])
def test_noise_that_is_stated_far_too_large_is_doubted(kr500, campaign, times, doubted):
    """A U95 in place of a standard deviation, by F_M below what noise alone leaves; 20 % more is not far."""
    data = campaign.identification
    runs = Runs("runs.csv", *[replace(data, sigma=times * data.sigma)] * 2, None)
    found = fit(kr500, named_models(kr500, ["Joints", "MGCO56"]), runs, lambda: 0.0)
    assert [doubt.name for doubt in found.fits.doubts] == doubted
    assert all(
        "is sigma too large (50 um where none is stated), a U95 perhaps" in doubt.sentence
        for doubt in found.fits.doubts
    )
