"""Priors: their metric, what they do to fits, how firmly to believe them, given or learnt; averages."""

import math
from dataclasses import replace

import numpy as np
import pytest
from loads import at_rest
from programs import block_matrices
from scipy import stats
from scipy.integrate import quad

from testbench import (
    BenchError,
    Scenario,
    deflections,
    gco,
    least_squares,
    paper_gco,
    reduce,
    score,
    simulate,
    with_prior,
)
from testbench.data.dataset import select_runs
from testbench.identify import average, hierarchy
from testbench.identify import posterior as posteriors
from testbench.identify.average import (
    average_two_priors,
    pose_to_pose_variation,
    weight_for_pose_variation,
)
from testbench.identify.estimate import ModelAverage, make_estimate
from testbench.identify.hierarchy import evidence_hessian, evidence_posterior, maximise_evidence
from testbench.identify.posterior import (
    SECOND_ORDER_FACTOR,
    Posterior,
    intervals,
    posterior_of_estimate,
    second_order_deflection,
)
from testbench.identify.prior import (
    Prior,
    PriorUncertainty,
    WeightedPrior,
    cad_prior,
    prior_rows,
    rescale_to_data,
    rows_in_prior_units,
    scale_by_prior,
)
from testbench.identify.regression import embed_parameters, f_m, restrict_regression
from testbench.identify.solve import solve, solve_with_prior
from testbench.identify.trace import (
    MAX_FOLDS,
    HeldOutErrors,
    cross_validation_groups,
    keep_first_unless_beaten,
)
from testbench.model.laws import add_coupling_parameters, add_law_parameters, remove_coupling_parameters
from testbench.model.load import first_order_deflection, nonlinear_deflection, one_step_theta
from testbench.model.structure import Structure, all153, joints_only, mgco47, mgco68, mgco147, template56
from testbench.model.vjm import evaluate_chain, observation_matrix
from testbench.studies import intervals as shrinkage
from testbench.workflows.advice import of_average
from testbench.workflows.campaign import true_cell
from testbench.workflows.fits import of_scale
from testbench.workflows.models import named_models, prior_of, with_priors


def runs(cell, seed, **changes):
    asked = Scenario(arm="kr500_l480", truth="linear", workspace_poses=1, **changes)
    return simulate(cell, asked, seed).identification


def scaled(cell, structure, seed):
    """Equations of a campaign, and the prior of the drawing in their scale."""
    regression = reduce(cell.vjm, structure, runs(cell, seed))
    return regression, rescale_to_data(scale_by_prior(cad_prior(cell.arm), cell.vjm, structure), regression)


@pytest.fixture(params=[mgco147, template56])
def structure(request, kr500):
    return request.param(kr500.arm)


@pytest.mark.parametrize("uncertainty", [0.2, 2.0])
def test_with_a_prior_least_squares_is_the_ridge_solution(kr500, structure, uncertainty):
    """With the common scale an unknown."""
    n = structure.n_parameters
    regression, own = scaled(kr500, structure, 3)
    (A, y), e = rows_in_prior_units(regression, own), own.expected_x
    rows = np.block([[A, np.zeros((len(A), 1))], [np.eye(n) / uncertainty, -e[:, None] / uncertainty]])
    ridge = own.L @ np.linalg.lstsq(rows, np.r_[y, np.zeros(n)], rcond=None)[0][:n]
    found = solve(regression, "none", WeightedPrior(own, PriorUncertainty(uncertainty))).pi
    np.testing.assert_allclose(found, ridge, rtol=0, atol=1e-7 * np.abs(ridge).max())


def test_log_det_prior_is_never_singular_and_of_least_cost_and_least_trace_fits_as_well(kr500):
    regression, own = scaled(kr500, template56(kr500.arm), 3)
    loose = shrinkage.gco_stein(regression, own, PriorUncertainty(3.0))
    assert loose.status == "solved"
    x = np.linalg.solve(own.L, loose.pi)
    assert min(np.linalg.eigvalsh(X)[0] for X in block_matrices(own, x)) > 1e-3
    (A, y), e = rows_in_prior_units(regression, own), own.expected_x
    scale = (
        np.linalg.solve(own.L, solve(regression, "psd", WeightedPrior(own, PriorUncertainty(3.0))).pi)
        @ e
        / (e @ e)
    )

    def cost(x):
        log_det = sum(np.linalg.slogdet(X)[1] for X in block_matrices(own, x))
        return ((A @ x - y) ** 2).sum() / 2 + (e @ x / scale - log_det) / 3.0**2

    # directions in which the cost is about equally curved: none goes down
    root = np.linalg.cholesky(A.T @ A + np.eye(len(x)) / (3.0 * scale) ** 2)
    steps = 1e-3 * np.linalg.solve(root.T, np.random.default_rng(1).standard_normal((len(x), 40)))
    assert min(cost(x + sign * step) for step in steps.T for sign in (1, -1)) > cost(x)
    data, structure = runs(kr500, 2), mgco68(kr500.arm)
    regression, own = scaled(kr500, structure, 2)
    ours, plain = shrinkage.gco_least_trace(regression, own), paper_gco(kr500.vjm, structure, data)
    assert ours.conservative
    assert ours.f_m <= (1 + shrinkage.SLACK) * plain.f_m * (1 + 1e-6)
    traces = [own.expected_x @ np.linalg.solve(own.L, e.pi) for e in (ours, plain)]
    assert traces[0] < traces[1]


