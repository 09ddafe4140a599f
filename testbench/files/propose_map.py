"""A map proposed for an export: by the layout that fits it, else by the names of its columns.

What only values tell is a guess: the map has it as a comment, and `testbench data map` says it.
"""

import json
import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from testbench.arm.document import is_decimal
from testbench.arm.folder import Arm
from testbench.data.dataset import Series
from testbench.errors import InputError, Mask, some_of
from testbench.files.beside import (
    MIN_POSES,
    NOTATIONS,
    OrientationFit,
    UnclearNotation,
    clear_fit,
    fits_of,
    unclear,
)
from testbench.files.guess import (
    DIRECTED,
    Entry,
    gauges_in_names,
    loads_in_names,
    lost_words,
    reasons,
)
from testbench.files.guessed_columns import (
    columns_by_name,
    has_joints,
    ordered_joints,
    orientation_columns,
    require_positions,
)
from testbench.files.guessed_names import TARGETS, WORD, names_by_cells
from testbench.files.layouts import ExportLayout, Fitting, stated_length_unit
from testbench.files.mapping import Log, Map, read_map, without_holes
from testbench.files.names import (
    ROTATIONS,
    are_markers,
    column_meaning,
    joints_of,
    places,
    series_names,
    squeeze,
)
from testbench.files.read_series import read_series
from testbench.files.read_unknown import (
    ReadFile,
    file_entries,
    lines_above,
    read_unknown,
    sheets_of,
    unit_in_cells,
)
from testbench.files.rearranged import (
    ASKED,
    DIRECTION,
    join_log,
    keys_of,
    nearest_times,
    parts_in,
    stack_columns,
    times_of,
    with_loaded,
)
from testbench.files.table import TableCells
from testbench.files.text import UnevenRows

# --- The log of a robot, joined to the readings of an instrument by names, by times or by the order of rows

SOON = 30.0  #: Farthest row of a log that may be of a reading [s].


def find_join(table: TableCells, log: TableCells, *fits: Fitting | None) -> tuple[Log, Mask]:
    """Find how rows of a log belong to those of a table: by names that it has once each, else by time.

    Args:
        table: The table.
        log: The log.
        fits: The layouts of both, which may say the columns of times.

    Returns:
        That, and which rows of the table have none, the fewer ones, (rows,).
    """
    every = {name: [*map(squeeze, keys_of(log, [name]))] for name in log.names}
    once = {name: {*texts} for name, texts in every.items() if len({*texts}) == len(texts)}
    for ours, (theirs, texts) in product(dict.fromkeys(table.names), once.items()):
        own = [*map(squeeze, keys_of(table, [ours]))]
        alone = np.array([text not in texts for text in own], dtype=bool)
        if alone.mean() < 0.5 and len({*own}) > 1:
            called = squeeze(ours) == squeeze(theirs) or {*map(column_meaning, (ours, theirs))} == {"name"}
            same = called and {*own} <= texts and all(text.isdecimal() for text in texts)
            if same or not all(map(is_decimal, own)):  # numbers are no names, unless both are called so
                return Log(file=log.path.name, on=[ours], to=[theirs]), alone
    for ours, (theirs, _) in product(dict.fromkeys(table.names), once.items()):
        if {column_meaning(ours), column_meaning(theirs)} == {"name"}:
            rows = parts_in(keys_of(table, [ours]), keys_of(log, [theirs]))
            if (rows >= 0).all() and len({*rows.tolist()}) == log.rows > 1:
                how = Log(file=log.path.name, on=[ours], to=[theirs], parts=True)
                return how, np.zeros(table.rows, dtype=bool)
    both = [_times(own, one) for own, one in zip((table, log), fits, strict=True)]
    if not all(both):
        count = table.rows // max(log.rows, 1)
        if table.rows != count * log.rows or not _in_turn(table, count):
            got = f"{table.rows} readings and {log.rows} rows of the log"
            problem = "expected names or times in both files, or equally many rows or poses in both"
            raise InputError(log.path, "", f"{problem}, got {got}")
        return Log(file=log.path.name, rows=count), np.zeros(table.rows, dtype=bool)
    when = [times_of(own, names) for own, names in zip((table, log), both, strict=True)]
    late = np.abs(when[1][nearest_times(*when)] - when[0])
    alone = late > SOON
    apart = float(late[~alone].max() if alone.mean() < 0.5 else late.max())
    if apart > SOON:
        problem = f"expected a row within {SOON:g} s of every reading, but one reading is {apart:.4g} s away"
        raise InputError(log.path, "", f"{problem}; do the clocks agree?")
    how = Log(file=log.path.name, on=both[0], to=both[1], within_s=max(1.0, float(np.ceil(2 * apart))))
    return how, alone


