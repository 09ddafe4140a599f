"""The tables that a plan leaves, and what is drawn: poses, loads, lines of sight, errors to expect."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbench.arm.folder import Joint
from testbench.arm.mjcf import GRAVITY
from testbench.campaign.campaign import Cell
from testbench.campaign.plan import Planned
from testbench.campaign.workspace_errors import ErrorPlaces
from testbench.design.planning import Plan
from testbench.errors import Array
from testbench.model.vjm import chain, tool_points
from testbench.plant.shapes import rigid_frames
from testbench.report.report import Report
from testbench.report.table import Row
from testbench.views.colours import GREY, LOAD, MEASURED, NOMINAL, TASK, Look
from testbench.views.colours import look as look_of
from testbench.views.scene import (
    Layer,
    Line,
    PlaceMap,
    Poses,
    RunChart,
    Scene,
    Seen,
    evenly,
    of_all,
    picked,
    workspace,
)

OURS, WORK = look_of("ALL153", "psd", prior=True), Look(TASK, 1, prior=True)
ORDER, UNSCALED = "Plan, in the order of measuring", "Nothing is magnified; loads are arrows of one length."
SPECKS, NUMBERED = 600, 20  #: Candidates that are drawn, and planned poses whose number is, at most.
FORCE = 0.2  #: Length of a load's arrow over the reach [1].
NOWHERE = "no bound"


@dataclass(frozen=True)
class World:
    """What stands around the arm in every pose."""

    cell: Cell  #: The arm.
    station: Sequence[float] | None  #: Where the tracker stands [m].
    plan: Array  #: Tools of the plan, in its order, (poses, 3) [m].
    tasks: Array  #: Tools of the tasks, (tasks, 3) [m].
    candidates: Array  #: Tools of the feasible poses, (c, 3) [m].

    def poses(
        self, name: str, named: Mapping[str, str], q: Array, layers: Sequence[Layer], first: int = 0
    ) -> Poses:
        """The arm in poses (poses, n) [rad, m], with what is said of each by its name."""
        every = [*layers, *self._still()]
        frames = rigid_frames(self.cell.room, q)
        return Poses(name, list(named), list(named.values()), frames, None, every, first)

    def measured(self, q: Array, force: Array) -> list[Layer]:
        """Markers, lines of sight and loads (poses, 3) [N] of poses that are measured."""
        markers = tool_points(self.cell.vjm, q, self.cell.vjm.markers)
        found = [Layer("markers", MEASURED, "dots", markers)]
        if self.station is not None:
            tracker = np.broadcast_to(np.array(self.station), markers.shape)
            found.append(Layer("lines of sight", MEASURED, "lines", tracker, markers))
        return [*found, *self.pulled(q, force)]

    def pulled(self, q: Array, force: Array) -> list[Layer]:
        """What hangs or pulls, all arrows of one length."""
        if not force.any():
            return []
        hook = tool_points(self.cell.vjm, q, self.cell.vjm.load[None])
        size = np.linalg.norm(force, axis=1, keepdims=True)
        way = np.divide(force, size, out=np.full(force.shape, np.nan), where=size > 0)
        return [Layer("load", LOAD, "arrows", hook, hook + FORCE * self.cell.vjm.reach * way[:, None])]

    def all_over(self, q: Array, words: Sequence[str], first: int = 0) -> Poses:
        """The arm all over the workspace."""
        tool = Layer("tool", MEASURED, "dots", chain(self.cell.vjm, q).position[:, None])
        return workspace(self.cell, q, words, [tool, *self._still()], first)

    def _still(self) -> list[Layer]:
        numbers = [str(k + 1) for k in range(len(self.plan))] if len(self.plan) <= NUMBERED else []
        some = evenly(np.arange(len(self.candidates)), SPECKS)
        found = [
            Layer("feasible poses", GREY, "specks", self.candidates[None, some], shown=False),
            Layer("way", NOMINAL, "lines", self.plan[None, :-1], self.plan[None, 1:], shown=False),
            Layer("planned, in order", NOMINAL, "dots", self.plan[None], labels=numbers),
        ]
        if len(self.tasks):
            found.append(Layer("tasks", TASK, "dots", self.tasks[None]))
        if self.station is not None:
            found.append(Layer("tracker", MEASURED, "dots", np.array([[self.station]]), labels=["tracker"]))
        return found


def seen(made: Planned, said: Report) -> Seen:
    """The plan's poses, the tasks, the workspace; errors to expect in each."""
    f, cell, tasks = Row(said.numbers), made.cell, said.numbers.get("tasks", [])
    plan, work = (np.array([row.tool_m for row in rows]).reshape(-1, 3) for rows in (f.plan, tasks))
    world = World(cell, f.tracker_m, plan, work, chain(cell.vjm, made.found.q).position)
    force = np.array([row.get("pull_N") or [0, 0, -GRAVITY * row.get("load_kg", 0.0)] for row in f.plan])
    named = {f"Run {row.run}": _said(cell, row, q) for row, q in zip(f.plan, made.plan.q, strict=True)}
    groups = [world.poses(ORDER, named, made.plan.q, world.measured(made.plan.q, force))]
    charts = [_chart(0, f.plan)]
    if isinstance(made.plan, Plan):
        every = made.plan.specification.tasks.q
        some = picked(made.forecast.error, np.arange(len(every)))
        rows, q = [tasks[k] for k in some], every[some]
        named = {f"Task {row.task}": _said(cell, row, own) for row, own in zip(rows, q, strict=True)}
        pulls = world.pulled(q, np.array([row.force_N for row in rows]))
        groups.append(world.poses("Tasks", named, q, pulls, int(made.forecast.error[some].argmax())))
        note = of_all(len(some), len(every), "tasks")
        charts.insert(0, _chart(1, rows, note))
    errors = {name: f.map.errors(name) for name in f.map.compared}
    words = [
        f"Expected error: {', '.join(_error(name, mm[k]) for name, mm in errors.items())}. {joints}."
        for k, joints in enumerate(f.map.joints)
    ]
    groups.append(world.all_over(np.array(f.map.q), words))
    return Seen(
        scene=Scene(cell, UNSCALED, groups),
        map=_map(f.map, len(groups) - 1, "after calibration" if f.absolute else "under the first load"),
        runs=charts,
    )


