"""Links and joints averaged with joints alone: by evidence, so that links which nobody sees add no noise."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from testbench.campaign.advice import of_average
from testbench.campaign.campaign import Scenario, simulate
from testbench.campaign.model_selection import with_priors
from testbench.campaign.models import named_models
from testbench.campaign.perturbed_prior import prior_of
from testbench.campaign.true_arms import true_cell
from testbench.identify import gco, intervals, reduce, with_prior
from testbench.identify.average import ODDS, averaged, of_two_priors
from testbench.identify.evaluate import deflections, score
from testbench.identify.hierarchy import ALONE, LOOSE, MISFIT, learn, log_evidence_alone
from testbench.identify.metric import metric, whitened
from testbench.identify.posterior import linearise
from testbench.identify.prior import cad_prior, softened
from testbench.model.structure import all153, joints_only

SCENARIO = Scenario(arm="kr500_l480", identification_poses=8, identification_runs=16, workspace_poses=60)


@pytest.fixture(scope="module")
def rigid(kr500):
    """Campaigns of links a thousand times stiffer than the folder's, by seed."""
    cell = true_cell(kr500, "tubes", 1, stiffer=1000)
    return {seed: simulate(cell, SCENARIO, seed) for seed in (1, 2, 3)}


def errors(cell, campaign, *estimates):
    truth = campaign.truth
    return [score(deflections(cell.vjm, e, truth), truth.deflection).rms for e in estimates]


@pytest.mark.parametrize("prior", ["right", "scaled"])
def test_where_links_are_rigid_the_default_is_joints_alone(kr500, rigid, prior):
    """Before it erred by a quarter to a half more."""
    for seed, campaign in rigid.items():
        data = campaign.identification
        [model] = with_priors(kr500.arm, named_models(kr500, ["ALL153"]), prior_of(kr500, prior, seed))
        found = model.estimator(kr500.vjm, model.structure, data)
        alone = gco(kr500.vjm, joints_only(kr500.arm), data)
        ours, theirs = errors(kr500, campaign, found, alone)
        assert found.average.weight > 0.75
        [said] = of_average(found.average)
        assert said.startswith("link compliances do not improve the model: joint stiffness only weighs")
        assert ours < 1.05 * theirs


def test_the_average_is_a_mean_of_gramians_whose_intervals_hold_both(kr500, rigid):
    campaign = rigid[1]
    found = with_prior(gco, cad_prior(kr500.arm))(kr500.vjm, all153(kr500.arm), campaign.identification)
    whole, w = found.average.whole, found.average.weight
    links = slice(0, 42)
    np.testing.assert_allclose(found.C_theta[links, links], (1 - w) * whole.C_theta[links, links], rtol=1e-12)
    assert found.conservative
    assert found.status == "solved"
    rows = np.eye(found.structure.n)
    apart = found.pi - whole.pi
    expected = np.hypot(linearise(whole).deviations(rows), np.abs(apart))
    np.testing.assert_allclose(linearise(found).deviations(rows), expected, rtol=1e-9)
    own, theirs = (intervals(kr500.vjm, e, campaign.truth) for e in (found, whole))
    assert np.median((own.upper - own.lower) / (theirs.upper - theirs.lower)) > 0.95


def test_the_weight_is_that_of_the_evidence_by_the_book(kr500, rigid):
    """Of joints alone: a normal density of the readings about a scale, integrated over it by quadrature."""
    data, found = rigid[2].identification, []
    s = joints_only(kr500.arm)
    regression = reduce(kr500.vjm, s, data)
    for name in ("right", "scaled", "uncoupled"):
        own = metric(prior_of(kr500, name, 2), kr500.vjm, s)
        log_evidence, belief = log_evidence_alone(regression, own)
        kappa, e = LOOSE / belief.strength.uncertainty, belief.metric.expected
        A, y = whitened(regression, belief.metric)
        S = kappa**2 * np.eye(len(y)) + ALONE**2 * A @ A.T
        best = float(y @ np.linalg.solve(S, A @ e))
        best /= float(A @ e @ np.linalg.solve(S, A @ e))

        def density(v, A=A, y=y, S=S, e=e, best=best):
            e0, e1 = y - A @ (best * e), y - A @ (v * e)
            return math.exp((e0 @ np.linalg.solve(S, e0) - e1 @ np.linalg.solve(S, e1)) / 2)

        e0 = y - A @ (best * e)
        log_size = np.linalg.slogdet(S)[1]
        over_scale = math.log(quad(density, best - 2, best + 2, points=[best], limit=200)[0])
        rest = sum(t.equations / 3 * t.rest for t in regression.terms) / kappa**2
        beyond = (regression.equations - len(y)) * math.log(kappa)
        dense = over_scale - (e0 @ np.linalg.solve(S, e0) + log_size + rest) / 2 - beyond
        found.append(log_evidence - dense + (math.log(kappa) / MISFIT) ** 2 / 2)
    np.testing.assert_allclose(found, found[0], rtol=0, atol=1e-5)  # but for powers of 2 pi


def test_the_weight_is_the_odds_beforehand_times_the_ratio_of_evidences(kr500, rigid):
    data, prior, s = rigid[3].identification, cad_prior(kr500.arm), all153(kr500.arm)
    belief = learn(regression := reduce(kr500.vjm, s, data), own := metric(prior, kr500.vjm, s))
    alone = joints_only(kr500.arm)
    there = log_evidence_alone(reduce(kr500.vjm, alone, data), metric(prior, kr500.vjm, alone))[0]
    odds = ODDS * math.exp(there - belief.log_evidence)
    found = averaged(regression, "psd", own, widths=True)
    assert found.average.weight == pytest.approx(odds / (1 + odds), rel=1e-5)


@pytest.fixture(scope="module")
def by_beams_and_both(kr500):
    """Estimates by the folder's prior alone, and by the softened one too, of three arms a kind; truths."""
    s, prior, found = all153(kr500.arm), cad_prior(kr500.arm), {}
    beams, soft = (metric(own, kr500.vjm, s) for own in (prior, softened(prior)))
    for kind in ("coupled", "tubes"):
        arms = [simulate(true_cell(kr500, kind, seed), SCENARIO, seed) for seed in (1, 2, 3)]
        reduced = [(arm, reduce(kr500.vjm, s, arm.identification)) for arm in arms]
        found[kind] = [
            (arm, averaged(r, "psd", beams, widths=True), of_two_priors(r, "psd", beams, soft))
            for arm, r in reduced
        ]
    return found


def test_links_that_are_no_beams_are_told_by_the_evidence(kr500, by_beams_and_both):
    pairs = [errors(kr500, arm, *both) for arm, *both in by_beams_and_both["coupled"]]
    assert np.mean([ours / alone for alone, ours in pairs]) < 0.95
    for arm, *both in by_beams_and_both["tubes"]:
        alone, ours = errors(kr500, arm, *both)
        assert ours < 1.05 * alone


def test_a_mean_by_two_priors_is_conservative_and_its_covariance_is_that_of_the_mixture(by_beams_and_both):
    found = next(own for *_, own in by_beams_and_both["coupled"] if own.average.parts)
    parts = found.average.parts
    assert sum(share for share, _ in parts) == pytest.approx(1)
    assert found.conservative
    np.testing.assert_allclose(found.pi, sum(share * own.pi for share, own in parts), rtol=1e-12)
    rows = np.eye(found.structure.n)
    expected = sum(
        share * (linearise(own).deviations(rows) ** 2 + (own.pi - found.pi) ** 2) for share, own in parts
    )
    np.testing.assert_allclose(linearise(found).deviations(rows) ** 2, expected, rtol=1e-9)
