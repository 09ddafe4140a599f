"""Least squares and GCO: optimality, what the data cannot see, readings with a covariance, honesty."""

from dataclasses import replace

import numpy as np
import pytest
from loads import SIGMA, SIGMA_ROTATION, axis_loads, rotation_observation

from testbench import BenchError, Scenario, simulate
from testbench.data.dataset import select_rows
from testbench.identify.conic import gradient_dual
from testbench.identify.method import gco, least_squares
from testbench.identify.observability import describe_identifiability, sample_task_rows
from testbench.identify.prior import PriorUncertainty, cad_prior, rows_in_prior_units, scale_by_prior
from testbench.identify.regression import RANK_TOLERANCE, f_m, generic_observation_matrix, rank, reduce
from testbench.model.structure import Structure, all153, mgco47, mgco68, mgco69, mls36, template56
from testbench.model.vjm import evaluate_chain, observation_matrix
from testbench.workflows.advice import advice
from testbench.workflows.fit_numbers import unseen_poses


@pytest.fixture(scope="module")
def data(kr500):
    """Eight poses under 460 kg, three markers: section 6."""
    scenario = Scenario(arm="kr500_l480", truth="linear", workspace_poses=1)
    return simulate(kr500, scenario, 1).identification


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


def test_least_squares_solves_eq_15_and_f_m_is_eq_19_with_its_gradient(arm_6r, rng):
    """On readings as they are, positions and orientations; what the certificate takes for the gradient."""
    data = axis_loads(arm_6r, rng)
    s = Structure.of(arm_6r.arm, joints=[j.name for j in arm_6r.arm.joints])
    args = (evaluate_chain(arm_6r.vjm, data.q), s, data.wrench, data.point)
    A = observation_matrix(*args, np.zeros((1, 3))).reshape(-1, s.n_parameters) / (np.sqrt(2) * SIGMA)
    B = rotation_observation(*args).reshape(-1, s.n_parameters) / (np.sqrt(2) * SIGMA_ROTATION)
    y = data.deflection.ravel() / (np.sqrt(2) * SIGMA)
    z = data.rotation.ravel() / (np.sqrt(2) * SIGMA_ROTATION)
    estimate = least_squares(arm_6r.vjm, s, data)
    np.testing.assert_allclose(estimate.pi, np.linalg.solve(A.T @ A + B.T @ B, A.T @ y + B.T @ z), rtol=1e-8)
    regression, pi = reduce(arm_6r.vjm, s, data), rng.uniform(0, 1e-6, s.n_parameters)
    expected = (np.linalg.norm(A @ pi - y) + np.linalg.norm(B @ pi - z)) / np.sqrt(data.n_runs)
    assert f_m(regression, pi) == pytest.approx(expected, rel=1e-12)
    dual = gradient_dual(regression, pi).y
    g = sum(term.R.T @ own for term, own in zip(regression.terms, dual, strict=True))
    steps = 1e-4 * np.diag(pi)
    change = [(f_m(regression, pi + h) - f_m(regression, pi - h)) / 2e-4 for h in steps]
    np.testing.assert_allclose(g * pi, change, rtol=1e-4, atol=1e-6 * np.abs(g * pi).max())


def test_an_empty_dataset_and_a_structure_that_leaves_the_symmetry_open_are_refused(kr500, data):
    with pytest.raises(BenchError, match="expected at least one run"):
        gco(kr500.vjm, mgco47(kr500.arm), select_rows(data, slice(0)))
    with pytest.raises(BenchError, match="symmetric structure"):
        report_of(kr500, mls36(kr500.arm), data)


@pytest.mark.parametrize("lost", [False, True])
def test_reduced_rows_are_those_of_the_full_weight_matrix(kr500, data, lost):
    A = np.random.default_rng(0).normal(size=(data.n_runs, 3, 3, 3))
    P = 1e8 * (A @ A.swapaxes(2, 3) + 0.1 * np.eye(3))
    if lost:
        P[2, 1] = P[5] = 0
    data, s = replace(data, precision=P), mgco68(kr500.arm)
    A = observation_matrix(evaluate_chain(kr500.vjm, data.q), s, data.wrench, data.point, kr500.vjm.markers)
    y, [term] = data.deflection, reduce(kr500.vjm, s, data).terms
    normal, right = np.einsum("rmin,rmij,rmjk->nk", A, P, A), np.einsum("rmin,rmij,rmj->n", A, P, y)
    ours = term.n_equations / 3 * term.R.T @ np.column_stack([term.R, term.z])
    np.testing.assert_allclose(ours[:, :-1], normal, atol=1e-10 * np.abs(normal).max())
    np.testing.assert_allclose(ours[:, -1], right, atol=1e-10 * np.abs(right).max())
    assert term.n_equations == 3 * data.is_measured.sum()
    rest = np.einsum("rmi,rmij,rmj->", y, P, y)
    assert term.n_equations / 3 * (term.z @ term.z + term.unexplained) == pytest.approx(rest)


@pytest.mark.parametrize("wrong", [np.diag([1.0, 1, -1]), np.eye(3) + np.eye(3, k=1), np.diag([1.0, 1, 0])])
def test_a_precision_that_is_none_is_refused(data, wrong):
    P = np.array(np.broadcast_to(np.eye(3), (data.n_runs, 3, 3, 3)))
    P[1, 2] = wrong
    with pytest.raises(BenchError, match=r"precision .* in place 1, 2"):
        replace(data, precision=P)


