"""A map proposed for an export: by the layout that fits it, else by the names of its columns.

What only values tell is a guess: the map has it as a comment, and `testbench data map` says it.
"""

import json
import os
import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path

import numpy as np

from testbench.arm.document import is_decimal
from testbench.arm.folder import Arm
from testbench.data.series import Series
from testbench.errors import InputError, Mask
from testbench.files.beside import NOTATIONS, UnclearNotation
from testbench.files.column_guesses import (
    TARGETS,
    Entry,
    angle_unit,
    columns_by_name,
    length_unit,
    lost_words,
    names_by_cells,
    orientation_columns,
    unit_of,
)
from testbench.files.layouts import Fitting, Ordered, fitting, numbered, stated_length_unit
from testbench.files.mapping import Log, Map, Named, read_map
from testbench.files.meaning import column_meaning, joints_of, looks_like, places
from testbench.files.names import ROTATIONS, SI, series_names, squeeze
from testbench.files.orientation import MIN_POSES, OrientationFit, clear_fit, fits_of, unclear
from testbench.files.read_series import read_series
from testbench.files.rearranged import NUMBERS, join_log, keys_of, nearest_times, times_of
from testbench.files.table import TableCells
from testbench.files.targets import read_log
from testbench.files.text import BLANK, read_letters

LISTED = re.compile(r"[^\W\d][\w/.-]*")  #: Name of a joint in a list such as ['joint_1', 'joint_2'].
WHOLES = {"joint": "{joints_", "reading": "{position_"}  #: Quantities that a cell may hold together.
SOON = 30.0  #: Farthest row of a log that may be of a reading [s].
LONGEST = 2_000  #: Letters of a line above a table that is looked at.


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


def propose(path: Path, arm: Arm, log: Path | None, beside: Path, layout: str | None = None) -> Proposal:
    """Propose the map of an export, and of the robot's log that belongs to it.

    Args:
        path: The export.
        arm: The arm that was measured.
        log: The robot's log with its joints; None where the export has them.
        beside: The folder where the map will be; the path of the log is relative to it.
        layout: Name of the layout that the export has; None for the one that fits.

    Returns:
        The map's lines, and the layouts that fit.

    Raises:
        InputError: When a file is no table, fits several layouts, lacks joints or positions, or cannot be
            joined to the log.
    """
    table, fits = _read(path, arm, layout)
    entries, every = _layout_entries("file", fits), [(fits, table)]
    above = fits.above if fits else _lines_above(table)
    if log is None:
        joint = joints_of(arm)
        joints = [k for k, name in enumerate(table.names) if joint(name)]
        blank = [table.blank(k) for k in joints] or [np.zeros(table.rows, dtype=bool)]
        table, points = _of_the_arm(table, np.all(blank, axis=0))
    else:
        other, own = _read(log, arm)
        how, alone = _join(table, other, fits, own)
        table, points = _of_the_arm(table, alone)
        table = join_log(table, other, how)
        said = {**how.model_dump(exclude_defaults=True), "file": os.path.relpath(log, beside)}
        why = "no names or times in common, but these counts agree"
        entries += [Entry("log", key, value, why * (key == "rows")) for key, value in said.items()]
        entries += _layout_entries("log.table", own)
        every.append((own, other))
    length = stated_length_unit(above) or (fits and fits.layout.length) or ""
    stated = Stated()
    for one, source in every:
        if one:
            stated.add(one, table, arm, length)
            stated.order(one, source, arm)
    entries += [*stated.entries, *columns_by_name(table, arm, length, stated.what), *points]
    entries += names_by_cells(table, arm, stated.names)
    asked = ""
    if not stated.what & {*ROTATIONS}:
        turned, asked = _orientations(path, arm, table, entries, log)
        entries += turned
    layouts = tuple(_called(one) for one, _ in every if one)
    return Proposal(tuple(entries), layouts, asked)


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
            why = f"alone fits the arm as drawn: {fit}"
            stated = [Entry("series", "rotation", fit.notation, why)] if export.fit else []
            found.append((fit, [*columns, *stated]))
    fits = sorted((fit for fit, _ in found), key=lambda fit: fit.score)
    if not fits:
        return [], asked and f"state rotation in [series] of the map: {asked}"
    best = clear_fit(fits)
    if best is None:
        return [], f"the columns of orientations: {unclear(fits)}"
    return next(columns for fit, columns in found if fit is best), ""


def _called(one: Fitting) -> str:
    """Name a layout with its title; of an assumed one also say what that means."""
    guess = ". This layout is assumed: compare names and units" if one.layout.facts == "assumed" else ""
    return f"{one.name} ({one.layout.title}){guess}"


