"""What hangs in each row of an export: masses, weights or words, in cells or in the names of columns."""

import re
from collections.abc import Iterator, Mapping, Sequence

from testbench.arm.document import is_decimal
from testbench.arm.folder import Arm
from testbench.files.guess import Entry, not_these, reasons, unit_of
from testbench.files.mapping import HOLE
from testbench.files.names import (
    BRACKETS,
    MAX_CODES,
    NUMBER,
    STATE_OF_CELL,
    STATE_OF_WORD,
    THOUSANDS,
    column_meaning,
    explained,
    masses_in,
    number_of,
    places,
    squeeze,
    state_of,
)
from testbench.files.table import TableCells
from testbench.files.text import read_letters

MASS = re.compile(r"(?<![\d.,])(?P<number>\d+(?:[.,]\d+)?)\s*(?P<unit>kg|lbs?)(?![^\W_])", re.IGNORECASE)
"""A mass in the name of a column, such as "X 150 kg [mm]"."""


def mass_entries(table: TableCells) -> Iterator[Entry]:
    """Guess the column of what hangs: masses, weights in newtons, or words such as "150 kg" and "none".

    Args:
        table: The export, with what the log adds.

    Yields:
        Lines of the map; none if no column says what hangs.

    Raises:
        InputError: If masses may be one or a thousand, or are in a unit that is none of masses.
    """
    columns = [k for k in mass_columns(table) if not _only_states(table, k)]
    if not columns:
        return
    k, *others = columns
    _refuse_several(table, columns)
    name, unit = table.names[k], unit_of(table, k)
    texts = [text for text in dict.fromkeys(table.texts(k)) if text]
    if unit and unit.si == "N":
        down = all(not text.startswith("-") for text in texts)
        yield Entry("columns", "force_z", f"-{name}" if down else name, "a weight, downwards")
        return
    _refuse_unclear_mass(table, name, texts)
    if masses := _masses(table, k):
        yield from _massive(name, masses, not_these(table, others))
        return
    told = "" if column_meaning(name) == "mass" else "its unit is a unit of mass"
    why = reasons(told if unit else "no unit", not_these(table, others))
    yield Entry("columns", "mass" if unit else "mass_kg", name, why)
    words = (text for text in texts if not NUMBER.search(text))
    if none := [text for text in words if STATE_OF_CELL.get(squeeze(text)) == "before"]:
        yield Entry("words", "0", none)


def _only_states(table: TableCells, k: int) -> bool:
    """Whether a column of loads only says whether something hangs, such as "yes" and "no"."""
    texts = {squeeze(text) for text in table.texts(k) if text}
    return unit_of(table, k) is None and bool(texts) and texts <= {*STATE_OF_CELL}


def _refuse_several(table: TableCells, columns: Sequence[int]) -> None:
    """Refuse several columns of loads that say different ones: they may be parts of a sum."""
    different = {tuple(table.texts(k)) for k in columns}
    if len(different) > 1:
        names = " and ".join(repr(table.names[k]) for k in columns)
        hint = f'say in [columns] of a map which one counts, as mass = "{table.names[columns[0]]}"'
        raise table.header_error(f"expected one column of loads, got {names}; {hint}")


def _refuse_unclear_mass(table: TableCells, name: str, texts: Sequence[str]) -> None:
    """Refuse masses that may be one or a thousand, and numbers in a unit that is none of masses."""
    if unclear := next(filter(THOUSANDS.search, texts), ""):
        problem = f"expected masses without a mark between thousands, as 1000 kg, got {unclear!r}"
        raise table.header_error(problem, name)
    numbers = all(number_of(text) is not None for text in texts)
    if numbers and (other := BRACKETS.match(name)) and unit_of(table, table.names.index(name)) is None:
        raise table.header_error(f"expected a unit of mass or force, got {other[2]!r}", name)


def _massive(name: str, masses: Mapping[str, str], left: str) -> Iterator[Entry]:
    """The column whose texts say masses, and the number of each."""
    numbers = {text: mass.partition(" ")[0] for text, mass in masses.items()}
    unit = max(mass.partition(" ")[2] for mass in masses.values())
    yield Entry("columns", f"mass_{unit}", name, left)
    for number in dict.fromkeys(numbers.values()):
        yield Entry("words", number, [text for text, own in numbers.items() if own == number])


