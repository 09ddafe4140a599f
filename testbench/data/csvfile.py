"""CSV in and out: measured runs, and poses to measure.

In a dataset file a row is one marker of one run; the unit is in the column's name; numbers are written in
full, so that reading gives them back bit by bit. `columns(...)` is the documented header, `plan_columns(...)`
that of a plan, whose poses can be read like any others.
"""

import csv
import io
from dataclasses import replace
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.data import csvprecision
from testbench.data.csvcells import integer, number, read_lines, write_whole
from testbench.data.dataset import Dataset, Ids
from testbench.errors import Array, BenchError, InputError

XYZ = ("x", "y", "z")
SIGMA_RANGE = (1e-9, 1e-2)
"""Standard deviations that an instrument can have [m, rad]: beyond them a unit is wrong."""
SAME_ANGLE = 1e-3
"""Difference between an angle in radians and the same in degrees that rounding explains [deg]."""


def columns(joints: tuple[str, ...], *, rotation: bool) -> list[str]:
    """The header of the CSV file, in order.

    run, pose: integers. marker: its name in the arm. JOINT_rad: joint angle. force_*_N, moment_*_Nm: load,
    world axes. point_*_m: where it acts, tool's frame. before_*_m, after_*_m: readings, world axes. sigma_m:
    standard deviation of one reading along one axis, the same in all rows. Where orientations are read too:
    rotation_before_*_rad, rotation_after_*_rad (rotation vectors, world axes, the same for every marker of a
    run) and sigma_rad. Where every reading has a covariance of its own, the six columns of
    csvprecision.COLUMNS follow; a lost target leaves them and its readings empty.

    Args:
        joints: Names of the arm's joints.
        rotation: Whether orientations are read.
    """
    names = ["run", "pose", "marker", *(f"{j}_rad" for j in joints)]
    names += [f"force_{x}_N" for x in XYZ] + [f"moment_{x}_Nm" for x in XYZ]
    names += [f"{what}_{x}_m" for what in ("point", "before", "after") for x in XYZ] + ["sigma_m"]
    if rotation:
        names += [f"rotation_{when}_{x}_rad" for when in ("before", "after") for x in XYZ]
        names += ["sigma_rad"]
    return names


def plan_columns(joints: tuple[str, ...]) -> list[str]:
    """The header of a plan, in order; a row is a run, in the order of measuring.

    run: integer. JOINT_rad, JOINT_deg: joint angle, twice. load_kg: hung mass. expected_deflection_mm: RMS
    over the markers, by the prior. expected_error_*_mm: of predicting it after identification, with the 5th
    and 95th percentile. travel_deg: of the joint that turns farthest from the run before. way: "start",
    "clear" where all joints can go straight, "via" where that way collides.

    Args:
        joints: Names of the arm's joints.
    """
    names = ["run", *(f"{j}_rad" for j in joints), *(f"{j}_deg" for j in joints), "load_kg"]
    names += [f"expected_{what}_mm" for what in ("deflection", "error", "error_p05", "error_p95")]
    return [*names, "travel_deg", "way"]


def write_csv(data: Dataset, joints: tuple[str, ...], path: Path) -> None:
    """Write the dataset; an existing file is replaced only by a whole one.

    Args:
        data: The runs.
        joints: Names of the arm's joints, for the header.
        path: The file.

    Raises:
        BenchError: When the names are not as many as the joint angles.
        InputError: When the file cannot be written.
    """
    if len(joints) != data.q.shape[1]:
        raise BenchError(f"joints: expected {data.q.shape[1]} names, got {list(joints)}")
    m = len(data.markers)
    rotation = data.rotation_before is not None
    parts = [np.repeat(a, m, axis=0) for a in (data.q, data.wrench, data.point)]
    parts += [a.reshape(-1, 3) for a in (data.before, data.after)]
    parts += [np.full((data.points, 1), data.sigma)]
    if data.rotation_before is not None and data.rotation_after is not None:
        parts += [np.repeat(a, m, axis=0) for a in (data.rotation_before, data.rotation_after)]
        parts += [np.full((data.points, 1), data.sigma_rotation)]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    header = columns(joints, rotation=rotation)
    lines = [list(map(repr, row)) for row in np.hstack(parts).tolist()]
    if data.precision is not None:
        header += csvprecision.COLUMNS
        lines = _with_precision(lines, data, header.index("before_x_m") - 3)
    writer.writerow(header)
    ids = zip(np.repeat(data.run, m), np.repeat(data.pose, m), data.markers * data.runs, strict=True)
    for (run, pose, marker), row in zip(ids, lines, strict=True):
        writer.writerow([run, pose, marker, *row])
    write_whole(text.getvalue(), path)