def fit_of_series(arm: Arm, series: Series) -> OrientationFit | None:
    """Fit frame and mount to the orientations of a series, and to the positions of its first target.

    Args:
        arm: The arm; its drawn geometry counts.
        series: Absolute readings.

    Returns:
        The fit; None without enough orientations.
    """
    some = series.turned & series.seen[:, 0]
    if series.rotation is None or some.sum() < MIN_POSES:
        return None
    tried = {"as read": series.rotation[some]}
    return fits_of(arm, series.q[some], series.position[some, 0], tried)[0]


def _read(path: Path, arm: Arm, layout: str | None = None) -> tuple[TableCells, Fitting | None]:
    """Read a table by the layout that fits, else by the names of columns that are known."""
    place, joint = places(arm), joints_of(arm)

    def known(name: str) -> bool:
        return bool(column_meaning(name) or place(name) or joint(name) or looks_like(name, "joints"))

    fits = fitting(path, arm, layout)
    return read_log(path, bool if fits else known, fits.file if fits else None), fits


def _layout_entries(table: str, fits: Fitting | None) -> list[Entry]:
    """Where the table of a layout is, and how it is written."""
    said = fits.file.model_dump(exclude_defaults=True, exclude_none=True) if fits else {}
    return [Entry(table, key, value) for key, value in said.items() if (key, value) != ("skip", 0)]


@dataclass
class Stated:
    """Hold what layouts state about a table."""

    entries: list[Entry] = field(default_factory=list)
    what: set[str] = field(default_factory=set)  #: Quantities, such as "joint" and "reading".
    names: dict[str, str] = field(default_factory=dict)  #: Columns, and the quantity that each says.

    def add(self, fits: Fitting, table: TableCells, arm: Arm, length: str) -> None:
        """Add what a layout says of the columns of a table, each with its unit.

        Args:
            fits: The layout.
            table: The export, with what the log adds.
            arm: The arm.
            length: Unit of lengths that the lines above the header state; "" where they state none.
        """
        layout, keys = fits.layout, dict[str, str]()
        names = read_map(layout, arm, series_names)
        found = {k: own for k, name in enumerate(table.names) if (own := names.find(name)) and own.mapped}
        for part, pairs in (("columns", layout.columns), ("optional", layout.optional)):
            for key, value in pairs.items():
                columns = [k for k, named in found.items() if named.mapped == key]
                if columns and not {found[k].slot.what for k in columns} & self.what:
                    unit, why = _missing_unit(table, [(k, found[k]) for k in columns], length)
                    keys[key] = key + unit
                    self.entries += _by_joint(Entry(part, key + unit, value, why), arm)
        self.entries += [Entry("scale", keys[key], by) for key, by in layout.scale.items() if key in keys]
        for part in ("cells", "words", "values"):
            self.entries += [Entry(part, *pair) for pair in getattr(layout, part).items()]
        said = layout.series.model_dump(exclude_defaults=True)
        self.entries += [Entry("series", *pair) for pair in said.items()]
        if "lost" not in layout.words:
            readings = [k for k, named in found.items() if named.slot.what == "reading"]
            self.entries += lost_words(table, readings)
        self.what |= {named.slot.what for named in found.values()}
        self.what |= {what for what, word in WHOLES.items() if word in str(layout.cells)}
        self.names |= {table.names[k]: named.slot.what for k, named in found.items()}
        self.names |= dict.fromkeys(layout.cells, "")

    def order(self, fits: Fitting, table: TableCells, arm: Arm) -> None:
        """Add the joints of a table that itself states their order.

        Args:
            fits: The layout that fits the table.
            table: The table.
            arm: The arm that was measured.
        """
        if fits.layout.joints:
            self.entries += _ordered(fits.layout.joints, table, arm)
            self.what.add("joint")


def _by_joint(entry: Entry, arm: Arm) -> list[Entry]:
    """A line for every joint where some slide, which are in metres; else the line itself."""
    pattern, _, unit = entry.key.rpartition("_")
    slides = any(joint.prismatic for joint in arm.file_joints)
    if not slides or pattern != "{joint}" or not isinstance(entry.value, str):
        return [entry]
    return [
        entry._replace(
            key=f"{joint.name}_{'m' if joint.prismatic else unit}",
            value=entry.value.replace(pattern, joint.name),
        )
        for joint in arm.file_joints
    ]


def _missing_unit(table: TableCells, columns: Sequence[tuple[int, Named]], length: str) -> tuple[str, str]:
    """The unit of columns that neither a layout nor the file says, as "_mm", and how it was guessed."""
    k, named = columns[0]
    if named.unit or named.header or unit_of(table, k):
        return "", ""
    if named.slot.what in ("joint", "rotation"):
        return angle_unit(table, [k for k, _ in columns])
    kind = {"deviation": "sigma_x", "sigma": "sigma_x", "axis": "axis", "mass": "mass"}.get(
        named.slot.what, ""
    )
    if kind or "m" in SI.get(named.slot.what, ()):
        return length_unit(table, k, [k for k, _ in columns], kind, length)
    return "", ""


