"""Reader of measured runs from a text file of an instrument, a spreadsheet or a robot.

Runs from single readings: each loaded reading is paired with its unloaded one.

Positions of targets: readings of one target in one state each; a row of a file may hold several.

Several shots of a point are averaged, and their standard deviation gives the noise.

Noise of readings: one standard deviation for a file, one per row, or a covariance of each.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.dataset import Dataset, line_precision, select_rows
from testbench.errors import Array, Ids, Mask, check_type
from testbench.files.beside import FileLines, place_lines, read_lines
from testbench.files.columns import (
    SAME_POSE,
    Columns,
    ReadColumn,
    RowConditions,
    find_columns,
    first_rows,
    number_rows,
    read_columns,
    read_conditions,
    repeats,
)
from testbench.files.mapping import Map, read_map
from testbench.files.names import (
    DEFLECTION,
    ENTRIES,
    ROTATIONS,
    STATES,
    UNITS_BY_NAME,
    WHEN,
    XYZ,
    Slot,
    What,
    columns_of,
    number_of,
    plain,
    squeeze,
)
from testbench.files.rearranged import clock
from testbench.files.table import TableCells, table_of

# --- Positions of targets: readings of one target in one state each; a row of a file may hold several -------

SIGMA = (50e-6, 2e-4)
"""Standard deviations of positions and of orientations if the file states none [m, rad]."""
SIGMA_RANGE = (1e-9, 1e-2)
"""Range of standard deviations of instruments [m, rad]: beyond it a unit is wrong."""
MAX_DEVIATION = 1.0
"""Largest standard deviation of a row [m, rad]: beyond it nothing was measured."""
DIFFERENCES = "dx", "dy", "dz"  #: Names of deflections, but of deviations from drawn places too.
MIN_DEVIATIONS = (1e-6, 1e-7)
"""Least standard deviations of a row that are accepted [m, rad]: no target is steadier."""


@dataclass(frozen=True)
class Scatter:
    """Hold the noise of every row of a table."""

    sigma: Array  #: Standard deviation of a position along an axis, (rows,) [m].
    sigma_rotation: Array  #: Standard deviation of an orientation about an axis, (rows,) [rad].
    #: Covariance of a position, (rows, 3, 3) [m^2]; None if sigma holds along every axis.
    covariance: Array | None
    notes: tuple[str, ...]  #: Assumptions that were made.


def read_scatter(columns: Columns, sigma: float | None) -> Scatter:
    """Read the noise of positions and orientations, from the file, the map or a flag.

    Args:
        columns: The columns of the file.
        sigma: Standard deviation per axis of one position [m]; None where no flag gives it.

    Returns:
        The noise [m, rad].

    Raises:
        InputError: At a number that no instrument has.
    """
    deviations, notes = _deviations(columns, "deviation", MIN_DEVIATIONS[0], "m")
    turned, more = _deviations(columns, "turn_deviation", MIN_DEVIATIONS[1], "rad")
    own, said = _read_sigma(columns, 0, sigma, deviations)
    own_turn, said_turn = _read_sigma(columns, 1, None, turned)
    covariance = read_covariances(columns, "spread")
    if covariance is None and deviations is not None:
        filled = np.where(np.isnan(deviations), own[:, None], deviations)
        covariance = filled[:, :, None] ** 2 * np.eye(3)
    elif (C := covariance) is not None:
        whole = np.asarray(~np.isnan(C).any(axis=(1, 2)))
        sound = np.asarray(~(np.abs(C) > MAX_DEVIATION**2).any(axis=(1, 2)) | ~whole)
        sound[whole & sound] = np.linalg.eigvalsh(C[whole & sound])[:, 0] >= SIGMA_RANGE[0] ** 2
        problem = "expected a positive definite covariance below 1 m^2, got {} m^2"
        columns.table.refuse(~sound, "", lambda row: problem.format(C[row].tolist()))
        covariance = np.where(np.isnan(C), own[:, None, None] ** 2 * np.eye(3), C)
    return Scatter(own, own_turn, covariance, (*notes, *more, *said, *said_turn))


def _read_sigma(
    columns: Columns, index: int, flag: float | None, deviations: Array | None = None
) -> tuple[Array, list[str]]:
    """Read the standard deviation of positions (0) or orientations (1) of every row.

    Args:
        columns: The columns of the file.
        index: 0 or 1.
        flag: Value for a file and map that state none [m, rad]; None for `SIGMA`.
        deviations: Standard deviations by axis in the file, (rows, 3) [m, rad].

    Returns:
        Standard deviations, (rows,) [m, rad], and notes on assumptions.

    Raises:
        InputError: At a number that no instrument has.
    """
    slot = Slot("sigma", index)
    name = ("sigma_m", "sigma_rad")[index]
    table = columns.table
    column = columns.found.get(slot)
    stated = columns.constant(slot)
    low, high = SIGMA_RANGE
    if column is not None:
        values = columns.full(column)
        bad = ~((values >= low) & (values <= high))
        table.refuse(bad, column.name, lambda row: f"expected {low:g} to {high:g}, got {values[row]:g}")
        return values, _unlike(flag, values)
    if deviations is not None and np.isfinite(deviations).any():
        values = np.full(table.rows, np.nanmedian(deviations))
        return values, _unlike(flag, values)
    value = flag if stated is None else stated
    if value is not None and not low <= value <= high:
        raise columns.map_error(name, f"expected {low:g} to {high:g}, got {value:g}")
    words = f"orientations: sigma {1e3 * SIGMA[1]:g} mrad" if index else f"sigma {1e6 * SIGMA[0]:g} um"
    asked = value is None and (not index or bool(columns.all_of(*ROTATIONS)))
    notes = [] if stated is None else _unlike(flag, np.array(stated))
    notes += [f"no column gives the noise: {words} is assumed"] * asked
    return np.full(table.rows, SIGMA[index] if value is None else value), notes


def _unlike(flag: float | None, used: Array) -> list[str]:
    """Note that the caller's sigma [m] is not used, if the file's or map's differs."""
    if flag is None or np.allclose(used, flag, rtol=1e-6, atol=0):
        return []
    return [f"the sigma of the file or its map is used, not the stated {1e6 * flag:g} um"]


