"""Priors: their metric, what they do to least squares and GCO, how firmly to believe them."""

from dataclasses import replace

import numpy as np
import pytest

from testbench.campaign.campaign import Scenario, simulate
from testbench.data.dataset import select
from testbench.errors import BenchError
from testbench.identify import gco, reduce
from testbench.identify.crossval import (
    Candidate,
    divided,
    unless_beaten,
)
from testbench.identify.metric import Belief, metric, precision_root, rescaled, whitened
from testbench.identify.prior import Prior, Strength, aggregate, cad_prior
from testbench.identify.regression import f_m
from testbench.identify.solve import answer, solve
from testbench.model.structure import Structure, all153, mgco68, mgco147, template56
from testbench.model.vjm import chain, observation
from testbench.studies.estimators.stein import (
    SLACK,
    UNCERTAINTIES,
    choose_strength,
    every_fold,
    gco_least_trace,
    gco_stein,
)


def campaign(cell, seed, **changes):
    return simulate(cell, Scenario(arm="kr500_l480", truth="linear", workspace_poses=50, **changes), seed)


@pytest.fixture(params=[mgco147, all153, mgco68, template56])
def structure(request, kr500):
    return request.param(kr500.arm)


def test_expected_compliance_is_the_prior_and_distances_are_frobenius(kr500, structure, rng):
    own = metric(cad_prior(kr500.arm), kr500.vjm, structure)
    P = aggregate(kr500.arm.C_theta, kr500.vjm, structure)
    np.testing.assert_allclose(own.L @ own.expected, structure.entries(P), rtol=1e-9, atol=1e-20)
    x = rng.standard_normal(structure.n)
    X = own.matrices(x)
    assert sum((block**2).sum() for block in X) == pytest.approx(x @ x, rel=1e-12)
    C = structure.matrix(own.L @ x)
    for block, X_i in zip(structure.blocks, X, strict=True):
        C_i = C[np.ix_(block, block)]
        # a congruence keeps the signs of the eigenvalues (Sylvester)
        assert (np.linalg.eigvalsh(C_i) > 0).sum() == (np.linalg.eigvalsh(X_i) > 0).sum()


@pytest.mark.parametrize("name", ["kr500", "slides"])
def test_joints_left_out_add_to_the_link_before_them(name, request, rng):
    """The paper's aggregation: all links with it predict what all parameters do, in any pose."""
    cell = request.getfixturevalue(name)
    whole, links = all153(cell.arm), mgco147(cell.arm)
    lower, upper = cell.arm.limits
    q, wrench = rng.uniform(lower, upper, (20, cell.arm.n_joints)), rng.standard_normal((20, 6))
    where = chain(cell.vjm, q)
    moved = [
        observation(where, s, wrench, np.zeros((20, 3)), cell.vjm.markers)
        @ s.entries(aggregate(cell.arm.C_theta, cell.vjm, s))
        for s in (whole, links)
    ]
    np.testing.assert_allclose(moved[1], moved[0], rtol=0, atol=1e-9 * np.abs(moved[0]).max())


def test_least_squares_with_a_prior_is_the_ridge_solution(kr500, structure):
    """Against the minimiser of the penalised sum itself, the common scale an unknown of its own."""
    run = campaign(kr500, 1)
    regression = reduce(kr500.vjm, structure, run.identification)
    own = rescaled(metric(cad_prior(kr500.arm), kr500.vjm, structure), regression)
    A, y = whitened(regression, own)
    n, e = structure.n, own.expected
    rows = np.block([[A, np.zeros((len(A), 1))], [2 * np.eye(n), -2 * e[:, None]]])
    x = np.linalg.lstsq(rows, np.r_[y, np.zeros(n)], rcond=None)[0][:n]
    estimate = solve(regression, "none", Belief(own, Strength(0.5)))
    np.testing.assert_allclose(estimate.pi, own.L @ x, rtol=0, atol=1e-7 * np.abs(own.L @ x).max())


