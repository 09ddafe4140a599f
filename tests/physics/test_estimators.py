"""Least squares completed, held down or regularised; GCO over b as the paper writes it; free directions."""

from dataclasses import replace

import numpy as np
import pytest

from testbench.errors import BenchError
from testbench.identify.cone import nearest_psd
from testbench.identify.estimate import deflections, deflections_of_models, make_estimate, sensitivity_units
from testbench.identify.method import completed_least_squares, least_squares, paper_gco, robust, with_prior
from testbench.identify.observability import with_zero_readings
from testbench.identify.prior import cad_prior
from testbench.identify.regression import f_m, reduce
from testbench.identify.solve import NO_CONSERVATIVE_FIT, conservative_least_squares, solve
from testbench.model.structure import all153, joints_only, mgco68, mgco69, mgco147, mls36, template56
from testbench.runs.rows import trial_rng
from testbench.studies.campaign import regimes as fits
from testbench.studies.campaign.regimes import CellGrid, Clean, expected
from testbench.studies.campaign.trial import reread
from testbench.studies.intervals import RIDGES, clipped, ridge
from testbench.studies.paper import factorised
from testbench.studies.paper.factorised import BOX, explore, trial_points
from testbench.workflows.advice import advice
from testbench.workflows.campaign import FullPose, Scenario, draw_poses, simulate_at, simulate_full_pose
from testbench.workflows.campaign import simulate as calibrate

SECTION_5_2 = FullPose(arm="arm_6r", least=9e-3, most=41e-3, check_runs=10)


def both(cell, structure, data):
    """Least squares, and the same completed."""
    return [method(cell.vjm, structure, data) for method in (least_squares, completed_least_squares)]


@pytest.mark.parametrize(("make", "seed"), [(template56, 1), (mgco147, 2)])
def test_of_section_5_2_the_nearest_conservative_model_of_equal_fit_is_found(arm_6r, make, seed):
    """Dykstra's alternating projections on the models of equal fit and on the cone end at the same one."""
    data, s = simulate_full_pose(arm_6r, SECTION_5_2, seed).identification, make(arm_6r.arm)
    plain, filled = both(arm_6r, s, data)
    assert (plain.conservative, filled.conservative) == (False, True)
    assert (filled.status, filled.constraint) == ("solved", "free")
    assert filled.f_m == pytest.approx(plain.f_m, rel=1e-7)
    moved = [deflections(arm_6r.vjm, e, data) for e in (plain, filled)]
    np.testing.assert_allclose(*moved, rtol=0, atol=1e-10)  # of millimetres: readings agree to 1e-7
    assert np.abs(filled.pi - plain.pi).max() > 0.1 * np.abs(plain.pi).max()  # and yet another model
    if s.n_parameters > 56:
        return  # the projections end after many more rounds
    root_2 = np.where(s.fills_two_entries, np.sqrt(2), 1)
    unit = sensitivity_units(plain.regression) / root_2  # pi = unit svec(X)
    rows = np.vstack([term.R for term in plain.regression.terms]) * unit
    seen = np.linalg.svd(rows)[2][: plain.regression.rank]
    start, found = plain.pi / unit, filled.pi / unit
    x, correction = start.copy(), np.zeros_like(start)
    for _ in range(500):
        X = s.C_theta_of((x + correction) / root_2)
        for block in s.blocks:
            X[np.ix_(block, block)] = nearest_psd(X[np.ix_(block, block)])
        y = s.parameters_of(X) * root_2
        correction += x - y
        x = y - seen.T @ (seen @ (y - start))
    distance = np.linalg.norm(found - start)
    assert np.linalg.norm(x - start) == pytest.approx(distance, rel=1e-6)
    assert np.linalg.norm(x - found) < 1e-3 * distance


def test_a_seen_compliance_below_zero_leaves_no_conservative_model(kr500):
    """Joint 3 softens against the load, and no free direction touches it; joint 1 is the free one."""
    structure = joints_only(kr500.arm)
    true = np.array([1.0, 1.0, -0.5, 1.0, 1.0, 1.0]) * 1e-6
    data = deflected(kr500, structure, true)
    plain, filled = both(kr500, structure, data)
    assert plain.regression.rank == structure.n_parameters - 1
    np.testing.assert_allclose(filled.pi, np.r_[0, true[1:]], rtol=0, atol=1e-12)
    assert not filled.conservative
    assert NO_CONSERVATIVE_FIT in filled.status
    assert any(NO_CONSERVATIVE_FIT in said for said in advice(filled))
    right = completed_least_squares(kr500.vjm, structure, deflected(kr500, structure, np.abs(true)))
    assert right.conservative
    assert right.status == "solved"


