"""Which column of a file says what: found by our names and those of a map, each with one unit."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.axis_rows import join_axes
from testbench.data.combined import take_apart
from testbench.data.mapping import Named, Names
from testbench.data.names import DEFLECTION, ROTATIONS, SI, XYZ, Slot, What
from testbench.data.table import Table
from testbench.data.units import LARGEST, LEAST, Unit, split_unit
from testbench.errors import Array, InputError

SUSPECT = {"rad": (2.5 * np.pi, "degrees"), "m": (10.0, "millimetres")}
"""Coordinates that only another unit explains, and that unit."""
READ: tuple[What, ...] = ("reading", "covariance", "deviation", "turn_deviation", "spread", *ROTATIONS)
"""Quantities whose cells are blank, or hold a word, where a target was lost."""


ACTS: tuple[What, ...] = ("force", "moment", "process")
"""Quantities that are 0 where nothing acts."""


@dataclass(frozen=True)
class Column:
    """A column that is read."""

    index: int  #: In the table.
    name: str  #: As it stands in the file.
    slot: Slot  #: What it says.
    unit: Unit | None  #: Its unit; None for what has none.
    sign: float  #: -1 for a column of the opposite direction.


@dataclass(frozen=True)
class Columns:
    """What a table says, column by column."""

    table: Table  #: The cells.
    names: Names  #: Of the quantities.
    found: dict[Slot, Column]  #: The columns that are read.
    ignored: tuple[str, ...]  #: Names of the others.
    mark: str  #: The decimal mark.

    def every(self, *what: str) -> list[Column]:
        """The columns of some quantities, in the order of the file."""
        return sorted((c for c in self.found.values() if c.slot.what in what), key=lambda c: c.index)

    def get(self, slot: Slot) -> Column | None:
        """The column of a quantity; None where there is none."""
        return self.found.get(slot)

    def values(self, column: Column) -> Array:
        """A column in SI units, (rows,); NaN where it is blank."""
        lost = '; a word for a lost target goes into the map, as [words] lost = "NaN"'
        words = lost if column.slot.what == "reading" else ""
        values = self.table.numbers(column.index, self.mark, words)
        if column.unit is None:
            return column.sign * values
        unit, most = column.unit, LARGEST[column.unit.si] / column.unit.scale
        beyond = np.flatnonzero((values > most) | (values < -most))  # NaN where a cell is blank
        if len(beyond):
            problem = f"expected numbers up to {most:g} {unit.name}, got {values[beyond[0]]:g}"
            raise self.table.error(beyond[0], column.name, problem)
        tiny = np.flatnonzero((np.abs(values) < LEAST) & (values != 0))
        if len(tiny):
            problem = f"expected 0 or numbers of at least {LEAST:g} {unit.name}, got {values[tiny[0]]:g}"
            raise self.table.error(tiny[0], column.name, problem)
        scale = column.sign * unit.scale
        return values if scale == 1 else scale * values

    def full(self, column: Column) -> Array:
        """The same where no cell may be blank; InputError at the first blank one."""
        values = self.values(column)
        blank = np.flatnonzero(np.isnan(values))
        if len(blank):
            last = blank[0] == self.table.rows - 1
            what, key = (
                ("a line behind the table", "footer = 1") if last else ("merged cells", "merged = true")
            )
            hint = f"for {what} say {key} in the map's [file]"
            if column.slot.what in ACTS:
                hint = "say 0 where none acts"
            raise self.table.error(blank[0], column.name, f"expected a finite number, got ''; {hint}")
        return values

    def lack(self, missing: Sequence[str], hint: str = "") -> InputError:
        """The error about columns that are not there."""
        ignored = f", ignored columns {list(self.ignored)}" if self.ignored else ""
        problem = f"missing columns {list(missing)}{ignored}{hint}"
        return InputError(self.table.path, f"line {self.table.header}", problem)

    def constant(self, slot: Slot) -> float | None:
        """A quantity that the map states, in SI units; None where it does not."""
        stated = self.names.values.get(slot)
        return None if stated is None else stated[0] * stated[1].scale


def find_columns(table: Table, names: Names, arm: Arm) -> Columns:
    """Which column says what.

    Raises:
        InputError: Where two columns say the same, a unit is missing or a column of the map is not there.
    """
    table, read_as = take_apart(table, names)
    named = {k: own for k, name in enumerate(read_as) if (own := names.find(name))}
    if not named:
        hint = "names that are not ours need a map, a file without a header too"
        wanted = ", ".join(joint.shown_column for joint in arm.joints)
        problem = f"no column is known, expected {wanted}, got {', '.join(table.names[:3])} ...; {hint}"
        raise InputError(table.path, f"line {table.header}", problem)
    _check_map(table, names, named)
    table, named = join_axes(table, named, names)
    named = _chosen(named)
    found: dict[Slot, Column] = {}
    for k, own in named.items():
        unit = _unit(table, k, own, arm)
        slot = own.slot
        if slot.what == "sigma":
            slot = replace(slot, index=int(unit is not None and unit.si == "rad"))
        if slot in found:
            both = " and ".join(map(repr, (found[slot].name, table.names[k])))
            problem = f"expected every column once, got {both} for the same quantity"
            raise InputError(table.path, f"line {table.header}", problem)
        if slot in names.values:
            problem = f"expected no value in the map for {table.names[k]!r}, which the file has"
            raise InputError(names.path or table.path, "values", problem)
        found[slot] = Column(k, table.names[k], slot, unit, own.sign)
    ignored = tuple(
        name for k, name in enumerate(table.names) if k not in named and name and name not in names.cells
    )
    readings = [c.index for c in found.values() if c.slot.what in READ]
    loads = [c.index for c in found.values() if c.slot.what in ("mass", "force", "moment")]
    mark = table.mark([c.index for c in found.values() if c.unit])
    table = table.worded(readings, names.lost)
    table = table.worded(loads, {word: value.replace(".", mark) for word, value in names.loads.items()})
    if names.layout.merged:
        table = table.filled([c.index for c in found.values() if c.index not in readings])
    return Columns(table, names, found, ignored, mark)


def _check_map(table: Table, names: Names, named: dict[int, Named]) -> None:
    """Every line of the map has a column in the file."""
    used = {own.mapped for own in named.values()}
    for own in names.theirs.values():
        if own.mapped not in used and not own.optional:
            problem = f"no such column in {table.path.name}; columns are {', '.join(map(repr, table.names))}"
            raise InputError(names.path or table.path, f"columns.{own.mapped}", problem)


def _chosen(named: dict[int, Named]) -> dict[int, Named]:
    """Without our own names for what the map names, and without readings that say less than others."""
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


def _unit(table: Table, k: int, own: Named, arm: Arm) -> Unit | None:
    """The unit of a column: its name says it, the map, or the line below the header."""
    allowed = SI.get(own.slot.what, ())
    if own.slot.what == "joint":
        allowed = (arm.joints[own.slot.index].unit,)
    if own.slot.what == "torque":
        allowed = ("N",) if arm.joints[own.slot.index].prismatic else ("Nm",)
    if not allowed:
        return None
    said = [unit for unit in (own.unit, own.header, table.units[k]) if unit]
    if not said and (parts := split_unit(table.names[k])):
        said = [parts[1]]
    place, expected = f"line {table.header}, column {table.names[k]}", " or ".join(f"_{u}" for u in allowed)
    if not said:
        problem = f"expected a unit at the end of the name such as {expected}, in brackets, or in a map"
        raise InputError(table.path, place, problem)
    if said[0].si not in allowed or any(u != said[0] for u in said):
        got = " and ".join(dict.fromkeys(u.name for u in said))
        raise InputError(table.path, place, f"expected one unit, of {expected}, got {got}")
    return said[0]


def axes(columns: Columns, what: What) -> list[Column | None]:
    """The columns of a vector, x, y, z: all, none, or one alone whose others are zero.

    Raises:
        InputError: When one is missing.
    """
    found = [next((c for c in columns.every(what) if c.slot.index == k), None) for k in range(3)]
    stated = [any(s.what == what and s.index == k for s in columns.names.values) for k in range(3)]
    have = [f is not None or s for f, s in zip(found, stated, strict=True)]
    if sum(have) == 2 or (what == "point" and 0 < sum(have) < 3):
        raise columns.lack([f"{what}_{XYZ[k]}_{SI[what][0]}" for k in range(3) if not have[k]])
    return found


def joint_coordinates(columns: Columns, arm: Arm) -> Array:
    """Joint coordinates within the arm's limits, (rows, n) [rad, m].

    Raises:
        InputError: Names line and column.
    """
    q = np.empty((columns.table.rows, arm.n_joints))
    found = [columns.get(Slot("joint", k)) for k in range(arm.n_joints)]
    stated = [columns.constant(Slot("joint", k)) for k in range(arm.n_joints)]
    units = {column.unit.si: column.unit.name for column in found if column and column.unit}
    missing = [
        f"{joint.name}_{units.get(joint.unit, joint.unit)}"
        for joint, column, value in zip(arm.joints, found, stated, strict=True)
        if column is None and value is None
    ]
    if missing:
        raise columns.lack(missing, _numbered(columns.ignored, arm.n_joints))
    for k, (column, value) in enumerate(zip(found, stated, strict=True)):
        q[:, k] = columns.full(column) if column else value
    _check_limits(columns, arm, q)
    return q


def _numbered(ignored: Sequence[str], count: int) -> str:
    """The line of a map for columns that are numbered as the joints are; empty where there are none."""
    units = dict(split_unit(name) or (name, None) for name in ignored)
    for name, unit in units.items():
        before, one, after = name.rpartition("1")
        if one and all(f"{before}{k}{after}" in units for k in range(1, count)):
            n = "{n}" if f"{before}{count}{after}" in units else "{n0}"
            if n == "{n0}" and f"{before}0{after}" not in units:
                continue
            ours = f"joint_{n}_{unit.name if unit else 'deg'}"
            return f"""; are they joints? [columns] of a map: "{ours}" = "{before}{n}{after}\""""
    return ""


