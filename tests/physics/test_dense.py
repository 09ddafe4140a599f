"""The dense solver against Clarabel as the referee, and what becomes of an answer that is not proven."""

import numpy as np
import pytest
from agreement import ROUNDING, WORSE, compared, compared_with_prior
from programs import NASTY, random_regression, with_random_prior

from testbench.bench.campaign import Scenario, simulate
from testbench.identify import cone, conic, dense, reduce
from testbench.identify.conic import answers, by_clarabel, optima, optimum, scale_program
from testbench.identify.metric import Case, metric, rescaled
from testbench.identify.prior import Strength, cad_prior
from testbench.identify.regularised import Belief, gco_with, parameters
from testbench.model.structure import all153, mgco47, mgco68, template56

STRENGTHS = (1e-6, 0.01, 0.3, 2.0, 30.0, 1e3)
STRUCTURES = (mgco47, template56, mgco68, all153)


@pytest.fixture(scope="module")
def campaigns(kr500):
    return [simulate(kr500, Scenario(arm=kr500.arm.name, workspace_poses=1), seed) for seed in (11, 12, 13)]


@pytest.mark.parametrize("kind", ["kind", *NASTY])
def test_no_answer_costs_more_than_the_referees_nor_is_proven_worse(kind, rng):
    for k in range(8):
        regression = random_regression(kind, rng)
        case = with_random_prior(regression, STRENGTHS[k % len(STRENGTHS)], rng)
        for found in (compared(regression), compared_with_prior(case)):
            assert found.over <= WORSE
            assert found.gap <= 10 * max(found.referee, ROUNDING)


@pytest.mark.parametrize("structure", STRUCTURES)
def test_campaigns_need_no_referee(kr500, campaigns, structure, monkeypatch):
    monkeypatch.setattr(cone, "solve", None)
    s = structure(kr500.arm)
    for run in campaigns:
        regression = reduce(kr500.vjm, s, run.identification)
        own = rescaled(metric(cad_prior(kr500.arm), kr500.vjm, s), regression)
        assert optimum(regression).status == "solved"
        for u in (0.05, 0.3, 2.0):
            estimate = gco_with(regression, own, Strength(u))
            assert estimate.status == "solved"
            assert estimate.conservative


@pytest.mark.parametrize("structure", STRUCTURES)
def test_fits_together_are_the_fits_alone(kr500, campaigns, structure):
    s = structure(kr500.arm)
    regressions = [reduce(kr500.vjm, s, run.identification) for run in campaigns]
    together, alone = optima(regressions), np.array([optimum(r).pi for r in reversed(regressions)])[::-1]
    assert np.abs(together - alone).max() <= 1e-7 * np.abs(alone).max()
    own = metric(cad_prior(kr500.arm), kr500.vjm, s)
    cases = [Case(r, Belief(own, Strength(u))) for r in regressions for u in (0.1, 3.0)]
    alone = np.array([gco_with(c.regression, own, c.belief.strength).pi for c in cases])
    assert np.abs(parameters("psd", cases) - alone).max() <= 1e-9 * np.abs(alone).max()


def test_gco_is_in_the_units_of_the_data(kr500, campaigns):
    regression = reduce(kr500.vjm, mgco68(kr500.arm), campaigns[0].identification)
    for factor in (1e-6, 1e6):
        scaled = conic.replace(
            regression,
            terms=tuple(conic.replace(t, z=factor * t.z, rest=factor**2 * t.rest) for t in regression.terms),
        )
        assert optimum(scaled).pi == pytest.approx(
            factor * optimum(regression).pi, rel=1e-5, abs=1e-9 * factor
        )


@pytest.mark.parametrize("wrong", [0.99, 1.01, 0.0, np.nan])
def test_a_wrong_answer_is_not_proven_and_the_referee_is_asked(kr500, campaigns, wrong, monkeypatch):
    regression = reduce(kr500.vjm, template56(kr500.arm), campaigns[0].identification)
    program = scale_program(regression)
    own = rescaled(metric(cad_prior(kr500.arm), kr500.vjm, regression.structure), regression)
    right, loose = optimum(regression), gco_with(regression, own, Strength(3.0))
    real, newton = dense.interior, dense.projected_newton
    monkeypatch.setattr(dense, "interior", lambda *args: wrong * real(*args))
    monkeypatch.setattr(
        dense, "projected_newton", lambda *args: (wrong * newton(*args)[0], *newton(*args)[1:])
    )
    [answer] = answers([regression], [program])
    assert answer.dual is not None
    assert answer.pi == pytest.approx(by_clarabel(regression, program).pi)
    assert optimum(regression).f_m == pytest.approx(right.f_m, rel=1e-6)
    again = gco_with(regression, own, Strength(3.0))
    assert again.pi != pytest.approx(loose.pi, rel=1e-12, abs=0)
    assert again.f_m == pytest.approx(loose.f_m, rel=1e-5)