def _said(cell: Cell, row: Row, q: Sequence[float] | Array) -> str:
    """What acts in a pose, how far it moves the tool, and the error to expect."""
    load = f"Load {row.load}. " if "load" in row else ""
    what = "sag" if "expected_sag_mm" in row else "deflection"
    moved = row[f"expected_{what}_mm"]
    low, high = row.expected_error_p05_mm, row.expected_error_p95_mm
    error = f"{row.expected_error_mm:.3f} mm (90 %: {low:.3f} to {high:.3f})"
    return f"{load}Expected {what} {moved:.2f} mm, error {error}. {cell.arm.words(np.array(q))}."


def _chart(group: int, rows: Sequence[Row], note: str = "") -> RunChart:
    """Errors to expect in the poses of the plan, or at tasks."""
    tasks = "task" in rows[0]
    key, where, look = ("task", "at each task", WORK) if tasks else ("run", "in each planned pose", OURS)
    middle, low, high = (
        np.array([row[f"expected_error{end}_mm"] for row in rows]) for end in ("", "_p05", "_p95")
    )
    title = f"Expected error {where}, 90 % intervals (mm)"
    line = Line("task" if tasks else "this plan", look, middle, (low, high))
    return RunChart(title, group, key, [str(row[key]) for row in rows], [line], note=note)


def _error(name: str, mm: float) -> str:
    return f"{name} {NOWHERE if np.isnan(mm) else f'{mm:.3f} mm'}"


