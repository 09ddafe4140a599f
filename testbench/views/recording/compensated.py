"""The recording of a corrected robot: its tool drawn off the line by the process, and put back."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.bench.campaign import Cell
from testbench.bench.rows import MM
from testbench.data.dataset import Ids
from testbench.errors import Array
from testbench.plant.shapes import Frames, elastic_frames, rigid_frames
from testbench.views.magnified import round_scale
from testbench.views.recording.arm import orbit, reach, write_places, write_shapes
from testbench.views.recording.camera import frame
from testbench.views.recording.curves import Curve, Curves, alone
from testbench.views.recording.pen import Pen, snake, text_view
from testbench.views.recording.stream import Header, layout, recording
from testbench.views.recording.style import LOAD, NOISE, TASK, Colour

TIMELINES = ("worst_first", "point")
LONGEST = 0.35  #: Of what is drawn of the largest error, at most [m].
ARROW = 1e-4  #: Length of the force's arrow [m/N].
THICK, CROSS = 0.004, 0.03  #: Radius of lines, and half a cross [m].
BESIDE, ASPECT = (-0.6, 0.9, 0.4), 1.0
"""Where the eye is: ahead along the reach of the arm, beside it, above; width over height of its pane."""
NEAR = (-0.62, -0.46, 0.28)  #: Of the eye that sees the panel, from its middle, over what is drawn there [1].
ROOM = 0.8  #: Around what is seen of the arm [m].
LEAST = 0.5  #: What is drawn there at least [m].
NOT_CORRECTED, CORRECTED, INTERVAL = "not corrected", "corrected, ", "95 % interval"
WITHIN = "corrected, within (95 %)"
"""Names of what is drawn, and how those of corrections begin."""
PLOT = (430.0, 270.0)  #: Size of the pane of the plot [ui points].
LEAST_MM = 1e-3  #: What is less is drawn there: the axis is logarithmic [mm].


@dataclass(frozen=True)
class Off:
    """Where the loaded tool is, minus where it was asked, by one model or not corrected."""

    name: str
    colour: Colour
    metres: Array  #: World, (points, 3) [m].
    half: Array | None = None  #: Half the 95 % interval of each component; None where nobody says.
    foretold: bool = False  #: Whether nobody knows but the model: only the interval tells how far off.


@dataclass(frozen=True)
class Part:
    """Some of the points: holes, or a path."""

    name: str
    points: slice
    path: bool  #: Whether the tool goes along it; else from hole to hole.
    closed: bool = False  #: Whether the path ends where it began.


@dataclass(frozen=True)
class Compensated:
    """A program that was done by the true arm, and its words."""

    cell: Cell  #: The true arm.
    q: Array  #: Programmed joints, (points, n) [rad].
    asked: Array  #: Where the tool was asked to be, (points, 3) [m].
    force: Array  #: On the tool, (points, 3) [N].
    bent: Array  #: Virtual joints loaded minus unloaded, not corrected, (points, n_theta) [m, rad].
    panel: Array | None  #: What is worked on, a grid, (rows, columns, 3) [m]; None where nobody says.
    parts: tuple[Part, ...]
    offs: tuple[Off, ...]  #: The first is not corrected, the last one is what to look at.
    point_words: Sequence[str]  #: Markdown of every point.
    summary: str  #: Markdown: question, bold answer, colours.
    tables: str  #: Markdown.

    @property
    def scale(self) -> float:
        """Magnification of what is off: 1, 2 or 5 times a power of ten [1]."""
        largest = float(np.linalg.norm(self.offs[0].metres, axis=1).max())
        return max(1.0, round_scale(LONGEST, largest)) if largest else 1.0

    @cached_property
    def frames(self) -> Frames:
        """The arm at every point."""
        return rigid_frames(self.cell.room, self.q)

    @property
    def rank(self) -> Ids:
        """Place of every point in worst_first, (points,)."""
        found = np.empty(len(self.q), dtype=int)
        found[np.argsort(-np.linalg.norm(self.offs[0].metres, axis=1), kind="stable")] = np.arange(len(found))
        return found

    def places(self, off: Off) -> Array:
        """Where the tool is drawn, (points, 3) [m]."""
        return np.asarray(self.asked + self.scale * off.metres)


def write_compensated(path: Path, header: Header, scene: Compensated) -> None:
    """Write a corrected program for the Rerun viewer; an existing file is replaced only by a whole one."""
    header = replace(header, scales={"error_magnification": scene.scale})
    times, plot = (scene.rank, np.arange(len(scene.q)) + 1), _plot(scene)
    with recording(path, "compensated", header, _blueprint(scene, plot)) as pen:
        pen.documents({"summary": scene.summary, "tables": scene.tables})
        run = pen.on(*(rr.TimeColumn(n, sequence=k) for n, k in zip(TIMELINES, times, strict=True)))
        run.texts("this_point", scene.point_words)
        _write_arm(run, scene)
        if scene.panel is not None:
            _write_panel(pen, scene.panel)
        _write_asked(pen, scene)
        for off in scene.offs:
            _write_way(pen, scene, off)
            _write_tool(run, scene, off)
            if off.foretold and off.half is not None:
                _write_interval(pen, scene, off, off.half)
        plot.write(pen)
        plot.write_cursor(run, _numbers(scene))


def _write_arm(pen: Pen, scene: Compensated) -> None:
    """The arm at every point; once more bent by the process, magnified; the force."""
    ghost = elastic_frames(scene.cell.plant, scene.q, scene.scale * scene.bent)
    shift = np.linalg.norm(ghost.positions - scene.frames.positions, axis=2).max(axis=0)
    moving = np.flatnonzero(shift > 0.005 * reach(scene.frames)).tolist()
    write_shapes(pen, scene.cell, moving)
    write_places(pen, scene.cell, scene.frames, ghost, moving)
    pen.still("world/load/force", rr.Arrows3D.from_fields(colors=LOAD, radii=0.012))
    tip = scene.places(scene.offs[0])
    pen.arrows("world/load/force", (tip - ARROW * scene.force)[:, None], ARROW * scene.force[:, None])


def _write_panel(pen: Pen, panel: Array) -> None:
    rows, columns, _ = panel.shape
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    corners = np.column_stack([first, first + 1, first + columns])
    others = np.column_stack([first + 1, first + columns + 1, first + columns])
    faces = rr.Mesh3D(
        vertex_positions=panel.reshape(-1, 3),
        triangle_indices=np.vstack([corners, others]),
        albedo_factor=(*NOISE, 90),
    )
    pen.still("world/panel", faces)


def _write_asked(pen: Pen, scene: Compensated) -> None:
    """Dots along paths, crosses at holes: what is put back stays visible on them."""
    for part in scene.parts:
        own, path = scene.asked[part.points], f"world/ways/asked/{snake(part.name)}"
        if part.path:
            pen.still(path, rr.Points3D(own, colors=TASK, radii=2 * THICK))
        else:
            ends = [CROSS * np.array([axis, np.negative(axis)]) for axis in ((0, 1, 0), (0, 0, 1))]
            strips = [place + end for place in own for end in ends]
            pen.still(path, rr.LineStrips3D(strips, colors=TASK, radii=THICK))


def _write_way(pen: Pen, scene: Compensated, off: Off) -> None:
    """Where the tool is: paths as lines, holes as dots."""
    for part in scene.parts:
        own, path = scene.places(off)[part.points], f"world/ways/{snake(off.name)}/{snake(part.name)}"
        if part.path:
            pen.still(
                path,
                rr.LineStrips3D(
                    [np.vstack([own, own[:1]]) if part.closed else own], colors=off.colour, radii=THICK
                ),
            )
        else:
            pen.still(path, rr.Points3D(own, colors=off.colour, radii=3 * THICK))


def _write_interval(pen: Pen, scene: Compensated, off: Off, half: Array) -> None:
    """Where the tool may be, along each axis of the world; nothing where that has no bound."""
    known = np.isfinite(half).all(axis=1)
    spans = scene.scale * half[known][:, None, :] * np.eye(3)
    at = scene.places(off)[known][:, None]
    ends = np.stack([at - spans, at + spans], axis=2).reshape(-1, 2, 3)
    pen.still("world/ways/interval_95", rr.LineStrips3D(list(ends), colors=off.colour, radii=THICK / 4))


def _write_tool(pen: Pen, scene: Compensated, off: Off) -> None:
    """Where the tool is at this point."""
    path = f"world/tool/{snake(off.name)}"
    pen.still(path, rr.Points3D.from_fields(colors=off.colour, radii=0.02))
    pen.points(path, scene.places(off)[:, None])


def _numbers(scene: Compensated) -> Array:
    """Of the points, from 1, (points,)."""
    return np.arange(1.0, len(scene.q) + 1)


def _plot(scene: Compensated) -> Curves:
    """Distances of all that are known, and what is stated of the last."""
    point, last = _numbers(scene), scene.offs[-1]
    values = [(o.name.removeprefix(CORRECTED), o.colour, o.metres) for o in scene.offs if not o.foretold]
    lines = [(name, colour, np.linalg.norm(metres, axis=1)) for name, colour, metres in values]
    if last.half is not None:
        name, colour = (WITHIN, last.colour) if last.foretold else (INTERVAL, NOISE)
        lines.append((name, colour, last.half.max(axis=1)))
    known = [(name, colour, metres, np.isfinite(metres)) for name, colour, metres in lines]
    curves = [
        Curve(name, colour, point[at], alone(np.maximum(MM * metres[at], LEAST_MM)), dots=False)
        for name, colour, metres, at in known
        if at.any()
    ]
    return Curves("off_mm", "Tool off where it was asked (mm) over point", curves, {}, size=PLOT)


def _blueprint(scene: Compensated, plot: Curves) -> rrb.Blueprint:
    """The arm at work, the panel from near by, words and errors beside them."""
    point = text_view("this_point", "This point")
    below = rrb.Horizontal(_whole(scene), plot.view(), column_shares=[5, 7])
    shown = rrb.Vertical(_near(scene), below, row_shares=[5, 5])
    words = rrb.Vertical(text_view("summary", "Summary"), point, row_shares=[4, 1])
    return layout(
        rrb.Horizontal(shown, words, column_shares=[11, 8], name="Overview"),
        text_view("tables", "Tables"),
        timeline=TIMELINES[0],
        places=len(scene.q),
    )


def _whole(scene: Compensated) -> rrb.Spatial3DView:
    panel = np.zeros((0, 3)) if scene.panel is None else scene.panel.reshape(-1, 3)
    points = np.vstack([scene.asked, panel, scene.frames.positions.reshape(-1, 3)])
    eye = frame(points, np.full(len(points), ROOM), scene.asked.mean(axis=0)[:2], BESIDE, ASPECT)
    return rrb.Spatial3DView(
        origin="world",
        name=f"Arm (m), bent x {scene.scale:g}",
        eye_controls=orbit(*eye),
    )


def _near(scene: Compensated) -> rrb.Spatial3DView:
    drawn = np.vstack([scene.asked, scene.places(scene.offs[0])])
    middle, size = (drawn.min(axis=0) + drawn.max(axis=0)) / 2, float(np.linalg.norm(np.ptp(drawn, axis=0)))
    return rrb.Spatial3DView(
        origin="world",
        contents=[f"+ $origin/{part}/**" for part in ("ways", "tool", "panel", "load")],
        name=f"Tool (m): how far it is off, x {scene.scale:g}",
        eye_controls=orbit(middle + max(size, LEAST) * np.array(NEAR), middle),
    )
