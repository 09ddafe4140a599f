"""Meaning and unit of every column of a file, and its values in SI units."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.errors import Array, InputError, Mask
from testbench.files.mapping import Named, Names
from testbench.files.names import (
    DEFLECTION,
    MAX_NUMBERS,
    MIN_NUMBER,
    ROTATIONS,
    SI,
    XYZ,
    Slot,
    Unit,
    What,
    columns_of,
    split_unit,
    unread_column_warnings,
)
from testbench.files.rearranged import join_axes, take_apart, with_log
from testbench.files.table import TableCells, read_table

READ: tuple[What, ...] = (
    *("reading", "covariance", "deviation", "turn_deviation", "spread", *ROTATIONS),
    *("travel", "distance", "direction", "fixed", "tilt", "fixed_sigma"),
)
"""Quantities whose cells are blank, or hold a word, if a target was lost."""
ACTS: tuple[What, ...] = ("force", "moment", "process")
"""Quantities that are 0 without a load."""
LIMITS: Mapping[What, tuple[float, float]] = {
    **dict.fromkeys(("force", "moment", "process"), (-1e6, 1e6)),
    **{"mass": (0.0, 1e5), "point": (-10.0, 10.0), "set_point": (-100.0, 100.0)},
}
"""Least and largest components [N, N m, N, kg, m, m]; beyond them a unit is wrong."""


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

    def get(self, slot: Slot) -> ReadColumn | None:
        """Find the column of a quantity.

        Args:
            slot: The quantity, with component, target and state.

        Returns:
            The column; None if there is none.
        """
        return self.found.get(slot)

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
        lost = '; a word for a lost target goes into the map, as [words] lost = "NaN"'
        words = lost if column.slot.what == "reading" else ""
        values = self.table.numbers(column.index, self.mark, words)
        if column.unit is None:
            return column.sign * values
        unit, most = column.unit, MAX_NUMBERS[column.unit.si] / column.unit.scale
        self.table.refuse(  # NaN where a cell is blank
            (values > most) | (values < -most),
            column.name,
            lambda row: f"expected numbers up to {most:g} {unit.name}, got {values[row]:g}",
        )
        self.table.refuse(
            (np.abs(values) < MIN_NUMBER) & (values != 0),
            column.name,
            lambda row: f"expected 0 or numbers of at least {MIN_NUMBER:g} {unit.name}, got {values[row]:g}",
        )
        scale = column.sign * unit.scale
        return values if scale == 1 else scale * values

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
            last = int(blank.argmax()) == self.table.rows - 1
            what, key = (
                ("a line behind the table", "footer = 1") if last else ("merged cells", "merged = true")
            )
            hint = f"for {what} say {key} in the map's [file]"
            if column.slot.what in ACTS:
                hint = "say 0 where none acts"
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
            The error; it also lists the ignored columns.
        """
        ignored = f", ignored columns {list(self.ignored)}" if self.ignored else ""
        if self.ignored and not hint:
            hint = "; testbench data map proposes a map"
        return self.table.header_error(f"missing columns {list(missing)}{ignored}{hint}")

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
    if not named:
        hint = "names that are not ours need a map, a file without a header too"
        wanted = ", ".join(joint.shown_column for joint in arm.file_joints) or "mass_kg"
        got = ", ".join(table.names[:3])
        raise table.header_error(f"no column is known, expected {wanted}, got {got} ...; {hint}")
    _check_map(table, names, named)
    # Join rows of single axes; the map's names replace our own.
    table, named = join_axes(table, named, names)
    named = _chosen(named)
    # One column per quantity, with its unit.
    found: dict[Slot, ReadColumn] = {}
    for k, own in named.items():
        unit = _unit(table, k, own, arm)
        slot = own.slot
        if slot.what == "sigma":
            slot = replace(slot, index=int(unit is not None and unit.si == "rad"))
        if slot in found:
            both = " and ".join(map(repr, (found[slot].name, table.names[k])))
            raise table.header_error(f"expected every column once, got {both} for the same quantity")
        if slot in names.values:
            problem = f"expected no value in the map for {table.names[k]!r}, which the file has"
            raise names.error(table.path, "values", problem)
        found[slot] = ReadColumn(k, table.names[k], slot, unit, own.sign)
    ignored = tuple(
        name for k, name in enumerate(table.names) if k not in named and name and name not in names.cells
    )
    # Replace words for lost targets and for loads, and fill merged cells.
    readings = [c.index for c in found.values() if c.slot.what in READ]
    loads = [c.index for c in found.values() if c.slot.what in ("mass", "force", "moment")]
    mark = table.mark([c.index for c in found.values() if c.unit])
    table = table.worded(readings, names.lost)
    table = table.worded(loads, {word: value.replace(".", mark) for word, value in names.loads.items()})
    if names.map.file.merged:
        table = table.filled([c.index for c in found.values() if c.index not in readings])
    if table.sheet and "" not in names.lost:
        _refuse_blanks(table, [c for c in found.values() if c.index in readings])
    return Columns(table, names, found, ignored, mark, _warnings(table, names, ignored))


def _refuse_blanks(table: TableCells, columns: Sequence[ReadColumn]) -> None:
    """Refuse blank cells of readings in a sheet: they may be errors, or formulas without a result."""
    blank = np.array([table.blank(c.index) for c in columns], dtype=bool).reshape(-1, table.rows).T
    problem = (
        "expected a number, got a blank cell, an error or a formula without its result; if blank cells are "
    )
    problem += 'lost targets say so in the map: [words] lost = ""'
    table.refuse(blank, [c.name for c in columns], problem)


def _warnings(table: TableCells, names: Names, ignored: Sequence[str]) -> tuple[str, ...]:
    """Write warnings about a log joined by the order of its rows, and about columns that are not read."""
    log = names.map.log
    keys = [] if log is None else [*log.on, *log.to]
    full = {name for k, name in enumerate(table.names) if not table.blank(k).all()}
    words = unread_column_warnings([name for name in ignored if name in full and name not in keys])
    if log is not None and log.rows is not None:
        each = f"{log.rows} rows" if log.rows > 1 else "one row"
        words.insert(0, f"warning: {log.file} is joined by the order of its rows, each to {each} of readings")
    return tuple(words)


def _check_map(table: TableCells, names: Names, named: dict[int, Named]) -> None:
    """Check that every entry of the map has a column in the file."""
    used = {own.mapped for own in named.values()}
    for name, own in names.theirs.items():
        if own.mapped not in used and not own.optional:
            columns = ", ".join(map(repr, table.names))
            problem = f"no column like {name!r} in {table.path.name}; columns are {columns}"
            raise names.error(table.path, f"columns.{own.mapped}", problem)


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
    if not said and (parts := split_unit(table.names[k])):
        said = [parts[1]]
    expected = " or ".join(f"_{u}" for u in allowed)
    if not said:
        problem = f"expected a unit at the end of the name such as {expected}, in brackets, or in a map"
        raise table.header_error(problem, table.names[k])
    if said[0].si not in allowed or any(u != said[0] for u in said):
        got = " and ".join(dict.fromkeys(u.name for u in said))
        raise table.header_error(f"expected one unit, of {expected}, got {got}", table.names[k])
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
