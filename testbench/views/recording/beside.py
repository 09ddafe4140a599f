"""The recording of a comparison: its words, a chart of the runs line by line, and what each line says."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.bench.compare_map import RunMap
from testbench.views.colours import SCALE
from testbench.views.recording.arm import orbit
from testbench.views.recording.camera import frame
from testbench.views.recording.chart import Chart
from testbench.views.recording.error_map import key_view, write_balls, write_key
from testbench.views.recording.pen import Pen, snake, text_view
from testbench.views.recording.stream import Header, layout, recording
from testbench.views.recording.style import NOISE
from testbench.views.scale import Scale, scale_of
from testbench.views.schema import show

TIMELINE = "worst_first"
MAPS, KEY = "error_map", "error_key_mm"
BALL, AXIS = 0.025, 0.15  #: Radius of the largest ball, and length of the base's axes, over the reach [1].


@dataclass(frozen=True)
class RunMaps:
    """Errors of one model over the workspace, run by run."""

    maps: Sequence[RunMap] = ()
    words: str = ""  #: What there is to say of them, in Markdown.


@dataclass(frozen=True)
class BesideScene:
    """Runs beside one another, as Markdown and a chart."""

    summary: str  #: Question, answer, what differs and how to read it.
    chart: Chart | None  #: None where no number differs.
    rows: Sequence[str]  #: What is said of each model or number, in the order of the chart; at least one.
    lines: int  #: Of each of them in the chart.
    tables: str  #: All of them.
    maps: RunMaps = field(default_factory=RunMaps)


def write_beside(path: Path, header: Header, scene: BesideScene) -> None:
    """Write a comparison for the Rerun viewer; an existing file is replaced only by a whole one."""
    places = np.arange(len(scene.rows))
    with recording(path, "compare", header, _blueprint(scene)) as pen:
        pen.documents({"summary": scene.summary, "tables": scene.tables})
        if scene.maps.maps:
            _write_maps(pen, scene.maps)
        row = pen.on(rr.TimeColumn(TIMELINE, sequence=places))
        row.texts("this_row", scene.rows)
        if scene.chart:
            scene.chart.write(pen)
            scene.chart.write_cursor(row, 1 + scene.lines * places.astype(np.float64), scene.lines)


def _write_maps(pen: Pen, shown: RunMaps) -> None:
    """Balls at all places and the worst one by its name, a map a run, and the axes of the base."""
    scale, size = _scale(shown), _reach(shown)
    for own in shown.maps:
        path = f"{MAPS}/{snake(own.worst.letter)}"
        write_balls(pen, f"{path}/field", own.position_m, scale.shares(own.error_mm), BALL * size)
        above = np.add([own.worst.position_m], [0, 0, 3 * BALL * size])
        pen.names(f"{path}/worst", above, [f"worst: {show(own.worst.error_mm)} mm"], SCALE[-1])
        axes = rr.Arrows3D(
            vectors=AXIS * size * np.eye(3), labels=["x", "y", "z"], colors=NOISE, show_labels=True
        )
        pen.still(f"{path}/base", axes)
    write_key(pen, KEY, scale)
    pen.documents({"map_words": shown.words})


def _scale(shown: RunMaps) -> Scale:
    return scale_of(*(own.error_mm for own in shown.maps))


def _reach(shown: RunMaps) -> float:
    """Farthest place from the base [m]."""
    return max(float(np.linalg.norm(own.position_m, axis=1).max()) for own in shown.maps)


def _maps_tab(shown: RunMaps) -> rrb.Container:
    """The maps side by side, their key, and the worst places in words."""
    points = np.vstack([[[0.0, 0.0, 0.0]], *(own.position_m for own in shown.maps)])
    eye = orbit(*frame(points, np.full(len(points), BALL * _reach(shown)), points[1:, :2].mean(axis=0)))
    views = [
        rrb.Spatial3DView(
            origin=f"{MAPS}/{snake(own.worst.letter)}",
            name=f"{own.worst.letter}: RMS {show(own.rms_mm)} mm, axes (m)",
            eye_controls=eye,
        )
        for own in shown.maps
    ]
    texts = text_view("map_words", "Worst places")
    parts = rrb.Horizontal(*views), key_view(KEY, _scale(shown)), texts
    return rrb.Vertical(*parts, row_shares=[12, 2, 5], name="Error map")


def _blueprint(scene: BesideScene) -> rrb.Blueprint:
    """The chart beside the words, below them what is said of one model or number; then all tables."""
    texts = text_view("summary", "Summary"), text_view("this_row", "Marked in the chart")
    words = rrb.Vertical(*texts, row_shares=[5, 2])
    parts = [scene.chart.view()] if scene.chart else []
    overview = rrb.Horizontal(*parts, words, column_shares=[1] * (len(parts) + 1), name="Overview")
    maps = [_maps_tab(scene.maps)] if scene.maps.maps else []
    tables = text_view("tables", "Tables")
    return layout(overview, *maps, tables, timeline=TIMELINE, places=len(scene.rows))
