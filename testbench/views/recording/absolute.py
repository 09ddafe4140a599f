"""The recording of a calibration by absolute readings: the arm, and how far its targets were from a model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.components import MarkerShape

from testbench.bench.absolute_report import SpectrumRow
from testbench.bench.campaign import Cell
from testbench.bench.rows import MM
from testbench.data.dataset import Ids
from testbench.errors import Array
from testbench.plant.shapes import Frames, rigid_frames
from testbench.views.magnified import round_scale
from testbench.views.recording.arm import orbit, origins, reach, write_places, write_shapes
from testbench.views.recording.camera import frame
from testbench.views.recording.error_map import shades
from testbench.views.recording.error_maps import (
    PlaceScene,
    error_maps_tab,
    map_eye,
    write_here,
    write_places_of,
)
from testbench.views.recording.pen import Line, Pen, snake, text_view
from testbench.views.recording.stream import Header, layout, recording
from testbench.views.recording.style import GCO, MEASURED, NOMINAL, Colour
from testbench.views.scale import shares

TIMELINES = ("worst_first", "run")
MODELS = {"drawn": ("As drawn", NOMINAL), "calibrated": ("Calibrated", GCO)}
"""Title and colour of each model, by path."""
MOST_SCALE, LONGEST = 500.0, 0.65
"""Magnification of errors, unless those that end the colours would be longer than this share of the reach."""
MOST_APART, LONGEST_APART = 10_000.0, 0.3
"""The same where either side has its own."""
TOP = 95  #: Per cent of the errors of the arm as drawn at which the colours end.
SPECTRA = 8  #: Joints whose spectrum is drawn at most.
ASPECT = 0.95  #: Width over height of a pane that shows the arm [1].
BESIDE = (0.3, 0.9, 0.45)  #: Where the eye is: ahead along the reach of the arm, beside it, above [1].


@dataclass(frozen=True)
class Arrows:
    """From where targets should be to where they were seen, of every row (m, 3) [m]."""

    places: tuple[Array, ...]
    errors: tuple[Array, ...]

    @cached_property
    def longest(self) -> Array:
        """Longest error of every row, (rows,) [m]."""
        return np.array([np.linalg.norm(error, axis=1).max() for error in self.errors])

    def of(self, rows: Ids) -> "Arrows":
        """Some rows."""
        return Arrows(tuple(self.places[k] for k in rows), tuple(self.errors[k] for k in rows))


@dataclass(frozen=True)
class AbsoluteScene:
    """A calibration and its words, made ready for drawing."""

    cell: Cell  #: The arm.
    q: Array  #: Joints of the poses that are shown, (poses, n) [rad, m].
    number: Ids  #: Of these poses in the order of the files, from 1, (poses,).
    drawn: Arrows  #: Of these poses, by the arm as drawn.
    calibrated: Arrows  #: By the calibrated arm.
    still: tuple[Arrows, Arrows]  #: Of more poses, by either: they stand still.
    pose_words: Sequence[str]  #: Markdown of every pose.
    summary: str  #: Markdown: question, bold answer, colours.
    tables: str  #: Markdown.
    geometry: str  #: Markdown.
    spectrum: Sequence[SpectrumRow]
    models: Mapping[str, tuple[str, Colour]] = field(default_factory=lambda: MODELS)  #: Title, colour.
    kind: str = "absolute"  #: Of layout: titles are a part of it.
    opens: str = "calibrated"  #: Model whose largest errors are first in worst_first.
    beside: str = "Geometry"  #: Title of that document.
    apart: bool = False  #: Whether either side has a magnification and ends of the colours of its own.
    plot: str = "Largest error of a pose (mm)"  #: Title of the plot below the arms.
    map: PlaceScene | None = None  #: Errors over the workspace, in a tab of their own.

    def saying(self, more: str) -> "AbsoluteScene":
        """The same with more words in its summary."""
        return replace(self, summary=f"{self.summary}\n\n{more}")

    @cached_property
    def frames(self) -> Frames:
        """The arm in every pose."""
        return rigid_frames(self.cell.room, self.q)

    @property
    def tops_mm(self) -> tuple[float, float]:
        """Errors at which the colours end, left and right."""
        left, right = (float(MM * np.percentile(one.longest, TOP)) for one in self.still)
        return (left, right) if self.apart else (left, left)

    @property
    def scales(self) -> tuple[float, float]:
        """Magnification of the errors left and right, 1, 2 or 5 times a power of ten [1]."""
        longest, most = (LONGEST_APART, MOST_APART) if self.apart else (LONGEST, MOST_SCALE)
        drawn = longest * reach(self.frames) * MM
        left, right = (max(1.0, round_scale(drawn, top, most=most)) for top in self.tops_mm)
        return left, right

    @property
    def top_mm(self) -> float:
        """The left one of them."""
        return self.tops_mm[0]

    @property
    def scale(self) -> float:
        """The left one of them."""
        return self.scales[0]

    @property
    def rank(self) -> Ids:
        """Place of every pose in worst_first, (poses,)."""
        worst = self.calibrated if self.opens == "calibrated" else self.drawn
        found = np.empty(len(self.q), dtype=int)
        found[np.argsort(-worst.longest, kind="stable")] = np.arange(len(self.q))
        return found


def write_absolute(path: Path, header: Header, scene: AbsoluteScene) -> None:
    """Write a calibration for the Rerun viewer; an existing file is replaced only by a whole one."""
    scales = {"error_magnification": scene.scale}
    if scene.apart:
        scales |= {"right_magnification": scene.scales[1]}
    header = replace(header, scales=scales)
    times = (scene.rank, scene.number)
    with recording(path, scene.kind, header, _blueprint(scene)) as pen:
        pen.documents({"summary": scene.summary, "tables": scene.tables, "geometry": scene.geometry})
        run = pen.on(*(rr.TimeColumn(n, sequence=k) for n, k in zip(TIMELINES, times, strict=True)))
        run.texts("this_pose", scene.pose_words)
        write_shapes(run, scene.cell, ())
        write_places(run, scene.cell, scene.frames)
        for side, (name, (title, colour)) in enumerate(scene.models.items()):
            own = (scene.drawn, scene.calibrated)[side]
            _write_still(pen, name, scene, side)
            _write_pose(run, name, own, scene, side)
            line = Line(f"error_mm/{name}", f"{title} (mm)", colour, 2.0, MarkerShape.Circle, 2.5)
            if side or not scene.apart:  # in one plot the smaller would lie flat
                run.line(line, MM * own.longest)
        if scene.map:
            tools = origins(scene.cell, [scene.cell.arm.tool], scene.frames)[:, 0]
            write_here(run, tools, reach(scene.frames))
            write_places_of(pen, scene.cell, scene.map, "this_pose", "error_mm")
        for row in scene.spectrum[:SPECTRA]:
            order, amplitude = np.array([(one.order, one.amplitude_urad) for one in row.orders]).T
            bars = rr.BarChart(amplitude, color=GCO, abscissa=order, widths=np.full(len(order), 0.8))
            pen.still(_spectrum_path(row), bars)


def _write_still(pen: Pen, name: str, scene: AbsoluteScene, side: int) -> None:
    """Every error, coloured by its size."""
    arrows = scene.still[side]
    places, errors = np.concatenate(arrows.places), np.concatenate(arrows.errors)
    size = np.linalg.norm(errors, axis=1)
    share = np.clip(shares(MM * size, (0.0, scene.tops_mm[side])), 0, 1)
    drawn = size > 0  # a lost target has none
    vectors = scene.scales[side] * errors[drawn]
    radii = 0.0015 * reach(scene.frames)
    looks = rr.Arrows3D(origins=places[drawn], vectors=vectors, colors=shades(share[drawn]), radii=radii)
    pen.still(f"world/errors/{name}", looks)


def _write_pose(pen: Pen, name: str, arrows: Arrows, scene: AbsoluteScene, side: int) -> None:
    """Errors of the pose that is shown."""
    path, size = f"world/pose_errors/{name}", reach(scene.frames)
    pen.still(path, rr.Arrows3D.from_fields(colors=MEASURED, radii=0.006 * size))
    columns = rr.Arrows3D.columns(
        origins=np.concatenate(arrows.places), vectors=scene.scales[side] * np.concatenate(arrows.errors)
    )
    pen.rows(path, columns.partition([len(part) for part in arrows.places]))


def _spectrum_path(row: SpectrumRow) -> str:
    return f"spectrum_urad/{snake(row.joint)}"


def _blueprint(scene: AbsoluteScene) -> rrb.Blueprint:
    """The arm twice, with the errors of either model; numbers beside it."""
    views = [_world(scene, name, title, k) for k, (name, (title, _)) in enumerate(scene.models.items())]
    plot = rrb.TimeSeriesView(
        origin="error_mm",
        name=scene.plot,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
    )
    below = rrb.Horizontal(text_view("this_pose", "This pose"), plot, column_shares=[1, 1])
    shown = rrb.Vertical(rrb.Horizontal(*views), below, row_shares=[7, 3])
    summary = text_view("summary", "Summary")
    tabs: list[rrb.Container | rrb.View] = [
        rrb.Horizontal(shown, summary, column_shares=[12, 7], name="Overview"),
        rrb.Horizontal(text_view("tables", "Tables"), text_view("geometry", scene.beside), name="Tables"),
    ]
    if scene.map:
        tabs.insert(1, error_maps_tab(scene.map.found, map_eye(scene.map.found, scene.cell)))
    if scene.spectrum:
        bars = [
            rrb.BarChartView(
                origin=_spectrum_path(row),
                name=f"{row.joint}: amplitude (urad) by order",
                plot_legend=rrb.PlotLegend(visible=False),
            )
            for row in scene.spectrum[:SPECTRA]
        ]
        tabs.append(rrb.Grid(*bars, name="Spectra"))
    return layout(*tabs, timeline=TIMELINES[0], places=len(scene.q))


def _world(scene: AbsoluteScene, name: str, title: str, side: int) -> rrb.Spatial3DView:
    still, scale = scene.still[side if scene.apart else 0], scene.scales[side]
    places, errors = (np.concatenate(x) for x in (still.places, still.errors))
    length = MM * np.linalg.norm(errors, axis=1, keepdims=True)
    top = scene.tops_mm[side]
    within = errors * np.minimum(1.0, top / np.maximum(length, top))  # no longer than where the colours end
    points = np.vstack([places, places + scale * within, scene.frames.positions.reshape(-1, 3)])
    tool = origins(scene.cell, [scene.cell.arm.tool], scene.frames)[scene.rank.argmin(), 0, :2]
    eye = frame(points, np.full(len(points), 0.05 * reach(scene.frames)), tool, BESIDE, ASPECT)
    return rrb.Spatial3DView(
        origin="world",
        contents=[f"+ $origin/{part}/**" for part in ("arm", f"errors/{name}", f"pose_errors/{name}")],
        name=f"{title} (m): {'' if scene.apart else 'errors '}x {scale:g}",
        eye_controls=orbit(*eye),
    )