def test_load_levels_are_held_out_whole_and_the_strength_that_predicts_best_is_taken(kr500):
    light, heavy = (runs(kr500, 1, payload=mass) for mass in (200.0, 460.3))
    structure = template56(kr500.arm)
    assert len(shrinkage.every_fold(kr500.vjm, structure, heavy)) == 8
    names = "run_id pose_id q wrench point before after".split()
    both = replace(heavy, **{k: np.concatenate([getattr(light, k), getattr(heavy, k)]) for k in names})
    folds = shrinkage.every_fold(kr500.vjm, structure, both)
    assert [fold.held_out_regression.n_equations for fold in folds[8:]] == [
        9 * light.n_runs,
        9 * heavy.n_runs,
    ]
    turned = np.where(np.arange(heavy.n_runs)[:, None] % 3 == 0, [0, 0, 0, 0, 40.0, 0], 0.0)
    folds = shrinkage.every_fold(kr500.vjm, structure, replace(heavy, wrench=heavy.wrench + turned))
    some = -(-heavy.n_runs // 3)
    assert [fold.held_out_regression.n_equations for fold in folds[8:]] == [
        9 * (heavy.n_runs - some),
        9 * some,
    ]
    own, errors = scale_by_prior(cad_prior(kr500.arm), kr500.vjm, structure), {}
    folds = shrinkage.every_fold(kr500.vjm, structure, runs(kr500, 1))
    for u in shrinkage.UNCERTAINTIES:
        fits = [
            solve(fold.fitted_regression, "none", WeightedPrior(own, PriorUncertainty(u))).pi
            for fold in folds
        ]
        errors[u] = np.mean([f_m(fold.held_out_regression, pi) for fold, pi in zip(folds, fits, strict=True)])
    chosen = shrinkage.choose_strength(folds, own, lambda *case: own.L @ solve_with_prior("none", *case).x)
    assert chosen.relative == min(errors, key=errors.get)


def test_a_model_stays_unless_beaten_fold_by_fold_by_more_than_chance():
    hard = np.array([1.0, 3.0, 1.0, 3.0, 2.0, 2.0])
    first, noise = HeldOutErrors("first", hard), np.array([0.1, -0.1, 0.1, -0.1, 0.1, -0.1])
    alike = HeldOutErrors("alike", hard - 0.05 + noise)  # 0.05 +- 0.045: 1.1 standard errors
    better, best = (HeldOutErrors(f"less by {d}", hard - d + noise) for d in (0.15, 0.3))
    assert keep_first_unless_beaten([first, alike], "first").selected_name == "first"
    assert keep_first_unless_beaten([alike, first], "alike").selected_name == "alike"
    duel = keep_first_unless_beaten([first, alike, better, best], "first")
    assert (duel.selected_name, duel.difference) == ("less by 0.3", pytest.approx(-0.3))
    assert duel.standard_error == pytest.approx(np.std(noise, ddof=1) / np.sqrt(6))


def unsymmetric(C):
    return C + 1e-3 * np.triu(np.full_like(C, np.abs(C).max()), 1)


@pytest.mark.parametrize(
    ("spoil", "text"),
    [
        (lambda C: C[:-1, :-1], "prior broken .*expected shape"),
        (lambda C: C * np.where(np.eye(len(C)), 1, 2), "expected a positive definite block"),
        (lambda C: -C, "a positive diagonal"),
        (unsymmetric, "expected a symmetric"),
        (lambda C: C * np.nan, "expected finite numbers"),
    ],
)
def test_a_broken_prior_is_refused_by_name(kr500, spoil, text):
    with pytest.raises(BenchError, match=text):
        scale_by_prior(Prior("broken", spoil(kr500.arm.C_theta)), kr500.vjm, mgco68(kr500.arm))


def test_strengths_of_nothing_holes_too_few_poses_and_moves_against_the_load_are_refused(kr500, campaign):
    for bad in (0, np.nan, np.inf, 1e-200):
        with pytest.raises(BenchError, match="relative: expected a number from 1e-06 to 1e"):
            PriorUncertainty(bad)
    holes = Structure.of(kr500.arm, links=["link_2"], entries=((0, 0), (0, 1), (1, 1), (1, 2)), name="holes")
    with pytest.raises(BenchError, match="holes lacks entries"):
        scale_by_prior(cad_prior(kr500.arm), kr500.vjm, holes)
    data = runs(kr500, 1, identification_poses=1, identification_runs=2)
    with pytest.raises(BenchError, match="expected at least 2 poses, got 1"):
        shrinkage.every_fold(kr500.vjm, template56(kr500.arm), data)
    data, method = campaign.identification, with_prior(gco, cad_prior(kr500.arm))
    with pytest.raises(BenchError, match="expected readings that move with the load"):
        method(kr500.vjm, mgco68(kr500.arm), replace(data, before=data.after, after=data.before))


@pytest.fixture(scope="module")
def campaign(kr500):
    return simulate(kr500, Scenario(arm="kr500_l480", workspace_poses=10), 3)


def seen_by(cell, campaign, structure, prior=None):
    prior = prior_of(cell, "scaled", 3) if prior is None else prior
    return reduce(cell.vjm, structure, campaign.identification), scale_by_prior(prior, cell.vjm, structure)


def tied(arm):
    return add_coupling_parameters(all153(arm))


@pytest.mark.parametrize("make", [tied, mgco68])
def test_slopes_and_bends_of_the_evidence_are_those_of_differences(kr500, campaign, make, rng):
    seen = hierarchy.prior_evidence_model(*seen_by(kr500, campaign, make(kr500.arm)))
    h = seen.hyperparameter_medians + 0.2 * rng.standard_normal(len(seen.hyperparameter_medians))
    own, step = evidence_posterior(seen.evidence, h), 1e-5
    ends = [
        [evidence_posterior(seen.evidence, h + sign * step * e) for sign in (1, -1)] for e in np.eye(len(h))
    ]
    H, J = evidence_hessian(seen.evidence, own)
    of_slopes = (
        (own.gradient, lambda x: x.neg_log_evidence),
        (H, lambda x: x.gradient),
        (J.T, lambda x: x.solution.x),
    )
    for found, of in of_slopes:
        expected = np.array([(of(up) - of(down)) / (2 * step) for up, down in ends])
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


def test_the_evidence_is_the_density_of_the_readings_under_the_prior(kr500, campaign):
    regression, own = seen_by(kr500, campaign, mgco68(kr500.arm))
    seen = hierarchy.prior_evidence_model(regression, own)
    h, other = seen.hyperparameter_medians.copy(), seen.hyperparameter_medians.copy()
    h[-3:], other[-3:] = np.log([0.3, 0.2, 1.2]), np.log([0.5, 0.1, 1.0])
    other[-6:-3] = np.log([0.5, 1.0, 2.0])  # of links 0, 2 and 3

    def density(h):
        """Minus its logarithm, from all rows as they are, the scales at one."""
        A, y = rows_in_prior_units(regression, seen.scaling)
        u, c, kappa = np.exp(h[-3:])
        D = (np.where(seen.scaling.is_link_coupling, c, u) * (seen.scale_exponents @ shares(seen, h))) ** 2
        S = kappa**2 * np.eye(len(y)) + A * D @ A.T
        e = y - A @ seen.scaling.expected_x
        more = sum(t.n_equations / 3 * t.unexplained for t in regression.terms) / kappa**2 / 2
        beyond = (regression.n_equations - len(y)) * np.log(kappa)
        return (np.linalg.slogdet(S)[1] + e @ np.linalg.solve(S, e)) / 2 + more + beyond

    def hyper(h):
        z = (h[-6:] - seen.hyperparameter_medians[-6:]) / np.array([0.5, 0.5, 0.5, 0.4, 0.7, 0.7])
        return z @ z / 2

    found = [
        evidence_posterior(seen.evidence, point).neg_log_evidence - hyper(point) - density(point)
        for point in (h, other)
    ]
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-6)  # but for a constant


