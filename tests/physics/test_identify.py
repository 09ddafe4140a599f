"""Least squares and GCO: optimality, readings with a covariance each, honesty about what is not solved."""

from dataclasses import replace

import numpy as np
import pytest
from loads import SIGMA, SIGMA_ROTATION, axis_loads, rotation_observation

from testbench.campaign.advice import advice
from testbench.campaign.campaign import Scenario, simulate
from testbench.errors import BenchError
from testbench.identify import cone, gco, interior, least_squares, reduce
from testbench.identify.certify import bound, default_trace_bounds, gradient_dual
from testbench.identify.regression import RANK_TOLERANCE, f_m, rank
from testbench.model.structure import Structure, mgco47, mgco68, mgco69
from testbench.model.vjm import chain, observation


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


def test_f_m_of_a_reduced_dataset_is_eq_19_on_its_readings_and_its_gradient_a_difference(arm_6r, rng):
    data = axis_loads(arm_6r, rng)
    s = mgco69(arm_6r.arm)
    pi = rng.uniform(0, 1e-6, s.n)
    args = (chain(arm_6r.vjm, data.q), s, data.wrench, data.point)
    e = observation(*args, np.zeros((1, 3))) @ pi - data.deflection
    r = (rotation_observation(*args) @ pi)[:, 0] - data.rotation
    expected = np.sqrt((e**2).sum() / data.runs) / (np.sqrt(2) * SIGMA)
    expected += np.sqrt((r**2).sum() / data.runs) / (np.sqrt(2) * SIGMA_ROTATION)
    regression = reduce(arm_6r.vjm, s, data)
    assert f_m(regression, pi) == pytest.approx(expected, rel=1e-12)
    g, h = f_m_gradient(regression, pi), 1e-4 * pi
    unit = np.eye(len(pi))
    numeric = [
        (f_m(regression, pi + h[k] * unit[k]) - f_m(regression, pi - h[k] * unit[k])) / (2 * h[k])
        for k in range(len(pi))
    ]
    np.testing.assert_allclose(g * pi, numeric * pi, rtol=1e-4, atol=1e-6 * np.abs(g * pi).max())


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


def test_an_empty_dataset_is_an_error(kr500):
    data = gravity_data(kr500, 1).identification
    none = replace(
        data,
        **{n: getattr(data, n)[:0] for n in ("run", "pose", "q", "wrench", "point", "before", "after")},
    )
    with pytest.raises(BenchError, match="expected at least one run"):
        gco(kr500.vjm, mgco47(kr500.arm), none)


@pytest.fixture(scope="module")
def data(kr500):
    return simulate(kr500, Scenario(arm="kr500_l480", truth="linear"), 1).identification


def random_precision(data, seed=0):
    A = np.random.default_rng(seed).normal(size=(data.runs, 3, 3, 3))
    return 1e8 * (A @ A.swapaxes(2, 3) + 0.1 * np.eye(3))


def brute_force(kr500, structure, data):
    """Rows and readings of Eq. 14 with the full weight matrix, nothing folded."""
    A = observation(chain(kr500.vjm, data.q), structure, data.wrench, data.point, kr500.vjm.markers)
    P = data.precision
    normal = np.einsum("rmin,rmij,rmjk->nk", A, P, A)
    right = np.einsum("rmin,rmij,rmj->n", A, P, data.deflection)
    rest = np.einsum("rmi,rmij,rmj->", data.deflection, P, data.deflection)
    return normal, right, rest


def normal_of(regression):
    term = regression.terms[0]
    return term.equations / 3 * term.R.T @ term.R, term.equations / 3 * term.R.T @ term.z


@pytest.mark.parametrize("lost", [False, True])
def test_reduced_rows_are_those_of_the_full_weight_matrix(kr500, data, lost):
    P = random_precision(data)
    if lost:
        P[2, 1] = P[5] = 0
    data, structure = replace(data, precision=P), mgco68(kr500.arm)
    regression = reduce(kr500.vjm, structure, data)
    normal, right, rest = brute_force(kr500, structure, data)
    ours = normal_of(regression)
    np.testing.assert_allclose(ours[0], normal, atol=1e-10 * np.abs(normal).max())
    np.testing.assert_allclose(ours[1], right, atol=1e-10 * np.abs(right).max())
    term = regression.terms[0]
    assert term.equations == 3 * data.seen.sum()
    assert term.equations / 3 * (term.z @ term.z + term.rest) == pytest.approx(rest)


@pytest.mark.parametrize(
    "wrong",
    [
        np.diag([1.0, 1.0, -1.0]),
        np.array([[1.0, 0.5, 0], [0, 1, 0], [0, 0, 1]]),
        np.diag([1.0, 1.0, 0.0]),
    ],
)
def test_a_precision_that_is_none_is_refused(data, wrong):
    P = np.array(np.broadcast_to(np.eye(3), (data.runs, 3, 3, 3)))
    P[1, 2] = wrong
    with pytest.raises(BenchError, match=r"precision .* in place 1, 2"):
        replace(data, precision=P)
