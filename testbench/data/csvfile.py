"""Measured runs as CSV: a row is one marker of one run, the unit is in the column's name.

Numbers are written in full, so that reading gives them back bit by bit. `columns` is the documented header.
"""

import csv
import io
from pathlib import Path

import numpy as np

from testbench import files
from testbench.arm.folder import Arm
from testbench.data.dataset import Dataset, Ids, Mask
from testbench.data.posefile import XYZ, check_limits
from testbench.data.table import Table, read_table
from testbench.errors import Array, BenchError, InputError

READINGS = [f"{when}_{x}_m" for when in ("before", "after") for x in XYZ]
ENTRIES = {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}
COVARIANCES = [f"deflection_cov_{name}_m2" for name in ENTRIES]
TURNED = [f"rotation_{when}_{x}_rad" for when in ("before", "after") for x in XYZ] + ["sigma_rad"]
SIGMA_RANGE = (1e-9, 1e-2)
"""Standard deviations that an instrument can have [m, rad]: beyond them a unit is wrong."""


def columns(arm: Arm | tuple[str, ...], *, rotation: bool, covariance: bool = False) -> list[str]:
    """The header of the CSV file, in order.

    run, pose: integers. marker: its name in the arm. JOINT_rad: joint angle, JOINT_m of a slide. force_*_N,
    moment_*_Nm: load, world axes. point_*_m: where it acts, tool's frame. before_*_m, after_*_m: readings,
    world axes. sigma_m: standard deviation of one reading along one axis, the same in all rows.

    With `rotation` orientations are read: rotation_before_*_rad, rotation_after_*_rad (rotation vectors,
    world axes, the same for every marker of a run) and sigma_rad. With `covariance` every reading has one of
    its own: deflection_cov_*_m2, of both readings together, world axes; a lost target leaves them and its
    readings empty.
    """
    names = ["run", "pose", "marker", *_joints(arm), *_load(), *READINGS, "sigma_m"]
    return names + TURNED * rotation + COVARIANCES * covariance


def _joints(arm: Arm | tuple[str, ...]) -> list[str]:
    return [j.column for j in arm.joints] if isinstance(arm, Arm) else [f"{name}_rad" for name in arm]


def _load() -> list[str]:
    return [pattern.format(x) for pattern in ("force_{}_N", "moment_{}_Nm", "point_{}_m") for x in XYZ]


def write_csv(data: Dataset, arm: Arm | tuple[str, ...], path: str | Path) -> None:
    """Write the dataset; an existing file is replaced only by a whole one.

    Args:
        data: The runs.
        arm: The arm that was measured, or the names of its hinges: they head the columns.
        path: The file.

    Raises:
        BenchError: When the names are not as many as the joint angles.
        InputError: When the file cannot be written.
    """
    joints = _joints(arm)
    if len(joints) != data.q.shape[1]:
        raise BenchError(f"joints: expected {data.q.shape[1]} names, got {joints}")
    m, turned, P = len(data.markers), data.rotation_before is not None, data.precision
    header = columns(arm, rotation=turned, covariance=P is not None)
    parts = [np.repeat(a, m, axis=0) for a in (data.q, data.wrench, data.point)]
    parts += [a.reshape(-1, 3) for a in (data.before, data.after)] + [np.full((data.points, 1), data.sigma)]
    if data.rotation_before is not None and data.rotation_after is not None:
        parts += [np.repeat(a, m, axis=0) for a in (data.rotation_before, data.rotation_after)]
        parts += [np.full((data.points, 1), data.sigma_rotation)]
    if P is not None:
        C = np.linalg.inv(np.where(data.seen[..., None, None], P, np.eye(3))).reshape(-1, 3, 3)
        parts += [C[:, a, b, None] for a, b in ENTRIES.values()]
    lines = [list(map(repr, row)) for row in np.hstack(parts).tolist()]
    for row in np.flatnonzero(~data.seen):
        for name in READINGS + COVARIANCES:
            lines[row][header.index(name) - 3] = ""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    ids = zip(np.repeat(data.run, m), np.repeat(data.pose, m), data.markers * data.runs, strict=True)
    writer.writerows([*own, *line] for own, line in zip(ids, lines, strict=True))
    files.write_whole(text.getvalue(), Path(path))


