"""An error map: how good predictions are where in the workspace, errors as colour and size of points."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import rerun as rr
import rerun.blueprint as rrb
from rerun.components import FillMode

from testbench.errors import Array
from testbench.views.colours import SCALE
from testbench.views.markdown import Words
from testbench.views.recording.pen import Pen
from testbench.views.recording.style import NOISE, Colour
from testbench.views.scale import Scale, scale_of
from testbench.views.schema import Column, Table, show

SMALLEST = 0.4  #: Size of the point of least error over that of the greatest [1]: colour is never alone.
KEYS, STEP, KEY = 5, 180.0, 20.0
"""Points of the key, their distance and the radius of the largest, in the key's own units."""
STATISTICS = {"least": 0, "median": 0.5, "95 %": 0.95, "greatest": 1}
"""Columns of the map's table: quantile by heading."""


@dataclass(frozen=True)
class ErrorMap:
    """Errors at places."""

    words: str  #: What the errors are, with unit.
    field: Array  #: Tool positions all over the workspace, (p, 3) [m].
    field_mm: Array  #: Error at each, (p,) [mm].
    tasks: Array  #: Tool positions where the robot works, (t, 3) [m]; none where no tasks are named.
    tasks_mm: Array  #: Error at each, (t,) [mm].

    @property
    def scale(self) -> Scale:
        """Of the whole map."""
        return scale_of(np.concatenate([self.field_mm, self.tasks_mm]))

    @property
    def ends(self) -> tuple[float, float]:
        """The ends of its scale [mm]."""
        return self.scale.ends

    @property
    def table(self) -> Table:
        """Errors over the workspace and in the tasks."""
        columns = (Column(heading, heading, "mm") for heading in STATISTICS)
        rows = [
            {"places": f"{name}, {len(mm)}"} | {k: np.quantile(mm, q) for k, q in STATISTICS.items()}
            for name, mm in (("workspace", self.field_mm), ("tasks", self.tasks_mm))
            if len(mm)
        ]
        return Table((Column("places", "places"), *columns), rows)


def shades(share: Array) -> npt.NDArray[np.uint8]:
    """Colours of places on the scale, (n,) to (n, 3): the greater the error, the brighter."""
    at = np.linspace(0, 1, len(SCALE))
    parts = [np.rint(np.interp(share, at, part)) for part in zip(*SCALE, strict=True)]
    return np.column_stack(parts).astype(np.uint8)


def sizes(share: Array) -> Array:
    """Sizes of places on the scale over that of the greatest error, (n,) [1]."""
    return SMALLEST + (1 - SMALLEST) * share


def write_error_map(pen: Pen, path: str, error_map: ErrorMap, radius: float) -> None:
    """Balls over the workspace, cubes at the tasks, and labels at the ends of either.

    `path` is the root of its entities, `radius` that of the largest ball [m].
    """
    scale = error_map.scale
    tasks = scale.shares(error_map.tasks_mm)
    write_balls(pen, f"{path}/field", error_map.field, scale.shares(error_map.field_mm), radius)
    named = [
        (error_map.field, error_map.field_mm, error_map.field_mm.argmin(), "least"),
        (error_map.field, error_map.field_mm, error_map.field_mm.argmax(), "greatest"),
    ]
    if len(tasks):
        write_cubes(pen, f"{path}/tasks", error_map.tasks, radius * sizes(tasks), shades(tasks))
        named.append((error_map.tasks, error_map.tasks_mm, error_map.tasks_mm.argmax(), "worst task"))
    at = np.array([places[k] for places, _, k, _ in named]) + np.array([0, 0, 3 * radius])
    pen.names(f"{path}/label", at, [f"{name} {show(mm[k])} mm" for _, mm, k, name in named], NOISE)


def write_balls(pen: Pen, path: str, centres: Array, share: Array, radius: float) -> None:
    """Balls at centres (n, 3) [m] by their places on the scale, (n,); `radius` of the largest [m]."""
    pen.still(path, rr.Points3D(centres, colors=shades(share), radii=radius * sizes(share)))


def write_cubes(
    pen: Pen, path: str, centres: Array, half: Array, colours: Colour | npt.NDArray[np.uint8]
) -> None:
    """Cubes that stand still: centres (n, 3), halves of their edges (n,) [m], one colour or (n, 3)."""
    sides = np.column_stack([half] * 3)
    solid = FillMode.Solid
    pen.still(path, rr.Boxes3D(centers=centres, half_sizes=sides, colors=colours, fill_mode=solid))


def write_key(pen: Pen, path: str, scale: Scale) -> None:
    """Colours and sizes of a scale with their errors, in a row; the path must name the unit, mm."""
    share = np.linspace(0, 1, KEYS)
    places = np.column_stack([STEP * np.arange(KEYS), np.zeros(KEYS)])
    pen.still(f"{path}/dot", rr.Points2D(places, colors=shades(share), radii=KEY * sizes(share)))
    beside = places + np.array([0.45 * STEP, -0.75 * KEY])  # a label hangs below its point
    pen.names(f"{path}/number", beside, [f"{show(mm)} mm" for mm in scale.errors(share)], NOISE)


def map_words(error_map: ErrorMap) -> str:
    """The map in Markdown: its greatest error, its table, its colours."""
    return Words(Path(__file__).parent, {"map": error_map}, "error_map.md.j2").block("error_map")


def key_view(path: str, scale: Scale) -> rrb.Spatial2DView:
    """The view of a key."""
    bounds = rrb.VisualBounds2D(x_range=(-0.3 * STEP, KEYS * STEP), y_range=(-1.6 * KEY, 1.6 * KEY))
    name = f"Colour and size of an error ({scale.words})"
    return rrb.Spatial2DView(origin=path, name=name, visual_bounds=bounds)
