"""Measuring instruments: noise of readings, and the targets that a tracker can see.

A flat instrument has equal noise along every axis, as in the paper. A laser tracker has a station: its range
is accurate to microns, its two angles to microns per metre, so that every reading has a covariance of its
own. Targets are visible by distance, elevation and incidence; obstacles are tested in `testbench.plant.site`.

Gauges on a face of the tool and distance meters read one number of a marker's motion. Their readings follow
from the arm at rest, unloaded and loaded. A gauge stands on the floor. Its tip touches a plane face of the
tool at a marker. Under the load the face moves, turns and slides below the tip; the tip follows along its
axis until it touches the face again. Face and axis differ from their stated places. A distance meter
(ballbar, draw-wire, interferometer) reads from a fixed point to a marker.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.errors import Array, BenchError, Ids, Mask, check_least
from testbench.plant.site import check_station_position

# --- Measuring instruments: noise of readings, and the targets that a tracker can see -----------------------

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


RADIAL_MPE, TRANSVERSE_MPE = (10e-6, 0.3e-6), (15e-6, 6e-6)
"""Maximum permissible errors a + b d at a distance d, a [m] and b [m/m], along the beam and across it.

Published by makers of laser trackers; from the project's list of numbers, without a data sheet.
"""
TYPICAL_MPE_SHARE = (
    0.5  #: Standard deviation over the maximum permissible error: typical results are half of it.
)


@dataclass(frozen=True)
class LaserTracker:
    """Describe a spherical instrument: one distance and two angles with independent normal noise."""

    station: tuple[float, float, float]  #: Origin of the beam, world, (3,) [m].
    share: float = TYPICAL_MPE_SHARE  #: Standard deviation over the maximum permissible error [1].

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
        """Compute the beam, (..., 3) [1], and the deviations along and across it, (..., 1) [m]."""
        beam = positions - np.array(self.station)
        distance = np.linalg.norm(beam, axis=-1, keepdims=True)
        radial, transverse = (
            self.share * (base + slope * distance) for base, slope in (RADIAL_MPE, TRANSVERSE_MPE)
        )
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
    """Compute the inverse covariance of deflections, the differences of two tracker readings per target.

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


