"""Instruments that read one number of a marker's motion: gauges on a face of the tool, and distance meters.

What they read follows from the arm at rest, unloaded and loaded. A gauge stands on the floor. Its tip touches
a plane face of the tool at a marker. Under the load the face moves, turns and slides below the tip; the tip
follows along its axis until it touches the face again. Neither the face nor the axis is exactly where it is
said to be. A distance meter (ballbar, draw-wire, interferometer) reads from a fixed point to a marker.
"""

import math
from dataclasses import dataclass

import numpy as np

from testbench.errors import Array, BenchError, Ids, check_least

PRELOAD = 0.5  #: Share of its range at which a gauge is set up unloaded [1].


def face_travel(axis: Array, normal: Array, start: Array, end: Array, turn: Array) -> Array:
    """Compute how far a tip travels along its axis to a plane face that moved and turned.

    The tip starts at the point `start` of the face, which moves to `end`. The face then has the normal
    n' = turn @ normal, and the tip touches it after ((end - start) . n') / (axis . n').

    Args:
        axis: Unit vectors along which the tips move, (runs, 3) [1].
        normal: Unit normals of the faces before, (runs, 3) [1].
        start: Where the tips touch the faces before, (runs, 3) [m].
        end: Where these points of the faces are afterwards, (runs, 3) [m].
        turn: Rotations of the tool in between, world axes, (runs, 3, 3) [1].

    Returns:
        Travel, (runs,) [m]; NaN where the face is along the axis, or a direction is zero.
    """
    after = np.matvec(turn, normal)
    along = np.vecdot(axis, after)
    return np.asarray(np.vecdot(end - start, after) / np.where(along == 0, np.nan, along))


def tilted(direction: Array, tilt: float, group: Ids, rng: np.random.Generator) -> Array:
    """Tilt directions by random angles; the directions of one group are tilted alike.

    Args:
        direction: Unit vectors, (runs, 3) [1].
        tilt: Standard deviation of the angle about each axis across [rad].
        group: Group of every direction, (runs,).
        rng: Source of the angles.

    Returns:
        Unit vectors, (runs, 3) [1].
    """
    _, own = np.unique(group, return_inverse=True)
    turn = tilt * rng.standard_normal((int(own.max()) + 1, 3))[own]
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
    stand: float = 0.0  #: Standard deviation of the stand's motion between two readings [m].
    alike: bool = False  #: Whether normal and axis are off alike in all poses, not anew in each.

    def __post_init__(self) -> None:
        for name in ("sigma", "tilt", "resolution", "hysteresis", "stand"):
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
        group = np.zeros_like(pose) if self.alike else pose
        normal, axis = (tilted(direction, self.tilt, group, rng) for _ in range(2))
        turn = rotations[1] @ rotations[0].swapaxes(1, 2)
        moved = face_travel(axis, normal, *places, turn)
        # Friction holds the tip back: from either side unloaded, against the motion loaded.
        held = np.array([rng.uniform(-1, 1, len(moved)), -np.sign(moved)])
        read = self.travel * PRELOAD + np.array([np.zeros_like(moved), moved]) + self.hysteresis * held
        read[1] += self.stand * rng.standard_normal(len(moved))
        read += self.sigma * rng.standard_normal(read.shape)
        if self.resolution:
            read = self.resolution * np.round(read / self.resolution)
        return np.asarray(np.where((read >= 0) & (read <= self.travel), read, np.nan))


@dataclass(frozen=True)
class DistanceMeter:
    """Describe a ballbar, a draw-wire or an interferometer between a fixed point and a marker."""

    sigma: float  #: Standard deviation of one reading [m].
    fixed: float  #: Standard deviation of the fixed point's stated place along each axis [m].
    #: Largest change of the distance that it follows, to either side [m].
    travel: float

    def __post_init__(self) -> None:
        for name in ("sigma", "fixed"):
            check_least(getattr(self, name), name)
        if not 0 < self.travel < math.inf:
            raise BenchError(f"travel [m] of a distance meter: expected more than 0, got {self.travel}")

    def read(self, stated: Array, places: tuple[Array, Array], rng: np.random.Generator) -> Array:
        """Read the distance unloaded and loaded.

        Args:
            stated: Where the fixed point is said to be, (3,) [m].
            places: The marker unloaded and loaded, (runs, 3) [m] each.
            rng: Source of the fixed point's error, the same in all runs, and of noise.

        Returns:
            Readings unloaded and loaded, (2, runs) [m]; NaN out of range.
        """
        true = stated + self.fixed * rng.standard_normal(3)
        length = np.linalg.norm(np.array(places) - true, axis=-1)
        read = length + self.sigma * rng.standard_normal(length.shape)
        return np.where(np.abs(length[1] - length[0]) <= self.travel, read, np.nan)


BALLBAR = DistanceMeter(sigma=1e-6, fixed=1e-3, travel=1e-3)
"""A telescoping ballbar. Makers state about 1 um and a range of 1 mm to either side [assumed]; the fixed ball
is placed with a tape or a square, to a millimetre [assumed]."""
DRAW_WIRE = DistanceMeter(sigma=50e-6, fixed=2e-3, travel=1.0)
"""A draw-wire encoder of 2 m. Makers state a repeatability of some hundredths of a millimetre [assumed]; its
outlet is known to two millimetres [assumed]."""
