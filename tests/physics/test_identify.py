"""Least squares and GCO: recovery, optimality, honesty about what is not solved."""

from dataclasses import replace

import numpy as np
import pytest
from loads import SIGMA, SIGMA_ROTATION, axis_loads

from testbench.campaign.advice import advice
from testbench.campaign.campaign import Scenario, simulate
from testbench.errors import BenchError
from testbench.identify import cone, gco, interior, least_squares, make_estimate, reduce
from testbench.identify.certify import bound, default_trace_bounds, gradient_dual
from testbench.identify.evaluate import deflections, score
from testbench.identify.regression import RANK_TOLERANCE, f_m, rank
from testbench.model.structure import Structure, all153, mgco47, mgco68, mgco69, mgco147, template56
from testbench.model.vjm import chain, observation, rotation_observation


def f_m_gradient(regression, pi):
    """What the certificate takes for the gradient of F_M."""
    return sum(
        term.R.T @ y for term, y in zip(regression.terms, gradient_dual(regression, pi).y, strict=True)
    )


def gravity_data(cell, seed, truth="linear", noise=True):
    scenario = Scenario(arm="kr500_l480", truth=truth, noise=noise, workspace_poses=20)
    return simulate(cell, scenario, seed)


@pytest.mark.parametrize("decades", [4, 8, 9, 10, 14])
def test_rank_is_that_of_the_singular_values_in_doubt_too(rng, decades):
    """A spectrum that ends before, at or behind the tolerance, columns in units of their own."""
    U, V = (np.linalg.qr(rng.normal(size=(30, 30)))[0] for _ in "UV")
    A = (U * np.logspace(0, -decades, 30)) @ V.T
    own = A / np.linalg.norm(A, axis=0)
    s = np.linalg.svd(own, compute_uv=False)
    clear = np.abs(s / s[0] - RANK_TOLERANCE).min() > 1e-12  # else rounding decides
    assert clear
    assert rank(own * np.logspace(-4, 4, 30)) == (s > RANK_TOLERANCE * s[0]).sum()


def test_f_m_of_a_reduced_dataset_is_eq_19_on_its_readings(arm_6r, rng):
    data = axis_loads(arm_6r, rng)
    s = mgco69(arm_6r.arm)
    pi = rng.uniform(0, 1e-6, s.n)
    args = (chain(arm_6r.vjm, data.q), s, data.wrench, data.point)
    e = observation(*args, np.zeros((1, 3))) @ pi - data.deflection
    r = (rotation_observation(*args) @ pi)[:, 0] - data.rotation
    expected = np.sqrt((e**2).sum() / data.runs) / (np.sqrt(2) * SIGMA)
    expected += np.sqrt((r**2).sum() / data.runs) / (np.sqrt(2) * SIGMA_ROTATION)
    assert f_m(reduce(arm_6r.vjm, s, data), pi) == pytest.approx(expected, rel=1e-12)


def test_gradient_of_f_m_is_its_finite_difference(arm_6r, rng):
    data = axis_loads(arm_6r, rng)
    regression = reduce(arm_6r.vjm, template56(arm_6r.arm), data)
    pi = regression.structure.entries(arm_6r.arm.C_theta) * 1.1
    g = f_m_gradient(regression, pi)
    h = 1e-6 * np.abs(pi)
    unit = np.eye(len(pi))
    numeric = [
        (f_m(regression, pi + h[k] * unit[k]) - f_m(regression, pi - h[k] * unit[k])) / (2 * h[k])
        for k in range(len(pi))
    ]
    np.testing.assert_allclose(g * pi, numeric * pi, rtol=1e-4, atol=1e-7)


def test_reduction_in_blocks_gives_the_factor_of_all_rows_at_once(kr500):
    data = gravity_data(kr500, 1).measured
    many = replace(
        data,
        **{
            name: np.tile(getattr(data, name), (60, *[1] * (getattr(data, name).ndim - 1)))
            for name in ("q", "wrench", "point", "before", "after")
        },
        run=np.arange(60 * data.runs),
        pose=np.tile(data.pose, 60),
    )
    s = template56(kr500.arm)
    one, sixty = reduce(kr500.vjm, s, data), reduce(kr500.vjm, s, many)
    # the same runs sixty times: the same mean squares, so the same F_M at any pi
    for scale in (0.0, 1.0, 1.7):
        pi = scale * s.entries(kr500.arm.C_theta)
        assert f_m(sixty, pi) == pytest.approx(f_m(one, pi), rel=1e-9)
    assert sixty.rank == one.rank