def _map(found: ErrorPlaces, group: int, when: str) -> PlaceMap:
    """Errors to expect over the workspace, a map a model; `group` is that of the places in the scene."""
    *others, last = found.compared
    looks = {**{name: look_of(name, "none") for name in others}, last: OURS}
    lines = [Line(name, own, found.errors(name)) for name, own in looks.items()]
    without = NOWHERE if any(map(found.unbounded, looks)) else ""
    title = f"Expected error over the workspace, {when} (mm)"
    return PlaceMap(title, group, np.array(found.position_m), lines, "Where it will err", without)


def write_poses(f: Row, joints: Sequence[Joint], path: Path) -> None:
    """plan.csv: `plan_columns` or `absolute_columns`; rad and m in full: read back bit by bit."""
    masses, pulls = f.loads_kg, bool(f.pulls_n)
    head = plan_columns(joints, pulls=pulls)
    if f.absolute:
        head = absolute_columns(joints, loaded=len(masses) == 1)
    rows = []
    for row in f.plan:
        force = row.get("pull_N")
        mass = "" if force else repr(row.get("load_kg", masses[0] if masses else 0.0))
        cells = {"run": row.run, "load_kg": mass, "way": row.way}
        cells |= zip((f"force_{axis}_N" for axis in "xyz"), map(repr, force or []), strict=False)
        cells |= {key: f"{row[key]:.2f}" for key in ("travel_deg", "travel_mm")}
        cells |= _cells(row, joints)
        cells |= {joint.column: repr(x) for joint, x in zip(joints, row.q, strict=True)}
        rows.append([cells.get(name, "") for name in head])
    _write_table(head, rows, path)


def write_tasks(f: Row, joints: Sequence[Joint], path: Path) -> None:
    """tasks_expected.csv: of every task its pose and the error to expect."""
    every = [{"task": f"{row.task}", **_cells(row, joints)} for row in f.tasks]
    _write_table(list(every[0]), [list(cells.values()) for cells in every], path)


def _cells(row: Row, joints: Sequence[Joint]) -> dict[str, str]:
    """Joints in deg or mm, and what is expected of a pose."""
    shown = {joint.shown_column: f"{x:.4f}" for joint, x in zip(joints, row.q_shown, strict=True)}
    return shown | {key: f"{x:.4f}" for key, x in row.items() if key.startswith("expected_")}


def _write_table(head: Sequence[str], rows: Sequence[Sequence[object]], path: Path) -> None:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([head, *rows])
    path.write_text(text.getvalue(), encoding="utf-8")


def plan_columns(joints: Sequence[Joint], *, pulls: bool = False) -> list[str]:
    """The header of a plan, in order; a row is a run, in the order of measuring.

    run: integer. JOINT_rad, JOINT_deg: joint angle, twice; of a slide JOINT_m, JOINT_mm. load_kg: hung mass.
    force_*_N, of a plan that may pull: force at the load point, world axes; a run has either, the other is
    blank.
    expected_deflection_mm: RMS over the markers, by the prior. expected_error_*_mm: of predicting it after
    identification, with the 5th and 95th percentile. travel_deg: of the hinge that turns farthest from the
    run before; travel_mm: of the slide, where the arm has one. way: "start", "clear" where all joints can go
    straight, "via" where that way collides.
    """
    names = ["run", *(j.column for j in joints), *(j.shown_column for j in joints), "load_kg"]
    names += [f"force_{axis}_N" for axis in "xyz" if pulls]
    names += [f"expected_{what}_mm" for what in ("deflection", "error", "error_p05", "error_p95")]
    return [*names, "travel_deg", *["travel_mm"] * any(j.prismatic for j in joints), "way"]


def absolute_columns(joints: Sequence[Joint], *, loaded: bool) -> list[str]:
    """The header of a plan of absolute readings, in order.

    As `plan_columns`, but for load_kg, where one mass hangs after the first reading of every pose;
    expected_sag_mm: RMS over the targets, by the prior, under all that hangs; expected_error_*_mm: of their
    positions after calibration.
    """
    names = plan_columns(joints)
    return [
        "expected_sag_mm" if name == "expected_deflection_mm" else name
        for name in names
        if name != "load_kg" or loaded
    ]