def shares(seen, h):
    """What u and c of every block are times, (blocks,)."""
    found = np.ones(seen.n_scales)
    found[seen.link_scale_indices] = np.exp(h[-3 - len(seen.link_scale_indices) : -3])
    return found


def test_the_fit_is_the_expectation_and_its_deviations_those_of_bayes(kr500, campaign):
    regression, own = seen_by(kr500, campaign, all153(kr500.arm))
    weighted_prior = hierarchy.learn_prior(regression, own)
    scaling, uncertainty = weighted_prior.scaling, weighted_prior.uncertainty
    (A, y), D = rows_in_prior_units(regression, scaling), weighted_prior.noise_factor**2
    e = scaling.expected_x
    assert np.std(np.log(uncertainty.block_factors[:7])) > 0.01  # links of one arm are unlike
    factor = np.repeat(uncertainty.block_factors, [21] * 7 + [1] * 6)
    size = np.where(scaling.is_link_coupling, uncertainty.link_coupling, uncertainty.relative)
    P = D * (factor * size) ** 2
    S = D * np.eye(len(y)) + A * P @ A.T
    gain = (P[:, None] * A.T) @ np.linalg.inv(S)
    estimate = solve(regression, "none", weighted_prior)
    x = np.linalg.solve(scaling.L, estimate.pi)
    np.testing.assert_allclose(x, e + gain @ (y - A @ e), rtol=0, atol=1e-6)  # rows of 1e3, entries of 1
    rows = np.linalg.qr(np.random.default_rng(0).standard_normal((153, 5)))[0].T
    functionals = rows @ np.linalg.inv(scaling.L)
    variance = np.einsum("ki,ij,kj->k", rows, np.diag(P) - gain @ (A * P), rows)
    # entries as large as the mean of their squares: what the readings leave of them
    left = rows @ (np.eye(153) - gain @ A)
    variance += left**2 @ (P * (weighted_prior.uncertainty_factors**2 - 1))
    variance += np.square(functionals @ weighted_prior.hyperparameter_effect.T).sum(axis=1)
    found = posterior_of_estimate(estimate).standard_deviations(functionals)
    np.testing.assert_allclose(found, np.sqrt(variance), rtol=1e-5)


def test_a_learnt_prior_moves_parameters_as_far_as_its_hyperparameters_are_open(kr500, campaign):
    """Laplace's covariance times derivatives of the estimate, which is solved again at every difference."""
    regression, own = seen_by(kr500, campaign, mgco68(kr500.arm))
    weighted_prior = hierarchy.learn_prior(regression, own)
    seen = hierarchy.prior_evidence_model(regression, own)
    h = maximise_evidence(seen.evidence, seen.hyperparameter_medians).h

    def estimate(h):
        L = seen.scaling.L * seen.entry_scales(h)
        u, c, kappa = np.exp(h[-3:])
        own = PriorUncertainty(u / kappa, 0.0, link_coupling=c / kappa, block_factors=tuple(shares(seen, h)))
        there = WeightedPrior(replace(seen.scaling, L=L), own)
        return solve(regression, "none", there).pi

    steps = 1e-4 * np.eye(len(h))[:-1]
    J = np.array([estimate(h + d) - estimate(h - d) for d in steps]) / 2e-4
    slopes = [[evidence_posterior(seen.evidence, h + s * d).gradient for s in (1, -1)] for d in steps]
    H = np.array([up - down for up, down in slopes])[:, :-1] / 2e-4
    assert np.linalg.eigvalsh(H)[0] > hierarchy.MAX_HYPERPARAMETER_DEVIATION**-2
    expected = J.T @ np.linalg.solve(H, J)
    found = weighted_prior.hyperparameter_effect.T @ weighted_prior.hyperparameter_effect
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4 * expected.max())


def test_scales_are_ratios_to_their_kind_as_sure_as_the_difference_of_their_logarithms(kr500, campaign, rng):
    own = scale_by_prior(cad_prior(kr500.arm), kr500.vjm, mgco68(kr500.arm))
    seen = hierarchy.prior_evidence_model(reduce(kr500.vjm, own.structure, campaign.identification), own)
    n, K = len(seen.hyperparameter_medians), seen.n_scales
    h, A = rng.normal(size=n), rng.normal(size=(n - 1, n - 1))
    C = A @ A.T
    pairs = [(k, K + kind) for k, kind in enumerate(seen.scale_kinds)]
    pairs += [(K + 1, K)]  # the joints over the links
    for scale, (i, j) in zip(hierarchy._scales(seen, h, C), pairs, strict=True):
        assert scale.factor == pytest.approx(np.exp(h[i]) / np.exp(h[j]))
        assert scale.log_deviation == pytest.approx(np.sqrt(C[i, i] + C[j, j] - 2 * C[i, j]))