def _ordered(how: Ordered, table: TableCells, arm: Arm) -> list[Entry]:
    """The joints of a table by the names that stand beside them.

    Args:
        how: Where names and values are: a column for each joint, or lists in one column.
        table: The table.
        arm: The arm; if it has other names, its joints are those of the file in their order, as a guess.

    Raises:
        InputError: When a column of names does not say the same in all rows.
    """
    said = list[str]()
    for name in (name for name in numbered(how.names, len(table.names)) if name in table.names):
        texts = {*table.texts(table.names.index(name))}
        if len(texts) > 1:
            raise table.error(0, name, f"expected the same joints in every row, got {len(texts)} lists")
        said += LISTED.findall(min(texts))
    own, why = [joint.name for joint in arm.file_joints], ""
    if len(said) < len(own):
        raise table.header_error(
            f"expected {len(own)} joints in {how.names}, got {', '.join(said) or 'none'}"
        )
    if not {*own} <= {*said}:
        why = f"the joints {', '.join(said)} of the file are those of the arm in this order"
        said = [*own, *said[len(own) :]]
    units = {joint.name: "m" if joint.prismatic else how.unit for joint in arm.file_joints}
    if how.values not in table.names:
        values = dict(zip(said, numbered(how.values, len(table.names)), strict=False))
        return [Entry("columns", f"{name}_{units[name]}", values[name], why) for name in own]
    [first, *_] = table.texts(table.names.index(how.values))
    parts = iter(f"{{{name}_{units[name]}}}" if name in units else "*" for name in said)
    pattern = NUMBERS[0].sub(lambda _: next(parts, "*"), first)
    last = pattern.rfind("}") + 1  # joints beyond the arm's, as of a gripper
    return [Entry("cells", how.values, f"{pattern[:last]}*" if len(said) > len(own) else pattern, why)]


def _lines_above(table: TableCells) -> tuple[str, ...]:
    """The lines before a table's header; none where the file has no header."""
    lines = read_letters(table.path, None, ".")[0].splitlines()[: max(table.header - 1, 0)]
    return tuple(line for line in lines if line.strip(BLANK) and len(line) <= LONGEST)


def _of_the_arm(table: TableCells, alone: Mask) -> tuple[TableCells, list[Entry]]:
    """Without rows that have no joints, such as of a nest, where targets have other names there."""
    names = [name for name in table.names if column_meaning(name) == "name"] if alone.any() else []
    for texts, name in ((np.array(keys_of(table, [name])), name) for name in names):
        targets, others = {*texts[~alone].tolist()}, {*texts[alone].tolist()}
        if not targets & others and len(targets) <= min(TARGETS, len(texts) / 2):
            own = Entry("words", "ignore", sorted(others), f"{', '.join(sorted(others))} without joints")
            return table.take(~alone), [Entry("columns", "marker", name), own]
    return table, []


def _join(table: TableCells, log: TableCells, *fits: Fitting | None) -> tuple[Log, Mask]:
    """How rows of a log belong to those of a table, by names that it has once each, else by time.

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
            same = {column_meaning(ours), column_meaning(theirs)} == {"name"} and {*own} == texts
            if same or not all(map(is_decimal, own)):  # numbers are no names, unless both are called so
                return Log(file=log.path.name, on=[ours], to=[theirs]), alone
    both = [_times(own, one) for own, one in zip((table, log), fits, strict=True)]
    if not all(both):
        count = table.rows // max(log.rows, 1)
        if table.rows != count * log.rows or not _in_turn(table, count):
            got = f"{table.rows} readings and {log.rows} rows of the log"
            problem = "expected names or times in columns of both files, or as many rows or poses in both"
            raise InputError(log.path, "", f"{problem}, got {got}")
        return Log(file=log.path.name, rows=count), np.zeros(table.rows, dtype=bool)
    when = [times_of(own, names) for own, names in zip((table, log), both, strict=True)]
    late = np.abs(when[1][nearest_times(*when)] - when[0])
    alone = late > SOON
    apart = float(late[~alone].max() if alone.mean() < 0.5 else late.max())
    if apart > SOON:
        problem = f"expected a row within {SOON:g} s of every reading, one has none in {apart:.4g} s"
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
    for name in (name for name in table.names if column_meaning(name) == "name"):
        texts = keys_of(table, [name])
        groups = [{*texts[k : k + count]} for k in range(0, len(texts), count)]
        one_each = {*map(len, groups)} == {1} and len({*texts}) == len(groups)
        if one_each or (len(groups[0]) == count and all(group == groups[0] for group in groups)):
            return True
    return False