def _with_precision(lines: list[list[str]], data: Dataset, first: int) -> list[list[str]]:
    """Rows with their covariances behind; the six readings from column `first` on are empty where lost."""
    assert data.precision is not None
    cells = csvprecision.cells(data.precision.reshape(-1, 3, 3))
    for line, own, seen in zip(lines, cells, data.seen.ravel(), strict=True):
        if not seen:
            line[first : first + 6] = [""] * 6
        line += own
    return lines


def read_csv(path: Path, arm: Arm) -> Dataset:
    """Read and check a dataset of an arm.

    Args:
        path: The file; `columns` documents its header.
        arm: The arm that was measured.

    Raises:
        InputError: Names the line and what was expected.
    """
    header, lines, precision = csvprecision.take_out(path, *read_lines(path))
    joints = tuple(j.name for j in arm.joints)
    plain, full = columns(joints, rotation=False), columns(joints, rotation=True)
    rotation = not set(header).isdisjoint(set(full) - set(plain))
    expected = full if rotation else plain
    unknown = [name for name in header if name not in expected]
    missing = [name for name in expected if name not in header]
    twice = [name for name in expected if header.count(name) > 1]
    if twice:
        raise InputError(path, "line 1", f"expected every column once, got {twice} more than once")
    if missing or unknown:
        problem = f"missing columns {missing}, unknown columns {unknown}"
        raise InputError(path, "line 1", f"{problem}; expected {','.join(expected)}")
    if not lines:
        raise InputError(path, "line 2", "expected at least one row")
    order = [header.index(name) for name in expected]
    lines = [[line[k] for k in order] for line in lines]
    marker = [line[2] for line in lines]
    for line, name in enumerate(marker, start=2):
        if name not in arm.markers:
            have = ", ".join(arm.markers)
            problem = f"no marker {name[:80]!r} in {arm.name}; markers are {have}"
            raise InputError(path, f"line {line}, column marker", problem)
    markers = tuple(dict.fromkeys(marker))
    ids, values = _numbers(path, expected, lines)
    _check_runs(path, ids, marker, markers)
    check_limits(path, arm, values[:, : len(joints)])
    data = _assemble(path, expected, len(joints), markers, ids, values, rotation)
    if precision is None:
        return data
    return replace(data, precision=precision.reshape(data.runs, len(markers), 3, 3))


def _numbers(path: Path, names: list[str], lines: list[list[str]]) -> tuple[Ids, Array]:
    """Run and pose identifiers, (rows, 2), and all other numbers, (rows, columns)."""
    ids = np.empty((len(lines), 2), dtype=int)
    values = np.empty((len(lines), len(names) - 3))
    for i, line in enumerate(lines):
        for k in (0, 1):
            ids[i, k] = integer(path, i + 2, names[k], line[k])
        for k in range(3, len(names)):
            values[i, k - 3] = number(path, i + 2, names[k], line[k])
    return ids, values


def _check_runs(path: Path, ids: Ids, marker: list[str], markers: tuple[str, ...]) -> None:
    """Every run lists every marker once, in the same order, on consecutive lines."""
    m = len(markers)
    for i in range(0, len(ids), m):
        block = marker[i : i + m]
        if tuple(block) != markers or (ids[i : i + m] != ids[i]).any():
            raise InputError(
                path,
                f"line {i + 2}",
                f"run {ids[i, 0]}: expected one line for each of {', '.join(markers)} in this order",
            )
    runs = ids[::m, 0]
    _, first = np.unique(runs, return_index=True)
    again = np.setdiff1d(np.arange(len(runs)), first)
    if len(again):
        raise InputError(path, f"line {again[0] * m + 2}", f"run {runs[again[0]]} stands in the file twice")


def check_limits(path: Path, arm: Arm, q: Array, *, unit: str = "rad") -> None:
    """Joint angles lie within the arm's limits; if not, degrees are the first suspect.

    Args:
        path: The file, a row of it a row of q.
        arm: The arm that is to take them.
        q: Joint angles, (rows, n) [rad].
        unit: That of the file, "rad" or "deg".

    Raises:
        InputError: Names line and joint.
    """
    lower, upper = arm.limits
    bad = np.argwhere((q < lower - 1e-6) | (q > upper + 1e-6))
    if len(bad):
        i, k = bad[0]
        joint = arm.joints[k]
        hint = "; are these degrees?" if unit == "rad" and np.abs(q).max() > 2.5 * np.pi else ""
        scale = 1.0 if unit == "rad" else 180 / np.pi
        lower, upper, got = scale * joint.lower, scale * joint.upper, scale * q[i, k]
        raise InputError(
            path,
            f"line {i + 2}, column {joint.name}_{unit}",
            f"expected {lower:.4f} to {upper:.4f} {unit}, got {got:g}{hint}",
        )


