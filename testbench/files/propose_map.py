"""A map proposed from an export's header and values: names, units, words, shots, the robot's log beside it.

What only values tell is a guess: the map has it as a comment, and `testbench data map` says it.
"""

import json
import os
import re
from collections.abc import Iterator, Sequence
from itertools import pairwise, product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from testbench.arm.decimal import is_decimal
from testbench.arm.folder import Arm
from testbench.errors import Array, InputError, Mask
from testbench.files.mapping import Layout, Log
from testbench.files.meaning import (
    NUMBER,
    STATES,
    Place,
    joint_family,
    joints_of,
    looks_like,
    meaning,
    places,
    plain,
)
from testbench.files.names import XYZ, squeeze
from testbench.files.propose_cells import cell_pattern, length_said, lines_above, names_below_targets, unit_of
from testbench.files.rearranged import clock, joined, keys_of, nearest, times_of
from testbench.files.table import Table, read_table
from testbench.files.targets import read_log

WORD = re.compile(r"\d+[.,]\d+|[^\W_]+")  #: Of a name such as P12_T1-loaded.
SHOTS, TARGETS = 20, 12  #: Most shots of a point, most targets of a file.
POSED = re.compile("tcp|cart|pose|xyz|koord|coord|frame")  #: Names of cells that hold a pose of the tool.
SOON = 30.0  #: Farthest row of a log that may be of a reading [s].
TURNS = 7.0  #: Joint coordinates beyond are degrees [rad].
SCATTER = {f"{what}_{x}": f"sigma_{x}" for what in ("sigma", "u95") for x in XYZ}
LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
TYPICAL = {
    "sigma": 3e-5,
    "": 1.0,
}  #: What readings scatter by, and positions are, to an order of magnitude [m].


class Entry(NamedTuple):
    """A line of a map."""

    table: str
    key: str
    value: object
    why: str = ""  #: Where it is a guess.


def map_text(entries: Sequence[Entry]) -> str:
    """Lines as TOML, by their tables; of one key the first."""
    tables: dict[str, dict[str, str]] = {}
    for table, key, value, why in entries:
        name, said = (json.dumps(x, ensure_ascii=False) for x in (key, value))
        name = key if key.isidentifier() and key.isascii() else name
        tables.setdefault(table, {}).setdefault(
            name, f"{name} = {said}" + (f"  # guess: {why}" if why else "")
        )
    return "".join("\n".join([f"[{table}]", *own.values(), ""]) for table, own in tables.items())


def propose(path: Path, arm: Arm, log: Path | None, beside: Path) -> list[Entry]:
    """The map of an export, in the folder `beside`, and of the robot's log that belongs to it.

    Raises:
        InputError: When a file is no table, lacks joints or positions, or cannot be joined to the log.
    """
    place, joint = places(arm), joints_of(arm)

    def known(name: str) -> bool:
        return bool(meaning(name) or place(name) or joint(name) or looks_like(name, "joints"))

    table, entries = read_table(path, known), list[Entry]()
    if not any(map(known, table.names)):
        table = _headless(path, table.names)
        why = "no header: the first numbers are positions"
        entries.append(Entry("file", "names", list(table.names), why))
    above = lines_above(table)
    if names := names_below_targets(table, above, arm):
        skip = int(table.lines[0]) - 1
        table = read_table(path, bool, Layout(names=names, skip=skip))
        entries += [Entry("file", "skip", skip), Entry("file", "names", names)]
    if log is None:
        joints = [k for k, name in enumerate(table.names) if joint(name)]
        blank = [table.blank(k) for k in joints] or [np.zeros(table.rows, dtype=bool)]
        table, points = _of_the_arm(table, np.all(blank, axis=0))
    else:
        other = read_log(log, known)
        how, alone = _join(table, other)
        table, points = _of_the_arm(table, alone)
        said = {**how.model_dump(exclude_defaults=True), "file": os.path.relpath(log, beside)}
        table = joined(table, other, how)
        why = "no names or times in common, but these counts agree"
        entries += [Entry("log", key, value, why * (key == "rows")) for key, value in said.items()]
    return [*entries, *_columns(table, arm, length_said(above)), *points, *_names(table, arm)]


def _of_the_arm(table: Table, alone: Mask) -> tuple[Table, list[Entry]]:
    """Without rows that have no joints, such as of a nest, where targets have other names there."""
    names = [name for name in table.names if meaning(name) == "name"] if alone.any() else []
    for texts, name in ((np.array(keys_of(table, [name])), name) for name in names):
        targets, others = {*texts[~alone].tolist()}, {*texts[alone].tolist()}
        if not targets & others and len(targets) <= min(TARGETS, len(texts) / 2):
            own = Entry("words", "ignore", sorted(others), f"{', '.join(sorted(others))} without joints")
            return table.take(~alone), [Entry("columns", "marker", name), own]
    return table, []


