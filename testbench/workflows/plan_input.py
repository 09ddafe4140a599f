"""Inputs of a plan: loads, tasks and work areas, read from files and flags."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from testbench.arm.document import read_decimals
from testbench.arm.folder import Arm
from testbench.arm.mjcf import GRAVITY
from testbench.errors import Array, BenchError, InputError
from testbench.files.columns import Columns, find_columns, vector, wrench
from testbench.files.mapping import read_map
from testbench.files.rows import joint_coordinates
from testbench.files.table import TableCells, read_table
from testbench.model.load import Load
from testbench.workflows.cell import Cell
from testbench.workflows.masses import payload_of, read_masses

if TYPE_CHECKING:
    from testbench.design.rows import Tasks

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
    """Read what hangs and what pulls at the load point in every run of a plan.

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
    else_ = "" if pulls is None else " where no force pulls"
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


def place(text: str, flag: str = "--tracker x,y,z [m]") -> Place:
    """Read a place such as the tracker's, or a pull; BenchError for anything but three finite numbers.

    Args:
        text: The text.
        flag: The flag and its form, for the message.

    Returns:
        x, y and z.
    """
    x, y, z = _numbers(text, 3, flag)
    return x, y, z


def joints_of(text: str, arm: Arm) -> Array:
    """Read file joints as people write them, --start a,b,c [deg, mm]; BenchError for others.

    Args:
        text: The text.
        arm: Description of the arm.

    Returns:
        Joints, (n,) [rad, m].
    """
    return arm.from_shown(np.array(_numbers(text, len(arm.file_joints), "--start [deg, mm]")))


def parse_work_area(text: str) -> tuple[Place, Place]:
    """Read two corners of the work area, x0,y0,z0,x1,y1,z1 [m]; BenchError unless six finite numbers."""
    x0, y0, z0, x1, y1, z1 = _numbers(text, 6, "--box x0,y0,z0,x1,y1,z1 [m]")
    return (x0, y0, z0), (x1, y1, z1)


def _numbers(text: str, count: int, flag: str) -> tuple[float, ...]:
    try:
        values = tuple(read_decimals(part.strip() for part in text.split(",")))
    except ValueError:
        values = ()
    if len(values) != count or not all(abs(value) <= MAX_NUMBER for value in values):
        problem = (
            f"expected {count} numbers with commas between them, up to {MAX_NUMBER:g}, got {text[:80]!r}"
        )
        raise BenchError(f"{flag}: {problem}")
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
    from testbench.plant.site import collisions

    names = read_map(mapping, cell.arm)
    table = read_table(path, names.knows, names.map.file)
    columns = find_columns(table, names, cell.arm)
    q = joint_coordinates(columns, cell.arm)
    if not 1 <= table.rows <= MAX_TASKS:
        problem = f"expected 1 to {MAX_TASKS} tasks, got {table.rows}"
        raise table.error(min(table.rows, MAX_TASKS), "", problem)
    for line, pair in zip(table.lines.tolist(), collisions(cell.room, q), strict=True):
        if pair:
            raise InputError(path, f"line {line}", f"{pair[0]} collides with {pair[1]} in this pose")
    return Tasks(q, _read_load(columns, hung))


def _read_load(columns: Columns, hung: Load) -> Load:
    """The load of every task."""
    table, acts, point = columns.table, wrench(columns), vector(columns, "point")
    if acts is None:
        if point is None:
            return hung
        given = "point_x_m, point_y_m, point_z_m are given"
        raise table.header_error(f"expected force_x_N, force_y_N, force_z_N where {given}")
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
    from testbench.plant.site import check_poses

    if (file is None) == (poses is None):
        raise BenchError("poses: expected either a file of poses or --poses NUMBER")
    q = None if file is None else read_poses(file, cell.arm, mapping)
    count = (poses or 0) if q is None else len(q)
    if count * times > MAX_RUNS:
        most = f"expected at most {MAX_RUNS} runs, poses times loads times series"
        raise BenchError(f"{file or '--poses'}: {most}, got {count} times {times}")
    if q is not None:
        check_poses(cell.room, q)
    return q


def hung_masses(
    arm: Arm, file: Path | None, payload_kg: float | None, loads: str | None, poses: int
) -> Array:
    """Find what hangs in every pose of a simulation, one after the other.

    Args:
        arm: The arm.
        file: File of poses that may say what hangs; None for random poses.
        payload_kg: Flag of one mass [kg].
        loads: Flag of several masses, commas between.
        poses: Number of poses where the file does not say what hangs.

    Returns:
        Masses, (poses, loads) [kg].

    Raises:
        BenchError: When two of them say what hangs.
    """
    if loads is not None and payload_kg is not None:
        raise BenchError("--loads: expected no --payload-kg with it")
    stated = None if file is None else read_loads(file)[0]
    if stated is None:
        mass = payload_of(arm, payload_kg, "--payload-kg") if loads is None else 0.0
        return np.tile([mass] if loads is None else read_masses(loads), (poses, 1))
    for flag, value in (("--payload-kg", payload_kg), ("--loads", loads)):
        if value is not None:
            problem = f"says what hangs or pulls in every run; leave out {flag}"
            raise InputError(file or Path(), "column load_kg" if stated.any() else FORCES, problem)
    return stated[:, None]
