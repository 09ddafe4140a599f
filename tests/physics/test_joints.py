"""Joints alone, what most calibrations identify, in every place where a model works."""

from dataclasses import replace

import numpy as np
import pytest

import testbench as tb
from testbench.campaign.advice import advice
from testbench.campaign.fits import Runs, fit
from testbench.campaign.identifiability import describe, imagined
from testbench.identify.prior import Strength

TRUE = np.array([3.0, 1.0, 2.0, 4.0, 5.0, 6.0]) * 1e-7  # rad/(N m)


@pytest.fixture(scope="module")
def model(kr500):
    return tb.MODELS["Joints"](kr500)


@pytest.fixture(scope="module")
def runs(kr500, model):
    """Noise-free readings of an arm whose links are rigid, under gravity."""
    measured = tb.simulate(kr500, tb.Scenario(arm="kr500_l480", workspace_poses=1), seed=1).measured
    return replace(imagined(measured), after=moved(kr500, model.structure, measured))


def moved(cell, structure, data):
    plain = tb.least_squares(cell.vjm, structure, data)
    return tb.deflections(cell.vjm, replace(plain, pi=TRUE, C_theta=structure.matrix(TRUE)), data)


def test_gravity_leaves_joint_1_at_zero_and_finds_the_others(kr500, model, runs):
    assert (model.name, model.structure.n, model.structure.labels[-6:]) == (
        "Joints",
        6,
        tuple(joint.name for joint in kr500.arm.joints),
    )
    for estimator in (model.estimator, tb.gco, tb.completed_least_squares, tb.robust(tb.gco)):
        found = estimator(kr500.vjm, model.structure, runs)
        np.testing.assert_allclose(found.pi, np.r_[0, TRUE[1:]], rtol=1e-5, atol=1e-14)
        assert found.conservative
        assert found.regression.rank == 5
        assert "6 unknowns, the data see 5 directions" in advice(found)[0]


def test_a_prior_speaks_of_the_joints_alone_and_fills_joint_1(kr500, model, runs):
    """In the prior's metric the links left out are rigid: no joint takes their compliance."""
    prior = tb.cad_prior(kr500.arm)
    for plain in (tb.least_squares, tb.gco):
        found = tb.with_prior(plain, prior, Strength(10.0))(kr500.vjm, model.structure, runs)
        own = np.diag(prior.C_theta)[42:]
        np.testing.assert_allclose(found.pi[1:], TRUE[1:], rtol=1e-3)  # the data have no noise
        assert 0.1 * own[0] < found.pi[0] < 10 * own[0]
        np.testing.assert_allclose(np.diag(found.belief.metric.L) / found.belief.metric.L[0, 0], own / own[0])


def test_intervals_are_finite_under_gravity_and_infinite_where_joint_1_is_loaded(kr500, model, runs):
    found = model.estimator(kr500.vjm, model.structure, runs)
    known = tb.intervals(kr500.vjm, found, runs)
    np.testing.assert_allclose(known.centre, runs.deflection, rtol=0, atol=1e-9)
    assert np.isfinite(known.upper - known.lower).all()
    pushed = runs.wrench.copy()
    pushed[:, 0] = 100.0
    assert np.isinf(tb.intervals(kr500.vjm, found, replace(runs, wrench=pushed)).upper).any()


def test_identifiability_a_plan_and_a_users_fit_take_it(kr500, model, runs):
    seen = describe(kr500.vjm, model.structure, runs, tb.cad_prior(kr500.arm), Strength(0.3))
    assert (seen.rank, seen.rank_of_structure, seen.not_loaded) == (5, 6, (0,))
    settings = tb.PlanSettings(model="Joints", loads_kg=(460.3,), poses=4, candidates_wanted=40)
    assert tb.plan(kr500, runs.q, settings).plan.q.shape == (4, 6)
    fits = fit(
        kr500,
        [tb.MODELS[name](kr500) for name in ("Joints", "MLS56")],
        Runs("x", runs, runs, None),
        lambda: 0.0,
    ).fits
    assert fits.recommended == "Joints"
    assert fits.models[0].joints == pytest.approx(
        dict(zip(model.structure.labels[-6:], np.r_[0, TRUE[1:]], strict=True))
    )
