"""Files and options of a plan: tasks and places in, the folder of the plan out."""

import csv
import io
import math
from pathlib import Path

import numpy as np

from testbench import files
from testbench.arm.folder import Arm
from testbench.bench.campaign import Cell
from testbench.bench.plan import LOAD_RANGE, Planned
from testbench.data.posefile import XYZ, check_limits, plan_columns
from testbench.data.station import Station
from testbench.data.table import Table, read_table
from testbench.design.rows import Load
from testbench.design.specification import Tasks
from testbench.errors import Array, BenchError, InputError
from testbench.model.poses import WorkArea
from testbench.model.vjm import chain
from testbench.plant import collisions
from testbench.views import plan_figure as figures_plan
from testbench.views import plan_page
from testbench.views.report import Report

MAX_TASKS = 1000
FORCE, MOMENT, POINT = (
    [f"force_{x}_N" for x in XYZ],
    [f"moment_{x}_Nm" for x in XYZ],
    [f"point_{x}_m" for x in XYZ],
)
WISHED = (
    "arm model criterion poses loads_kg sigma_um uncertainty_percent tracker_m acceptance_deg box_m sling_m "
    "candidates_wanted seed"
).split()
"""Keys of the report that the manifest repeats."""
FARTHEST = {"force": 1e6, "moment": 1e6, "point": 10.0}
"""Largest components of a task's load [N, N m] and of where it acts [m]; beyond them a unit is a slip."""


def read_tasks(path: Path, cell: Cell, hung: Load) -> Tasks:
    """Read tasks, one pose a row, and check that the arm can take them.

    Columns: JOINT_rad of every joint or JOINT_deg of every joint. force_*_N and moment_*_Nm (optional): load
    of the process, world axes. point_*_m (optional with them): where it acts, in the tool's frame; the arm's
    load point if not given.

    Args:
        path: The file.
        cell: The arm.
        hung: The load of tasks without columns of their own.

    Raises:
        InputError: Names line, joint or bodies, and what was expected.
    """
    table = read_table(path)
    angles = _check_header(table, cell.arm)
    if not 1 <= table.rows <= MAX_TASKS:
        row = 0 if not table.rows else MAX_TASKS
        raise table.error(row, "", f"expected 1 to {MAX_TASKS} tasks, got {table.rows}")
    q = table.numbers(angles)
    unit = angles[0].rsplit("_", 1)[1]
    q = np.deg2rad(q) if unit == "deg" else q
    check_limits(path, cell.arm, q, unit=unit)
    for line, pair in enumerate(collisions(cell.room, q), start=2):
        if pair:
            raise InputError(path, f"line {line}", f"{pair[0]} collides with {pair[1]} in this pose")
    return Tasks(q, _read_load(table, hung))


def _check_header(table: Table, arm: Arm) -> list[str]:
    """The columns of the angles, all in one unit."""
    path, header = table.path, table.columns.keys()
    radians, degrees = ([f"{j.name}_{unit}" for j in arm.joints] for unit in ("rad", "deg"))
    angles = degrees if header & set(degrees) else radians
    groups = [group for group in (FORCE, MOMENT, POINT) if header & set(group)]
    expected = {*angles, *(name for group in groups for name in group)}
    if header != expected:
        raise InputError(
            path,
            "line 1",
            f"expected the columns {','.join(radians)} or all of them in _deg, and if wanted all of "
            f"{','.join(FORCE)}, of {','.join(MOMENT)} and of {','.join(POINT)}, got {','.join(header)}",
        )
    if groups == [POINT]:
        raise InputError(path, "line 1", f"expected {','.join(FORCE)} where {','.join(POINT)} are given")
    return angles


def _read_load(table: Table, hung: Load) -> Load:
    """The load of every task."""

    def three(names: list[str], default: Array) -> Array:
        if names[0] not in table.columns:
            return np.tile(default, (table.rows, 1))
        values = table.numbers(names)
        most = FARTHEST[names[0].split("_")[0]]
        far = np.argwhere(np.abs(values) > most)
        if len(far):
            i, k = far[0]
            raise table.error(i, names[k], f"expected {-most:g} to {most:g}, got {values[i, k]:g}")
        return values

    if not {FORCE[0], MOMENT[0]} & table.columns.keys():
        return Load(np.tile(hung.wrench, (table.rows, 1)), np.tile(hung.point, (table.rows, 1)))
    wrench = np.hstack([three(FORCE, np.zeros(3)), three(MOMENT, np.zeros(3))])
    idle = np.flatnonzero(~wrench.any(axis=1))
    if len(idle):
        raise table.error(idle[0], "", "expected a load, got zero force and moment")
    return Load(wrench, three(POINT, hung.point))


