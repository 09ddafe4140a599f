"""An export read without a map: by the layout that fits, else by the names of columns that are known."""

import contextlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from testbench.arm.folder import Arm
from testbench.errors import InputError
from testbench.files.guess import MASS, Entry
from testbench.files.guessed_names import marked
from testbench.files.layouts import Fitting, fitting
from testbench.files.mapping import FileLayout
from testbench.files.names import (
    STATES,
    XYZ,
    are_markers,
    column_meaning,
    find_unit,
    joint_family,
    joints_of,
    looks_like,
    masses_in,
    places,
    state_of,
)
from testbench.files.rearranged import read_log
from testbench.files.table import TableCells
from testbench.files.text import (
    BLANK,
    DELIMITERS,
    SHEET,
    UNIT_LABEL,
    even_rows,
    read_letters,
    sheets_with_tables,
    split_lines,
)

MAX_HEADER = 3  #: Most lines of a header.
MAX_QUANTITIES = 1000  #: Most lines of a file whose rows are columns: each is a quantity, or a remark.
LONGEST = 2_000  #: Letters of a line above a table that is looked at.
GUESSED_LAYOUT = {
    "transposed": "the first column names the joints",
    "tidy": "each row holds one quantity: its name and its value",
}
"""Why the layout of a file is as it was found."""


class ReadFile(NamedTuple):
    """Hold a table and how it was read."""

    table: TableCells
    fits: Fitting | None  #: The layout that fits.
    file: FileLayout  #: How the table is written.


def read_unknown(path: Path, arm: Arm, layout: str | None = None, sheets: Sequence[str] = ()) -> ReadFile:
    """Read a table by the layout that fits, else by the names of columns that are known.

    Args:
        path: The file.
        arm: The arm that was measured.
        layout: Name of the layout that the file has; None for the one that fits.
        sheets: Sheets of a workbook that make one table; none for the first one.

    Returns:
        The table, and how it was read.

    Raises:
        InputError: If the file cannot be read, is no table, or fits several layouts.
    """
    place, joint = places(arm), joints_of(arm)

    def known(name: str) -> bool:
        return bool(column_meaning(name) or place(name) or joint(name) or looks_like(name, "joints"))

    def read(**how: object) -> ReadFile:
        other = file.model_copy(update=how)
        return ReadFile(read_log(path, bool if fits else known, other), fits, other)

    fits, file = None, FileLayout(sheets=[*sheets])
    if _lies(path, arm):
        return read(transposed=True)
    if fits := fitting(path, arm, layout):
        file = fits.file.model_copy(update={"sheets": [*sheets]})
    try:
        found = read()
    except InputError:
        with contextlib.suppress(InputError):
            titled = read(sections=True)
            titles = list(dict.fromkeys(titled.table.texts(len(titled.table.names) - 1)))
            if all(map(state_of, titles)) or masses_in(titles) or marked(titles, arm):
                return titled
        raise
    if fits:
        return found
    if tidy := _tidy(found.table, arm):
        return read(tidy=tidy)
    return _with_upper_lines(found, read, arm)


def _with_upper_lines(found: ReadFile, read: Callable[..., ReadFile], arm: Arm) -> ReadFile:
    """A table whose header has further lines, of merged cells, if only these tell its positions apart."""
    place = places(arm)
    axes = [*filter(place, found.table.names)]
    for lines in range(2, MAX_HEADER + 1) if len({*axes}) < max(len(axes), len(XYZ)) else ():
        with contextlib.suppress(InputError):
            wide = read(header=lines)
            several = [name for name in wide.table.names if place(MASS.sub(" ", name))]
            whole = len({*several}) == len(several) >= max(len(axes), len(XYZ))
            if whole and (axes or joint_family(wide.table.names, arm)):
                return wide
    return found


