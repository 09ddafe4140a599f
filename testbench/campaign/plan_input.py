"""What files and flags of a plan say: what hangs or pulls in each run of a plan.csv, places, masses."""

from pathlib import Path

import numpy as np

from testbench.arm.decimal import read_decimals
from testbench.arm.folder import Arm
from testbench.arm.mjcf import GRAVITY
from testbench.campaign.payload import read_mass
from testbench.data.table import Table, read_table
from testbench.errors import Array, BenchError, InputError

Place = tuple[float, float, float]
LOAD_RANGE = (1e-3, 1e4)  #: Masses that can hang from an arm [kg], as in campaign.Scenario.
PULL_RANGE = (GRAVITY * LOAD_RANGE[0], GRAVITY * LOAD_RANGE[1])  #: Sizes of forces that can pull [N].
LARGEST = 1e6  #: Of a number in a flag, whatever its unit.
LOAD = "load_kg"  #: Column of a plan: what hangs in a run.
FORCE = ("force_x_N", "force_y_N", "force_z_N")  #: Columns of a plan: what pulls in a run, world axes.


def read_payload(path: Path) -> Array | None:
    """Hung mass of every run of a plan, (runs,) [kg], 0 where it is pulled; None for poses without loads.

    Raises:
        InputError: Where a run has neither a mass nor a force, or both.
    """
    table, pulls = read_table(path, _says_load), read_pulls(path)
    if LOAD not in table.names and pulls is None:
        return None
    mass, (low, high) = _column(table, LOAD), LOAD_RANGE
    pulled = np.zeros(table.rows, dtype=bool) if pulls is None else pulls.any(axis=1)
    for row in np.flatnonzero(pulled & (np.nan_to_num(mass) != 0)).tolist():
        raise table.error(row, LOAD, f"expected no mass beside a force, got {mass[row]:g} kg")
    beside = "" if pulls is None else " where no force pulls"
    for row in np.flatnonzero(~(pulled | ((mass >= low) & (mass <= high)))).tolist():
        raise table.error(row, LOAD, f"expected {low:g} to {high:g}{beside}, got {mass[row]:g}")
    return np.where(pulled, 0.0, mass)


def read_pulls(path: Path) -> Array | None:
    """Force at the load point in every run of a plan, world axes, (runs, 3) [N], 0 where a weight hangs.

    None for a plan without columns force_*_N.

    Raises:
        InputError: Where one of the columns is missing, a force is out of range or acts elsewhere.
    """
    table = read_table(path, _says_load)
    if not set(FORCE) & set(table.names):
        return None
    place = f"line {table.header}"
    if missing := [name for name in FORCE if name not in table.names]:
        raise InputError(path, place, f"expected {', '.join(missing)} too")
    if others := [name for name in table.names if name.startswith(("moment_", "point_"))]:
        problem = f"expected forces alone, which act at the arm's load point, got {', '.join(others)}"
        raise InputError(path, place, problem)
    pulls = np.nan_to_num(np.column_stack([_column(table, name) for name in FORCE]))
    size, (low, high) = np.linalg.norm(pulls, axis=1), PULL_RANGE
    for row in np.flatnonzero((size > 0) & ~((size >= low) & (size <= high))).tolist():
        raise table.error(row, "", f"expected a force of {low:g} to {high:g} N, got {size[row]:g}")
    return np.asarray(pulls)


def _says_load(name: str) -> bool:
    return name in (LOAD, *FORCE)


def _column(table: Table, name: str) -> Array:
    """Numbers of a column, (rows,), NaN where a cell is blank or there is no such column."""
    if name not in table.names:
        return np.full(table.rows, np.nan)
    k = table.names.index(name)
    return table.numbers(k, table.mark([k]))


def read_masses(text: str) -> list[float]:
    """Masses, MASS,MASS ... [kg]; BenchError for anything but different ones that can hang."""
    try:
        masses = [read_mass(part) for part in text.split(",")]
    except BenchError as err:
        raise BenchError(f"--loads: {err}, got {text[:80]!r}") from err
    if len(set(masses)) < len(masses):
        raise BenchError(f"--loads: expected different masses, got {text[:80]!r}")
    return masses


def place(text: str, flag: str = "--tracker") -> Place:
    """A place such as the tracker's, x,y,z [m]; BenchError for anything but three finite numbers."""
    x, y, z = _numbers(text, 3, f"{flag} x,y,z [m]")
    return x, y, z


def joints_of(text: str, arm: Arm) -> Array:
    """Joints in the units that people read, --start a,b,c [deg, mm], (n,) [rad, m]; BenchError for others."""
    shown = np.array([joint.shown for joint in arm.joints])
    return np.asarray(_numbers(text, arm.n_joints, "--start [deg, mm]") / shown)


def pull(text: str) -> Place:
    """A force that pulls, fx,fy,fz [N]; BenchError for anything but three finite numbers."""
    x, y, z = _numbers(text, 3, "--pull fx,fy,fz [N]")
    return x, y, z


def box(text: str) -> tuple[Place, Place]:
    """Two corners of the work area, x0,y0,z0,x1,y1,z1 [m]; BenchError for anything but six finite numbers."""
    x0, y0, z0, x1, y1, z1 = _numbers(text, 6, "--box x0,y0,z0,x1,y1,z1 [m]")
    return (x0, y0, z0), (x1, y1, z1)


def _numbers(text: str, count: int, flag: str) -> tuple[float, ...]:
    try:
        values = tuple(read_decimals(part.strip() for part in text.split(",")))
    except ValueError:
        values = ()
    if len(values) != count or not all(abs(value) <= LARGEST for value in values):
        problem = f"expected {count} numbers with commas between them, up to {LARGEST:g}, got {text[:80]!r}"
        raise BenchError(f"{flag}: {problem}")
    return values
