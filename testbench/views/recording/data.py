"""The recording of measured runs: the arm run by run, its targets as read and as they should be."""

import json
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.bench.campaign import Cell
from testbench.bench.rows import MM
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify.registered import Registered
from testbench.plant.shapes import Frames, body_names, rigid_frames
from testbench.views.data.nominal import magnification, nominal_markers, stations
from testbench.views.data.words import CheckedRuns, words
from testbench.views.recording.arm import ARROW, orbit, origins, reach, write_places, write_shapes
from testbench.views.recording.camera import frame
from testbench.views.recording.pen import Pen, text_view
from testbench.views.recording.scene import MARKERS
from testbench.views.recording.stream import Header, layout, recording
from testbench.views.recording.style import LOAD, MEASURED, NOMINAL

TIMELINE = "run"


def write_data(path: Path, cell: Cell, runs: CheckedRuns) -> None:
    """Write measured runs for the Rerun viewer; an existing file is replaced only by a whole one."""
    registered, data = runs.registered, runs.registered.data
    nominal, frames = nominal_markers(cell, data), rigid_frames(cell.room, data.q)
    scale = magnification(data, nominal)
    header = Header("testbench data check", json.dumps({"data": runs.name, "arm": cell.arm.name}), 0)
    text = words(runs, scale)
    with recording(path, "data", header, _blueprint(cell, frames, registered, scale)) as pen:
        pen.documents({"summary": text.block("summary"), "columns": text.block("columns")})
        run = pen.on(rr.TimeColumn(TIMELINE, sequence=np.arange(data.runs) + 1))
        run.texts("this_run", [text.block("run", run=row) for row in _run_rows(data)])
        write_shapes(run, cell, ())
        write_places(run, cell, frames)
        write_markers(run, data, nominal, scale, reach(frames))
        tool = origins(cell, [cell.arm.tool], frames)[:, 0]
        write_spokes(run, tool, nominal)
        write_load(run, cell, data, frames)
        pen.still("world/tracker", *_tracker(registered))


def write_markers(pen: Pen, data: Dataset, nominal: Array, scale: float, size: float) -> None:
    """Where targets should be, where they were read unloaded, how far they moved; lost ones are hidden."""
    looks = {"nominal": (NOMINAL, 0.007, nominal), "unloaded": (MEASURED, 0.01, data.before)}
    for name, (colour, radius, places) in looks.items():
        pen.still(f"{MARKERS}/{name}", rr.Points3D.from_fields(colors=colour, radii=radius * size))
        columns = rr.Points3D.columns(positions=places[data.seen])
        pen.rows(f"{MARKERS}/{name}", columns.partition(data.seen.sum(axis=1)))
    pen.still(f"{MARKERS}/deflection", rr.Arrows3D.from_fields(colors=MEASURED, radii=0.006 * size))
    arrows = rr.Arrows3D.columns(origins=data.before[data.seen], vectors=scale * data.deflection[data.seen])
    pen.rows(f"{MARKERS}/deflection", arrows.partition(data.seen.sum(axis=1)))


def write_spokes(pen: Pen, tool: Array, nominal: Array) -> None:
    """Lines from the tool, (runs, 3) [m], to where its targets should be, (runs, m, 3) [m]."""
    pen.still(f"{MARKERS}/spokes", rr.LineStrips3D.from_fields(colors=NOMINAL, radii=-1.5))
    strips = np.stack([np.broadcast_to(tool[:, None], nominal.shape), nominal], axis=2).reshape(-1, 2, 3)
    columns = rr.LineStrips3D.columns(strips=strips)
    pen.rows(f"{MARKERS}/spokes", columns.partition([nominal.shape[1]] * len(nominal)))


def write_load(pen: Pen, cell: Cell, data: Dataset, frames: Frames) -> None:
    """The force of every run, where it acts."""
    tool = body_names(cell.room).index(cell.arm.tool)
    hook = frames.positions[:, tool] + np.einsum("rxy,ry->rx", frames.rotations[:, tool], data.point)
    force = data.wrench[:, :3]
    size, length = np.linalg.norm(force, axis=1, keepdims=True), ARROW * reach(frames)
    unit = np.divide(force, size, out=np.zeros_like(force), where=size > 0)
    pen.still("world/load/force", rr.Arrows3D.from_fields(colors=LOAD, radii=0.01 * reach(frames)))
    pen.arrows("world/load/force", hook[:, None], length * unit[:, None])
    pen.label("world/load/label", hook + 1.1 * length * unit, [f"{n:.4g} N" for n in size[:, 0]], LOAD)


def _tracker(registered: Registered) -> list[rr.Points3D]:
    """A ball where the tracker stood."""
    at = stations(registered)
    names = [f"tracker {k + 1}" for k in range(len(at))]
    return [rr.Points3D(at, labels=names, colors=MEASURED, radii=0.12, show_labels=True)]


def _run_rows(data: Dataset) -> list[dict[str, object]]:
    """What is said of every run."""
    size = MM * np.linalg.norm(data.deflection, axis=-1)
    return [
        {
            "run": int(data.run[k]),
            "pose": int(data.pose[k]),
            "force": float(np.linalg.norm(data.wrench[k, :3])),
            "markers": [
                (name, float(size[k, i]) if data.seen[k, i] else None) for i, name in enumerate(data.markers)
            ],
        }
        for k in range(data.runs)
    ]


def _blueprint(cell: Cell, frames: Frames, registered: Registered, scale: float) -> rrb.Blueprint:
    """The arm, and what was understood beside it."""
    points = np.vstack([frames.positions.reshape(-1, 3), stations(registered)])
    tool = origins(cell, [cell.arm.tool], frames)[0, 0, :2]
    eye = orbit(*frame(points, np.full(len(points), 0.1 * reach(frames)), tool, aspect=1.5))
    view = rrb.Spatial3DView(origin="world", name=f"Arm (m): deflection x {scale:g}", eye_controls=eye)
    shown = rrb.Vertical(view, text_view("this_run", "This run"), row_shares=[9, 2])
    words = text_view("summary", "What was understood")
    return layout(
        rrb.Horizontal(shown, words, column_shares=[12, 9], name="Overview"),
        text_view("columns", "Columns"),
        timeline=TIMELINE,
        places=registered.data.runs,
    )