def _headless(path: Path, cells: Sequence[str]) -> Table:
    """The table of a file without a header, by its first row."""
    numbers = [k for k, cell in enumerate(cells) if is_decimal(cell.replace(",", "."))]
    names = [f"column {k + 1}" if k in numbers else f"point {k + 1}" for k in range(len(cells))]
    for axis, k in zip(XYZ, numbers, strict=False):
        names[k] = axis
    return read_table(path, bool, Layout(names=[name.replace("point 1", "point") for name in names]))


def _join(table: Table, log: Table) -> tuple[Log, Mask]:
    """How rows of a log belong to those of a table, by names that it has once each, else by time.

    Returns:
        That, and which rows of the table have none, the fewer ones, (rows,).
    """
    every = {name: [*map(squeeze, keys_of(log, [name]))] for name in log.names}
    once = {name: {*texts} for name, texts in every.items() if len({*texts}) == len(texts)}
    for ours, (theirs, texts) in product(dict.fromkeys(table.names), once.items()):
        own = [*map(squeeze, keys_of(table, [ours]))]
        alone = np.array([text not in texts for text in own], dtype=bool)
        if alone.mean() < 0.5 and len({*own}) > 1:
            same = {meaning(ours), meaning(theirs)} == {"name"} and {*own} == texts
            if same or not all(map(is_decimal, own)):  # numbers are no names, unless both are called so
                return Log(file=log.path.name, on=[ours], to=[theirs]), alone
    both = [[name for name in own.names if meaning(name) == "when"] for own in (table, log)]
    if not all(both):
        count = table.rows // max(log.rows, 1)
        if table.rows != count * log.rows or not _in_turn(table, count):
            got = f"{table.rows} readings and {log.rows} rows of the log"
            problem = "expected names or times in columns of both files, or as many rows or poses in both"
            raise InputError(log.path, "", f"{problem}, got {got}")
        return Log(file=log.path.name, rows=count), np.zeros(table.rows, dtype=bool)
    when = [times_of(own, names) for own, names in zip((table, log), both, strict=True)]
    late = np.abs(when[1][nearest(*when)] - when[0])
    alone = late > SOON
    apart = float(late[~alone].max() if alone.mean() < 0.5 else late.max())
    if apart > SOON:
        problem = f"expected a row within {SOON:g} s of every reading, one has none in {apart:.4g} s"
        raise InputError(log.path, "", f"{problem}; do the clocks agree?")
    how = Log(file=log.path.name, on=both[0], to=both[1], within_s=max(1.0, float(np.ceil(2 * apart))))
    return how, alone


def _in_turn(table: Table, count: int) -> bool:
    """Whether rows stand together: their names are those of the targets in each group, or one name."""
    if count <= 1:
        return count == 1
    for name in (name for name in table.names if meaning(name) == "name"):
        texts = keys_of(table, [name])
        groups = [{*texts[k : k + count]} for k in range(0, len(texts), count)]
        one_each = {*map(len, groups)} == {1} and len({*texts}) == len(groups)
        if one_each or (len(groups[0]) == count and all(group == groups[0] for group in groups)):
            return True
    return False


def _columns(table: Table, arm: Arm, length: str) -> Iterator[Entry]:
    """Joints, positions, scatter, mass: which column, in which unit.

    Args:
        table: The export, with what the log adds.
        arm: The arm.
        length: Unit of lengths that the lines above the header state; "" where they state none.
    """
    known = dict[str, list[int]]()
    for k, name in enumerate(table.names):
        known.setdefault(meaning(name), []).append(k)
    if joints := joint_family(table.names, arm):
        unit, why = _joint_unit(table, joints)
        for joint, k in zip(arm.file_joints, joints, strict=True):
            own = unit * (unit_of(table, k) is None)
            yield Entry("columns", joint.name + own, table.names[k], why * bool(own))
    elif arm.file_joints:
        yield _joint_cells(table, arm)
    readings, markers = _positions(table, arm)
    if not readings and {"axis", "position"} <= known.keys():
        readings = {"axis": known["axis"], "position": known["position"]}
    yield from markers if readings else [_position_cells(table, length)]
    others = SCATTER | {"mass": "mass", "temperature": "temperature"}
    for our, columns, kind in (
        *((our, columns, our if our == "axis" else "") for our, columns in readings.items()),
        *((our, known[theirs], theirs) for theirs, our in others.items() if theirs in known),
    ):
        alike = [own[0] for own in readings.values()] if our in readings else columns[:1]
        unit, why = _unit(table, columns[0], alike, kind, length)
        left = ", ".join(repr(table.names[k]) for k in columns[1:])
        why = "; ".join(filter(None, [why, left and f"not {left}"]))
        yield Entry("columns", our + unit, table.names[columns[0]], why)
        if kind.startswith("u95"):
            yield Entry("scale", our + unit, 0.5, "two standard deviations, as U95")
    if words := {
        text
        for our, (k, *_) in readings.items()
        for text in table.texts(k)
        if our != "axis" and text and not is_decimal(text.replace(",", "."))
    }:
        yield Entry("words", "lost", sorted(words), "no numbers")


def _unlike(table: Table, what: str) -> InputError:
    hint = '[columns] of a map by hand says which it is, as x = "X", or before_x and after_x of pairs'
    hint = f'{hint}, or "{{marker}}_{{when}}_{{axis}}" = "{{marker}} {{when}} {{axis}}" with its words'
    return table.header_error(f"no column looks like {what}; columns are {list(table.names)}; {hint}")


