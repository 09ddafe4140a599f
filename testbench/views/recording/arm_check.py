"""The recording of an arm's folder: two poses with beams, tubes, joints, markers, load and base."""

import json
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.bench.checked import Checked
from testbench.errors import Array
from testbench.plant.corners import RING
from testbench.plant.shapes import Frames, rigid_frames
from testbench.views.checked.words import words
from testbench.views.recording.arm import ARROW, orbit, origins, write_places, write_shapes, write_weight
from testbench.views.recording.camera import frame
from testbench.views.recording.pen import Pen, text_view
from testbench.views.recording.scene import MARKERS
from testbench.views.recording.stream import Header, layout, recording
from testbench.views.recording.style import LOAD, NOISE, NOMINAL

TIMELINE = "pose"
SPOKES = 4  #: Lines along a tube.
AXIS = 0.2  #: Length of the axes of the base over the reach [1].
THIN, THICK = 0.8, 2.5  #: Widths of a tube's lines, thick where it is doubted [ui points].
CLOSE = 0.2  #: Distance of joints over the reach below which their names would overlap [1].
ABOVE, STEP, STEPS = 0.1, 0.065, 3
"""Height of a name above its joint, and between names of close joints, over the reach [1]; how many."""
GLASS = (*NOISE, 60)  #: The arm as drawn, so that the beams inside are seen.
BESIDE = (0.4, 1.0, 0.25)  #: Where the eye is: ahead along the reach of the arm, beside it, above [1].


def write_arm(path: Path, checked: Checked) -> None:
    """Write an arm for the Rerun viewer; an existing file is replaced only by a whole one."""
    header = Header("testbench check", json.dumps({"arm": checked.cell.arm.name}), 0)
    frames = rigid_frames(checked.cell.room, checked.poses)
    with recording(path, "arm", header, _blueprint(checked, frames)) as pen:
        pen = pen.on(rr.TimeColumn(TIMELINE, sequence=np.array([1, 2])))
        pen.documents({"summary": words(checked).block("summary")})
        write_shapes(pen, checked.cell, (), GLASS)
        write_places(pen, checked.cell, frames)
        _write_beams(pen, checked)
        _write_tool(pen, checked, frames)
        _write_base(pen, checked)


def _write_beams(pen: Pen, checked: Checked) -> None:
    """Tubes as lines at their true diameter, their axes as arrows, joints with their names."""
    beams, sizes, size = checked.beams, checked.sizes, checked.reach
    for k, (link, (length, diameter)) in enumerate(zip(checked.cell.arm.links, sizes, strict=True)):
        own = beams[:, k]
        width = THICK if checked.doubted(link.name) else THIN
        place = rr.new_entity_path(["world", "tubes", link.name])
        pen.still(place, rr.LineStrips3D.from_fields(colors=NOMINAL, radii=-width))
        strips = [line for pose in own for line in _tube(pose, length, diameter)]
        pen.rows(place, rr.LineStrips3D.columns(strips=strips).partition([2 + SPOKES] * len(own)))
    pen.still("world/beam_axes", rr.Arrows3D.from_fields(colors=NOMINAL, radii=0.005 * size))
    pen.arrows("world/beam_axes", beams[..., :3, 3], sizes[:, :1] * beams[..., :3, 0])
    if checked.cell.arm.joints:
        _write_joints(pen, checked)


def _write_joints(pen: Pen, checked: Checked) -> None:
    """A ball a joint, its name above it; names of joints close to one another at several heights."""
    joints, size = checked.cell.arm.joints, checked.reach
    at = checked.beams[:, 1:, :3, 3]
    pen.still("world/joints", rr.Points3D.from_fields(colors=NOISE, radii=0.008 * size))
    pen.points("world/joints", at)
    ends = at + size * np.outer(_heights(at[0], CLOSE * size), [0, 0, 1])
    pen.still("world/joint_names/lines", rr.LineStrips3D.from_fields(colors=NOISE, radii=-0.5))
    strips = [*np.stack([at, ends], axis=2).reshape(-1, 2, 3)]
    lines = rr.LineStrips3D.columns(strips=strips)
    pen.rows("world/joint_names/lines", lines.partition([len(joints)] * len(at)))
    names = [j.name + " ?" * checked.doubted(j.name) for j in joints]
    pen.still("world/joint_names", rr.Points3D.from_fields(colors=NOISE, radii=0.0, show_labels=True))
    columns = rr.Points3D.columns(positions=ends.reshape(-1, 3), labels=names * len(at))
    pen.rows("world/joint_names", columns.partition([len(joints)] * len(at)))


