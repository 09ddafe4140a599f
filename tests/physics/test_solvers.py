"""Solvers against Clarabel, Clarabel against closed forms; the certificate against whoever would fool it."""

from dataclasses import replace

import numpy as np
import pytest
from agreement import APART, OFF, WORSE, compared, least_squares_off
from programs import NASTY, random_prior, random_regression

from testbench import BenchError, Scenario, build_cell, deflections, simulate
from testbench.data.dataset import select_rows
from testbench.identify import cone, conic, interior
from testbench.identify.conic import (
    certify,
    default_trace_bounds,
    gradient_dual,
    lower_bound_certificate,
    tie_break_penalty,
    total_trace,
    trace_units,
)
from testbench.identify.estimate import Dual, make_estimate
from testbench.identify.method import least_squares, paper_gco
from testbench.identify.prior import (
    PriorUncertainty,
    WeightedPrior,
    cad_prior,
    rescale_to_data,
    scale_by_prior,
)
from testbench.identify.regression import ResidualTerm, f_m, reduce, regression_from_terms
from testbench.identify.solve import solve, solve_with_prior
from testbench.model.structure import Structure, all153, mgco47, mgco68, template56
from testbench.plant.true_arms import FAMILY_TRUE_ARMS
from testbench.workflows.campaign import true_cell

STRENGTHS = (1e-6, 0.01, 0.3, 2.0, 30.0, 1e3)


@pytest.fixture(scope="module")
def campaign(kr500):
    return simulate(kr500, Scenario(arm=kr500.arm.name, workspace_poses=1), 11)


@pytest.mark.parametrize("kind", ["kind", *NASTY])
def test_no_answer_costs_more_than_the_referees_nor_is_proven_worse(kind, rng):
    """With a prior, where ours is proven or the referee's is taken, and without one."""
    own = 0
    for uncertainty in STRENGTHS:
        regression = random_regression(kind, rng)
        weighted_prior = random_prior(regression.structure, uncertainty, rng)
        found = compared(regression, weighted_prior)
        own += found.own
        assert found.over <= WORSE
        assert not found.own or found.gap <= APART
        assert least_squares_off(regression, weighted_prior) <= OFF
        penalty = tie_break_penalty(regression)
        program = conic.scaled_gco_program(regression, penalty)
        answers = (
            conic.solve_gco_by_interior_point(regression, program),
            conic.solve_gco_by_clarabel(regression, program),
        )
        if answers[0] is not None:
            trace = [penalty.trace_gradient @ a.pi for a in answers]
            cost = [f_m(regression, a.pi) + t for a, t in zip(answers, trace, strict=True)]
            assert cost[0] <= cost[1] + WORSE * program.f_m_unit
    assert own >= 5 or kind != "kind"  # of random ones 97 of 100 are proven


WITHOUT_NOISE = ("arm_6r", all153, "nonlinear", 1010), ("ur10", mgco68, "linear", 1005)


def told_again(cell, structure, campaign, rng):
    """Fits of the same readings with other last digits and in other orders."""
    for k in range(4):
        data = campaign.identification
        after = data.after * (1 + 1e-15) ** (k % 2) * (1 + 2e-16 * k * rng.standard_normal(data.after.shape))
        changed = select_rows(replace(data, after=after), rng.permutation(data.n_runs))
        yield conic.solve_gco(reduce(cell.vjm, structure(cell.arm), changed))


def test_the_last_digits_of_readings_move_no_prediction(kr500, campaign, rng):
    """What no reading shows is held by the trace term alone: the referee lets it move by micrometres."""
    told = [deflections(kr500.vjm, own, campaign.truth) for own in told_again(kr500, all153, campaign, rng)]
    assert np.ptp(told, axis=0).max() < 2e-7


