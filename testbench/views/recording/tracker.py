"""The laser tracker: a head on three legs, and its lines of sight."""

import numpy as np
import rerun as rr
from rerun.components import FillMode

from testbench.errors import Array
from testbench.views.recording.pen import Pen
from testbench.views.recording.style import MEASURED

HEAD = 0.12  #: Radius of the tracker's head [m]; its feet stand three times as far from its axis.
ROOT, SIGHT = "world/tracker", "world/sight"


def write_tracker(pen: Pen, station: Array, label: str = "tracker") -> None:
    """A head that stands still at its station, (3,) [m]."""
    head = rr.Ellipsoids3D(
        centers=[station], half_sizes=[[HEAD] * 3], colors=MEASURED, fill_mode=FillMode.Solid
    )
    pen.still(f"{ROOT}/head", head)
    legs = rr.LineStrips3D([[station, foot] for foot in feet(station)], colors=MEASURED, radii=0.18 * HEAD)
    pen.still(f"{ROOT}/stand", legs)
    pen.names(f"{ROOT}/label", station[None] + np.array([0, 0, 4 * HEAD]), [label], MEASURED)
    pen.still(SIGHT, rr.LineStrips3D.from_fields(colors=MEASURED, radii=-0.6))


def write_sights(pen: Pen, station: Array, markers: Array) -> None:
    """A line to every marker, (rows, m, 3) [m], a row a time."""
    lines = np.stack([np.broadcast_to(station, markers.shape), markers], axis=2).reshape(-1, 2, 3)
    pen.rows(SIGHT, rr.LineStrips3D.columns(strips=lines).partition([markers.shape[1]] * len(markers)))


def feet(station: Array) -> Array:
    """Where the tracker's legs stand, (3, 3) [m]."""
    angle = 2 * np.pi * np.arange(3) / 3
    away = 3 * HEAD * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.column_stack([station[:2] + away, np.zeros(3)])
