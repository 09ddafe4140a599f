"""Meaning and unit of every column of a file, and its values in SI units."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from testbench.arm.document import is_integer
from testbench.arm.folder import Arm, ArmJoint, limits_of
from testbench.arm.mjcf import GRAVITY, attribute_numbers, find_body, read_mjcf
from testbench.errors import Array, Ids, InputError, Mask, some_of
from testbench.files.mapping import Named, Names
from testbench.files.names import (
    DEFLECTION,
    DEGREES,
    GON,
    GRAD,
    LOADING,
    MAX_NUMBERS,
    MIN_NUMBER,
    NUMBER,
    ROTATIONS,
    SI,
    STATES,
    UNITS_BY_NAME,
    WHEN,
    XYZ,
    Slot,
    Unit,
    What,
    columns_of,
    plain,
    split_unit,
    squeeze,
    unread_column_warnings,
)
from testbench.files.rearranged import join_axes, take_apart, with_loaded, with_log
from testbench.files.table import TableCells, read_table
from testbench.files.text import sheets_with_tables

# --- Meaning and unit of every column of a file, and its values in SI units ---------------------------------

READ: tuple[What, ...] = (
    *("reading", "covariance", "deviation", "turn_deviation", "spread", *ROTATIONS),
    *("travel", "distance", "direction", "fixed", "tilt", "fixed_sigma", "zero_sigma"),
)
"""Quantities whose cells are blank, or hold a word, if a target was lost."""
ACTS: tuple[What, ...] = ("force", "moment", "process")
"""Quantities that are 0 without a load."""
LIMITS: Mapping[What, tuple[float, float]] = {
    **dict.fromkeys(("force", "moment", "process"), (-1e6, 1e6)),
    **{"mass": (0.0, 1e5), "point": (-10.0, 10.0), "set_point": (-100.0, 100.0)},
}
"""Least and largest components [N, N m, N, kg, m, m]; beyond them a unit is wrong."""


KINDS_OF_UNITS = {
    **{"rad": "angle", "m": "length", "m2": "squared length", "kg": "mass", "N": "force", "Nm": "moment"},
}
"""What the units of quantities are of."""


JOINTS_BY_MAP = '; joints with other names go into [columns] of a map, as "joint_{n}_deg" = "A{n}"'


class UnknownColumns(InputError):
    """Signal a table in which wanted columns, or their units, are not recognised by their names.

    Args:
        table: The table.
        problem: Expected and actual columns.
        column: Name of the column; "" for all.
        joints: Whether joints are recognised.
    """

    def __init__(self, table: TableCells, problem: str, column: str = "", *, joints: bool) -> None:
        super().__init__(table.path, table.place(table.header, column), problem)
        self.joints = joints


@dataclass(frozen=True)
class ReadColumn:
    """Describe a column that is read."""

    index: int  #: Place in the table.
    name: str  #: Name in the file.
    slot: Slot  #: Quantity.
    unit: Unit | None  #: Unit; None for a quantity without one.
    sign: float  #: -1 for a column with the opposite sign.


@dataclass(frozen=True)
class Columns:
    """Hold a table with the meaning of its columns."""

    table: TableCells  #: The cells.
    names: Names  #: Names of the quantities.
    found: dict[Slot, ReadColumn]  #: Columns that are read, by quantity.
    ignored: tuple[str, ...]  #: Names of the other columns.
    mark: str  #: The decimal mark.
    warnings: tuple[str, ...]  #: Warnings about a log joined by row order, and about unread columns.

    def all_of(self, *what: str) -> list[ReadColumn]:
        """List the columns of some quantities.

        Args:
            what: The quantities, such as "force".

        Returns:
            The columns, in the order of the file.
        """
        return sorted((c for c in self.found.values() if c.slot.what in what), key=lambda c: c.index)

    @property
    def joints(self) -> tuple[tuple[str, str], ...]:
        """List name and unit of every joint's column in the arm's order; a minus marks a reversed column."""
        columns = sorted(self.all_of("joint"), key=lambda c: c.slot.index)
        return tuple(("-" * (c.sign < 0) + c.name, "" if c.unit is None else c.unit.name) for c in columns)

    def values(self, column: ReadColumn) -> Array:
        """Read a column in SI units.

        Args:
            column: The column.

        Returns:
            Its numbers, (rows,); NaN where a cell is blank.

        Raises:
            InputError: When a cell is no number, too large, or too close to zero.
        """
        lost = '; if this word means a lost target, add it to the map: [words] lost = "NaN"'
        words = lost if column.slot.what == "reading" else ""
        values = self.table.numbers(column.index, self.mark, words)
        if column.unit is None:
            return column.sign * values
        unit, sizes = column.unit, np.abs(values)  # NaN where a cell is blank
        most = MAX_NUMBERS[unit.si] / unit.scale
        self.table.refuse(
            (sizes > most) | ((sizes < MIN_NUMBER) & (sizes > 0)),
            column.name,
            lambda row: (
                f"expected 0 or numbers from {MIN_NUMBER:g} up to {most:g} {unit.name}, got {values[row]:g}"
            ),
        )
        return column.sign * unit.scale * values

    def full(self, column: ReadColumn) -> Array:
        """Read a column without blank cells in SI units.

        Args:
            column: The column.

        Returns:
            Its numbers, (rows,).

        Raises:
            InputError: Names the first cell that is blank or no usable number.
        """
        values = self.values(column)
        blank = np.isnan(values)
        if blank.any():
            hint = "for merged cells, write merged = true, and for a line after the table footer = 1, "
            hint += "in [file] of a map"
            if column.slot.what in ACTS:
                hint = "write 0 if none acts"
            self.table.refuse(blank, column.name, f"expected a finite number, got ''; {hint}")
        return values

    def source_of(self, slot: Slot) -> "ReadColumn | float | None":
        """Find the source of a quantity.

        Args:
            slot: The quantity, with component, target and state.

        Returns:
            Its column; else the map's constant in SI units; else None.
        """
        return self.found.get(slot) or self.constant(slot)

    def values_of(self, own: "ReadColumn | float | None") -> Array:
        """Read a source from `source_of` in every row.

        Args:
            own: Column, constant in SI units, or None for 0.

        Returns:
            Values in SI units, (rows,).

        Raises:
            InputError: Names the first cell of the column that is blank or no usable number.
        """
        return self.full(own) if isinstance(own, ReadColumn) else np.full(self.table.rows, own or 0.0)

    def complete_set(self, wanted: Mapping[str, Slot]) -> list[ReadColumn]:
        """List the columns of some quantities: all of them, or none if the file has none.

        Args:
            wanted: Quantities by the name of their column in our files.

        Returns:
            The columns in that order; empty if the file has none.

        Raises:
            InputError: Names the missing columns if the file has some of them.
        """
        columns = [self.found.get(slot) for slot in wanted.values()]
        missing = [name for name, column in zip(wanted, columns, strict=True) if column is None]
        if 0 < len(missing) < len(columns):
            raise self.lack(missing)
        return [column for column in columns if column]

    def together(self, columns: Sequence[ReadColumn]) -> tuple[Array, Mask]:
        """Read columns whose cells are blank together.

        Args:
            columns: The columns, k of them.

        Returns:
            Their numbers in SI units, (rows, k), NaN where blank; and which rows have them, (rows,).

        Raises:
            InputError: When a row has only some of the cells.
        """
        values = np.column_stack([self.values(column) for column in columns])
        blank = np.isnan(values)
        part, names = blank & ~blank.all(axis=1, keepdims=True), [column.name for column in columns]
        self.table.refuse(part, names, "expected a finite number, got ''")
        return values, ~blank[:, 0]

    def lack(self, missing: Sequence[str], hint: str = "") -> InputError:
        """Make the error about missing columns.

        Args:
            missing: Names of the missing columns.
            hint: What the user can do instead, beginning with "; ".

        Returns:
            The error; it also lists which columns were understood, and which were not.
        """
        ignored = ""
        if self.ignored:
            understood = [column.name for column in sorted(self.found.values(), key=lambda c: c.index)]
            ignored = f"; not understood: {some_of(self.ignored)}; understood: {some_of(understood)}"
        readings = Slot("state") in self.names.ours.values()  # a program has no states
        if self.ignored and not hint:
            hint = "; testbench data check proposes a map" if readings else JOINTS_BY_MAP
        problem = f"missing columns: {some_of(missing)}{ignored}{hint}"
        return UnknownColumns(self.table, problem, joints=bool(self.all_of("joint")))

    def map_error(self, place: str, problem: str) -> InputError:
        """Make the error about an entry of the map, or about an argument that replaces it.

        Args:
            place: Key of the map, such as "values.mass_kg".
            problem: Expected and actual value.

        Returns:
            The error.
        """
        return self.names.error(self.table.path, place, problem)

    def constant(self, slot: Slot) -> float | None:
        """Read a quantity that the map states for all rows.

        Args:
            slot: The quantity, with component, target and state.

        Returns:
            Its value in SI units; None if the map states none.
        """
        stated = self.names.values.get(slot)
        return None if stated is None else stated[0] * stated[1].scale


def read_columns(path: Path, names: Names, arm: Arm) -> Columns:
    """Read a file and find its columns; it raises as `read_table` and `find_columns` do.

    Args:
        path: The file.
        names: Map of column names.
        arm: The arm.

    Returns:
        The columns.
    """
    table = read_table(path, names.knows, names.map.file)
    if names.map.loaded is not None:
        other = (names.path or path).parent / names.map.loaded.file
        table = with_loaded(table, read_table(other, names.knows, names.map.file))
    return find_columns(with_log(table, names), names, arm)


def find_columns(table: TableCells, names: Names, arm: Arm) -> Columns:
    """Find the quantity of every column of a table.

    Args:
        table: The table.
        names: Map of column names.
        arm: The arm.

    Returns:
        The columns.

    Raises:
        InputError: Where two columns say the same, a unit is missing or a column of the map is not there.
    """
    # Split combined cells, and find the quantity of every name.
    table, read_as = take_apart(table, names)
    named = {k: own for k, name in enumerate(read_as) if (own := names.find(name))}
    if {*table.names} >= OF_A_PLAN:  # its `travel_mm` is that of a slide, not of a gauge
        named = {k: own for k, own in named.items() if own.slot != Slot("travel")}
    if not named:
        raise _none_known(table, arm)
    _check_map(table, names, named)
    # Join rows of single axes; the map's names replace our own.
    table, named = join_axes(table, named, names)
    named = _chosen(_without_keys(table, named, names))
    found, again = _one_each(table, named, names, arm)
    ignored = tuple(
        name for k, name in enumerate(table.names) if k not in named and name and name not in names.cells
    )
    # Replace words for lost targets and for loads, and fill merged cells.
    settled = _settled(table, found, arm)
    found |= settled
    readings = [c.index for c in found.values() if c.slot.what in READ]
    loads = [c.index for c in found.values() if c.slot.what in ("mass", "force", "moment")]
    mark = table.mark([c.index for c in found.values() if c.unit])
    table = table.worded(readings, names.lost)
    table = table.worded(loads, {word: value.replace(".", mark) for word, value in names.loads.items()})
    if names.map.file.merged:
        table = table.filled([c.index for c in found.values() if c.index not in readings])
    if table.sheet and "" not in names.lost:
        _refuse_blanks(table, [c for c in found.values() if c.index in readings])
    columns = Columns(table, names, found, ignored, mark, _warnings(table, names, ignored, settled))
    _compare_units(columns, again, arm)
    return columns


def _compare_units(columns: Columns, again: Sequence[ReadColumn], arm: Arm) -> None:
    """Refuse joints that are given in two units, as in plan.csv, if they differ: one of them was edited."""
    for column in again:
        joint, first = arm.file_joints[column.slot.index], columns.found[column.slot]
        values = joint.display_factor * np.array([columns.values(first), columns.values(column)])
        for row in np.flatnonzero(np.abs(np.diff(values, axis=0)[0]) > UNIT_ROUNDING)[:1]:
            one, other = values[:, row]
            got = f"got {one:.4f} and {other:.4f} {joint.display_unit}"
            place = f"line {columns.table.lines[row]}, columns {first.name} and {column.name}"
            problem = f"expected the same joint in both units, {got}; remove one of the columns"
            raise InputError(columns.table.path, place, problem)


def _none_known(table: TableCells, arm: Arm) -> UnknownColumns:
    """The error about a table of which no column is known."""
    hint = f"a file without a header needs a map{JOINTS_BY_MAP}"
    wanted = some_of(joint.display_column for joint in arm.file_joints) if arm.joints else "mass_kg"
    got = ", ".join(table.names[:3])
    problem = f"no column name is known: expected {wanted}, got {got} ...; {hint}"
    return UnknownColumns(table, problem, joints=False)


def _one_each(
    table: TableCells, named: Mapping[int, Named], names: Names, arm: Arm
) -> tuple[dict[Slot, ReadColumn], list[ReadColumn]]:
    """The column of each quantity, and joints again in another unit; InputError if two say the same."""
    found: dict[Slot, ReadColumn] = {}
    again = list[ReadColumn]()
    for k, own in named.items():
        unit = _unit(table, k, own, arm)
        slot = own.slot
        if slot.what == "sigma":
            slot = replace(slot, index=int(unit is not None and unit.si == "rad"))
        if slot.what == "joint" and slot in found and unit != found[slot].unit:
            again.append(ReadColumn(k, table.names[k], slot, unit, own.sign))
            continue
        if slot in found:
            both = " and ".join(map(repr, (found[slot].name, table.names[k])))
            problem = f"expected one column for each quantity, got {both} for the same quantity"
            raise UnknownColumns(
                table, problem, joints=any(own.slot.what == "joint" for own in named.values())
            )
        if slot in names.values:
            problem = f"{table.names[k]!r} is a value in the map and a column of the file: remove one of them"
            raise names.error(table.path, "values", problem)
        found[slot] = ReadColumn(k, table.names[k], slot, unit, own.sign)
    return found, again


def _refuse_blanks(table: TableCells, columns: Sequence[ReadColumn]) -> None:
    """Refuse blank cells of readings in a sheet: they may be errors, or formulas without a result."""
    blank = np.array([table.blank(c.index) for c in columns], dtype=bool).reshape(-1, table.rows).T
    problem = (
        "expected a number, got a blank cell, an error or a formula without its result; if blank cells mean "
    )
    problem += 'lost targets, add to the map: [words] lost = ""'
    table.refuse(blank, [c.name for c in columns], problem)


def _warnings(
    table: TableCells, names: Names, ignored: Sequence[str], settled: Mapping[Slot, ReadColumn]
) -> tuple[str, ...]:
    """Write warnings of a log joined by the order of its rows, of columns that are not read, and of gon."""
    log = names.map.log
    keys = [] if log is None else [*log.on, *log.to]
    full = {name for k, name in enumerate(table.names) if not table.blank(k).all()}
    words = unread_column_warnings([name for name in ignored if name in full and name not in keys])
    alone = table.sheet and not (names.map.file.sheets or names.map.loaded)
    if alone and (others := sheets_with_tables(table.path, table.sheet)):
        words.append(f"warning: other sheets with tables are not read: {', '.join(others)}")
    if log is not None and log.rows is not None:
        each = f"{log.rows} rows" if log.rows > 1 else "one row"
        words.insert(
            0, f"warning: the rows of {log.file} are joined in their order, each to {each} of readings"
        )
    if far := [column.name for column in settled.values() if column.unit == GON]:
        words.append(f"warning: grad is read as gon, because degrees would exceed a limit: {', '.join(far)}")
    return tuple(words)


def _check_map(table: TableCells, names: Names, named: dict[int, Named]) -> None:
    """Check that every entry of the map has a column in the file."""
    used = {own.mapped for own in named.values()}
    for name, own in names.theirs.items():
        if own.mapped not in used and not own.optional:
            problem = f"no column like {name!r} in {table.path.name}; columns are {some_of(table.names)}"
            raise names.error(table.path, f"columns.{own.mapped}", problem)


def _without_keys(table: TableCells, named: dict[int, Named], names: Names) -> dict[int, Named]:
    """Drop the columns by which a log is joined, where the file says the same, such as the time."""
    keys = {*names.map.log.to} - {*names.map.log.on} if names.map.log else set[str]()
    log = {k for k, name in enumerate(table.names) if name in keys}
    slots = {own.slot.what for k, own in named.items() if k not in log}
    return {k: own for k, own in named.items() if k not in log or own.slot.what not in slots}


def _chosen(named: dict[int, Named]) -> dict[int, Named]:
    """Drop our own names for what the map names, and readings that others state in more detail."""
    mapped = {own.slot for own in named.values() if own.mapped}
    chosen = {k: own for k, own in named.items() if own.mapped or own.slot not in mapped}
    loaded = {own.slot.marker for own in chosen.values() if own.slot.when == "after"}
    twice = [k for k, own in chosen.items() if own.slot.when == DEFLECTION and own.slot.marker in loaded]
    chosen = {k: own for k, own in chosen.items() if k not in twice}
    for part in ("when", "marker"):
        readings = [k for k, own in chosen.items() if own.slot.what == "reading"]
        full = [k for k in readings if getattr(chosen[k].slot, part)]
        if full:
            chosen = {k: own for k, own in chosen.items() if k not in readings or k in full}
    return chosen


def _settled(table: TableCells, found: Mapping[Slot, ReadColumn], arm: Arm) -> dict[Slot, ReadColumn]:
    """Find what "grad" means in the names of columns: degrees by their language, gon by their numbers."""
    of = {slot: column for slot, column in found.items() if column.unit == GRAD}
    if not of:
        return {}
    if any(DEGREES.search(plain(name)) for name in table.names):
        return {slot: replace(column, unit=UNITS_BY_NAME["deg"]) for slot, column in of.items()}
    mark = table.mark([column.index for column in of.values()])
    for slot, column in of.items():
        values = np.radians(table.numbers(column.index, mark)) * (column.sign or 1)
        joint = arm.file_joints[slot.index] if slot.what == "joint" else None
        low, high = (joint.lower, joint.upper) if joint else (-2 * np.pi, 2 * np.pi)
        if np.nanmin(values, initial=0.0) < low - 1e-6 or np.nanmax(values, initial=0.0) > high + 1e-6:
            return {slot: replace(column, unit=GON) for slot, column in of.items()}
    first = next(iter(of.values())).name
    says = "grad means degrees in German, Spanish and Russian, gon in English"
    hint = 'state which in [columns] of a map, as "joint_{n}_deg" or "joint_{n}_gon" = '
    raise table.header_error(f"{says}; {hint}{re.sub(NUMBER, '{n}', first, count=1)!r}", first)


def _unit(table: TableCells, k: int, named: Named, arm: Arm) -> Unit | None:
    """Find the unit of a column: in its name, in the map, or in the line below the header."""
    allowed = SI.get(named.slot.what, ())
    if named.slot.what == "joint":
        allowed = (arm.file_joints[named.slot.index].unit,)
    if named.slot.what == "torque":
        allowed = ("N",) if arm.file_joints[named.slot.index].prismatic else ("Nm",)
    if not allowed:
        return None
    said = [unit for unit in (named.unit, named.header, table.units[k]) if unit]
    said = [unit for unit in said if unit != GRAD] or said
    if not said and (parts := split_unit(table.names[k])):
        said = [parts[1]]
    expected = " or ".join(f"_{u}" for u in allowed)
    if not said:
        problem = f"expected a unit such as {expected} at the end of the name, in brackets, or in a map"
        raise UnknownColumns(table, problem, table.names[k], joints=named.slot.what == "joint")
    got = " and ".join(dict.fromkeys(u.name for u in said))
    if any(u != said[0] for u in said):
        raise table.header_error(f"expected the same unit in map and file, got {got}", table.names[k])
    if said[0].si not in allowed:
        wanted = " or ".join(KINDS_OF_UNITS[u] for u in allowed)
        raise table.header_error(
            f"expected a unit of {wanted}, such as {expected}, got {got}", table.names[k]
        )
    return said[0]


def axes(columns: Columns, what: What) -> list[ReadColumn | float | None]:
    """Find the source of each component of a vector quantity.

    Args:
        columns: The columns of the file.
        what: The quantity, such as "force".

    Returns:
        For x, y and z: a column, the map's constant [SI units], or None, which counts as zero.

    Raises:
        InputError: If one component is missing while the others are given.
    """
    found = [columns.source_of(Slot(what, k)) for k in range(len(XYZ))]
    missing = [name for name, own in zip(columns_of(what), found, strict=True) if own is None]
    if len(missing) == 1 or (what == "point" and len(missing) == 2):
        raise columns.lack(missing)
    return found


def vector(columns: Columns, what: What, count: int = len(XYZ)) -> Array | None:
    """Read the components of a quantity, zero for those that are missing.

    Args:
        columns: The columns of the file.
        what: The quantity.
        count: Number of components.

    Returns:
        Values in SI units, (rows, count); None where neither file nor map gives any.

    Raises:
        InputError: At the first cell that is blank or too large.
    """
    found = [columns.source_of(Slot(what, k)) for k in range(count)]
    if all(own is None for own in found):
        return None
    (least, most), values = LIMITS[what], np.column_stack([columns.values_of(own) for own in found])

    def problem(row: int, k: int) -> str:
        return f"expected {least:g} to {most:g} {SI[what][0]}, got {values[row, k]:g}"

    far = (values < least) | (values > most)
    stated = [not isinstance(own, ReadColumn) for own in found]
    if far.any() and stated[np.argwhere(far)[0, 1]]:
        raise columns.map_error("values", problem(*np.argwhere(far)[0]))
    columns.table.refuse(far, [own.name if isinstance(own, ReadColumn) else "" for own in found], problem)
    return values


def wrench(columns: Columns) -> Array | None:
    """Read force and moment of every row; missing components are zero, as in `vector`.

    Args:
        columns: The table.

    Returns:
        Wrenches, (rows, 6) [N, N m]; None if the file states neither.
    """
    parts = [vector(columns, what) for what in ("force", "moment")]
    if all(part is None for part in parts):
        return None
    return np.hstack([np.zeros((columns.table.rows, 3)) if part is None else part for part in parts])


# --- Conditions of every row of a table: run, pose, station, joints, load -----------------------------------

SAME_POSE = 1e-6
"""Largest difference of joint coordinates in one pose [rad, m]."""
ROUNDED = 1e-4
"""Excess over a limit that rounding in a file explains; the coordinate is then set to the limit [rad, m]."""
OF_A_PLAN = frozenset({"travel_deg", "way"})
"""Columns that only a plan.csv has."""
UNIT_ROUNDING = 1e-3
"""Difference of a joint in two units that rounding in a file explains [deg, mm]."""
POSES_BY_ANGLES = "rows of equal joint angles count as one pose"
MIN_POSES_OF_A_LOAD = 4
"""Poses from which on a load that acts in one of them only is striking."""
SUSPECT = {"rad": (2.5 * np.pi, "degrees"), "m": (10.0, "millimetres")}
"""Coordinates that only another unit explains, and that unit."""


@dataclass(frozen=True)
class RowConditions:
    """Hold the conditions of every row of a table."""

    run: Ids | None  #: Identifier of the run, (rows,); None if no column states it.
    pose: Ids  #: Identifier of the pose, (rows,).
    named: bool  #: Whether a column states the pose.
    station: Ids | None  #: Station of the tracker, (rows,).
    taken_off: Mask | None  #: Whether the load was taken off before the unloaded reading, (rows,).
    q: Array  #: Joint coordinates, (rows, n) [rad, m].
    wrench: Array  #: Force and moment, world axes, (rows, 6) [N, N m].
    point: Array  #: Point where the load acts, tool's frame, (rows, 3) [m].
    notes: tuple[str, ...]  #: Assumptions that were made.

    @property
    def loaded(self) -> Mask:
        """Tell which rows have a load, (rows,)."""
        return np.asarray(self.wrench.any(axis=1))


def read_conditions(columns: Columns, arm: Arm, *, needs_load: bool = True) -> RowConditions:
    """Read run, pose, station, joints and load of every row.

    Args:
        columns: The columns of the file.
        arm: The arm that was measured.
        needs_load: Whether a file without any load is refused; otherwise all of its readings are unloaded.

    Returns:
        The conditions.

    Raises:
        InputError: Names line and column.
    """
    _refuse_unclear_states(columns)
    q = joint_coordinates(columns, arm)
    wrench, load_notes = _wrench(columns, needed=needs_load)
    point, point_notes = _point(columns, arm)
    notes = [*load_notes, *(point_notes if wrench.any() else [])]
    ids: dict[str, Ids | None] = {}
    for what in (Slot("run"), Slot("pose"), Slot("station")):
        column = columns.found.get(what)
        ids[what.what], said = (None, "") if column is None else identifiers(columns, column)
        notes += [said] * bool(said)
    pose, named = ids["pose"], ids["pose"] is not None
    if pose is None:
        pose = same_poses(q)
        notes.append(f"{POSES_BY_ANGLES}: {len(np.unique(pose))} poses")
    notes += _odd_loads(columns.table, pose, wrench)
    taken_off = _taken_off(columns)
    return RowConditions(ids["run"], pose, named, ids["station"], taken_off, q, wrench, point, tuple(notes))


def _odd_loads(table: TableCells, pose: Ids, wrench: Array) -> list[str]:
    """Warn of a load that acts in one pose only, if all other poses share another one: a digit too many?"""
    loaded = np.flatnonzero(wrench.any(axis=1))
    if len(np.unique(pose[loaded])) < MIN_POSES_OF_A_LOAD:
        return []
    load, place = number_rows(wrench[loaded]), number_rows(pose[loaded])
    acts = np.unique(np.column_stack([load, place]), axis=0)  # which load acts in which pose, once
    n_poses_of = np.bincount(acts[:, 0])
    odd = np.flatnonzero(n_poses_of == 1)
    if len(odd) != 1:
        return []
    elsewhere = acts[acts[:, 1] != acts[acts[:, 0] == odd[0], 1]]
    usual = np.flatnonzero(np.bincount(elsewhere[:, 0], minlength=len(n_poses_of)) == place.max())
    first = loaded[first_rows(load)]
    words = list[str]()
    for k in usual[:1]:
        row = first[odd[0]]
        here, there = _load_words(wrench[row]), _load_words(wrench[first[k]])
        where = f"pose {pose[row]} (line {table.lines[row]})"
        words.append(f"warning: only {where} has a load of {here}; all other poses have {there}: a typo?")
    return words


def _load_words(wrench: Array) -> str:
    """Write a load, (6,) [N, N m]: its mass if it is a weight, else its force."""
    hangs = wrench[2] < 0 and not np.delete(wrench, 2).any()
    return f"{-wrench[2] / GRAVITY:.6g} kg" if hangs else f"{np.linalg.norm(wrench[:3]):.6g} N"


def _refuse_unclear_states(columns: Columns) -> None:
    """Refuse states that are both "loaded" and "after": the load may be off again in the latter."""
    state = columns.found.get(Slot("state"))
    if state is None:
        return
    texts = {squeeze(text): text for text in columns.table.texts(state.index)}
    if {*STATES["after"]} <= {*texts}:
        both = " and ".join(repr(texts[word][:80]) for word in STATES["after"])
        problem = f"expected one word for loaded rows, got {both}; write unloaded or loaded in every row"
        raise columns.table.header_error(problem, state.name)


def _taken_off(columns: Columns) -> Mask | None:
    """Read the column of loading, (rows,); blank is a load put on."""
    column = columns.found.get(Slot("loading"))
    if column is None:
        return None
    texts = columns.table.texts(column.index)
    wrong = np.array([squeeze(text) not in ("", *LOADING) for text in texts], dtype=bool)
    columns.table.refuse(
        wrong, column.name, lambda row: f"expected {' or '.join(LOADING)}, got {texts[row][:80]!r}"
    )
    return np.array([squeeze(text) == LOADING[1] for text in texts], dtype=bool)


def identifiers(columns: Columns, column: ReadColumn) -> tuple[Ids, str]:
    """Read a column of identifiers as integers.

    Names are replaced by the number that each contains, or else by 1, 2, ... in the order of the file.

    Args:
        columns: The columns of the file.
        column: The column.

    Returns:
        Identifiers, (rows,), and a note on replaced names; "" if there is none.

    Raises:
        InputError: If numbers and names are mixed, or a cell is blank.
    """
    if (counted := columns.table.counts(column.index)) is not None:
        return counted, ""
    texts = columns.table.texts(column.index)
    names = list(dict.fromkeys(texts))
    if "" in names or any(map(is_integer, names)):
        return columns.table.integers(column.index), ""
    digits = ["".join(c for c in name if c in "0123456789") for name in names]
    plain = all(map(is_integer, digits)) and len({int(d) for d in digits}) == len(names)
    plain = plain and not any(set(".,") & set(name) for name in names)
    number = {name: int(digits[k]) if plain else k + 1 for k, name in enumerate(names)}
    few = ", ".join(f"{name[:20]!r} is {number[name]}" for name in names[:3])
    what = column.slot.what
    return np.array([number[text] for text in texts], dtype=int), f"{what}s have names: {few}"


def same_poses(q: Array) -> Ids:
    """Number poses in order of appearance; two are the same if they agree in every joint.

    Args:
        q: Actuated joints, (rows, n) [rad, m].

    Returns:
        Number of the pose of every row, from 1, (rows,).
    """
    labels = np.zeros(q.shape, dtype=int)
    for k, own in enumerate(q.T):
        order = np.argsort(own, kind="stable")
        labels[order, k] = np.cumsum(np.diff(own[order], prepend=own[order[:1]]) > SAME_POSE)
    return number_rows(labels) + 1


def number_rows(*parts: Array | Ids | Mask | None) -> Ids:
    """Number the groups of equal rows in order of appearance.

    Args:
        parts: Arrays that are compared together, (rows,) or (rows, k) each; None is left out.

    Returns:
        Group of every row, from 0, (rows,).
    """
    known = [part.reshape(len(part), -1) for part in parts if part is not None]
    code = np.zeros(len(known[0]), dtype=int)
    for column in (column for part in known for column in part.T):
        own, more = np.unique(column, return_inverse=True)
        code = np.unique(code * len(own) + more.reshape(-1), return_inverse=True)[1].reshape(-1)
    _, first, code = np.unique(code, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[code.reshape(-1)]


def first_rows(code: Ids) -> Ids:
    """Find the first row of every group.

    Args:
        code: Group of every row, numbered in order of appearance, (rows,).

    Returns:
        Index of the first row, (groups,).
    """
    return np.unique(code, return_index=True)[1]


def repeats(*parts: Ids) -> Ids:
    """Count the earlier rows that are equal to each row in all parts.

    Args:
        parts: Arrays that are compared together, (rows,) each.

    Returns:
        The counts, (rows,).
    """
    code = number_rows(*parts)
    order = np.argsort(code, kind="stable")
    size = np.bincount(code)
    found = np.empty(len(code), dtype=int)
    found[order] = np.arange(len(code)) - np.repeat(np.cumsum(size) - size, size)
    return found


def _wrench(columns: Columns, *, needed: bool) -> tuple[Array, list[str]]:
    """Read the load of every row, (rows, 6) [N, N m]; a blank cell of an unloaded reading is no load."""
    table, hung = columns.table, columns.source_of(Slot("mass"))
    acting = [*axes(columns, "force"), *axes(columns, "moment")]
    acts = any(own is not None for own in acting)
    told = columns.names.load if hung is None and not acts else None
    hung = hung if told is None else told
    if not acts and hung is None:
        if not needed:
            return np.zeros((table.rows, 6)), ["no column gives a load, so only own weight is assumed"]
        hint = "; for one load in the whole file, give --load, or mass_kg = 150 in [values] of a map; name "
        hint += 'forces in world axes in [columns] of a map, as force_x = "Fx"; '
        hint += "absolute readings without a load are for `testbench calibrate`"
        raise columns.lack(["mass_kg (or force_x_N, force_y_N, force_z_N)"], hint)
    # A row states a mass or a force; the cells of the other may be blank.
    pulls, hangs = _given(columns, acting), _given(columns, [hung])
    kg = _load(columns, hung, pulls)
    wrench = np.column_stack([_load(columns, own, hangs) for own in acting])
    name = hung.name if isinstance(hung, ReadColumn) else ""
    table.refuse(kg < 0, name, lambda row: f"expected a mass of at least 0 kg, got {kg[row]:g}")
    both = "expected a mass or a force, got {:g} kg and a force or moment; leave one of them blank"
    table.refuse((kg != 0) & wrench.any(axis=1), name, lambda row: both.format(kg[row]))
    wrench[:, 2] -= GRAVITY * kg
    notes = list[str]()
    if told is not None:
        notes.append(f"no column gives a mass: loaded rows get the {told:g} kg that you stated")
    if hung is not None:
        notes.append("the load is a hung mass: its force is -9.81 m/s2 times the mass along the world's z")
    names = [f"{what}_{x}" for what in ("force", "moment") for x in XYZ]
    if acts and (zero := [name for name, own in zip(names, acting, strict=True) if own is None]):
        notes.append(f"no column gives {', '.join(zero)}: taken as 0")
    return wrench, notes


def _given(columns: Columns, sources: Sequence[ReadColumn | float | None]) -> Mask:
    """Tell in which rows one of some columns has a number, (rows,)."""
    read = [columns.values(own) for own in sources if isinstance(own, ReadColumn)]
    return np.asarray(~np.isnan(np.array(read).reshape(len(read), columns.table.rows)).all(axis=0))


def _load(columns: Columns, own: ReadColumn | float | None, other: Mask) -> Array:
    """Read a component of the load, (rows,): zero in an unloaded row, and if blank beside another load."""
    values = columns.values(own) if isinstance(own, ReadColumn) else columns.values_of(own)
    state = columns.found.get(Slot("state"))
    idle = np.zeros(len(values), dtype=bool)
    if state is not None:
        words = columns.table.texts(state.index)
        idle = np.array([columns.names.word(word, WHEN) == "before" for word in words], dtype=bool)
    elif (
        isinstance(own, ReadColumn)
        and own.slot.what == "mass"
        and not columns.table.sheet  # a formula without its result
        and not any(c.slot.when for c in columns.all_of("reading"))
    ):
        idle = np.isnan(values)  # nothing hangs
    hint = "; write 0 if nothing hangs" if columns.table.sheet else ""
    problem = f"expected a finite number in a loaded row, got ''{hint}"
    blank = np.isnan(values) & ~idle & ~other
    columns.table.refuse(blank, own.name if isinstance(own, ReadColumn) else "", problem)
    return np.where(idle | np.isnan(values), 0.0, values)


def load_point(arm: Arm) -> Array:
    """Find the arm's load point; its body is a child of the tool's.

    Args:
        arm: The arm.

    Returns:
        The point in the tool's frame, (3,) [m].

    Raises:
        InputError: When rigid.xml has no such body, or its position is not three numbers.
    """
    body = find_body(arm.mjcf_path, read_mjcf(arm.mjcf_path), arm.load_point)
    return np.array(attribute_numbers(arm.mjcf_path, body, "pos", 3) if "pos" in body.attrib else [0.0] * 3)


def _point(columns: Columns, arm: Arm) -> tuple[Array, list[str]]:
    """Read the point where the load acts, (rows, 3) [m]."""
    found, rows = axes(columns, "point"), columns.table.rows
    if all(own is None for own in found):
        return np.tile(load_point(arm), (rows, 1)), [
            f"the load acts at the arm's load point, {arm.load_point!r}"
        ]
    return np.column_stack([columns.values_of(own) for own in found]), []


def joint_coordinates(columns: Columns, arm: Arm) -> Array:
    """Read the joint coordinates of the arm's chain, within its limits.

    Args:
        columns: The columns of the file.
        arm: The arm.

    Returns:
        Joint coordinates, (rows, n) [rad, m].

    Raises:
        InputError: Names line and column.
    """
    joints = arm.file_joints
    found = [columns.source_of(Slot("joint", k)) for k in range(len(joints))]
    units = {own.unit.si: own.unit.name for own in found if isinstance(own, ReadColumn) and own.unit}
    missing = [
        f"{joint.name}_{units.get(joint.unit, joint.unit)}"
        for joint, own in zip(joints, found, strict=True)
        if own is None
    ]
    if missing:
        raise columns.lack(missing)
    none = np.empty((columns.table.rows, 0))  # an arm may have no joints
    q = np.column_stack([none, *(columns.values_of(own) for own in found)])
    _check_limits(columns, joints, q)
    q = arm.to_chain_joints(q)
    _check_chain(columns, arm, q)
    ends = arm.clip_to_limits(q)
    return np.where(np.abs(q - ends) > SAME_POSE, ends, q)


def _check_chain(columns: Columns, arm: Arm, q: Array) -> None:
    """Refuse poses, (rows, n) [rad, m], in which a joint of the chain is beyond its limits."""
    if arm.joint_map is None:
        return  # its limits are those of the file's joints
    lower, upper = arm.limits
    for i, k in np.argwhere((q < lower - ROUNDED) | (q > upper + ROUNDED))[:1]:
        joint = arm.joints[k]
        low, high, got = (joint.display_factor * x for x in (joint.lower, joint.upper, q[i, k]))
        limits = f"expected {low:.4f} to {high:.4f} {joint.display_unit}, got {got:.4f}"
        problem = (
            f"joint {joint.name} of the arm is {arm.joint_map.joint_formula(int(k))} of the file: {limits}"
        )
        raise columns.table.error(i, "", problem)


def _check_limits(columns: Columns, joints: Sequence[ArmJoint], q: Array) -> None:
    """Refuse file joints beyond their limits, with a hint if another unit or sign would fit."""
    lower, upper = limits_of(joints)
    bad = np.argwhere((q < lower - ROUNDED) | (q > upper + ROUNDED))
    if not len(bad):
        return
    i, k = bad[0]
    joint, column = joints[k], columns.found.get(Slot("joint", int(k)))
    unit = column.unit if column else None
    name, scale = (unit.name, unit.scale) if unit else (joint.unit, 1.0)
    alike = [other.prismatic == joint.prismatic for other in joints]
    most, suspect = SUSPECT[joint.unit]
    hint = f"; are these {suspect}?" if name == joint.unit and np.abs(q[:, alike]).max() > most else ""
    hint = hint or _other_columns(columns, joints, q, int(k))
    low, high, got = (x / scale for x in (joint.lower, joint.upper, q[i, k]))
    problem = f"expected {low:.4f} to {high:.4f} {name}, got {got:g}{hint}"
    raise columns.table.error(i, column.name if column else joint.name, problem)


def _other_columns(columns: Columns, joints: Sequence[ArmJoint], q: Array, k: int) -> str:
    """Find what brings a joint's column within the limits: the other sign, or another joint's column."""
    lower, upper = limits_of(joints)
    found = list[str]()

    def within(some: Sequence[int], values: Array) -> bool:
        return bool(((values >= lower[some] - ROUNDED) & (values <= upper[some] + ROUNDED)).all())

    own, *others = (columns.found.get(Slot("joint", m)) for m in [k, *range(len(joints))])
    if own is None:
        return ""
    if within([k], -q[:, [k]]):
        other = own.name if own.sign < 0 else f"-{own.name}"
        found.append(f"with the other sign (name it {other!r} in [columns] of a map)")
    for m, column in enumerate(others):
        alike = m != k and joints[m].prismatic == joints[k].prismatic
        if column and alike and within([k, m], q[:, [m, k]]):
            found.append(f"with {own.name!r} and {column.name!r} exchanged")
    return f"; all rows are within the limits {', or '.join(found)}" if found else ""
