"""A map proposed from an export's header and values: names, units, words, shots, the robot's log beside it.

What only values tell is a guess: the map has it as a comment, and `testbench data map` says it.
"""

import json
import os
import re
import tomllib
from collections.abc import Iterator, Sequence
from itertools import pairwise, permutations
from pathlib import Path
from typing import NamedTuple

import numpy as np

from testbench.arm.decimal import is_decimal
from testbench.arm.folder import Arm
from testbench.data.mapping import Layout, Log
from testbench.data.names import XYZ, recognise, series_names, split_unit, squeeze
from testbench.data.rearranged import joined, keys_of, nearest, times_of
from testbench.data.table import Table, read_table
from testbench.errors import InputError, Mask

KNOWN = tomllib.loads(Path(__file__).with_name("exports.toml").read_text(encoding="utf-8"))
STATES = {squeeze(word): state for state, words in KNOWN["states"].items() for word in words}
WORD = re.compile(r"\d+[.,]\d+|[^\W_]+")  #: Of a name such as P12_T1-loaded.
SHOTS, TARGETS = 20, 12  #: Most shots of a point, most targets of a file.
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


def meaning(name: str) -> str:
    """What a column is to us by its name; "" for an unknown one."""
    found = ((ours, re.fullmatch(own, _plain(name))) for ours, own in KNOWN["columns"].items())
    return next((ours.format(**match.groupdict()) for ours, match in found if match), "")


def _plain(name: str) -> str:
    return re.sub(r"[\W_]+", "", (split_unit(name) or (name,))[0]).casefold()


def _side_by_side(arm: Arm) -> dict[str, str]:
    """Our names of unloaded and loaded positions, by what files call state, axis and target in any order."""
    return {
        _plain("".join(order)): "_".join(filter(None, (marker, when, axis)))
        for word, when in STATES.items()
        for axis in XYZ
        for marker in ("", *arm.markers)
        for order in permutations((marker, word, axis))
    }


def propose(path: Path, arm: Arm, log: Path | None, beside: Path) -> list[Entry]:
    """The map of an export, in the folder `beside`, and of the robot's log that belongs to it.

    Raises:
        InputError: When a file is no table, lacks joints or positions, or shares neither names nor times.
    """
    paired, entries = _side_by_side(arm), list[Entry]()

    def known(name: str) -> bool:
        return bool(meaning(name)) or _plain(name) in paired

    table = read_table(path, known)
    if not any(map(known, table.names)):
        table = _headless(path, table.names)
        why = "no header: the first numbers are positions"
        entries.append(Entry("file", "names", list(table.names), why))
    if log is None:
        joints = [k for k, name in enumerate(table.names) if meaning(name).startswith("joint")]
        blank = [table.blank(k) for k in joints] or [np.zeros(table.rows, dtype=bool)]
        table, points = _of_the_arm(table, np.all(blank, axis=0))
    else:
        other = read_table(log, lambda name: bool(meaning(name)))
        how, alone = _join(table, other)
        table, points = _of_the_arm(table, alone)
        said = {**how.model_dump(exclude_none=True), "file": os.path.relpath(log, beside)}
        table = joined(table, other, how)
        entries += [Entry("log", key, value) for key, value in said.items()]
    return [*entries, *_columns(table, arm), *points, *_names(table, arm)]


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
    for ours in table.names:
        own = [*map(squeeze, keys_of(table, [ours]))]
        for theirs in log.names if len({*own}) > 1 and not all(map(is_decimal, own)) else ():
            texts = [*map(squeeze, keys_of(log, [theirs]))]
            alone = np.array([text not in {*texts} for text in own])
            if alone.mean() < 0.5 and len({*texts}) == len(texts):
                return Log(file=log.path.name, on=[ours], to=[theirs]), alone
    both = [[name for name in own.names if meaning(name) == "when"] for own in (table, log)]
    when = [times_of(own, names) for own, names in zip((table, log), both, strict=True)]
    late = np.abs(when[1][nearest(*when)] - when[0])
    alone = late > SOON
    apart = float(late[~alone].max() if alone.mean() < 0.5 else late.max())
    if apart > SOON:
        problem = f"expected a row within {SOON:g} s of every reading, one has none in {apart:.4g} s"
        raise InputError(log.path, "", f"{problem}; do the clocks agree?")
    how = Log(file=log.path.name, on=both[0], to=both[1], within_s=max(1.0, float(np.ceil(2 * apart))))
    return how, alone


def _columns(table: Table, arm: Arm) -> Iterator[Entry]:
    """Joints, positions, scatter, mass: which column, in which unit."""
    known, paired = dict[str, list[int]](), _side_by_side(arm)
    for k, name in enumerate(table.names):
        known.setdefault(paired.get(_plain(name)) or meaning(name), []).append(k)
    first = 0 if "joint 0" in known else 1
    needed = {f"joint {k + first}": joint.name for k, joint in enumerate(arm.file_joints)}
    ours = [recognise(name, series_names(arm)) for name in table.names]
    both = [own for own in known if own in paired.values()]
    if both or set(XYZ) <= known.keys():
        needed |= {own: own for own in both or XYZ}
    elif not any(own and own[0].what == "reading" and own[0].marker for own in ours):
        needed |= {"axis": "axis", "position": "position"}
    for theirs, our in (needed | SCATTER | {"mass": "mass", "temperature": "temperature"}).items():
        if theirs in known:
            unit, why = _unit(table, known, theirs)
            others = ", ".join(repr(table.names[k]) for k in known[theirs][1:])
            why = "; ".join(filter(None, [why, others and f"not {others}"]))
            yield Entry("columns", our + unit, table.names[known[theirs][0]], why)
            if theirs.startswith("u95"):
                yield Entry("scale", our + unit, 0.5, "two standard deviations, as U95")
        elif theirs in needed:
            hint = '[columns] of a map by hand says which it is, as x = "X", or before_x and after_x of pairs'
            hint = (
                f'{hint}, or "{{marker}}_{{when}}_{{axis}}" = "{{marker}} {{when}} {{axis}}" with its words'
            )
            what = {"axis": "a position"}.get(our, our)
            raise table.header_error(f"no column looks like {what}; columns are {list(table.names)}; {hint}")
    places = [k for x in (*both, *XYZ, "position") for k in known.get(x, [])[:1]]
    if words := {
        text for k in places for text in table.texts(k) if text and not is_decimal(text.replace(",", "."))
    }:
        yield Entry("words", "lost", sorted(words), "no numbers")


def _unit(table: Table, known: dict[str, list[int]], theirs: str) -> tuple[str, str]:
    """What a key gets behind it where the header has no unit, by the values, and that in words."""
    k = known[theirs][0]
    if split_unit(table.names[k]) or table.units[k] or theirs in ("axis", "temperature"):
        return "", ""
    joint = theirs.startswith("joint")
    every = [own[0] for name, own in known.items() if name.startswith("joint")] if joint else [k]
    texts = [text.replace(",", ".") for m in every for text in table.texts(m)]
    size = np.abs([float(text) for text in texts if is_decimal(text)] or [1.0])
    if joint:
        return "_deg" if size.max() > TURNS else "_rad", f"joints up to {size.max():.4g}"
    if theirs == "mass":
        return "_kg", "no unit"
    middle, typical = float(np.median(size)) or 1.0, TYPICAL["sigma" if theirs in SCATTER else ""]
    unit = min(LENGTHS, key=lambda unit: abs(np.log(middle * LENGTHS[unit] / typical)))
    return f"_{unit}", f"numbers around {middle:.4g}"


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
