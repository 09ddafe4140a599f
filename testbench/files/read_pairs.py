"""Reader of measured runs from a text file of an instrument, a spreadsheet or a robot.

Runs from single readings: each loaded reading is paired with its unloaded one.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.dataset import Dataset, along_lines, in_order
from testbench.errors import Array, Ids, Mask, check_type
from testbench.files.beside import FileLines, place_lines, read_lines
from testbench.files.columns import Columns, find_columns, read_columns
from testbench.files.mapping import Map, read_map
from testbench.files.names import ENTRIES, Slot, columns_of
from testbench.files.readings import (
    FileReadings,
    average_shots,
    markers_only,
    read_covariances,
    read_readings,
    read_scatter,
    readings_by_group,
)
from testbench.files.rows import SAME_POSE, RowConditions, first_rows, number_rows, read_conditions, repeats
from testbench.files.table import TableCells, table_of

HELD = 2e-4
"""Largest difference of joint coordinates between the readings of a run that is accepted, with a note [rad,
m]."""


@dataclass(frozen=True)
class Paired:
    """Hold the readings of every run."""

    row: Ids  #: Row of the table with the run's conditions, (runs,).
    run: Ids  #: Identifier, (runs,).
    leader: Ids  #: For every row one that has the same conditions, (rows,).
    before: Array  #: Unloaded positions, (runs, m, 3) [m]; NaN where the target was lost or has no reading.
    after: Array  #: Loaded positions, (runs, m, 3) [m]; NaN as above.
    notes: tuple[str, ...]  #: Assumptions that were made.


def pair(table: TableCells, conditions: RowConditions, read: FileReadings) -> Paired:
    """Pair unloaded and loaded readings of a table to runs.

    Args:
        table: The table.
        conditions: Poses, loads and states of its rows.
        read: Readings of its rows.

    Returns:
        The runs.

    Raises:
        InputError: Names the line and what was expected.
    """
    marker = np.zeros(table.rows, dtype=int)
    if read.long:
        marker[read.row] = read.marker
    if read.paired:
        return _in_one_row(table, conditions, read, marker)
    return _state_by_state(table, conditions, read, marker)


def _in_one_row(table: TableCells, conditions: RowConditions, read: FileReadings, marker: Ids) -> Paired:
    """Pair readings if a row holds both states, of all targets or of one."""
    # Number the runs; without a column of runs repeated markers start a new one.
    own, code = conditions, np.arange(table.rows)
    if own.run is not None:
        code = number_rows(own.run)
    elif read.long:
        code = _repeated(table, number_rows(own.pose, own.station, own.wrench, own.point), marker)
    first = first_rows(code)
    run = np.arange(len(first)) + 1 if own.run is None else own.run[first]
    # Every run needs each marker exactly once.
    again = repeats(code, marker) > 0
    table.refuse(again, "", lambda row: f"run {run[code[row]]} is in the file twice")
    if read.long:
        short = np.bincount(code) < len(read.markers)
        each = f"expected one line for each of {', '.join(read.markers)}; those of a lost target are blank"
        for k in np.flatnonzero(short)[:1]:
            raise table.error(first[k], "", f"run {run[k]}: {each}")
    before, after = (readings_by_group(read, code, read.after == state) for state in (False, True))
    notes = () if own.run is not None else (f"runs are numbered in their order: {len(first)} of them",)
    return Paired(first, run, first[code], before, after, notes)


def _state_by_state(table: TableCells, conditions: RowConditions, read: FileReadings, marker: Ids) -> Paired:
    """Pair readings if a row holds one state; an unloaded one serves its run, or all loads of its pose."""
    own, loaded = conditions, np.zeros(table.rows, dtype=bool)
    loaded[read.row] = read.after
    if loaded.all() or not loaded.any():
        have = "loaded" if loaded.any() else "unloaded"
        raise table.error(0, "", f"expected unloaded and loaded readings, all are {have}")
    # Number readings of one pose, load and state; unloaded rows have no load.
    load = np.column_stack([own.wrench, own.point]) * loaded[:, None]
    code = number_rows(own.pose, own.station, own.run, loaded, load)
    if own.run is None:
        code = _repeated(table, code, marker)
    again = repeats(code, marker) > 0
    table.refuse(again, "", "this marker was read before in the same run, pose, state and load")
    first, position = first_rows(code), readings_by_group(read, code)
    # Find the unloaded reading of every loaded one; joints must not move in between.
    hung, idle = np.flatnonzero(loaded[first]), np.flatnonzero(~loaded[first])
    row, unloaded = first[hung], _belongs(table, own, first[idle], first[hung])
    held = _check_held(table, own.q, row, first[idle[unloaded]])
    # Number the runs, and note what was assumed.
    notes = list[str]()
    if own.run is None or len(np.unique(own.run[row])) < len(row):
        notes = [f"runs are numbered in file order, one per load: {len(row)}"]
    number = np.arange(len(row)) + 1 if notes or own.run is None else own.run[row]
    notes += [*held, *_notes(table, first[idle], unloaded)]
    return Paired(row, number, first[code], position[idle[unloaded]], position[hung], tuple(notes))


def _notes(table: TableCells, idle: Ids, unloaded: Ids) -> list[str]:
    """Note unloaded readings that serve several runs or none."""
    shared = int((np.bincount(unloaded, minlength=len(idle)) > 1).sum())
    alone = np.setdiff1d(np.arange(len(idle)), unloaded)
    notes = [f"{shared} unloaded readings belong to several loads each"] * bool(shared)
    if len(alone):
        lines = ", ".join(str(table.lines[r]) for r in idle[alone[:5]])
        notes.append(f"{len(alone)} unloaded readings have no loaded one, from line {lines}")
    return notes


def _repeated(table: TableCells, code: Ids, marker: Ids) -> Ids:
    """Split groups at a repeated marker, (rows,): the second reading of each marker is a second run."""
    again = repeats(code, marker)
    if not again.any():
        return code
    count = np.zeros((int(code.max()) + 1, int(marker.max()) + 1), dtype=int)
    np.add.at(count, (code, marker), 1)
    if (count != count.max(axis=1, keepdims=True)).any():
        problem = "missing columns ['run']: a pose and load comes again, not for all markers alike"
        raise table.header_error(problem)
    return number_rows(code, again)


def _belongs(table: TableCells, conditions: RowConditions, idle: Ids, rows: Ids) -> Ids:
    """Find the unloaded reading of each loaded one, (runs,): that of the run, else of the pose.

    Args:
        table: The cells.
        conditions: Conditions of every row.
        idle: First rows of the unloaded readings, in the order of the file.
        rows: First rows of the loaded readings.
    """
    found = _last(number_rows(conditions.pose, conditions.station), idle, rows)
    of_run = np.full(len(rows), -1)
    if conditions.run is not None:
        of_run = _last(number_rows(conditions.pose, conditions.station, conditions.run), idle, rows)
    if conditions.taken_off is not None:
        for row in rows[conditions.taken_off[rows] & (of_run < 0)][:1]:
            raise table.error(row, "", "loading off: expected an unloaded reading of the same run")
    for row in rows[found < 0][:1]:
        hint = "" if conditions.named else "; without a column of poses equal joints are one"
        problem = f"a loaded reading in pose {conditions.pose[row]}, which has no unloaded one{hint}"
        raise table.error(row, "", problem)
    return np.where(of_run < 0, found, of_run)


def _last(key: Ids, idle: Ids, rows: Ids) -> Ids:
    """Find the last place in `idle` with each row's key before that row, else the first one; else -1."""
    place = key * len(key) + np.arange(len(key))
    order = np.argsort(place[idle])
    known = place[idle[order]]
    first, behind = np.searchsorted(known, key[rows] * len(key)), np.searchsorted(known, place[rows])
    at = np.minimum(np.maximum(first, behind - 1), len(known) - 1)
    return np.where(key[idle[order[at]]] == key[rows], order[at], -1)


