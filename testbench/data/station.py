"""Where the laser tracker stands, and which targets it can see from there: distance, elevation, incidence.

Whether something stands in the way is a question of shapes: testbench/plant/site.py.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from testbench.errors import Array, BenchError, check_array

Mask = npt.NDArray[np.bool_]

FARTHEST = 1000.0
"""Largest coordinate of a station, and largest distance of a target [m]; beyond it a unit is a slip."""

TOO_NEAR = "target too near the tracker"
TOO_FAR = "target too far from the tracker"
TOO_STEEP = "target too high or low for the tracker"
FACES_AWAY = "target faces away from the tracker"


@dataclass(frozen=True)
class Station:
    """A laser tracker standing upright, and its range.

    The defaults are assumptions, narrower than what common trackers are sold with: near the ends of its
    range an instrument is at its worst, and a stand is never quite upright.
    """

    position: tuple[float, float, float]  #: Where the beam leaves, in the world, (3,) [m].
    nearest: float = 1.0  #: Least distance of a target [m].
    farthest: float = 20.0  #: Largest distance of a target [m].
    lowest: float = math.radians(-50)  #: Least elevation of a target above the horizon of the station [rad].
    highest: float = math.radians(75)  #: Largest elevation [rad].
    #: Half angle of the cone in which a fixed target returns the beam [rad]; such a target faces along the z
    #: axis of its marker's body in rigid.xml. None for targets that are turned to the tracker by hand, as
    #: spherically mounted reflectors in magnetic nests are: any incidence is fine.
    acceptance: float | None = None

    def __post_init__(self) -> None:
        check_position(self.position)
        right = math.pi / 2
        _check_range("distance [m]", self.nearest, self.farthest, 0.0, FARTHEST)
        _check_range("elevation [rad]", self.lowest, self.highest, -right, right)
        if self.acceptance is not None:
            _check_range("acceptance [rad]", 0.0, self.acceptance, 0.0, right)


def check_position(position: object) -> Array:
    """The position of a station, (3,) [m]; BenchError for what is no place near any arm."""
    where = check_array(position, (3,), "position of the station [m]")
    if np.abs(where).max() > FARTHEST:
        raise BenchError(
            f"position of the station [m]: expected coordinates up to {FARTHEST:g}, got {where.tolist()}"
        )
    return where


def _check_range(what: str, low: float, high: float, least: float, most: float) -> None:
    if not least <= low < high <= most:  # false for NaN
        raise BenchError(
            f"{what} of a station's targets: expected {least:.4g} <= least < largest <= {most:.4g}, "
            f"got {low} to {high}"
        )


def out_of_view(station: Station, targets: Array, facing: Array | None = None) -> dict[str, Mask]:
    """Which poses, (poses,), hold a target that the tracker cannot see, by reason in a fixed order.

    Targets, (poses, m, 3) [m], face along unit vectors, (poses, m, 3) [1], which count with an acceptance
    only; all in world axes.

    Raises:
        BenchError: When an argument has the wrong shape or is not finite, or facing is missing.
    """
    targets = check_array(targets, (None, None, 3), "targets [m]")
    beam = targets - np.array(station.position)
    distance = np.linalg.norm(beam, axis=2)
    elevation = np.arctan2(beam[:, :, 2], np.hypot(beam[:, :, 0], beam[:, :, 1]))
    refused = {
        TOO_NEAR: distance < station.nearest,
        TOO_FAR: distance > station.farthest,
        TOO_STEEP: (elevation < station.lowest) | (elevation > station.highest),
    }
    if station.acceptance is not None:
        away = -np.einsum("pmx,pmx->pm", _check_facing(facing, targets.shape), beam)
        refused[FACES_AWAY] = away < math.cos(station.acceptance) * distance
    return {reason: np.asarray(mask.any(axis=1)) for reason, mask in refused.items()}


def _check_facing(facing: Array | None, shape: tuple[int, ...]) -> Array:
    if facing is None:
        raise BenchError("facing: expected unit vectors, as the station has an acceptance, got None")
    facing = check_array(facing, shape, "facing [1]")
    length = np.linalg.norm(facing, axis=2)
    if not np.allclose(length, 1, rtol=0, atol=1e-6):
        raise BenchError(f"facing: expected unit vectors, got lengths from {length.min():.4g}")
    return facing
