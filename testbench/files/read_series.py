"""Reader of absolute readings from a text file of a tracker, a spreadsheet or a robot.

Readings of several targets at one time form one row of a series.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.dataset import Series, select_rows, series_from_runs
from testbench.errors import Array, Ids, check_type, some_of, stem_of
from testbench.files.beside import (
    MIN_POSES,
    NOTATIONS,
    FixedPoints,
    OrientationFit,
    UnclearNotation,
    clear_fit,
    fits_of,
    notations,
    read_fixed_points,
    read_rotations,
    read_temperature,
    read_time,
    read_torques,
    unclear,
    unsaid_angles,
)
from testbench.files.columns import (
    Columns,
    RowConditions,
    first_rows,
    number_rows,
    read_columns,
    read_conditions,
    repeats,
)
from testbench.files.mapping import Map, read_map
from testbench.files.names import ROTATIONS, WHEN, Slot, What, series_names
from testbench.files.read_pairs import (
    HELD,
    FileReadings,
    Scatter,
    average_shots,
    markers_only,
    not_held,
    read_distances,
    read_readings,
    read_scatter,
    readings_by_group,
    runs_of,
    untold_readings,
)

ALONE = "target"
"""Name of a file's only target if the arm has several."""
APART = 0.02
"""Distance of two readings of one target in one pose beyond which they are of two targets [m]."""
TURNED_APART = 1e-6
"""Difference of two orientations up to which they count as equal [1]."""
SERIES_QUANTITIES: tuple[What, ...] = ("time", "temperature", "torque", *ROTATIONS)
"""Quantities of absolute readings that pairs do not have."""
Point = tuple[float, ...] | None
"""A fixed point [m], of a plane with its normal, (3,) or (6,); None of positions."""
NAMES: tuple[What, ...] = ("series", "station", "series_frame", "series_target")
"""Columns that divide a file into series, or name what series share."""


@dataclass(frozen=True)
class SeriesExport:
    """Hold a file of absolute readings that was read, and how it was understood."""

    series: tuple[Series, ...]  #: One series for every station that the file names.
    columns: Columns  #: Meaning of its columns.
    notes: tuple[str, ...]  #: Assumptions, omissions and numbering.
    fit: OrientationFit | None = None  #: The fitted notation of angles, where nothing states it.


def read_series(
    path: str | Path,
    arm: Arm,
    mapping: str | Path | Map | None = None,
    sigma: float | None = None,
    load: float | None = None,
) -> SeriesExport:
    """Read and check absolute readings of an arm; both readings of a deflection are one each.

    Args:
        path: The file; docs/formats.md says what it may hold.
        arm: The arm that was measured.
        mapping: A map of its names, or its TOML file; None where it uses ours.
        sigma: Standard deviation of a position along an axis [m], where neither file nor map has one.
        load: Mass that hangs in loaded rows [kg], where neither file nor map has a load.

    Returns:
        A series for every set-up that the file names, and what was understood.

    Raises:
        InputError: Names line and column, or key of the map, and what was expected.
        BenchError: When arm is no Arm.
    """
    check_type(arm, Arm, "arm")
    path = Path(path)
    mapping = Path(mapping) if isinstance(mapping, str) else mapping
    names = replace(read_map(mapping, arm, series_names), load=load)
    arm = replace(arm, markers=names.markers)
    return _series_of_columns(read_columns(path, names, arm), arm, sigma)


