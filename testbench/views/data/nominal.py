"""Measured runs beside the arm without sag: where its targets would be, and how far to magnify."""

import numpy as np

from testbench.bench.campaign import Cell
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify.registered import Registered
from testbench.identify.weighed import marker_points
from testbench.model.vjm import tool_points
from testbench.views.magnified import round_scale

MOST = 1e4  #: Largest magnification [1].
SHARE = 0.15  #: Length of the longest drawn deflection over the extent of the readings, before rounding [1].


def nominal_markers(cell: Cell, data: Dataset) -> Array:
    """Targets of the rigid arm, (runs, m, 3) [m]."""
    return tool_points(cell.vjm, data.q, marker_points(cell.vjm, data.markers))


def stations(registered: Registered) -> Array:
    """Where the tracker stood, as the registration has it, (stations, 3) [m]; none in the base's frame."""
    if registered.frame == "base" or registered.registration is None:
        return np.empty((0, 3))
    return np.array([-one.rotation.T @ one.translation for one in registered.registration.frames])


def magnification(data: Dataset, nominal: Array) -> float:
    """Magnification 1, 2 or 5 times a power of ten for a longest deflection of at most SHARE."""
    longest = float(np.linalg.norm(data.deflection, axis=-1).max())
    extent = float(np.linalg.norm(np.ptp(nominal.reshape(-1, 3), axis=0))) or 1.0
    return max(1.0, round_scale(SHARE * extent, longest, most=MOST))