def _deviations(columns: Columns, what: What, least: float, unit: str) -> tuple[Array | None, list[str]]:
    """Read standard deviations by axis, (rows, 3) [m, rad], NaN if blank; None without such columns."""
    found = columns.complete_set(columns_of(what))
    if not found:
        return None, []
    values = np.column_stack([columns.values(column) for column in found])
    columns.table.refuse(
        (values < 0) | (values > MAX_DEVIATION),
        [column.name for column in found],
        lambda row, k: f"expected 0 to {MAX_DEVIATION:g} {unit}, got {values[row, k]:g} {unit}",
    )
    middle = float(np.nanmedian(values)) if np.isfinite(values).any() else least
    if middle > SIGMA_RANGE[1]:
        problem = f"expected at most {SIGMA_RANGE[1]:g} {unit}, got {middle:g} in most rows; another unit?"
        raise columns.table.error(0, found[0].name, problem)
    low = int((values < least).sum())
    words = f"{low} standard deviations are below {1e6 * least:g} u{unit}: this limit is used for them"
    return np.fmax(values, least) if low else values, [words] * bool(low)


def read_covariances(columns: Columns, what: What) -> Array | None:
    """Read the covariance of every row.

    Args:
        columns: The columns of the file.
        what: The quantity.

    Returns:
        Covariances, (rows, 3, 3) [m^2], NaN where blank; None without such columns.

    Raises:
        InputError: Where one of the columns is missing.
    """
    found = columns.complete_set(columns_of(what))
    if not found:
        return None
    C = np.empty((columns.table.rows, 3, 3))
    for column, (a, b) in zip(found, ENTRIES.values(), strict=True):
        C[:, a, b] = C[:, b, a] = columns.values(column)
    return C


