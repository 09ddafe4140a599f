"""Measuring instruments: noise of readings, and the targets that a tracker can see.

An isotropic instrument has equal noise along every axis, as in the paper. A laser tracker measures a range,
accurate to microns, and two angles, accurate to microns per metre. The covariance of its readings therefore
depends on the target's position. Whether a target is visible depends on distance, elevation and incidence;
`testbench.plant.rigid_cell` tests obstacles.

Gauges and distance meters read one coordinate of a marker's motion. Their readings follow from the
equilibria of the arm, unloaded and loaded. A gauge stands on the floor, and its tip touches a plane face of
the tool at a marker. Under the load the face moves, rotates and slides below the tip; the tip follows along
its axis until it touches the face again. The true normal and axis differ from the stated ones. A distance
meter (ballbar, draw-wire, interferometer) reads from a fixed point to a marker.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.errors import Array, BenchError, Ids, Mask, check_least
from testbench.plant.rigid_cell import check_station_position

# --- Measuring instruments: noise of readings, and the targets that a tracker can see -----------------------

MAX_SIGMA = 1e-2
"""Largest standard deviation of a reading, or of the drift of a base frame, that is accepted [m, rad]."""


@dataclass(frozen=True)
class IsotropicTracker:
    """Describe an instrument that reads positions with independent normal noise, equal along every axis."""

    sigma: float  #: Standard deviation of ONE position reading along one axis [m].
    #: Standard deviation of one orientation reading [rad]; None if it reads positions only.
    sigma_rotation: float | None = None

    def __post_init__(self) -> None:
        """Refuse a sigma that is not a finite number of at least zero, by BenchError."""
        for name in ("sigma", "sigma_rotation"):
            value = getattr(self, name)
            check_least(0.0 if value is None else value, name)

    def noise(self, positions: Array, rng: np.random.Generator) -> Array:
        """Draw the noise of position readings, of the standard deviation sigma along every axis.

        Args:
            positions: True positions, (..., 3) [m]; only their shape is used.
            rng: Random number generator.

        Returns:
            Noise, (..., 3) [m].
        """
        return self.sigma * rng.standard_normal(positions.shape)


RADIAL_MPE, TRANSVERSE_MPE = (10e-6, 0.3e-6), (15e-6, 6e-6)
"""Maximum permissible errors a + b d at a distance d, along the beam and across it: a [m] and b [m/m].

Makers of laser trackers publish such numbers; these are not from one data sheet.
"""
TYPICAL_MPE_FRACTION = 0.5  #: Typical standard deviation of a reading over its maximum permissible error [1].


@dataclass(frozen=True)
class LaserTracker:
    """Describe a laser tracker by its noise: independent normal errors of one distance and two angles."""

    position: tuple[float, float, float]  #: Origin of the beam, world, (3,) [m].
    mpe_fraction: float = TYPICAL_MPE_FRACTION  #: Standard deviation over the maximum permissible error [1].

    def covariance(self, positions: Array) -> Array:
        """Compute the covariance of a position reading, transverse^2 (I - u u^T) + radial^2 u u^T.

        u is the direction of the beam; radial and transverse are the standard deviations along and across it.

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
        """Draw the noise of position readings, (transverse (I - u u^T) + radial u u^T) z, z standard normal.

        u is the direction of the beam; radial and transverse are the standard deviations along and across it.
        This symmetric root of the covariance is smooth in the position; a root by decomposition is not,
        because two eigenvalues are equal.

        Args:
            positions: True positions, world, (..., 3) [m].
            rng: Random number generator.

        Returns:
            Noise, (..., 3) [m].
        """
        u, radial, transverse = self._beam(positions)
        normal = rng.standard_normal(positions.shape)
        along = (u * normal).sum(axis=-1, keepdims=True) * u
        return np.asarray(transverse * (normal - along) + radial * along)

    def _beam(self, positions: Array) -> tuple[Array, Array, Array]:
        """Compute the beam, (..., 3) [1], and the deviations along and across it, (..., 1) [m]."""
        beam = positions - np.array(self.position)
        distance = np.linalg.norm(beam, axis=-1, keepdims=True)
        radial, transverse = (
            self.mpe_fraction * (base + slope * distance) for base, slope in (RADIAL_MPE, TRANSVERSE_MPE)
        )
        return beam / distance, radial, transverse


