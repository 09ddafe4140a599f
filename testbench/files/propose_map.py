"""A map proposed for an export: by the layout that fits it, else by the names of its columns.

What only values tell is a guess: the map has it as a comment, and `testbench data map` says it.
"""

import contextlib
import json
import os
import re
import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise, product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from testbench.arm.document import is_decimal
from testbench.arm.folder import Arm
from testbench.data.dataset import Series
from testbench.errors import Array, InputError, Mask
from testbench.files.beside import (
    MIN_POSES,
    NOTATIONS,
    OrientationFit,
    UnclearNotation,
    clear_fit,
    fits_of,
    unclear,
)
from testbench.files.columns import listed
from testbench.files.layouts import Fitting, Ordered, fitting, numbered, stated_length_unit
from testbench.files.mapping import LOAD, FileLayout, Log, Map, Named, read_map, without_load
from testbench.files.names import (
    BRACKETS,
    DEFLECTION,
    KNOWN_EXPORTS,
    MAX_CODES,
    NUMBER,
    ROTATIONS,
    SI,
    STATE_OF_CELL,
    STATE_OF_WORD,
    STATES,
    THOUSANDS,
    XYZ,
    Place,
    Unit,
    column_meaning,
    explained,
    find_unit,
    joint_family,
    joints_of,
    looks_like,
    masses_in,
    places,
    plain,
    series_names,
    split_unit,
    squeeze,
    state_of,
)
from testbench.files.read_series import read_series
from testbench.files.rearranged import (
    DIRECTION,
    NUMBERS,
    SIGNED_AXIS,
    clock,
    join_log,
    keys_of,
    nearest_times,
    numbers_in,
    parts_in,
    read_log,
    stack_loads,
    times_of,
    with_loaded,
)
from testbench.files.table import SECTION, SHEETS, TableCells
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

# --- Guess what columns of an unknown export mean, by their names and cells, each guess with its reason -----

WORD = re.compile(r"\d+[.,]\d+|[^\W_]+")  #: Of a name such as P12_T1-loaded.
GROUPED = re.compile(r"[+-]?\d{1,3}([.,' \u00a0\u202f]\d{3})+([.,]\d+)?")  #: A number of divided thousands.
SHOTS, TARGETS = 20, 12  #: Most shots of a point, most targets of a file.
APART_TARGETS = 0.01  #: Least distance of two targets, over the typical size of a coordinate.
AXES = re.compile(r"[(\[]?\bx *[/,; |] *y *[/,; |] *z\b[)\]]?", re.IGNORECASE)  #: Of a cell, as "P1 (x/y/z)".
POSED = re.compile("tcp|cart|pose|xyz|koord|coord|frame")  #: Names of cells that hold a pose of the tool.
APART = {"mass", "axis", "pose", "marker", "state"}  #: Quantities that tell rows of one name apart.
WEIGHED = re.compile(r"(?P<number>\d+(?:[.,]\d+)?)\s*(?P<unit>kg|lbs?)?", re.IGNORECASE)  #: Such as 150 kg.
UNREADABLE = (
    (
        re.compile("(d|delta|δ|defl(ection)?|disp(lacement)?|verschiebung|auslenkung)[xyz]"),
        "of deflections alone the targets' places are not known: add the unloaded positions, as before_x_mm",
    ),
    (
        re.compile(
            r".*(gauge|dial|indicator|messuhr|comparateur|reloj|comparatore|lvdt|千分表|百分表).*"
            r"|direction[xyz]|reading|travel"
        ),
        "a gauge's readings are travel_before_mm and travel_after_mm, with direction_x, direction_y and "
        "direction_z of the face; the map's [scale] converts volts or counts to mm "
        "(docs/formats.md, Gauges and distances)",
    ),
    (
        re.compile(".*(wire|ballbar).*|(fixed|anchor|outlet|ball)[xyz]"),
        "distances to a fixed point are distance_before_mm and distance_after_mm, with fixed_x_mm, "
        "fixed_y_mm and fixed_z_mm; the map's [scale] converts counts to mm "
        "(docs/formats.md, Gauges and distances)",
    ),
)
"""Names of columns that hold no positions, and what to do."""
TURNS = 7.0  #: Joint coordinates beyond are degrees [rad].
SCATTER = {f"{what}_{x}": f"sigma_{x}" for what in ("sigma", "u95") for x in XYZ}
LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
TYPICAL = {"sigma": 3e-5, "": 1.0}
"""What readings scatter by, and positions are, to an order of magnitude [m]."""


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


def columns_by_name(table: TableCells, arm: Arm, length: str, said: Collection[str]) -> Iterator[Entry]:
    """Guess the columns of joints, positions, scatter, mass and temperature by their names, with their units.

    Args:
        table: The export, with what the log adds.
        arm: The arm.
        length: Unit of lengths that the lines above the header state; "" where they state none.
        said: Quantities that a layout states; they are not guessed.

    Yields:
        Lines of the map, with the reason of each guess.

    Raises:
        InputError: When no column looks like joints or positions.
    """
    known = dict[str, list[int]]()
    for k, name in enumerate(table.names):
        known.setdefault(column_meaning(name), []).append(k)
    if "joint" not in said:
        yield from _joints(table, arm)
    readings, stated = dict[str, list[int]](), ""
    if "reading" not in said:
        readings, markers, stated = _positions(table, arm)
        if not readings and "axis" in known:
            of_axes = {"position": known["position"]} if "position" in known else _states_by_axis(table)
            readings = {"axis": known["axis"]} | of_axes if of_axes else {}
        lines = [] if readings else list(_lines(table))
        yield from lines or (markers if readings else _position_cells(table, arm, length))
        _refuse_twice(table, [k for columns in readings.values() for k in columns])
    yield from _mass(table, mass_columns(table) if "mass" not in said else [])
    others = SCATTER | {"temperature": "temperature"}
    kinds = dict.fromkeys(SCATTER, "deviation")
    others = {theirs: our for theirs, our in others.items() if kinds.get(theirs, theirs) not in said}
    for our, columns, kind in (
        *((our, columns, our if our == "axis" else "") for our, columns in readings.items()),
        *((our, known[theirs], theirs) for theirs, our in others.items() if theirs in known),
    ):
        alike = [own[0] for own in readings.values()] if our in readings else columns[:1]
        unit, why = length_unit(table, columns[0], alike, kind, length)
        left = ", ".join(repr(table.names[k]) for k in columns[1:])
        told = stated if our in readings else ""
        why = "; ".join(filter(None, [told, why, left and f"not {left}"]))
        yield Entry("columns", our + unit, table.names[columns[0]], why)
        if kind.startswith("u95"):
            yield Entry("scale", our + unit, 0.5, "two standard deviations, as U95")
    yield from lost_words(table, [k for our, (k, *_) in readings.items() if our != "axis"])