def _positions(table: Table, arm: Arm) -> tuple[dict[str, list[int]], list[Entry]]:
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


def _joint_cells(table: Table, arm: Arm) -> Entry:
    """How a column holds all joints in one cell; InputError where no column does."""
    order = sorted(range(len(table.names)), key=lambda k: not looks_like(table.names[k], "joints"))
    for k in order:
        found = _cells_of(table, k, len(arm.file_joints))
        if found and not POSED.search(plain(table.names[k])):
            said, (guessed, why) = unit_of(table, k), _angle(found[1])
            units = [said.name if said else "m" if joint.prismatic else guessed for joint in arm.file_joints]
            parts = [f"joint_{n}_{unit}" for n, unit in enumerate(units, start=1)]
            return Entry("cells", table.names[k], _pattern_of(found[0], parts), "" if said else why)
    raise _unlike(table, arm.file_joints[0].name)


def _position_cells(table: Table, length: str) -> Entry:
    """How a column holds x, y, z in one cell; InputError where no column does."""
    for k in (k for k, name in enumerate(table.names) if not looks_like(name, "joints")):
        if found := _cells_of(table, k, len(XYZ)):
            said, (guessed, why) = unit_of(table, k), _length(found[1], "", length)
            unit = said.name if said else guessed
            pattern = _pattern_of(found[0], [f"{axis}_{unit}" for axis in XYZ])
            return Entry("cells", table.names[k], pattern, "" if said else why)
    raise _unlike(table, "a position")


def _cells_of(table: Table, k: int, count: int) -> tuple[list[str], Array] | None:
    """As `cell_pattern` of a column that is neither the same in all rows nor a date or time."""
    texts = table.texts(k)
    same = table.rows > 1 and len({*texts}) == 1
    return None if same or clock(texts) is not None else cell_pattern(texts, count)


def _pattern_of(pieces: Sequence[str], parts: Sequence[str]) -> str:
    return pieces[0] + "".join(f"{{{part}}}{piece}" for part, piece in zip(parts, pieces[1:], strict=True))


def _joint_unit(table: Table, joints: Sequence[int]) -> tuple[str, str]:
    """The unit of joints whose names have none, by their values, and that in words."""
    unit, why = _angle(_sizes(table, joints))
    return f"_{unit}", why


def _angle(values: Array) -> tuple[str, str]:
    most = float(np.abs(values).max(initial=0.0))
    return "deg" if most > TURNS else "rad", f"joints up to {most:.4g}"


def _length(values: Array, kind: str, length: str) -> tuple[str, str]:
    if length and kind not in SCATTER:
        return length, "the lines above the table say so"
    middle = float(np.median(np.abs(values))) if np.size(values) else 1.0
    middle, typical = middle or 1.0, TYPICAL["sigma" if kind in SCATTER else ""]
    unit = min(LENGTHS, key=lambda unit: abs(np.log(middle * LENGTHS[unit] / typical)))
    return unit, f"numbers around {middle:.4g}"


def _sizes(table: Table, columns: Sequence[int]) -> Array:
    """The numbers of some columns, those that are none left out."""
    texts = (text.replace(",", ".") for k in columns for text in table.texts(k))
    return np.array([float(text) for text in texts if is_decimal(text)])


def _unit(table: Table, k: int, alike: Sequence[int], kind: str, length: str) -> tuple[str, str]:
    """What a key gets behind it where the header has no unit, by the values of columns alike, and why."""
    if unit_of(table, k) or kind in ("axis", "temperature"):
        return "", ""
    if kind == "mass":
        return "_kg", "no unit"
    unit, why = _length(_sizes(table, alike), kind, length)
    return f"_{unit}", why


def _names(table: Table, arm: Arm) -> Iterator[Entry]:
    """What columns of names say: poses, targets, states, loads, shots."""
    names = [name for name in table.names if meaning(name) in ("name", "state")]
    every = keys_of(table, [*names, *(name for name in table.names if meaning(name) in ("mass", "axis"))])
    again = 1 + sum(a != b for a, b in pairwise(every)) == len({*every}) < len(every) / 1.5
    shots = "names stand several times in a row: shots" if again else ""
    for name in names:
        texts = keys_of(table, [name])
        distinct, changes = list(dict.fromkeys(texts)), 1 + sum(a != b for a, b in pairwise(texts))
        if pattern := _pattern(texts, arm) if len(distinct) > 1 else "":
            yield Entry("cells", name, pattern, f"of {texts[0]!r}")
            shots = "the last number of a name counts shots" if "*" in pattern else shots
            yield from _states([word for text in distinct for word in WORD.findall(text)])
        elif {squeeze(text) for text in texts} <= {*STATES}:
            yield Entry("columns", "state", name)
            yield from _states(distinct)
        elif meaning(name) == "state":
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
        if own := sorted({word for word in words if STATES.get(squeeze(word)) == state}):
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
            "{when}": kinds <= {*STATES},
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
