"""Results with a row a pose in every field: some of them, in parts, joined, put in place of others."""

from collections.abc import Iterator, Sequence
from copy import copy
from typing import TypeVar

import numpy as np

from testbench.data.dataset import Ids
from testbench.session import stepwise

T = TypeVar("T")
TOGETHER = 512  #: Poses computed side by side: enough for numpy, few for its cache.


def batches(poses: int) -> Iterator[slice]:
    """Places of some poses at a time; one empty part of none."""
    return stepwise([slice(k, k + TOGETHER) for k in range(0, max(poses, 1), TOGETHER)], "solving poses")


def at(rows: T, some: Ids | slice) -> T:
    """Those of some poses."""
    found = copy(rows)
    vars(found).update({name: values[some] for name, values in vars(rows).items()})
    return found


def joined(parts: Sequence[T]) -> T:
    """Those of all parts, one after the other."""
    found = copy(parts[0])
    for name in vars(found):
        vars(found)[name] = np.concatenate([vars(part)[name] for part in parts])
    return found


def put(rows: T, where: Ids, others: T) -> None:
    """Others in place of some, (k,)."""
    for name, values in vars(rows).items():
        values[where] = vars(others)[name]


def replaced(rows: T, where: Ids, others: T) -> T:
    """The same, of a copy."""
    found = joined([rows])
    put(found, where, others)
    return found