def _series_of_columns(columns: Columns, arm: Arm, sigma: float | None) -> SeriesExport:
    """Convert the columns of a table to series."""
    if any(c.slot.when for c in columns.all_of("reading")):
        return _pairs(columns, arm, sigma)
    meters = _of_distances(columns)
    # Drop points that are no markers, and average shots.
    columns, notes = markers_only(columns)
    columns, shots = average_shots(columns)
    # A file without loads is of unloaded readings, unless a column states loaded ones.
    state = columns.found.get(Slot("state"))
    words = set() if state is None else set(columns.table.texts(state.index))
    loaded = any(columns.names.word(word, WHEN) == "after" for word in words)
    conditions = read_conditions(columns, arm, needs_load=loaded)
    notes += untold_readings(columns)
    # Without a column of markers all readings are of one target.
    alone = len(arm.markers) > 1 and columns.found.get(Slot("marker")) is None
    alone = alone and not any(c.slot.marker for c in columns.all_of("reading"))
    if alone:
        arm = replace(arm, markers=(ALONE,))
        notes.append(f"no column names the marker: all readings count as those of one, called {ALONE!r}")
    read = (read_distances if meters else read_readings)(columns, arm, conditions.loaded)
    if alone and not meters:
        _check_alone(columns, conditions, read)
    # One series of all rows, then one per station.
    scatter = read_scatter(columns, sigma)
    fit = _fitted_notation(columns, arm, conditions, read)
    whole, first, more = _assembled(columns, arm, (conditions, read, scatter), fit)
    fixed = read_fixed_points(columns) if meters else None
    aside = [] if meters else [c.name for c in columns.all_of("distance", "fixed")]
    notes += [f"warning: these columns are not read beside positions: {', '.join(aside)}"] * bool(aside)
    notes += [*columns.warnings, *shots, *conditions.notes, *scatter.notes, *more]
    notes += [] if fixed is None else fixed.notes
    if columns.names.map.frame == "base":
        notes.append("the map says that readings are in the base's frame, but the frame is fitted anyway")
    parts = _parted(columns, whole, first, scatter, fixed)
    return SeriesExport(parts, columns, tuple(notes), fit)


def _of_distances(columns: Columns) -> bool:
    """Tell whether the readings are distances to fixed points; refuse positions and distances in one file."""
    fixed, distances, others = (
        columns.all_of(*what) for what in (("fixed",), ("distance",), ("reading", *ROTATIONS))
    )
    if fixed and distances and others:
        problem = "expected distances, or positions and orientations, got both; use a file for each"
        raise columns.table.header_error(problem)
    return bool(fixed or distances) and not others


def _pairs(columns: Columns, arm: Arm, sigma: float | None) -> SeriesExport:
    """Convert runs, whose rows hold both readings, to series."""
    export = runs_of(columns, arm, sigma)
    said, stem = columns.names.map.series, stem_of(columns.table.path)
    series = series_from_runs(export.data, stem, said.target or stem)
    series = tuple(
        replace(s, joint_columns=columns.joints, frame=s.frame.replace(s.name, said.frame or s.name, 1))
        for s in series
    )
    unread = [c.name for c in columns.all_of(*SERIES_QUANTITIES) if not c.slot.when]
    warning = f"warning: these columns are not read beside pairs: {', '.join(unread)}"
    notes = (*export.notes, *[warning] * bool(unread), "a run is two readings, unloaded and loaded")
    return SeriesExport(series, columns, notes)


def _check_alone(columns: Columns, conditions: RowConditions, read: FileReadings) -> None:
    """Refuse several positions in one pose under one load: they are of several targets."""
    key = np.column_stack([conditions.q, conditions.wrench])
    same = (key[1:] == key[:-1]).all(axis=1)
    apart = np.linalg.norm(np.diff(read.position, axis=0), axis=1) > APART
    problem = f"expected a column 'marker': the row above has the same pose, but is {APART} m away or more"
    columns.table.refuse(np.append(False, same & apart), "", problem)