def _states_by_axis(table: TableCells) -> dict[str, list[int]]:
    """Columns of readings unloaded and loaded, whose axis another column says; none unless both are there."""
    found = {state: k for k, name in enumerate(table.names) if (state := STATE_OF_WORD.get(plain(name), ""))}
    return {state: [k] for state, k in found.items()} if len(found) == len(STATES) else {}


def _lines(table: TableCells) -> Iterator[Entry]:
    """The columns of gauges, or of distances to a fixed point, by their names; none unless a set is whole."""
    names = {plain(name): name for name in table.names}
    letters = next((name for name in table.names if _of_directions(table, name)), "")
    for what, own in KNOWN_EXPORTS["lines"].items():
        where = "direction" if what == "travel" else "fixed"
        states = "|".join(map(re.escape, sorted(STATE_OF_WORD, key=len, reverse=True)))
        reading = re.compile(rf"(?:{own['reading']})?(?P<when>{states})(?:{own['reading']})?")
        bare = what == "travel" and letters
        read = {
            STATE_OF_WORD[match["when"]]: name
            for text, name in names.items()
            if (match := reading.fullmatch(text)) and (bare or match["when"] != text)
            if column_meaning(name) != "mass"
        }
        why = ""
        if what == "travel" and not read and not _by_states(table):
            alone = [name for text, name in names.items() if text and re.fullmatch(own["reading"], text)]
            read, why = {"after": alone[0]} if len(alone) == 1 else {}, "the gauge is at zero unloaded"
        beside = re.compile(own["beside"])
        axes = {match["axis"]: name for text, name in names.items() if (match := beside.fullmatch(text))}
        if ({*read} == {*STATES} or (why and read)) and ({*axes} == {*XYZ} or bare):
            yield from (Entry("columns", f"{what}_{when}", name, why) for when, name in read.items())
            if {*axes} == {*XYZ}:
                yield from (Entry("columns", f"{where}_{axis}", axes[axis]) for axis in XYZ)
            else:
                said = "world axes, along which readings grow"
                yield Entry("cells", letters, f"{{{DIRECTION}}}", said)
            return


def _by_states(table: TableCells) -> bool:
    """Whether rows are unloaded or loaded: by a column of states, or by loads of which some are zero."""
    hung = [str(text).replace(",", ".") for k in mass_columns(table)[:1] for text in table.texts(k)]
    idle = any(
        not text or (is_decimal(text) and float(text) == 0) or state_of(text) == "before" for text in hung
    )
    return idle or any(column_meaning(name) == "state" for name in table.names)


def _of_directions(table: TableCells, name: str) -> bool:
    """Whether a column holds axes of the world, such as -Z, that its name calls directions of gauges."""
    called = re.fullmatch(KNOWN_EXPORTS["lines"]["travel"]["letters"], plain(name))
    texts = {text for text in table.texts(table.names.index(name)) if text}
    return bool(called and texts) and all(map(SIGNED_AXIS.fullmatch, texts))


def _refuse_twice(table: TableCells, columns: Sequence[int]) -> None:
    """Refuse columns of positions that have one name: nobody knows which of them is meant."""
    names = [table.names[k] for k in columns]
    if again := next((name for name in names if names.count(name) > 1), ""):
        hint = f'say in [columns] of a map which is which, as before_x = "{again}", after_x = "{again} (2)"'
        raise table.header_error(f"expected every name once, got {again!r} again; {hint}")


def _mass(table: TableCells, columns: Sequence[int]) -> Iterator[Entry]:
    """The column of what hangs: masses, weights in newtons, or words such as "150 kg" and "none"."""
    for k, *others in [columns] if columns else []:
        name, unit = table.names[k], unit_of(table, k)
        texts = [text for text in dict.fromkeys(table.texts(k)) if text]
        if unit is None and texts and {*map(squeeze, texts)} <= {*STATE_OF_CELL}:
            return  # a column of states
        left = ", ".join(repr(table.names[other]) for other in others)
        if unit and unit.si == "N":
            down = all(not text.startswith("-") for text in texts)
            yield Entry("columns", "force_z", f"-{name}" if down else name, "a weight, downwards")
            return
        _refuse_unclear_mass(table, name, texts)
        if masses := _masses(table, k):
            yield from _massive(name, masses, left)
            return
        weighed = {text: own for text in texts if (own := WEIGHED.fullmatch(text)) and not is_decimal(text)}
        units = {own["unit"].casefold()[:2] for own in weighed.values() if own["unit"]}
        said = "" if unit else f"_{min(units, default='kg')}"
        if len({*units, *([unit.name] if unit and units else [])}) > 1:
            raise table.header_error(f"expected masses in one unit, got {' and '.join(sorted(units))}", name)
        told = "" if column_meaning(name) == "mass" else "its unit is of a mass"
        why = "; ".join(filter(None, [told if unit else "no unit", left and f"not {left}"]))
        yield Entry("columns", f"mass{said}", name, why)
        for text, own in weighed.items():
            if own["unit"]:
                yield Entry("words", own["number"].replace(",", "."), text)
        words = (text for text in texts if not NUMBER.search(text))
        if none := [text for text in words if STATE_OF_CELL.get(squeeze(text)) == "before"]:
            yield Entry("words", "0", none)


def _refuse_unclear_mass(table: TableCells, name: str, texts: Sequence[str]) -> None:
    """Refuse masses that may be one or a thousand, and numbers in a unit that is none of masses."""
    if unclear := next(filter(THOUSANDS.search, texts), ""):
        problem = f"expected masses without a mark between thousands, as 1000 kg, got {unclear!r}"
        raise table.header_error(problem, name)
    numbers = all(is_decimal(text.replace(",", ".")) for text in texts)
    if numbers and (other := BRACKETS.match(name)) and unit_of(table, table.names.index(name)) is None:
        raise table.header_error(f"expected a unit of mass or force, got {other[2]!r}", name)