SHOT_QUANTITIES = ("reading", "torque", "temperature", "time", "sigma", "deviation", "spread")
"""Quantities that may differ between shots."""
APART = 2e-3
"""Distance of a shot from the mean of its point beyond which it is of another point [m]."""


@dataclass(frozen=True)
class FileReadings:
    """Hold all readings of a file, one marker in one state each."""

    markers: tuple[str, ...]  #: Names in order of appearance.
    row: Ids  #: Row of the table, (s,).
    marker: Ids  #: Index of the marker, (s,).
    after: Mask  #: Whether the arm was loaded, (s,).
    position: Array  #: Positions, (s, 3) [m]; NaN for lost targets.
    long: bool  #: Whether a column of markers states the target of a row.
    paired: bool  #: Whether both states are in one row.


def readings_by_group(read: FileReadings, code: Ids, some: Mask | slice = slice(None)) -> Array:
    """Arrange readings by group and marker.

    Args:
        read: The readings.
        code: The group of every row, (rows,).
        some: The readings that count.

    Returns:
        Positions, (groups, m, 3) [m]; NaN where there is none.
    """
    found: Array = np.full((int(code.max()) + 1, len(read.markers), 3), np.nan)
    found[code[read.row[some]], read.marker[some]] = read.position[some]
    return found


def markers_only(columns: Columns) -> tuple[Columns, list[str]]:
    """Drop the rows of points that the map does not count as markers.

    Args:
        columns: The table.

    Returns:
        The table with the other rows; and a note if rows were dropped.

    Raises:
        InputError: When the table has no row.
    """
    table, column = columns.table, columns.found.get(Slot("marker"))
    if not table.rows:
        raise table.error(0, "", "expected at least one row")
    if column is None or not columns.names.ignored:
        return columns, []
    other = np.array([squeeze(text) in columns.names.ignored for text in table.texts(column.index)])
    words = f"{other.sum()} rows are left out: the map does not list their points as markers"
    return replace(columns, table=table.take(~other)), [words] * bool(other.any())


def read_readings(columns: Columns, arm: Arm, loaded: Mask, lines: FileLines | None = None) -> FileReadings:
    """Read all readings of a table.

    Args:
        columns: The columns of the file.
        arm: The arm.
        loaded: Whether the row has a load, (rows,); it gives the state if no column does.
        lines: Readings along lines, which count as positions of their number along the direction.

    Returns:
        The readings.

    Raises:
        InputError: Names line and column.
    """
    # Three columns per marker and state; rows may also name the marker ("long") or the state.
    along: dict[tuple[str, str], list[ReadColumn]] = {}
    if lines is not None:
        along = {("", when): [] for when in ("",) * lines.by_state or WHEN}
    blocks = _blocks(columns) if lines is None or columns.all_of("reading") else along
    if lines is not None and blocks.keys() != along.keys():
        problem = (
            "a file with travel or distance needs one row per run and marker, with positions before and after"
        )
        raise columns.table.header_error(problem)
    everyone = np.arange(columns.table.rows)
    long = "" in {marker for marker, _ in blocks}
    names = _markers(columns, arm) if long else None
    kept = tuple(dict.fromkeys(names if names is not None else [marker for marker, _ in blocks]))
    place = {name: k for k, name in enumerate(kept)}
    paired = all(when for _, when in blocks)
    state = None if paired else _states(columns, loaded)
    parts = []
    # One part per block: marker, state and position of every row; deflections are added to unloaded
    # positions.
    for (name, when), triple in blocks.items():
        own = np.array([place[n] for n in names or [name] * len(everyone)])
        after = np.full(len(everyone), when != "before") if state is None else state
        position = _positions(columns, triple) if triple else np.full((len(everyone), 3), np.nan)
        if lines is not None:
            number = lines.number[everyone, after.astype(int)][:, None] * lines.direction
            problem = "expected a position or a reading along a line, got both"
            columns.table.refuse(lines.rows & ~np.isnan(position).any(axis=1), "", problem)
            position = np.where(lines.rows[:, None], number, position)
        if when == DEFLECTION:
            position = position + _positions(columns, blocks[name, "before"])
        parts.append((everyone, own, after, position))
    row, marker, loaded, position = (np.concatenate(x) for x in zip(*parts, strict=True))
    return FileReadings(kept, row, marker, loaded, position, long, paired)