def _assembled(
    columns: Columns,
    arm: Arm,
    rows: tuple[RowConditions, FileReadings, Scatter],
    fit: OrientationFit | None,
) -> tuple[Series, Ids, list[str]]:
    """Convert all rows of a file to one series without a name, each with a covariance.

    Returns:
        The series, the first row of the table of each of its rows, and notes on unread columns and rows.

    Raises:
        InputError: Names line and column.
    """
    conditions, read, scatter = rows
    # Rows of one reading, and their positions by target.
    table, m = columns.table, len(read.markers)
    code = _grouped(columns, conditions, read) if read.long and m > 1 else np.arange(table.rows)
    first, position = first_rows(code), readings_by_group(read, code)
    own = select_rows(conditions, first)
    lost = np.asarray(np.isnan(position).any(axis=2))
    # Inverse covariance of every position, zero for lost targets.
    P = np.zeros((len(first), m, 3, 3))
    P[code[read.row], read.marker] = _precision(scatter)[read.row]
    P[lost] = 0
    # Readings other than positions.
    temperature, warm = read_temperature(columns)
    time, timed = read_time(columns)
    torque, rotation = read_torques(columns, arm), read_rotations(columns, fit.notation if fit else "")
    whole = Series(
        name="",
        markers=read.markers,
        frame="",
        mount="",
        row_id=table.lines[first] if own.run is None else own.run,
        pose_id=own.pose,
        q=own.q,
        wrench=own.wrench,
        point=own.point,
        position=np.where(lost[..., None], 0.0, position),
        sigma=float(np.median(scatter.sigma)),
        precision=P,
        rotation=None if rotation is None else _one_each(columns, rotation, code, first),
        sigma_rotation=None if rotation is None else float(np.median(scatter.sigma_rotation)),
        torque=None if torque is None else torque[first],
        temperature=None if temperature is None else temperature[first],
        time=None if time is None else time[first],
        joint_columns=columns.joints,
    )
    # Drop rows without any reading.
    there = whole.is_measured.any(axis=1) | whole.is_oriented
    if not there.any():
        raise table.error(0, "", "expected at least one reading, all are blank")
    turned = (
        [f"the angles are {fit.notation}, the only notation that fits the nominal arm: {fit}"] if fit else []
    )
    notes = [*turned, *warm, *timed]
    if not there.all():
        lines = some_of(table.lines[first[~there]])
        notes.append(f"rows without a reading are left out: {(~there).sum()} (line {lines})")
    return select_rows(whole, there), first[there], notes


def _fitted_notation(
    columns: Columns, arm: Arm, conditions: RowConditions, read: FileReadings
) -> OrientationFit | None:
    """Find the notation of three angles of which nobody says it, by the kinematics of the drawn arm.

    Raises:
        UnclearNotation: If none fits, several do, or there are too few poses.
    """
    found = unsaid_angles(columns)
    if found is None:
        return None
    angles, there, by_axis = found
    # Rows of the target that was read most often.
    target = int(np.bincount(read.marker).argmax()) if len(read.marker) else 0
    some = (read.marker == target) & np.isfinite(read.position).all(axis=1) & there[read.row]
    row, position = read.row[some], read.position[some]
    if len(np.unique(number_rows(conditions.q[row]))) < MIN_POSES:
        problem = f"{NOTATIONS}; testbench can find the notation from {MIN_POSES} poses or more"
        raise UnclearNotation(columns, problem)
    tried = notations(angles[row], by_axis)
    fits = fits_of(arm, conditions.q[row], position, tried)
    fit = clear_fit(fits)
    if fit is None:
        problem = f"{NOTATIONS}; {unclear(fits)}"
        raise UnclearNotation(columns, problem)
    return fit


def _grouped(columns: Columns, conditions: RowConditions, read: FileReadings) -> Ids:
    """Number the rows of each reading, (rows,): one row per target, in one pose under one load."""
    table = columns.table
    marker = np.empty(table.rows, dtype=int)
    marker[read.row] = read.marker
    found = columns.all_of("series", "series_frame", "series_target", "state", "fixed", "direction")
    words = (np.array(table.texts(column.index)) for column in found)
    # Equal conditions form a group; a repeated marker starts a new reading.
    own = conditions
    code = number_rows(own.wrench, own.point, own.pose, own.run, own.station, *words)
    code = number_rows(code, repeats(code, marker))
    # The joints of a reading must agree in all of its rows.
    leader = first_rows(code)[code]
    moved = np.abs(conditions.q - conditions.q[leader]).max(axis=1)
    table.refuse(
        moved > HELD, "", lambda row: not_held("same", int(table.lines[leader[row]]), float(moved[row]))
    )
    return code


def _precision(scatter: Scatter) -> Array:
    """Compute the inverse covariance of the positions in every row of the table, (rows, 3, 3) [1/m^2]."""
    if scatter.covariance is None:
        return np.asarray(np.eye(3) / scatter.sigma[:, None, None] ** 2)
    P = np.linalg.inv(scatter.covariance)
    return np.asarray((P + P.swapaxes(1, 2)) / 2)


