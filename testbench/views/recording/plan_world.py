"""A measurement plan in space: the arm pose by pose, tracker and lines of sight, tasks and error map."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as attribute

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.components import FillMode

from testbench.bench.campaign import Cell
from testbench.data.dataset import Ids
from testbench.errors import Array
from testbench.plant.shapes import Frames, body_names
from testbench.views.recording.arm import ARROW, Places, Weight, write_places, write_shapes, write_weight
from testbench.views.recording.error_map import ErrorMap, write_error_map
from testbench.views.recording.scene import frame, write_points
from testbench.views.recording.style import LOAD, MEASURED, NOISE, NOMINAL, TASK
from testbench.views.recording.sweep import Sweep

MOST_CANDIDATES = 2000
"""Candidates drawn at most, evenly picked."""
HEAD = 0.12
"""Radius of the tracker's head [m]; its feet stand three times as far from its axis."""
BESIDE = (0.45, 0.9, 0.4)
"""Where the eye is: beyond the arm on the way to the tracker, beside, above [1]."""
NARROW, WIDE = 0.9, 1.4
"""Width over height of the panes of the plan and of the error map [1]."""


@dataclass(frozen=True)
class PlanScene:
    """A measurement plan and its words, made ready for drawing."""

    cell: Cell  #: The arm.
    scenario: str  #: Name of the scenario.
    parameters: object  #: It as plain data.
    seed: int  #: Root of randomness.
    #: Where the tracker's beam leaves, (3,) [m]; None for no tracker.
    station: tuple[float, float, float] | None
    loads_kg: tuple[float, ...]  #: Weights that may be hung [kg].
    load: Ids  #: Index into loads_kg of every pose, (poses,).
    candidates: Array  #: Tool positions of the feasible poses, (c, 3) [m].
    q: Array  #: Joint angles in the order of measuring, (poses, n) [rad].
    pose_words: Sequence[str]  #: Markdown of every pose: angles, what to expect.
    deflection_mm: Array  #: Expected deflection, (poses,) [mm].
    error_mm: Array  #: Expected error of its prediction, (poses,) [mm].
    tasks: Array  #: Tool positions where the robot works, at least one, (t, 3) [m].
    task_error_mm: Array  #: Expected error in each, (t,) [mm].
    field: Array  #: Tool positions all over the workspace, at least one, (p, 3) [m].
    field_error_mm: Array  #: Expected error at each, (p,) [mm].
    field_words: str  #: What the errors are, with unit, such as "expected error after identification (mm)".
    summary: str  #: Markdown: question, bold answer, table. Colours and how to scrub are appended.
    tables: Mapping[str, str] = attribute(default_factory=dict)  #: Further tables in markdown, by heading.
    sweep: Sweep | None = None  #: Accuracy against the number of poses.

    @property
    def poses(self) -> int:
        """How many poses are measured."""
        return len(self.q)

    @property
    def error_map(self) -> ErrorMap:
        """Errors over the workspace and in the tasks."""
        return ErrorMap(self.field_words, self.field, self.field_error_mm, self.tasks, self.task_error_mm)

    def drawn_candidates(self) -> Array:
        """The candidates, or MOST_CANDIDATES of them, (k, 3) [m]."""
        count = len(self.candidates)
        picked = np.linspace(0, count - 1, min(count, MOST_CANDIDATES)).round().astype(int)
        return np.asarray(self.candidates[picked])

    def bodies(self, names: Sequence[str], frames: Frames) -> Array:
        """Origins of named bodies, (poses, len(names), 3) [m]."""
        known = body_names(self.cell.room)
        return frames.positions[:, [known.index(name) for name in names]]


def write_world(stream: rr.RecordingStream, scene: PlanScene, frames: Frames, time: rr.TimeColumn) -> None:
    """Everything under `world`."""
    size = _reach(frames)
    write_shapes(stream, scene.cell, ())
    write_places(stream, scene.cell, Places([time], frames))
    _write_load(stream, scene, frames, time)
    markers = scene.bodies(scene.cell.arm.markers, frames)
    look = rr.Points3D.from_fields(colors=NOMINAL, radii=0.012 * size)
    stream.log("world/markers/nominal", look, static=True)
    write_points(stream, "nominal", [time], markers)
    if scene.station is not None:
        _write_tracker(stream, np.array(scene.station))
        _write_sight(stream, np.array(scene.station), markers, time)
    _write_places(stream, scene, frames)
    write_error_map(stream, "world/error_map", scene.error_map, 0.03 * size)


def _reach(frames: Frames) -> float:
    """Largest distance of a body from the foot of the arm, the scale of symbols [m]."""
    return float(np.linalg.norm(frames.positions - frames.positions[:, :1], axis=-1).max())


