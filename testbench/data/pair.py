"""Runs made of single readings: each loaded reading with the unloaded one that belongs to it."""

from bisect import bisect_left
from dataclasses import dataclass

import numpy as np

from testbench.data.rows import SAME_POSE, Conditions, Readings, first_rows, number_rows, repeats
from testbench.data.table import Table
from testbench.errors import Array, Ids

HELD = 2e-4
"""Difference of joint coordinates between the readings of a run that is let pass, and said [rad, m]."""


@dataclass(frozen=True)
class Paired:
    """The readings of every run."""

    row: Ids  #: A row of the table with the run's conditions, (runs,).
    run: Ids  #: Identifier, (runs,).
    leader: Ids  #: Of every row one that has the same conditions, (rows,).
    before: Array  #: (runs, m, 3) [m]; NaN where the target was lost or has no reading.
    after: Array  #: (runs, m, 3) [m]; the same.
    notes: tuple[str, ...]  #: What was assumed.


def pair(table: Table, conditions: Conditions, read: Readings) -> Paired:
    """The runs of a table.

    Raises:
        InputError: Names the line and what was expected.
    """
    marker = np.zeros(table.rows, dtype=int)
    if read.long:
        marker[read.row] = read.marker
    if read.paired:
        return _in_one_row(table, conditions, read, marker)
    return _state_by_state(table, conditions, read, marker)


def _in_one_row(table: Table, conditions: Conditions, read: Readings, marker: Ids) -> Paired:
    """Both states stand in a row: of all targets, or of one."""
    if conditions.run is not None:
        of_row = number_rows(conditions.run[:, None])
    elif read.long:
        of_row = _repeated(table, number_rows(_load_key(conditions)), marker)
    else:
        of_row = np.arange(table.rows)
    first = first_rows(of_row)
    run = np.arange(len(first)) + 1 if conditions.run is None else conditions.run[first]
    again = repeats(np.column_stack([of_row, marker])) > 0
    table.refuse(again, "", lambda row: f"run {run[of_row[row]]} stands in the file twice")
    if read.long:
        short = np.bincount(of_row) < len(read.markers)
        each = f"expected one line for each of {', '.join(read.markers)}; those of a lost target are blank"
        for k in np.flatnonzero(short)[:1]:
            raise table.error(first[k], "", f"run {run[k]}: {each}")
    before, after = (_placed(read, of_row, len(first), after=state) for state in (False, True))
    notes = () if conditions.run is not None else (f"runs are numbered in their order: {len(first)} of them",)
    return Paired(first, run, first[of_row], before, after, notes)


def _state_by_state(table: Table, conditions: Conditions, read: Readings, marker: Ids) -> Paired:
    """A row is of one state; an unloaded reading serves its own run, or all loads of its pose."""
    rows, loaded, run = np.arange(table.rows), np.zeros(table.rows, dtype=bool), conditions.run
    loaded[read.row] = read.after
    if loaded.all() or not loaded.any():
        have = "loaded" if loaded.any() else "unloaded"
        raise table.error(0, "", f"expected unloaded and loaded readings, all are {have}")
    ids = [own for own in (conditions.pose, conditions.station, run) if own is not None]
    of_load = [_load_key(conditions), *([] if run is None else [run])]
    keys = np.column_stack(ids), np.column_stack(of_load)
    (idle_code, idle_row), (code, row) = (
        _grouped(table, rows[own], key, marker, counted=run is None)
        for own, key in zip((~loaded, loaded), keys, strict=True)
    )
    unloaded = _belongs(table, conditions, idle_row, row)
    held = _check_held(table, conditions.q, row, idle_row[unloaded])
    leader, of_row = rows.copy(), np.full(table.rows, -1)
    leader[~loaded], leader[loaded] = idle_row[idle_code], row[code]
    of_row[~loaded], of_row[loaded] = idle_code, code
    before = _placed(read, of_row, len(idle_row), after=False)[unloaded]
    notes = list[str]()
    if run is None or len(np.unique(run[row])) < len(row):
        notes = [f"runs, one a load, are numbered in their order: {len(row)} of them"]
    number = np.arange(len(row)) + 1 if notes or run is None else run[row]
    notes += [*held, *_notes(table, idle_row, unloaded)]
    return Paired(row, number, leader, before, _placed(read, of_row, len(row), after=True), tuple(notes))


