"""Which of many poses are drawn: pictures of more are neither looked at nor carried about."""

import numpy as np

from testbench.data.dataset import Ids
from testbench.errors import Array

POSES, FAR = 240, 40  #: Poses that are drawn at most, and those of largest error among them.


def picked(size: Array, rows: Ids, far: int = FAR) -> Ids:
    """Places of the largest of some rows and of others evenly, in their order.

    Args:
        size: Error, or deflection, of every row, (n,).
        rows: Those to choose from.
        far: How many of the largest; of a path one, as its neighbours are as large.
    """
    largest = rows[np.argsort(-size[rows], kind="stable")[:far]]
    return np.union1d(largest, evenly(rows, POSES - far))


def evenly(rows: Ids, most: int) -> Ids:
    """So many of some rows at most, the first and the last among them."""
    return np.asarray(rows[np.linspace(0, len(rows) - 1, min(most, len(rows))).round().astype(int)])


def of_all(shown: int, total: int, noun: str) -> str:
    """What a title says where not all are drawn: "240 of 1,000 runs, the worst among them"; else nothing."""
    return "" if shown == total else f"{shown} of {total:,} {noun}, the worst among them"