def deflected(cell, structure, pi):
    """The runs of a campaign with the readings that these parameters make."""
    runs = calibrate(cell, Scenario(arm="kr500_l480", truth="linear", workspace_poses=1), 1).identification
    estimate = least_squares(cell.vjm, structure, runs)
    made = replace(estimate, pi=pi, C_theta=structure.C_theta_of(pi))
    return replace(with_zero_readings(runs), after=deflections(cell.vjm, made, runs))


def test_it_takes_no_prior_and_looks_for_outliers_as_least_squares_does(arm_6r):
    with pytest.raises(BenchError, match="with a prior, no direction is left"):
        with_prior(completed_least_squares, cad_prior(arm_6r.arm))
    structure, data = mgco147(arm_6r.arm), simulate_full_pose(arm_6r, SECTION_5_2, 1).identification
    data = replace(data, after=data.after + 0.01 * (data.run_id == 8)[:, None, None])
    methods = robust(least_squares), robust(completed_least_squares)
    plain, filled = (method(arm_6r.vjm, structure, data) for method in methods)
    assert {r.run for r in filled.rejected_readings} == {r.run for r in plain.rejected_readings} == {8}
    assert filled.conservative
    assert filled.f_m == pytest.approx(plain.f_m, rel=1e-7)
    with pytest.raises(BenchError, match="symmetric"):
        completed_least_squares(arm_6r.vjm, mls36(arm_6r.arm), data)


@pytest.fixture(scope="module")
def seen(kr500):
    """Runs, the unknowns, and their equations as they stand in the file, in standard deviations."""
    data = calibrate(kr500, Scenario(arm="kr500_l480", workspace_poses=1), 3).identification
    beams = template56(kr500.arm)
    regression = reduce(kr500.vjm, beams, data)
    each = [make_estimate(regression, 1e-6 * e, method="one") for e in np.eye(beams.n_parameters)]
    sigma = np.sqrt(2) * data.sigma * 1e-6
    A = (
        deflections_of_models(kr500.vjm, each, data)[:, data.is_measured].reshape(beams.n_parameters, -1).T
        / sigma
    )
    return data, beams, A, 1e-6 * data.deflection[data.is_measured].ravel() / sigma


def test_ridge_leaves_readings_out_by_their_weight_and_clipping_makes_the_nearest_matrices(kr500, seen):
    """Generalised cross-validation of all equations by the hat matrix, not of those that are reduced."""
    data, beams, A, y = seen
    A = A / np.linalg.norm(A, axis=0).clip(1e-9 * np.linalg.norm(A, axis=0).max())
    largest = np.linalg.norm(A, 2) ** 2

    def fit(size):
        return np.linalg.solve(A.T @ A + size * largest * np.eye(beams.n_parameters), A.T)

    def score(size):
        hat = A @ fit(size)
        return np.sum((y - hat @ y) ** 2) / (len(y) - np.trace(hat)) ** 2

    best = min(RIDGES, key=score)
    found = ridge(kr500.vjm, beams, data)
    moved = deflections_of_models(kr500.vjm, [found], data)[0][data.is_measured].ravel()
    expected = A @ fit(best) @ y * np.sqrt(2) * data.sigma
    np.testing.assert_allclose(moved, expected, rtol=0, atol=1e-6 * np.abs(expected).max())
    assert found.constraint == "ridge"
    plain, held = (method(kr500.vjm, beams, data) for method in (least_squares, clipped))
    assert (plain.conservative, held.conservative, held.f_m > plain.f_m) == (False, True, True)
    for block in beams.blocks:
        C, X = (own.C_theta[np.ix_(block, block)] for own in (plain, held))
        left = X - C  # positive semi-definite, and orthogonal to what is kept
        assert np.linalg.eigvalsh(left)[0] >= -1e-12 * np.abs(C).max()
        assert abs(np.sum(left * X)) <= 1e-9 * np.sum(C**2)


NOISE = {"sigma": 25e-6 / 2**0.5, "sigma_rotation": 250e-6 / 2**0.5}
PRECISE = FullPose(arm="arm_6r", least=9e-3, most=41e-3, **NOISE)


