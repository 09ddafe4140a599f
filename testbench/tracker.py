"""The measuring instrument: targets read with noise, once unloaded and once loaded."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from testbench.errors import Array, BenchError


@dataclass(frozen=True)
class Tracker:
    """A laser tracker whose noise is white, normal and equal along every axis.

    Attributes:
        sigma: Standard deviation of ONE position reading along one axis [m].
        sigma_rotation: The same of one orientation reading [rad]; None if it reads positions only.
    """

    sigma: float
    sigma_rotation: float | None = None

    def __post_init__(self) -> None:
        """Refuse a negative or infinite sigma.

        Raises:
            BenchError: When a sigma is not a finite number of at least zero.
        """
        for name in ("sigma", "sigma_rotation"):
            value = getattr(self, name)
            if value is not None and not 0 <= value < np.inf:
                raise BenchError(f"{name}: expected a finite number of at least 0, got {value}")


def read_positions(tracker: Tracker, positions: Array, rng: np.random.Generator) -> Array:
    """One reading of every target.

    Args:
        tracker: The instrument.
        positions: True positions, (..., 3) [m].
        rng: Source of the noise.
    """
    return positions + tracker.sigma * rng.standard_normal(positions.shape)


def read_orientations(tracker: Tracker, rotations: Array, rng: np.random.Generator) -> Array:
    """One reading of every target's orientation, as rotation vectors in world axes.

    Args:
        tracker: The instrument; its sigma_rotation must be set.
        rotations: True orientations, world from target, (runs, 3, 3).
        rng: Source of the noise.

    Returns:
        Rotation vectors, (runs, 3) [rad].

    Raises:
        BenchError: When the tracker reads positions only.
    """
    if tracker.sigma_rotation is None:
        raise BenchError("tracker: expected a sigma_rotation to read orientations, got None")
    noise = tracker.sigma_rotation * rng.standard_normal((len(rotations), 3))
    return (Rotation.from_rotvec(noise) * Rotation.from_matrix(rotations)).as_rotvec()
