"""Results with a row a pose in every field: in parts, joined, put in place of others."""

from collections.abc import Iterator, Sequence

import numpy as np

from testbench.data.dataset import Rows, arrays, with_arrays
from testbench.errors import Ids
from testbench.session import stepwise

TOGETHER = 512  #: Poses computed side by side: enough for numpy, few for its cache.


def batches(poses: int) -> Iterator[slice]:
    """Places of some poses at a time; one empty part of none."""
    return stepwise([slice(k, k + TOGETHER) for k in range(0, max(poses, 1), TOGETHER)], "solving poses")


def joined(parts: Sequence[Rows]) -> Rows:
    """Those of all parts, one after the other."""
    every = [arrays(part) for part in parts]
    return with_arrays(parts[0], {name: np.concatenate([own[name] for own in every]) for name in every[0]})


def put(rows: Rows, where: Ids, others: Rows) -> None:
    """Others in place of some, (k,)."""
    for name, values in arrays(rows).items():
        values[where] = arrays(others)[name]


def replaced(rows: Rows, where: Ids, others: Rows) -> Rows:
    """The same, of a copy."""
    found = joined([rows])
    put(found, where, others)
    return found
