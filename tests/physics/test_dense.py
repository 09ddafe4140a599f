"""The dense solver against Clarabel as the referee, and what becomes of an answer that is not proven."""

from dataclasses import replace

import numpy as np
import pytest
from agreement import APART, OFF, ROUNDING, WORSE, compared, compared_with_prior, least_squares_off
from programs import NASTY, random_regression, with_random_prior

from testbench.campaign.campaign import Scenario, simulate
from testbench.errors import BenchError
from testbench.identify import cone, dense, reduce
from testbench.identify.conic import answers, by_clarabel, optima, optimum, scale_program
from testbench.identify.metric import Belief, Case, metric, rescaled
from testbench.identify.prior import Strength, cad_prior
from testbench.identify.regression import regression_of
from testbench.identify.regularised import answers as with_prior
from testbench.identify.regularised import fit_each, gco_with, parameters
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
        for found, enough in ((compared(regression), ROUNDING), (compared_with_prior(case), APART)):
            assert found.over <= WORSE
            assert not found.own or found.gap <= enough
        assert least_squares_off(case) <= OFF


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
        terms = tuple(replace(t, z=factor * t.z, rest=factor**2 * t.rest) for t in regression.terms)
        scaled, right = (
            optimum(replace(regression, terms=terms)).C_theta / factor,
            optimum(regression).C_theta,
        )
        size = np.sqrt(np.diag(right))  # an entry of a block is at most the product of two
        assert (np.abs(scaled - right) <= 1e-4 * np.outer(size, size) + 1e-9 * size.max() ** 2).all()


def not_projected(objective, blocks, start):
    return start.x, np.zeros_like(start.x), np.ones(len(start.x), dtype=bool)


def without_a_cone(objective, blocks, bold):
    return np.array(
        [np.linalg.lstsq(R, z, rcond=1e-9)[0] for R, z in zip(objective.R, objective.z, strict=True)]
    )


WRONG = {
    "too small": (lambda x: 0.99 * x),
    "too large": (lambda x: 1.01 * x),
    "nothing": (lambda x: 0.0 * x),
    "not a number": (lambda x: np.nan * x),
    "outside the cone": None,
}


@pytest.mark.parametrize("wrong", WRONG.values(), ids=WRONG)
@pytest.mark.parametrize("structure", [template56, mgco68])
def test_a_wrong_answer_is_not_proven_and_the_referee_is_asked(
    kr500, campaigns, structure, wrong, monkeypatch
):
    regression = reduce(kr500.vjm, structure(kr500.arm), campaigns[0].identification)
    program = scale_program(regression)
    own = rescaled(metric(cad_prior(kr500.arm), kr500.vjm, regression.structure), regression)
    case = Case(regression, Belief(own, Strength(3.0)))
    right, loose = optimum(regression), gco_with(regression, own, case.belief.strength)
    real, newton = dense.interior, dense.projected_newton
    if wrong is None:
        monkeypatch.setattr(dense, "interior", without_a_cone)
        monkeypatch.setattr(dense, "projected_newton", not_projected)
    else:
        monkeypatch.setattr(dense, "interior", lambda *args: wrong(real(*args)))
        monkeypatch.setattr(
            dense, "projected_newton", lambda *args: (wrong(newton(*args)[0]), *newton(*args)[1:])
        )
    [answer] = answers([regression], [program])
    assert answer.dual is not None
    assert answer.pi == pytest.approx(by_clarabel(regression, program).pi)
    assert optimum(regression).f_m == pytest.approx(right.f_m, rel=1e-6)
    assert not with_prior("psd", [case])[0].own
    again = gco_with(regression, own, case.belief.strength)
    assert again.conservative
    assert again.f_m == pytest.approx(loose.f_m, rel=1e-5)


def test_datasets_of_unlike_shape_are_told_apart(kr500, campaigns):
    """Structures, terms that are shared and terms that are not, in one list."""
    whole, part = (reduce(kr500.vjm, s(kr500.arm), campaigns[0].identification) for s in (mgco68, mgco47))
    [term] = whole.terms
    other = replace(term, R=3 * term.R, z=3 * term.z)
    mixed = [
        whole,
        regression_of(whole.structure, (term, other)),
        part,
        regression_of(whole.structure, (term, term)),
    ]
    for regression, answer in zip(mixed, answers(mixed, [scale_program(r) for r in mixed]), strict=True):
        assert answer.dual is None
        assert answer.pi == pytest.approx(
            optimum(regression).pi, rel=1e-6, abs=1e-6 * optimum(regression).pi.max()
        )
    assert answers([], []) == []
    assert with_prior("psd", []) == []


def test_a_prior_for_some_of_the_datasets_is_refused(kr500, campaigns):
    regression = reduce(kr500.vjm, mgco47(kr500.arm), campaigns[0].identification)
    own = metric(cad_prior(kr500.arm), kr500.vjm, regression.structure)
    with pytest.raises(BenchError, match="one for every dataset or none"):
        fit_each([regression] * 2, "psd", [Belief(own, Strength(0.3)), None])