def _massive(name: str, masses: Mapping[str, str], left: str) -> Iterator[Entry]:
    """The column whose texts say masses, and the number of each."""
    numbers = {text: mass.partition(" ")[0] for text, mass in masses.items()}
    unit = max(mass.partition(" ")[2] for mass in masses.values())
    yield Entry("columns", f"mass_{unit}", name, left and f"not {left}")
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
    texts = [str(text).replace(",", ".") for text in table.texts(k)]
    values = {float(text or 0) for text in texts if is_decimal(text) or not text}
    return 0 in values and len(values) > 1


def orientation_columns(table: TableCells) -> Iterator[list[Entry]]:
    """List what columns of orientations may be: three angles, or four parts of a quaternion.

    Args:
        table: The export, with what the log adds.

    Yields:
        Lines of the map, one alternative after the other: units and orders that the names leave open.
    """
    names = {plain(name): k for k, name in reversed(list(enumerate(table.names)))}
    for parts, pattern in KNOWN_EXPORTS["orientations"].items():
        found = _whole_set(names, re.compile(pattern), parts)
        if found and len(parts) == len(XYZ):
            yield from _three_angles(table, found, XYZ)
            return
        if found:
            both = zip(parts, found, strict=True)
            yield [Entry("columns", f"quaternion_{part}", table.names[k]) for part, k in both]
            return
    for words in KNOWN_EXPORTS["together"]["orientations"]:
        columns = [names[word] for word in words.split() if word in names]
        if len(columns) == len(words.split()) == len(XYZ):
            yield from _three_angles(table, sorted(columns), "123")
            return
        if len(columns) == len(words.split()):
            orders = ["wxyz"] if words == "w i j k" else ["wxyz", "xyzw"]
            for order in orders:
                both = zip(order, columns, strict=True)
                yield [Entry("columns", f"quaternion_{part}", table.names[k]) for part, k in both]
            return


def _whole_set(names: Mapping[str, int], pattern: re.Pattern[str], parts: str) -> list[int]:
    """Columns of names that are alike but for a part, one for each part; none where no set is whole."""
    sets = dict[str, dict[str, int]]()
    for name, k in names.items():
        if match := pattern.fullmatch(name):
            rest = f"{name[: match.start('part')]}#{name[match.end('part') :]}"
            sets.setdefault(rest, {})[match["part"]] = k
    whole = [[own[part] for part in parts] for own in sets.values() if {*own} == {*parts}]
    return min(whole, default=[])


def _three_angles(table: TableCells, columns: Sequence[int], parts: Sequence[str]) -> Iterator[list[Entry]]:
    """Three columns of angles, in degrees or radians where their names do not say it."""
    units = ["", ""] if unit_of(table, columns[0]) else ["_deg", "_rad"]
    for unit in dict.fromkeys(units):
        both = zip(parts, columns, strict=True)
        yield [Entry("columns", f"rotation_{part}{unit}", table.names[k]) for part, k in both]


def lost_words(table: TableCells, columns: Sequence[int]) -> list[Entry]:
    """Find the words that columns of positions have for lost targets: cells that are no numbers.

    Args:
        table: The export.
        columns: Places of the columns of positions.

    Returns:
        One line of the map that lists the words; empty if there are none.
    """
    texts = {text for k in columns for text in table.texts(k)}
    words = sorted(text for text in texts if text and not is_decimal(text.replace(",", ".")))
    words = [text for text in words if not GROUPED.fullmatch(text) and not NUMBER.search(text)]
    return [Entry("words", "lost", words, "no numbers")] if words else []


def _joints(table: TableCells, arm: Arm) -> Iterator[Entry]:
    """The columns of joints by their names."""
    if joints := joint_family(table.names, arm):
        unit, why = angle_unit(table, joints)
        for joint, k in zip(arm.file_joints, joints, strict=True):
            own = ("_m" if joint.prismatic else unit) * (unit_of(table, k) is None)
            yield Entry("columns", joint.name + own, table.names[k], why * bool(own))
    elif arm.file_joints:
        yield _joint_cells(table, arm)


def _unlike(table: TableCells, what: str) -> InputError:
    if what != "a position":
        hint = 'name all of them in [columns] of a map, as "joint_{n}_deg" = "A{n}"; '
        hint += f"one that never moves goes into [values], as {what}_deg = 0"
        return table.header_error(f"no column looks like {what}; columns are {listed(table.names)}; {hint}")
    hint = 'name it in [columns] of a map, as x = "X", or before_x and after_x of pairs'
    hint = f'{hint}, or "{{marker}}_{{when}}_{{axis}}" = "{{marker}} {{when}} {{axis}}" with its words'
    for pattern, words in UNREADABLE:
        if any(pattern.fullmatch(plain(name)) for name in table.names):
            hint = words
    return table.header_error(f"no column looks like {what}; columns are {listed(table.names)}; {hint}")


def _positions(table: TableCells, arm: Arm) -> tuple[dict[str, list[int]], list[Entry], str]:
    """The columns of positions by our names for them, what the map says of their targets, and why.

    Names that say a state come before those that do not, names of several targets before those of none.
    """
    place, found, why = places(arm), dict[Place, list[int]](), ""
    for k, name in enumerate(table.names):
        if at := place(name):
            found.setdefault(at, []).append(k)
    names, said = {plain(marker): marker for marker in arm.markers} | {"": ""}, list[Entry]()
    if (hung := _one_load(table, arm)) and not mass_columns(table):
        loaded = {
            at: [k]
            for k, name in enumerate(table.names)
            if (at := place(MASS.sub(" ", name))) and MASS.search(name)
        }
        both = {at: found[at] for at in loaded if at in found}
        found = {at._replace(when="before"): own for at, own in both.items()}
        found |= {at._replace(when="after"): loaded[at] for at in both}
        why, said = (
            f"{hung[0]} {hung[1]} in the names of some columns alone",
            [Entry("values", f"mass_{hung[1]}", hung[0])],
        )
    if {at.target for at in found if not at.when} & {"0"} and (counted := _counted_states(table, arm, found)):
        found, why = counted, "0 and 1, or 0 and d, are unloaded and loaded: another column has the targets"
    whole = [p for p in found if p.axis == "x" and all(p._replace(axis=axis) in found for axis in XYZ)]
    whole = [p for p in whole if p.when] or whole
    targets = list(dict.fromkeys(p.target for p in whole if p.target))
    bare = any(not p.target for p in whole)
    if bare and len(targets) < 2:
        targets = [""]
    elif bare:
        whole = [p for p in whole if p.target]
    if not {*targets} <= {*names}:
        own = sorted(targets, key=lambda target: int(NUMBER.findall(target)[-1]))
        markers = [f"M{target}" if target.isdecimal() else target.upper() for target in own]
        because = "no markers of the arm"
        if len(own) == len(arm.markers):
            markers, because = list(arm.markers), "targets are numbered as the markers of the arm"
        names = dict(zip(own, markers, strict=True))
        said.append(Entry("series", "markers", markers, because))
    kept = [p._replace(axis=axis) for p in whole if p.target in targets for axis in XYZ]
    return {p.ours(names): found[p] for p in kept}, said, why