def read_csv(path: str | Path, arm: Arm) -> Dataset:
    """Read and check a dataset of an arm.

    Args:
        path: The file; `columns` documents its header.
        arm: The arm that was measured.

    Returns:
        Readings before and after loading, with poses and loads.

    Raises:
        InputError: Names the line and what was expected.
    """
    path = Path(path)
    table, joints = read_table(path), _joints(arm)
    turned, covariance = (not table.columns.keys().isdisjoint(own) for own in (TURNED, COVARIANCES))
    _check_header(table, columns(arm, rotation=turned, covariance=covariance))
    markers = _markers(table, arm)
    m, n = len(markers), len(joints)
    run, pose = _check_runs(table, markers)
    lost = _lost(table) if covariance else None
    readings = table.numbers(READINGS, lost)
    once = _once(table, arm, m, [*joints, *_load(), "sigma_m", *TURNED * turned])
    return Dataset(
        markers=markers,
        run=run,
        pose=pose,
        q=once[:, :n],
        wrench=once[:, n : n + 6],
        point=once[:, n + 6 : n + 9],
        before=readings[:, :3].reshape(-1, m, 3),
        after=readings[:, 3:].reshape(-1, m, 3),
        sigma=float(once[0, n + 9]),
        rotation_before=once[:, n + 10 : n + 13] if turned else None,
        rotation_after=once[:, n + 13 : n + 16] if turned else None,
        sigma_rotation=float(once[0, n + 16]) if turned else None,
        precision=None if lost is None else _precision(table, lost).reshape(-1, m, 3, 3),
    )


def _check_header(table: Table, expected: list[str]) -> None:
    unknown = [name for name in table.columns if name not in expected]
    missing = [name for name in expected if name not in table.columns]
    if missing or unknown:
        problem = f"missing columns {missing}, unknown columns {unknown}"
        raise InputError(table.path, "line 1", f"{problem}; expected {','.join(expected)}")
    if not table.rows:
        raise table.error(0, "", "expected at least one row")


def _markers(table: Table, arm: Arm) -> tuple[str, ...]:
    """Markers in the order of their first rows."""
    for row, name in enumerate(table.columns["marker"]):
        if name not in arm.markers:
            have = ", ".join(arm.markers)
            raise table.error(row, "marker", f"no marker {name[:80]!r} in {arm.name}; markers are {have}")
    return tuple(dict.fromkeys(table.columns["marker"]))


def _check_runs(table: Table, markers: tuple[str, ...]) -> tuple[Ids, Ids]:
    """Run and pose of every run: it lists every marker once, in the same order, on consecutive lines."""
    m, name = len(markers), table.columns["marker"]
    ids = np.column_stack([table.integers("run"), table.integers("pose")])
    for row in range(0, table.rows, m):
        if name[row : row + m] != markers or (ids[row : row + m] != ids[row]).any():
            each = f"expected one line for each of {', '.join(markers)} in this order"
            raise table.error(row, "", f"run {ids[row, 0]}: {each}")
    run, pose = ids[::m].T
    again = np.setdiff1d(np.arange(len(run)), np.unique(run, return_index=True)[1])
    if len(again):
        raise table.error(again[0] * m, "", f"run {run[again[0]]} stands in the file twice")
    return run, pose


def _once(table: Table, arm: Arm, m: int, names: list[str]) -> Array:
    """Columns that are the same in all m rows of a run, (runs, names)."""
    values = table.numbers(names)
    check_limits(table.path, arm, values[:, : len(arm.joints)])
    differs = np.argwhere(values != np.repeat(values[::m], m, axis=0))
    if len(differs):
        row, k = differs[0]
        raise table.error(row, names[k], "expected the same value in every row of the run")
    low, high = SIGMA_RANGE
    for k in (names.index(name) for name in ("sigma_m", "sigma_rad") if name in names):
        other = np.flatnonzero(values[:, k] != values[0, k])
        if len(other):
            raise table.error(other[0], names[k], "expected one value in the whole file")
        if not low <= values[0, k] <= high:
            raise table.error(0, names[k], f"expected {low:g} to {high:g}, got {values[0, k]:g}")
    return values[::m]


def _lost(table: Table) -> Mask:
    """Rows whose readings and covariances are all empty."""
    cells = zip(*(table.columns[name] for name in READINGS + COVARIANCES), strict=True)
    return np.array([not any(text.strip() for text in row) for row in cells])


def _precision(table: Table, lost: Mask) -> Array:
    """Inverse covariances, (rows, 3, 3) [1/m^2]; zero where the target was lost."""
    entries = table.numbers(COVARIANCES, lost)
    C = np.tile(np.eye(3), (table.rows, 1, 1))
    for k, (a, b) in enumerate(ENTRIES.values()):
        C[~lost, a, b] = C[~lost, b, a] = entries[~lost, k]
    bad = np.flatnonzero(~(np.linalg.eigvalsh(C)[:, 0] > 0))
    if len(bad):
        problem = f"expected a positive definite covariance, got {C[bad[0]].tolist()} m^2"
        raise table.error(bad[0], "", problem)
    P = np.linalg.inv(C)
    P[lost] = 0
    return np.asarray((P + P.swapaxes(1, 2)) / 2)
