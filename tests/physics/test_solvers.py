"""Our solver against Clarabel, this against closed forms; unproven answers, and data without noise."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from agreement import APART, OFF, WORSE, compared, least_squares_off
from programs import NASTY, random_regression, with_random_prior

from testbench.campaign.campaign import Scenario, build_cell, simulate
from testbench.data.dataset import in_order
from testbench.identify import cone, conic, projected, reduce
from testbench.identify.certify import total_trace, trace_weight
from testbench.identify.conic import by_clarabel, by_interior, by_squares, optimum, scale_program
from testbench.identify.evaluate import deflections
from testbench.identify.metric import Belief, Case, metric, rescaled
from testbench.identify.prior import Strength, cad_prior
from testbench.identify.regression import f_m
from testbench.identify.solve import answer, solve
from testbench.model.structure import all153, mgco68, template56

MODELS = Path(__file__).parents[2] / "models"
STRENGTHS = (1e-6, 0.01, 0.3, 2.0, 30.0, 1e3)


@pytest.fixture(scope="module")
def campaigns(kr500):
    return [simulate(kr500, Scenario(arm=kr500.arm.name, workspace_poses=1), seed) for seed in (11, 12, 13)]


@pytest.mark.parametrize("kind", ["kind", *NASTY])
def test_no_answer_costs_more_than_the_referees_nor_is_proven_worse(kind, rng):
    own = 0
    for k in range(8):
        case = with_random_prior(random_regression(kind, rng), STRENGTHS[k % len(STRENGTHS)], rng)
        found = compared(case)
        own += found.own
        assert found.over <= WORSE
        assert not found.own or found.gap <= APART
        assert least_squares_off(case) <= OFF
    assert own >= 6 or kind != "kind"  # of random ones 97 of 100 are proven


@pytest.mark.parametrize("kind", ["kind", *NASTY])
def test_our_interior_points_cost_no_more_than_the_referees(kind, rng):
    for _ in range(8):
        regression = random_regression(kind, rng)
        program = scale_program(regression)
        own, referee = by_interior(regression, program), by_clarabel(regression, program)
        if own is not None:
            cost = [f_m(regression, a.pi) + traces(regression, a.pi) for a in (own, referee)]
            assert cost[0] <= cost[1] + WORSE * program.unit


def traces(regression, pi):
    return trace_weight(regression) * total_trace(regression.structure, pi)


def test_the_last_digits_of_readings_move_no_prediction(kr500, campaigns, rng):
    """What no reading shows is held by the trace term alone: the referee lets it move by micrometres."""
    for run in campaigns:
        told = []
        for k in range(4):
            after = run.identification.after
            after = after * (1 + 2e-16 * k * rng.standard_normal(after.shape))
            estimate = optimum(reduce(kr500.vjm, all153(kr500.arm), replace(run.identification, after=after)))
            told.append(deflections(kr500.vjm, estimate, run.truth))
        assert np.ptp(told, axis=0).max() < 2e-7


WITHOUT_NOISE = (
    ("arm_6r", all153, "linear", 1005),
    ("arm_6r", all153, "nonlinear", 1010),
    ("ur10", mgco68, "linear", 1005),
    ("ur10", mgco68, "nonlinear", 1011),
)


@pytest.mark.parametrize(("name", "structure", "truth", "seed"), WITHOUT_NOISE)
def test_without_noise_the_last_digits_of_readings_do_not_change_what_is_said(
    name, structure, truth, seed, rng
):
    """Of some of these readings Clarabel proves nothing: least squares are taken."""
    cell = build_cell(MODELS / name)
    data = simulate(
        cell, Scenario(arm=name, workspace_poses=1, truth=truth, noise=False), seed
    ).identification
    for k in range(4):
        after = data.after * (1 + 1e-15) ** (k % 2) * (1 + 2e-16 * k * rng.standard_normal(data.after.shape))
        changed = in_order(replace(data, after=after), rng.permutation(data.runs))
        found = optimum(reduce(cell.vjm, structure(cell.arm), changed))
        assert found.status == "solved"
        unit = f_m(found.regression, np.zeros(found.structure.n))
        assert found.f_m < 1e-5 * unit
        squares = by_squares(found.regression, scale_program(found.regression))
        assert f_m(found.regression, squares) < 1e-8 * unit


@pytest.mark.parametrize(("off", "status"), [(1e-9, "solved"), (1e-2, "worse")])
def test_what_is_not_near_enough_is_not_called_solved(kr500, campaigns, off, status, monkeypatch):
    regression = reduce(kr500.vjm, mgco68(kr500.arm), campaigns[0].identification)
    own = by_clarabel(regression, scale_program(regression))
    far = replace(own, pi=(1 + off) * own.pi, failure="worse")
    monkeypatch.setattr(conic, "by_interior", lambda *args: None)
    monkeypatch.setattr(conic, "by_clarabel", lambda *args: far)
    monkeypatch.setattr(conic, "by_squares", lambda *args: far.pi)
    assert optimum(regression).status == status


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
    own = rescaled(metric(cad_prior(kr500.arm), kr500.vjm, regression.structure), regression)
    belief = Belief(own, Strength(3.0))
    right, squares = solve(regression, "psd", belief), projected.follow
    if wrong is None:
        monkeypatch.setattr(projected, "follow", not_projected)
    else:
        monkeypatch.setattr(projected, "follow", lambda *args: (wrong(squares(*args)[0]), squares(*args)[1]))
    assert not answer("psd", Case(regression, belief)).own
    again = solve(regression, "psd", belief)
    assert again.conservative
    assert again.f_m == pytest.approx(right.f_m, rel=1e-5)


def symmetric(rng, n):
    A = rng.standard_normal((n, n))
    return A + A.T


def nearest(z, blocks):
    """min |v - z| over v; the unknowns are the distance, then v."""
    cost = np.r_[1.0, np.zeros(len(z))]
    rows = (cone.norm_below(0, np.eye(len(z), 1 + len(z), 1), z),)
    return cone.solve(cone.Problem(cost, (cone.free_block(0, 1), *blocks), rows))


@pytest.mark.parametrize("n", [1, 2, 6])
def test_svec_keeps_lengths_and_smat_takes_it_back(rng, n):
    X = np.array([symmetric(rng, n) for _ in range(3)])
    x = cone.svec(X)
    assert x.shape == (3, cone.triangle(n))
    np.testing.assert_allclose(np.linalg.norm(x, axis=1), np.linalg.norm(X, axis=(1, 2)), rtol=1e-14)
    np.testing.assert_allclose(cone.smat(x), X, rtol=1e-15)
    assert cone.order(x.shape[1]) == n
    A = rng.standard_normal((n, n))
    np.testing.assert_allclose(x @ cone.congruence(A).T, cone.svec(A @ X @ A.T), rtol=1e-12, atol=1e-12)


def test_the_nearest_psd_matrices_are_those_without_negative_eigenvalues(rng):
    A, B = symmetric(rng, 4), symmetric(rng, 3)
    found = nearest(np.r_[cone.svec(A), cone.svec(B)], cone.psd_blocks(1, (4, 3)))
    assert found.status == "solved"
    expected = np.r_[cone.svec(cone.psd_part(A)), cone.svec(cone.psd_part(B))]
    np.testing.assert_allclose(found.x[1:], expected, atol=1e-6)
    lost = [np.minimum(np.linalg.eigvalsh(M), 0) for M in (A, B)]
    assert found.cost == pytest.approx(np.linalg.norm(np.concatenate(lost)), rel=1e-8)
    assert found.bound == pytest.approx(found.cost, rel=1e-8)


def test_a_block_that_lacks_entries_keeps_them_zero(rng):
    """Diagonal and one off-diagonal entry of a 3 x 3 matrix: a 2 x 2 block and a number."""
    z = np.array([1.0, -2.0, 3.0, 4.0])  # X_00, X_11, X_22, X_01
    places = np.zeros((6, 4))
    places[[0, 2, 5, 1], [0, 1, 2, 3]] = 1, 1, 1, np.sqrt(2)
    found = nearest(z, (cone.Block(1 + np.arange(4), 3, places),))
    x = found.x[1:]
    X = np.array([[x[0], x[3], 0], [x[3], x[1], 0], [0, 0, x[2]]])
    assert np.linalg.eigvalsh(X)[0] > -1e-7
    assert x[2] == pytest.approx(3.0, abs=1e-6)
    assert np.linalg.det(X[:2, :2]) == pytest.approx(0, abs=1e-6)  # on the boundary


def test_what_cannot_be_is_not_called_solved():
    one = np.eye(1)
    apart = (
        cone.Rows("nonnegative", one, np.array([-1.0])),
        cone.Rows("nonnegative", -one, np.array([-1.0])),
    )
    found = cone.solve(cone.Problem(np.ones(1), (cone.free_block(0, 1),), apart))  # x <= -1 and x >= 1
    assert found.status == f"not solved: Clarabel says {found.word}"
    assert "nfeasible" in found.word