@pytest.mark.parametrize(("name", "structure", "truth", "seed"), WITHOUT_NOISE)
def test_without_noise_last_digits_of_readings_do_not_change_what_is_said(name, structure, truth, seed, rng):
    """Of some of these readings Clarabel proves nothing: least squares are taken."""
    cell, asked = build_cell(name), Scenario(arm=name, workspace_poses=1, truth=truth, noise=False)
    for found in told_again(cell, structure, simulate(cell, asked, seed), rng):
        assert found.status == "solved"
        unit = f_m(found.regression, np.zeros(found.structure.n_parameters))
        assert found.f_m < 1e-5 * unit
        squares = conic.solve_noise_free_gco(
            found.regression, conic.scaled_gco_program(found.regression, found.penalty)
        )
        assert f_m(found.regression, squares) < 1e-8 * unit


@pytest.mark.parametrize(("off", "status"), [(1e-9, "solved"), (1e-2, "worse")])
def test_what_is_not_near_enough_is_not_called_solved(kr500, campaign, off, status, monkeypatch):
    regression = reduce(kr500.vjm, mgco68(kr500.arm), campaign.identification)
    own = conic.solve_gco_by_clarabel(
        regression, conic.scaled_gco_program(regression, tie_break_penalty(regression))
    )
    far = replace(own, pi=(1 + off) * own.pi, failure="worse")
    monkeypatch.setattr(conic, "solve_gco_by_interior_point", lambda *args: None)
    monkeypatch.setattr(conic, "solve_gco_by_clarabel", lambda *args: far)
    monkeypatch.setattr(conic, "solve_noise_free_gco", lambda *args: far.pi)
    assert conic.solve_gco(regression).status == status


@pytest.mark.parametrize(
    ("structure", "wrong"), [(template56, 1.01), *((mgco68, x) for x in (0.99, 1.01, 0.0, np.nan, None))]
)
def test_a_wrong_answer_is_not_proven_and_the_referee_is_asked(
    kr500, campaign, structure, wrong, monkeypatch
):
    """Too small, too large, nothing, not a number, outside the cone."""
    regression = reduce(kr500.vjm, structure(kr500.arm), campaign.identification)
    own = rescale_to_data(scale_by_prior(cad_prior(kr500.arm), kr500.vjm, regression.structure), regression)
    weighted_prior = WeightedPrior(own, PriorUncertainty(3.0))
    right, sound = solve(regression, "psd", weighted_prior), interior.solve_program
    size = -1.0 if wrong is None else wrong

    def wrongly(program):
        found = sound(program)
        return replace(found, x=size * found.x)

    monkeypatch.setattr(interior, "solve_program", wrongly)
    assert not solve_with_prior("psd", regression, weighted_prior).by_our_solver
    again = solve(regression, "psd", weighted_prior)
    assert again.conservative
    assert again.f_m == pytest.approx(right.f_m, rel=1e-5)


def symmetric(rng, n):
    A = rng.standard_normal((n, n))
    return A + A.T


def nearest(z, orders, svecs):
    """min |v - z| over v; the unknowns are the distance, then v."""
    cost = np.r_[1.0, np.zeros(len(z))]
    norm = cone.norm_constraint(0, np.eye(len(z), 1 + len(z), 1), z)
    psd = cone.psd_constraints(orders, np.c_[np.zeros(len(svecs)), svecs])
    return cone.solve(cone.ConeProgram(cost, (norm, *psd)))


def test_the_nearest_psd_matrices_lack_negative_eigenvalues_and_entries_that_their_block_lacks(rng):
    """The second has a diagonal and one off-diagonal entry of 3 x 3: a 2 x 2 block and a number."""
    A, B = symmetric(rng, 4), symmetric(rng, 3)
    found = nearest(np.r_[cone.svec(A), cone.svec(B)], (4, 3), np.eye(16))
    assert found.status == "solved"
    expected = np.r_[cone.svec(cone.nearest_psd(A)), cone.svec(cone.nearest_psd(B))]
    np.testing.assert_allclose(found.unknowns[1:], expected, atol=1e-6)
    lost = [np.minimum(np.linalg.eigvalsh(M), 0) for M in (A, B)]
    assert found.cost == pytest.approx(np.linalg.norm(np.concatenate(lost)), rel=1e-8)
    assert found.lower_bound == pytest.approx(found.cost, rel=1e-8)
    z = np.array([1.0, -2.0, 3.0, 4.0])  # X_00, X_11, X_22, X_01
    places = np.zeros((6, 4))
    places[[0, 2, 5, 1], [0, 1, 2, 3]] = 1, 1, 1, np.sqrt(2)
    found = nearest(z, (3,), places)
    x = found.unknowns[1:]
    X = np.array([[x[0], x[3], 0], [x[3], x[1], 0], [0, 0, x[2]]])
    assert np.linalg.eigvalsh(X)[0] > -1e-7
    assert x[2] == pytest.approx(3.0, abs=1e-6)
    assert np.linalg.det(X[:2, :2]) == pytest.approx(0, abs=1e-6)  # on the boundary