def _grouped(table: Table, own: Ids, key: Array | Ids, marker: Ids, *, counted: bool) -> tuple[Ids, Ids]:
    """Readings of one state as groups, one reading of each marker: a number each, and first rows.

    Args:
        table: The cells.
        own: Rows of the state.
        key: What readings of a group share, (rows, columns).
        marker: Index of the marker, (rows,).
        counted: Whether a marker that comes again begins another group, as no column says the run.
    """
    code = number_rows(key[own])
    if counted:
        code = _repeated(table, code, marker[own])
    for k in np.flatnonzero(repeats(np.column_stack([code, marker[own]])))[:1]:
        raise table.error(own[k], "", "this marker was read before in the same run, pose, state and load")
    return code, own[first_rows(code)]


def _notes(table: Table, idle: Ids, unloaded: Ids) -> list[str]:
    """Unloaded readings, by their first rows, that serve several runs or none; one belongs to each run."""
    shared = int((np.bincount(unloaded, minlength=len(idle)) > 1).sum())
    alone = np.setdiff1d(np.arange(len(idle)), unloaded)
    notes = [f"{shared} unloaded readings serve several loads each"] * bool(shared)
    if len(alone):
        lines = ", ".join(str(table.lines[r]) for r in idle[alone[:5]])
        notes.append(f"{len(alone)} unloaded readings have no loaded one, from line {lines}")
    return notes


def _load_key(conditions: Conditions) -> Array:
    """Pose, set-up and load of every row, (rows, columns)."""
    pose = number_rows(conditions.pose[:, None])
    station = conditions.station if conditions.station is not None else np.zeros(len(pose), dtype=int)
    return np.column_stack([pose, number_rows(station[:, None]), conditions.wrench, conditions.point])


def _repeated(table: Table, code: Ids, marker: Ids) -> Ids:
    """Groups parted where a marker comes again, (rows,): the second reading of each is a second run."""
    again = repeats(np.column_stack([code, marker]))
    if not again.any():
        return code
    count = np.zeros((int(code.max()) + 1, int(marker.max()) + 1), dtype=int)
    np.add.at(count, (code, marker), 1)
    if (count != count.max(axis=1, keepdims=True)).any():
        problem = "missing columns ['run']: a pose and load comes again, not for all markers alike"
        raise table.header_error(problem)
    return number_rows(np.column_stack([code, again]))


def _placed(read: Readings, of_row: Ids, groups: int, *, after: bool) -> Array:
    """Readings of one state by group and marker, (groups, m, 3) [m]; NaN where there are none."""
    found = np.full((groups, len(read.markers), 3), np.nan)
    own = read.after == after
    found[of_row[read.row[own]], read.marker[own]] = read.position[own]
    return found


def _belongs(table: Table, conditions: Conditions, idle: Ids, rows: Ids) -> Ids:
    """Which unloaded readings belong to loaded ones, (runs,): of the run, else the last of the pose.

    Args:
        table: The cells.
        conditions: Of every row.
        idle: First rows of the unloaded readings, in the order of the file.
        rows: First rows of the loaded ones.
    """
    none = np.zeros(table.rows, dtype=int)
    ids = (conditions.pose, conditions.station, conditions.run)
    keys = list(zip(*((none if own is None else own).tolist() for own in ids), strict=True))
    homes: dict[tuple[int, ...], list[int]] = {}
    for k, row in enumerate(idle.tolist()):
        for key in (keys[row], keys[row][:2]):
            homes.setdefault(key, []).append(k)
    found = []
    for row in rows.tolist():
        own = homes.get(keys[row], []) if conditions.run is not None else []
        if conditions.taken_off is not None and conditions.taken_off[row] and not own:
            raise table.error(row, "", "loading off: expected an unloaded reading of the same run")
        near = own or homes.get(keys[row][:2])
        if near is None:
            pose = conditions.pose[row]
            hint = "" if conditions.named else "; without a column of poses equal joints are one"
            raise table.error(row, "", f"a loaded reading in pose {pose}, which has no unloaded one{hint}")
        found.append(near[max(0, bisect_left(near, row, key=lambda k: int(idle[k])) - 1)])
    return np.array(found)


def _check_held(table: Table, q: Array, row: Ids, idle: Ids) -> list[str]:
    """What is to be said of joints that moved between unloaded and loaded readings; they may by HELD."""
    moved = np.abs(q[row] - q[idle]).max(axis=1)
    for k in np.flatnonzero(moved > HELD)[:1]:
        raise table.error(row[k], "", not_held("unloaded", int(table.lines[idle[k]]), moved[k]))
    most = float(moved.max())
    words = f"joints differ by up to {most:.2g} rad or m between unloaded and loaded"
    return [f"{words}: deflections hold that too"] if most > SAME_POSE else []


def not_held(which: str, line: int, by: float) -> str:
    """What is wrong with joints of a reading that another one in this line should have."""
    return f"expected the joints of the {which} reading in line {line}, one differs by {by:.2g} rad or m"
