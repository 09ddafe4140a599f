"""A periodic error that joints share, each turned by an angle of its own, is found; others are left alone."""

from types import SimpleNamespace

import numpy as np
import pytest

from testbench.identify.absolute.evidence import Learnt
from testbench.identify.absolute.inner import eliminate
from testbench.identify.absolute.pattern import Pattern, basis, find, turned, waves
from testbench.identify.fold import Part, Reduced
from testbench.model.joint_errors import JointErrors

ORDERS = tuple(range(1, 21))
ERRORS = JointErrors(ORDERS, play=True)
HIGH = np.arange(3, 21)  #: Orders that a pattern may have.
K = len(HIGH)
READ, NOISE, SIZE, OWN = 200, 50e-6, 60e-6, 20e-6
PLACED = {0: (0.0, 1), 2: (1.9, -1), 3: (-2.4, 1)}  #: Turn [rad] and sense of the joints that share it.


def phi(q):
    """Sines, then cosines of all high orders, (rows, 2 K)."""
    return np.hstack([np.sin(np.outer(q, HIGH)), np.cos(np.outer(q, HIGH))])


def test_a_pattern_turned_and_mirrored_is_its_error_at_the_turned_angle(rng):
    f, q = rng.normal(size=2 * K), rng.uniform(-3, 3, 30)
    for turn, sense in PLACED.values():
        np.testing.assert_allclose(phi(q) @ turned(f, turn, sense, HIGH), sense * phi(sense * q + turn) @ f)


def test_waves_are_the_pattern_of_their_joints_and_differences_that_add_up_to_none(rng):
    """Whatever joints without the pattern, low orders and other unknowns are."""
    pattern = Pattern(tuple(PLACED), *map(tuple, zip(*PLACED.values(), strict=True)))
    first, size = 7, 7 + 4 * ERRORS.size + 5
    B, z = basis(pattern, ERRORS, first, size).toarray(), rng.normal(size=size)
    np.testing.assert_allclose((B.T @ B) / np.diag(B.T @ B), np.eye(size), atol=1e-12)
    at = first + ERRORS.size * np.arange(4)[:, None] + waves(ERRORS)
    x, rest = B @ z, np.setdiff1d(np.arange(size), at[list(PLACED)])
    np.testing.assert_allclose(x[rest], z[rest])
    off = [turned(np.eye(2 * K), *PLACED[j], HIGH) @ x[at[j]] for j in PLACED]  # its inverse is its transpose
    np.testing.assert_allclose(np.mean(off, axis=0), z[at[0]], atol=1e-12)
    assert np.sum((off - z[at[0]]) ** 2) == pytest.approx(np.sum(z[at[[2, 3]]] ** 2))


def told(errors, ranges, rng):
    """What readings of joints in these ranges tell of their waves."""
    found = []
    for x, (low, high) in zip(errors, ranges, strict=True):
        A = phi(rng.uniform(low, high, READ)) / NOISE
        found.append((A.T @ A, A.T @ (A @ x + rng.standard_normal(READ))))
    return found


def sought(readings):
    return find(readings, np.full(2 * K, OWN**2), np.full(2 * K, SIZE**2), HIGH)


@pytest.mark.parametrize("seed", range(1000, 1005))
def test_joints_that_share_a_pattern_are_found_with_their_turns(seed):
    """The one with errors of its own, and the one that was hardly turned, are left out."""
    rng = np.random.default_rng(seed)
    f = SIZE * rng.standard_normal(2 * K)
    errors = [turned(f, *PLACED.get(j, (1.0, 1)), HIGH) + OWN * rng.standard_normal(2 * K) for j in range(5)]
    errors[1] = SIZE * rng.standard_normal(2 * K)
    pattern = sought(told(errors, [(-2.5, 2.5), (-2.5, 2.5), (-1.5, 3.5), (-3.5, 1.5), (0.5, 0.6)], rng))
    assert pattern.joints == tuple(PLACED)
    assert pattern.senses == tuple(sense for _, sense in PLACED.values())
    np.testing.assert_allclose(pattern.turns, [turn for turn, _ in PLACED.values()], atol=np.radians(3))


@pytest.mark.parametrize("seed", range(1000, 1010))
def test_errors_that_are_each_joints_own_share_no_pattern(seed):
    rng = np.random.default_rng(seed)
    errors = SIZE * rng.standard_normal((4, 2 * K))
    assert sought(told(errors, [(-3, 3)] * 4, rng)) is None
    lines = errors * np.isin(np.tile(HIGH, 2), (5, 10))  # a gear's own orders look alike at many turns
    assert sought(told(lines, [(-3, 3)] * 4, rng)) is None


def test_what_is_found_by_a_pattern_is_as_sure_in_si_units(rng):
    """Unknowns and precision by normal equations in which the prior alone knows the pattern.

    They spend the trace of the hat matrix: free ones a whole equation each.
    """
    pattern = Pattern((0, 1), (0.0, 1.1), (1, -1))
    errors = JointErrors(tuple(range(1, 5)))
    size = 2 * errors.size
    B, A, y = basis(pattern, errors, 0, size), rng.normal(size=(40, size)), rng.normal(size=40)
    deviation, factor = np.r_[rng.uniform(0.5, 2.0, size - 3), [np.inf] * 3], 1.7
    own = SimpleNamespace(
        rigid=size, columns=np.arange(size), elastic=None, unknowns=SimpleNamespace(size=size, basis=B)
    )
    R = np.linalg.qr(np.column_stack([A, y]), mode="r")
    plain = Reduced((0,), (Part(0, (R.T @ R)[None], np.array([40])),), {0: R})
    found = eliminate(own, plain.turned(B), Learnt(deviation, np.array([factor])))
    back = np.linalg.inv(B.toarray())
    P = A.T @ A / factor**2 + back.T @ np.diag(deviation**-2.0) @ back
    np.testing.assert_allclose(found.root.T @ found.root, P, atol=1e-9)
    np.testing.assert_allclose(found.x, np.linalg.solve(P, A.T @ y / factor**2))
    assert found.spent == pytest.approx(np.trace(A @ np.linalg.solve(P, A.T)) / factor**2)
    assert not np.tril(found.root, -1).any()
    [part] = plain.turned(B).parts
    np.testing.assert_allclose(part.gram[0][:-1, :-1], B.T @ (A.T @ A) @ B, atol=1e-9)