def test_what_cannot_be_is_not_called_solved():
    apart = tuple(cone.ConeConstraint("nonnegative", sign * np.eye(1), np.array([-1.0])) for sign in (1, -1))
    found = cone.solve(cone.ConeProgram(np.ones(1), apart))  # x <= -1 and x >= 1
    assert found.status == f"not solved: Clarabel says {found.solver_status}"
    assert "nfeasible" in found.solver_status


SLACK = 1e-12  #: Of F_M at C = 0, for the arithmetic of this file.


def gravity(cell, seed, **options):
    return simulate(cell, Scenario(arm=cell.arm.name, workspace_poses=1, **options), seed).identification


def at_rest(regression):
    """F_M at C = 0."""
    return f_m(regression, np.zeros(regression.structure.n_parameters))


def by_hand(regression, pi):
    return make_estimate(regression, pi, method="by hand")


def traces(structure, pi):
    """Of every block in scaled units."""
    diagonal = np.diag(structure.C_theta_of(pi)) / trace_units(structure) ** 2
    return np.array([diagonal[block].sum() for block in structure.blocks])


def best_within(regression, t):
    """The model of least F_M within traces: another program, without a trace weight, by another solver."""
    program = conic.scaled_gco_program(regression, tie_break_penalty(regression))
    s, count = program.observed_structure, len(regression.terms)
    of_block = {tuple(block): most for block, most in zip(regression.structure.blocks, t, strict=True)}
    room = np.zeros((len(s.blocks), count + s.n_parameters))
    for k, block in enumerate(s.blocks):
        own = np.flatnonzero((s.rows == s.columns) & np.isin(s.rows, block))
        room[k, count + own] = (
            program.parameter_units[own] / trace_units(s)[s.rows[own]] ** 2 / of_block[tuple(block)]
        )
    norms = conic.norm_constraints(program.R, program.z, program.unexplained)
    found = cone.solve(
        cone.ConeProgram(
            cost=np.r_[np.ones(count), np.zeros(s.n_parameters)],
            constraints=(
                *norms,
                cone.ConeConstraint("nonnegative", room, np.ones(len(room))),
                *program.psd_constraints(count),
            ),
        )
    )
    return program.to_pi(found.unknowns[count:], regression.structure.n_parameters)


def refuted(regression, certificate, cost, pi):
    """By how much a model within the bounds is better than a certificate of this F_M allows."""
    weight, s = tie_break_penalty(regression).weight, regression.structure
    own, other = (f_m(regression, p) for p in (cost, pi))
    program = weight * (total_trace(s, cost) - total_trace(s, pi))
    return max(
        own - other - certificate.f_m_excess_bound, own - other + program - certificate.duality_gap
    ) / at_rest(regression)


@pytest.mark.parametrize("kind", ["kind", *NASTY])
def test_random_and_nasty_datasets_do_not_fool_it(kind, rng):
    """Zero columns, rank one, no noise, readings against the loads; duals of their own and random ones."""
    within = 0
    for _ in range(4):
        regression = random_regression(kind, rng)
        s, best = regression.structure, conic.solve_gco(regression)
        others, t = [best.pi, 0 * best.pi], best.certificate.trace_bounds
        least = best_within(regression, t)
        if (traces(s, least) <= t * (1 + 1e-6)).all():  # Clarabel solves most of them
            others, within = [least, *others], within + 1
        y = rng.standard_normal((len(regression.terms), s.n_parameters + 1))
        y /= np.linalg.norm(y, axis=1)[:, None]
        for estimate in (best, by_hand(regression, 0 * best.pi), by_hand(regression, 2 * best.pi)):
            for dual in (None, best.certificate.dual, Dual(y[:, :-1], y[:, -1])):
                dual = dual or gradient_dual(regression, estimate.pi)
                found = lower_bound_certificate(
                    regression, estimate.pi, dual, t, penalty=tie_break_penalty(regression)
                )
                for other in others:
                    slack = 1e-9 if other is least else SLACK  # what Clarabel leaves of its constraints
                    assert refuted(regression, found, estimate.pi, other) <= slack
    assert within >= 2