def _one_each(columns: Columns, rotation: Array, code: Ids, first: Ids) -> Array:
    """Return the orientation of every reading, (readings, 3, 3), equal in all its rows; NaN without one."""
    there = np.asarray(np.isfinite(rotation).all(axis=(1, 2)))
    leader = np.full(len(first), -1)
    rows = np.flatnonzero(there)[::-1]
    leader[code[rows]] = rows  # the first one is written last
    found = np.where((leader >= 0)[:, None, None], rotation[leader], np.nan)
    differs = np.abs(rotation - found[code]).max(axis=(1, 2)) > TURNED_APART  # NaN differs from nothing
    name = columns.all_of(*ROTATIONS)[0].name
    columns.table.refuse(differs, name, "expected the same orientation in all rows of a reading")
    return found


def _parted(
    columns: Columns, whole: Series, first: Ids, scatter: Scatter, fixed: FixedPoints | None
) -> tuple[Series, ...]:
    """Divide the rows of a file by its columns of series and stations, and by fixed points.

    Args:
        columns: The columns of the file.
        whole: All rows as one series; of distances the first numbers of its positions.
        first: Row of the table of each.
        scatter: Noise of every row of the table.
        fixed: Fixed point of every row of the table; None of positions.
    """
    said, stem = columns.names.map.series, stem_of(columns.table.path)
    texts = [_texts(columns, what, first) for what in NAMES]
    points: list[Point] = [None] * len(first)
    if fixed is not None:
        both = np.column_stack([fixed.place, fixed.normal])[first]
        points = [tuple(own[np.isfinite(own)].tolist()) for own in both]
    keys = list(zip(points, *texts, strict=True))
    found = []
    for key in dict.fromkeys(keys):
        rows = np.array([k == key for k in keys])
        part = select_rows(whole, rows)
        own, turn = scatter.sigma[first[rows]], scatter.sigma_rotation[first[rows]]
        even = scatter.covariance is None and (own == own[0]).all() and part.is_measured.all()
        point, series, station, frame, target = key
        number = ""
        if fixed is not None:
            number = _number_of(point, [own for own, *rest in keys if rest[:2] == [series, station]])
        place, turned = " ".join(filter(None, (series, station, number))), bool(part.is_oriented.any())
        if fixed is not None and point is not None:
            x, y, z, *normal = point
            part = replace(
                part,
                position=np.zeros_like(part.position),
                distance=part.position[:, :, 0],
                fixed_point=(x, y, z),
                fixed_point_sigma=float(fixed.sigma[first[rows]].max()),
                plane_normal=(normal[0], normal[1], normal[2]) if normal else None,
                plane_normal_sigma=float(fixed.tilt[first[rows]].max()),
                distance_offset_sigma=float(fixed.zero_sigma[first[rows]].max()),
            )
        found.append(
            replace(
                part,
                name=f"{stem} {place}".strip(),
                frame=frame or f"{said.frame or stem} {place}".strip(),
                mount=target or said.target or stem,
                sigma=float(np.median(own)),
                rotation=part.rotation if turned else None,
                sigma_rotation=float(np.median(turn)) if turned else None,
                precision=None if even else part.precision,
            )
        )
    return tuple(found)


def _number_of(point: Point, every: Sequence[Point]) -> str:
    """Name a fixed point or plane by its place among those of a series; empty if it is the only one."""
    others = list(dict.fromkeys(every))
    kind = "plane" if point and len(point) > 3 else "point"
    return f"{kind} {others.index(point) + 1}" if len(others) > 1 else ""


def _texts(columns: Columns, what: What, first: Ids) -> list[str]:
    """Read the text of a column in some rows; empty without such a column."""
    column = columns.found.get(Slot(what))
    if column is None:
        return [""] * len(first)
    texts = columns.table.texts(column.index)
    blank = np.array([not text for text in texts], dtype=bool)
    columns.table.refuse(blank, column.name, "expected a name, got ''")
    return [texts[row] for row in first]