def _check_held(table: TableCells, q: Array, row: Ids, idle: Ids) -> list[str]:
    """Note joints that moved between unloaded and loaded readings; refuse motions beyond HELD."""
    moved = np.abs(q[row] - q[idle]).max(axis=1)
    for k in np.flatnonzero(moved > HELD)[:1]:
        raise table.error(row[k], "", not_held("unloaded", int(table.lines[idle[k]]), moved[k]))
    most = float(moved.max())
    words = f"joints differ by up to {most:.2g} rad or m between unloaded and loaded"
    return [f"{words}: deflections hold that too"] if most > SAME_POSE else []


def not_held(which: str, line: int, by: float) -> str:
    """Write the message about a joint that moved between two readings which belong together.

    Args:
        which: Which of the two the other line holds, such as "unloaded".
        line: The line of the other reading.
        by: Largest difference of a joint coordinate [rad, m].

    Returns:
        The message.
    """
    return f"expected the joints of the {which} reading in line {line}, one differs by {by:.2g} rad or m"


@dataclass(frozen=True)
class Export:
    """Hold a file that was read, and how it was understood."""

    data: Dataset  #: The runs.
    columns: Columns  #: Meaning of its columns.
    notes: tuple[str, ...]  #: Assumptions, omissions and numbering; empty for a complete file.


