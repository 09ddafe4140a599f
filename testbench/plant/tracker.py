"""Measuring instruments: noise of readings, and the targets that a tracker can see.

A flat instrument has equal noise along every axis, as in the paper. A laser tracker has a station: its range
is accurate to microns, its two angles to microns per metre, so that every reading has a covariance of its
own. Targets are visible by distance, elevation and incidence; obstacles are tested in `testbench.plant.site`.
"""

import math
from dataclasses import dataclass

import numpy as np

from testbench.errors import Array, BenchError, Mask, check_least
from testbench.plant.site import check_position

MAX_DEVIATION = 1e-2
"""Largest standard deviation of a reading, or drift of a frame, that an instrument can have [m, rad]."""


@dataclass(frozen=True)
class Tracker:
    """Describe a flat instrument: its noise is white, normal and equal along every axis."""

    sigma: float  #: Standard deviation of ONE position reading along one axis [m].
    #: Standard deviation of one orientation reading [rad]; None if it reads positions only.
    sigma_rotation: float | None = None

    def __post_init__(self) -> None:
        """Refuse a sigma that is not a finite number of at least zero, by BenchError."""
        for name in ("sigma", "sigma_rotation"):
            value = getattr(self, name)
            check_least(0.0 if value is None else value, name)

    def noise(self, positions: Array, rng: np.random.Generator) -> Array:
        """Draw the noise of position readings, of sigma along every axis.

        Args:
            positions: True positions, (..., 3) [m]; their shape counts.
            rng: Source of the noise.

        Returns:
            Noise, (..., 3) [m].
        """
        return self.sigma * rng.standard_normal(positions.shape)


RADIAL, TRANSVERSE = (10e-6, 0.3e-6), (15e-6, 6e-6)
"""Maximum permissible errors a + b d at a distance d, a [m] and b [m/m], along the beam and across it.

Published by makers of laser trackers; taken from the project's list of numbers, no data sheet was at hand.
"""
TYPICAL = 0.5  #: Standard deviation over the maximum permissible error: typical results are half of it.


@dataclass(frozen=True)
class LaserTracker:
    """Describe a spherical instrument: one distance and two angles with independent normal noise."""

    station: tuple[float, float, float]  #: Origin of the beam, world, (3,) [m].
    share: float = TYPICAL  #: Standard deviation over the maximum permissible error [1].

    def covariance(self, positions: Array) -> Array:
        """Compute transverse^2 (I - u u^T) + radial^2 u u^T for the beam directions u.

        Args:
            positions: True positions, world, (..., 3) [m].

        Returns:
            Covariance of one reading, (..., 3, 3) [m^2].
        """
        u, radial, transverse = self._beam(positions)
        along = u[..., :, None] * u[..., None, :]
        radial, transverse = radial[..., None], transverse[..., None]
        return np.asarray(transverse**2 * (np.eye(3) - along) + radial**2 * along)

    def noise(self, positions: Array, rng: np.random.Generator) -> Array:
        """Draw the noise (transverse (I - u u^T) + radial u u^T) z with z standard normal.

        The symmetric root of the covariance is unique and smooth in the position. A root by decomposition is
        not: if eigenvalues are equal, the last digit of a position rotates the axes.

        Args:
            positions: True positions, world, (..., 3) [m].
            rng: Source of z.

        Returns:
            Noise, (..., 3) [m].
        """
        u, radial, transverse = self._beam(positions)
        normal = rng.standard_normal(positions.shape)
        along = (u * normal).sum(axis=-1, keepdims=True) * u
        return np.asarray(transverse * (normal - along) + radial * along)

    def _beam(self, positions: Array) -> tuple[Array, Array, Array]:
        """Unit vector, (..., 3) [1], and standard deviations along and across it, (..., 1) [m]."""
        beam = positions - np.array(self.station)
        distance = np.linalg.norm(beam, axis=-1, keepdims=True)
        radial, transverse = (self.share * (base + slope * distance) for base, slope in (RADIAL, TRANSVERSE))
        return beam / distance, radial, transverse


def read_positions(tracker: Tracker | LaserTracker, positions: Array, rng: np.random.Generator) -> Array:
    """Read every target once, with noise.

    Args:
        tracker: The instrument.
        positions: True positions, (..., 3) [m].
        rng: Source of the noise.

    Returns:
        Readings, (..., 3) [m].
    """
    return positions + tracker.noise(positions, rng)


