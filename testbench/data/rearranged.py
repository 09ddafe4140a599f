"""Tables rearranged: cells of several quantities become columns, three rows of a point become one."""

import re
from collections import Counter
from dataclasses import replace

import numpy as np

from testbench.data.mapping import Named, Names
from testbench.data.names import WHOLE, XYZ, recognise, squeeze
from testbench.data.table import Table
from testbench.errors import Ids

MOST_STARS = 2  #: Wildcards in a pattern: more take long to match.


def take_apart(table: Table, names: Names) -> tuple[Table, list[str]]:
    """The table with a column more for every part of its combined cells, and how its columns are called.

    A name that stands in the header again is called by its number too, as "X (2)", where the map does so.

    Raises:
        InputError: At a pattern that is none, or a cell that none of its patterns fits.
    """
    read_as = _numbered(table.names, names)
    for header, patterns in names.cells.items():
        place, wholes = f"cells.{header}", []
        if header not in table.names:
            have = ", ".join(map(repr, table.names))
            raise names.error(table.path, place, f"no such column; columns are {have}")
        for pattern in patterns:
            parts = re.findall(r"\{(\w+)\}", pattern)
            known = all(recognise(part, names.ours) for part in parts)
            if not parts or not known or len(set(parts)) < len(parts) or pattern.count("*") > MOST_STARS:
                problem = (
                    "expected quantities such as {run}, {pose}, {marker}, each once, * for anything else, "
                    f"got {pattern!r}"
                )
                raise names.error(table.path, place, problem)
            wholes.append(_expression(pattern))
        parts = list(dict.fromkeys(part for whole in wholes for part in whole.groupindex))
        table = table.with_parts(table.names.index(header), parts, wholes, " or ".join(map(repr, patterns)))
        read_as += parts
        if not names.maps(header):
            read_as[table.names.index(header)] = ""  # one of our names, but its parts count
    return table, read_as


def _numbered(header: tuple[str, ...], names: Names) -> list[str]:
    """The names of a header; those that stand there again with their number, where the map has it."""
    count, found = Counter[str](), list[str]()
    for name in header:
        count[name] += 1
        numbered = f"{name} ({count[name]})"
        found.append(numbered if count[name] > 1 and names.maps(numbered) else name)
    return found


def _expression(pattern: str) -> re.Pattern[str]:
    """A pattern as a regular expression: {part} is as short as may be, * anything."""
    pieces = re.split(r"\{(\w+)\}", pattern)
    literal = [re.escape(piece).replace(r"\*", ".*") for piece in pieces[::2]]
    groups = [f"(?P<{part}>.+?)" for part in pieces[1::2]]
    return re.compile("".join(a + b for a, b in zip(literal, [*groups, ""], strict=True)), re.IGNORECASE)


def join_axes(table: Table, named: dict[int, Named], names: Names) -> tuple[Table, dict[int, Named]]:
    """The table with a row a point where a column says the axis of a row; else as it is.

    Returns:
        The table, and which of its columns says what.

    Raises:
        InputError: Where the three rows of a point do not stand together, or differ in what they share.
    """
    axis = next((k for k, own in named.items() if own.slot.what == "axis"), None)
    whole = [k for k, own in named.items() if own.slot.index == WHOLE]
    if axis is None or not whole:
        for k in whole:
            if named[k].mapped:
                problem = f"expected an axis in the name {named[k].mapped!r}, or a column of axes, 'axis'"
                raise names.error(table.path, f"columns.{named[k].mapped}", problem)
        return table, {k: own for k, own in named.items() if k not in (axis, *whole)}
    other = [squeeze(text) in names.ignored for text in table.texts(axis)]
    table = table.take(~np.array(other, dtype=bool))
    rows = _rows_of_points(table, axis)
    kept = [k for k in range(len(table.names)) if k != axis and k not in whole]
    _check_shared(table, [k for k in kept if k in named])
    points, spread = table.take(np.arange(table.rows) % 3 == 0), [(k, i) for k in whole for i in range(3)]
    points = replace(
        points,
        names=(*(table.names[k] for k in kept), *(f"{XYZ[i]} {table.names[k]}" for k, i in spread)),
        units=tuple(table.units[k] for k in (*kept, *(k for k, _ in spread))),
        cells=[points.cells[k] for k in kept] + [table.cells[k].take(rows[:, i]) for k, i in spread],
    )
    found = {n: named[k] for n, k in enumerate(kept) if k in named}
    for n, (k, i) in enumerate(spread, start=len(kept)):
        found[n] = replace(named[k], slot=replace(named[k].slot, index=i))
    return points, found


def _rows_of_points(table: Table, axis: int) -> Ids:
    """Rows of x, y and z of every point, (points, 3)."""
    texts = [squeeze(text) for text in table.texts(axis)]
    for row, text in enumerate(texts):
        if text not in XYZ:
            got = table.texts(axis)[row][:80]
            problem = f"no axis {got!r}; axes are {', '.join(XYZ)}, a map's [words] may ignore others"
            raise table.error(row, table.names[axis], problem)
    for row in range(0, len(texts), 3):
        if sorted(texts[row : row + 3]) != list(XYZ):
            problem = "expected the rows x, y, z of a point together, one each"
            raise table.error(row, table.names[axis], problem)
    order = np.array([XYZ.index(text) for text in texts], dtype=int).reshape(-1, 3)
    return np.argsort(order, axis=1) + 3 * np.arange(len(order))[:, None]


def _check_shared(table: Table, columns: list[int]) -> None:
    """What holds for a point is the same in its three rows, or blank in the lower ones."""
    for k in columns:
        texts = table.texts(k)
        for row, text in enumerate(texts):
            first = texts[row - row % 3]
            if text not in (first, ""):
                problem = f"expected {first[:80]!r} as in the other rows of the point, got {text[:80]!r}"
                raise table.error(row, table.names[k], problem)