def test_least_squares_solves_the_normal_equations_of_eq_15(arm_6r, rng):
    data = axis_loads(arm_6r, rng)
    s = Structure.of(arm_6r.arm, joints=[j.name for j in arm_6r.arm.joints])
    args = (chain(arm_6r.vjm, data.q), s, data.wrench, data.point)
    A = observation(*args, np.zeros((1, 3))).reshape(-1, s.n) / (np.sqrt(2) * SIGMA)
    B = rotation_observation(*args).reshape(-1, s.n)
    A = np.vstack([A, B / (np.sqrt(2) * SIGMA_ROTATION)])
    y = np.r_[
        data.deflection.ravel() / (np.sqrt(2) * SIGMA),
        data.rotation.ravel() / (np.sqrt(2) * SIGMA_ROTATION),
    ]
    M = A.T @ A
    estimate = least_squares(arm_6r.vjm, s, data)
    np.testing.assert_allclose(estimate.pi, np.linalg.solve(M, A.T @ y), rtol=1e-8)


@pytest.mark.parametrize("estimator", [least_squares, gco])
@pytest.mark.parametrize("structure", [mgco147, template56])
def test_predictions_are_recovered_from_noise_free_linear_data(kr500, estimator, structure):
    """Redundant or not, seen poses and the loads on them come out to 1e-9 m, in every seed."""
    for seed in range(1, 11):
        data = gravity_data(kr500, seed, noise=False).identification
        estimate = estimator(kr500.vjm, structure(kr500.arm), data)
        assert estimate.status == "solved"
        error = deflections(kr500.vjm, estimate, data) - data.deflection
        assert np.abs(error).max() < 1e-9


def test_predictions_at_unseen_poses_are_recovered_where_the_data_see_all(arm_6r, rng):
    data = axis_loads(arm_6r, rng, noise=0.0, poses=30)
    unseen = axis_loads(arm_6r, rng, noise=0.0, poses=10)
    for estimator in (least_squares, gco):
        estimate = estimator(arm_6r.vjm, template56(arm_6r.arm), data)
        assert estimate.regression.rank == 32
        assert np.abs(deflections(arm_6r.vjm, estimate, unseen) - unseen.deflection).max() < 1e-9


def test_of_a_fit_that_the_data_determine_there_is_nothing_to_say(arm_6r, rng):
    data = axis_loads(arm_6r, rng)
    for estimator in (least_squares, gco):
        estimate = estimator(arm_6r.vjm, Structure.of(arm_6r.arm, links=["link_3"]), data)
        assert estimate.regression.rank == 21
        assert not [said for said in advice(estimate) if "filled" in said or "free" in said]


@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_gco_is_not_called_solved_unless_it_is_when_deflections_do_not_fit_their_sigma(kr500, factor):
    """Deflections a million times smaller or larger at the same sigma: F_M scales with them."""
    data = gravity_data(kr500, 4).identification
    scaled = replace(data, before=factor * data.before, after=factor * data.after)
    estimate = gco(kr500.vjm, mgco47(kr500.arm), scaled)
    reference = gco(kr500.vjm, mgco47(kr500.arm), data)
    assert estimate.status == "solved"
    assert estimate.f_m == pytest.approx(factor * reference.f_m, rel=1e-6)


def test_gco_is_not_called_solved_when_the_solver_is_stopped_early(kr500, monkeypatch):
    data = gravity_data(kr500, 4).identification
    solved = gco(kr500.vjm, mgco68(kr500.arm), data)
    settings = cone.settings(cone.TOLERANCE)
    settings.max_iter = 4
    monkeypatch.setattr(cone, "settings", lambda _: settings)
    monkeypatch.setattr(interior, "ITERATIONS", 4)  # and ours, which comes first
    stopped = gco(kr500.vjm, mgco68(kr500.arm), data)
    assert stopped.status.startswith("not solved: Clarabel says")
    assert stopped.conservative  # poor, but never unphysical
    bounds = default_trace_bounds(solved.regression, solved.pi)
    proof = bound(stopped.regression, stopped.pi, gradient_dual(stopped.regression, stopped.pi), bounds)
    assert proof.f_m_excess_bound >= stopped.f_m - solved.f_m