@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_joints_ten_times_off_are_found_and_hardly_cost_anything(kr500, factor):
    prior = cad_prior(kr500.arm)
    C = prior.C_theta.copy()
    C[42:, 42:] *= factor
    campaign = simulate(kr500, Scenario(arm="kr500_l480", truth="linear", workspace_poses=20), 5)
    errors = {}
    for name, own in (("right", prior), ("wrong", Prior("joints off", C))):
        estimate = with_prior(gco, own)(kr500.vjm, all153(kr500.arm), campaign.identification)
        errors[name] = np.abs(estimate.C_theta - kr500.arm.C_theta)[42:, 42:].max()
    [joints] = [scale for scale in estimate.weighted_prior.learnt_scales if scale.name == "joints"]
    assert abs(np.log(joints.factor * factor)) < 4 * joints.log_deviation < np.log(10)  # told from 1
    [doubt] = [
        scale for scale in hierarchy.contradicted_scales(estimate.weighted_prior) if scale.name == "joints"
    ]
    assert f"compared with the links, the joints are {joints.factor:.2g} times" in of_scale(doubt).sentence
    assert errors["wrong"] < errors["right"] + 0.3 * kr500.arm.C_theta[42:, 42:].max()


@pytest.mark.parametrize(("link", "factor"), [(1, 0.1), pytest.param(6, 10.0, marks=pytest.mark.study)])
def test_a_link_ten_times_off_is_contradicted_or_named_as_open_that_way(kr500, campaign, link, factor):
    C = kr500.arm.C_theta.copy()
    C[6 * link : 6 * link + 6] *= factor
    name = kr500.arm.links[link].name
    regression, own = seen_by(kr500, campaign, all153(kr500.arm), Prior("one link off", C))
    told = any(
        scale.name == name for scale in hierarchy.contradicted_scales(hierarchy.learn_prior(regression, own))
    )
    found = hierarchy.undetermined_compliances(regression, own)
    assert told or name in (found.stiffer if factor > 1 else found.softer)


def test_intervals_widen_by_what_a_linear_model_leaves_out(kr500, campaign):
    data, C = campaign.truth, kr500.arm.C_theta
    whole = second_order_deflection(kr500.vjm, C, data)
    theta = at_rest(kr500, C, data.q, data.wrench, data.point)
    exact = nonlinear_deflection(kr500.vjm, data.q, theta, kr500.vjm.markers)
    where = evaluate_chain(kr500.vjm, data.q)
    linear = first_order_deflection(
        where, one_step_theta(where, C, data.wrench, data.point), kr500.vjm.markers
    )
    np.testing.assert_allclose(whole, exact - linear, rtol=0, atol=0.1 * np.abs(whole).max())
    method = with_prior(gco, cad_prior(kr500.arm))
    estimate = method(kr500.vjm, template56(kr500.arm), campaign.identification)
    found = intervals(kr500.vjm, estimate, data)
    rows = observation_matrix(where, estimate.structure, data.wrench, data.point, kr500.vjm.markers)
    half = posterior_of_estimate(estimate).half_widths(rows.reshape(-1, 56)).reshape(whole.shape)
    left_out = second_order_deflection(kr500.vjm, estimate.C_theta, data)
    np.testing.assert_allclose(
        found.upper - found.centre, np.hypot(half, SECOND_ORDER_FACTOR * left_out), rtol=1e-9
    )


SCENARIO = Scenario(arm="kr500_l480", identification_poses=8, identification_runs=16, workspace_poses=60)


@pytest.fixture(scope="module")
def rigid(kr500):
    """A campaign of links a thousand times stiffer than the folder's."""
    return simulate(true_cell(kr500, "tubes", 1, stiffer=1000), SCENARIO, 1)


def errors(cell, campaign, *estimates):
    truth = campaign.truth
    return [score(deflections(cell.vjm, e, truth), truth.deflection).rms for e in estimates]


def test_where_links_are_rigid_the_default_is_joints_alone(kr500, rigid):
    method, s = default(kr500, 1)
    found = method(kr500.vjm, s, rigid.identification)
    ours, theirs = errors(kr500, rigid, found, gco(kr500.vjm, joints_only(kr500.arm), rigid.identification))
    assert found.averaged_models.joints_only_weight > 0.75
    [said] = of_average(found.averaged_models)
    assert "Joints-only" in said
    assert ours < 1.05 * theirs


def test_the_weight_is_that_of_the_evidence_by_the_book(kr500, rigid):
    """Of joints alone: a normal density of the readings about a scale, integrated over it by quadrature."""
    data, found = rigid.identification, []
    s = joints_only(kr500.arm)
    regression = reduce(kr500.vjm, s, data)
    for name in ("right", "scaled", "uncoupled"):
        own = scale_by_prior(prior_of(kr500, name, 2), kr500.vjm, s)
        log_evidence, weighted_prior = hierarchy.joints_only_log_evidence(regression, own)
        kappa = hierarchy.JOINTS_ONLY_FIT_DEVIATION / weighted_prior.uncertainty.relative
        e = weighted_prior.scaling.expected_x
        A, y = rows_in_prior_units(regression, weighted_prior.scaling)
        S = kappa**2 * np.eye(len(y)) + hierarchy.JOINTS_ONLY_DEVIATION**2 * A @ A.T
        best = float(y @ np.linalg.solve(S, A @ e))
        best /= float(A @ e @ np.linalg.solve(S, A @ e))

        def density(v, A=A, y=y, S=S, e=e, best=best):
            e0, e1 = y - A @ (best * e), y - A @ (v * e)
            return math.exp((e0 @ np.linalg.solve(S, e0) - e1 @ np.linalg.solve(S, e1)) / 2)

        e0 = y - A @ (best * e)
        log_determinant = np.linalg.slogdet(S)[1]
        over_scale = math.log(quad(density, best - 2, best + 2, points=[best], limit=200)[0])
        rest = sum(t.n_equations / 3 * t.unexplained for t in regression.terms) / kappa**2
        beyond = (regression.n_equations - len(y)) * math.log(kappa)
        dense = over_scale - (e0 @ np.linalg.solve(S, e0) + log_determinant + rest) / 2 - beyond
        found.append(log_evidence - dense + (math.log(kappa) / hierarchy.LOG_MISFIT_DEVIATION) ** 2 / 2)
    np.testing.assert_allclose(found, -math.log(2 * math.pi) / 2, rtol=0, atol=1e-5)  # left out on purpose