def _check_limits(columns: Columns, arm: Arm, q: Array) -> None:
    """Refuse what is beyond the arm's limits; degrees are the first suspect."""
    lower, upper = arm.limits
    bad = np.argwhere((q < lower - 1e-6) | (q > upper + 1e-6))
    if not len(bad):
        return
    i, k = bad[0]
    joint, column = arm.joints[k], columns.get(Slot("joint", k))
    unit = column.unit if column else None
    name, scale = (unit.name, unit.scale) if unit else (joint.unit, 1.0)
    alike = [other.prismatic == joint.prismatic for other in arm.joints]
    most, suspect = SUSPECT[joint.unit]
    hint = f"; are these {suspect}?" if name == joint.unit and np.abs(q[:, alike]).max() > most else ""
    if not hint and column and np.all((-q[:, k] >= lower[k]) & (-q[:, k] <= upper[k])):
        other = column.name if column.sign < 0 else f"-{column.name}"
        hint = f"; with the other sign all rows are within: [columns] of a map reads it so as {other!r}"
    low, high, got = (x / scale for x in (joint.lower, joint.upper, q[i, k]))
    problem = f"expected {low:.4f} to {high:.4f} {name}, got {got:g}{hint}"
    raise columns.table.error(i, column.name if column else joint.name, problem)