def read_csv(path: str | Path, arm: Arm) -> Dataset:
    """Read and check a dataset of an arm.

    Args:
        path: The file: `testbench.files.write.write_csv` documents ours, docs/formats.md every other form.
        arm: The arm that was measured.

    Returns:
        Readings before and after loading, with poses and loads.

    Raises:
        InputError: Names the line and what was expected.
        BenchError: When arm is no Arm.
    """
    check_type(arm, Arm, "arm")
    return read_export(Path(path), arm).data


def read_export(
    path: Path,
    arm: Arm,
    mapping: Path | Map | None = None,
    sigma: float | None = None,
    load: float | None = None,
) -> Export:
    """Read and check the runs of an arm.

    Args:
        path: The file; docs/formats.md has an example of every form.
        arm: The arm that was measured.
        mapping: A map of its names, or its TOML file; None if it uses ours.
        sigma: Standard deviation of a reading along an axis [m], if neither file nor map has one.
        load: Mass of the payload in loaded rows [kg], if neither file nor map has a load.

    Returns:
        The runs, and how the file was understood.

    Raises:
        InputError: Names line and column, or key of the map, and what was expected.
    """
    names = replace(read_map(mapping, arm), load=load)
    return runs_of(read_columns(path, names, arm), arm, sigma)


def from_text(text: str, arm: Arm) -> Dataset:
    """Read runs of an arm from the text that `write.csv_text` makes.

    Args:
        text: The text.
        arm: The arm.

    Returns:
        The runs.
    """
    names = read_map(None, arm)
    table = table_of(Path("runs"), (text, "utf-8"), names.knows, names.map.file)
    return runs_of(find_columns(table, names, arm), arm, None).data


def runs_of(columns: Columns, arm: Arm, sigma: float | None) -> Export:
    """Convert the columns of a file to runs.

    Args:
        columns: The columns.
        arm: The arm that was measured.
        sigma: Standard deviation of a reading along an axis [m], if neither file nor map has one.

    Returns:
        The runs, and how the file was understood.

    Raises:
        InputError: Names line and column, or key of the map, and what was expected.
    """
    # Drop points that are no markers, and average shots.
    columns, dropped = markers_only(columns)
    columns, shots = average_shots(columns)
    # Conditions and positions of every row, then pairs of unloaded and loaded readings.
    conditions = read_conditions(columns, arm)
    lines = read_lines(columns)
    read = read_readings(columns, arm, conditions.loaded, lines)
    runs = pair(columns.table, conditions, read)
    _check_once(columns, conditions, runs, read)
    own = in_order(conditions, runs.row)
    # Noise: one sigma for the file, or a covariance per reading; lost targets have zero weight.
    lost = np.asarray((np.isnan(runs.before) | np.isnan(runs.after)).any(axis=-1))
    scatter, (before, after) = read_scatter(columns, sigma), _rotations(columns, runs.row)
    own_sigma = _of_the_file(columns, 0, scatter.sigma) if lines is None else float(scatter.sigma[0])
    precision = covariances = _precision(columns, read, runs, lost, lines)
    if precision is None and lost.any():
        precision = np.where(lost[..., None, None], 0.0, np.eye(3) / (2 * own_sigma**2))
    data = Dataset(
        markers=read.markers,
        run=runs.run,
        pose=own.pose,
        q=own.q,
        wrench=own.wrench,
        point=own.point,
        before=np.where(lost[..., None], 0.0, runs.before),
        after=np.where(lost[..., None], 0.0, runs.after),
        sigma=own_sigma,
        rotation_before=before,
        rotation_after=after,
        sigma_rotation=None if before is None else _of_the_file(columns, 1, scatter.sigma_rotation),
        precision=precision,
        station=own.station,
        taken_off=own.taken_off,
    )
    if lines is not None:
        data = _with_lines(data, lines, arm, (runs, read), scatter.sigma, covariances)
    along = () if lines is None else lines.notes
    notes = (*columns.warnings, *conditions.notes, *runs.notes, *scatter.notes, *along, *dropped, *shots)
    return Export(data, columns, notes)