def test_an_average_is_conservative_and_widths_are_less_sure_of_joints_alone(kr500, rigid):
    found = with_prior(gco, cad_prior(kr500.arm))(kr500.vjm, all153(kr500.arm), rigid.identification)
    average, links = found.averaged_models, slice(0, 42)
    whole, w = average.links_and_joints, average.joints_only_weight
    np.testing.assert_allclose(found.C_theta[links, links], (1 - w) * whole.C_theta[links, links], rtol=1e-12)
    assert found.conservative
    [(_, first), (joints_only_probability, _)] = average.interval_models
    assert first is whole
    assert w > joints_only_probability > 0.5  # these joints are alone


@pytest.mark.parametrize("kind", ["every model", "coupled joints alone", "two priors"])
def test_an_average_has_the_covariance_of_the_mixture_of_its_models(kr500, campaign, kind, monkeypatch, rng):
    """By probability every model's own, and what lies between it and the mean; unknowns it lacks are zero."""
    _, s = default(kr500, 3)
    regression = reduce(kr500.vjm, s, campaign.identification)
    links, laws, ties, joints = (
        make_estimate(restrict_regression(regression, own), rng.normal(size=own.n_parameters), method="known")
        for own in (all153(kr500.arm), remove_coupling_parameters(s), tied(kr500.arm), joints_only(kr500.arm))
    )
    roots = {id(own): rng.normal(size=(3, own.structure.n_parameters)) for own in (links, laws, ties, joints)}
    monkeypatch.setattr(
        posteriors,
        "posterior_of_estimate",
        lambda own: Posterior.from_covariance_root(own.pi, roots[id(own)]),
    )
    parts = {
        "every model": ((0.3, ties), (0.56, laws), (0.056, joints), (0.084, links)),
        "coupled joints alone": ((1, ties),),
        "two priors": ((0.6, laws), (0.4, links)),
    }[kind]
    mean = make_estimate(regression, rng.normal(size=s.n_parameters), method="known")
    expected = np.zeros((s.n_parameters, s.n_parameters))
    for p, own in parts:
        x, root = (embed_parameters(numbers, own.structure, s) for numbers in (own.pi, roots[id(own)]))
        expected += p * (root.T @ root + np.outer(x - mean.pi, x - mean.pi))
    found = posterior_of_estimate(replace(mean, averaged_models=ModelAverage(links, parts))).covariance(
        np.eye(s.n_parameters)
    )
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("likelier", [0, 1])
def test_the_share_of_a_prior_is_that_of_its_evidence_against_the_odds_beforehand(
    kr500, campaign, likelier, monkeypatch
):
    """Two known estimates, one three times as probable as the other once the odds are counted."""
    r = reduce(kr500.vjm, joints_only(kr500.arm), campaign.identification)
    size = np.abs(joints_only(kr500.arm).parameters_of(kr500.arm.C_theta))
    both = []
    for factor, weight, laws in ((1.0, 0.1, 0.2), (2.0, 0.5, 0.7)):
        one = make_estimate(r, factor * size, method="known", constraint="psd")
        parts = ModelAverage(one, ((1.0, one),), joints_only_weight=weight, joint_laws_weight=laws)
        both.append(replace(one, averaged_models=parts))
    odds = math.log(average.BEAM_LIKE_LINKS_PRIOR_ODDS) + (math.log(3) if likelier else -math.log(3))
    given = {"first": (both[0], 7.0), "second": (both[1], 7.0 + odds)}
    monkeypatch.setattr(
        average, "_average_joint_couplings", lambda _r, _constraint, prior, *, for_intervals: given[prior]
    )
    found = average_two_priors(r, "psd", "first", "second")
    mixed = found.averaged_models
    share = np.array([0.25, 0.75] if likelier else [0.75, 0.25])
    np.testing.assert_allclose(found.pi, (share @ [1.0, 2.0]) * size, rtol=1e-12)
    # as widths count them, with even odds beforehand
    even = (share * [1, average.BEAM_LIKE_LINKS_PRIOR_ODDS]) ** average.INTERVAL_ODDS_EXPONENT
    told, estimates = zip(*mixed.interval_models, strict=True)
    np.testing.assert_allclose(told, even / even.sum(), rtol=1e-12)
    assert list(estimates) == both
    assert mixed.links_and_joints is both[likelier].averaged_models.links_and_joints
    own = mixed.joints_only_weight, mixed.joint_laws_weight
    np.testing.assert_allclose(own, share @ [[0.1, 0.2], [0.5, 0.7]], rtol=1e-12)


