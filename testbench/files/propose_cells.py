"""Several numbers in one cell, and headers of several lines: what a map has to say of them."""

import re
from collections.abc import Sequence
from itertools import accumulate

import numpy as np

from testbench.arm.folder import Arm
from testbench.errors import Array
from testbench.files.meaning import places, plain
from testbench.files.names import XYZ, Unit, find_unit, split_unit
from testbench.files.table import Table
from testbench.files.text import BLANK, cells_in, read_letters, split_lines

NUMBERS = {
    mark: re.compile(rf"(?<![\w{mark}])[-+]?(?:\d+(?:[{mark}]\d*)?|[{mark}]\d+)(?:[eE][-+]?\d+)?(?!\w)")
    for mark in (".", ",")
}
"""Of a cell, by decimal mark; A1 holds none."""
TURNED = re.compile("rotation|orientation|quaternion|euler|.*error|velocity|acceleration")
"""Above an axis: it is not that of a position."""
LENGTH = re.compile(r"(?:units?|einheit(?:en)?|unit(?:é|e)s?)[^\w]+(?:\w+\s*[=:]\s*)?(\w+)", re.IGNORECASE)
LONGEST = 2_000  #: Letters of a line, or cell, that is looked at.


def unit_of(table: Table, k: int) -> Unit | None:
    """The unit of a column by its name or the line below the header."""
    parts = split_unit(table.names[k])
    return table.units[k] if parts is None else parts[1]


def cell_pattern(texts: Sequence[str], count: int) -> tuple[list[str], Array] | None:
    """What stands around the first numbers of cells that are all written alike, and these numbers.

    Args:
        texts: The cells.
        count: How many numbers are wanted; further ones must be the same in all cells.

    Returns:
        count + 1 pieces of text, and the numbers, (cells, count); None where the cells hold no such numbers.
    """
    texts = list(dict.fromkeys(texts))
    if any(len(text) > LONGEST for text in texts):
        return None
    for mark, number in NUMBERS.items():
        found = [number.findall(text) for text in texts]
        if len({*map(len, found)}) != 1 or len(found[0]) < count:
            continue
        rest = {tuple(own[count:]) for own in found}
        between = {
            tuple(piece.strip() or " " * bool(piece) for piece in number.split(text)) for text in texts
        }
        if len(rest) == len(between) == 1:
            [own], [more] = between, rest
            last = own[count] + "".join(a + b for a, b in zip(more, own[count + 1 :], strict=True))
            values = [[float(x.replace(mark, ".")) for x in numbers[:count]] for numbers in found]
            return [*own[:count], last], np.array(values)
    return None


def lines_above(table: Table) -> list[str]:
    """The lines before a table's header that say something; none where the file has no header."""
    if table.header < 2:
        return []
    text, _ = read_letters(table.path, None, ".")
    head = "\n".join(text.splitlines()[: table.header - 1])
    lines = split_lines(table.path, head)
    return [line for line in lines if line.strip(BLANK) and len(line) <= LONGEST]


def length_said(above: Sequence[str]) -> str:
    """The unit of length that lines above a header say, as "Length Units,Meters"; "" where none does."""
    found = (find_unit(word) for line in above for word in LENGTH.findall(line))
    return next((unit.name for unit in found if unit and unit.si == "m"), "")


def names_below_targets(table: Table, above: Sequence[str], arm: Arm) -> list[str]:
    """Names of all columns where the targets stand in a line above the axes, as motion capture writes them.

    Returns:
        Such as "P1 X [mm]"; none where the header needs no line above, or none says whose its axes are.
    """
    place, rows = places(arm), [_filled(line, table) for line in above]
    turned = {k for row in rows for k, word in enumerate(row) if TURNED.fullmatch(plain(word))}
    axes = {k: at.axis for k, name in enumerate(table.names) if (at := place(name)) and not at.target}
    axes = {k: axis for k, axis in axes.items() if k not in turned}
    if len(axes) <= len(XYZ):
        return []
    labels = [
        row
        for row in rows
        if sorted((row[k], axis) for k, axis in axes.items())
        == [(label, axis) for label in sorted({row[k] for k in axes} - {""}) for axis in XYZ]
    ]
    if not labels:
        return []
    markers = {plain(marker) for marker in arm.markers}
    row = max(labels, key=lambda row: len({plain(_last(row[k])) for k in axes} & markers))
    own = list(dict.fromkeys(row[k] for k in axes))
    known = all((p := place(f"{_last(label)} x")) and p.target for label in own)
    short = {label: _last(label) if known else f"M{k}" for k, label in enumerate(own, start=1)}
    return [
        f"{short[row[k]]} {axes[k]}" + _bracketed(table, k, length_said(above))
        if k in axes
        else " ".join(filter(None, (row[k], "rotation" * (k in turned), name or f"column {k + 1}")))
        for k, name in enumerate(table.names)
    ]


def _filled(line: str, table: Table) -> list[str]:
    """The cells of a line above the header, each as wide as the columns below it."""
    cells = cells_in(line, table.delimiter)[: len(table.names)]
    wide = [*cells, *[""] * (len(table.names) - len(cells))]
    return list(accumulate(wide, _kept))


def _kept(left: str, own: str) -> str:
    return own or left


def _last(label: str) -> str:
    """The target of a label such as "Subject:P1"."""
    return label.rpartition(":")[2].strip()


def _bracketed(table: Table, k: int, length: str) -> str:
    unit = unit_of(table, k)
    name = unit.name if unit else length
    return f" [{name}]" if name else ""