def test_a_dual_longer_than_one_would_prove_too_much_and_is_refused(kr500):
    best = paper_gco(kr500.vjm, mgco68(kr500.arm), gravity(kr500, 2))
    regression, known = best.regression, best.certificate
    longer = Dual(1.001 * known.dual.y, 1.001 * known.dual.y_unexplained)
    poor = by_hand(regression, 0.5 * best.pi)
    fooled = lower_bound_certificate(
        regression, poor.pi, longer, known.trace_bounds, penalty=tie_break_penalty(regression)
    )  # no door, so that the door is needed
    assert refuted(regression, fooled, poor.pi, best.pi) > 1e-6
    with pytest.raises(BenchError, match=r"dual: expected vectors of length 1 at most, got one of 1\.001"):
        certify(poor, dual=longer)


def test_duals_that_are_none_and_models_that_are_not_conservative_are_refused_in_one_line(kr500):
    best = paper_gco(kr500.vjm, mgco47(kr500.arm), gravity(kr500, 2))
    broken = least_squares(kr500.vjm, template56(kr500.arm), gravity(kr500, 2))
    y, rest = best.certificate.dual.y, best.certificate.dual.y_unexplained
    for estimate, wrong, text in (
        (best, Dual(y[:, :-1], rest), "dual.y: expected"),
        (best, Dual(y, np.r_[rest, 0.0]), "dual.y_unexplained: expected"),
        (best, Dual(y * np.nan, rest), "dual.y: .*finite"),
        (best, Dual(y, rest + np.inf), "dual.y_unexplained: .*finite"),
        (best, Dual(y, rest + 0.5), "length 1 at most"),  # each part is shorter than one by itself
        (broken, None, "expected a conservative estimate"),
    ):
        with pytest.raises(BenchError, match=text) as told:
            certify(estimate, dual=wrong)
        assert "\n" not in str(told.value)


@pytest.mark.parametrize("name", FAMILY_TRUE_ARMS)
def test_true_arms_of_every_kind_lie_within_the_default_bounds(kr500, name):
    """What is assumed of several axes at once holds where the truth is known."""
    cell, s = true_cell(kr500, name, 5), all153(kr500.arm)
    regression = reduce(cell.vjm, s, gravity(cell, 1))
    bounds = default_trace_bounds(regression, np.zeros(s.n_parameters))
    assert (traces(s, s.parameters_of(cell.plant.arm.C_theta)) <= bounds).all()


@pytest.mark.parametrize("shown", [1.0, 1e-3, 1e-11])
def test_an_axis_that_the_data_hardly_show_may_explain_all_of_them(shown):
    """Noise-free readings of one axis: twice its compliance fits as well as a rigid arm, and is the bound."""
    s = Structure("two axes", 2, np.arange(2), np.arange(2), ("one", "other"))
    R, truth = np.diag([1.0, shown]), np.array([0.0, 7.0 / shown])
    regression = regression_from_terms(s, (ResidualTerm(R, R @ truth, 0.0, 6),))
    assert f_m(regression, 2 * truth) == pytest.approx(at_rest(regression))
    assert default_trace_bounds(regression, np.zeros(2))[1] == pytest.approx(2 * truth[1])
    stiff = by_hand(regression, np.zeros(2))
    assert certify(stiff).f_m_excess_bound >= stiff.f_m * (1 - SLACK)  # the truth has an F_M of zero
    best = conic.solve_gco(regression)
    assert refuted(regression, best.certificate, best.pi, truth) <= SLACK