@pytest.mark.parametrize("log_evidence", [(0.0, 2.0, 2.5), (3.0, 0.0, 5.5)], ids=["linear", "laws"])
def test_models_of_one_prior_weigh_by_their_evidence_times_the_odds_beforehand(
    kr500, campaign, log_evidence, monkeypatch
):
    """Joints, links and joints, and these with laws: known estimates and evidences, weights by Bayes."""
    s, (e_joints, e_links, e_laws) = add_law_parameters(all153(kr500.arm), kr500.arm), log_evidence
    r, own = seen_by(kr500, campaign, s)
    worth = {"Joints": 3.0, "ALL153": 1.0, s.name: 2.0}

    def learn(_regression, prior, *, for_intervals):
        return WeightedPrior(
            prior, PriorUncertainty(1.0), log_evidence=e_laws if prior.is_joint_law_size.any() else e_links
        )

    def solve(regression, constraint, weighted_prior):
        pi = np.full(regression.structure.n_parameters, worth[regression.structure.name])
        return replace(
            make_estimate(regression, pi, method="known", constraint=constraint),
            weighted_prior=weighted_prior,
        )

    monkeypatch.setattr(average, "learn_prior", learn)
    monkeypatch.setattr(average, "solve", solve)

    def joints_only_log_evidence(_regression, prior):
        return e_joints, WeightedPrior(prior, PriorUncertainty(1.0))

    monkeypatch.setattr(average, "joints_only_log_evidence", joints_only_log_evidence)
    found, together = average._average_joint_couplings(r, "psd", own, for_intervals=True)
    mixed = found.averaged_models
    joints, links = average.JOINTS_ONLY_PRIOR_ODDS * math.exp(e_joints), math.exp(e_links)
    linear, laws = joints + links, math.exp(e_laws) / average.LINEAR_JOINTS_PRIOR_ODDS
    assert together == pytest.approx(math.log(linear + laws))
    assert mixed.joints_only_weight == pytest.approx(joints / linear)
    assert mixed.joint_laws_weight == pytest.approx(laws / (linear + laws))
    even = (average.LINEAR_JOINTS_PRIOR_ODDS * laws / linear) ** average.INTERVAL_ODDS_EXPONENT
    (probability, with_laws), *_ = mixed.interval_models
    assert with_laws is mixed.with_joint_laws
    assert probability == pytest.approx(even / (1 + even))
    straight = links / linear * 1.0 + joints / linear * 3.0 * (s.rows >= 42)
    w, compliances = mixed.joint_laws_weight, s.rows < s.n_compliance_rows
    np.testing.assert_allclose(found.pi, w * 2.0 + (1 - w) * np.where(compliances, straight, 0.0), rtol=1e-12)


