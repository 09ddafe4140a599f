"""The recording of planted faults: the arm in a run of each, targets as handed in and as they should be."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.bench.campaign import Cell
from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.plant.shapes import Frames, rigid_frames
from testbench.views.recording.arm import orbit, origins, reach, write_places, write_shapes
from testbench.views.recording.camera import frame
from testbench.views.recording.data import write_load, write_markers, write_spokes
from testbench.views.recording.pen import text_view
from testbench.views.recording.stream import Header, layout, recording

TIMELINE = "fault"
FARTHEST = 0.5  #: Distance over the arm's reach at which what lies farther off is drawn [1].
ARROW = 0.25  #: Largest length of a drawn deflection over the reach [1].
HOW = """**Colours** Sky blue: where the arm of the folder has its targets, and lines to them from the tool.
Vermillion: where they were handed in, unloaded; arrows: how far they moved. Purple: load. Grey: the arm.
What lies farther off than half the arm's reach is drawn there.

**Scrub** the time bar below: `fault` counts what was planted. First stand faults that the first doubt
does not name, last the sound data set."""


@dataclass(frozen=True)
class Planted:
    """A run of every data set of a trial."""

    cell: Cell
    data: Dataset  #: Runs as handed in, one a data set.
    nominal: Array  #: Where the arm without sag has the targets, (runs, m, 3) [m].
    scale: float  #: Magnification of deflections [1].
    texts: list[str]  #: What was planted and what was said, Markdown, one a run.


def write_planted(path: Path, header: Header, shown: Planted, summary: str) -> None:
    """Write planted faults for the Rerun viewer; an existing file is replaced only by a whole one.

    Args:
        path: The .rrd file.
        header: What identifies it.
        shown: What to draw.
        summary: Question, answer and tables in Markdown; how to read the scene is added.
    """
    cell, frames = shown.cell, rigid_frames(shown.cell.room, shown.data.q)
    tool, size = origins(cell, [cell.arm.tool], frames), reach(frames)
    data = near(shown.data, tool[:, 0], size, shown.scale)
    with recording(path, "planted", header, _blueprint(shown, frames)) as pen:
        pen.documents({"summary": f"{summary}\n\n{HOW}", "every_fault": "\n\n".join(shown.texts)})
        step = pen.on(rr.TimeColumn(TIMELINE, sequence=data.run))
        step.texts("this_fault", shown.texts)
        write_shapes(step, cell, ())
        write_places(step, cell, frames)
        write_markers(step, data, shown.nominal, shown.scale, size)
        write_spokes(step, tool[:, 0], shown.nominal)
        write_load(step, cell, data, frames)


def near(data: Dataset, tool: Array, size: float, scale: float) -> Dataset:
    """Readings and load points that are drawn within sight of the tool, (runs, 3) [m]."""
    before = tool[:, None] + _shortened(data.before - tool[:, None], FARTHEST * size)
    after = before + _shortened(data.deflection, ARROW * size / scale)
    return replace(data, before=before, after=after, point=_shortened(data.point, FARTHEST * size))


def _shortened(vectors: Array, most: float) -> Array:
    """Vectors, those that are longer cut to a length."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors * np.minimum(1.0, most / np.maximum(length, most)))


def _blueprint(shown: Planted, frames: Frames) -> rrb.Blueprint:
    """The arm, and what was planted and said beside it."""
    size = reach(frames)
    points = frames.positions[:, 1:].reshape(-1, 3)
    tool = origins(shown.cell, [shown.cell.arm.tool], frames)[0, 0, :2]
    eye = orbit(*frame(points, np.full(len(points), 0.2 * size), tool, aspect=1.3))
    view = rrb.Spatial3DView(
        origin="world",
        name=f"Arm (m): deflection x {shown.scale:g}, handed in with a fault",
        eye_controls=eye,
    )
    seen = rrb.Vertical(view, text_view("this_fault", "This fault"), row_shares=[4, 1])
    overview = rrb.Horizontal(seen, text_view("summary", "Summary"), column_shares=[11, 11], name="Overview")
    return layout(
        overview, text_view("every_fault", "Every fault"), timeline=TIMELINE, places=shown.data.runs
    )