def read_positions(
    tracker: IsotropicTracker | LaserTracker, positions: Array, rng: np.random.Generator
) -> Array:
    """Simulate one position reading of every target: the true position plus noise.

    Args:
        tracker: The instrument.
        positions: True positions, world, (..., 3) [m].
        rng: Random number generator.

    Returns:
        Readings, world, (..., 3) [m].
    """
    return positions + tracker.noise(positions, rng)


def deflection_precision(tracker: LaserTracker, before: Array, after: Array) -> Array:
    """Compute the inverse covariance of deflections, the difference of two tracker readings of a target.

    Args:
        tracker: The laser tracker.
        before: Readings before the load, world, (..., 3) [m].
        after: Readings under the load, world, (..., 3) [m].

    Returns:
        Inverse covariance, (..., 3, 3) [1/m^2].
    """
    return np.asarray(np.linalg.inv(tracker.covariance(before) + tracker.covariance(after)))


def read_orientations(tracker: IsotropicTracker, rotations: Array, rng: np.random.Generator) -> Array:
    """Simulate readings of orientations: the true ones with noise, as rotation vectors.

    Args:
        tracker: The instrument.
        rotations: True orientations, world from tool, (runs, 3, 3) [1].
        rng: Random number generator.

    Returns:
        Rotation vectors, world axes, (runs, 3) [rad].

    Raises:
        BenchError: When the instrument reads positions only.
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
"""Reasons why a tracker cannot read a target, for messages."""


MIN_RANGE, MAX_RANGE = 1.0, 20.0  #: Distances from the tracker between which a target can be read [m].
MIN_ELEVATION, MAX_ELEVATION = math.radians(-50), math.radians(75)
"""Elevations above the tracker's horizon between which a target can be read [rad].