def test_poses_and_levels_of_load_are_dealt_out_in_turn(campaign):
    """Levels are pairs of a force and a moment: of equal sums or lengths two of them may still differ."""
    level = np.array([[100.0, 0.0], [0.0, 100.0], [100.0, 50.0], [100.04, 0.0], [50.0, 100.0]])
    data = select_runs(campaign.identification, np.arange(campaign.identification.n_runs) < 5)
    wrench = np.zeros((5, 6))
    wrench[:, [2, 4]] = -level
    data = replace(data, pose_id=np.array([7, 7, 9, 9, 11]), wrench=wrench)
    part = cross_validation_groups(data)
    assert (part // MAX_FOLDS).tolist() == [0, 0, 1, 1, 2]
    load = part % MAX_FOLDS
    assert load[0] == load[3]
    assert len(set(load[[0, 1, 2, 4]])) == 4
    precision = np.tile(np.eye(3), (*data.before.shape[:2], 1, 1))
    precision[0] = 0.0
    assert cross_validation_groups(replace(data, precision=precision)).tolist() == [-1, *part[1:]]


@pytest.mark.parametrize("laws", [False, True])
@pytest.mark.parametrize("make", [all153, mgco68, mgco47])
def test_what_no_reading_speaks_of_weighs_nothing_however_many_blocks_there_are(kr500, campaign, make, laws):
    """Of links and joints: the evidence by the prior alone is log 1, the factor of all blocks held."""
    s = add_law_parameters(make(kr500.arm), kr500.arm) if laws else make(kr500.arm)
    seen = hierarchy.prior_evidence_model(*seen_by(kr500, campaign, s, cad_prior(kr500.arm)))
    mute = replace(
        seen.evidence,
        gram_matrices=0 * seen.evidence.gram_matrices,
        equation_counts=0 * seen.evidence.equation_counts,
    )
    h = np.r_[np.zeros(len(seen.hyperparameter_medians) - 3), seen.hyperparameter_medians[-3:-1], 0.0]
    for k in range(2, seen.scale_kinds.max() + 1):  # sizes of laws beside the prior's
        own = math.log(hierarchy._law_sizes(seen.scaling)[k - 2][0])
        h[seen.n_scales + k], h[: seen.n_scales][seen.scale_kinds == k] = own, own
    at = evidence_posterior(mute, h)
    some = np.setdiff1d(np.arange(len(h) - 1), [seen.n_scales])
    values = np.linalg.eigvalsh(evidence_hessian(mute, at)[0][np.ix_(some, some)])
    assert at.neg_log_evidence == pytest.approx(0, abs=1e-9)
    assert hierarchy._log_evidence(seen, at.neg_log_evidence, values) == pytest.approx(0, abs=1e-9)


def default(cell, seed):
    """The default by the prior of the drawing, wrong as the studies have it, and its structure."""
    [model] = with_priors(cell.arm, named_models(cell, ["ALL153"]), prior_of(cell, "scaled", seed))
    return model.estimator, model.structure


@pytest.mark.study
def test_coupled_joints_are_found_and_where_there_are_none_nothing_moves(kr500):
    """By the true couplings of neighbours; without couplings in the structure the cone bends the fit."""
    for kind, seed in (("tied_joints", 3), ("tubes", 1)):
        cell = true_cell(kr500, kind, seed)
        campaign, (method, s) = simulate(cell, SCENARIO, seed), default(kr500, seed)
        found = method(kr500.vjm, s, campaign.identification)
        alone = method(kr500.vjm, add_law_parameters(all153(kr500.arm), kr500.arm), campaign.identification)
        ours, theirs = errors(kr500, campaign, found, alone)
        assert found.conservative
        if kind == "tubes":
            assert found.averaged_models is None or found.averaged_models.joint_couplings_weight == 0
            assert ours == pytest.approx(theirs, rel=1e-6)
            continue
        assert found.averaged_models.joint_couplings_weight > 0.95
        assert ours < 0.6 * theirs
        true = cell.plant.compliance(campaign.truth.q)[
            np.ix_(cell.plant.joint_spring_indices, cell.plant.joint_spring_indices)
        ]
        own = found.C_theta[42:48, 42:48]
        (a, b), scale = (np.arange(1, 5), np.arange(2, 6)), np.sqrt(np.diag(true))  # no weight turns joint 1
        far = (own - true)[a, b] / (scale[a] * scale[b])
        assert np.abs(far).max() < 0.2 < np.abs(true[a, b] / (scale[a] * scale[b])).min() + 1e-9
        [said] = of_average(found.averaged_models)
        assert "coupled" in said


def test_an_unknown_size_widens_what_the_prior_leaves_open(kr500, campaign, rng):
    """By the mean of its square over what the readings leave open: so large is an error of the prior."""
    own = scale_by_prior(cad_prior(kr500.arm), kr500.vjm, mgco68(kr500.arm))
    r = reduce(kr500.vjm, own.structure, campaign.identification)
    learnt, seen = hierarchy.learn_prior(r, own), hierarchy.prior_evidence_model(r, own)
    h = maximise_evidence(seen.evidence, seen.hyperparameter_medians).h
    bends, _ = evidence_hessian(seen.evidence, evidence_posterior(seen.evidence, h))
    values, Q = np.linalg.eigh(bends[:-1, :-1])
    deviations = 1 / np.sqrt(np.maximum(values, hierarchy.MAX_HYPERPARAMETER_DEVIATION**-2))
    draws = (Q * deviations) @ rng.standard_normal((len(values), 20000))
    size = np.exp(seen.evidence.log_deviation_rows[:, :-1] @ draws)  # over that at the best h
    middle = np.quantile(size, 0.84, axis=1)  # one standard deviation above the median
    np.testing.assert_allclose(learnt.uncertainty_factors, np.exp(np.log(middle) ** 2), rtol=0.1)
    found = solve(r, "none", learnt)
    rows_of_prior, _ = prior_rows(learnt.scaling, learnt.uncertainty)
    B = learnt.uncertainty_factors[:, None] * rows_of_prior
    A, _ = rows_in_prior_units(r, learnt.scaling)
    M = learnt.scaling.L @ np.linalg.inv(A.T @ A + np.diag(rows_of_prior.diagonal() ** 2))
    open_ = learnt.noise_factor**2 * M @ B.T @ B @ M.T
    rows = rng.standard_normal((5, own.structure.n_parameters)) / np.sqrt(np.diag(open_))
    covariance = open_ + learnt.hyperparameter_effect.T @ learnt.hyperparameter_effect
    whole, prior = (one**2 for one in posterior_of_estimate(found)._deviations(rows))
    np.testing.assert_allclose(prior, np.einsum("ki,ij,kj->k", rows, covariance, rows), rtol=1e-6)
    # what links do in a pose that nobody measured is no error of the prior
    W = rng.standard_normal((7, own.structure.n_parameters)) / np.linalg.norm(rows, axis=0)
    wider = posterior_of_estimate(replace(found, regression=replace(r, pose_variation=W)))._deviations(rows)
    np.testing.assert_allclose(wider[0] ** 2, whole + ((rows @ W.T) ** 2).sum(axis=1), rtol=1e-9)
    np.testing.assert_allclose(wider[1] ** 2, prior, rtol=1e-9)


def test_links_that_are_others_in_every_pose_weigh_readings_by_their_covariance(kr500, campaign):
    """By the density of the readings of every pose, dense; the same unknowns, moments and size as by rows."""
    _, s = default(kr500, 3)
    regression, rho = reduce(kr500.vjm, s, campaign.identification), 0.2
    data, pi = campaign.identification, cad_prior(kr500.arm).C_theta[s.rows[:147], s.columns[:147]]
    weighed = weight_for_pose_variation(regression, pi, rho)
    H = np.zeros((s.n_parameters + 1, s.n_parameters + 1))
    link = s.rows // 6
    for pose in np.unique(data.pose_id):
        [term] = reduce(kr500.vjm, s, select_runs(data, data.pose_id == pose)).terms
        rows = math.sqrt(term.n_equations / 3) * np.c_[term.R, term.z]
        each = [rows[:, :-1][:, link == k] @ pi[link[:147] == k] for k in range(7)]
        S = np.eye(len(rows)) + rho**2 * sum(np.outer(a, a) for a in each)
        H += rows.T @ np.linalg.solve(S, rows)
        H[-1, -1] += term.n_equations / 3 * term.unexplained
    A, y = weighed.weighted_equations
    found = np.c_[A, y].T @ np.c_[A, y]
    found[-1, -1] += sum(t.n_equations / 3 * t.unexplained for t in weighed.terms)
    norm = np.sqrt(np.diag(H)) + (np.diag(H) == 0)
    np.testing.assert_allclose(found / norm / norm[:, None], H / norm / norm[:, None], rtol=0, atol=1e-9)
    poses = len(np.unique(data.pose_id))
    width = stats.t.ppf(0.975, poses - 1) / stats.norm.ppf(0.975)  # its size is learnt from so many poses
    np.testing.assert_allclose(weighed.pose_variation[3, link == 3], width * rho * pi[link[:147] == 3])


@pytest.mark.study
def test_links_that_follow_the_pose_widen_intervals_and_others_are_left_alone(kr500):
    for kind, seed in (("following_50", 1), ("tubes", 1)):
        campaign, (method, s) = simulate(true_cell(kr500, kind, seed), SCENARIO, seed), default(kr500, seed)
        regression = reduce(kr500.vjm, s, campaign.identification)
        plain = method.fit_reduced(kr500.vjm, replace(regression, rows_by_pose=()))
        found = method.fit_reduced(kr500.vjm, regression)
        if kind == "tubes":
            assert pose_to_pose_variation(regression, plain) == 0
            np.testing.assert_array_equal(found.pi, plain.pi)
            continue
        assert pose_to_pose_variation(regression, plain) > 0
        covered = []
        for estimate in (plain, found):
            told = intervals(kr500.vjm, estimate, campaign.truth)
            inside = np.abs(told.centre - campaign.truth.deflection) <= (told.upper - told.lower) / 2
            covered.append(inside.mean())
        assert covered[1] > 0.85
        assert found.f_m == pytest.approx(f_m(restrict_regression(regression, found.structure), found.pi))


def test_joints_alone_weigh_a_third_where_links_change_with_the_pose(kr500, campaign, monkeypatch):
    """As least squares has them, of readings as they are; intervals widen by how far the mean moves."""
    method, s = default(kr500, 3)
    regression = reduce(kr500.vjm, s, campaign.identification)
    monkeypatch.setattr(average, "pose_to_pose_variation", lambda *_: 0.2)
    found, share = method.fit_reduced(kr500.vjm, regression), average.MIN_JOINTS_ONLY_WEIGHT
    monkeypatch.setattr(average, "MIN_JOINTS_ONLY_WEIGHT", 0.0)
    changing = method.fit_reduced(kr500.vjm, regression)
    assert found.averaged_models.joint_laws_weight == found.averaged_models.joint_couplings_weight == 0
    joints = joints_only(kr500.arm)
    alone = embed_parameters(
        least_squares(kr500.vjm, joints, campaign.identification).pi, joints, found.structure
    )
    seen = alone > 0  # no weight turns joint 1: it has what the prior says
    np.testing.assert_allclose((found.pi - (1 - share) * changing.pi)[seen], share * alone[seen], rtol=2e-3)
    links = found.structure.rows < 6 * found.structure.n_links
    np.testing.assert_allclose(found.pi[links], (1 - share) * changing.pi[links], rtol=1e-12, atol=1e-24)
    rows = np.random.default_rng(0).standard_normal((5, len(found.pi)))
    told = posterior_of_estimate(found)
    np.testing.assert_array_equal(told.mean, found.pi)
    around = sum(p * (rows @ (e.pi - found.pi)) ** 2 for p, e in found.averaged_models.interval_models)
    own = sum(
        p * posterior_of_estimate(e).standard_deviations(rows) ** 2
        for p, e in found.averaged_models.interval_models
    )
    np.testing.assert_allclose(told.standard_deviations(rows) ** 2, own + around, rtol=1e-9)


@pytest.fixture(scope="module")
def alike(kr500, campaign):
    """The default, the equations of a campaign, and its fit without looking for links that change."""
    method, s = default(kr500, 3)
    regression = reduce(kr500.vjm, s, campaign.identification)
    return method, regression, method.fit_reduced(kr500.vjm, replace(regression, rows_by_pose=()))


def test_poses_left_out_are_predicted_by_a_fit_to_all_others(alike):
    """As least squares on the rows of all others and of the prior predicts them, one fit a pose."""
    _, regression, fit = alike
    whole = fit if fit.averaged_models is None else fit.averaged_models.links_and_joints
    weighted_prior = whole.weighted_prior
    poses = restrict_regression(regression, whole.structure).rows_by_pose
    found = average._held_out_errors(poses, poses, weighted_prior)
    L, (B, c) = weighted_prior.scaling.L, prior_rows(weighted_prior.scaling, weighted_prior.uncertainty)
    for k, held in enumerate(poses):
        rest = np.vstack([rows for other, rows in enumerate(poses) if other != k])
        M, r = np.vstack([rest[:, :-1] @ L, B]), np.r_[rest[:, -1], c]
        left = held[:, :-1] @ (L @ np.linalg.lstsq(M, r, rcond=None)[0]) - held[:, -1]
        assert found[k] == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-6)