def _tidy(table: TableCells, arm: Arm) -> list[str]:
    """Columns of the names, values and units of quantities, if each row holds one of them; else none."""
    place, kinds = places(arm), [column_meaning(name) for name in table.names]
    if "position" not in kinds or "axis" in kinds or any(map(place, table.names)):
        return []
    value = table.names[kinds.index("position")]
    for k, name in enumerate(table.names):
        found = {*map(place, {*table.texts(k)})}
        if name != value and any(at and {at._replace(axis=axis) for axis in XYZ} <= found for at in found):
            units = [own for own in table.names if UNIT_LABEL.fullmatch(own)][:1]
            return [name, value, *units]
    return []


def _lies(path: Path, arm: Arm) -> bool:
    """Whether the first cells of a file's lines name the joints: its rows are columns."""
    text, how = read_letters(path, None, ".")
    lines = split_lines(path, text)
    if len(lines) > MAX_QUANTITIES:
        return False
    rows = even_rows(lines, ["\t"] if how.startswith(SHEET) else DELIMITERS[:4])
    first = [row[0] for row in rows]
    joints = joint_family(first, arm)
    return bool(joints) and all(first.count(first[k]) == 1 for k in joints)


def sheets_of(path: Path, arm: Arm, layout: str | None = None) -> list[str]:
    """List the sheets of a workbook that make one table: their names say states, masses or targets.

    Args:
        path: The file.
        arm: The arm, with the names of its markers.
        layout: Name of the layout that the sheets have; None for the one that fits.

    Returns:
        Their names; empty if there are fewer than two, or the path names one.

    Raises:
        InputError: If the workbook cannot be read.
    """
    names = sheets_with_tables(path)
    first = read_unknown(path, arm, layout).table if len(names) > 1 else None
    alike = [name for name in names if first is not None and _alike(first, _sheet(path, name), arm, layout)]
    states = [state_of(name) for name in alike]
    targets = are_markers(alike, arm)
    together = sorted(states) == sorted(STATES) or masses_in(alike) or targets
    return alike if len(alike) > 1 and together else []


def _sheet(path: Path, name: str) -> Path:
    return path.with_name(f"{path.name}#{name}")


def _alike(first: TableCells, path: Path, arm: Arm, layout: str | None) -> bool:
    """Whether a sheet has the columns of another one."""
    with contextlib.suppress(InputError):
        read_unknown(path, arm, layout).table.cells_like(first)
        return True
    return False


def unit_in_cells(table: TableCells) -> str:
    """Find the unit of lengths that every cell of a column of units says.

    Args:
        table: The export.

    Returns:
        Name of the unit; "" without such a column.

    Raises:
        InputError: If it holds several units of length.
    """
    for name in (name for name in table.names if UNIT_LABEL.fullmatch(name)):
        units = {
            unit.name
            for text in table.texts(table.names.index(name))
            if (unit := find_unit(text)) and unit.si == "m"
        }
        if len(units) > 1:
            raise table.header_error(f"expected one unit of length, got {' and '.join(sorted(units))}", name)
        if units:
            return units.pop()
    return ""


def lines_above(table: TableCells) -> tuple[str, ...]:
    """List the lines before a table's header.

    Args:
        table: The export.

    Returns:
        The lines that hold something; none where the file has no header.
    """
    lines = read_letters(table.path, None, ".")[0].splitlines()[: max(table.header - 1, 0)]
    return tuple(line for line in lines if line.strip(BLANK) and len(line) <= LONGEST)


def file_entries(table: str, file: FileLayout) -> list[Entry]:
    """List where a table is, and how it is written, as far as a map has to say it.

    Args:
        table: Table of the map: "file", or "log.table" of a log.
        file: How the file is written.

    Returns:
        Lines of the map.
    """
    said = file.model_dump(exclude_defaults=True, exclude_none=True)
    return [
        Entry(table, key, value, GUESSED_LAYOUT.get(key, ""))
        for key, value in said.items()
        if (key, value) != ("skip", 0)
    ]
