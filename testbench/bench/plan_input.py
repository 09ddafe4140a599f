"""What a plan is asked for in files and flags: tasks, places; and what a plan.csv hangs where."""

import math
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.bench.campaign import Cell
from testbench.bench.plan_settings import LOAD_RANGE, Place
from testbench.data.posefile import XYZ, read_joints
from testbench.data.table import Table, read_table
from testbench.design.rows import Load
from testbench.design.specification import Tasks
from testbench.errors import Array, BenchError, InputError
from testbench.plant import collisions

MAX_TASKS = 1000
FORCE, MOMENT, POINT = (
    [f"force_{x}_N" for x in XYZ],
    [f"moment_{x}_Nm" for x in XYZ],
    [f"point_{x}_m" for x in XYZ],
)
FARTHEST = {FORCE[0]: 1e6, MOMENT[0]: 1e6, POINT[0]: 10.0}
"""Largest components of a task's load [N, N m] and of where it acts [m]; beyond them a unit is a slip."""


def read_tasks(path: Path, cell: Cell, hung: Load) -> Tasks:
    """Read tasks, one pose a row, and check that the arm can take them.

    Columns: JOINT_rad or JOINT_deg of every joint, of a slide JOINT_m or JOINT_mm. force_*_N and moment_*_Nm
    (optional): load of the process, world axes. point_*_m (optional with them): where it acts, in the tool's
    frame; the arm's load point if not given.

    Tasks without such columns have the load `hung`.

    Raises:
        InputError: Names line, joint or bodies, and what was expected.
    """
    table = read_table(path)
    _check_header(table, cell.arm)
    if not 1 <= table.rows <= MAX_TASKS:
        raise table.error(
            min(table.rows, MAX_TASKS), "", f"expected 1 to {MAX_TASKS} tasks, got {table.rows}"
        )
    q = read_joints(table, cell.arm)
    for line, pair in enumerate(collisions(cell.room, q), start=2):
        if pair:
            raise InputError(path, f"line {line}", f"{pair[0]} collides with {pair[1]} in this pose")
    return Tasks(q, _read_load(table, hung))


def _check_header(table: Table, arm: Arm) -> None:
    """Refuse what is no column of tasks, and loads that lack a component."""
    path, header = table.path, table.columns.keys()
    groups = [group for group in (FORCE, MOMENT, POINT) if header & set(group)]
    of_loads = {name for group in groups for name in group}
    of_joints = {name for j in arm.joints for name in (j.column, j.shown_column)}
    if not of_loads <= header <= of_loads | of_joints:
        raise InputError(
            path,
            "line 1",
            f"expected the columns {','.join(j.column for j in arm.joints)} (or in deg or mm), and if wanted "
            f"all of {','.join(FORCE)}, of {','.join(MOMENT)} and of {','.join(POINT)}, got "
            f"{','.join(header)}",
        )
    if groups == [POINT]:
        raise InputError(path, "line 1", f"expected {','.join(FORCE)} where {','.join(POINT)} are given")


def _read_load(table: Table, hung: Load) -> Load:
    """The load of every task."""

    def three(names: list[str], default: Array) -> Array:
        if names[0] not in table.columns:
            return np.tile(default, (table.rows, 1))
        values, most = table.numbers(names), FARTHEST[names[0]]
        far = np.argwhere(np.abs(values) > most)
        if len(far):
            i, k = far[0]
            raise table.error(i, names[k], f"expected {-most:g} to {most:g}, got {values[i, k]:g}")
        return values

    if not {FORCE[0], MOMENT[0]} & table.columns.keys():
        return hung
    wrench = np.hstack([three(FORCE, np.zeros(3)), three(MOMENT, np.zeros(3))])
    idle = np.flatnonzero(~wrench.any(axis=1))
    if len(idle):
        raise table.error(idle[0], "", "expected a load, got zero force and moment")
    return Load(wrench, three(POINT, hung.point))


def read_payload(path: Path) -> Array | None:
    """Hung mass of every run of a plan, (runs,) [kg]; None for poses without column load_kg."""
    table = read_table(path)
    if "load_kg" not in table.columns:
        return None
    mass, (low, high) = table.numbers(["load_kg"])[:, 0], LOAD_RANGE
    for row in np.flatnonzero((mass < low) | (mass > high)).tolist():
        raise table.error(row, "load_kg", f"expected {low:g} to {high:g}, got {mass[row]:g}")
    return mass


def place(text: str) -> Place:
    """Where the tracker stands, x,y,z [m]; BenchError for anything but three finite numbers."""
    x, y, z = _numbers(text, 3, "--tracker x,y,z [m]")
    return x, y, z


def box(text: str) -> tuple[Place, Place]:
    """Two corners of the work area, x0,y0,z0,x1,y1,z1 [m]; BenchError for anything but six finite numbers."""
    x0, y0, z0, x1, y1, z1 = _numbers(text, 6, "--box x0,y0,z0,x1,y1,z1 [m]")
    return (x0, y0, z0), (x1, y1, z1)


def _numbers(text: str, count: int, flag: str) -> tuple[float, ...]:
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count or not all(map(math.isfinite, values)):
        raise BenchError(f"{flag}: expected {count} numbers with commas between them, got {text[:80]!r}")
    return values