def read_distances(columns: Columns, arm: Arm, loaded: Mask) -> FileReadings:
    """Read distances to fixed points, or heights over planes, one per row.

    Args:
        columns: The columns of the file.
        arm: The arm.
        loaded: Whether the row has a load, (rows,); it gives the state if no column does.

    Returns:
        The readings; the first number of a position is the distance, the others are zero.

    Raises:
        InputError: Names line and column.
    """
    column = columns.found.get(Slot("distance"))
    if column is None:
        raise columns.lack(["distance_m"], "; absolute readings have one distance per row, loaded or not")
    distance, names = columns.values(column), _markers(columns, arm)
    kept = tuple(dict.fromkeys(names))
    marker = np.array([kept.index(name) for name in names])
    position = np.column_stack([distance, np.zeros((len(names), 2))])
    every = np.arange(columns.table.rows)
    return FileReadings(kept, every, marker, _states(columns, loaded), position, long=True, paired=False)


def _blocks(columns: Columns) -> dict[tuple[str, str], list[ReadColumn]]:
    """List the three columns of every marker and state."""
    found: dict[tuple[str, str], dict[int, ReadColumn]] = {}
    for column in columns.all_of("reading"):
        found.setdefault((column.slot.marker, column.slot.when), {})[column.slot.index] = column
    missing = [
        "_".join(filter(None, (marker, when, XYZ[k], "m")))
        for (marker, when), triple in found.items()
        for k in range(3)
        if k not in triple
    ]
    if not found:
        raise columns.lack(["x_mm, y_mm, z_mm (or before_x_mm ... after_z_mm)"])
    for marker, when in found:
        others = ("after", DEFLECTION) if when == "before" else ("before",)
        if when and not any((marker, other) in found for other in others):
            missing += ["_".join(filter(None, (marker, others[0], axis, "m"))) for axis in XYZ]
    if missing:
        raise columns.lack(missing)
    return {key: [triple[k] for k in range(3)] for key, triple in found.items()}


def _markers(columns: Columns, arm: Arm) -> list[str]:
    """Read the marker of every row."""
    column, table = columns.found.get(Slot("marker")), columns.table
    if column is None:
        if len(arm.markers) == 1:
            return [arm.markers[0]] * table.rows
        hint = '; name the column of targets in [columns] of a map, as marker = "Point", '
        hint += "or write {marker} in [cells] for names with several parts, as p1_P1_100kg"
        raise columns.lack(["marker"], hint)
    have = f"in {arm.name}; markers are {', '.join(arm.markers)}"
    return _said(columns, column, arm.markers, f'{have}; others go into [words] of a map, as P1 = "SMR-A"')


def _states(columns: Columns, loaded: Mask) -> Mask:
    """Find the loaded rows, (rows,)."""
    column = columns.found.get(Slot("state"))
    if column is None:
        return loaded
    have = ", ".join(word for words in STATES.values() for word in words)
    hint = 'others go into [words] of a map, as before = "cold"'
    blank = columns.table.blank(column.index)
    said = _said(columns, column, WHEN, f"is known; states are {have}; {hint}", blank)
    return np.where(blank, loaded, np.array([word == "after" for word in said], dtype=bool))


