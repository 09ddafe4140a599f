"""Where the laser tracker stands, and which targets it can see from there: distance, elevation, incidence.

Whether something stands in the way is a question of shapes: testbench/plant/site.py.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from testbench.errors import Array, BenchError
from testbench.plant.site import check_position

Mask = npt.NDArray[np.bool_]

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
    """A laser tracker standing upright."""

    position: tuple[float, float, float]  #: Where the beam leaves, in the world, (3,) [m].
    #: Half angle of the cone in which a fixed target returns the beam [rad]; such a target faces along the z
    #: axis of its marker's body in rigid.xml. None for targets that are turned to the tracker by hand, as
    #: spherically mounted reflectors in magnetic nests are: any incidence is fine.
    acceptance: float | None = None

    def __post_init__(self) -> None:
        check_position(self.position)
        most = math.pi / 2
        if self.acceptance is not None and not 0 < self.acceptance <= most:  # false for NaN
            raise BenchError(
                f"acceptance [rad] of a station's targets: expected 0 <= least < largest <= {most:.4g}, "
                f"got 0.0 to {self.acceptance}"
            )


def out_of_view(station: Station, targets: Array, facing: Array | None = None) -> dict[str, Mask]:
    """Which poses, (poses,), hold a target that the tracker cannot see, by reason in a fixed order.

    Targets, (poses, m, 3) [m], face along unit vectors, (poses, m, 3) [1], which count with an acceptance
    only; all in world axes.
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
