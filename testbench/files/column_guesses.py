"""Guess what columns of an unknown export mean, by their names and cells, each guess with its reason."""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from testbench.arm.document import is_decimal
from testbench.arm.folder import Arm
from testbench.errors import Array, InputError
from testbench.files.meaning import (
    KNOWN_EXPORTS,
    NUMBER,
    STATE_OF_WORD,
    Place,
    column_meaning,
    joint_family,
    looks_like,
    places,
    plain,
)
from testbench.files.names import XYZ, Unit, split_unit, squeeze
from testbench.files.rearranged import clock, keys_of, numbers_in
from testbench.files.table import TableCells

WORD = re.compile(r"\d+[.,]\d+|[^\W_]+")  #: Of a name such as P12_T1-loaded.
SHOTS, TARGETS = 20, 12  #: Most shots of a point, most targets of a file.
POSED = re.compile("tcp|cart|pose|xyz|koord|coord|frame")  #: Names of cells that hold a pose of the tool.
APART = {"mass", "axis", "pose", "marker", "state"}  #: Quantities that tell rows of one name apart.
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
    readings = dict[str, list[int]]()
    if "reading" not in said:
        readings, markers = _positions(table, arm)
        if not readings and {"axis", "position"} <= known.keys():
            readings = {"axis": known["axis"], "position": known["position"]}
        yield from markers if readings else [_position_cells(table, length)]
    others = SCATTER | {"mass": "mass", "temperature": "temperature"}
    kinds = dict.fromkeys(SCATTER, "deviation")
    others = {theirs: our for theirs, our in others.items() if kinds.get(theirs, theirs) not in said}
    for our, columns, kind in (
        *((our, columns, our if our == "axis" else "") for our, columns in readings.items()),
        *((our, known[theirs], theirs) for theirs, our in others.items() if theirs in known),
    ):
        alike = [own[0] for own in readings.values()] if our in readings else columns[:1]
        unit, why = length_unit(table, columns[0], alike, kind, length)
        left = ", ".join(repr(table.names[k]) for k in columns[1:])
        why = "; ".join(filter(None, [why, left and f"not {left}"]))
        yield Entry("columns", our + unit, table.names[columns[0]], why)
        if kind.startswith("u95"):
            yield Entry("scale", our + unit, 0.5, "two standard deviations, as U95")
    yield from lost_words(table, [k for our, (k, *_) in readings.items() if our != "axis"])


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
    hint = 'name it in [columns] of a map, as x = "X", or before_x and after_x of pairs'
    hint = f'{hint}, or "{{marker}}_{{when}}_{{axis}}" = "{{marker}} {{when}} {{axis}}" with its words'
    return table.header_error(f"no column looks like {what}; columns are {list(table.names)}; {hint}")


def _positions(table: TableCells, arm: Arm) -> tuple[dict[str, list[int]], list[Entry]]:
    """The columns of positions by our names for them, and what the map says of their targets.

    Names that say a state come before those that do not, names of several targets before those of none.
    """
    place, found = places(arm), dict[Place, list[int]]()
    for k, name in enumerate(table.names):
        if at := place(name):
            found.setdefault(at, []).append(k)
    whole = [p for p in found if p.axis == "x" and all(p._replace(axis=axis) in found for axis in XYZ)]
    whole = [p for p in whole if p.when] or whole
    targets = list(dict.fromkeys(p.target for p in whole if p.target))
    bare = any(not p.target for p in whole)
    if bare and len(targets) < 2:
        targets = [""]
    elif bare:
        whole = [p for p in whole if p.target]
    names, said = {plain(marker): marker for marker in arm.markers} | {"": ""}, list[Entry]()
    if not {*targets} <= {*names}:
        own = sorted(targets, key=lambda target: int(NUMBER.findall(target)[-1]))
        markers = [f"M{target}" if target.isdecimal() else target.upper() for target in own]
        why = "no markers of the arm"
        if len(own) == len(arm.markers):
            markers, why = list(arm.markers), "targets are numbered as the markers of the arm"
        names = dict(zip(own, markers, strict=True))
        said = [Entry("series", "markers", markers, why)]
    kept = [p._replace(axis=axis) for p in whole if p.target in targets for axis in XYZ]
    return {p.ours(names): found[p] for p in kept}, said


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