def _said(
    columns: Columns, column: ReadColumn, known: tuple[str, ...], hint: str, unsaid: Mask | None = None
) -> list[str]:
    """Translate the cells of a column of words; under the mask `unsaid` they may be blank."""
    texts = columns.table.texts(column.index)
    ours = {text: columns.names.word(text, known) for text in dict.fromkeys(texts)}
    found = [ours[text] for text in texts]
    bad = np.array([not text for text in found], dtype=bool)
    if unsaid is not None:
        bad &= ~unsaid
    columns.table.refuse(bad, column.name, lambda row: f"no {column.slot.what} {texts[row][:80]!r} {hint}")
    return found


def _positions(columns: Columns, triple: list[ReadColumn]) -> Array:
    """Read the positions of a target, (rows, 3) [m]; NaN if all three cells are blank.

    Three equal coordinates, such as 9999 or 0, are refused: instruments write them for a lost target.
    """
    found, _ = columns.together(triple)
    if triple[0].slot.when != DEFLECTION:
        table, first = columns.table, triple[0]

        def problem(row: int) -> str:
            text = table.texts(first.index)[row]
            hint = f'if this means a lost target, add to the map: [words] lost = "{text}"'
            return f"expected a position, got {text!r} three times; {hint}"

        table.refuse((found == found[:, :1]).all(axis=1), first.name, problem)
    return found


def average_shots(columns: Columns) -> tuple[Columns, list[str]]:
    """Average the shots of each point to one row, if the map requests it.

    Shots of a point are rows with equal names and loads; without a name, with equal joints. The noise of a
    mean is the pooled standard deviation over the root of the number of shots, if nothing else states it.

    Args:
        columns: The table.

    Returns:
        The table with one row per point; and a note about the shots and their scatter.

    Raises:
        InputError: When shots of one point are farther than APART from their mean.
    """
    names, table = columns.names, columns.table
    if not names.map.file.average:
        return columns, []
    keys = [c for c in columns.found.values() if c.slot.what not in (*SHOT_QUANTITIES, "joint")]
    if not any(c.slot.what in ("pose", "run") for c in keys):
        keys += columns.all_of("joint")
    code = number_rows(*(np.array(table.texts(c.index)) for c in keys))
    first = first_rows(code)
    count = np.bincount(code)
    squares = 0.0
    free = 0
    table = table.take(np.isin(np.arange(table.rows), first))
    for column in columns.all_of("reading"):
        values = columns.table.numbers(column.index, columns.mark)
        there = np.isfinite(values)
        n = np.bincount(code[there], minlength=len(first))
        mean = np.full(len(first), np.nan)
        np.divide(np.bincount(code[there], values[there], len(first)), n, out=mean, where=n > 0)
        off = (values - mean[code]) * column.sign * (column.unit.scale if column.unit else 1.0)
        columns.table.refuse(
            np.abs(off) > APART, column.name, f"expected shots of one point within {APART} m"
        )
        squares += float((off[there] ** 2).sum())
        free += int((n[n > 0] - 1).sum())
        table = table.with_numbers(column.index, mean)
    shots, scatter = float(np.median(count)), float(np.sqrt(squares / max(free, 1)))
    words = (
        f"{len(code)} shots are averaged to {len(first)} readings; shots scatter by {1e6 * scatter:.3g} um"
    )
    silent = columns.source_of(Slot("sigma")) is None and not columns.all_of("deviation", "spread")
    if free and scatter > 0 and silent:
        sigma = scatter / np.sqrt(shots)
        names = replace(names, values={**names.values, Slot("sigma"): (sigma, UNITS_BY_NAME["m"])})
        words += f", so sigma is {1e6 * sigma:.3g} um; errors common to all shots of a point are not included"
    return replace(columns, names=names, table=table), [words]


MAX_KINDS = 12  #: Most different texts of a column that tells loads, states or targets apart.
CONDITIONS = ("run", "pose", "marker", "station", "state", "loading", "mass", "force", "moment", "joint")
"""Quantities that tell the readings of a file apart."""


