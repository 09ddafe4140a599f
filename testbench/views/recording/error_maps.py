"""Error maps of several models side by side: one scale for all of them, the worst place of each named."""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.components import FillMode

from testbench.bench.error_places import ErrorPlaces, WorstPlace
from testbench.errors import Array
from testbench.views.colours import SCALE
from testbench.views.markdown import Words
from testbench.views.recording.error_map import (
    SMALLEST,
    key_view,
    write_balls,
    write_key,
)
from testbench.views.recording.pen import Pen, snake, text_view
from testbench.views.recording.style import NOISE, NOMINAL
from testbench.views.scale import Scale, scale_of
from testbench.views.schema import show
from testbench.views.worst import WorstRow, worst_rows, worst_table

TIMELINE = "place"  #: Of the places of the workspace, from 1, where models differ most.
ROOT, KEY, IN_WORDS = "world/error_map", "error_key_mm", "error_words"
BALL = 0.025  #: Radius of the largest ball over the reach of the arm [1].
CLEAR, INWARD = 0.1, 0.4
"""How far above all balls the worst is named, over the reach, and from their middle, over its own way [1]."""
PANE = 1.1  #: Width over height of the pane of a map where three stand side by side [1].
ABOUT = 1.6  #: Radius of the shell about the place that is shown over that of the largest ball [1].


def write_error_maps(pen: Pen, found: ErrorPlaces, reach: float) -> None:
    """A map a compared model, and the key: balls at places, rings where there is no bound.

    Args:
        pen: What stands still is drawn with it.
        found: Errors by place.
        reach: Of the arm [m].
    """
    scale, at = _scale(found), np.array(found.position_m)
    for name in found.compared:
        path, mm = f"{ROOT}/{snake(name)}", found.errors(name)
        known = np.isfinite(mm)
        write_balls(pen, f"{path}/field", at[known], scale.shares(mm[known]), BALL * reach)
        if not known.all():
            _write_rings(pen, f"{path}/without_bound", at[~known], SMALLEST * BALL * reach)
        if name in found.worst:
            _write_worst(pen, f"{path}/worst", found.worst[name], at, reach)
    write_key(pen, KEY, scale)
    words = Words(
        Path(__file__).parent,
        {"map": found, "table": worst_table(found), "scale": scale},
        "error_maps.md.j2",
    )
    pen.documents({IN_WORDS: words.block("error_maps")})


def _scale(found: ErrorPlaces) -> Scale:
    """The one scale of all maps."""
    return scale_of(*map(found.errors, found.compared))


def _write_rings(pen: Pen, path: str, centres: Array, radius: float) -> None:
    """Grey rings about centres (n, 3) [m]."""
    half, lines = np.full(centres.shape, radius), FillMode.MajorWireframe
    rings = rr.Ellipsoids3D(centers=centres, half_sizes=half, colors=NOISE, fill_mode=lines, line_radii=-0.5)
    pen.still(path, rings)


def _write_worst(pen: Pen, path: str, worst: WorstPlace, at: Array, reach: float) -> None:
    """The name of the worst of all places (n, 3) [m], above them and not at their edge, with a line to it."""
    own = np.array(worst.position_m)
    name = at.mean(axis=0) + INWARD * (own - at.mean(axis=0))
    name[2] = at[:, 2].max() + CLEAR * reach
    end = name - [0, 0, CLEAR * reach / 2]  # a name hangs below its point
    pen.still(path, rr.LineStrips3D([[own, end]], colors=SCALE[-1], radii=-0.75))
    label = f"worst {show(worst.error_mm)} mm, place {worst.place + 1}"
    pen.names(path, name[None], [label], SCALE[-1])


def write_here(pen: Pen, tool: Array, reach: float) -> None:
    """A shell about the place that the arm is in, a row a time: tool (times, 3) [m]."""
    shell = rr.Ellipsoids3D.from_fields(colors=NOMINAL, fill_mode=FillMode.MajorWireframe, line_radii=-1.0)
    pen.still(f"{ROOT}/here", shell)
    half = np.full_like(tool, ABOUT * BALL * reach)
    pen.rows(f"{ROOT}/here", rr.Ellipsoids3D.columns(centers=tool, half_sizes=half))


def error_maps_tab(found: ErrorPlaces, eye: rrb.EyeControls3D) -> rrb.Container:
    """The maps side by side, their key, and the worst places in words.

    Args:
        found: Errors by place.
        eye: Of all maps.
    """
    views = [_map_view(row, found.means.typical, eye) for row in worst_rows(found)[: len(found.compared)]]
    key = key_view(KEY, _scale(found))
    return rrb.Vertical(
        rrb.Horizontal(*views),
        key,
        text_view(IN_WORDS, "Worst places"),
        row_shares=[11, 2, 7],
        name="Error map",
    )


def _map_view(row: WorstRow, typical: str, eye: rrb.EyeControls3D) -> rrb.Spatial3DView:
    drawn = ("arm/**", f"error_map/{snake(row.model)}/**", "error_map/here")
    known = "no bound" if row.typical_mm is None else f"{typical} {show(row.typical_mm)} mm"
    return rrb.Spatial3DView(
        origin="world",
        contents=[f"+ $origin/{part}" for part in drawn],
        name=f"{row.model}: {known}, axes (m)",
        eye_controls=eye,
    )