def _one_load(table: TableCells, arm: Arm) -> tuple[float, str] | None:
    """The load that some names of positions state while others state none, with its unit; else None."""
    place = places(arm)
    masses = {
        (float(own["number"].replace(",", ".")), own["unit"].casefold()[:2])
        for name in table.names
        if (own := MASS.search(name)) and place(MASS.sub(" ", name))
    }
    return masses.pop() if len(masses) == 1 else None


def _counted_states(table: TableCells, arm: Arm, found: Mapping[Place, list[int]]) -> dict[Place, list[int]]:
    """Columns X0 and X1, or X0 and dX, as states, where another column says the targets; else none."""
    markers = {*map(squeeze, arm.markers)}
    texts = ({*map(squeeze, table.texts(k))} for k in range(len(table.names)))
    if len(markers) > 1 and not any(len(own) > 1 and own <= markers for own in texts):
        return {}
    own = {at: columns for at, columns in found.items() if at.target in ("0", "1") and not at.when}
    if {at.target for at in own} == {"0"}:
        names = {plain(name): k for k, name in enumerate(table.names)}
        moved = {axis: names.get(f"d{axis}", names.get(f"delta{axis}")) for axis in XYZ}
        own |= {Place("", DEFLECTION, axis): [k] for axis, k in moved.items() if k is not None}
    states = {"0": "before", "1": "after", "": DEFLECTION}
    named = {at._replace(target="", when=states[at.target]): columns for at, columns in own.items()}
    return named if len(named) == 2 * len(XYZ) else {}


def _joint_cells(table: TableCells, arm: Arm) -> Entry:
    """The column that holds all joints in one cell; InputError where none does."""
    for k in sorted(range(len(table.names)), key=lambda k: not looks_like(table.names[k], "joints")):
        values = _cells_of(table, k, len(arm.file_joints))
        if len(values) and not POSED.search(plain(table.names[k])):
            said, (guessed, why) = unit_of(table, k), _angle(values)
            unit = said.name if said else guessed
            slides = "_m" * any(joint.prismatic for joint in arm.file_joints)
            return Entry("cells", table.names[k], f"{{joints_{unit}{slides}}}", "" if said else why)
    raise _unlike(table, arm.file_joints[0].name)


def _position_cells(table: TableCells, arm: Arm, length: str) -> Iterator[Entry]:
    """The columns that hold x, y, z in one cell, of one target or of several; InputError where none does."""
    place, found = places(arm), dict[Place, Entry]()
    markers = {plain(marker): marker for marker in arm.markers}
    for k, name in enumerate(table.names):
        if looks_like(name, "joints") or not len(values := _cells_of(table, k, len(XYZ))):
            continue
        said, (guessed, why) = unit_of(table, k), _length(values, "", length)
        bare = AXES.sub(" ", (split_unit(name) or (name,))[0])
        at = place(f"{bare} x") or Place("", "", "x")
        whose = "_".join(
            filter(None, (markers.get(at.target, ""), at.when, f"position_{said.name if said else guessed}"))
        )
        found.setdefault(at, Entry("cells", name, f"{{{whose}}}", "" if said else why))
    if not found:
        raise _unlike(table, "a position")
    several = [own for at, own in found.items() if at.target in markers or at.when]
    yield from several or [*found.values()][:1]


def _cells_of(table: TableCells, k: int, count: int) -> Array:
    """Numbers of a column's cells, (cells, count), if they are neither all the same nor dates or times."""
    texts = [text for text in dict.fromkeys(table.texts(k)) if text]
    same = table.rows > 1 and len(texts) == 1
    found = None if same or clock(texts) is not None else numbers_in(texts, count)
    return np.array([[float(x.replace(",", ".")) for x in own] for own in found or []])


def angle_unit(table: TableCells, joints: Sequence[int]) -> tuple[str, str]:
    """Guess the unit of joints from their values: degrees if one exceeds TURNS, else radians.

    Args:
        table: The export.
        joints: Places of the joints' columns.

    Returns:
        Suffix of the map's key, "_deg" or "_rad", and the reason.
    """
    unit, why = _angle(_sizes(table, joints))
    return f"_{unit}", why


def _angle(values: Array) -> tuple[str, str]:
    most = float(np.abs(values).max(initial=0.0))
    return "deg" if most > TURNS else "rad", f"joints up to {most:.4g}"


def _length(values: Array, kind: str, length: str) -> tuple[str, str]:
    if length and kind not in SCATTER:
        return length, ""
    middle = float(np.median(np.abs(values))) if np.size(values) else 1.0
    middle, typical = middle or 1.0, TYPICAL["sigma" if kind in SCATTER else ""]
    unit = min(LENGTHS, key=lambda unit: abs(np.log(middle * LENGTHS[unit] / typical)))
    return unit, f"numbers around {middle:.4g}"


def _sizes(table: TableCells, columns: Sequence[int]) -> Array:
    """The numbers of some columns, those that are none left out."""
    texts = (text.replace(",", ".") for k in columns for text in table.texts(k))
    return np.array([float(text) for text in texts if is_decimal(text)])