def _times(table: TableCells, fits: Fitting | None) -> list[str]:
    """The columns that say together when a row was read: those of its layout, else by their names."""
    own = [name for name in fits.layout.times if name in table.names] if fits else []
    return own or [name for name in table.names if column_meaning(name) == "when"]


def _in_turn(table: TableCells, count: int) -> bool:
    """Whether rows stand together: their names are those of the targets in each group, or one name."""
    if count <= 1:
        return count == 1
    names = [keys_of(table, [name]) for name in table.names if column_meaning(name) == "name"]
    parts = [zip(*map(WORD.findall, texts), strict=False) for texts in names]
    for texts in (*names, *(words for own in parts for words in own)):
        groups = [{*texts[k : k + count]} for k in range(0, len(texts), count)]
        one_each = {*map(len, groups)} == {1} and len({*texts}) == len(groups)
        if one_each or (len(groups[0]) == count and all(group == groups[0] for group in groups)):
            return True
    return False


# --- A map proposed for an export: by the layout that fits it, else by the names of its columns ------------

WHOLES = {"joint": "{joints_", "reading": "{position_"}  #: Quantities that a cell may hold together.
STATED = {"series", "columns", "optional", "scale", "cells", "words", "values"}
"""Tables of a map by which a layout says what columns mean."""


def map_text(entries: Sequence[Entry]) -> str:
    """Write entries as a TOML map, grouped by table; of several entries with one key, the first counts.

    Args:
        entries: Lines of the map.

    Returns:
        The text; guesses carry their reason as a comment.
    """
    tables: dict[str, dict[str, str]] = {}
    for table, key, value, why in entries:
        name, said = (json.dumps(x, ensure_ascii=False) for x in (key, value))
        name = key if key.isidentifier() and key.isascii() else name
        tables.setdefault(table, {}).setdefault(
            name, f"{name} = {said}" + (f"  # guess: {why}" if why else "")
        )
    return "".join("\n".join([f"[{table}]", *own.values(), ""]) for table, own in tables.items())


@dataclass(frozen=True)
class Proposal:
    """Hold a proposed map, and the layouts that it is based on."""

    entries: tuple[Entry, ...]
    layouts: tuple[str, ...]  #: Layouts that fit the export and its log, with their titles.
    asked: str = ""  #: What the user has to say about orientations, which are not read; "" for nothing.

    def map(self) -> Map:
        """Build the map from the entries.

        Returns:
            The map.
        """
        return Map.model_validate(tomllib.loads(map_text(self.entries)))


def propose(
    path: Path,
    arm: Arm,
    log: Path | None,
    beside: Path,
    layout: str | None = None,
    loaded: Path | None = None,
) -> Proposal:
    """Propose the map of an export, and of the robot's log that belongs to it.

    Args:
        path: The export.
        arm: The arm that was measured.
        log: The robot's log with its joints; None where the export has them.
        beside: The folder where the map will be; the path of the log is relative to it.
        layout: Name of the layout that the export has; None for the one that fits.
        loaded: Another file or sheet of the same columns, with the loaded readings; None without one.

    Returns:
        The map's lines, and the layouts that fit.

    Raises:
        InputError: When a file is given twice, is no table, fits several layouts, lacks joints or positions,
            or cannot be joined to the log.
    """
    if path in (log, loaded):
        raise InputError(path, "", "expected another file for --log or --loaded: this one has the readings")
    # Read the file, with its sheets or the file of its loaded readings.
    sheets = sheets_of(path, arm, layout) if loaded is None else []
    export = read_unknown(path, arm, layout, sheets)
    table = export.table
    entries = file_entries("file", export.file)
    every = [export]
    if export.fits is None:
        _require_names(table)
    if loaded is not None:
        table = with_loaded(table, read_unknown(loaded, arm, layout).table)
        entries.append(Entry("loaded", "file", os.path.relpath(loaded, beside)))
    # Rearrange it as the map will: columns of several loads or gauges, merged cells, the log.
    table, patterns = _stacked(table, arm)
    if log is None:
        table, points = _with_whole_rows(table, arm)
    else:
        table, points, read = _joined(table, log, arm, export.fits, beside)
        every.append(read)
    # Find what its columns mean: as layouts state it, else by their names and cells.
    above = export.fits.above if export.fits else lines_above(export.table)
    length = stated_length_unit(above) or unit_in_cells(table)
    length = length or (export.fits and export.fits.layout.length) or ""
    angle, said = "", dict[str, str]()
    entries += points
    for source in every:
        if source.fits:
            own, of = _stated(source.fits.layout, source.table, table, arm)
            entries += own
            said |= of
            angle = source.fits.layout.angle or angle
    what = {*said.values()}
    entries += columns_by_name(table, arm, length=length, angle=angle, said=what)
    entries += names_by_cells(table, arm, said)
    entries = [_with_holes(own, patterns) for own in entries]
    asked = ""
    if not what & {*ROTATIONS}:
        turned, asked = _orientations(path, arm, table, entries, log)
        entries += turned
    layouts = tuple(f"{fits.name} ({fits.layout.title})" for fits in (own.fits for own in every) if fits)
    return Proposal(tuple(entries), layouts, asked)


