"""Absolute readings of a table put together: those of several targets at one time are one row."""

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.columns import Columns
from testbench.data.conditions import Conditions, number_rows
from testbench.data.dataset import Ids
from testbench.data.names import ROTATIONS, Slot
from testbench.data.pairing import HELD, repeats
from testbench.data.series import Series, select_rows
from testbench.data.series_beside import read_temperature, read_time, read_torques
from testbench.data.series_rotation import read_rotations
from testbench.data.series_scatter import Scatter
from testbench.data.sightings import Sightings
from testbench.errors import Array

TURNED_APART = 1e-6  #: Difference of two orientations up to which they are one [1].
TOLD = 5  #: Most lines that a note lists.


def assemble(
    columns: Columns, arm: Arm, conditions: Conditions, seen: Sightings, scatter: Scatter
) -> tuple[Series, Ids, list[str]]:
    """All rows of a file as one series without a name, each with a covariance.

    Returns:
        The series, the first row of the table of each of its rows, and what was left out.

    Raises:
        InputError: Names line and column.
    """
    table, m = columns.table, len(seen.markers)
    code = _readings(columns, conditions, seen) if seen.long and m > 1 else np.arange(table.rows)
    first = np.unique(code, return_index=True)[1]
    position = np.full((len(first), m, 3), np.nan)
    position[code[seen.row], seen.marker] = seen.position
    lost = np.isnan(position).any(axis=2)
    P = np.zeros((len(first), m, 3, 3))
    P[code[seen.row], seen.marker] = _precision(scatter)[seen.row]
    P[lost] = 0
    temperature, warm = read_temperature(columns)
    time, timed = read_time(columns)
    torque, rotation = read_torques(columns, arm), read_rotations(columns)
    whole = Series(
        name="",
        markers=seen.markers,
        frame="",
        target="",
        row=table.lines[first] if conditions.run is None else conditions.run[first],
        pose=conditions.pose[first],
        q=conditions.q[first],
        wrench=conditions.wrench[first],
        point=conditions.point[first],
        position=np.where(lost[..., None], 0.0, position),
        sigma=float(np.median(scatter.sigma)),
        precision=P,
        rotation=None if rotation is None else _one_each(columns, rotation, code, first),
        sigma_rotation=None if rotation is None else float(np.median(scatter.sigma_rotation)),
        torque=None if torque is None else torque[first],
        temperature=None if temperature is None else temperature[first],
        time=None if time is None else time[first],
    )
    read = whole.seen.any(axis=1) | whole.turned
    if not read.any():
        raise table.error(0, "", "expected at least one reading, all are blank")
    return select_rows(whole, read), first[read], [*warm, *timed, *_left_out(table.lines[first[~read]])]


def _left_out(lines: Ids) -> list[str]:
    if not len(lines):
        return []
    places = ", ".join(map(str, lines[:TOLD].tolist())) + (", ..." if len(lines) > TOLD else "")
    return [f"{len(lines)} rows without a reading are left out, of line {places}"]


def _readings(columns: Columns, conditions: Conditions, seen: Sightings) -> Ids:
    """Rows of one pose and load as one reading, each target once, (rows,): numbers as they first appear."""
    table = columns.table
    marker = np.empty(table.rows, dtype=int)
    marker[seen.row] = seen.marker
    parts: list[Array | Ids] = [conditions.wrench, conditions.point, conditions.pose[:, None]]
    parts += [ids[:, None] for ids in (conditions.run, conditions.station) if ids is not None]
    for slot in (Slot("series"), Slot("series_frame"), Slot("series_target"), Slot("state")):
        column = columns.get(slot)
        if column is not None:
            parts.append(np.unique(table.texts(column.index), return_inverse=True)[1].reshape(-1, 1))
    code = number_rows(np.column_stack([number_rows(part)[:, None] for part in parts]))
    code = number_rows(np.column_stack([code, repeats(np.column_stack([code, marker]))]))
    leader = np.unique(code, return_index=True)[1][code]
    moved = np.abs(conditions.q - conditions.q[leader]).max(axis=1)
    bad = np.flatnonzero(moved > HELD)
    if len(bad):
        line, by = table.lines[leader[bad[0]]], f"{moved[bad[0]]:.2g}"
        problem = f"expected the joints of the same reading in line {line}, one differs by {by} rad or m"
        raise table.error(bad[0], "", problem)
    return code


def _precision(scatter: Scatter) -> Array:
    """Inverse covariance of the positions in every row of the table, (rows, 3, 3) [1/m^2]."""
    if scatter.covariance is None:
        return np.asarray(np.eye(3) / scatter.sigma[:, None, None] ** 2)
    P = np.linalg.inv(scatter.covariance)
    return np.asarray((P + P.swapaxes(1, 2)) / 2)


def _one_each(columns: Columns, rotation: Array, code: Ids, first: Ids) -> Array:
    """The orientation of every reading, (readings, 3, 3), which all its rows say; NaN where none does."""
    there = np.asarray(np.isfinite(rotation).all(axis=(1, 2)))
    leader = np.full(len(first), -1)
    rows = np.flatnonzero(there)[::-1]
    leader[code[rows]] = rows  # the first one is written last
    found = np.where((leader >= 0)[:, None, None], rotation[leader], np.nan)
    differs = np.abs(rotation - found[code]).max(axis=(1, 2)) > TURNED_APART  # NaN differs from nothing
    if differs.any():
        row = int(np.flatnonzero(differs)[0])
        name = columns.every(*ROTATIONS)[0].name
        raise columns.table.error(row, name, "expected the orientation of the other rows of the reading")
    return found
