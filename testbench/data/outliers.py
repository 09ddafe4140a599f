"""Gross errors put into a dataset: a marker knocked, a beam broken, a reading filed under another marker."""

from dataclasses import replace

import numpy as np

from testbench.data.dataset import Dataset, Mask
from testbench.errors import BenchError, check_least


def spoil(data: Dataset, share: float, size: float, rng: np.random.Generator) -> tuple[Dataset, Mask]:
    """A dataset with some loaded readings off, each in a random direction; and which those are, (runs, m).

    They are `share` of all [1], rounded to whole readings, off by `size` [m]; orientations stay as they are.

    Raises:
        BenchError: When the share is outside [0, 1] or the size is not a finite number of at least 0.
    """
    if not 0 <= share <= 1:
        raise BenchError(f"share: expected 0 to 1, got {share}")
    check_least(size, "size [m]")
    readings = data.runs * len(data.markers)
    spoiled = np.zeros(readings, dtype=bool)
    spoiled[rng.permutation(readings)[: round(share * readings)]] = True
    mask = spoiled.reshape(data.runs, -1)
    direction = rng.standard_normal(data.after.shape)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    return replace(data, after=data.after + size * direction * mask[..., None]), mask