STRENGTH = PriorUncertainty(0.3)


@pytest.fixture(scope="module")
def full_pose(arm_6r):
    """Random poses, six axis loads each, full pose read: section 5.2."""
    return axis_loads(arm_6r, np.random.default_rng(52))


def report_of(cell, structure, data, uncertainty=STRENGTH):
    return describe_identifiability(
        cell.vjm, reduce(cell.vjm, structure, data), data, cad_prior(cell.arm), uncertainty
    )


def proposal(report, start):
    return next(p for p in report.proposals if p.description.startswith(start))


@pytest.mark.parametrize(
    ("structure", "many"),
    [(all153, [89]), (mgco68, [49]), (mgco47, [36]), (template56, [27, 28])],
)
def test_ranks_under_gravity_are_those_of_the_paper(kr500, data, structure, many):
    report = report_of(kr500, structure(kr500.arm), data)
    assert report.structure.n_parameters - len(report.lost_to_structure) - len(report.lost_to_loads) in many
    assert report.rank == reduce(kr500.vjm, report.structure, data).rank
    assert report.rank <= report.max_independent_equations == 48
    # the spread is the diagonal of a projector: its trace is its dimension, up to rounding
    assert report.participation_lost_to_poses.sum() == pytest.approx(report.n_lost_to_poses, abs=1e-9)


@pytest.mark.parametrize(
    ("structure", "seen", "lost"), [(all153, 105, 48), (mgco69, 56, 13), (template56, 32, 24)]
)
def test_full_pose_and_full_wrench_lose_to_structure_alone(arm_6r, full_pose, structure, seen, lost):
    report = report_of(arm_6r, structure(arm_6r.arm), full_pose)
    assert report.rank == seen
    assert len(report.lost_to_structure) == lost
    assert report.lost_to_loads == ()
    assert report.n_lost_to_poses == 0


def test_what_is_named_is_not_seen_joint_1_by_no_weight_and_a_side_load_restores_it(kr500, data):
    """Leaving one parameter of each structural direction out costs no rank."""
    structure = mgco68(kr500.arm)
    report = report_of(kr500, structure, data)
    A = generic_observation_matrix(kr500.vjm, structure)
    for d in report.lost_to_structure:
        part = A[:, [*d.parameters, *d.minor_parameters]]
        assert rank(part) < part.shape[1]
        assert rank(np.delete(A, d.parameters[0], axis=1)) == rank(A)
    s = Structure.of(kr500.arm, joints=["joint_1", "joint_2"])
    report = report_of(kr500, s, data)
    assert (report.rank, report.lost_to_structure) == (1, ())
    assert report.explained_share[0] == 0.0
    [row] = unseen_poses(report)
    assert row == {"why": "loads", "parts": "joint_1", "directions": 1, "parameters": "joint_1"}
    assert proposal(report, "the same force, as a side load along world y").rank == 2
    side = np.zeros_like(data.wrench)
    side[:, 1] = 4500.0
    assert report_of(kr500, s, replace(data, wrench=side)).lost_to_loads == ()


def test_expected_error_is_that_of_draws_from_prior_and_noise(kr500, data):
    """Monte Carlo: compliance drawn from the prior, identified by regularised least squares."""
    structure = mgco47(kr500.arm)
    known = PriorUncertainty(
        0.3, 1e-9
    )  # a known common scale: the prior's covariance is 0.3^2 times the identity
    report = report_of(kr500, structure, data, known)
    m = scale_by_prior(cad_prior(kr500.arm), kr500.vjm, structure)
    A, _ = rows_in_prior_units(reduce(kr500.vjm, structure, data), m)
    rng, n, draws = np.random.default_rng(5), structure.n_parameters, 2000
    x = 0.3 * rng.standard_normal((draws, n))
    y = x @ A.T + rng.standard_normal((draws, len(A)))
    both = np.vstack([A, np.eye(n) / 0.3]), np.vstack([y.T, np.zeros((n, draws))])
    found = np.linalg.lstsq(*both, rcond=None)[0].T
    wrong = np.einsum("pmin,dn->dpmi", sample_task_rows(kr500.vjm, data, structure) @ m.L, found - x)
    rms = np.sqrt(3 * (wrong**2).mean())
    # 2000 draws of at least ten effective directions: relative sd of the RMS below 1 %; 4 sd
    assert report.expected_error == pytest.approx(rms, rel=0.04)


def test_data_without_load_are_a_report_not_a_crash(kr500, data):
    idle = replace(data, wrench=np.zeros_like(data.wrench))
    for structure in (mgco68(kr500.arm), Structure.of(kr500.arm, joints=["joint_1"])):
        estimate = gco(kr500.vjm, structure, idle)
        assert estimate.status == "solved"
        assert np.abs(estimate.pi).max() == estimate.regression.rank == 0
        assert "rank 0" in advice(estimate)[0]
        assert np.abs(least_squares(kr500.vjm, structure, idle).pi).max() == 0
    report = report_of(kr500, mgco47(kr500.arm), idle)
    assert report.rank == 0
    assert not report.explained_share.any()
    assert report.expected_error == np.inf
    assert sum(row.directions for row in unseen_poses(report)) == report.structure.n_parameters