def length_unit(table: TableCells, k: int, alike: Sequence[int], kind: str, length: str) -> tuple[str, str]:
    """Guess the unit of a column from the values of columns like it, where the header states none.

    Args:
        table: The export.
        k: Place of the column.
        alike: Places of the columns whose values are compared with a typical size.
        kind: Quantity of the column, such as "mass" or "sigma_x"; "" for a position.
        length: Unit of lengths that the lines above the header state; "" where they state none.

    Returns:
        Suffix of the map's key, such as "_mm", and the reason; both "" where no suffix is needed.
    """
    if unit_of(table, k) or kind in ("axis", "temperature"):
        return "", ""
    if kind == "mass":
        return "_kg", "no unit"
    unit, why = _length(_sizes(table, alike), kind, length)
    return f"_{unit}", why


def names_by_cells(table: TableCells, arm: Arm, said: Mapping[str, str]) -> Iterator[Entry]:
    """Guess from their cells what columns of names hold: poses, targets, states, loads or shots.

    Args:
        table: The export.
        arm: The arm, with the names of its markers.
        said: Quantity of each column that a layout states, by the column's name.

    Yields:
        Lines of the map, with the reason of each guess.
    """
    kinds = {name: column_meaning(name) for name in table.names}
    names = [name for name, kind in kinds.items() if kind in ("name", "state") and name not in said]
    others = [
        name for name, kind in kinds.items() if kind == "mass" or STATE_OF_WORD.get(plain(name)) == "after"
    ]
    names += [name for name in others if name not in names and _of_states(table, name)]
    names += _told_by_cells(table, arm, [name for name, kind in kinds.items() if not kind], names)
    weighed = [] if "mass" in {*kinds.values(), *said.values()} else mass_columns(table)
    massive = [table.names[k] for k in weighed[:1]]
    names = [name for name in names if name not in massive]
    apart = [name for name, kind in kinds.items() if {kind, said.get(name)} & APART and name not in names]
    every = keys_of(table, [*names, *apart])
    again = 1 + sum(a != b for a, b in pairwise(every)) == len({*every}) < len(every) / 1.5
    shots = "names stand several times in a row: shots" if names and again else ""
    lined = any(_lines(table))
    told, parted, own = _told(table, arm, said), list[str](), {"pose", "marker"} & {*said.values()}
    for name in names:
        texts = keys_of(table, [name])
        distinct = list(dict.fromkeys(texts))
        if _of_states(table, name):
            yield Entry("columns", "state", name)
            yield from _states(distinct)
        elif len(distinct) > 1 and _parts_of(texts, arm, told, own):
            parted.append(name)
        elif column_meaning(name) == "state":
            continue  # in words that nobody knows
        elif told.targets(texts) or (lined and {*map(squeeze, distinct)} <= {*map(squeeze, arm.markers)}):
            yield Entry("columns", "marker", name)
            yield from _targets(distinct, arm)
            own.add("marker")
        elif len(distinct) > 1 and "pose" not in own:
            _refuse_unknown_words(table, name, texts, arm)
            own.add("pose")
            yield Entry("columns", "pose", name)
    yield from _sections(table, arm, massive)
    for name in parted:  # beside columns that hold nothing else
        texts = keys_of(table, [name])
        if parts := _parts_of(texts, arm, told, own):
            yield Entry("cells", name, parts.pattern, f"of {texts[0]!r}")
            shots = "the last number of a name counts shots" if parts.shots else shots
            yield from _words_of_parts(parts, texts, arm)
            own |= {part for part in ("pose", "marker") if f"{{{part}}}" in parts.pattern}
    if shots:
        yield Entry("file", "average", True, shots)


def _words_of_parts(parts: "_Parts", texts: Sequence[str], arm: Arm) -> Iterator[Entry]:
    """What the words in names of several parts mean: masses, else states; and targets."""
    words = [word for text in dict.fromkeys(texts) for word in WORD.findall(text)]
    masses = masses_in(parts.loads)
    yield from (Entry("words", mass.partition(" ")[0], word) for word, mass in masses.items())
    if not masses:
        yield from _states([word for word in words if squeeze(word) in STATE_OF_WORD])
    yield from _targets(parts.targets, arm)


def _told_by_cells(
    table: TableCells, arm: Arm, unknown: Sequence[str], names: Sequence[str]
) -> Iterator[str]:
    """Columns that hold the arm's markers, or states, whatever they are called; where none is called so."""
    markers = {*map(squeeze, arm.markers)}

    def of_markers(name: str) -> bool:
        return {*map(squeeze, keys_of(table, [name]))} <= markers

    def of_states(name: str) -> set[str]:
        words = {squeeze(text).strip("0123456789") for text in keys_of(table, [name])}
        return {STATE_OF_WORD.get(word, "") for word in words}

    if not any(map(of_markers, names)):
        yield from [name for name in unknown if of_markers(name)][:1]
    if not any(_of_states(table, name) for name in names):
        both = [name for name in unknown if of_states(name) == {*STATES}]
        yield from [name for name in both if _of_states(table, name)][:1]


def _of_states(table: TableCells, name: str) -> bool:
    """Whether every cell of a column is a word for a state, one word for all loaded readings.

    "Loaded 1" and "Loaded 2" are two loads; of "under load" and "after", one may be unloaded again.
    """
    texts = {*keys_of(table, [name])}
    if column_meaning(name) == "name" and not {*map(squeeze, texts)} <= {*STATE_OF_CELL} - {"0", "1"}:
        return False
    states = [state_of(text) for text in {*map(squeeze, texts)}]
    steps = {tuple(NUMBER.findall(text)) for text in texts}
    alike = "" not in states and (states.count("after") == 1 or ({*states} == {"before"} and len(steps) == 1))
    return alike and unit_of(table, table.names.index(name)) is None


@dataclass(frozen=True)
class _Told:
    """Hold what tells names of poses, targets and shots from one another."""

    joints: Sequence[str]  #: Text of the joints in every row; equal in all rows if nobody knows the columns.
    position: Array  #: Positions over their typical size, (rows, 3) [1]; NaN where nobody knows them.

    def poses(self, texts: Sequence[str]) -> bool:
        """Tell whether each of some names, one per row, has joints of its own."""
        both = {*zip(texts, self.joints, strict=True)}
        return len({*self.joints}) > 1 and len(both) == len({*texts})

    def targets(self, texts: Sequence[str]) -> bool:
        """Tell whether some names, one per row, are those of targets: they come again, or in one pose."""
        count, changes = len({*texts}), 1 + sum(a != b for a, b in pairwise(texts))
        if not 1 < count <= TARGETS or self.poses(texts):
            return False
        return count < changes or (self.joints[0] != "" and self.apart([""] * len(texts)))

    def apart(self, others: Sequence[object]) -> bool:
        """Tell whether positions are far apart in rows that others call the same."""
        rows = dict[object, list[int]]()
        for row, own in enumerate(zip(others, self.joints, strict=True)):
            rows.setdefault(own, []).append(row)
        spread = [np.ptp(self.position[own], axis=0).max() for own in rows.values() if len(own) > 1]
        return bool(spread) and float(np.median(spread)) > APART_TARGETS


