"""The model side against MuJoCo's Jacobians, against Eq. 6, and against the known ranks."""

import numpy as np
import pytest
from loads import random_q, rotation_observation

from testbench.errors import BenchError
from testbench.identify.regression import non_redundant, rank
from testbench.model.loaded import load_jacobian
from testbench.model.structure import all153, template56
from testbench.model.vjm import chain, observation
from testbench.plant import settle_linear


def jacobian(vjm, q, point=(0.0, 0.0, 0.0)):
    return load_jacobian(chain(vjm, q), np.tile(point, (len(q), 1)))


def cartesian_compliance(J, C_theta):
    return J @ C_theta @ J.swapaxes(1, 2)


def random_load(rng, runs):
    return 1000 * rng.standard_normal((runs, 6)), 0.3 * rng.standard_normal((runs, 3))


@pytest.fixture(params=["kr500", "arm_6r"])
def six_axes(request):
    return request.getfixturevalue(request.param)


def test_observation_matrix_times_parameters_is_the_congruence_of_eq_6(cell, rng):
    """A pi = J C J^T w with the wrench moved to the target's point, Eq. (5), (6) and (12)."""
    q = random_q(cell, rng, 10)
    wrench, _ = random_load(rng, 10)
    C_theta = cell.arm.C_theta
    structure = all153(cell.arm)
    at_tool = np.zeros((10, 3))
    args = (chain(cell.vjm, q), structure, wrench, at_tool)
    moved = observation(*args, np.zeros((1, 3))) @ structure.entries(C_theta)
    turned = rotation_observation(*args) @ structure.entries(C_theta)
    C = cartesian_compliance(jacobian(cell.vjm, q), C_theta)
    expected = np.einsum("rij,rj->ri", C, wrench)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(moved[:, 0], expected[:, :3], rtol=0, atol=1e-13 * scale)
    np.testing.assert_allclose(turned[:, 0], expected[:, 3:], rtol=0, atol=1e-13 * scale)


def test_markers_move_as_in_the_first_order_truth(cell, rng):
    """Partial pose: force at one point, markers at others, against MuJoCo's Jacobians."""
    q = random_q(cell, rng, 10)
    wrench, point = random_load(rng, 10)
    structure = all153(cell.arm)
    A = observation(chain(cell.vjm, q), structure, wrench, point, cell.vjm.markers)
    start = settle_linear(cell.plant, q, 0 * wrench, point).markers
    moved = settle_linear(cell.plant, q, wrench, point).markers - start
    predicted = A @ structure.entries(cell.arm.C_theta)
    np.testing.assert_allclose(predicted, moved, rtol=0, atol=1e-14)


def test_algebraic_reduction_finds_the_32_parameters_of_mls32(six_axes, rng):
    full = template56(six_axes.arm)
    reduced = non_redundant(six_axes.vjm, full, name="MLS32")
    assert (reduced.name, reduced.n) == ("MLS32", 32)
    q = random_q(six_axes, rng, 30)
    wrench, point = random_load(rng, 30)
    A, B = (
        observation(chain(six_axes.vjm, q), s, wrench, point, six_axes.vjm.markers).reshape(-1, s.n)
        for s in (full, reduced)
    )
    assert rank(B) == rank(A)  # and so every prediction of the 56 can be had from the 32
    assert rank(np.hstack([A, B])) == rank(B)


def test_wrong_shapes_say_what_was_expected(kr500):
    with pytest.raises(BenchError, match=r"q \[rad, m\]: expected shape \(any, 6\), got \(2, 5\)"):
        chain(kr500.vjm, np.zeros((2, 5)))
    with pytest.raises(BenchError, match="finite"):
        chain(kr500.vjm, np.full((2, 6), np.nan))