def mass_columns(table: TableCells) -> list[int]:
    """Find the columns that say what hangs: by their names, else by their cells or by a unit of mass.

    Args:
        table: The export, with what the log adds.

    Returns:
        Places of the columns; empty if none says it.
    """
    kinds = {k: column_meaning(name) for k, name in enumerate(table.names)}
    bare = {k: match[1] for k, name in enumerate(table.names) if (match := BRACKETS.match(name))}
    kinds |= {k: kind for k, name in bare.items() if (kind := column_meaning(name)) == "mass"}
    named = [k for k, kind in kinds.items() if kind == "mass"]
    others = [k for k, kind in kinds.items() if kind in ("state", "")]
    return named or [k for k in others if _masses(table, k)] or [k for k in others if _weighs(table, k)]


def _masses(table: TableCells, k: int) -> dict[str, str]:
    """The mass that each text of a column says, itself or by a legend of the file; empty of other columns."""
    texts = [text for text in dict.fromkeys(table.texts(k)) if text]
    if masses := masses_in(texts):
        return masses
    if len(texts) > MAX_CODES or any(map(is_decimal, texts)):
        return {}
    meant = explained(texts, read_letters(table.path, None, ".")[0])
    masses = masses_in([*meant.values()])
    return {code: masses[text] for code, text in meant.items()} if masses else {}


def _weighs(table: TableCells, k: int) -> bool:
    """Whether a column has a unit of mass, and some of its cells say that nothing hangs."""
    unit = unit_of(table, k)
    if unit is None or unit.si != "kg":
        return False
    values = {number_of(text or "0") for text in table.texts(k)} - {None}
    return 0 in values and len(values) > 1


def by_states(table: TableCells) -> bool:
    """Tell whether rows are unloaded or loaded: by a column of states, or by loads of which some are zero.

    Args:
        table: The export, with what the log adds.

    Returns:
        Whether they are.
    """
    hung = {text for k in mass_columns(table)[:1] for text in table.texts(k)}
    idle = any(number_of(text or "0") == 0 or state_of(text) == "before" for text in hung)
    return idle or any(column_meaning(name) == "state" for name in table.names)


def refuse_twice(table: TableCells, columns: Sequence[int]) -> None:
    """Refuse columns of positions that have one name: nobody knows which of them is meant.

    Args:
        table: The export.
        columns: Places of the columns.

    Raises:
        InputError: If two of them have one name.
    """
    names = [table.names[k] for k in columns]
    if again := next((name for name in names if names.count(name) > 1), ""):
        hint = f'state in [columns] of a map which is which, as before_x = "{again}", after_x = "{again} (2)"'
        raise table.header_error(f"expected every name once, got {again!r} again; {hint}")


def loads_in_names(table: TableCells, arm: Arm) -> tuple[list[str], list[str]]:
    """Find columns of positions that differ in nothing but a load in their names.

    Args:
        table: The export.
        arm: The arm, with the names of its markers.

    Returns:
        Their names with the place of the load, such as "X {mass_kg} [mm]", and the loads.

    Raises:
        InputError: If two of them have one name.
    """
    place, loads = places(arm), set[str]()
    patterns, stated = dict[str, None](), list[int]()
    for k, name in enumerate(table.names):
        masses = [*MASS.finditer(name)]
        if len(masses) == 1 and place(MASS.sub(" ", name)):
            unit = masses[0]["unit"].casefold()[:2]
            patterns[MASS.sub(f"{{mass_{unit}}}", name)] = None
            loads.add(squeeze(masses[0][0]))
            stated.append(k)
    refuse_twice(table, stated)
    for pattern in patterns:
        before, after = (squeeze(part) for part in HOLE.sub("{", pattern).split("{"))
        for name in map(squeeze, table.names):
            word = name.removeprefix(before).removesuffix(after)
            if f"{before}{word}{after}" == name and STATE_OF_WORD.get(word) == "before":
                loads.add(word)
    return ([*patterns], sorted(loads)) if len(loads) > 1 else ([], [])