def _told(table: TableCells, arm: Arm, said: Mapping[str, str]) -> _Told:
    """Read joints and positions of every row, as far as names tell their columns."""
    joints = [name for name in table.names if said.get(name) == "joint"]
    joints = joints or [table.names[k] for k in joint_family(table.names, arm)]
    joints = joints or [name for name in table.names if looks_like(name, "joints")]
    read = [k for k, name in enumerate(table.names) if said.get(name) == "reading"]
    columns = read[: len(XYZ)] or [k for k, *_ in _positions(table, arm)[0].values()][: len(XYZ)]
    position = np.full((table.rows, len(XYZ)), np.nan)
    for axis, k in enumerate(columns):
        texts = [text.replace(",", ".") for text in table.texts(k)]
        position[:, axis] = [float(text) if is_decimal(text) else np.nan for text in texts]
    size = np.nanmedian(np.abs(position)) if np.isfinite(position).any() else 1.0
    return _Told(keys_of(table, joints) if joints else [""] * table.rows, position / (size or 1.0))


def _targets(own: Sequence[str], arm: Arm) -> Iterator[Entry]:
    """Say whose names those of targets are: the arm's markers by their numbers, else targets of their own."""
    own = [text for text in own if text]
    numbers = [NUMBER.findall(text)[-1:] for text in own]
    if {*map(squeeze, own)} <= {*map(squeeze, arm.markers)}:
        return
    if len(own) == len(arm.markers) == len({int(n[0]) for n in numbers if n}):
        order = sorted(own, key=lambda text: int(NUMBER.findall(text)[-1]))
        why = "targets are numbered as the markers of the arm"
        both = zip(arm.markers, order, strict=True)
        yield from (Entry("words", marker, text, why) for marker, text in both)
    else:
        yield Entry("series", "markers", list(own), "no markers of the arm")


def _sections(table: TableCells, arm: Arm, massive: Collection[str]) -> Iterator[Entry]:
    """What lines of words say of the rows below them, or names of sheets of their rows: states or targets."""
    for name in {*table.names[-1:]} - {*massive}:
        texts = list(dict.fromkeys(table.texts(len(table.names) - 1)))
        if name in (SECTION, SHEETS) and all(map(state_of, texts)):
            yield Entry("columns", "state", name)
            yield from _states(texts)
        elif name == SECTION and _marked(texts, arm):
            yield Entry("columns", "marker", name)
            both = zip(texts, parts_in(texts, arm.markers), strict=True)
            yield from (Entry("words", arm.markers[k], text) for text, k in both)
        elif name == SHEETS:
            yield Entry("columns", "marker", name)
            yield from _targets(texts, arm)


def _states(words: Sequence[str]) -> Iterator[Entry]:
    for state in ("before", "after"):
        if own := sorted({word for word in words if state_of(word) == state}):
            yield Entry("words", state, own)


def _refuse_unknown_words(table: TableCells, name: str, texts: Sequence[str], arm: Arm) -> None:
    """Refuse names of several parts that differ in nothing but a word that nobody knows, as P1_U and P1_L."""
    rows = [WORD.findall(text) for text in texts]
    columns = list(zip(*rows, strict=True)) if {*map(len, rows)} - {1} and len({*map(len, rows)}) == 1 else []
    unknown = list[list[str]]()
    for k, words in enumerate(columns):
        kinds = list(dict.fromkeys(words))
        others = list(zip(*columns[:k], *columns[k + 1 :], strict=True)) or [()] * len(texts)
        again = len({*others}) < len({*zip(words, others, strict=True)})
        known = {*map(squeeze, kinds)} <= {*map(squeeze, arm.markers)} or any(map(is_decimal, kinds))
        if again and not known and 1 < len(kinds) <= SHOTS:
            unknown.append(kinds)
    if unknown:
        few = " and ".join(map(repr, min(unknown, key=len)[:3]))
        hint = f'say it in a map, as [cells] {json.dumps(name)} = "{{pose}}_{{when}}", [words] before = "..."'
        raise table.header_error(f"nobody knows what {few} mean in names as {texts[0]!r}; {hint}", name)


class _Parts(NamedTuple):
    """Describe names of several parts."""

    pattern: str  #: Such as "P{pose}_{marker}_*".
    targets: list[str]  #: Names of the targets in them, each once.
    loads: list[str]  #: Words in them that say a mass, each once.
    shots: bool  #: Whether a part counts shots.