@pytest.mark.parametrize("uncertainty", [0.2, 2.0])
def test_gco_with_a_prior_meets_the_optimality_conditions_of_the_cone(kr500, structure, uncertainty):
    """The gradient S of the penalised sum is PSD in every block and orthogonal to X: no model is better."""
    binds = 0
    for seed in (1, 3):
        regression = reduce(kr500.vjm, structure, campaign(kr500, seed).identification)
        own = rescaled(metric(cad_prior(kr500.arm), kr500.vjm, structure), regression)
        strength = Strength(uncertainty)
        estimate = solve(regression, "psd", Belief(own, strength))
        assert estimate.status == "solved"
        assert estimate.conservative
        x = np.linalg.solve(own.L, estimate.pi)
        (A, y), (B, c) = whitened(regression, own), precision_root(own, strength)
        gradient = 2 * A.T @ (A @ x - y) + 2 * B.T @ (B @ x - c)
        # relative to the two halves of the gradient, which cancel inside the cone
        size = np.abs(A.T @ y).max()
        for X, S in zip(own.matrices(x), own.matrices(gradient), strict=True):
            assert np.linalg.eigvalsh(S)[0] > -1e-5 * size
            assert abs((S * X).sum()) < 1e-5 * size * max(1, np.trace(X))
        binds += not solve(regression, "none", Belief(own, strength)).conservative
    if uncertainty > 1 and structure.name != "MGCO68":
        assert binds  # else the cone was never asked for anything


def test_log_det_prior_is_never_singular_and_of_least_cost(kr500):
    run = campaign(kr500, 3)
    structure = template56(kr500.arm)
    regression = reduce(kr500.vjm, structure, run.identification)
    own = rescaled(metric(cad_prior(kr500.arm), kr500.vjm, structure), regression)
    loose = gco_stein(regression, own, Strength(3.0))
    assert loose.status == "solved"
    x = np.linalg.solve(own.L, loose.pi)
    assert min(np.linalg.eigvalsh(X)[0] for X in own.matrices(x)) > 1e-3
    A, y = whitened(regression, own)
    e = own.expected
    scale = np.linalg.solve(own.L, solve(regression, "psd", Belief(own, Strength(3.0))).pi) @ e / (e @ e)

    def cost(x):
        log_det = sum(np.linalg.slogdet(X)[1] for X in own.matrices(x))
        return ((A @ x - y) ** 2).sum() / 2 + (e @ x / scale - log_det) / 3.0**2

    # directions in which the cost is about equally curved: none goes down
    root = np.linalg.cholesky(A.T @ A + np.eye(len(x)) / (3.0 * scale) ** 2)
    steps = 1e-3 * np.linalg.solve(root.T, np.random.default_rng(1).standard_normal((len(x), 40)))
    assert min(cost(x + sign * step) for step in steps.T for sign in (1, -1)) > cost(x)


def test_least_trace_has_less_trace_and_fits_as_well(kr500):
    run, structure = campaign(kr500, 2), mgco68(kr500.arm)
    regression = reduce(kr500.vjm, structure, run.identification)
    own = metric(cad_prior(kr500.arm), kr500.vjm, structure)
    ours, plain = gco_least_trace(regression, own), gco(kr500.vjm, structure, run.identification)
    assert ours.conservative
    assert ours.f_m <= (1 + SLACK) * plain.f_m * (1 + 1e-6)
    traces = [own.expected @ np.linalg.solve(own.L, e.pi) for e in (ours, plain)]
    assert traces[0] < traces[1]


def with_covariances(data, rng):
    A = rng.normal(size=(data.runs, 3, 3, 3))
    P = 1e8 * (A @ A.swapaxes(2, 3) + 0.1 * np.eye(3))
    P[3, 1] = P[4] = 0  # lost targets
    return replace(data, precision=P)


def with_orientations(data, rng):
    before, after = 1e-3 * rng.normal(size=(2, data.runs, 3))
    return replace(data, rotation_before=before, rotation_after=after, sigma_rotation=1e-5)


@pytest.mark.parametrize("read", [lambda data, _: data, with_covariances, with_orientations])
def test_folds_are_whole_poses_reduced_by_themselves_and_cover_all_runs(kr500, rng, read):
    data = read(campaign(kr500, 1).identification, rng)
    structure = template56(kr500.arm)
    folds = every_fold(kr500.vjm, structure, data)
    part = divided(data)
    np.testing.assert_array_equal(part >= 0, data.seen.any(axis=1))
    data, part = select(data, part >= 0), part[part >= 0]
    masks = [np.isin(part, fold.kept) for fold in folds]
    assert (sum(~kept for kept in masks) == 1).all()
    for fold, kept in zip(folds, masks, strict=True):
        assert not set(data.pose[kept]) & set(data.pose[~kept])
        for pi in (np.zeros(structure.n), structure.entries(kr500.arm.C_theta)):
            for found, runs in ((fold.fitted, kept), (fold.held_out, ~kept)):
                alone = reduce(kr500.vjm, structure, select(data, runs))
                assert f_m(found, pi) == pytest.approx(f_m(alone, pi), rel=1e-9)
                assert (found.equations, found.rank) == (alone.equations, alone.rank)