Both ranges are narrower than those of common trackers: an instrument is least accurate near the ends of its
range, and a stand is never quite upright.
"""


@dataclass(frozen=True)
class Station:
    """Describe the place of an upright laser tracker, and the angles at which its targets return the beam."""

    position: tuple[float, float, float]  #: Origin of the beam, world, (3,) [m].
    #: Half angle of the cone in which a fixed target returns the beam [rad]; such a target faces along the z
    #: axis of its marker's body in rigid.xml. None for targets that are turned to the tracker by hand, such
    #: as spherically mounted reflectors in magnetic nests.
    acceptance_angle: float | None = None

    def __post_init__(self) -> None:
        """Refuse an invalid position or acceptance angle, by BenchError."""
        check_station_position(self.position)
        most = math.pi / 2
        if self.acceptance_angle is not None and not 0 < self.acceptance_angle <= most:  # false for NaN
            raise BenchError(
                f"acceptance_angle [rad] of targets: expected more than 0, at most {most:.4g}, "
                f"got {self.acceptance_angle}"
            )


def find_out_of_view(
    station: Station, targets: Array, target_directions: Array | None = None
) -> dict[str, Mask]:
    """Find the poses in which the tracker cannot read a target, by reason: distance, elevation or incidence.

    Args:
        station: The tracker's station.
        targets: Positions of the targets, world, (poses, m, 3) [m].
        target_directions: Unit vectors along which the targets face, world, (poses, m, 3) [1]; needed if the
            station has an acceptance angle.

    Returns:
        For every reason, in a fixed order, whether it applies to each pose, (poses,).
    """
    beam = targets - np.array(station.position)
    distance = np.linalg.norm(beam, axis=2)
    elevation = np.arctan2(beam[:, :, 2], np.hypot(beam[:, :, 0], beam[:, :, 1]))
    refused = {
        TOO_NEAR: distance < MIN_RANGE,
        TOO_FAR: distance > MAX_RANGE,
        TOO_STEEP: (elevation < MIN_ELEVATION) | (elevation > MAX_ELEVATION),
    }
    if station.acceptance_angle is not None:
        assert target_directions is not None
        away = -np.einsum("pmx,pmx->pm", target_directions, beam)
        refused[FACES_AWAY] = away < math.cos(station.acceptance_angle) * distance
    return {reason: np.asarray(mask.any(axis=1)) for reason, mask in refused.items()}


# --- Instruments that read one number of a marker's motion --------------------------------------------------

GAUGE_PRELOAD_FRACTION = 0.5  #: Reading of a gauge on the unloaded arm over its measuring range [1].


def tip_travel(
    tip_axis: Array, face_normal: Array, contact_before: Array, contact_after: Array, rotation: Array
) -> Array:
    """Compute how far a gauge's tip travels along its axis a when the face that it touches moves and rotates.

    The point of contact on the face moves by d, and the face has the normal n' = rotation @ n afterwards. The
    tip touches it after the travel (d . n') / (a . n').

    Args:
        tip_axis: Axis a of every tip, unit vectors, world, (runs, 3) [1].
        face_normal: Normal n of every face before the motion, unit vectors, world, (runs, 3) [1].
        contact_before: Point of contact on every face before the motion, world, (runs, 3) [m].
        contact_after: The same point of the face after the motion, world, (runs, 3) [m].
        rotation: Rotation of the face, world axes, (runs, 3, 3) [1].

    Returns:
        Travel, (runs,) [m]; NaN if the axis lies in the face, or a direction is zero.
    """
    after = np.matvec(rotation, face_normal)
    along = np.vecdot(tip_axis, after)
    return np.asarray(np.vecdot(contact_after - contact_before, after) / np.where(along == 0, np.nan, along))


def _tilt_directions(directions: Array, tilt_sigma: float, groups: Ids, rng: np.random.Generator) -> Array:
    """Tilt directions by random small angles; the directions of one group are tilted equally.

    Args:
        directions: Unit vectors, (runs, 3) [1].
        tilt_sigma: Standard deviation of the angle about each axis [rad].
        groups: Identifier of the group of every direction, (runs,).
        rng: Random number generator.

    Returns:
        Unit vectors, (runs, 3) [1].
    """
    _, group_index = np.unique(groups, return_inverse=True)
    turn = tilt_sigma * rng.standard_normal((int(group_index.max()) + 1, 3))[group_index]
    moved = directions + np.cross(turn, directions)
    return np.asarray(moved / np.maximum(np.linalg.norm(moved, axis=1, keepdims=True), np.finfo(float).tiny))


@dataclass(frozen=True)
class Gauge:
    """Describe a dial gauge, an LVDT or a touch probe on a stand, whose tip touches a plane face of the tool.

    The defaults are those of a digital gauge on a magnetic stand. DIN 878 admits 3 um of hysteresis and 3 um
    of scatter to a dial gauge of 10 mm; a standard deviation of 5 um contains both and the stand.
    """

    sigma: float = 5e-6  #: Standard deviation of one reading [m].
    #: Standard deviation of the tilts of the face's normal and of the gauge's axis from the stated direction,
    #: about each axis [rad].
    tilt_sigma: float = math.radians(0.5)
    measuring_range: float = 25e-3  #: Measuring range of the tip [m]; unloaded the tip is in its middle.
    resolution: float = 1e-6  #: Step of the display [m]; 0 for none.
    hysteresis: float = 0.0  #: Half-width of the hysteresis loop by friction of the tip [m].
    stand_sigma: float = 0.0  #: Standard deviation of the stand's motion between two readings [m].
    constant_tilt: bool = False  #: Whether all poses have the same tilts; if not, each pose has its own.

    def __post_init__(self) -> None:
        """Refuse negative or infinite numbers, and a measuring range of zero, by BenchError."""
        for name in ("sigma", "tilt_sigma", "resolution", "hysteresis", "stand_sigma"):
            check_least(getattr(self, name), name)
        if not 0 < self.measuring_range < math.inf:
            raise BenchError(
                f"measuring_range [m] of a gauge: expected more than 0, got {self.measuring_range}"
            )

    def read(
        self,
        directions: Array,
        marker_positions: tuple[Array, Array],
        tool_rotations: tuple[Array, Array],
        pose_ids: Ids,
        rng: np.random.Generator,
    ) -> Array:
        """Simulate the gauge's readings of the tool's face, unloaded and loaded.

        Args:
            directions: Stated direction of both the gauge's axis and the face's normal, unit vectors, world,
                (runs, 3) [1].
            marker_positions: Positions of the touched marker, unloaded and loaded, world, (runs, 3) [m] each.
            tool_rotations: Orientations of the tool, unloaded and loaded, world from tool, (runs, 3, 3) [1]
                each.
            pose_ids: Identifier of the pose of every run, (runs,); the gauge is set up anew for each pose.
            rng: Random number generator.

        Returns:
            Readings unloaded and loaded, (2, runs) [m]; NaN out of range.
        """
        group = np.zeros_like(pose_ids) if self.constant_tilt else pose_ids
        normal, axis = (_tilt_directions(directions, self.tilt_sigma, group, rng) for _ in range(2))
        turn = tool_rotations[1] @ tool_rotations[0].swapaxes(1, 2)
        moved = tip_travel(axis, normal, *marker_positions, turn)
        # Friction holds the tip back: unloaded from either side, loaded against its motion.
        held = np.array([rng.uniform(-1, 1, len(moved)), -np.sign(moved)])
        read = (
            self.measuring_range * GAUGE_PRELOAD_FRACTION
            + np.array([np.zeros_like(moved), moved])
            + self.hysteresis * held
        )
        read[1] += self.stand_sigma * rng.standard_normal(len(moved))
        read += self.sigma * rng.standard_normal(read.shape)
        if self.resolution:
            read = self.resolution * np.round(read / self.resolution)
        return np.asarray(np.where((read >= 0) & (read <= self.measuring_range), read, np.nan))


@dataclass(frozen=True)
class DistanceMeter:
    """Describe a ballbar, draw-wire or interferometer: it reads the distance from a point to a marker."""

    sigma: float  #: Standard deviation of one reading [m].
    fixed_point_sigma: float  #: Standard deviation of the fixed point's stated position along each axis [m].
    max_change: float  #: Largest change of the distance to either side [m].
    #: Standard deviation of an unknown constant in all distances [m]; changes of distance do not contain it.
    zero_sigma: float = 0.0

    def __post_init__(self) -> None:
        """Refuse negative or infinite numbers, and a largest change of zero, by BenchError."""
        for name in ("sigma", "fixed_point_sigma", "zero_sigma"):
            check_least(getattr(self, name), name)
        if not 0 < self.max_change < math.inf:
            raise BenchError(
                f"max_change [m] of a distance meter: expected more than 0, got {self.max_change}"
            )

    def read(
        self, fixed_point: Array, marker_positions: tuple[Array, Array], rng: np.random.Generator
    ) -> Array:
        """Simulate readings of the distance to a marker, unloaded and loaded.

        Args:
            fixed_point: Position of the instrument's fixed end as the user states it, world, (3,) [m]; its
                error is the same in all runs.
            marker_positions: Positions of the marker, unloaded and loaded, world, (runs, 3) [m] each.
            rng: Random number generator.

        Returns:
            Readings unloaded and loaded, (2, runs) [m]; NaN out of range.
        """
        read, length = self._lengths(fixed_point, np.array(marker_positions), rng)
        return np.where(np.abs(length[1] - length[0]) <= self.max_change, read, np.nan)

    def read_absolute(self, fixed_point: Array, marker_positions: Array, rng: np.random.Generator) -> Array:
        """Simulate readings of the absolute distance to a marker.

        The instrument can read distances up to `max_change` from the middle of the least and the largest one.

        Args:
            fixed_point: Position of the instrument's fixed end as the user states it, world, (3,) [m]; its
                error is the same in all runs.
            marker_positions: Positions of the marker, world, (runs, 3) [m].
            rng: Random number generator.

        Returns:
            Readings, (runs,) [m]; NaN out of range.
        """
        read, length = self._lengths(fixed_point, marker_positions, rng)
        middle = (length.min() + length.max()) / 2
        if self.zero_sigma:
            read += self.zero_sigma * rng.standard_normal()
        return np.where(np.abs(length - middle) <= self.max_change, read, np.nan)

    def _lengths(self, stated: Array, places: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """Read distances from a fixed point that is not quite where it is stated, and the true ones."""
        true = stated + self.fixed_point_sigma * rng.standard_normal(3)
        length = np.linalg.norm(places - true, axis=-1)
        return length + self.sigma * rng.standard_normal(length.shape), length


BALLBAR = DistanceMeter(sigma=1e-6, fixed_point_sigma=1e-3, max_change=1e-3)
"""A telescoping ballbar. Makers state about 1 um and a range of 1 mm to either side [assumed]; the fixed ball
is placed with a tape or a square, to a millimetre [assumed]."""
LONG_BAR = DistanceMeter(sigma=10e-6, fixed_point_sigma=1e-3, max_change=1.0)
"""A bar that telescopes by a metre to either side, or an interferometer that follows its reflector: 10 um are
usual [assumed]."""
DRAW_WIRE = DistanceMeter(sigma=50e-6, fixed_point_sigma=2e-3, max_change=1.0)
"""A draw-wire encoder of 2 m. Makers state a repeatability of some hundredths of a millimetre [assumed]; its
outlet is known to two millimetres [assumed]."""


@dataclass(frozen=True)
class PlaneProbe:
    """Describe a probe on the tool that reads its height over a plane face on a stand.

    It may be a touch probe, whose reading is zero at contact, a gauge, or a laser triangulation sensor.
    """

    sigma: float = 10e-6  #: Standard deviation of one reading [m].
    #: Standard deviation of the face's height from a plane, drawn once per pose [m].
    flatness_sigma: float = 3e-6
    fixed_point_sigma: float = 2e-3  #: Standard deviation of the face's stated point along each axis [m].
    tilt_sigma: float = math.radians(0.5)  #: Standard deviation of the face's stated normal [rad].
    max_height: float = 25e-3  #: Largest height that the probe reads, above and below the face [m].
    face_radius: float = 0.4  #: Radius of the face around the stated point [m].

    def __post_init__(self) -> None:
        """Refuse negative or infinite numbers, and a range or radius of zero, by BenchError."""
        for name in ("sigma", "flatness_sigma", "fixed_point_sigma", "tilt_sigma"):
            check_least(getattr(self, name), name)
        if not (0 < self.max_height < math.inf and 0 < self.face_radius < math.inf):
            raise BenchError(
                "plane probe: expected max_height and face_radius above 0, got "
                f"{self.max_height} and {self.face_radius}"
            )

    def read_absolute(
        self, face: tuple[Array, Array], marker_positions: Array, pose_ids: Ids, rng: np.random.Generator
    ) -> Array:
        """Simulate readings of the height of a marker over the face.

        Args:
            face: True point of the face [m] and its true unit normal [1], world, (3,) each.
            marker_positions: Positions of the marker, world, (runs, 3) [m].
            pose_ids: Identifier of the pose of every run, (runs,).
            rng: Random number generator.

        Returns:
            Heights, (runs,) [m]; NaN out of range and beside the face.
        """
        point, normal = face
        off = marker_positions - point
        height = off @ normal
        beside = np.linalg.norm(off - height[:, None] * normal, axis=1)
        _, spot = np.unique(pose_ids, return_inverse=True)
        uneven = self.flatness_sigma * rng.standard_normal(int(spot.max()) + 1)[spot]
        read = height - uneven + self.sigma * rng.standard_normal(len(height))
        return np.where((np.abs(height) <= self.max_height) & (beside <= self.face_radius), read, np.nan)


def place_faces(
    stated_faces: Sequence[tuple[Array, Array]],
    shift_sigma: float,
    tilt_sigma: float,
    rng: np.random.Generator,
) -> list[tuple[Array, Array]]:
    """Draw the true faces of a rigid block: the stated faces, shifted and rotated together.

    The block rotates about the mean of its faces' points.

    Args:
        stated_faces: Stated point [m] and stated unit normal [1] of every face, world, (3,) each.
        shift_sigma: Standard deviation of the block's shift along each axis [m].
        tilt_sigma: Standard deviation of the block's rotation about each axis [rad].
        rng: Random number generator.

    Returns:
        True point and true unit normal of every face, world.
    """
    from scipy.spatial.transform import Rotation  # here: it takes long to import

    centre = np.mean([point for point, _ in stated_faces], axis=0)
    moved = shift_sigma * rng.standard_normal(3)
    turn = Rotation.from_rotvec(tilt_sigma * rng.standard_normal(3)).as_matrix()
    return [(centre + moved + turn @ (point - centre), turn @ normal) for point, normal in stated_faces]
