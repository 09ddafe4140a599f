"""The certificate against whoever would fool it: no conservative model is better than it says.

All bounds hold up to rounding: SLACK of F_M at C = 0 for the arithmetic of this file.
"""

from dataclasses import replace

import numpy as np
import pytest
from programs import NASTY, random_regression

from testbench.campaign.campaign import Scenario, simulate
from testbench.errors import BenchError
from testbench.identify import certify, cone, gco, least_squares, make_estimate
from testbench.identify.certify import (
    bound,
    default_trace_bounds,
    gradient_dual,
    scaled_units,
    total_trace,
    trace_weight,
)
from testbench.identify.conic import norms_below, optimum, psd_blocks, scale_program
from testbench.identify.estimate import Dual
from testbench.identify.fold import reduce
from testbench.identify.regression import Term, f_m, regression_of
from testbench.model.structure import Structure, mgco47, mgco68, mgco147, template56

SLACK = 1e-12
STRUCTURES = (mgco47, template56, mgco68, mgco147)


def gravity(cell, seed, **options):
    return simulate(cell, Scenario(arm=cell.arm.name, workspace_poses=1, **options), seed).identification


def at_rest(regression):
    """F_M at C = 0."""
    return f_m(regression, np.zeros(regression.structure.n))


def by_hand(regression, pi):
    return make_estimate(regression, pi, method="by hand")


def traces(structure, pi):
    """Of every block in scaled units."""
    diagonal = np.diag(structure.matrix(pi)) / scaled_units(structure) ** 2
    return np.array([diagonal[block].sum() for block in structure.blocks])


def random_within(structure, t, rng):
    """A conservative model of any rank whose blocks have traces between nothing and all of their bounds."""
    unit, C = scaled_units(structure), np.zeros((structure.n_theta,) * 2)
    for block, most in zip(structure.blocks, t, strict=True):
        V = rng.standard_normal((rng.integers(1, len(block) + 1), len(block))) * unit[block]
        X = V.T @ V
        size = (np.diag(X) / unit[block] ** 2).sum()
        C[np.ix_(block, block)] = rng.choice([0.0, 1.0, 10 ** rng.uniform(-4, 0)]) * most / size * X
    return structure.entries(C)


def against_the_proof(structure, dual, regression, t):
    """The model that the proof fears most: all of a bound along the worst direction of its S_i."""
    unit = scaled_units(structure)
    g = sum(term.R.T @ y for term, y in zip(regression.terms, dual.y, strict=True))
    S, C = structure.gradient(g) * np.outer(unit, unit), np.zeros((structure.n_theta,) * 2)
    for block, most in zip(structure.blocks, t, strict=True):
        v = np.linalg.eigh(S[np.ix_(block, block)])[1][:, 0] * unit[block]
        C[np.ix_(block, block)] = most * np.outer(v, v)
    return structure.entries(C)


def best_within(regression, t):
    """The model of least F_M within traces: another program, without a trace weight, by another solver."""
    program = scale_program(regression)
    s, count = program.structure, len(regression.terms)
    of_block = {tuple(block): most for block, most in zip(regression.structure.blocks, t, strict=True)}
    room = np.zeros((len(s.blocks), count + s.n))
    for k, block in enumerate(s.blocks):
        own = np.flatnonzero((s.a == s.b) & np.isin(s.a, block))
        room[k, count + own] = program.scale[own] / scaled_units(s)[s.a[own]] ** 2 / of_block[tuple(block)]
    norms = norms_below(program.R, program.z, program.rest)
    found = cone.solve(
        cone.Problem(
            cost=np.r_[np.ones(count), np.zeros(s.n)],
            blocks=(cone.free_block(0, count), *psd_blocks(s, count)),
            rows=(*norms, cone.Rows("nonnegative", room, np.ones(len(room)))),
        )
    )
    return program.parameters(found.x[count:], regression.structure.n)


def refuted(regression, certificate, cost, pi):
    """By how much a model within the bounds is better than a certificate of this F_M allows."""
    weight, s = trace_weight(regression), regression.structure
    own, other = (f_m(regression, p) for p in (cost, pi))
    program = weight * (total_trace(s, cost) - total_trace(s, pi))
    return max(
        own - other - certificate.f_m_excess_bound, own - other + program - certificate.duality_gap
    ) / at_rest(regression)


