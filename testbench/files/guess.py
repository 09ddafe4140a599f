"""Lines of a proposed map, and units that only values tell."""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from testbench.arm.document import is_decimal
from testbench.arm.folder import Arm
from testbench.arm.mjcf import GRAVITY
from testbench.errors import Array
from testbench.files.mapping import HOLE
from testbench.files.names import (
    BRACKETS,
    KNOWN_EXPORTS,
    LETTERS,
    MAX_CODES,
    NUMBER,
    STATE_OF_CELL,
    STATE_OF_WORD,
    STATE_WORDS,
    STATES,
    THOUSANDS,
    XYZ,
    Unit,
    column_meaning,
    explained,
    masses_in,
    number_of,
    places,
    plain,
    split_unit,
    squeeze,
    state_of,
)
from testbench.files.rearranged import DIRECTION, SIGNED_AXIS
from testbench.files.table import TableCells
from testbench.files.text import read_letters

# --- Lines of a proposed map, and units that only values tell ----------------------------------------------

GROUPED = re.compile(r"[+-]?\d{1,3}([.,' \u00a0\u202f]\d{3})+([.,]\d+)?")  #: A number of divided thousands.
SAME_LOAD = 0.01  #: Two columns that differ by at most so much state one load [1].
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
        Such as "'X2' is not read"; "" if there are none.
    """
    names = ", ".join(repr(table.names[k]) for k in columns)
    return names and f"{names} {'is' if len(columns) == 1 else 'are'} not read"


def guessed_unit(values: Array, stated: str, typical: float | None = None) -> tuple[str, str]:
    """Guess the unit of angles from their largest, degrees beyond TURNS, or of lengths from their median.

    Args:
        values: The numbers, of any shape.
        stated: Name of their unit; "" where the file states none.
        typical: What lengths are, to an order of magnitude [m]; None for angles.

    Returns:
        Name of the unit, and the reason; "" if the unit is stated.
    """
    if stated:
        return stated, ""
    sizes = np.abs(values)
    if typical is None:
        most = float(sizes.max(initial=0.0))
        return "deg" if most > TURNS else "rad", f"the largest angle is {most:.4g}"
    middle = (float(np.median(sizes)) if sizes.size else 1.0) or 1.0
    unit = min(LENGTHS, key=lambda unit: abs(np.log(middle * LENGTHS[unit] / typical)))
    return unit, f"a typical number is {middle:.4g}"


def numbers_of(table: TableCells, columns: Sequence[int]) -> Array:
    """Read the numbers of some columns, those that are none left out.

    Args:
        table: The export.
        columns: Places of the columns.

    Returns:
        The numbers, (k,).
    """
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


# --- What hangs in each row of an export: masses, weights or words, in cells or in the names of columns ----

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
    columns, agreed = _one_load(table, columns)
    k, *others = columns
    name, unit = table.names[k], unit_of(table, k)
    others = [] if agreed else others
    texts = [text for text in dict.fromkeys(table.texts(k)) if text]
    if unit and unit.si == "N":
        down = all(not text.startswith("-") for text in texts)
        yield Entry(
            "columns", "force_z", f"-{name}" if down else name, reasons("a weight: it acts downwards", agreed)
        )
        return
    _refuse_unclear_mass(table, name, texts)
    if masses := _masses(table, k):
        yield from _massive(name, masses, reasons(agreed, not_these(table, others)))
        return
    told = "" if column_meaning(name) == "mass" else "its unit is a unit of mass"
    why = reasons(told if unit else "no unit", agreed, not_these(table, others))
    yield Entry("columns", "mass" if unit else "mass_kg", name, why)
    words = (text for text in texts if not NUMBER.search(text))
    if none := [text for text in words if STATE_OF_CELL.get(squeeze(text)) == "before"]:
        yield Entry("words", "0", none)


def _only_states(table: TableCells, k: int) -> bool:
    """Whether a column of loads only says whether something hangs, such as "yes" and "no"."""
    texts = {squeeze(text) for text in table.texts(k) if text}
    return unit_of(table, k) is None and bool(texts) and texts <= {*STATE_OF_CELL}


def _one_load(table: TableCells, columns: Sequence[int]) -> tuple[list[int], str]:
    """Order columns of loads, masses first, and say that they agree; refuse those that state different loads.

    Those without a unit must have the same cells: they may be parts of a sum.
    """
    hint = f'say in [columns] of a map which one counts, as mass = "{table.names[columns[0]]}"'
    stated = {k: kg for k in columns if (kg := _kilograms(table, k)) is not None}
    if len(stated) < len(columns):
        if len({tuple(table.texts(k)) for k in columns}) > 1:
            names = " and ".join(repr(table.names[k]) for k in columns)
            raise table.header_error(f"expected one column of loads, got {names}; {hint}")
        return [*columns], ""
    first, *others = sorted(columns, key=lambda k: getattr(unit_of(table, k), "si", "") == "N")
    for k in others:
        for row in np.flatnonzero(~np.isclose(stated[first], stated[k], rtol=SAME_LOAD, atol=0))[:1]:
            both = " and ".join(
                f"{table.texts(own)[row]!r} in {table.names[own]!r} ({stated[own][row]:.4g} kg)"
                for own in (first, k)
            )
            raise table.error(row, "", f"expected the same load in both, got {both}; {hint}")
    agreed = "" if not others else f"{', '.join(repr(table.names[k]) for k in others)} agrees within 1 %"
    return [first, *others], agreed


def _kilograms(table: TableCells, k: int) -> Array | None:
    """The mass that a column states, (rows,) [kg]; None if it has no unit, or a cell that is no number."""
    unit, numbers = unit_of(table, k), [number_of(text or "0") for text in table.texts(k)]
    if unit is None or unit.si not in ("kg", "N") or None in numbers:
        return None
    kilograms = unit.scale / (GRAVITY if unit.si == "N" else 1.0)
    return np.asarray(kilograms * np.abs(np.array(numbers, dtype=float)))


def _refuse_unclear_mass(table: TableCells, name: str, texts: Sequence[str]) -> None:
    """Refuse masses that may be one or a thousand, and numbers in a unit that is none of masses."""
    if unclear := next(filter(THOUSANDS.search, texts), ""):
        problem = f"expected masses without a thousands separator, such as 1000 kg, got {unclear!r}"
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
    masses = masses_in(texts)
    if masses and len(texts) <= max(MAX_CODES, 2 * len({*masses.values()})):
        return masses  # more texts are names that hold a mass among others, such as p1_P1_0.1t
    if len(texts) > MAX_CODES or any(map(is_decimal, texts)):
        return {}
    meant = explained(texts, read_letters(table.path, None, ".")[0])
    masses = masses_in([*meant.values()])
    return {code: masses[text] for code, text in meant.items()} if masses else {}


def _weighs(table: TableCells, k: int) -> bool:
    """Whether a column has a unit of mass, and some of its cells say that nothing hangs.

    An acceleration may be in g, a field in T.
    """
    unit = unit_of(table, k)
    if unit is None or unit.si != "kg" or unit.name in LETTERS:
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


# --- Gauges, and distances to fixed points, in an export of other names than ours --------------------------

DIRECTED = "in world axes; the reading grows along it"


def line_entries(table: TableCells) -> Iterator[Entry]:
    """Guess the columns of gauges, or of distances to a fixed point, by their names.

    Args:
        table: The export, with what the log adds.

    Yields:
        Lines of the map; none unless a set of columns is whole.
    """
    names = {plain(name): name for name in table.names}
    letters = next((name for name in table.names if _of_directions(table, name)), "")
    for what, own in KNOWN_EXPORTS["lines"].items():
        where = "direction" if what == "travel" else "fixed"
        reading = re.compile(rf"(?:{own['reading']})?(?P<when>{STATE_WORDS})(?:{own['reading']})?")
        beside = re.compile(own["beside"])
        axes = {match["axis"]: name for text, name in names.items() if (match := beside.fullmatch(text))}
        directed = what == "travel" and (bool(letters) or {*axes} == {*XYZ})
        read = {
            STATE_OF_WORD[match["when"]]: name
            for text, name in names.items()
            if (match := reading.fullmatch(text)) and (directed or match["when"] != text)
            if column_meaning(name) not in ("mass", "state")
        }
        why = ""
        if what == "travel" and not read:
            alone = [name for text, name in names.items() if text and re.fullmatch(own["reading"], text)]
            when = "" if by_states(table) else "after"
            read = {when: alone[0]} if len(alone) == 1 else {}
            why = when and "the gauge reads zero without load"
        whole = {*read} == {*STATES} or (what == "travel" and len(read) == 1 and {*read} <= {"", "after"})
        if whole and ({*axes} == {*XYZ} or directed):
            keys = ("_".join(filter(None, (what, when))) for when in read)
            yield from (
                Entry("columns", key, name, why) for key, name in zip(keys, read.values(), strict=True)
            )
            if {*axes} == {*XYZ}:
                yield from (Entry("columns", f"{where}_{axis}", axes[axis]) for axis in XYZ)
            else:
                yield Entry("cells", letters, f"{{{DIRECTION}}}", DIRECTED)
            return


def _of_directions(table: TableCells, name: str) -> bool:
    """Whether a column holds axes of the world, such as -Z, that its name calls directions of gauges."""
    called = re.fullmatch(KNOWN_EXPORTS["lines"]["travel"]["letters"], plain(name))
    texts = {text for text in table.texts(table.names.index(name)) if text}
    return bool(called and texts) and all(map(SIGNED_AXIS.fullmatch, texts))


def gauges_in_names(table: TableCells, arm: Arm) -> list[str]:
    """Find columns of gauges whose names state a direction and perhaps a target, such as "Gauge P1 -Z [mm]".

    Args:
        table: The export.
        arm: The arm, with the names of its markers.

    Returns:
        Their names with places for these, such as "Gauge {marker} {direction} [mm]"; none if there are whole
        positions, or neither names nor rows tell that these are gauges.
    """
    place = places(arm)
    found = {*map(place, table.names)} - {None}
    if any(at and {at._replace(axis=axis) for axis in XYZ} <= found for at in found):
        return []
    markers = "|".join(map(re.escape, sorted(arm.markers, key=len, reverse=True)))
    part = re.compile(
        rf"(?<![^\W_])(?P<marker>{markers})(?![^\W_])"
        r"|(?<![^\s_(\[])(?P<direction>[+-]? ?[xyz] ?[+-]?)(?![^\s_)\]])",
        re.IGNORECASE,
    )
    reading = KNOWN_EXPORTS["lines"]["travel"]["reading"]
    wanted = re.compile(rf"(?:{reading})?(?P<when>{STATE_WORDS})?(?:{reading})?")
    patterns = dict[str, None]()
    for name in table.names:
        parts = [own.lastgroup for own in part.finditer(name)]
        rest = wanted.fullmatch(plain(part.sub(" ", name)))
        if "direction" in parts and len({*parts}) == len(parts) and rest and rest[0]:
            patterns[part.sub(lambda own: f"{{{own.lastgroup}}}", name)] = None
    return [*patterns]