def untold_readings(columns: Columns) -> list[str]:
    """Find a column that alone tells readings of one point under one load apart, and that is not read.

    Its words may be loads, states or targets in a language that nobody knows here.

    Args:
        columns: The columns of the file.

    Returns:
        A warning that names the column, if other columns tell unloaded from loaded readings; else nothing.

    Raises:
        InputError: Names the column and its words, if no other column tells unloaded from loaded readings.
    """
    table, kinds = columns.table, (*CONDITIONS, "series", "fixed", "direction")
    told = [np.array(table.texts(c.index)) for c in columns.all_of(*kinds)]
    code = number_rows(*told) if told else np.zeros(table.rows, dtype=int)
    shared = np.bincount(code)[code] > 1
    if columns.names.map.file.average or 2 * shared.sum() < table.rows:
        return []
    for k, name in enumerate(table.names):
        texts = list(dict.fromkeys(table.texts(k)))
        if name not in columns.ignored or not 1 < len(texts) <= MAX_KINDS or _counts(texts):
            continue
        if (repeats(code, number_rows(np.array(table.texts(k)))) > 0).any():
            continue
        few = ", ".join(map(repr, texts[:3])) + ", ..." * (len(texts) > 3)
        loads = columns.all_of("state", "mass", "force")
        if any(len({*table.texts(c.index)}) > 1 for c in loads):
            return [f"warning: readings of one point differ in {name} ({few}), which is not read"]
        hint = f'mass_kg, force_z, state or marker = "{name}"'
        hint += "; or, if rows are repeated readings, write average = true in [file]"
        problem = f"readings of one point differ only in this column ({few}), which is not read"
        raise table.header_error(f"{problem}; state what it is in [columns] of a map, as {hint}", name)
    return []


def _counts(texts: Sequence[str]) -> bool:
    """Whether texts are numbers that count from 0 or 1, numbers without 0, or times."""
    numbers = {*map(number_of, texts)} - {None}
    if len(numbers) < len(texts):
        return clock(texts) is not None
    return 0 not in numbers or numbers == {*range(len(texts))}


# --- Reader of measured runs from a text file of an instrument, a spreadsheet or a robot --------------------

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