@pytest.mark.parametrize(
    ("gains", "changes", "weight"),
    [
        ([0.2, 0.3, 0.4], False, 0.0),  # t = 5.2, of two degrees of freedom 2.9 is sure
        ([0.1, 0.5, 0.9], False, 1.0),  # t = 2.2
        ([-0.2, -0.3, -0.4], False, 1.0),
        (None, False, 0.0),  # without held-out errors the average stays
        ([0.2, 0.3, 0.4], True, average.MIN_JOINTS_ONLY_WEIGHT),
        ([0.1, 0.5, 0.9], True, average.JOINTS_ONLY_WEIGHT_IF_UNSURE),
        ([-0.2, -0.3, -0.4], True, 1.0),
        (None, True, average.MIN_JOINTS_ONLY_WEIGHT),
    ],
)
def test_links_count_where_they_surely_predict_poses_better_that_were_left_out(gains, changes, weight):
    own = np.array([1.0, 2.0, 0.5])
    errors = None if gains is None else (own, own * np.exp(gains))
    assert average.joints_only_weight(errors, links_vary=changes) == weight


def test_links_that_predict_no_better_leave_joints_alone_and_intervals_as_wide(kr500, alike, monkeypatch):
    method, regression, before = alike
    of_two = average._average_priors

    def with_laws_of_half(*args):
        e = of_two(*args)
        return replace(e, averaged_models=replace(average._models_of(e), joint_laws_weight=0.5))

    monkeypatch.setattr(average, "_average_priors", with_laws_of_half)
    monkeypatch.setattr(average.LinksVersusJointsOnly, "links_certain", False)
    monkeypatch.setattr(average.LinksVersusJointsOnly, "held_out_errors", (np.ones(8), np.ones(8)))
    found = method.fit_reduced(kr500.vjm, regression)
    assert (found.averaged_models.joints_only_weight, found.averaged_models.joint_laws_weight) == (1, 0)
    assert not found.pi[found.structure.rows < 6 * found.structure.n_links].any()
    rows = np.random.default_rng(0).standard_normal((5, len(found.pi)))
    assert (
        posterior_of_estimate(found).standard_deviations(rows)
        > posterior_of_estimate(before).standard_deviations(rows)
    ).all()


def test_links_stay_alike_in_all_poses_where_readings_weighed_otherwise_refuse_the_prior(
    kr500, alike, monkeypatch
):
    """Weighed so, readings of coupled joints may want a negative scale of the prior (seen: 1 of 21 arms)."""
    method, regression, plain = alike

    def refused(*_, **__):
        raise BenchError("its best scale is -0.115")

    monkeypatch.setattr(average, "pose_to_pose_variation", lambda *_: 0.2)
    monkeypatch.setattr(average, "average_models", refused)
    np.testing.assert_array_equal(method.fit_reduced(kr500.vjm, regression).pi, plain.pi)