def _heights(at: Array, close: float) -> Array:
    """How far above its joint a name stands over the reach, (n,) [1]; joints at (n, 3) [m]."""
    near = np.linalg.norm(np.diff(at, axis=0), axis=1) < close
    steps = np.zeros(len(at), dtype=int)
    for k, follows in enumerate(near, start=1):
        steps[k] = steps[k - 1] + 1 if follows else 0
    return ABOVE + STEP * (steps % STEPS)


def _tube(pose: Array, length: float, diameter: float) -> list[Array]:
    """Two rings and the lines between them."""
    ring = diameter / 2 * np.vstack([RING, RING[:1]]) @ pose[:3, [1, 2, 0]].T + pose[:3, 3]
    far = ring + length * pose[:3, 0]
    spokes = np.stack([ring, far], axis=1)[: len(RING) : len(RING) // SPOKES]
    return [ring, far, *spokes]


def _write_tool(pen: Pen, checked: Checked, frames: Frames) -> None:
    """Markers with their names, the load's arrow and the weight."""
    arm, size, cell = checked.cell.arm, checked.reach, checked.cell
    markers, hook = origins(cell, arm.markers, frames), origins(cell, [arm.load], frames)
    look = rr.Points3D.from_fields(colors=NOMINAL, radii=0.014 * size, show_labels=True)
    pen.still(f"{MARKERS}/nominal", look)
    columns = rr.Points3D.columns(positions=markers.reshape(-1, 3), labels=list(arm.markers) * len(markers))
    pen.rows(f"{MARKERS}/nominal", columns.partition([len(arm.markers)] * len(markers)))
    pen.still("world/load/force", rr.Arrows3D.from_fields(colors=LOAD, radii=0.01 * size))
    pen.arrows("world/load/force", hook, np.broadcast_to([0, 0, -ARROW * size], hook.shape))
    if arm.payload is not None:
        write_weight(pen, hook[:, 0], np.full(len(hook), arm.payload), size)


def _write_base(pen: Pen, checked: Checked) -> None:
    """The axes of the base."""
    base, length = checked.cell.vjm.base, AXIS * checked.reach
    axes = rr.Arrows3D(
        origins=np.tile(base[:3, 3], (3, 1)),
        vectors=length * base[:3, :3].T,
        labels=["x", "y", "z"],
        colors=NOISE,
        radii=0.006 * checked.reach,
        show_labels=True,
    )
    pen.still("world/base", axes)


def _blueprint(checked: Checked, frames: Frames) -> rrb.Blueprint:
    """The arm, and what must be confirmed beside it."""
    hooks = origins(checked.cell, [checked.cell.arm.load], frames)[:, 0] - [0, 0, 0.35 * checked.reach]
    points = np.vstack([frames.positions[:, 1:].reshape(-1, 3), hooks])
    tool = origins(checked.cell, [checked.cell.arm.tool], frames)[0, 0, :2]
    eye = orbit(*frame(points, np.full(len(points), 0.1 * checked.reach), tool, BESIDE, 1.3))
    view = rrb.Spatial3DView(
        origin="world", name="Arm (m): tubes at their true diameter, beam axes as arrows", eye_controls=eye
    )
    words = text_view("summary", "What to confirm")
    return layout(
        rrb.Horizontal(view, words, column_shares=[13, 8], name="Arm"),
        timeline=TIMELINE,
        places=len(checked.poses),
    )