def _position_cells(table: TableCells, length: str) -> Entry:
    """The column that holds x, y, z in one cell; InputError where none does."""
    for k in (k for k, name in enumerate(table.names) if not looks_like(name, "joints")):
        if len(values := _cells_of(table, k, len(XYZ))):
            said, (guessed, why) = unit_of(table, k), _length(values, "", length)
            return Entry(
                "cells", table.names[k], f"{{position_{said.name if said else guessed}}}", "" if said else why
            )
    raise _unlike(table, "a position")


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
    names = [name for name in table.names if column_meaning(name) in ("name", "state") and name not in said]
    apart = [name for name in table.names if {column_meaning(name), said.get(name)} & APART]
    every = keys_of(table, [*names, *apart])
    again = 1 + sum(a != b for a, b in pairwise(every)) == len({*every}) < len(every) / 1.5
    shots = "names stand several times in a row: shots" if again else ""
    for name in names:
        texts = keys_of(table, [name])
        distinct, changes = list(dict.fromkeys(texts)), 1 + sum(a != b for a, b in pairwise(texts))
        if pattern := _pattern(texts, arm) if len(distinct) > 1 else "":
            yield Entry("cells", name, pattern, f"of {texts[0]!r}")
            shots = "the last number of a name counts shots" if "*" in pattern else shots
            yield from _states([word for text in distinct for word in WORD.findall(text)])
        elif {squeeze(text) for text in texts} <= {*STATE_OF_WORD}:
            yield Entry("columns", "state", name)
            yield from _states(distinct)
        elif column_meaning(name) == "state":
            continue  # in words that nobody knows
        elif 1 < len(distinct) < changes and len(distinct) <= TARGETS:
            yield Entry("columns", "marker", name)
            if not {*distinct} <= {*arm.markers}:
                yield Entry("series", "markers", distinct, "no markers of the arm")
        elif len(distinct) > 1:
            yield Entry("columns", "pose", name)
    if shots:
        yield Entry("file", "average", True, shots)


def _states(words: Sequence[str]) -> Iterator[Entry]:
    for state in ("before", "after"):
        if own := sorted({word for word in words if STATE_OF_WORD.get(squeeze(word)) == state}):
            yield Entry("words", state, own)


def _pattern(texts: Sequence[str], arm: Arm) -> str:
    """What names of several parts hold, as "P{pose}_{marker}_*"; "" where fewer than two parts differ."""
    between, rows = {tuple(WORD.split(text)) for text in texts}, [WORD.findall(text) for text in texts]
    if len(between) > 1:
        return ""
    columns, parts = list(zip(*rows, strict=True)), list[str]()
    for k, words in enumerate(columns):
        kinds, after = {*map(squeeze, words)}, squeeze(columns[k + 1][0]) if k + 1 < len(columns) else ""
        holes = {
            words[0]: len(kinds) == 1,
            "{marker}": kinds <= {*map(squeeze, arm.markers)},
            "{when}": kinds <= {*STATE_OF_WORD},
            f"{{mass_{after}}}": after in ("kg", "lb"),
            "{mass_kg}kg": all(re.fullmatch(r"\d+kg", kind) for kind in kinds),
            "{pose}": "{pose}" not in parts,
            "*": len(kinds) <= SHOTS,
        }
        parts.append(next((hole for hole, fits in holes.items() if fits), ""))
    if "" in parts or sum(part in ("*",) or "{" in part for part in parts) < 2:
        return ""
    [ends] = between
    return "".join(a + b for a, b in zip(ends, [*parts, ""], strict=True))