MIN_RANGE, MAX_RANGE = 1.0, 20.0  #: Distances between which a target is seen [m].
MIN_ELEVATION, MAX_ELEVATION = math.radians(-50), math.radians(75)
"""Elevations above the station's horizon between which a target is seen [rad].

These ranges are narrower than those of common trackers: an instrument is least accurate near the ends of its
range, and a stand is never quite upright.
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
        check_station_position(self.position)
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
        TOO_NEAR: distance < MIN_RANGE,
        TOO_FAR: distance > MAX_RANGE,
        TOO_STEEP: (elevation < MIN_ELEVATION) | (elevation > MAX_ELEVATION),
    }
    if station.acceptance is not None:
        assert facing is not None
        away = -np.einsum("pmx,pmx->pm", facing, beam)
        refused[FACES_AWAY] = away < math.cos(station.acceptance) * distance
    return {reason: np.asarray(mask.any(axis=1)) for reason, mask in refused.items()}


# --- Instruments that read one number of a marker's motion --------------------------------------------------

GAUGE_PRELOAD = 0.5  #: Share of its range at which a gauge is set up unloaded [1].


def face_travel(axis: Array, normal: Array, start: Array, end: Array, rotation: Array) -> Array:
    """Compute how far a tip travels along its axis to a plane face that moved and turned.

    The tip starts at the point `start` of the face, which moves to `end`. The face then has the normal
    n' = turn @ normal, and the tip touches it after ((end - start) . n') / (axis . n').

    Args:
        axis: Unit vectors along which the tips move, (runs, 3) [1].
        normal: Unit normals of the faces before, (runs, 3) [1].
        start: Where the tips touch the faces before, (runs, 3) [m].
        end: Where these points of the faces are afterwards, (runs, 3) [m].
        rotation: Rotations of the tool in between, world axes, (runs, 3, 3) [1].

    Returns:
        Travel, (runs,) [m]; NaN where the face is along the axis, or a direction is zero.
    """
    after = np.matvec(rotation, normal)
    along = np.vecdot(axis, after)
    return np.asarray(np.vecdot(end - start, after) / np.where(along == 0, np.nan, along))


def tilt_directions(direction: Array, tilt: float, group: Ids, rng: np.random.Generator) -> Array:
    """Tilt directions by random angles; the directions of one group are tilted equally.

    Args:
        direction: Unit vectors, (runs, 3) [1].
        tilt: Standard deviation of the angle about each axis across [rad].
        group: Group of every direction, (runs,).
        rng: Source of the angles.

    Returns:
        Unit vectors, (runs, 3) [1].
    """
    _, group_index = np.unique(group, return_inverse=True)
    turn = tilt * rng.standard_normal((int(group_index.max()) + 1, 3))[group_index]
    moved = direction + np.cross(turn, direction)
    return np.asarray(moved / np.maximum(np.linalg.norm(moved, axis=1, keepdims=True), np.finfo(float).tiny))


@dataclass(frozen=True)
class Gauge:
    """Describe a dial gauge, an LVDT or a touch probe on a stand, against a plane face of the tool.

    Defaults are a digital gauge of 1 um steps on a magnetic stand. DIN 878 admits 3 um of hysteresis and 3 um
    of scatter to a dial gauge of 10 mm; 5 um of standard deviation contain both and the stand.
    """

    sigma: float = 5e-6  #: Standard deviation of one reading [m].
    #: Standard deviation of the face's normal, and of the gauge's axis, about each axis across [rad].
    tilt: float = math.radians(0.5)
    travel: float = 25e-3  #: Range of the tip [m]; it is set up in the middle.
    resolution: float = 1e-6  #: Step of the display [m]; 0 for none.
    hysteresis: float = 0.0  #: Half-width of the loop by friction of the tip [m].
    stand_motion: float = 0.0  #: Standard deviation of the stand's motion between two readings [m].
    #: Whether the tilts of normal and axis are equal in all poses, not new in each.
    constant_tilt: bool = False

    def __post_init__(self) -> None:
        for name in ("sigma", "tilt", "resolution", "hysteresis", "stand_motion"):
            check_least(getattr(self, name), name)
        if not 0 < self.travel < math.inf:
            raise BenchError(f"travel [m] of a gauge: expected more than 0, got {self.travel}")

    def read(
        self,
        direction: Array,
        places: tuple[Array, Array],
        rotations: tuple[Array, Array],
        pose: Ids,
        rng: np.random.Generator,
    ) -> Array:
        """Read the face of the tool unloaded and loaded; a pose is one set-up of gauge and face.

        Args:
            direction: Direction as it is stated, of axis and normal, unit vectors, (runs, 3) [1].
            places: The marker that is touched, unloaded and loaded, (runs, 3) [m] each.
            rotations: Orientations of the tool, unloaded and loaded, (runs, 3, 3) [1] each.
            pose: Identifier of the pose of every run, (runs,).
            rng: Source of tilts and noise.

        Returns:
            Readings unloaded and loaded, (2, runs) [m]; NaN out of range.
        """
        group = np.zeros_like(pose) if self.constant_tilt else pose
        normal, axis = (tilt_directions(direction, self.tilt, group, rng) for _ in range(2))
        turn = rotations[1] @ rotations[0].swapaxes(1, 2)
        moved = face_travel(axis, normal, *places, turn)
        # Friction holds the tip back: from either side unloaded, against the motion loaded.
        held = np.array([rng.uniform(-1, 1, len(moved)), -np.sign(moved)])
        read = self.travel * GAUGE_PRELOAD + np.array([np.zeros_like(moved), moved]) + self.hysteresis * held
        read[1] += self.stand_motion * rng.standard_normal(len(moved))
        read += self.sigma * rng.standard_normal(read.shape)
        if self.resolution:
            read = self.resolution * np.round(read / self.resolution)
        return np.asarray(np.where((read >= 0) & (read <= self.travel), read, np.nan))


@dataclass(frozen=True)
class DistanceMeter:
    """Describe a ballbar, a draw-wire or an interferometer between a fixed point and a marker."""

    sigma: float  #: Standard deviation of one reading [m].
    fixed_point_sigma: float  #: Standard deviation of the fixed point's stated place along each axis [m].
    #: Largest change of the distance that it follows, to either side [m].
    travel: float
    #: Standard deviation of an unknown constant in every distance [m]; a change of distance is without it.
    zero_sigma: float = 0.0

    def __post_init__(self) -> None:
        for name in ("sigma", "fixed_point_sigma", "zero_sigma"):
            check_least(getattr(self, name), name)
        if not 0 < self.travel < math.inf:
            raise BenchError(f"travel [m] of a distance meter: expected more than 0, got {self.travel}")

    def read(self, stated: Array, places: tuple[Array, Array], rng: np.random.Generator) -> Array:
        """Read the distance unloaded and loaded.

        Args:
            stated: Stated position of the fixed point, (3,) [m].
            places: The marker unloaded and loaded, (runs, 3) [m] each.
            rng: Source of the fixed point's error, the same in all runs, and of noise.

        Returns:
            Readings unloaded and loaded, (2, runs) [m]; NaN out of range.
        """
        read, length = self._lengths(stated, np.array(places), rng)
        return np.where(np.abs(length[1] - length[0]) <= self.travel, read, np.nan)

    def read_absolute(self, stated: Array, places: Array, rng: np.random.Generator) -> Array:
        """Read the distance in any poses; the middle of its range is that of the distances.

        Args:
            stated: Stated position of the fixed point, (3,) [m].
            places: The marker in every pose, (runs, 3) [m].
            rng: Source of the fixed point's error, the same in all runs, and of noise.

        Returns:
            Readings, (runs,) [m]; NaN out of range.
        """
        read, length = self._lengths(stated, places, rng)
        middle = (length.min() + length.max()) / 2
        if self.zero_sigma:
            read += self.zero_sigma * rng.standard_normal()
        return np.where(np.abs(length - middle) <= self.travel, read, np.nan)

    def _lengths(self, stated: Array, places: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """Read distances from a fixed point that is not quite where it is stated, and the true ones."""
        true = stated + self.fixed_point_sigma * rng.standard_normal(3)
        length = np.linalg.norm(places - true, axis=-1)
        return length + self.sigma * rng.standard_normal(length.shape), length


BALLBAR = DistanceMeter(sigma=1e-6, fixed_point_sigma=1e-3, travel=1e-3)
"""A telescoping ballbar. Makers state about 1 um and a range of 1 mm to either side [assumed]; the fixed ball
is placed with a tape or a square, to a millimetre [assumed]."""
LONG_BAR = DistanceMeter(sigma=10e-6, fixed_point_sigma=1e-3, travel=1.0)
"""A bar that telescopes by a metre to either side, or an interferometer that follows its reflector: 10 um are
usual [assumed]."""
DRAW_WIRE = DistanceMeter(sigma=50e-6, fixed_point_sigma=2e-3, travel=1.0)
"""A draw-wire encoder of 2 m. Makers state a repeatability of some hundredths of a millimetre [assumed]; its
outlet is known to two millimetres [assumed]."""


@dataclass(frozen=True)
class PlaneProbe:
    """Describe a probe on the tool that reads its height over a plane face on a stand.

    A touch probe reads zero where it touches; a gauge or a laser triangulation sensor reads near it.
    """

    sigma: float = 10e-6  #: Standard deviation of one reading [m].
    flatness: float = 3e-6  #: Standard deviation of the face from a plane, one per pose [m].
    fixed_point_sigma: float = 2e-3  #: Standard deviation of the stated point along each axis [m].
    tilt: float = math.radians(0.5)  #: Standard deviation of the stated normal [rad].
    travel: float = 25e-3  #: Largest height that it reads, to either side [m].
    radius: float = 0.4  #: Radius of the face around the stated point [m].

    def __post_init__(self) -> None:
        for name in ("sigma", "flatness", "fixed_point_sigma", "tilt"):
            check_least(getattr(self, name), name)
        if not (0 < self.travel < math.inf and 0 < self.radius < math.inf):
            raise BenchError(f"plane probe: expected a travel and a radius, got {self.travel}, {self.radius}")

    def read_absolute(
        self, face: tuple[Array, Array], places: Array, pose: Ids, rng: np.random.Generator
    ) -> Array:
        """Read the height of a marker over the face.

        Args:
            face: Point of the face [m] and its unit normal [1], as they truly are, (3,) each.
            places: The marker in every row, (runs, 3) [m].
            pose: Identifier of the pose of every row, (runs,).
            rng: Source of noise and of the unevenness of the face.

        Returns:
            Heights, (runs,) [m]; NaN out of range and beside the face.
        """
        point, normal = face
        off = places - point
        height = off @ normal
        beside = np.linalg.norm(off - height[:, None] * normal, axis=1)
        _, spot = np.unique(pose, return_inverse=True)
        uneven = self.flatness * rng.standard_normal(int(spot.max()) + 1)[spot]
        read = height - uneven + self.sigma * rng.standard_normal(len(height))
        return np.where((np.abs(height) <= self.travel) & (beside <= self.radius), read, np.nan)


def place_block(
    stated: Sequence[tuple[Array, Array]], shift: float, tilt: float, rng: np.random.Generator
) -> list[tuple[Array, Array]]:
    """Place the faces of one rigid block where they truly are: shifted, and turned about their mean point.

    Args:
        stated: Stated point of every face [m] and its stated unit normal [1], (3,) each.
        shift: Standard deviation of the block's place along each axis [m].
        tilt: Standard deviation of the block's rotation about each axis [rad].
        rng: Source of shift and rotation.

    Returns:
        Point and unit normal of every face.
    """
    from scipy.spatial.transform import Rotation  # here: it takes long to import

    centre = np.mean([point for point, _ in stated], axis=0)
    moved = shift * rng.standard_normal(3)
    turn = Rotation.from_rotvec(tilt * rng.standard_normal(3)).as_matrix()
    return [(centre + moved + turn @ (point - centre), turn @ normal) for point, normal in stated]
