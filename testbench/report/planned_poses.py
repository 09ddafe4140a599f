"""Planned poses: pictures of arm, loads, lines of sight and expected errors; their table in a terminal."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.data.dataset import select_evenly
from testbench.design.planning import Plan
from testbench.errors import Array
from testbench.model.vjm import evaluate_chain, marker_positions, tool_points
from testbench.plant.shapes import rigid_frames
from testbench.plant.tracker import PlaneProbe
from testbench.report.colours import GREY, MEASURED, NOMINAL, TASK, Look
from testbench.report.colours import look as look_of
from testbench.report.report import Report
from testbench.report.scene import (
    Layer,
    ModelLine,
    PageContent,
    PlaceMap,
    PoseGroup,
    RunChart,
    Scene,
    faces,
    gauges,
    largest_and_even,
    loads,
    of_all,
    trackers,
    workspace,
)
from testbench.report.schema import Table, TableColumn
from testbench.runs.rows import Row
from testbench.workflows.cell import Cell
from testbench.workflows.error_places import ErrorPlaces
from testbench.workflows.instruments import Mounted, names_of, unit_normal
from testbench.workflows.model_names import in_words
from testbench.workflows.plan import Planned

OURS, WORK = look_of("ALL153", "psd", prior=True), Look(TASK, 1, prior=True)
CHANCE = Look(GREY, 0, prior=False)  #: Of plans that were not chosen.
MADE = "this plan"  #: How the plan that was made is called.
ORDER, UNSCALED = (
    "Plan, in the order of measuring",
    "Nothing is magnified; weights have the size of steel weights.",
)
SPECKS, NUMBERED = 600, 20  #: Candidates that are drawn, and planned poses whose number is, at most.
NOWHERE = "no bound"
MANY = 6  #: With more joints, pulls or gauges, a terminal of 80 columns has no decimals and no travel.
GAUGES_IN_LINE = 3  #: Gauges of a pose in a line of a terminal; beside pulls each has its own line.


@dataclass(frozen=True)
class World:
    """Hold what stands around the arm in every pose."""

    cell: Cell  #: The arm.
    station: Sequence[float] | None  #: Where the tracker stands [m].
    plan: Array  #: Tools of the plan, in its order, (poses, 3) [m].
    tasks: Array  #: Tools of the tasks, (tasks, 3) [m].
    candidates: Array  #: Tools of the feasible poses, (c, 3) [m].
    #: Instruments of distances and heights, with their names.
    instruments: Sequence[tuple[Mounted, str]] = ()

    def poses(
        self,
        name: str,
        named: Mapping[str, str],
        q: Array,
        layers: Sequence[Layer],
        first: int = 0,
        *,
        ordered: bool = False,
    ) -> PoseGroup:
        """Draw the arm in poses, with what is said of each by its name.

        Args:
            name: Name of the group.
            named: What is said of each pose, by its name.
            q: Poses, (poses, n) [rad, m].
            layers: What is drawn beside the arm.
            first: Pose that is shown first.
            ordered: Whether the poses follow each other.

        Returns:
            The group.
        """
        every = [*layers, *self._still()]
        frames = rigid_frames(self.cell.room, q)
        words = list(named.values())
        return PoseGroup(name, list(named), words, frames, None, every, first, ordered=ordered)

    def measured(self, q: Array, force: Array) -> list[Layer]:
        """Draw markers, lines of sight and loads of poses that are measured.

        Args:
            q: Poses, (poses, n) [rad, m].
            force: Loads, (poses, 3) [N].

        Returns:
            The layers.
        """
        markers = tool_points(self.cell.vjm, q, self.cell.vjm.markers)
        layers = [Layer("markers", MEASURED, "dots", markers)]
        if points := [(own, name) for own, name in self.instruments if own.direction is None]:
            read = marker_positions(self.cell.vjm, tuple(own.marker for own, _ in points))
            to = tool_points(self.cell.vjm, q, read)
            fixed = np.array([own.fixed for own, _ in points])
            layers.append(Layer("distances", MEASURED, "lines", np.broadcast_to(fixed, to.shape), to))
        if self.station is not None:
            tracker = np.broadcast_to(np.array(self.station), markers.shape)
            layers.append(Layer("lines of sight", MEASURED, "lines", tracker, markers))
        return [*layers, *self.pulled(q, force)]

    def pulled(self, q: Array, force: Array) -> list[Layer]:
        """Draw what hangs or pulls.

        Args:
            q: Poses, (poses, n) [rad, m].
            force: Loads, (poses, 3) [N].

        Returns:
            The layers.
        """
        hook = tool_points(self.cell.vjm, q, self.cell.vjm.load_point[None])[:, 0]
        return loads(hook, force, self.cell.vjm.reach)

    def all_over(self, q: Array, words: Sequence[str], first: int = 0) -> PoseGroup:
        """Draw the arm all over the workspace.

        Args:
            q: Poses, (poses, n) [rad, m].
            words: What is said of each pose.
            first: Pose that is shown first.

        Returns:
            The group.
        """
        tool = Layer("tool", MEASURED, "dots", evaluate_chain(self.cell.vjm, q).tool_position[:, None])
        return workspace(self.cell, q, words, [tool, *self._still()], first)

    def _still(self) -> list[Layer]:
        numbers = [str(k + 1) for k in range(len(self.plan))] if len(self.plan) <= NUMBERED else []
        some = select_evenly(np.arange(len(self.candidates)), SPECKS)
        layers = [
            Layer("feasible poses", GREY, "specks", self.candidates[None, some], shown=False),
            Layer("way", NOMINAL, "lines", self.plan[None, :-1], self.plan[None, 1:], shown=False),
            Layer("planned poses", NOMINAL, "dots", self.plan[None], labels=numbers),
        ]
        if len(self.tasks):
            layers.append(Layer("tasks", TASK, "dots", self.tasks[None]))
        if self.station is not None:
            layers.append(trackers(np.array(self.station)))
        points = [(own.fixed, name) for own, name in self.instruments if own.direction is None]
        if points:
            fixed, names = zip(*points, strict=True)
            layers.append(Layer("fixed points", MEASURED, "dots", np.array([fixed]), labels=names))
        planes = [(own, name) for own, name in self.instruments if own.direction is not None]
        if planes:
            at, normals = np.array([own.fixed for own, _ in planes]), [unit_normal(own) for own, _ in planes]
            probes = [own.instrument for own, _ in planes]
            half = max(probe.face_radius for probe in probes if isinstance(probe, PlaneProbe))
            layers.append(faces(at, np.array(normals), half, [name for _, name in planes]))
        return layers


def seen(made: Planned, f: Row) -> PageContent:
    """Show the plan's poses, the tasks and the workspace, with the errors to expect in each.

    Args:
        made: The plan.
        f: Its numbers.

    Returns:
        The content.
    """
    cell, tasks = made.cell, f.get("tasks", [])
    plan, work = (np.array([row.tool_m for row in rows]).reshape(-1, 3) for rows in (f.plan, tasks))
    instruments = made.settings.mounted
    named_instruments = [*zip(instruments, names_of(instruments), strict=True)]
    feasible = evaluate_chain(cell.vjm, made.found.q).tool_position
    world = World(cell, f.tracker_m, plan, work, feasible, named_instruments)
    force = np.array([row.get("pull_N") or [0, 0, -GRAVITY * row.get("load_kg", 0.0)] for row in f.plan])
    named = {f"Run {row.run}": _said(cell, row, q) for row, q in zip(f.plan, made.plan.q, strict=True)}
    layers = [*world.measured(made.plan.q, force), *_gauges(made)]
    groups = [world.poses(ORDER, named, made.plan.q, layers, ordered=True)]
    charts = [_chart(0, f.plan)]
    if isinstance(made.plan, Plan):
        every = made.plan.specification.tasks.q
        some = largest_and_even(made.forecast.rms_error, np.arange(len(every)))
        rows, q = [tasks[k] for k in some], every[some]
        named = {f"Task {row.task}": _said(cell, row, own) for row, own in zip(rows, q, strict=True)}
        pulls = world.pulled(q, np.array([row.force_N for row in rows]))
        groups.append(world.poses("Tasks", named, q, pulls, int(made.forecast.rms_error[some].argmax())))
        note = of_all(len(some), len(every), "tasks")
        charts.insert(0, _chart(1, rows, note))
    errors = {name: f.map.error_mm[name] for name in f.map.compared}
    words = [
        f"Expected error: {', '.join(_error(name, mm[k]) for name, mm in errors.items())}. {joints}."
        for k, joints in enumerate(f.map.joints)
    ]
    groups.append(world.all_over(f.map.q, words))
    return PageContent(
        scene=Scene(cell, UNSCALED, groups),
        map=_map(f.map, len(groups) - 1, "after calibration" if f.absolute else "under the first load"),
        runs=charts,
    )


def _gauges(made: Planned) -> list[Layer]:
    """Draw the gauges of a plan; none for a tracker."""
    placed = made.plan.gauges if isinstance(made.plan, Plan) else None
    if placed is None:
        return []
    vjm, q = made.cell.vjm, made.plan.q
    direction = np.zeros((len(q), len(vjm.markers), 3))
    direction[np.arange(len(q))[:, None], placed.marker] = np.eye(3)[placed.axis]
    return gauges(
        tool_points(vjm, q, vjm.markers), direction, evaluate_chain(vjm, q).tool_position, vjm.reach
    )


def _said(cell: Cell, row: Row, q: Sequence[float] | Array) -> str:
    """What acts in a pose, how far it moves the tool, and the error to expect."""
    load = f"Load {row.load}. " if "load" in row else ""
    what = "sag" if "expected_sag_mm" in row else "deflection"
    moved = row[f"expected_{what}_mm"]
    low, high = row.expected_error_p05_mm, row.expected_error_p95_mm
    error = f"{row.expected_error_mm:.3f} mm (90 % interval {low:.3f} to {high:.3f} mm)"
    return (
        f"{load}Expected {what} {moved:.2f} mm, error {error}. Joints at {cell.arm.pose_text(np.array(q))}."
    )


def _chart(group: int, rows: Sequence[Row], note: str = "") -> RunChart:
    """Errors to expect in the poses of the plan, or at tasks."""
    tasks = "task" in rows[0]
    key, where, look = ("task", "at each task", WORK) if tasks else ("run", "in each planned pose", OURS)
    middle, low, high = (
        np.array([row[f"expected_error{end}_mm"] for row in rows]) for end in ("", "_p05", "_p95")
    )
    title = f"Expected error {where}, 90 % intervals (mm)"
    line = ModelLine("task" if tasks else MADE, look, middle, (low, high))
    return RunChart(title, group, key, [str(row[key]) for row in rows], [line], note=note)


def looks_of_plans(rows: Sequence[Row]) -> dict[str, Look]:
    """Choose how plans are drawn: the one that was made filled, hollow under other conditions, others grey.

    Args:
        rows: `what` of each, see `plan_numbers`.
    """
    names = [str(row.what) for row in rows]
    own = {name: replace(OURS, prior=name == MADE) for name in names if name.startswith(MADE)}
    return dict.fromkeys(names, CHANCE) | own


def _error(name: str, mm: float) -> str:
    return f"{in_words(name)} {NOWHERE if np.isnan(mm) else f'{mm:.3f} mm'}"


def _map(error_places: ErrorPlaces, group: int, when: str) -> PlaceMap:
    """Errors to expect over the workspace, a map a model; `group` is that of the places in the scene."""
    *others, last = error_places.compared
    looks = {**{name: look_of(name, "none") for name in others}, last: OURS}
    lines = [ModelLine(name, look, error_places.error_mm[name]) for name, look in looks.items()]
    without = NOWHERE if any(map(error_places.unbounded, looks)) else ""
    title = f"Expected error over the workspace, {when} (mm)"
    return PlaceMap(title, group, error_places.position_m, lines, "Expected errors", without)


def poses_for_terminal(said: Report) -> Table:
    """Shorten the table of poses for a terminal: joints in one cell; no decimals if it is wide.

    Args:
        said: The report of a plan.

    Returns:
        The table.
    """
    table, f = said.tables["poses"], Row(said.numbers)
    many = len(f.joints) > MANY or bool(f.pulls_n) or bool(f.get("gauges"))
    way = many and not f.get("gauges")
    left = {"expected_deflection_mm", "travel_mm", "way" * (not way), "travel_deg" * many}
    first, *others = (c for c in table.columns if c.key not in left and not c.key.startswith("q_shown"))
    own = [replace(c, exact=True, heading="error") if c.key == "error_there_mm" else c for c in others]
    units = ", ".join(dict.fromkeys(f.units))
    joints = TableColumn("q_told", f"q1 to q{len(f.joints)}", units, short=f"q1 to q{len(f.joints)}\n{units}")
    form, column = "5.0f" if many else "6.1f", TableColumn("q_shown", "")
    rows = [
        Row(
            row,  # type: ignore[call-overload]
            q_told=" ".join(format(q, form) for q in column.value(row)),
            gauges=_in_lines(row.get("gauges", ""), 1 if f.pulls_n else GAUGES_IN_LINE),  # type: ignore[attr-defined]
        )
        for row in table.rows
    ]
    return replace(table, columns=(first, joints, *own), rows=rows, title="")


def _in_lines(gauges: str, count: int) -> str:
    """Break the gauges of a pose into lines of so many."""
    names = gauges.split()
    lines = [names[k : k + count] for k in range(0, len(names), count)]
    return "\n".join(map(" ".join, lines))