def _with_lines(
    data: Dataset,
    lines: FileLines,
    arm: Arm,
    places: tuple[Paired, FileReadings],
    sigma: Array,
    covariances: Array | None,
) -> Dataset:
    """Give runs the directions of their readings along lines, and every reading the sigma of its row."""
    runs, read = places
    at, lost = (np.searchsorted(runs.row, runs.leader), read.marker[: len(sigma)]), ~data.seen
    placed = place_lines(lines, arm, data.markers, data.q, at)
    own, along = np.full(lost.shape, data.sigma), np.asarray(placed.direction.any(axis=2) & ~lost)[..., None]
    own[at] = sigma
    P = np.eye(3) / (2 * own[..., None, None] ** 2) * ~lost[..., None, None]
    P = P if covariances is None else covariances
    meter = placed.reach[..., None] > 0  # read along the x axis before its direction was known
    before, after = (np.where(meter, x[..., :1] * placed.direction, x) for x in (data.before, data.after))
    P = np.where(along[..., None], along_lines(placed.direction, own), P)
    return replace(data, before=before, after=after, precision=P, **vars(placed))


def _check_once(columns: Columns, conditions: RowConditions, runs: Paired, read: FileReadings) -> None:
    """Check that conditions of a run are equal in all of its rows."""
    every, lead = {"pose": conditions.pose[:, None], "joint": conditions.q}, runs.leader
    if conditions.taken_off is not None:
        every["loading"] = conditions.taken_off[:, None].astype(int)
    if read.paired:
        every |= {"force": conditions.wrench[:, :3], "moment": conditions.wrench[:, 3:]}
        every |= {"mass": conditions.wrench[:, 2:3], "point": conditions.point}
        if conditions.station is not None:
            every["station"] = conditions.station[:, None]
    turned = [(column, columns.full(column)) for column in columns.all_of("rotation") if column.slot.when]
    for column, own in [(c, every[c.slot.what][:, c.slot.index]) for c in columns.all_of(*every)] + turned:
        differs = np.abs(own - own[lead]) > (0.0 if read.paired else HELD)
        columns.table.refuse(differs, column.name, "expected the same value in every row of the run")


def _of_the_file(columns: Columns, index: int, values: Array) -> float:
    """Return one standard deviation of positions (0) or orientations (1) of a file, from (rows,) [m, rad]."""
    if column := columns.get(Slot("sigma", index)):
        columns.table.refuse(values != values[0], column.name, "expected one value in the whole file")
    return float(values[0])


def _rotations(columns: Columns, row: Ids) -> tuple[Array, Array] | tuple[None, None]:
    """Read orientations of every run, unloaded and loaded, (runs, 3) [rad]; None if there are none."""
    wanted = columns_of("rotation", "before") | columns_of("rotation", "after")
    found = columns.complete_set(wanted)
    if not found:
        if Slot("sigma", 1) in columns.found:
            raise columns.lack(list(wanted))
        return None, None
    if columns.source_of(Slot("sigma", 1)) is None:
        raise columns.lack(["sigma_rad"])
    values = np.column_stack([columns.full(column)[row] for column in found])
    return values[:, :3], values[:, 3:]


def _precision(
    columns: Columns, read: FileReadings, runs: Paired, lost: Mask, lines: FileLines | None
) -> Array | None:
    """Compute inverse covariances, (runs, m, 3, 3) [1/m^2], zero for lost targets; None without columns."""
    table, C = columns.table, read_covariances(columns, "covariance")
    if C is None:
        return None
    if not (read.long and read.paired):
        raise table.header_error("covariances: expected a line for every marker of a run, with both readings")
    of_row, marker = np.searchsorted(runs.row, runs.leader), read.marker[: table.rows]
    gone = lost[of_row, marker] | (False if lines is None else lines.rows)
    blank = np.isnan(C) & ~gone[:, None, None]
    for k, (a, b) in enumerate(ENTRIES.values()):
        name = columns.found[Slot("covariance", k)].name
        table.refuse(blank[:, a, b], name, "expected a finite number, got ''")
    C[gone] = np.eye(3)
    problem = "expected a positive definite covariance, got {} m^2"
    table.refuse(~(np.linalg.eigvalsh(C)[:, 0] > 0), "", lambda row: problem.format(C[row].tolist()))
    P = np.asarray(np.linalg.inv(C))
    P[gone] = 0
    placed = np.zeros((*lost.shape, 3, 3))
    placed[of_row, marker] = (P + P.swapaxes(1, 2)) / 2
    return placed