def pair(
    table: TableCells, conditions: RowConditions, read: FileReadings, gauge: Ids | None = None
) -> Paired:
    """Pair unloaded and loaded readings of a table to runs.

    Args:
        table: The table.
        conditions: Poses, loads and states of its rows.
        read: Readings of its rows.
        gauge: Which of the gauges that touch a marker in turn each row is of, (rows,); None without gauges.

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
    return _state_by_state(table, conditions, read, marker, gauge)


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
        each = (
            f"expected one line for each of {', '.join(read.markers)}; leave the cells of a lost target blank"
        )
        for k in np.flatnonzero(short)[:1]:
            raise table.error(first[k], "", f"run {run[k]}: {each}")
    before, after = (readings_by_group(read, code, read.after == state) for state in (False, True))
    notes = () if own.run is not None else (f"{len(first)} runs are numbered in their order",)
    return Paired(first, run, first[code], before, after, notes)


def _gauges(conditions: RowConditions, read: FileReadings, lines: FileLines) -> Ids:
    """Number the directions along which each marker is read in a pose, in their order, (rows,)."""
    marker = read.marker[: len(lines.gauge)]
    point = number_rows(conditions.pose, conditions.station, conditions.run, marker).tolist()
    found, gauge = dict[int, list[bytes]](), np.zeros(len(point), dtype=int)
    for row, (own, direction) in enumerate(zip(point, lines.direction, strict=True)):
        before = found.setdefault(own, [])
        if (key := direction.tobytes()) not in before:
            before.append(key)
        gauge[row] = before.index(key)
    return gauge


def _state_by_state(
    table: TableCells, conditions: RowConditions, read: FileReadings, marker: Ids, gauge: Ids | None
) -> Paired:
    """Pair readings if a row holds one state; an unloaded one serves its run, or all loads of its pose."""
    own, loaded = conditions, np.zeros(table.rows, dtype=bool)
    loaded[read.row] = read.after
    if loaded.all() or not loaded.any():
        have = "loaded" if loaded.any() else "unloaded"
        hint = "if the others are in another file or sheet, testbench data check --loaded FILE reads both; "
        hint += 'if names hold the state, as P1_loaded, write "{marker}_{when}" in [cells] of a map'
        if {*DIFFERENCES} <= {re.sub("^(δ|delta)", "d", plain(name)) for name in table.names}:
            hint = "if dx, dy, dz are loaded minus unloaded positions, state it in [columns] of a map, as "
            hint += 'before_x = "X", deflection_x = "dX"'
        raise table.error(0, "", f"expected unloaded and loaded readings, all are {have}; {hint}")
    # Number readings of one pose, load and state; unloaded rows have no load.
    load = np.column_stack([own.wrench, own.point]) * loaded[:, None]
    code = number_rows(own.pose, own.station, own.run, loaded, load, gauge)
    if own.run is None:
        code = _repeated(table, code, marker)
    again = repeats(code, marker) > 0
    table.refuse(again, "", "this marker was read before in the same run, pose, state and load")
    first, position = first_rows(code), readings_by_group(read, code)
    # Find the unloaded reading of every loaded one; joints must not move in between.
    hung, idle = np.flatnonzero(loaded[first]), np.flatnonzero(~loaded[first])
    row, unloaded = first[hung], _belongs(table, own, first[idle], first[hung], gauge)
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
    notes = [f"{shared} unloaded readings count for several loads each"] * bool(shared)
    if len(alone):
        lines = ", ".join(str(table.lines[r]) for r in idle[alone[:5]])
        notes.append(f"{len(alone)} unloaded readings have no loaded reading (lines {lines} ...)")
    return notes


def _repeated(table: TableCells, code: Ids, marker: Ids) -> Ids:
    """Split groups at a repeated marker, (rows,): the second reading of each marker is a second run."""
    again = repeats(code, marker)
    if not again.any():
        return code
    count = np.zeros((int(code.max()) + 1, int(marker.max()) + 1), dtype=int)
    np.add.at(count, (code, marker), 1)
    uneven = (count != count.max(axis=1, keepdims=True)).any(axis=1)
    problem = "this marker has more readings in its pose and load than the others: "
    problem += "add a column run that tells measurements apart, or leave the row out"
    table.refuse((again > 0) & uneven[code], "", problem)
    return number_rows(code, again)


def _belongs(table: TableCells, conditions: RowConditions, idle: Ids, rows: Ids, gauge: Ids | None) -> Ids:
    """Find the unloaded reading of each loaded one, (runs,): that of the run, else of the pose.

    Args:
        table: The cells.
        conditions: Conditions of every row.
        idle: First rows of the unloaded readings, in the order of the file.
        rows: First rows of the loaded readings.
        gauge: Gauge of every row, which reads both; None without gauges.
    """
    found = _last(number_rows(conditions.pose, conditions.station, gauge), idle, rows)
    of_run = np.full(len(rows), -1)
    if conditions.run is not None:
        key = number_rows(conditions.pose, conditions.station, conditions.run, gauge)
        of_run = _last(key, idle, rows)
    if conditions.taken_off is not None:
        for row in rows[conditions.taken_off[rows] & (of_run < 0)][:1]:
            raise table.error(row, "", "loading off: expected an unloaded reading of the same run")
    for row in rows[found < 0][:1]:
        hint = (
            "" if conditions.named else "; there is no column of poses, so rows of equal joints are one pose"
        )
        problem = f"expected an unloaded reading in pose {conditions.pose[row]}, got loaded ones only{hint}"
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
    return [f"{words}; deflections contain this difference"] if most > SAME_POSE else []


def not_held(which: str, line: int, by: float) -> str:
    """Write the message about a joint that moved between two readings which belong together.

    Args:
        which: Which of the two the other line holds, such as "unloaded".
        line: The line of the other reading.
        by: Largest difference of a joint coordinate [rad, m].

    Returns:
        The message.
    """
    return (
        f"expected the same joints as in the {which} reading of line {line}; one differs by {by:.2g} rad or m"
    )


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
    untold = untold_readings(columns)
    lines = read_lines(columns, _states(columns, conditions.loaded))
    read = read_readings(columns, arm, conditions.loaded, lines)
    runs = pair(columns.table, conditions, read, None if lines is None else _gauges(conditions, read, lines))
    _check_once(columns, conditions, runs, read)
    scatter = read_scatter(columns, sigma)
    data = _dataset_of(columns, select_rows(conditions, runs.row), runs, read, scatter, lines)
    if lines is not None:
        covariances = data.precision if columns.all_of("covariance") else None
        data = _with_lines(data, lines, arm, (runs, read), scatter.sigma, covariances)
    along = () if lines is None else lines.notes
    notes = (
        *columns.warnings,
        *untold,
        *conditions.notes,
        *runs.notes,
        *scatter.notes,
        *along,
        *dropped,
        *shots,
    )
    return Export(data, columns, notes)


def _dataset_of(
    columns: Columns,
    own: RowConditions,
    runs: Paired,
    read: FileReadings,
    scatter: Scatter,
    lines: FileLines | None,
) -> Dataset:
    """The runs, with one sigma for the file or a covariance per reading; lost targets have zero weight."""
    lost = np.asarray((np.isnan(runs.before) | np.isnan(runs.after)).any(axis=-1))
    before, after = _rotations(columns, runs.row)
    sigma = _of_the_file(columns, 0, scatter.sigma) if lines is None else float(scatter.sigma[0])
    precision = _precision(columns, read, runs, lost, lines)
    if precision is None and lost.any():
        precision = np.where(lost[..., None, None], 0.0, np.eye(3) / (2 * sigma**2))
    return Dataset(
        markers=read.markers,
        run_id=runs.run,
        pose_id=own.pose,
        q=own.q,
        wrench=own.wrench,
        point=own.point,
        before=np.where(lost[..., None], 0.0, runs.before),
        after=np.where(lost[..., None], 0.0, runs.after),
        sigma=sigma,
        rotation_before=before,
        rotation_after=after,
        sigma_rotation=None if before is None else _of_the_file(columns, 1, scatter.sigma_rotation),
        precision=precision,
        station=own.station,
        unloaded_after_load=own.taken_off,
    )


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
    # Of rows of one state, those of the loaded readings hold the conditions of their run.
    some, lost = np.isin(runs.leader, runs.row), ~data.is_measured
    at = np.searchsorted(runs.row, runs.leader[some]), read.marker[: len(some)][some]
    direction, tilt, reach = place_lines(select_rows(lines, some), arm, data.markers, data.q, at)
    own, along = np.full(lost.shape, data.sigma), np.asarray(direction.any(axis=2) & ~lost)[..., None]
    own[at] = sigma[some]
    P = np.eye(3) / (2 * own[..., None, None] ** 2) * ~lost[..., None, None]
    P = P if covariances is None else covariances
    meter = reach[..., None] > 0  # read along the x axis before its direction was known
    before, after = (np.where(meter, x[..., :1] * direction, x) for x in (data.before, data.after))
    return replace(
        data,
        before=before,
        after=after,
        precision=np.where(along[..., None], line_precision(direction, own), P),
        line_direction=direction,
        line_direction_deviation=tilt,
        line_length=reach,
    )


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
    if column := columns.found.get(Slot("sigma", index)):
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