def test_load_levels_are_held_out_whole_where_there_are_several(kr500):
    light, heavy = (campaign(kr500, 1, payload=mass).identification for mass in (200.0, 460.3))
    structure = template56(kr500.arm)
    assert len(every_fold(kr500.vjm, structure, heavy)) == 8
    names = ("run", "pose", "q", "wrench", "point", "before", "after")
    both = replace(heavy, **{k: np.concatenate([getattr(light, k), getattr(heavy, k)]) for k in names})
    folds = every_fold(kr500.vjm, structure, both)
    assert [fold.held_out.equations for fold in folds[8:]] == [9 * light.runs, 9 * heavy.runs]
    turned = np.where(np.arange(heavy.runs)[:, None] % 3 == 0, [0, 0, 0, 0, 40.0, 0], 0.0)
    folds = every_fold(kr500.vjm, structure, replace(heavy, wrench=heavy.wrench + turned))
    some = -(-heavy.runs // 3)
    assert [fold.held_out.equations for fold in folds[8:]] == [9 * (heavy.runs - some), 9 * some]


def test_cross_validation_takes_the_strength_that_predicts_best(kr500):
    data = campaign(kr500, 1).identification
    structure = template56(kr500.arm)
    own = metric(cad_prior(kr500.arm), kr500.vjm, structure)
    folds = every_fold(kr500.vjm, structure, data)
    errors = {}
    for u in UNCERTAINTIES:
        fits = [solve(fold.fitted, "none", Belief(own, Strength(u))).pi for fold in folds]
        errors[u] = np.mean([f_m(fold.held_out, pi) for fold, pi in zip(folds, fits, strict=True)])
    chosen = choose_strength(folds, own, lambda case: answer("none", case).pi)
    assert chosen.uncertainty == min(errors, key=errors.get)


def test_a_model_stays_unless_beaten_fold_by_fold_by_more_than_chance():
    hard = np.array([1.0, 3.0, 1.0, 3.0, 2.0, 2.0])
    first, noise = Candidate("first", hard), np.array([0.1, -0.1, 0.1, -0.1, 0.1, -0.1])
    alike = Candidate("alike", hard - 0.05 + noise)  # 0.05 +- 0.045: 1.1 standard errors
    better, best = (Candidate(f"less by {d}", hard - d + noise) for d in (0.15, 0.3))
    assert unless_beaten([first, alike], "first").name == "first"
    assert unless_beaten([alike, first], "alike").name == "alike"
    duel = unless_beaten([first, alike, better, best], "first")
    assert (duel.name, duel.difference) == ("less by 0.3", pytest.approx(-0.3))
    assert duel.standard_error == pytest.approx(np.std(noise, ddof=1) / np.sqrt(6))


BROKEN = {
    "shape": (lambda C: C[:-1, :-1], "prior broken .*expected shape"),
    "indefinite": (lambda C: C * np.where(np.eye(len(C)), 1, 2), "expected a positive definite block"),
    "negative": (lambda C: -C, "a positive diagonal"),
    "unsymmetric": (
        lambda C: C + 1e-3 * np.triu(np.abs(C).max() * np.ones_like(C), 1),
        "expected a symmetric",
    ),
    "nan": (lambda C: C * np.nan, "expected finite numbers"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_prior_is_refused_by_name(kr500, case):
    spoil, text = BROKEN[case]
    with pytest.raises(BenchError, match=text):
        metric(Prior("broken", spoil(kr500.arm.C_theta)), kr500.vjm, mgco68(kr500.arm))


def test_strengths_of_nothing_structures_with_holes_and_too_few_poses_are_refused(kr500):
    for bad in (0, np.nan, np.inf, 1e-200):
        with pytest.raises(BenchError, match="uncertainty: expected 1e-06 to 1e"):
            Strength(bad)
    holes = Structure.of(kr500.arm, links=["link_2"], entries=((0, 0), (0, 1), (1, 1), (1, 2)), name="holes")
    with pytest.raises(BenchError, match="holes lacks entries"):
        metric(cad_prior(kr500.arm), kr500.vjm, holes)
    data = campaign(kr500, 1, identification_poses=1, identification_runs=2).identification
    with pytest.raises(BenchError, match="expected at least 2 poses, got 1"):
        every_fold(kr500.vjm, template56(kr500.arm), data)