def _require_names(table: TableCells) -> None:
    """Refuse a table whose header holds numbers: no line of the file names the columns."""
    if sum("." in name and is_decimal(name) for name in table.names) > 1:
        got = some_of(table.names)
        hint = "add a line of names above the table, or list them as names in [file] of a map"
        raise table.header_error(f"expected a line with the names of the columns, got {got}; {hint}")


def _stacked(table: TableCells, arm: Arm) -> tuple[TableCells, dict[str, str]]:
    """The table with columns of several loads, or of several gauges, below each other.

    Returns:
        The table; and the pattern of the names of each stacked column, by its name.
    """
    patterns, loads = loads_in_names(table, arm)
    patterns = patterns or gauges_in_names(table, arm)
    if patterns:
        table = stack_columns(table, patterns, loads, arm.markers)
    return table, {without_holes(pattern): pattern for pattern in patterns}


def _with_whole_rows(table: TableCells, arm: Arm) -> tuple[TableCells, list[Entry]]:
    """The table with filled merged cells and without rows that lack joints; what the map says of both."""
    joint, entries = joints_of(arm), list[Entry]()
    joints = [k for k, name in enumerate(table.names) if joint(name)]
    blank = [table.blank(k) for k in joints] or [np.zeros(table.rows, dtype=bool)]
    alone = np.all(blank, axis=0)
    if merged := _merged(table, arm, alone, joints):
        entries = [Entry("file", "merged", True, "joints are only in the first row of each pose")]
        table, alone = table.filled(merged), np.zeros(table.rows, dtype=bool)
    table, points = _of_the_arm(table, alone)
    return table, [*entries, *points]


def _joined(
    table: TableCells, log: Path, arm: Arm, fits: Fitting | None, beside: Path
) -> tuple[TableCells, list[Entry], ReadFile]:
    """Join the robot's log to an export.

    Returns:
        The table with the columns of the log; what the map says of the log and of points without a row in it;
        how the log was read.
    """
    try:
        read = read_unknown(log, arm)
    except UnevenRows as err:
        raise InputError(
            log, "", f"expected a table with columns of the joints, got no table; {ASKED}"
        ) from err
    ordered = read.fits is not None and read.fits.layout.joints is not None
    if not ordered and not any(has_joints(own, arm) for own in (read.table, table)):
        got = f"got columns {some_of(read.table.names)}" if read.table.names else "got none"
        raise InputError(log, "", f"expected columns of the joints, such as A1 to A6, {got}; {ASKED}")
    try:
        how, alone = find_join(table, read.table, fits, read.fits)
    except InputError:
        if fits is None:
            require_positions(table, arm)  # without them it is no table of readings
        raise
    table, points = _of_the_arm(table, alone)
    keys = {**how.model_dump(exclude_defaults=True), "file": os.path.relpath(log, beside)}
    why = {
        "rows": "no names or times in common, but these counts agree",
        "parts": "each name here contains a name of the log",
    }
    entries = [Entry("log", key, value, why.get(key, "")) for key, value in keys.items()]
    entries += file_entries("log.table", read.file)
    return join_log(table, read.table, how), [*entries, *points], read


def _with_holes(entry: Entry, named: Mapping[str, str]) -> Entry:
    """A line of the map with the pattern of stacked columns; the line itself of other columns."""
    pattern = named.get(entry.value, "") if isinstance(entry.value, str) else ""
    if not pattern:
        return entry
    why = f"{DIRECTED} (in the names)" if f"{{{DIRECTION}}}" in pattern else ""
    return entry._replace(value=pattern, why=reasons(entry.why, why))


