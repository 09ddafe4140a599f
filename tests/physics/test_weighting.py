"""Readings with a covariance each: weighted fits against brute force, lost targets, a tracker's gain."""

from dataclasses import replace

import numpy as np
import pytest

from testbench.campaign.campaign import Scenario, simulate, stream
from testbench.campaign.tracker import LaserTracker, precision, read_positions
from testbench.data.dataset import select
from testbench.errors import BenchError
from testbench.identify import gco, least_squares, reduce, with_prior
from testbench.identify.evaluate import deflections
from testbench.identify.huber import _accepted
from testbench.identify.least_squares import minimum_norm
from testbench.identify.prior import Strength, cad_prior, distorted
from testbench.identify.weighed import one_by_one
from testbench.model.structure import mgco68, template56
from testbench.model.vjm import chain, observation


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


def test_equal_covariances_are_the_flat_fit(kr500, data):
    P = np.broadcast_to(np.eye(3) / (2 * data.sigma**2), (data.runs, 3, 3, 3))
    flat, full = (reduce(kr500.vjm, mgco68(kr500.arm), d) for d in (data, replace(data, precision=P)))
    np.testing.assert_allclose(minimum_norm(full).pi, minimum_norm(flat).pi, rtol=1e-6, atol=1e-12)
    assert full.f_m_floor == flat.f_m_floor


def test_a_lost_target_counts_as_never_read(kr500, data):
    P = np.array(np.broadcast_to(np.eye(3) / (2 * data.sigma**2), (data.runs, 3, 3, 3)))
    P[4:] = 0
    lost = reduce(kr500.vjm, template56(kr500.arm), replace(data, precision=P))
    never = reduce(kr500.vjm, template56(kr500.arm), select(data, np.arange(data.runs) < 4))
    ours, theirs = normal_of(lost)[0], normal_of(never)[0]
    np.testing.assert_allclose(ours, theirs, atol=1e-10 * np.abs(theirs).max())
    assert lost.equations == never.equations == 36


def test_robust_fit_weighs_readings_alike(kr500, data):
    P = random_precision(data)
    P[3, 0] = 0
    data, structure = replace(data, precision=P), mgco68(kr500.arm)
    readings = one_by_one(kr500.vjm, structure, data)
    assert len(readings.y) == 3 * data.runs - 1
    normal, _, rest = brute_force(kr500, structure, data)
    A = readings.A.reshape(-1, structure.n)
    np.testing.assert_allclose(A.T @ A, normal, atol=1e-10 * np.abs(normal).max())
    assert (readings.y**2).sum() == pytest.approx(rest)


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


def test_weights_of_the_laser_tracker_beat_flat_ones(kr500, data):
    """Gauss and Markov: of all linear unbiased fits, that with the true covariance has the least error.

    Six metres of air: across the beam a reading is five times worse than along it.
    """
    S = LaserTracker((2.2, -5.5, 1.6)).covariance(data.before)  # of a reading; of a deflection twice that
    structure = template56(kr500.arm)
    A = observation(chain(kr500.vjm, data.q), structure, data.wrench, data.point, kr500.vjm.markers)
    flat, weighted = (
        normal_of(reduce(kr500.vjm, structure, d))[0]
        for d in (replace(data, sigma=1.0), replace(data, precision=np.linalg.inv(2 * S)))
    )
    U, s, _ = np.linalg.svd(flat)
    V = U[:, s > 1e-9 * s[0]]  # what these runs identify
    inverse = np.linalg.inv(V.T @ flat @ V)
    k = np.trace(flat) / (A**2).sum()  # flat = k A^T A
    of_flat = k**2 * inverse @ V.T @ np.einsum("rmin,rmij,rmjk->nk", A, 2 * S, A) @ V @ inverse
    of_weighted = np.linalg.inv(V.T @ weighted @ V)
    root = np.linalg.cholesky(V.T @ flat @ V)  # predictions of the measured deflections, whitened
    gain = root.T @ (of_flat - of_weighted) @ root
    assert np.linalg.eigvalsh(gain)[0] > -1e-9 * np.trace(gain)  # better in every direction
    ratio = np.trace(root.T @ of_weighted @ root) / np.trace(root.T @ of_flat @ root)
    assert np.sqrt(ratio) < 0.85  # 0.827


@pytest.mark.parametrize("prior", [False, True])
def test_the_last_digit_of_a_marker_moves_no_prediction(kr500, prior):
    """As another processor would give it; of a tracker whose noise turns with the beam."""
    campaign = simulate(kr500, Scenario(arm="kr500_l480", truth="linear", noise=False), 1)
    wrong = distorted(cad_prior(kr500.arm), scale=2, shape=0.3, rng=stream(1, 5))
    method = with_prior(gco, wrong, Strength(0.3)) if prior else least_squares
    tracker, rng = LaserTracker((2.2, -5.5, 1.6)), np.random.default_rng(1)
    predicted = []
    for digit in (0.0, 1e-15):
        clean = campaign.identification
        true = [p * (1 + digit * rng.uniform(-1, 1, p.shape)) for p in (clean.before, clean.after)]
        noise = stream(2, 1)
        before, after = (read_positions(tracker, p, noise) for p in true)
        data = replace(clean, before=before, after=after, precision=precision(tracker, before, after))
        estimate = method(kr500.vjm, template56(kr500.arm), data)
        predicted.append(deflections(kr500.vjm, estimate, campaign.truth))
    assert (predicted[0] != predicted[1]).any()
    # of 10 mm: the conic solver stops at 1e-8 of the cost, least squares at rounding
    np.testing.assert_allclose(predicted[1], predicted[0], rtol=0, atol=1e-9 if prior else 1e-12)


def test_readings_one_by_one_make_the_terms_that_runs_do_and_each_counts_its_own(kr500, data, rng):
    """Some positions are left out, no orientation: each term is divided by its own equations."""
    before, after = 1e-3 * rng.normal(size=(2, data.runs, 3))
    data = replace(data, rotation_before=before, rotation_after=after, sigma_rotation=1e-4)
    structure = mgco68(kr500.arm)
    readings = one_by_one(kr500.vjm, structure, data)
    keep = (readings.marker != 1) | (readings.run > 3)
    P = np.tile(np.eye(3) / (2 * data.sigma**2), (data.runs, 3, 1, 1))
    P[:4, 1] = 0
    expected = reduce(kr500.vjm, structure, replace(data, precision=P))
    found = _accepted(expected.structure, readings, keep, np.ones(len(keep)))
    for own, other in zip(found.terms, expected.terms, strict=True):
        assert own.equations == other.equations
        for pi in (np.zeros(structure.n), structure.entries(kr500.arm.C_theta)):
            left = [np.sum((t.R @ pi - t.z) ** 2) + t.rest for t in (own, other)]
            assert left[0] == pytest.approx(left[1], rel=1e-9)
