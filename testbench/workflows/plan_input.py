"""Inputs of a plan: loads, tasks and work areas, read from files and flags.

Candidate poses to measure: the arm can take them with its payload, and the tracker sees every target.

The conditions are asked in a fixed order, the cheap ones first; a pose counts for the first that refuses it.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from testbench.arm.document import read_decimals
from testbench.arm.folder import Arm
from testbench.arm.mjcf import GRAVITY
from testbench.errors import Array, BenchError, InputError, Mask, PoseError, check_array, some_of
from testbench.files.columns import Columns, find_columns, joint_coordinates, vector, wrench
from testbench.files.mapping import read_map
from testbench.files.names import looks_like
from testbench.files.table import TableCells, read_table
from testbench.model.load import Load
from testbench.model.vjm import Vjm, WorkArea, evaluate_chain, in_work_area
from testbench.plant.rigid_cell import (
    ContactCategory,
    Payload,
    RigidCell,
    build_rigid_cell,
    find_contacts,
    find_hidden_markers,
)
from testbench.plant.tracker import FACES_AWAY, TOO_FAR, TOO_NEAR, TOO_STEEP, Station, find_out_of_view
from testbench.progress import tell
from testbench.workflows.cell import Cell
from testbench.workflows.options import payload_of, read_masses

if TYPE_CHECKING:  # importing MuJoCo takes a sixth of a second, and --help does without
    from testbench.design.rows import Tasks

# --- Inputs of a plan: loads, tasks and work areas, read from files and flags -------------------------------

Place = tuple[float, float, float]
LOAD_RANGE = (1e-3, 1e4)  #: Masses that can hang from an arm [kg], as in campaign.Scenario.
PULL_RANGE = (GRAVITY * LOAD_RANGE[0], GRAVITY * LOAD_RANGE[1])  #: Sizes of forces that can pull [N].
MAX_TASKS = 1000
MAX_NUMBER = 1e6  #: Of a number in a flag, whatever its unit.
LOAD = "load_kg"  #: Column of a plan: what hangs in a run.
#: Columns of a plan: what pulls in a run, world axes.
FORCE_COLUMNS = ("force_x_N", "force_y_N", "force_z_N")
FORCES = f"columns {', '.join(FORCE_COLUMNS)}"  #: As messages name them.
MAX_RUNS = 50_000  #: Equilibria that are sought at most, poses times loads times set-ups.


def read_loads(path: Path) -> tuple[Array | None, Array | None]:
    """Read the mass that hangs, and the force that pulls, at the load point in every run of a plan.

    Returns:
        Masses, (runs,) [kg], 0 where a force pulls; None for poses without loads. Forces, world axes,
        (runs, 3) [N], 0 where a weight hangs; None for a plan without columns force_*_N.
    """
    table = read_table(path, lambda name: name in (LOAD, *FORCE_COLUMNS))
    pulls = _read_pulls(table) if set(FORCE_COLUMNS) & set(table.names) else None
    if LOAD not in table.names and pulls is None:
        return None, None
    mass, (low, high) = _column(table, LOAD), LOAD_RANGE
    pulled = np.zeros(table.rows, dtype=bool) if pulls is None else pulls.any(axis=1)
    beside = pulled & (np.nan_to_num(mass) != 0)
    table.refuse(beside, LOAD, lambda row: f"expected no mass beside a force, got {mass[row]:g} kg")
    else_ = "" if pulls is None else " if no force acts"
    off = ~(pulled | ((mass >= low) & (mass <= high)))
    table.refuse(off, LOAD, lambda row: f"expected {low:g} to {high:g}{else_}, got {mass[row]:g}")
    return np.where(pulled, 0.0, mass), pulls


def _read_pulls(table: TableCells) -> Array:
    if missing := [name for name in FORCE_COLUMNS if name not in table.names]:
        raise table.header_error(f"expected {', '.join(missing)} too")
    if others := [name for name in table.names if name.startswith(("moment_", "point_"))]:
        problem = "expected forces without moments: they act at the arm's load point"
        raise table.header_error(f"{problem}, got {', '.join(others)}")
    pulls = np.nan_to_num(np.column_stack([_column(table, name) for name in FORCE_COLUMNS]))
    size, (low, high) = np.linalg.norm(pulls, axis=1), PULL_RANGE
    off = (size > 0) & ~((size >= low) & (size <= high))
    table.refuse(off, "", lambda row: f"expected a force of {low:g} to {high:g} N, got {size[row]:g}")
    return np.asarray(pulls)


def _column(table: TableCells, name: str) -> Array:
    """Numbers of a column, (rows,), NaN where a cell is blank or there is no such column."""
    if name not in table.names:
        return np.full(table.rows, np.nan)
    k = table.names.index(name)
    return table.numbers(k, table.mark([k]))


def parse_point(text: str, flag: str = "--tracker x,y,z [m]") -> Place:
    """Parse a point or a force, "x,y,z"; BenchError for anything but three finite numbers.

    Args:
        text: The text.
        flag: The flag and its form, for the message.

    Returns:
        x, y and z.
    """
    x, y, z = parse_numbers(text, (3,), flag)
    return x, y, z


def joints_of(text: str, arm: Arm) -> Array:
    """Parse the joint angles of a flag such as --start a,b,c [deg, mm]; BenchError for other text.

    Args:
        text: The text.
        arm: Description of the arm.

    Returns:
        Joints, (n,) [rad, m].
    """
    return arm.from_display_units(np.array(parse_numbers(text, (len(arm.file_joints),), "--start [deg, mm]")))


def parse_work_area(text: str) -> tuple[Place, Place]:
    """Read two corners of the work area, x0,y0,z0,x1,y1,z1 [m]; BenchError unless six finite numbers."""
    x0, y0, z0, x1, y1, z1 = parse_numbers(text, (6,), "--box x0,y0,z0,x1,y1,z1 [m]")
    return (x0, y0, z0), (x1, y1, z1)


def parse_numbers(text: str, counts: Collection[int], flag: str) -> list[float]:
    """Parse the numbers of a flag, such as "1,2.5,-3".

    Args:
        text: The text.
        counts: How many numbers there may be.
        flag: The flag and its form, for the message.

    Returns:
        The numbers.

    Raises:
        BenchError: If the text is something else, or a number is too large.
    """
    try:
        values = read_decimals(part.strip() for part in text.split(","))
    except ValueError:
        values = []
    if len(values) not in counts or not all(abs(value) <= MAX_NUMBER for value in values):
        wanted = f"expected {' or '.join(map(str, counts))} numbers with commas between them"
        raise BenchError(f"{flag}: {wanted}, up to {MAX_NUMBER:g}, got {text[:80]!r}")
    return values


def read_tasks(path: Path, cell: Cell, hung: Load, mapping: Path | None = None) -> "Tasks":
    """Read tasks, one pose a row, and check that the arm can take them.

    Columns: JOINT_rad or JOINT_deg of every joint, of a slide JOINT_m or JOINT_mm. force_*_N and moment_*_Nm
    (optional): load of the process, world axes. point_*_m (optional with them): where it acts, in the tool's
    frame; the arm's load point if not given.

    Tasks without such columns have the load `hung`. A map says how the file names the columns otherwise.

    Args:
        path: Path of the file.
        cell: The arm with its model and its truth.
        hung: Load of tasks without columns of loads.
        mapping: Map of the file's names; None for none.

    Returns:
        The tasks.

    Raises:
        InputError: Names line, joint or bodies, and what was expected.
    """
    from testbench.design.rows import Tasks  # here: only plans have tasks
    from testbench.plant.rigid_cell import find_collisions

    names = read_map(mapping, cell.arm)
    table = read_table(path, names.knows, names.map.file)
    columns = find_columns(table, names, cell.arm)
    q = joint_coordinates(columns, cell.arm)
    if not 1 <= table.rows <= MAX_TASKS:
        problem = f"expected 1 to {MAX_TASKS} tasks, got {table.rows}"
        raise table.error(min(table.rows, MAX_TASKS), "", problem)
    for line, pair in zip(table.lines.tolist(), find_collisions(cell.room, q), strict=True):
        if pair:
            raise InputError(path, f"line {line}", f"{pair[0]} collides with {pair[1]} in this pose")
    return Tasks(q, _read_load(columns, hung))


def _read_load(columns: Columns, hung: Load) -> Load:
    """The load of every task; a column that looks like a load must not be lost."""
    table = columns.table
    masses = [column.name for column in columns.all_of("mass")]
    if lost := [*masses, *(name for name in columns.ignored if looks_like(name, "loads"))]:
        wanted = "expected loads of tasks in force_x_N, force_y_N, force_z_N (a weight: -9.81 N/kg along z)"
        raise table.header_error(f"{wanted}, got {some_of(lost)}")
    acts = wrench(columns)
    point = vector(columns, "point")
    if acts is None:
        if point is None:
            return hung
        given = "point_x_m, point_y_m, point_z_m are given"
        raise table.header_error(f"expected force_x_N, force_y_N, force_z_N if {given}")
    table.refuse(np.asarray(~acts.any(axis=1)), "", "expected a load, got zero force and moment")
    return Load(acts, np.tile(hung.point, (table.rows, 1)) if point is None else point)


def given_poses(
    cell: Cell, file: Path | None, mapping: Path | None, poses: int | None, times: int
) -> Array | None:
    """Read the poses that a simulation takes from a file.

    Args:
        cell: The arm.
        file: File of poses; None where `poses` says how many random ones there are.
        mapping: Map of the file's columns.
        poses: Number of random poses.
        times: How often every pose is run.

    Returns:
        Poses, (poses, n) [rad, m]; None for random ones.

    Raises:
        BenchError: When both or none are given, or the runs are too many.
    """
    from testbench.files.program import read_poses  # here: plans read none
    from testbench.plant.rigid_cell import check_poses

    if (file is None) == (poses is None):
        raise BenchError("poses: expected either a file of poses or --poses NUMBER")
    q = None if file is None else read_poses(file, cell.arm, mapping)
    count = (poses or 0) if q is None else len(q)
    if count * times > MAX_RUNS:
        most = f"expected at most {MAX_RUNS} runs (poses times loads times series)"
        raise BenchError(f"{file or '--poses'}: {most}, got {count} times {times}")
    if q is not None:
        check_poses(cell.room, q)
    return q


def hung_loads(
    arm: Arm, file: Path | None, payload_kg: float | None, loads: str | None, unsaid: float | None = None
) -> tuple[Array, Array | None]:
    """Find what hangs and what pulls in every pose of a simulation.

    Args:
        arm: The arm.
        file: File of poses that may say what hangs; None for random poses.
        payload_kg: Flag of one mass [kg].
        loads: Flag of several masses, commas between.
        unsaid: Mass where nothing is said [kg]; None for the payload that the arm states.

    Returns:
        Masses in the order of reading, (poses, loads), or (1, loads) where all poses have the same [kg].
        Forces as `read_loads` has them.

    Raises:
        BenchError: When two of them say what hangs.
    """
    if loads is not None and payload_kg is not None:
        raise BenchError("--loads cannot be combined with --payload-kg")
    stated, pulls = (None, None) if file is None else read_loads(file)
    if stated is None and loads is not None:
        return np.array([read_masses(loads)]), pulls
    if stated is None:
        mass = unsaid if payload_kg is None else payload_kg
        return np.array([[payload_of(arm, mass, "--payload-kg")]]), pulls
    for flag, value in (("--payload-kg", payload_kg), ("--loads", loads)):
        if value is not None:
            problem = f"states the load of every run; leave out {flag}"
            raise InputError(file or Path(), "column load_kg" if stated.any() else FORCES, problem)
    return stated[:, None], pulls


def masses_in_turn(
    arm: Arm, file: Path | None, payload_kg: float | None, loads: str | None
) -> tuple[float, ...]:
    """Find the masses of absolute readings in one pose, in the order of reading; the first is zero [kg].

    Args:
        arm: The arm.
        file: File of poses that may say what hangs; None for random poses.
        payload_kg: Flag of one mass [kg].
        loads: Flag of several masses, commas between.

    Returns:
        Masses [kg].

    Raises:
        BenchError: When the file has forces, or other masses from run to run, or two say what hangs.
    """
    masses, pulls = hung_loads(arm, file, payload_kg, loads, unsaid=0.0)
    if pulls is not None:
        raise InputError(file or Path(), FORCES, "expected no forces with --absolute")
    if (masses != masses[0]).any():
        problem = "expected the same load in all runs with --absolute; remove the column and state --loads"
        raise InputError(file or Path(), "column load_kg", problem)
    return (0.0, *filter(None, masses[0].tolist()))


# --- Candidate poses to measure -----------------------------------------------------------------------------

POSES_PER_BATCH = 1024
PATIENCE = 200_000
"""Poses drawn before `find_feasible_poses` gives up."""
DRAWS_PER_POSE = 1000  #: Poses that it draws beyond `PATIENCE` for every pose that it has found.

OFF_LIMITS = "outside the joint limits"
OFF_AREA = "tool outside the work area"
BLOCKED = "line of sight is blocked"
TOUCHING: dict[ContactCategory, str] = {
    "itself": "arm collides with itself",
    "room": "arm hits the floor or a wall",
    "tracker": "arm hits the tracker",
    "payload": "payload does not hang clear",
}
ADVICE = {
    OFF_LIMITS: "draw within the limits",
    OFF_AREA: "widen the work area",
    TOO_NEAR: "move the station away",
    TOO_FAR: "move the station nearer",
    TOO_STEEP: "move the station away or to another height",
    FACES_AWAY: "move the station to where the targets face, or turn them by hand (no acceptance)",
    TOUCHING["itself"]: "check the collision shapes of rigid.xml",
    TOUCHING["room"]: "raise the work area",
    TOUCHING["tracker"]: "move the station away",
    TOUCHING["payload"]: "shorten the sling, or raise the work area",
    BLOCKED: "move the station to another side",
}
"""What to change where a reason refuses too many poses."""
REASONS = tuple(ADVICE)  #: Why a pose is refused, in the order in which it is asked.


@dataclass(frozen=True)
class PoseConditions:
    """Describe what a pose must satisfy beyond limits and collisions."""

    area: WorkArea | None = None  #: Where the tool has to be; None for anywhere.
    station: Station | None = None  #: Where the tracker stands and what it sees; None where nobody looks.
    payload: Payload | None = None  #: What hangs from the load point; None for nothing.


@dataclass(frozen=True)
class Checks:
    """Hold the conditions of a pose, with the model and the collision shapes that check them."""

    vjm: Vjm  #: The model, for its nominal kinematics.
    site: RigidCell  #: Arm, payload and tracker as shapes.
    conditions: PoseConditions  #: What is asked.


@dataclass(frozen=True)
class Candidates:
    """Hold feasible poses, and how many poses were drawn and rejected to find them."""

    q: Array  #: Actuated joints, (count, n) [rad, m].
    drawn: int  #: Poses drawn.
    rejected: dict[str, int]  #: How many each of `REASONS` refused, in their order.


def build_checks(cell: Cell, conditions: PoseConditions) -> Checks:
    """Build the checks of poses of an arm; BenchError if the tracker is inside something that does not move.

    Args:
        cell: The arm with its model and its truth.
        conditions: Conditions of a pose.

    Returns:
        The checks.
    """
    station = conditions.station
    place = None if station is None else station.position
    site = build_rigid_cell(cell.arm, conditions.payload, place, cell.floor)
    return Checks(cell.vjm, site, conditions)


def refusal_reasons(checks: Checks, q: Array) -> list[str | None]:
    """Find the reason for which each pose is refused: the first condition, in the order of `STAGES`.

    Args:
        checks: The checks.
        q: Poses, (poses, n) [rad, m].

    Returns:
        Reason per pose, None where it is feasible.
    """
    q = check_array(q, (None, checks.vjm.arm.n_joints), "q [rad, m]")
    reasons = np.full(len(q), None, dtype=object)
    left = np.arange(len(q))
    for stage in STAGES:
        refused = np.zeros(len(left), dtype=bool)
        for reason, mask in stage(checks, q[left]).items():
            reasons[left[mask & ~refused]] = reason
            refused |= mask
        left = left[~refused]
    return list(reasons)


def feasible(checks: Checks, q: Array) -> Mask:
    """Tell which poses satisfy all conditions.

    Args:
        checks: The checks.
        q: Poses, (poses, n) [rad, m].

    Returns:
        True for a feasible pose, (poses,).
    """
    return np.array([reason is None for reason in refusal_reasons(checks, q)], dtype=bool)


def _limits(checks: Checks, q: Array) -> dict[str, Mask]:
    lower, upper = checks.vjm.arm.limits
    return {OFF_LIMITS: np.asarray(((q < lower) | (q > upper)).any(axis=1))}


def _area(checks: Checks, q: Array) -> dict[str, Mask]:
    area = checks.conditions.area
    return {} if area is None else {OFF_AREA: ~in_work_area(checks.vjm, area, q)}


def _view(checks: Checks, q: Array) -> dict[str, Mask]:
    station = checks.conditions.station
    if station is None:
        return {}
    where = evaluate_chain(checks.vjm, q)
    turned = where.tool_rotation.swapaxes(1, 2)  # rows are turned from the tool's axes into the world's
    targets = where.tool_position[:, None] + checks.vjm.markers @ turned
    return find_out_of_view(station, targets, checks.site.marker_directions @ turned)


def _contacts(checks: Checks, q: Array) -> dict[str, Mask]:
    kinds = [contact.category if contact else None for contact in find_contacts(checks.site, q)]
    return {reason: np.array([k == kind for k in kinds], dtype=bool) for kind, reason in TOUCHING.items()}


def _sight(checks: Checks, q: Array) -> dict[str, Mask]:
    if checks.conditions.station is None:
        return {}
    return {BLOCKED: np.array([by is not None for by in find_hidden_markers(checks.site, q)], dtype=bool)}


STAGES: tuple[Callable[[Checks, Array], dict[str, Mask]], ...] = (_limits, _area, _view, _contacts, _sight)
"""Each says which poses it refuses and why; only those that all before it let pass come to it."""


def find_feasible_poses(
    checks: Checks, count: int, rng: np.random.Generator, *, least: int | None = None
) -> Candidates:
    """Draw feasible poses evenly over the joint limits, as many as asked for.

    It gives up after `PATIENCE` draws, and `DRAWS_PER_POSE` more for every pose found: PoseError says what
    refused them and what to change.

    Args:
        checks: The checks.
        count: Number of poses.
        rng: Source of randomness.
        least: Number of poses that suffices where no more are found; None for `count`.

    Returns:
        The poses.
    """
    least = count if least is None else least
    rejected, drawn = dict.fromkeys(REASONS, 0), 0
    kept: list[Array] = []
    while len(kept) < count and drawn < PATIENCE + DRAWS_PER_POSE * len(kept):
        q = checks.vjm.arm.draw_poses(rng, POSES_PER_BATCH)
        reasons = refusal_reasons(checks, q)
        good = np.flatnonzero([reason is None for reason in reasons])[: count - len(kept)]
        kept += list(q[good])
        asked = POSES_PER_BATCH if len(kept) < count else int(good[-1]) + 1  # the rest counts as never drawn
        drawn += asked
        for reason in filter(None, reasons[:asked]):
            rejected[reason] += 1
        tell("finding feasible poses", len(kept), count)
    tell("finding feasible poses", count, count)
    if len(kept) < least:
        raise PoseError(_too_few(len(kept), count, drawn, rejected))
    return Candidates(np.array(kept), drawn, rejected)


def _too_few(found: int, count: int, drawn: int, rejected: dict[str, int]) -> str:
    """What was found and what refused the rest: the most of all, and the most of what came to it."""
    came = dict(zip(REASONS, drawn - np.cumsum([0, *rejected.values()]), strict=False))
    most = max(REASONS, key=lambda r: rejected[r])
    strict = max(REASONS, key=lambda r: rejected[r] / max(came[r], 1))
    refused = f"; {strict!r} refused {rejected[strict]} of the {came[strict]} poses tested: {ADVICE[strict]}"
    table = ", ".join(f"{reason} {n}" for reason, n in rejected.items() if n)
    return (
        f"found {found} of {count} poses in {drawn} draws; most were refused by {most!r}: {ADVICE[most]}"
        f"{refused if strict != most else ''} (refused: {table})"
    )
