"""Conic programs against closed forms and optimality conditions, with PSD and free blocks."""

import numpy as np
import pytest

from testbench.identify import cone


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
