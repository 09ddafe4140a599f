"""Readings with a covariance each: weighted fits against brute force, lost targets, a tracker's gain."""

from dataclasses import replace

import numpy as np
import pytest

from testbench.campaign.campaign import Scenario, simulate
from testbench.errors import BenchError
from testbench.identify import reduce
from testbench.model.structure import mgco68
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
