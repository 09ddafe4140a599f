"""Runs made of single readings: each loaded reading with the unloaded one that belongs to it."""

from bisect import bisect_left
from dataclasses import dataclass

import numpy as np

from testbench.data.conditions import SAME_POSE, Conditions, number_rows
from testbench.data.dataset import Ids
from testbench.data.sightings import Sightings
from testbench.data.table import Table
from testbench.errors import Array, InputError

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


def pair(table: Table, conditions: Conditions, seen: Sightings) -> Paired:
    """The runs of a table.

    Raises:
        InputError: Names the line and what was expected.
    """
    if seen.paired:
        return _in_one_row(table, conditions, seen)
    return _state_by_state(table, conditions, seen)


def _in_one_row(table: Table, conditions: Conditions, seen: Sightings) -> Paired:
    """Both states stand in a row: of all targets, or of one."""
    marker = seen.marker[: table.rows] if seen.long else np.zeros(table.rows, dtype=int)
    if conditions.run is not None:
        of_row = number_rows(conditions.run[:, None])
    else:
        of_row = (
            _repeated(table, number_rows(_key(conditions)), marker) if seen.long else np.arange(table.rows)
        )
    first = _first(of_row)
    run = np.arange(len(first)) + 1 if conditions.run is None else conditions.run[first]
    again = np.flatnonzero(repeats(np.column_stack([of_row, marker])))
    if len(again):
        raise table.error(again[0], "", f"run {run[of_row[again[0]]]} stands in the file twice")
    short = np.flatnonzero(np.bincount(of_row) < len(seen.markers)) if seen.long else None
    if short is not None and len(short):
        each = f"expected one line for each of {', '.join(seen.markers)}; those of a lost target are blank"
        raise table.error(first[short[0]], "", f"run {run[short[0]]}: {each}")
    before, after = (_placed(seen, of_row, len(first), after=state) for state in (False, True))
    notes = () if conditions.run is not None else (f"runs are numbered in their order: {len(first)} of them",)
    return Paired(first, run, first[of_row], before, after, notes)


def _state_by_state(table: Table, conditions: Conditions, seen: Sightings) -> Paired:
    """A row is of one state; an unloaded reading serves its own run, or all loads of its pose."""
    rows, marker, loaded = (
        np.arange(table.rows),
        np.zeros(table.rows, dtype=int),
        np.zeros(table.rows, dtype=bool),
    )
    loaded[seen.row] = seen.after
    if seen.long:
        marker[seen.row] = seen.marker
    idle = [conditions.pose, conditions.station, conditions.run]
    idle_key = np.column_stack([ids for ids in idle if ids is not None])
    load_key = (
        _key(conditions) if conditions.run is None else np.column_stack([_key(conditions), conditions.run])
    )
    if loaded.all() or not loaded.any():
        have = "loaded" if loaded.any() else "unloaded"
        raise table.error(0, "", f"expected unloaded and loaded readings, all are {have}")
    counted = conditions.run is None
    idle_code, idle_row = _grouped(table, rows[~loaded], idle_key, marker, counted=counted)
    code, row = _grouped(table, rows[loaded], load_key, marker, counted=counted)
    unloaded = _belongs(table, conditions, idle_row, row)
    held = _check_held(table, conditions.q, row, idle_row[unloaded])
    leader, of_row = rows.copy(), np.full(table.rows, -1)
    leader[~loaded], leader[loaded] = idle_row[idle_code], row[code]
    of_row[~loaded], of_row[loaded] = idle_code, code
    before = _placed(seen, of_row, len(idle_row), after=False)[unloaded]
    run, notes = conditions.run, list[str]()
    if run is None or len(np.unique(run[row])) < len(row):
        notes = [f"runs, one a load, are numbered in their order: {len(row)} of them"]
    run = np.arange(len(row)) + 1 if notes or run is None else run[row]
    notes += held
    notes += _notes(table, idle_row, unloaded)
    return Paired(row, run, leader, before, _placed(seen, of_row, len(row), after=True), tuple(notes))


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
    again = own[np.flatnonzero(repeats(np.column_stack([code, marker[own]])))]
    if len(again):
        problem = "this marker was read before in the same run, pose, state and load"
        raise table.error(again[0], "", problem)
    return code, own[_first(code)]


