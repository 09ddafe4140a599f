"""What readings leave open: behind what a quantity hides, and which joint helps, against numbers by hand."""

import numpy as np
import pytest

from testbench.identify.observability import NamedQuantity, undetermined_quantities

SHARE = 0.53
"""Of every prior variance below left by the readings."""


def left_open(shares):
    """A quantity "x" and others, each of which, once known, takes this share of the rest away."""
    n = len(shares) + 1
    correlation = np.eye(n)
    correlation[0, 1:] = correlation[1:, 0] = np.sqrt(shares)
    quantities = [
        NamedQuantity("x" if k == 0 else f"y{k}", np.eye(n)[[k]], belongs_to_arm=k == 0) for k in range(n)
    ]
    M = np.linalg.inv(SHARE * correlation) - np.eye(n)
    return undetermined_quantities(quantities, np.eye(n), M, np.zeros((n, 0)))


@pytest.mark.parametrize(
    ("shares", "behind"),
    [
        ([0.25, 0.55], ("y2", "y1")),
        ([0.72, 0.1], ("y1",)),
        ([0.35, 0.2, 0.3, 0.1], ("y1", "y3", "y2")),
        ([0.2, 0.15], ()),
    ],
    ids=["half and a quarter", "mostly one", "three at most", "a little of everything"],
)
def test_a_quantity_hides_behind_those_that_explain_most_of_it_together(shares, behind):
    [found] = left_open(shares)
    assert found.name == "x"
    assert found.remaining_variance_share == pytest.approx(SHARE)
    assert found.confounded_with == behind
    explained = sum(sorted(shares)[::-1][: len(behind)])
    assert found.multiple_correlation == pytest.approx(np.sqrt(explained))


@pytest.mark.parametrize(
    ("each", "everywhere", "helps"),
    [
        ((0.55, 0.45, 0.47), 0.4, 1),
        ((0.55, 0.55, 0.55), 0.45, 3),
        ((0.55, 0.55, 0.55), 0.5, -1),
    ],
    ids=["the second joint", "all three together", "hardly anything"],
)
def test_turning_a_joint_helps_by_what_it_takes_of_what_is_left(each, everywhere, helps):
    """Of a share of 0.6; a fifth of that counts as help."""
    further = [np.array([[1 / share - 1 / 0.6]]) for share in (*each, everywhere)]
    one = [NamedQuantity("x", np.eye(1))]
    [found] = undetermined_quantities(one, np.eye(1), np.array([[1 / 0.6 - 1]]), np.zeros((1, 0)), further)
    assert found.joint_to_turn == helps


def test_what_hides_comes_first_and_the_most_open_of_those_alike_and_of_a_pair_the_more_open_one():
    """Two pairs of which only the sums are read, and two that are not read at all."""
    names, left = ["a", "b", "c", "d", "e", "f"], (0.51, 0.52, 0.53, 0.54, 0.7, 0.95)
    K = np.diag(left)
    for i, j in ((0, 1), (2, 3)):
        K[i, j] = K[j, i] = -0.845 * np.sqrt(left[i] * left[j])
    M = np.linalg.inv(K) - np.eye(6)
    quantities = [NamedQuantity(name, row[None]) for name, row in zip(names, np.eye(6), strict=True)]
    found = undetermined_quantities(quantities, np.eye(6), M, np.zeros((6, 0)))
    assert [(one.name, one.confounded_with) for one in found] == [
        ("d", ("c",)),
        ("b", ("a",)),
        ("f", ()),
        ("e", ()),
    ]