def _of_the_arm(table: TableCells, alone: Mask) -> tuple[TableCells, list[Entry]]:
    """Without rows that have no joints, such as of a nest, where targets have other names there."""
    names = [name for name in table.names if column_meaning(name) == "name"] if alone.any() else []
    for name in reversed(names):  # a pose is named before its targets
        texts = np.array(keys_of(table, [name]))
        targets, others = {*texts[~alone].tolist()}, {*texts[alone].tolist()}
        if not targets & others and len(targets) <= min(TARGETS, len(texts) / 2):
            own = Entry("words", "ignore", sorted(others), f"no joints for {', '.join(sorted(others))}")
            return table.take(~alone), [Entry("columns", "marker", name), own]
    return table, []


def _merged(table: TableCells, arm: Arm, alone: Mask, joints: Sequence[int]) -> list[int]:
    """Columns of merged cells, of a table that states joints once for the rows of a pose; none of another.

    Args:
        table: The table.
        arm: The arm, with the names of its markers.
        alone: Rows without joints, (rows,).
        joints: Places of the columns of joints.
    """
    if not alone.any() or alone[0]:
        return []
    place = places(arm)
    others = [k for k, name in enumerate(table.names) if name and k not in joints and not place(name)]
    alike = [k for k in others if np.array_equal(table.blank(k), alone)]
    named = any(are_markers(table.texts(k), arm) for k in others)
    return [*joints, *alike] if alike or named else []


def _stated(
    layout: ExportLayout, source: TableCells, table: TableCells, arm: Arm
) -> tuple[list[Entry], dict[str, str]]:
    """The map of a layout, and the quantity of each column that it names.

    Args:
        layout: The layout.
        source: The table of the file that it fits.
        table: The export, with what the log adds.
        arm: The arm.
    """
    names = read_map(layout, arm, series_names)
    said: dict[str, str] = {
        name: own.slot.what for name in table.names if (own := names.find(name)) and own.mapped
    }
    for name, patterns in layout.cells.items():
        said[name] = next((what for what, hole in WHOLES.items() if hole in str(patterns)), "")
    parts = layout.model_dump(include=STATED, exclude_defaults=True)
    entries = [Entry(part, key, _only(own)) for part, pairs in parts.items() for key, own in pairs.items()]
    if "lost" not in layout.words:
        entries += lost_words(table, [k for k, name in enumerate(table.names) if said.get(name) == "reading"])
    if layout.joints and layout.angle:
        entries += ordered_joints(layout.joints, source, arm, layout.angle)
        said[layout.joints.values] = "joint"
    return entries, said


def _only(value: object) -> object:
    """The text of a list of one, as a map states it; anything else as it is."""
    return value[0] if isinstance(value, list) and len(value) == 1 else value


def _orientations(
    path: Path, arm: Arm, table: TableCells, entries: Sequence[Entry], log: Path | None
) -> tuple[list[Entry], str]:
    """The columns of orientations, in the notation that fits the arm, and what is unclear about them."""
    ours = read_map(None, arm, series_names)
    if any((named := ours.find(name)) and named.slot.what == "rotation" for name in table.names):
        return [], ""  # a rotation vector, or angles that a map names
    own = [Entry("log", "file", os.path.relpath(log, path.parent))] if log else []
    found, asked = list[tuple[OrientationFit, list[Entry]]](), ""
    for columns in orientation_columns(table):
        tried = [*own, *entries, *columns]
        try:
            export = read_series(path, arm, Proposal(tuple(tried), ()).map())
        except UnclearNotation as err:
            asked = asked or str(err).partition(f"{NOTATIONS}; ")[2]
            continue
        except InputError:
            continue  # of pairs, or no orientations
        if fit := export.fit or fit_of_series(arm, export.series[0]):
            if not export.fit:
                fit = replace(fit, notation=f"{columns[0].key} = {columns[0].value}")
            why = f"only this one fits the nominal arm: {fit}"
            stated = [Entry("series", "rotation", fit.notation, why)] if export.fit else []
            found.append((fit, [*columns, *stated]))
    fits = sorted((fit for fit, _ in found), key=lambda fit: fit.score)
    if not fits:
        return [], asked and f"state rotation in [series] of the map: {asked}"
    best = clear_fit(fits)
    if best is None:
        return [], f"the columns of orientations: {unclear(fits)}"
    return next(columns for fit, columns in found if fit is best), ""


def fit_of_series(arm: Arm, series: Series) -> OrientationFit | None:
    """Fit frame and mount to the orientations of a series, and to the positions of its first target.

    Args:
        arm: The arm; its drawn geometry counts.
        series: Absolute readings.

    Returns:
        The fit; None without enough orientations.
    """
    some = series.is_oriented & series.is_measured[:, 0]
    if series.rotation is None or some.sum() < MIN_POSES:
        return None
    tried = {"as read": series.rotation[some]}
    return fits_of(arm, series.q[some], series.position[some, 0], tried)[0]