def _notes(table: Table, idle: Ids, unloaded: Ids) -> list[str]:
    """Unloaded readings, by their first rows, that serve several runs or none; one belongs to each run."""
    shared = int((np.bincount(unloaded, minlength=len(idle)) > 1).sum())
    alone = np.setdiff1d(np.arange(len(idle)), unloaded)
    notes = [f"{shared} unloaded readings serve several loads each"] * bool(shared)
    if len(alone):
        lines = ", ".join(str(table.lines[r]) for r in idle[alone[:5]])
        notes.append(f"{len(alone)} unloaded readings have no loaded one, from line {lines}")
    return notes


def _key(conditions: Conditions) -> Array:
    """Pose, set-up and load of every row, (rows, columns)."""
    pose = number_rows(conditions.pose[:, None])
    station = conditions.station if conditions.station is not None else np.zeros(len(pose), dtype=int)
    return np.column_stack([pose, number_rows(station[:, None]), conditions.wrench, conditions.point])


def _first(code: Ids) -> Ids:
    """The first row of every group, (groups,), of groups numbered as they first appear."""
    return np.unique(code, return_index=True)[1]


def repeats(values: Array | Ids) -> Ids:
    """How many equal rows stand before each row, (rows,)."""
    code = number_rows(values)
    order = np.argsort(code, kind="stable")
    size = np.bincount(code)
    found = np.empty(len(code), dtype=int)
    found[order] = np.arange(len(code)) - np.repeat(np.cumsum(size) - size, size)
    return found


def _repeated(table: Table, code: Ids, marker: Ids) -> Ids:
    """Groups parted where a marker comes again, (rows,): the second reading of each is a second run."""
    again = repeats(np.column_stack([code, marker]))
    if not again.any():
        return code
    count = np.zeros((int(code.max()) + 1, int(marker.max()) + 1), dtype=int)
    np.add.at(count, (code, marker), 1)
    if (count != count.max(axis=1, keepdims=True)).any():
        problem = "missing columns ['run']: a pose and load comes again, not for all markers alike"
        raise InputError(table.path, f"line {table.header}", problem)
    return number_rows(np.column_stack([code, again]))


def _placed(seen: Sightings, of_row: Ids, groups: int, *, after: bool) -> Array:
    """Readings of one state by group and marker, (groups, m, 3) [m]; NaN where there are none."""
    found = np.full((groups, len(seen.markers), 3), np.nan)
    own = seen.after == after
    found[of_row[seen.row[own]], seen.marker[own]] = seen.position[own]
    return found


def _belongs(table: Table, conditions: Conditions, idle: Ids, rows: Ids) -> Ids:
    """Which unloaded readings belong to loaded ones, (runs,): of the run, else the last of the pose.

    Args:
        table: The cells.
        conditions: Of every row.
        idle: First rows of the unloaded readings, in the order of the file.
        rows: First rows of the loaded ones.
    """
    station = conditions.pose * 0 if conditions.station is None else conditions.station
    run = conditions.pose * 0 if conditions.run is None else conditions.run
    keys = list(zip(conditions.pose.tolist(), station.tolist(), run.tolist(), strict=True))
    homes: dict[tuple[int, ...], list[int]] = {}
    for k, row in enumerate(idle.tolist()):
        for key in (keys[row], keys[row][:2]):
            homes.setdefault(key, []).append(k)
    found = []
    for row in rows.tolist():
        near = homes.get(keys[row]) or homes.get(keys[row][:2])
        if near is None:
            pose = conditions.pose[row]
            hint = "" if conditions.named else "; without a column of poses equal joints are one"
            raise table.error(row, "", f"a loaded reading in pose {pose}, which has no unloaded one{hint}")
        found.append(near[max(0, bisect_left(near, row, key=lambda k: int(idle[k])) - 1)])
    return np.array(found)


def _check_held(table: Table, q: Array, row: Ids, idle: Ids) -> list[str]:
    """What is to be said of joints that moved between unloaded and loaded readings; they may by HELD."""
    moved = np.abs(q[row] - q[idle]).max(axis=1)
    bad = np.flatnonzero(moved > HELD)
    if len(bad):
        k = bad[0]
        line, by = table.lines[idle[k]], f"{moved[k]:.2g}"
        problem = f"expected the joints of the unloaded reading in line {line}, one differs by {by} rad or m"
        raise table.error(row[k], "", problem)
    most = float(moved.max())
    words = (
        f"joints differ by up to {most:.2g} rad or m between unloaded and loaded: deflections hold that too"
    )
    return [words] if most > SAME_POSE else []
