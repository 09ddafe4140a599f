"""Error maps of several models side by side: one scale for all of them, the worst place of each named."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.components import FillMode

from testbench.bench.error_places import ErrorPlaces
from testbench.errors import Array
from testbench.views.colours import SCALE
from testbench.views.markdown import Words
from testbench.views.recording.error_map import key_view, write_balls, write_key
from testbench.views.recording.pen import Pen, snake, text_view
from testbench.views.recording.style import NOMINAL
from testbench.views.scale import scale_for
from testbench.views.schema import Column, Table, show

ROOT, KEY, IN_WORDS = "world/error_map", "error_key_mm", "error_words"
BALL = 0.025  #: Radius of the largest ball over the reach of the arm [1].
ABOUT = 1.6  #: Radius of the shell about the place that is shown over that of the largest ball [1].


@dataclass(frozen=True)
class WorstRow:
    """A model of the table: its error, and where it is worst."""

    model: str
    rms_mm: float
    median_mm: float
    worst_mm: float
    place: int
    where_m: str
    joints: str


COLUMNS = (
    Column("model", "model"),
    Column("rms_mm", "RMS", "mm"),
    Column("median_mm", "median", "mm"),
    Column("worst_mm", "greatest", "mm"),
    Column("place", "place", form="d"),
    Column("where_m", "x, y, z", "m"),
    Column("joints", "joints"),
)


def worst_rows(found: ErrorPlaces) -> list[WorstRow]:
    """The compared models, then the others."""
    names = dict.fromkeys([*found.compared, *found.error_mm])
    return [_row(found, name) for name in names]


def _row(found: ErrorPlaces, name: str) -> WorstRow:
    mm, worst = np.array(found.error_mm[name]), found.worst[name]
    return WorstRow(
        model=name,
        rms_mm=float(np.sqrt(np.mean(mm**2))),
        median_mm=float(np.median(mm)),
        worst_mm=worst.error_mm,
        place=worst.place,
        where_m=", ".join(f"{x:.2f}" for x in worst.position_m),
        joints=worst.joints,
    )


def write_error_maps(pen: Pen, found: ErrorPlaces, reach: float) -> None:
    """Balls at all places, a map a compared model, and the key; `reach` is that of the arm [m]."""
    scale, at = scale_for(found), np.array(found.position_m)
    for name in found.compared:
        path, worst = f"{ROOT}/{snake(name)}", found.worst[name]
        write_balls(pen, f"{path}/field", at, scale.shares(np.array(found.error_mm[name])), BALL * reach)
        above = np.array([worst.position_m]) + np.array([0, 0, 3 * BALL * reach])
        label = f"worst: {show(worst.error_mm)} mm, place {worst.place}"
        pen.names(f"{path}/worst", above, [label], SCALE[-1])
    write_key(pen, KEY, scale)
    table = Table(COLUMNS, worst_rows(found))
    words = Words(Path(__file__).parent, {"map": found, "table": table, "scale": scale}, "error_maps.md.j2")
    pen.documents({IN_WORDS: words.block("error_maps")})


def write_here(pen: Pen, tool: Array, reach: float) -> None:
    """A shell about the place that the arm is in, a row a time: tool (times, 3) [m]."""
    shell = rr.Ellipsoids3D.from_fields(colors=NOMINAL, fill_mode=FillMode.MajorWireframe, line_radii=-1.0)
    pen.still(f"{ROOT}/here", shell)
    half = np.full_like(tool, ABOUT * BALL * reach)
    pen.rows(f"{ROOT}/here", rr.Ellipsoids3D.columns(centers=tool, half_sizes=half))


def error_maps_tab(found: ErrorPlaces, eye: rrb.EyeControls3D) -> rrb.Container:
    """The maps side by side, their key, and the worst places in words."""
    maps = rrb.Horizontal(*(_map_view(row, eye) for row in worst_rows(found)[: len(found.compared)]))
    key = key_view(KEY, scale_for(found))
    return rrb.Vertical(
        maps, key, text_view(IN_WORDS, "Worst places"), row_shares=[12, 2, 6], name="Error map"
    )


def _map_view(row: WorstRow, eye: rrb.EyeControls3D) -> rrb.Spatial3DView:
    drawn: Sequence[str] = ("arm/**", f"error_map/{snake(row.model)}/**", "error_map/here")
    return rrb.Spatial3DView(
        origin="world",
        contents=[f"+ $origin/{part}" for part in drawn],
        name=f"{row.model}: RMS {show(row.rms_mm)} mm, axes (m)",
        eye_controls=eye,
    )
