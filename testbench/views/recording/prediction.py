"""The recording of a prediction: the arm, where its loads bring the tool, how stiff that is."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.components import FillMode, MarkerShape
from scipy.spatial.transform import Rotation

from testbench.bench.campaign import Cell
from testbench.bench.rows import MM
from testbench.data.dataset import Ids
from testbench.errors import Array
from testbench.plant.shapes import Frames, rigid_frames
from testbench.views.magnified import round_scale
from testbench.views.recording.arm import orbit, reach, write_places, write_shapes
from testbench.views.recording.camera import frame
from testbench.views.recording.error_maps import (
    PlaceScene,
    error_maps_tab,
    map_eye,
    write_here,
    write_places_of,
)
from testbench.views.recording.pen import Line, Pen, text_view
from testbench.views.recording.stream import Header, layout, recording
from testbench.views.recording.style import GCO, MEASURED, NOISE

TIMELINES = ("worst_first", "pose")
LONGEST, WIDEST = 0.22, 0.18  #: Of an arrow and of a semi-axis at most, over the reach of the arm [1].
MOST_SCALE = 1000.0  #: Magnification at most [1].
BESIDE = (0.35, 0.9, 0.35)  #: Where the eye is: ahead along the reach of the arm, beside it, above [1].
ASPECT = 1.9  #: Width over height of the pane of the arm [1].


@dataclass(frozen=True)
class PredictionScene:
    """A prediction and its words, made ready for drawing."""

    cell: Cell  #: The arm.
    q: Array  #: Joints of the poses that are shown, (poses, n) [rad, m].
    number: Ids  #: Of these poses in the order of the file, from 1, (poses,).
    start: Array  #: Points of the unloaded tool, its origin first, (poses, k, 3) [m].
    deflection: Array  #: How far they move, (poses, k, 3) [m].
    half_mm: Array  #: Half width of the tool's own, (poses,) [mm]; infinite where nothing was seen.
    tool: Array  #: The loaded tool, (poses, 3) [m].
    give: Array  #: Semi-axes of where a force of every direction brings it, (poses, 3) [m].
    axes: Array  #: Their unit vectors as columns, (poses, 3, 3).
    map: PlaceScene  #: How far that force moves the tool over the workspace.
    pose_words: Sequence[str]  #: Markdown of every pose.
    summary: str  #: Markdown: question, bold answer, statements.
    tables: str  #: Markdown.

    def saying(self, more: str) -> "PredictionScene":
        """The same with more words in its summary."""
        return replace(self, summary=f"{self.summary}\n\n{more}")

    @cached_property
    def frames(self) -> Frames:
        """The arm in every pose."""
        return rigid_frames(self.cell.room, self.q)

    @property
    def size_mm(self) -> Array:
        """Deflection of the tool, (poses,) [mm]."""
        return np.asarray(MM * np.linalg.norm(self.deflection[:, 0], axis=1))

    @property
    def scale(self) -> float:
        """Magnification of deflections [1]."""
        longest = float(np.linalg.norm(self.deflection, axis=2).max())
        return max(1.0, round_scale(LONGEST * reach(self.frames), longest, most=MOST_SCALE))

    @property
    def give_scale(self) -> float:
        """Magnification of the ellipsoids [1]."""
        widest = float(self.give.max())
        return max(1.0, round_scale(WIDEST * reach(self.frames), widest, most=MOST_SCALE))

    @property
    def rank(self) -> Ids:
        """Place of every pose in worst_first, (poses,)."""
        found = np.empty(len(self.q), dtype=int)
        found[np.argsort(-self.size_mm, kind="stable")] = np.arange(len(self.q))
        return found


def write_prediction(path: Path, header: Header, scene: PredictionScene) -> None:
    """Write a prediction for the Rerun viewer; an existing file is replaced only by a whole one."""
    scales = {"deflection_magnification": scene.scale, "ellipsoid_magnification": scene.give_scale}
    times = (scene.rank, scene.number)
    with recording(path, "prediction", replace(header, scales=scales), _blueprint(scene)) as pen:
        pen.documents({"summary": scene.summary, "tables": scene.tables})
        run = pen.on(*(rr.TimeColumn(n, sequence=k) for n, k in zip(TIMELINES, times, strict=True)))
        run.texts("this_pose", scene.pose_words)
        write_shapes(run, scene.cell, ())
        write_places(run, scene.cell, scene.frames)
        size = reach(scene.frames)
        run.still("world/deflection", rr.Arrows3D.from_fields(colors=MEASURED, radii=0.006 * size))
        run.arrows("world/deflection", scene.start, scene.scale * scene.deflection)
        _write_ellipsoids(run, scene)
        write_here(run, scene.start[:, 0], size)
        write_places_of(pen, scene.cell, scene.map, "this_pose", "deflection_mm")
        _write_plot(run, scene)


def _write_ellipsoids(run: Pen, scene: PredictionScene) -> None:
    """Where a force of every direction would bring the loaded tool of every pose."""
    axes = scene.axes * np.linalg.det(scene.axes)[:, None, None]  # none left-handed
    path = "world/ellipsoid"
    run.still(path, rr.Ellipsoids3D.from_fields(colors=GCO, fill_mode=FillMode.Solid))
    run.rows(
        path,
        rr.Ellipsoids3D.columns(
            centers=scene.start[:, 0] + scene.scale * scene.deflection[:, 0],
            half_sizes=scene.give_scale * scene.give,
            quaternions=Rotation.from_matrix(axes).as_quat(),
        ),
    )


def _write_plot(run: Pen, scene: PredictionScene) -> None:
    """Deflection of the tool, and its interval where there is one."""
    size, half = scene.size_mm, np.where(np.isfinite(scene.half_mm), scene.half_mm, np.nan)
    tool = Line("deflection_mm/tool", "the tool (mm)", GCO, 2.0, MarkerShape.Circle, 2.5)
    run.line(tool, size)
    for name, values in (("lower", np.maximum(size - half, 0)), ("upper", size + half)):
        if np.isfinite(values).any():
            run.line(Line(f"deflection_mm/{name}", f"{name} end of 95 % (mm)", NOISE, 1.0), values)


def _blueprint(scene: PredictionScene) -> rrb.Blueprint:
    """The arm with its deflections, the map, and numbers beside them."""
    plot = rrb.TimeSeriesView(
        origin="deflection_mm",
        name="Tool moves in a pose, at a place (mm)",
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
    )
    below = rrb.Horizontal(text_view("this_pose", "This pose"), plot, column_shares=[1, 1])
    shown = rrb.Vertical(_arm_view(scene), below, row_shares=[7, 3])
    summary = text_view("summary", "Summary")
    overview = rrb.Horizontal(shown, summary, column_shares=[12, 7], name="Overview")
    where = error_maps_tab(scene.map.found, map_eye(scene.map.found, scene.cell))
    return layout(overview, where, text_view("tables", "Tables"), timeline=TIMELINES[0], places=len(scene.q))


def _arm_view(scene: PredictionScene) -> rrb.Spatial3DView:
    worst = scene.rank.argmin()
    ends = scene.start[worst] + scene.scale * scene.deflection[worst]
    points = np.vstack([scene.frames.positions[worst], ends])
    radii = np.full(len(points), 0.2 * reach(scene.frames))
    eye = frame(points, radii, scene.tool[worst, :2], BESIDE, ASPECT)
    return rrb.Spatial3DView(
        origin="world",
        contents=[f"+ $origin/{part}/**" for part in ("arm", "deflection", "ellipsoid")],
        name=f"Arm (m): deflections x {scene.scale:g}, ellipsoid x {scene.give_scale:g}",
        eye_controls=orbit(*eye),
    )
