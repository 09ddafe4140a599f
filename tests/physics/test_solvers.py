"""Our solvers against Clarabel as the referee, without a prior and with, and answers that are not proven."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from agreement import APART, OFF, ROUNDING, WORSE, compared, compared_with_prior, least_squares_off
from programs import NASTY, random_regression, with_random_prior

from testbench.campaign.campaign import Scenario, build_cell, simulate
from testbench.data.dataset import in_order
from testbench.errors import BenchError
from testbench.identify import cone, conic, interior, projected, reduce
from testbench.identify.conic import answers, by_clarabel, optima, optimum, scale_program
from testbench.identify.interior import least_norms
from testbench.identify.metric import Belief, Case, metric, rescaled
from testbench.identify.prior import Strength, cad_prior
from testbench.identify.regression import f_m, regression_of
from testbench.identify.regularised import answer, fit_each, gco_with
from testbench.model.structure import all153, mgco47, mgco68, template56

MODELS = Path(__file__).parents[2] / "models"
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


def test_of_plain_datasets_none_needs_the_referee(rng):
    assert all(compared(random_regression("kind", rng)).own for _ in range(12))


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


@pytest.mark.parametrize("seed", [1010, 1014, 1025])
@pytest.mark.parametrize("truth", ["linear", "nonlinear"])
def test_without_noise_the_last_digits_of_readings_do_not_change_what_is_said(arm_6r, seed, truth, rng):
    """What is proven then has no digits to spare."""
    scenario = Scenario(arm=arm_6r.arm.name, workspace_poses=1, truth=truth, noise=False)
    data = simulate(arm_6r, scenario, seed).identification
    for k in range(5):
        after = data.after * (1 + (2e-16 * rng.standard_normal(data.after.shape) if k % 2 else 1e-15))
        again = in_order(
            replace(data, after=after), rng.permutation(data.runs) if k else np.arange(data.runs)
        )
        found = optimum(reduce(arm_6r.vjm, mgco68(arm_6r.arm), again))
        assert found.status == "solved"
        assert found.f_m < 1e-5 * f_m(found.regression, np.zeros(found.structure.n))


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


@pytest.fixture(scope="module")
def without_noise():
    """Programs of noise-free readings, in which steps near no residual at all are wild."""
    cell, taken = build_cell(MODELS / "ur10"), []
    for seed in (1004, 1028, 1049):
        scenario = Scenario(arm="ur10", workspace_poses=1, truth="linear", noise=False)
        regression = reduce(cell.vjm, all153(cell.arm), simulate(cell, scenario, seed).identification)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(conic, "least_norms", lambda *args: taken.append(args[0]) or least_norms(*args))
            answers([regression], [scale_program(regression)])
    return taken


@pytest.mark.parametrize("bold", [interior.BOLD, interior.CAUTIOUS])
def test_no_wild_step_is_kept(without_noise, bold):
    for programs in without_noise:
        norms, _ = programs.at(interior.interior(programs, bold))
        assert norms.sum() < 1e-5


def test_what_a_first_try_does_not_prove_a_second_does(without_noise):
    """The trace term alone costs 3e-8 to 1e-7."""
    assert max(float(least_norms(programs, 0.0)[1][0]) for programs in without_noise) < 1.5e-7


@pytest.mark.parametrize(("off", "status"), [(1e-9, "solved"), (1e-7, "worse")])
def test_what_is_not_near_enough_is_not_called_solved(kr500, campaigns, off, status, monkeypatch):
    regression = reduce(kr500.vjm, mgco68(kr500.arm), campaigns[0].identification)
    [own] = answers([regression], [scale_program(regression)])
    far = replace(own, pi=(1 + off) * own.pi, failure="worse")
    monkeypatch.setattr(conic, "answers", lambda *args: [far])
    assert optimum(regression).status == status


def without_a_cone(programs, bold):
    [term] = programs.terms
    return np.linalg.lstsq(term.R[0], term.z[0], rcond=1e-9)[0][None]


def not_projected(path, start, cost, groups):
    return start.u, np.zeros_like(start.u)


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
    norms, squares = interior.interior, projected.follow
    if wrong is None:
        monkeypatch.setattr(interior, "interior", without_a_cone)
        monkeypatch.setattr(projected, "follow", not_projected)
    else:
        monkeypatch.setattr(interior, "interior", lambda *args: wrong(norms(*args)))
        monkeypatch.setattr(projected, "follow", lambda *args: (wrong(squares(*args)[0]), squares(*args)[1]))
    [found] = answers([regression], [program])
    assert found.dual is not None
    assert found.pi == pytest.approx(by_clarabel(regression, program).pi)
    assert optimum(regression).f_m == pytest.approx(right.f_m, rel=1e-6)
    assert not answer("psd", case).own
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
    for regression, found in zip(mixed, answers(mixed, [scale_program(r) for r in mixed]), strict=True):
        assert found.dual is None
        assert found.pi == pytest.approx(
            optimum(regression).pi, rel=1e-6, abs=1e-6 * optimum(regression).pi.max()
        )
    assert answers([], []) == []


def test_a_prior_for_some_of_the_datasets_is_refused(kr500, campaigns):
    regression = reduce(kr500.vjm, mgco47(kr500.arm), campaigns[0].identification)
    own = metric(cad_prior(kr500.arm), kr500.vjm, regression.structure)
    with pytest.raises(BenchError, match="one for every dataset or none"):
        fit_each([regression] * 2, "psd", [Belief(own, Strength(0.3)), None])