def precision(tracker: LaserTracker, before: Array, after: Array) -> Array:
    """Compute the inverse covariance of deflections between two readings.

    Args:
        tracker: The instrument.
        before: First readings, (..., 3) [m].
        after: Second readings, (..., 3) [m].

    Returns:
        Inverse covariance, (..., 3, 3) [1/m^2].
    """
    return np.asarray(np.linalg.inv(tracker.covariance(before) + tracker.covariance(after)))


def read_orientations(tracker: Tracker, rotations: Array, rng: np.random.Generator) -> Array:
    """Read orientations as rotation vectors, with noise.

    Args:
        tracker: The instrument.
        rotations: True orientations, world axes, (runs, 3, 3).
        rng: Source of the noise.

    Returns:
        Rotation vectors, world axes, (runs, 3) [rad].

    Raises:
        BenchError: If the instrument reads positions only.
    """
    if tracker.sigma_rotation is None:
        raise BenchError("tracker: expected a sigma_rotation to read orientations, got None")
    from scipy.spatial.transform import Rotation  # here: it takes long to import, and few campaigns need it

    noise = tracker.sigma_rotation * rng.standard_normal((len(rotations), 3))
    return (Rotation.from_rotvec(noise) * Rotation.from_matrix(rotations)).as_rotvec()


TOO_NEAR = "target too near the tracker"
TOO_FAR = "target too far from the tracker"
TOO_STEEP = "target too high or low for the tracker"
FACES_AWAY = "target faces away from the tracker"


NEAREST, FARTHEST_SEEN = 1.0, 20.0  #: Distances between which a target is seen [m].
LOWEST, HIGHEST = math.radians(-50), math.radians(75)
"""Elevations above the horizon of the station between which it is [rad].

These are narrower than what common trackers are sold with: near the ends of its range an instrument is at its
worst, and a stand is never quite upright.
"""


@dataclass(frozen=True)
class Station:
    """Describe a laser tracker that stands upright."""

    position: tuple[float, float, float]  #: Origin of the beam, world, (3,) [m].
    #: Half angle of the cone in which a fixed target returns the beam [rad]; such a target faces along the z
    #: axis of its marker's body in rigid.xml. None for targets that are turned to the tracker by hand, such
    #: as spherically mounted reflectors in magnetic nests: any incidence is accepted.
    acceptance: float | None = None

    def __post_init__(self) -> None:
        """Refuse an invalid position or acceptance, by BenchError."""
        check_position(self.position)
        most = math.pi / 2
        if self.acceptance is not None and not 0 < self.acceptance <= most:  # false for NaN
            raise BenchError(
                f"acceptance [rad] of a station's targets: expected 0 <= least < largest <= {most:.4g}, "
                f"got 0.0 to {self.acceptance}"
            )


def out_of_view(station: Station, targets: Array, facing: Array | None = None) -> dict[str, Mask]:
    """Find poses with a target that the tracker cannot see, by reason.

    Args:
        station: The tracker.
        targets: Positions of the targets, world, (poses, m, 3) [m].
        facing: Unit vectors along which the targets face, world, (poses, m, 3) [1]; needed with an
            acceptance.

    Returns:
        Reasons in a fixed order, each with the poses that have it, (poses,).
    """
    beam = targets - np.array(station.position)
    distance = np.linalg.norm(beam, axis=2)
    elevation = np.arctan2(beam[:, :, 2], np.hypot(beam[:, :, 0], beam[:, :, 1]))
    refused = {
        TOO_NEAR: distance < NEAREST,
        TOO_FAR: distance > FARTHEST_SEEN,
        TOO_STEEP: (elevation < LOWEST) | (elevation > HIGHEST),
    }
    if station.acceptance is not None:
        assert facing is not None
        away = -np.einsum("pmx,pmx->pm", facing, beam)
        refused[FACES_AWAY] = away < math.cos(station.acceptance) * distance
    return {reason: np.asarray(mask.any(axis=1)) for reason, mask in refused.items()}


def trial_rng(seed: int, trial: int = 0) -> np.random.Generator:
    """Make the random numbers of one trial, independent of order, workers and restarts.

    Args:
        seed: Root of all randomness.
        trial: Number of the trial.

    Returns:
        The generator.
    """
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=(trial,))))
