"""A measurement plan in space: the arm pose by pose, tracker and lines of sight, tasks and error map."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbench.bench.campaign import Cell
from testbench.bench.plan_settings import pull_words
from testbench.data.dataset import Mask
from testbench.errors import Array
from testbench.plant.shapes import Frames, rigid_frames
from testbench.views.recording.arm import (
    ARROW,
    LABEL,
    orbit,
    origins,
    reach,
    write_hung,
    write_places,
    write_shapes,
    write_weight,
)
from testbench.views.recording.camera import frame
from testbench.views.recording.error_map import write_cubes
from testbench.views.recording.error_maps import PlaceScene, error_maps_tab, map_eye, write_here
from testbench.views.recording.pen import Pen
from testbench.views.recording.scene import MARKERS
from testbench.views.recording.style import LOAD, NOISE, NOMINAL, TASK
from testbench.views.recording.swept import Sweep
from testbench.views.recording.tracker import HEAD, feet, write_sights, write_tracker

MANY = 20  #: Poses beyond which they are neither numbered nor joined: numbers would cover each other.
MOST_CANDIDATES = 2000  #: Candidates drawn at most, evenly picked.
BESIDE = (0.45, 0.9, 0.4)  #: Where the eye is: beyond the arm on the way to the tracker, beside, above [1].
LONGER = 2.0  #: Arrow of a pull over that of a weight, which has its cube too [1].
ASPECT = 1.6  #: Width over height of the pane of the plan [1].


@dataclass(frozen=True)
class PlanScene:
    """A measurement plan and its words, made ready for drawing."""

    cell: Cell  #: The arm.
    station: tuple[float, float, float] | None  #: Where the tracker's beam leaves [m]; None for no tracker.
    payload: Array  #: Mass that hangs in every pose, (poses,) [kg]; zero in all for own weight alone.
    candidates: Array  #: Tool positions of the feasible poses, (c, 3) [m].
    q: Array  #: Joint angles in the order of measuring, (poses, n) [rad, m].
    pose_words: Sequence[str]  #: Markdown of every pose: angles, what to expect.
    deflection_mm: Array  #: Expected deflection, (poses,) [mm].
    error_mm: Array  #: Expected error of its prediction, (poses,) [mm].
    map: PlaceScene  #: Errors over the workspace, and in the tasks.
    summary: str  #: Markdown: question, bold answer, table. Colours and how to scrub are appended.
    #: Force that pulls in place of a weight, (poses, 3) [N], zero where one hangs; None where none ever does.
    pull: Array | None = None
    tables: str = ""  #: Further tables in Markdown.
    sweep: Sweep | None = None  #: Accuracy against the number of poses.
    sweep_words: str = ""  #: The same in Markdown.

    @property
    def tasks(self) -> Array:
        """Tool positions where the robot works, (t, 3) [m]; none where no tasks are named."""
        every = [places for places, _ in self.map.tasks.values()]
        return every[0] if every else np.empty((0, 3))

    @property
    def poses(self) -> int:
        """How many poses are measured."""
        return len(self.q)

    def drawn_candidates(self) -> Array:
        """The candidates, or MOST_CANDIDATES of them, (k, 3) [m]."""
        count = len(self.candidates)
        picked = np.linspace(0, count - 1, min(count, MOST_CANDIDATES)).round().astype(int)
        return np.asarray(self.candidates[picked])

    @functools.cached_property
    def frames(self) -> Frames:
        """The arm in every pose."""
        return rigid_frames(self.cell.room, self.q)

    def bodies(self, *names: str) -> Array:
        """Origins of named bodies, (poses, len(names), 3) [m]."""
        return origins(self.cell, names, self.frames)


def write_world(pen: Pen, scene: PlanScene) -> None:
    """Everything under `world`, on the order of measuring."""
    size = reach(scene.frames)
    write_shapes(pen, scene.cell, ())
    write_places(pen, scene.cell, scene.frames)
    if scene.payload.any() or scene.pull is not None:
        _write_load(pen, scene, size)
    markers = scene.bodies(*scene.cell.arm.markers)
    pen.still(f"{MARKERS}/nominal", rr.Points3D.from_fields(colors=NOMINAL, radii=0.012 * size))
    pen.points(f"{MARKERS}/nominal", markers)
    if scene.station is not None:
        write_tracker(pen, np.array(scene.station))
        write_sights(pen, np.array(scene.station), markers)
    _write_places(pen, scene, size)
    write_here(pen, scene.bodies(scene.cell.arm.tool)[:, 0], size)


def _write_load(pen: Pen, scene: PlanScene, size: float) -> None:
    """What hangs or pulls in every pose."""
    hook = scene.bodies(scene.cell.arm.load)[:, 0]
    if scene.pull is None:
        write_weight(pen, hook, scene.payload, size)
        return
    pulled: Mask = np.asarray(scene.pull.any(axis=1))
    length = np.linalg.norm(scene.pull, axis=1, keepdims=True)
    along = np.divide(LONGER * ARROW * size * scene.pull, length, out=np.zeros_like(hook), where=length > 0)
    pen.still("world/load/force", rr.Arrows3D.from_fields(colors=LOAD, radii=0.01 * size))
    pen.arrows("world/load/force", hook[:, None], along[:, None])
    loads = zip(scene.payload, scene.pull, pulled, strict=True)
    texts = [pull_words(force) if pulls else f"{kg:.4g} kg" for kg, force, pulls in loads]
    below = write_hung(pen, hook, scene.payload, np.where(pulled, 0.0, ARROW * size), size)
    pen.label(LABEL, below, texts, LOAD)


def _write_places(pen: Pen, scene: PlanScene, size: float) -> None:
    """Tool positions: candidates, the plan with its numbers and its path, tasks."""
    pen.still("world/candidates", rr.Points3D(scene.drawn_candidates(), colors=NOISE, radii=-1.1))
    tools = scene.bodies(scene.cell.arm.tool)[:, 0]
    few = scene.poses <= MANY
    numbers = [str(k + 1) for k in range(scene.poses)]
    points = rr.Points3D(tools, labels=numbers, colors=NOMINAL, radii=0.014 * size, show_labels=few)
    pen.still("world/plan/positions", points)
    if few:
        pen.still("world/plan/path", rr.LineStrips3D([tools], colors=NOMINAL, radii=-0.7))
    tasks = scene.tasks
    if len(tasks):
        write_cubes(pen, "world/tasks", tasks, np.full(len(tasks), 0.012 * size), TASK)


def plan_view(scene: PlanScene) -> rrb.Spatial3DView:
    """Arm, tracker, candidates and plan, without the error map."""
    return rrb.Spatial3DView(
        origin="world",
        contents=["+ $origin/**", "- $origin/error_map/**"],
        name="Plan (m): tool positions in the order of measuring",
        eye_controls=_eye(scene),
    )


def map_tab(scene: PlanScene) -> rrb.Container:
    """The error maps."""
    found = scene.map.found
    return error_maps_tab(found, map_eye(found, scene.cell, scene.tasks), scene.map.tasks)


def _eye(scene: PlanScene) -> rrb.EyeControls3D:
    """From beside the line from arm to tracker, poses and tasks in view."""
    tools = scene.bodies(scene.cell.arm.tool)[:, 0]
    toward = tools.mean(axis=0) if scene.station is None else np.array(scene.station)
    legs = tools if scene.station is None else feet(toward)
    points = np.vstack([scene.frames.positions.reshape(-1, 3), scene.tasks, toward, legs])
    return orbit(*frame(points, np.full(len(points), 2 * HEAD), toward[:2], BESIDE, ASPECT))