@pytest.fixture(scope="module")
def data(arm_6r):
    return simulate_full_pose(arm_6r, PRECISE, 1).identification


@pytest.fixture(scope="module")
def regression(arm_6r, data):
    return reduce(arm_6r.vjm, mgco69(arm_6r.arm), data)


@pytest.fixture(scope="module")
def best(arm_6r, data):
    return paper_gco(arm_6r.vjm, mgco69(arm_6r.arm), data)


@pytest.mark.parametrize("m", [1, 3, 6])
def test_gradient_of_the_cost_is_its_finite_difference(regression, rng, m):
    problem = factorised.factorise(regression, m)
    b = factorised.random_start(problem, rng)
    _, gradient = factorised.cost(problem, b)
    h = 1e-5
    steps = h * np.eye(problem.size)
    ends = [[factorised.cost(problem, b + sign * step)[0] for sign in (1, -1)] for step in steps]
    numeric = [(up - down) / (2 * h) for up, down in ends]
    # truncation h^2 and rounding 1e-16 F_M / h, both about 1e-10 of the gradient
    np.testing.assert_allclose(gradient, numeric, rtol=0, atol=1e-7 * np.abs(gradient).max())


@pytest.mark.parametrize(("structure", "m"), [(mgco69, 1), (mgco147, 3), (template56, 4), (mgco69, 6)])
def test_parameters_are_gramians_of_at_most_rank_m_and_cost_what_f_m_says(arm_6r, data, rng, structure, m):
    problem = factorised.factorise(reduce(arm_6r.vjm, structure(arm_6r.arm), data), m)
    population = rng.uniform(-1, 1, (problem.size, 70))  # more than one block of points
    each = [factorised.cost(problem, b)[0] for b in population.T]
    by_parameters = [f_m(problem.regression, factorised.parameters(problem, b)) for b in population.T]
    np.testing.assert_allclose(factorised.costs(problem, population), each, rtol=1e-12)
    np.testing.assert_allclose(by_parameters, each, rtol=1e-12)
    s = problem.regression.structure
    C = s.C_theta_of(factorised.parameters(problem, factorised.random_start(problem, rng)))
    for block in s.blocks:
        part = C[np.ix_(block, block)]
        unit = np.sqrt(np.diag(part))
        values = np.linalg.eigvalsh(part / np.outer(unit, unit))
        assert values[0] > -1e-12  # rounding of a matrix of unit diagonal
        assert (values > 1e-9).sum() == min(m, len(block)) or s.name == "MGCO56"


def test_what_cannot_be_searched_is_refused(arm_6r, data):
    with pytest.raises(BenchError, match="expected a symmetric structure"):
        factorised.factorise(reduce(arm_6r.vjm, mls36(arm_6r.arm), data))


@pytest.mark.study
def test_the_papers_search_ends_at_the_conic_optimum_and_f_m_falls_until_there(best, monkeypatch):
    """By the same random numbers at the same place; local solves are seen to fall too."""
    monkeypatch.setattr(factorised, "POPULATION", 2)
    monkeypatch.setattr(factorised, "STAGE_ONE", 10)
    problem, seen, of_several = factorised.factorise(best.regression), [], []
    one, two = factorised.Search(problem, seen.append), factorised.Search(problem)
    for search in (one, two):
        explore(search, trial_rng(1), generations=3, trials=40)
    np.testing.assert_array_equal(one.best, two.best)
    assert one.f_m == pytest.approx(best.f_m, rel=1e-5)
    third = factorised.Search(factorised.factorise(best.regression, 3), of_several.append)
    factorised.local_solves(third, trial_rng(4), starts=3)
    for values, end in ((seen, one.f_m), (of_several, min(d.f_m for d in third.descents))):
        assert len(values) > 10
        assert (np.diff(values) < 0).all()
        assert values[-1] == pytest.approx(end, rel=1e-12)


def test_order_of_the_vector_space_by_counting_is_that_of_eq_20(arm_6r):
    # n = 6; 108 runs: seven links bound m by 6 * 108 / (6 * 7), three by 6 * 108 / (6 * 3)
    assert factorised.order_range(mgco147(arm_6r.arm), 108) == (3.5, pytest.approx(108 / 7))
    assert factorised.order_range(mgco69(arm_6r.arm), 108) == (3.5, 36.0)
    assert factorised.order_range(template56(arm_6r.arm), 108) == (1.5, pytest.approx(648 / (2 * 14)))


SEEDS = (11, 12, 13)