def read_payload(path: Path) -> Array | None:
    """Hung mass of every run of a plan, (runs,) [kg]; None for poses without column load_kg.

    Raises:
        InputError: When one is no number, or no weight that could be meant.
    """
    table = read_table(path)
    if "load_kg" not in table.columns:
        return None
    mass = table.numbers(["load_kg"])[:, 0]
    low, high = LOAD_RANGE
    bad = np.flatnonzero((mass < low) | (mass > high))
    if len(bad):
        problem = f"expected {low:g} to {high:g}, got {mass[bad[0]]:g}"
        raise table.error(bad[0], "load_kg", problem)
    return mass


def write_plan(report: Report, path: Path) -> None:
    """plan.csv: `csvfile.plan_columns`; radians in full, so that reading gives them back bit by bit.

    Args:
        report: As `plan_report.report` makes it.
        path: The file.
    """
    rows = [
        [
            row["run"],
            *map(repr, row["q_rad"]),
            *(f"{angle:.4f}" for angle in row["q_deg"]),
            repr(row["load_kg"]),
            *(f"{row[key]:.4f}" for key in ("expected_deflection_mm", *ERRORS)),
            f"{row['travel_deg']:.2f}",
            row["way"],
        ]
        for row in report["plan"]
    ]
    _write(plan_columns(tuple(report["joints"])), rows, path)


ERRORS = ("expected_error_mm", "expected_error_p05_mm", "expected_error_p95_mm")


def write_tasks(report: Report, path: Path) -> None:
    """tasks_expected.csv: of every task its pose and the error to expect.

    Args:
        report: As `plan_report.report` makes it.
        path: The file.
    """
    rows = [
        [
            row["task"],
            *(f"{angle:.4f}" for angle in row["q_deg"]),
            *(f"{row[key]:.4f}" for key in ("expected_deflection_mm", *ERRORS)),
        ]
        for row in report["tasks"]
    ]
    head = ["task", *(f"{joint}_deg" for joint in report["joints"]), "expected_deflection_mm", *ERRORS]
    _write(head, rows, path)


def _write(head: list[str], rows: list[list[object]], path: Path) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([head, *rows])
    files.write_whole(text.getvalue(), path)


def write_all(cell: Cell, planned: Planned, report: Report, *, arm: Path, task: Path, out: Path) -> None:
    """The folder of a plan, all of it or nothing.

    Args:
        cell: The arm.
        planned: The plan and what it promises.
        report: The same as `plan_report.report` makes it.
        arm: Folder of the arm.
        task: File of the tasks.
        out: Folder to write.

    Raises:
        InputError: When it cannot be written.
    """
    from testbench.views import (
        plan_recording,
        recording,  # here: importing rerun takes a third of a second
    )

    wished = {"task": task.name, **{key: report[key] for key in WISHED}}
    with files.whole_folder(out) as folder:
        write_plan(report, folder / "plan.csv")
        write_tasks(report, folder / "tasks_expected.csv")
        files.write_json(report, folder / "plan.json")
        (folder / "plan.md").write_text(plan_page.markdown(report), encoding="utf-8")
        figures_plan.overview(report, chain(cell.vjm, planned.found.q).position, folder / "plan.png")
        scene = plan_recording.scene(cell, planned, report, wished)
        recording.write_plan(folder / "recording.rrd", scene)
        files.write_manifest(
            folder, command="testbench plan", scenario=wished, seed=planned.wish.seed, seeds=1, arms=[arm]
        )


def parse_station(text: str, acceptance: float | None) -> Station:
    """The tracker of an option.

    Args:
        text: x,y,z [m].
        acceptance: Half angle in which fixed targets return the beam [deg]; None for targets turned by hand.

    Raises:
        BenchError: When it is not three numbers, or no place for a tracker.
    """
    x, y, z = parse_numbers(text, 3, "--tracker x,y,z [m]")
    return Station((x, y, z), acceptance=None if acceptance is None else math.radians(acceptance))


def parse_box(text: str) -> WorkArea:
    """The work area of an option, x0,y0,z0,x1,y1,z1 [m].

    Raises:
        BenchError: When it is not six numbers, or the second corner does not lie beyond the first.
    """
    x0, y0, z0, x1, y1, z1 = parse_numbers(text, 6, "--box x0,y0,z0,x1,y1,z1 [m]")
    if not (x0 < x1 and y0 < y1 and z0 < z1):
        raise BenchError(f"--box x0,y0,z0,x1,y1,z1 [m]: expected the lower corner first, got {text[:80]!r}")
    return WorkArea((x0, y0, z0), (x1, y1, z1))


def parse_numbers(text: str, count: int, what: str) -> tuple[float, ...]:
    """Numbers of an option, such as 4.5,-2.5,1.6.

    Args:
        text: Numbers with commas between them.
        count: How many are expected.
        what: The option and what it means, such as "--tracker x,y,z [m]".

    Raises:
        BenchError: When it is not so many finite numbers.
    """
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count or not all(map(math.isfinite, values)):
        raise BenchError(f"{what}: expected {count} numbers with commas between them, got {text[:80]!r}")
    return values