def _parts_of(texts: Sequence[str], arm: Arm, told: _Told, own: Collection[str]) -> _Parts | None:
    """Find what names of several parts hold; None where fewer than two parts differ.

    Args:
        texts: The names, one per row.
        arm: The arm, with the names of its markers.
        told: Joints and positions of the rows.
        own: Quantities, of pose and marker, that other columns say.
    """
    between, rows = {tuple(WORD.split(text)) for text in texts}, [WORD.findall(text) for text in texts]
    if len(between) > 1:
        return None
    columns, parts, shots = list(zip(*rows, strict=True)), list[str](), False
    targets, loads = list[str](), list[str]()
    for k, words in enumerate(columns):
        kinds, after = {*map(squeeze, words)}, squeeze(columns[k + 1][0]) if k + 1 < len(columns) else ""
        others = list(zip(*columns[:k], *columns[k + 1 :], strict=True)) or [()] * len(texts)
        free, of_poses = not {"pose", "{pose}"} & {*own, *parts}, told.poses(words)
        alone = free and not any(map(told.poses, columns))
        of_targets = len(kinds) <= TARGETS and told.apart(others)
        masses = masses_in(words)
        unit = next(iter({mass.partition(" ")[2] for mass in masses.values()} - {""}), "")
        counts = all(word.isdecimal() for word in words)
        holes = [
            (words[0], len(kinds) == 1),
            ("*", "marker" in own and kinds <= {*map(squeeze, arm.markers)}),
            ("{marker}", kinds <= {*map(squeeze, arm.markers)}),
            ("{when}", kinds <= {*STATE_OF_WORD}),
            (f"{{mass_{after}}}", after in ("kg", "lb")),
            (f"{{mass_{unit}}}", bool(masses)),
            ("{pose}" if free else "*", of_poses),
            ("{marker}", of_targets and not {"marker", "{marker}"} & {*own, *parts}),
            ("{pose}", alone),
            (
                "*",
                len(kinds) <= SHOTS and (counts or len({*others}) == len({*zip(words, others, strict=True)})),
            ),
        ]
        part = next((hole for hole, fits in holes if fits), "")
        targets = list(dict.fromkeys(words)) if part == "{marker}" else targets
        loads = list(dict.fromkeys(words)) if masses and part == f"{{mass_{unit}}}" else loads
        shots = shots or (part == "*" and counts and not of_poses)
        parts.append(part)
    if "" in parts or sum(part == "*" or "{" in part for part in parts) < 2:
        return None
    [ends] = between
    pattern = "".join(a + b for a, b in zip(ends, [*parts, ""], strict=True))
    return _Parts(pattern, targets, loads, shots)


# --- A map proposed for an export: by the layout that fits it, else by the names of its columns -------------

LISTED = re.compile(r"[^\W\d][\w/.-]*")  #: Name of a joint in a list such as ['joint_1', 'joint_2'].
WHOLES = {"joint": "{joints_", "reading": "{position_"}  #: Quantities that a cell may hold together.
MASS = re.compile(r"(?<![\d.,])(?P<number>\d+(?:[.,]\d+)?)\s*(?P<unit>kg|lbs?)(?![^\W_])", re.IGNORECASE)
"""A mass in the name of a column, such as "X 150 kg [mm]"."""
MAX_HEADER = 3  #: Most lines of a header.
MAX_QUANTITIES = 1000  #: Most lines of a file whose rows are columns: each is a quantity, or a remark.
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


def _joined(
    table: TableCells, log: Path, arm: Arm, fits: Fitting | None, beside: Path
) -> tuple[TableCells, list[Entry], list[Entry], tuple[Fitting | None, TableCells]]:
    """Join the robot's log to an export.

    Returns:
        The table with the columns of the log; the entries of its points; those of the log; how it was read.
    """
    rows, layout = _read(log, arm)
    how, alone = _join(table, rows, fits, layout)
    table, points = _of_the_arm(table, alone)
    keys = {**how.model_dump(exclude_defaults=True), "file": os.path.relpath(log, beside)}
    why = {
        "rows": "no names or times in common, but these counts agree",
        "parts": "names of the log are parts of the names here",
    }
    entries = [Entry("log", key, value, why.get(key, "")) for key, value in keys.items()]
    entries += _layout_entries("log.table", layout)
    return join_log(table, rows, how), points, entries, (layout, rows)


def propose(
    path: Path,
    arm: Arm,
    log: Path | None,
    beside: Path,
    layout: str | None = None,
    loaded: Path | None = None,
) -> Proposal:
    """Propose the map of an export, and of the robot's log that belongs to it.

    Args:
        path: The export.
        arm: The arm that was measured.
        log: The robot's log with its joints; None where the export has them.
        beside: The folder where the map will be; the path of the log is relative to it.
        layout: Name of the layout that the export has; None for the one that fits.
        loaded: Another file or sheet of the same columns, with the loaded readings; None without one.

    Returns:
        The map's lines, and the layouts that fit.

    Raises:
        InputError: When a file is no table, fits several layouts, lacks joints or positions, or cannot be
            joined to the log.
    """
    sheets = sheets_of(path, arm, layout) if loaded is None else []
    table, fits = _read(path, arm, layout, sheets)
    entries, every = [*_layout_entries("file", fits), *_file_entries(table, sheets)], [(fits, table)]
    if loaded is not None:
        table = with_loaded(table, _read(loaded, arm, layout)[0])
        entries.append(Entry("loaded", "file", os.path.relpath(loaded, beside)))
    above = fits.above if fits else _lines_above(table)
    patterns, loads = _loads_in_names(table, arm)
    if patterns:
        table = stack_loads(table, patterns, loads)
    if log is None:
        joint = joints_of(arm)
        joints = [k for k, name in enumerate(table.names) if joint(name)]
        blank = [table.blank(k) for k in joints] or [np.zeros(table.rows, dtype=bool)]
        alone = np.all(blank, axis=0)
        if merged := _merged(table, arm, alone, joints):
            entries.append(Entry("file", "merged", True, "joints are blank below those of the pose"))
            table, alone = table.filled(merged), np.zeros(table.rows, dtype=bool)
        table, points = _of_the_arm(table, alone)
    else:
        table, points, of_log, read = _joined(table, log, arm, fits, beside)
        entries += of_log
        every.append(read)
    length = stated_length_unit(above) or _unit_in_cells(table) or (fits and fits.layout.length) or ""
    stated = Stated()
    for one, source in every:
        if one:
            stated.add(one, table, arm, length)
            stated.order(one, source, arm)
    entries += [*stated.entries, *columns_by_name(table, arm, length, stated.what), *points]
    entries += names_by_cells(table, arm, stated.names)
    named = {without_load(pattern): pattern for pattern in patterns}
    entries = [
        own._replace(value=named[own.value]) if isinstance(own.value, str) and own.value in named else own
        for own in entries
    ]
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
    some = series.oriented & series.seen[:, 0]
    if series.rotation is None or some.sum() < MIN_POSES:
        return None
    tried = {"as read": series.rotation[some]}
    return fits_of(arm, series.q[some], series.position[some, 0], tried)[0]