def test_trial_points_lie_inside_the_box_and_differ(regression):
    problem = factorised.factorise(regression)
    points = trial_points(problem, np.zeros(problem.size), 700, trial_rng(3))
    assert points.shape == (700, problem.size)
    assert np.abs(points).max() <= BOX
    assert len(np.unique(points, axis=0)) == 700
    assert not np.isin(points, trial_points(problem, np.zeros(problem.size), 700, trial_rng(4))).all()
    from_outside = trial_points(problem, np.full(problem.size, 2 * BOX), 100, trial_rng(3))
    assert np.abs(from_outside).max() <= BOX


def hung(cell, seed, poses):
    """True deflections under a weight, linear, the structure's tubes: the model can be exact."""
    scenario = Scenario(
        arm=cell.arm.name, noise=False, truth="linear", identification_poses=poses,
        identification_runs=poses, workspace_poses=60,
    )  # fmt: skip
    campaign = simulate_at(cell, scenario, seed, draw_poses(cell, scenario, seed))
    return Clean(campaign.identification, campaign.truth, seed)


def noisy(clean, sigma):
    return reread(clean.runs, sigma, trial_rng(clean.seed, 1))


def weighed_rows(regression):
    """Rows and readings as least squares weighs them."""
    weights = [np.sqrt(term.n_equations) for term in regression.terms]
    A = np.vstack([w * term.R for w, term in zip(weights, regression.terms, strict=True)])
    return A, np.concatenate([w * term.z for w, term in zip(weights, regression.terms, strict=True)])


def test_the_fit_of_least_squares_is_kept_and_the_free_directions_are_those_of_gco(kr500):
    structure = all153(kr500.arm)
    clean = hung(kr500, SEEDS[0], 8)
    found = fits.methods([reduce(kr500.vjm, structure, noisy(clean, 50e-6))], [])
    [ls], [gco], [lent] = found[fits.SQUARES], found[fits.GCO], found[fits.LENT]
    A, _ = weighed_rows(ls.regression)
    assert ls.regression.rank < structure.n_parameters
    np.testing.assert_allclose(A @ lent.pi, A @ ls.pi, atol=1e-9 * np.abs(A @ ls.pi).max())
    # here a conservative model fits as well: GCO has the fit of least squares, and the rest from `lent`
    assert found[fits.EQUAL][0].conservative
    moved = [deflections(kr500.vjm, own, clean.judge) for own in (ls, gco, lent)]
    size = np.abs(moved[1]).max()
    assert np.abs(moved[2] - moved[1]).max() < 1e-3 * size
    assert np.abs(moved[0] - moved[1]).max() > 0.1 * size


@pytest.mark.study
def test_where_no_equal_fit_is_sought_there_is_none(kr500):
    ls, taken = [], []
    for structure, poses in ((mgco68(kr500.arm), (8, 12)), (all153(kr500.arm), (4, 12, 20))):
        clean = [hung(kr500, seed, count) for seed in SEEDS for count in poses]
        found = fits.methods([reduce(kr500.vjm, structure, noisy(own, 50e-6)) for own in clean], [])
        ls += found[fits.SQUARES]
        taken += map(fits.added, found[fits.SQUARES], found[fits.GCO])
    skipped = [own for own, share in zip(ls, taken, strict=True) if share > fits.TAKEN]
    assert 3 < len(skipped) < len(ls) - 3
    assert not any(conservative_least_squares(own.regression).conservative for own in skipped)


def test_the_error_to_expect_is_what_noise_does_to_least_squares(kr500):
    structure, sigma = template56(kr500.arm), 50e-6
    clean = hung(kr500, SEEDS[0], 12)
    exact = reduce(kr500.vjm, structure, replace(clean.runs, sigma=sigma))
    [size] = expected(kr500.vjm, clean, CellGrid(kr500.arm.name, (12,), (sigma,)), [exact])
    rng, draws = trial_rng(SEEDS[0], 1), 100
    seen = [reduce(kr500.vjm, structure, reread(clean.runs, sigma, rng)) for _ in range(draws)]
    found = [solve(regression, "none") for regression in (exact, *seen)]
    moved = np.array([deflections(kr500.vjm, own, clean.judge) for own in found])
    error = 1e6 * np.sqrt(np.square(moved[1:] - moved[0]).sum(axis=3).mean())
    assert error == pytest.approx(size, rel=0.2)  # of one direction 100 draws tell it to 7 %