def _assemble(
    path: Path,
    names: list[str],
    n: int,
    markers: tuple[str, ...],
    ids: Ids,
    values: Array,
    rotation: bool,
) -> Dataset:
    m = len(markers)
    once = [*range(n + 9), *range(n + 15, values.shape[1])]  # all but the readings of a marker
    differs = np.argwhere(values[:, once].reshape(-1, m, len(once)) != values[::m][:, None, once])
    if len(differs):
        i, j, k = differs[0]
        place = f"line {i * m + j + 2}, column {names[3 + once[k]]}"
        raise InputError(path, place, "expected the same value in every row of the run")
    sigmas = [names.index("sigma_m") - 3] + ([names.index("sigma_rad") - 3] if rotation else [])
    for k in sigmas:
        other = np.flatnonzero(values[:, k] != values[0, k])
        if len(other):
            place = f"line {other[0] + 2}, column {names[k + 3]}"
            raise InputError(path, place, "expected one value in the whole file")
        if not SIGMA_RANGE[0] <= values[0, k] <= SIGMA_RANGE[1]:
            place, (low, high) = f"line 2, column {names[k + 3]}", SIGMA_RANGE
            raise InputError(path, place, f"expected {low:g} to {high:g}, got {values[0, k]:g}")
    first = values[::m]
    turned = first[:, n + 16 : n + 22] if rotation else None
    return Dataset(
        markers=markers,
        run=ids[::m, 0],
        pose=ids[::m, 1],
        q=first[:, :n],
        wrench=first[:, n : n + 6],
        point=first[:, n + 6 : n + 9],
        before=values[:, n + 9 : n + 12].reshape(-1, m, 3),
        after=values[:, n + 12 : n + 15].reshape(-1, m, 3),
        sigma=float(values[0, n + 15]),
        rotation_before=None if turned is None else turned[:, :3],
        rotation_after=None if turned is None else turned[:, 3:],
        sigma_rotation=float(values[0, n + 22]) if rotation else None,
    )


def read_poses(path: Path, arm: Arm) -> Array:
    """Read joint angles, one pose a row, one column JOINT_rad for every joint; a plan's others may be there.

    Args:
        path: The file.
        arm: The arm that is to take them.

    Returns:
        (poses, n) [rad], within the arm's limits.

    Raises:
        InputError: Names the line and what was expected.
    """
    header, lines = read_lines(path)
    joints = tuple(j.name for j in arm.joints)
    expected, known = [f"{j}_rad" for j in joints], plan_columns(joints)
    if not set(expected) <= set(header) <= set(known) or len(set(header)) < len(header):
        problem = f"expected the columns {','.join(expected)} or those of a plan, got {','.join(header)}"
        raise InputError(path, "line 1", problem)
    if not lines:
        raise InputError(path, "line 2", "expected at least one pose")
    q = np.transpose([column(path, header, lines, name) for name in expected])
    for k, joint in enumerate(joints):
        if f"{joint}_deg" in header:
            _check_same(path, joint, q[:, k], column(path, header, lines, f"{joint}_deg"))
    check_limits(path, arm, q)
    return q


def column(path: Path, header: list[str], lines: list[list[str]], name: str) -> Array:
    """One column of numbers, (rows,).

    Raises:
        InputError: When one is none, or not finite; names line and column.
    """
    k = header.index(name)
    return np.array([number(path, i, name, line[k]) for i, line in enumerate(lines, start=2)])


def _check_same(path: Path, joint: str, radians: Array, degrees: Array) -> None:
    """A plan has every angle twice: whoever edits one of them must not be overheard."""
    apart = np.flatnonzero(np.abs(np.rad2deg(radians) - degrees) > SAME_ANGLE)
    if len(apart):
        i = apart[0]
        raise InputError(
            path,
            f"line {i + 2}, columns {joint}_rad and {joint}_deg",
            f"expected the same angle twice, got {np.rad2deg(radians[i]):.4f} and {degrees[i]:g} deg",
        )
