"""Lines of a proposed map, and units that only values tell."""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from testbench.errors import Array
from testbench.files.names import NUMBER, Unit, number_of, split_unit
from testbench.files.table import TableCells

GROUPED = re.compile(r"[+-]?\d{1,3}([.,' \u00a0\u202f]\d{3})+([.,]\d+)?")  #: A number of divided thousands.
TURNS = 7.0  #: Joint coordinates beyond are degrees [rad].
LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
PLACE, SCATTER = 1.0, 3e-5
"""What positions are, and what they scatter by, to an order of magnitude [m]."""


class Entry(NamedTuple):
    """Hold one line of a map."""

    table: str
    key: str
    value: object
    why: str = ""  #: Where it is a guess.


def unit_of(table: TableCells, k: int) -> Unit | None:
    """Find the unit that a column's name states, or else the line below the header.

    Args:
        table: The export.
        k: Place of the column.

    Returns:
        The unit; None if neither states one.
    """
    parts = split_unit(table.names[k])
    return table.units[k] if parts is None else parts[1]


def reasons(*why: str) -> str:
    """Join the reasons of a guess.

    Args:
        why: The reasons; "" for none.

    Returns:
        One text; "" if there are none.
    """
    return "; ".join(filter(None, why))


def not_these(table: TableCells, columns: Sequence[int]) -> str:
    """Say which other columns could have been meant.

    Args:
        table: The export.
        columns: Places of these columns.

    Returns:
        Such as "not 'X2'"; "" if there are none.
    """
    names = ", ".join(repr(table.names[k]) for k in columns)
    return names and f"not {names}"


def angle_unit(table: TableCells, joints: Sequence[int]) -> tuple[str, str]:
    """Guess the unit of joints from their values: degrees if one exceeds TURNS, else radians.

    Args:
        table: The export.
        joints: Places of the joints' columns.

    Returns:
        Suffix of the map's key, "_deg" or "_rad", and the reason.
    """
    unit, why = angle_of(_sizes(table, joints))
    return f"_{unit}", why


def angle_of(values: Array) -> tuple[str, str]:
    """Guess the unit of angles: degrees if one exceeds TURNS, else radians.

    Args:
        values: The angles, of any shape.

    Returns:
        "deg" or "rad", and the reason.
    """
    most = float(np.abs(values).max(initial=0.0))
    return "deg" if most > TURNS else "rad", f"joints up to {most:.4g}"


def length_of(values: Array, typical: float, stated: str) -> tuple[str, str]:
    """Guess the unit of lengths from their median.

    Args:
        values: The lengths, of any shape.
        typical: What they are, to an order of magnitude [m].
        stated: Unit of positions that the file states; "" where it states none.

    Returns:
        Name of the unit, and the reason; "" if the unit is stated.
    """
    if stated and typical == PLACE:
        return stated, ""
    middle = float(np.median(np.abs(values))) if np.size(values) else 1.0
    middle = middle or 1.0
    unit = min(LENGTHS, key=lambda unit: abs(np.log(middle * LENGTHS[unit] / typical)))
    return unit, f"numbers around {middle:.4g}"


def length_unit(
    table: TableCells, k: int, alike: Sequence[int], typical: float, stated: str
) -> tuple[str, str]:
    """Guess the unit of a column of lengths from the values of columns like it, where its name states none.

    Args:
        table: The export.
        k: Place of the column.
        alike: Places of the columns whose values count.
        typical: What they are, to an order of magnitude [m].
        stated: Unit of positions that the file states; "" where it states none.

    Returns:
        Suffix of the map's key, such as "_mm", and the reason; both "" where no suffix is needed.
    """
    if unit_of(table, k):
        return "", ""
    unit, why = length_of(_sizes(table, alike), typical, stated)
    return f"_{unit}", why


def _sizes(table: TableCells, columns: Sequence[int]) -> Array:
    """The numbers of some columns, those that are none left out."""
    numbers = (number_of(text) for k in columns for text in table.texts(k))
    return np.array([number for number in numbers if number is not None])


def lost_words(table: TableCells, columns: Sequence[int]) -> list[Entry]:
    """Find the words that columns of positions have for lost targets: cells that are no numbers.

    Args:
        table: The export.
        columns: Places of the columns of positions.

    Returns:
        One line of the map that lists the words; empty if there are none.
    """
    texts = {text for k in columns for text in table.texts(k)}
    words = sorted(text for text in texts if text and number_of(text) is None)
    words = [text for text in words if not GROUPED.fullmatch(text) and not NUMBER.search(text)]
    return [Entry("words", "lost", words, "no numbers")] if words else []
