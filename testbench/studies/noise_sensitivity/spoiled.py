"""Readings that are worse than noise: from a frame that drifts, and some that are far off."""

from dataclasses import dataclass, replace

import numpy as np

from testbench.campaign.tracker import LONGEST
from testbench.data.dataset import Dataset
from testbench.errors import Array, BenchError, Mask, check_least


@dataclass(frozen=True)
class Drift:
    """How far the tracker's frame moves between the unloaded and the loaded reading of a run."""

    shift: float  #: Standard deviation of the frame's displacement along each axis [m].
    turn: float  #: The same of its rotation about each axis through the station [rad].

    def __post_init__(self) -> None:
        """Refuse, by BenchError, a number below 0 or too large for a slow drift."""
        for name in ("shift", "turn"):
            if not 0 <= getattr(self, name) <= LONGEST:
                raise BenchError(f"drift, {name}: expected 0 to {LONGEST:g}, got {getattr(self, name)}")


def drifted(
    readings: Array, drift: Drift, station: tuple[float, float, float], rng: np.random.Generator
) -> Array:
    """Readings, (runs, m, 3) [m], in a frame that has moved, and turned about its station, for each run."""
    shift, turn = (size * rng.standard_normal((len(readings), 1, 3)) for size in (drift.shift, drift.turn))
    return np.asarray(readings + shift + np.cross(turn, readings - np.array(station)))


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