def _read(
    path: Path, arm: Arm, layout: str | None = None, sheets: Sequence[str] = ()
) -> tuple[TableCells, Fitting | None]:
    """Read a table by the layout that fits, else by the names of columns that are known."""
    place, joint = places(arm), joints_of(arm)

    def known(name: str) -> bool:
        return bool(column_meaning(name) or place(name) or joint(name) or looks_like(name, "joints"))

    if _lies(path, arm):
        return read_log(path, known, FileLayout(transposed=True, sheets=[*sheets])), None
    fits = fitting(path, arm, layout)
    file = (fits.file if fits else FileLayout()).model_copy(update={"sheets": [*sheets]})
    own = bool if fits else known
    try:
        table = read_log(path, own, file)
    except InputError:
        with contextlib.suppress(InputError):
            table = read_log(path, own, file.model_copy(update={"sections": True}))
            titles = list(dict.fromkeys(table.texts(len(table.names) - 1)))
            if all(map(state_of, titles)) or masses_in(titles) or _marked(titles, arm):
                return table, fits
        raise
    axes, lines = [*filter(place, table.names)], 1
    while not fits and len({*filter(place, table.names)}) < len(axes) and lines < MAX_HEADER:
        lines += 1  # merged cells in lines above may say which is which
        with contextlib.suppress(InputError):
            wide = read_log(path, own, file.model_copy(update={"header": lines}))
            if len({name for name in wide.names if place(MASS.sub(" ", name))}) == len(axes):
                return wide, fits
    return table, fits


def _loads_in_names(table: TableCells, arm: Arm) -> tuple[list[str], list[str]]:
    """Find columns of positions that differ in nothing but a load in their names.

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
    _refuse_twice(table, stated)
    for pattern in patterns:
        before, after = (squeeze(part) for part in LOAD.sub("{", pattern).split("{"))
        for name in map(squeeze, table.names):
            word = name.removeprefix(before).removesuffix(after)
            if f"{before}{word}{after}" == name and STATE_OF_WORD.get(word) == "before":
                loads.add(word)
    return ([*patterns], sorted(loads)) if len(loads) > 1 else ([], [])


def _lies(path: Path, arm: Arm) -> bool:
    """Whether the first cells of a file's lines name the joints: its rows are columns."""
    text, how = read_letters(path, None, ".")
    lines = split_lines(path, text)
    if len(lines) > MAX_QUANTITIES:
        return False
    rows = even_rows(lines, ["\t"] if how.startswith(SHEET) else DELIMITERS[:4])
    return bool(joint_family([row[0] for row in rows], arm))


def _marked(titles: Sequence[str], arm: Arm) -> bool:
    """Whether lines of words are those of the arm's markers, such as "Marker P1", each once."""
    rows = parts_in(titles, arm.markers)
    return bool((rows >= 0).all()) and len({*rows.tolist()}) == len(titles) > 1


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
    first = _read(path, arm, layout)[0] if len(names) > 1 else None
    alike = [name for name in names if first is not None and _alike(first, _sheet(path, name), arm, layout)]
    states = [state_of(name) for name in alike]
    targets = {*map(squeeze, alike)} <= {*map(squeeze, arm.markers)}
    together = sorted(states) == sorted(STATES) or masses_in(alike) or targets
    return alike if len(alike) > 1 and together else []


def _sheet(path: Path, name: str) -> Path:
    return path.with_name(f"{path.name}#{name}")


def _alike(first: TableCells, path: Path, arm: Arm, layout: str | None) -> bool:
    """Whether a sheet has the columns of another one."""
    with contextlib.suppress(InputError):
        _read(path, arm, layout)[0].cells_like(first)
        return True
    return False


def _unit_in_cells(table: TableCells) -> str:
    """The unit of lengths that every cell of a column of units says; "" without such a column."""
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


def _layout_entries(table: str, fits: Fitting | None) -> list[Entry]:
    """Where the table of a layout is, and how it is written."""
    said = fits.file.model_dump(exclude_defaults=True, exclude_none=True) if fits else {}
    return [Entry(table, key, value) for key, value in said.items() if (key, value) != ("skip", 0)]


def _file_entries(table: TableCells, sheets: Sequence[str]) -> Iterator[Entry]:
    """How a table was read where no layout says it."""
    if sheets:
        yield Entry("file", "sheets", [*sheets])
    if table.names[-1:] == (SECTION,):
        yield Entry("file", "sections", True)
    if table.transposed:
        yield Entry("file", "transposed", True, "the first column names the joints")
    if table.head > 1:
        yield Entry("file", "header", table.head)


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


def _merged(table: TableCells, arm: Arm, alone: Mask, joints: Sequence[int]) -> list[int]:
    """Columns of merged cells, of a table that states joints once for the rows of a pose; none of another.

    Args:
        table: The table.
        arm: The arm, with the names of its markers.
        alone: Rows without joints, (rows,).
        joints: Places of the columns of joints.
    """
    if not alone.any() or alone[0]:
        return []
    place, markers = places(arm), {*map(squeeze, arm.markers)}
    others = [k for k, name in enumerate(table.names) if name and k not in joints and not place(name)]
    alike = [k for k in others if np.array_equal(table.blank(k), alone)]
    named = [np.array([squeeze(text) in markers for text in table.texts(k)]) for k in others]
    return [*joints, *alike] if alike or any(own.all() for own in named) else []


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
            called = squeeze(ours) == squeeze(theirs) or {*map(column_meaning, (ours, theirs))} == {"name"}
            same = called and {*own} <= texts and all(text.isdecimal() for text in texts)
            if same or not all(map(is_decimal, own)):  # numbers are no names, unless both are called so
                return Log(file=log.path.name, on=[ours], to=[theirs]), alone
    for ours, (theirs, _) in product(dict.fromkeys(table.names), once.items()):
        if {column_meaning(ours), column_meaning(theirs)} == {"name"}:
            rows = parts_in(keys_of(table, [ours]), keys_of(log, [theirs]))
            if (rows >= 0).all() and len({*rows.tolist()}) == log.rows > 1:
                how = Log(file=log.path.name, on=[ours], to=[theirs], parts=True)
                return how, np.zeros(table.rows, dtype=bool)
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
    names = [keys_of(table, [name]) for name in table.names if column_meaning(name) == "name"]
    parts = [zip(*map(WORD.findall, texts), strict=False) for texts in names]
    for texts in (*names, *(words for own in parts for words in own)):
        groups = [{*texts[k : k + count]} for k in range(0, len(texts), count)]
        one_each = {*map(len, groups)} == {1} and len({*texts}) == len(groups)
        if one_each or (len(groups[0]) == count and all(group == groups[0] for group in groups)):
            return True
    return False