def _write_load(stream: rr.RecordingStream, scene: PlanScene, frames: Frames, time: rr.TimeColumn) -> None:
    """What hangs in every pose."""
    size = _reach(frames)
    hook = scene.bodies([scene.cell.arm.load], frames)[:, 0]
    look = rr.Arrows3D.from_fields(colors=LOAD, radii=0.01 * size)
    stream.log("world/load/force", look, static=True)
    down = np.tile([0, 0, -ARROW * size], (scene.poses, 1))
    stream.send_columns("world/load/force", [time], rr.Arrows3D.columns(origins=hook, vectors=down))
    payload = np.array(scene.loads_kg, dtype=float)[scene.load]
    write_weight(stream, [time], Weight(hook, payload, np.ones(scene.poses)), size)


def _write_tracker(stream: rr.RecordingStream, station: Array) -> None:
    """A head on three legs."""
    head = rr.Ellipsoids3D(
        centers=[station], half_sizes=[[HEAD] * 3], colors=MEASURED, fill_mode=FillMode.Solid
    )
    stream.log("world/tracker/head", head, static=True)
    legs = rr.LineStrips3D([[station, foot] for foot in _feet(station)], colors=MEASURED, radii=0.18 * HEAD)
    stream.log("world/tracker/stand", legs, static=True)
    above = station + np.array([0, 0, 4 * HEAD])
    label = rr.Points3D([above], labels=["tracker"], colors=MEASURED, radii=0.0, show_labels=True)
    stream.log("world/tracker/label", label, static=True)


def _feet(station: Array) -> Array:
    """Where the tracker's legs stand, (3, 3) [m]."""
    angle = 2 * np.pi * np.arange(3) / 3
    away = 3 * HEAD * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.column_stack([station[:2] + away, np.zeros(3)])


def _write_sight(stream: rr.RecordingStream, station: Array, markers: Array, time: rr.TimeColumn) -> None:
    """A line from the tracker to every marker: markers (poses, m, 3) [m]."""
    poses, count, _ = markers.shape
    look = rr.LineStrips3D.from_fields(colors=MEASURED, radii=-0.6)
    stream.log("world/sight", look, static=True)
    lines = np.stack([np.broadcast_to(station, markers.shape), markers], axis=2).reshape(-1, 2, 3)
    columns = rr.LineStrips3D.columns(strips=lines).partition([count] * poses)
    stream.send_columns("world/sight", [time], columns)


def _write_places(stream: rr.RecordingStream, scene: PlanScene, frames: Frames) -> None:
    """Tool positions: candidates, the plan with its numbers and its path, tasks."""
    size = _reach(frames)
    faint = rr.Points3D(scene.drawn_candidates(), colors=NOISE, radii=-1.1)
    stream.log("world/candidates", faint, static=True)
    tools = scene.bodies([scene.cell.arm.tool], frames)[:, 0]
    numbers = [str(k + 1) for k in range(scene.poses)]
    points = rr.Points3D(tools, labels=numbers, colors=NOMINAL, radii=0.014 * size, show_labels=True)
    stream.log("world/plan/positions", points, static=True)
    path = rr.LineStrips3D([tools], colors=NOMINAL, radii=-0.7)
    stream.log("world/plan/path", path, static=True)
    cubes = rr.Boxes3D(
        centers=scene.tasks,
        half_sizes=np.full((len(scene.tasks), 3), 0.012 * size),
        colors=TASK,
        fill_mode=FillMode.Solid,
    )
    stream.log("world/tasks", cubes, static=True)


def plan_view(scene: PlanScene, frames: Frames) -> rrb.Spatial3DView:
    """Arm, tracker, candidates and plan, without the error map."""
    return rrb.Spatial3DView(
        origin="world",
        contents=["+ $origin/**", "- $origin/error_map/**"],
        name="Plan (m): tool positions in the order of measuring",
        eye_controls=_eye(scene, frames, np.empty((0, 3)), NARROW),
    )


def map_view(scene: PlanScene, frames: Frames) -> rrb.Spatial3DView:
    """The error map, and what helps to find one's way in it."""
    names = ("arm", "error_map", "tracker", "plan/positions")
    return rrb.Spatial3DView(
        origin="world",
        contents=[f"+ $origin/{name}/**" for name in names],
        name=f"Error map: {scene.field_words}; positions in m",
        eye_controls=_eye(scene, frames, scene.field, WIDE),
    )


def _eye(scene: PlanScene, frames: Frames, further: Array, aspect: float) -> rrb.EyeControls3D:
    """From beside the line from arm to tracker: poses, tasks and further points (k, 3) [m] in view."""
    tools = scene.bodies([scene.cell.arm.tool], frames)[:, 0]
    toward = tools.mean(axis=0) if scene.station is None else np.array(scene.station)
    feet = tools if scene.station is None else _feet(toward)
    points = np.vstack([frames.positions.reshape(-1, 3), scene.tasks, further, toward, feet])
    eye, target = frame(points, np.full(len(points), 2 * HEAD), toward[:2], BESIDE, aspect)
    return rrb.EyeControls3D(kind=rrb.Eye3DKind.Orbital, position=eye, look_target=target, eye_up=(0, 0, 1))