def test_gco_survives_columns_that_no_load_touches(kr500):
    data = gravity_data(kr500, 4).identification
    idle = replace(data, wrench=np.zeros_like(data.wrench))
    for structure in (mgco68(kr500.arm), Structure.of(kr500.arm, joints=["joint_1"])):
        estimate = gco(kr500.vjm, structure, idle)
        assert estimate.status == "solved"
        assert np.abs(estimate.pi).max() == 0.0
        assert estimate.regression.rank == 0
        assert "see 0 directions" in advice(estimate)[0]
    assert np.abs(least_squares(kr500.vjm, mgco68(kr500.arm), idle).pi).max() == 0


def test_fewer_runs_than_unknown_directions_is_a_rank_report_not_a_crash(kr500):
    data = gravity_data(kr500, 4).identification
    one = replace(
        data,
        **{n: getattr(data, n)[:1] for n in ("run", "pose", "q", "wrench", "point", "before", "after")},
    )
    for estimator in (least_squares, gco):
        estimate = estimator(kr500.vjm, mgco68(kr500.arm), one)
        assert estimate.regression.rank == 6
        assert "68 unknowns, the data see 6 directions" in advice(estimate)[0]
        assert np.isfinite(estimate.pi).all()


def test_f_m_of_least_squares_lies_at_its_floor(kr500):
    """Linear truth that the structure contains: mean of F_M^2 over seeds is floor^2."""
    ratios = []
    for seed in range(20):
        estimate = least_squares(kr500.vjm, mgco147(kr500.arm), gravity_data(kr500, seed).identification)
        ratios.append((estimate.f_m / estimate.f_m_floor) ** 2)
    # chi-square with 87 degrees of freedom over 20 seeds: sd of the mean sqrt(2/87/20) = 0.034; 4 sd
    assert np.mean(ratios) == pytest.approx(1, abs=0.136)


def test_full_pose_certified_gco_of_all_153_unknowns(arm_6r, rng):
    data = axis_loads(arm_6r, rng)
    estimate = gco(arm_6r.vjm, all153(arm_6r.arm), data)
    assert estimate.status == "solved"
    assert estimate.conservative
    assert estimate.regression.rank == 105
    # two terms, each near sqrt(3) sqrt(1 - 105/648); the cone leaves fewer than 105 free directions
    assert estimate.f_m == pytest.approx(estimate.f_m_floor, rel=0.1)
    assert estimate.certificate.f_m_excess_bound < 0.05 * estimate.f_m


def test_a_users_own_estimator_plugs_in(kr500):
    def stiff(vjm, structure, data):
        return make_estimate(reduce(vjm, structure, data), np.zeros(structure.n), method="rigid arm")

    data = gravity_data(kr500, 1).identification
    estimate = stiff(kr500.vjm, mgco47(kr500.arm), data)
    assert estimate.conservative
    assert estimate.status == "not certified"
    assert "wrong structure, sigma, load" in " ".join(advice(estimate))
    assert score(deflections(kr500.vjm, estimate, data), data.deflection).max_relative == pytest.approx(1)
    with pytest.raises(BenchError, match="finite"):
        make_estimate(estimate.regression, np.full(47, np.nan), method="broken")


def test_relative_error_is_none_where_nothing_moved():
    assert score(np.ones((2, 3, 3)), np.zeros((2, 3, 3))).max_relative is None


def test_an_empty_dataset_is_an_error(kr500):
    data = gravity_data(kr500, 1).identification
    none = replace(
        data,
        **{n: getattr(data, n)[:0] for n in ("run", "pose", "q", "wrench", "point", "before", "after")},
    )
    with pytest.raises(BenchError, match="expected at least one run"):
        gco(kr500.vjm, mgco47(kr500.arm), none)