@pytest.mark.parametrize("share", [0.01, 1.0])
@pytest.mark.parametrize("structure", STRUCTURES)
def test_not_even_the_best_model_within_the_bounds_beats_it(kr500, structure, share):
    """It does better than the optimum of the weighted program, so that there is something to refute."""
    regression = reduce(kr500.vjm, structure(kr500.arm), gravity(kr500, 6))
    found = optimum(regression)
    t = share * default_trace_bounds(regression, found.pi)
    certificate = bound(regression, found.pi, found.certificate.dual, t)
    best = best_within(regression, t)
    assert (traces(found.structure, best) <= t * (1 + 1e-6)).all()
    assert refuted(regression, certificate, found.pi, best) <= 1e-9  # what Clarabel leaves of its constraints
    if share == 1.0:
        assert f_m(regression, best) < found.f_m


@pytest.mark.parametrize("kind", ["kind", *NASTY])
def test_random_and_nasty_datasets_do_not_fool_it(kind, rng):
    """Zero columns, rank one, no noise, readings against the loads; duals of their own and random ones."""
    for _ in range(8):
        regression = random_regression(kind, rng)
        s, best = regression.structure, optimum(regression)
        estimates = [best, by_hand(regression, 0 * best.pi), by_hand(regression, 2 * best.pi)]
        y = rng.standard_normal((len(regression.terms), s.n + 1))
        y /= np.linalg.norm(y, axis=1)[:, None]
        for estimate in estimates:
            for dual in (None, best.certificate.dual, Dual(y[:, :-1], y[:, -1])):
                dual = dual or gradient_dual(regression, estimate.pi)
                found = bound(regression, estimate.pi, dual, best.certificate.trace_bounds)
                worst = against_the_proof(s, found.dual, regression, found.trace_bounds)
                others = [random_within(s, found.trace_bounds, rng) for _ in range(10)]
                for other in [*others, worst, best.pi, 0 * best.pi]:
                    assert refuted(regression, found, estimate.pi, other) <= SLACK


def test_a_dual_longer_than_one_would_prove_too_much_and_is_refused(kr500):
    best = gco(kr500.vjm, mgco68(kr500.arm), gravity(kr500, 2))
    regression, known = best.regression, best.certificate
    longer = Dual(1.001 * known.dual.y, 1.001 * known.dual.y_rest)
    poor = by_hand(regression, 0.5 * best.pi)
    fooled = bound(regression, poor.pi, longer, known.trace_bounds)  # no door, so that the door is needed
    assert refuted(regression, fooled, poor.pi, best.pi) > 1e-6
    with pytest.raises(BenchError, match=r"dual: expected vectors of length 1 at most, got one of 1\.001"):
        certify(poor, dual=longer)
    rest = replace(known.dual, y_rest=known.dual.y_rest + 0.5)  # each part is shorter than one by itself
    with pytest.raises(BenchError, match="length 1 at most"):
        certify(poor, dual=rest)


def test_duals_that_are_none_and_models_that_are_not_conservative_are_refused_in_one_line(kr500):
    best = gco(kr500.vjm, mgco47(kr500.arm), gravity(kr500, 2))
    y, rest = best.certificate.dual.y, best.certificate.dual.y_rest
    for wrong, text in (
        (Dual(y[:, :-1], rest), "dual.y: expected"),
        (Dual(y, np.r_[rest, 0.0]), "dual.y_rest: expected"),
        (Dual(y * np.nan, rest), "dual.y: .*finite"),
        (Dual(y, rest + np.inf), "dual.y_rest: .*finite"),
    ):
        with pytest.raises(BenchError, match=text) as told:
            certify(best, dual=wrong)
        assert "\n" not in str(told.value)
    broken = least_squares(kr500.vjm, template56(kr500.arm), gravity(kr500, 2))
    assert not broken.conservative
    with pytest.raises(BenchError, match="expected a conservative estimate"):
        certify(broken)


@pytest.mark.parametrize("shown", [1.0, 1e-3, 1e-11])
def test_an_axis_that_the_data_hardly_show_may_explain_all_of_them(shown):
    """Noise-free readings of one axis: twice its compliance fits as well as a rigid arm, and is the bound."""
    s = Structure("two axes", 2, np.arange(2), np.arange(2), ("one", "other"))
    R, truth = np.diag([1.0, shown]), np.array([0.0, 7.0 / shown])
    regression = regression_of(s, (Term(R, R @ truth, 0.0, 6),))
    assert f_m(regression, 2 * truth) == pytest.approx(at_rest(regression))
    assert default_trace_bounds(regression, np.zeros(2))[1] == pytest.approx(2 * truth[1])
    stiff = by_hand(regression, np.zeros(2))
    assert certify(stiff).f_m_excess_bound >= stiff.f_m * (1 - SLACK)  # the truth has an F_M of zero
    best = optimum(regression)
    assert refuted(regression, best.certificate, best.pi, truth) <= SLACK
