"""Poses, targets, states and shots in the columns of names of an export, by their cells."""

import json
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from testbench.arm.document import is_decimal
from testbench.arm.folder import Arm
from testbench.errors import Array
from testbench.files.guess import Entry, line_entries, mass_columns, unit_of
from testbench.files.guessed_columns import place_columns
from testbench.files.names import (
    NUMBER,
    STATE_OF_CELL,
    STATE_OF_WORD,
    STATES,
    XYZ,
    are_markers,
    column_meaning,
    joint_family,
    looks_like,
    masses_in,
    number_of,
    plain,
    squeeze,
    state_of,
)
from testbench.files.rearranged import keys_of, parts_in
from testbench.files.table import SECTION, SHEETS, UNNAMED, TableCells

WORD = re.compile(r"\d+[.,]\d+[^\W\d_]*|[^\W_]+")  #: Of a name such as P12_T1-loaded or p1_P1_0.1t.
SHOTS, TARGETS = 20, 12  #: Most shots of a point, most targets of a file.
APART_TARGETS = 0.01  #: Least distance of two targets, over the typical size of a coordinate.
APART = {"mass", "axis", "pose", "marker", "state"}  #: Quantities that tell rows of one name apart.


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
    kinds |= {name: "name" for name in kinds if UNNAMED.fullmatch(name) and _of_words(table, name)}
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
    shots = "names repeat in successive rows: these are repeated readings (shots)" if names and again else ""
    lined = any(line_entries(table))
    told = _told(table, arm, said)
    parted = list[str]()
    own = {"pose", "marker"} & {*said.values()}
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
        elif told.targets(texts) or (lined and are_markers(distinct, arm)):
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
            yield Entry("cells", name, parts.pattern, f"from names such as {texts[0]!r}")
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

    def of_markers(name: str) -> bool:
        return are_markers(keys_of(table, [name]), arm)

    def of_states(name: str) -> set[str]:
        words = {squeeze(text).strip("0123456789") for text in keys_of(table, [name])}
        return {STATE_OF_WORD.get(word, "") for word in words}

    if not any(map(of_markers, names)):
        yield from [name for name in unknown if of_markers(name)][:1]
    if not any(_of_states(table, name) for name in names):
        both = [name for name in unknown if of_states(name) == {*STATES}]
        yield from [name for name in both if _of_states(table, name)][:1]


def _of_words(table: TableCells, name: str) -> bool:
    """Whether no cell of a column is a number: a number may count the rows."""
    return not any(is_decimal(text) for text in keys_of(table, [name]))


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
    columns = read[: len(XYZ)] or place_columns(table, arm)
    position = np.full((table.rows, len(XYZ)), np.nan)
    for axis, k in enumerate(columns):
        position[:, axis] = np.array([number_of(text) for text in table.texts(k)], dtype=float)
    size = np.nanmedian(np.abs(position)) if np.isfinite(position).any() else 1.0
    return _Told(keys_of(table, joints) if joints else [""] * table.rows, position / (size or 1.0))


def _targets(own: Sequence[str], arm: Arm) -> Iterator[Entry]:
    """Say whose names those of targets are: the arm's markers by their numbers, else targets of their own."""
    own = [text for text in own if text]
    numbers = [NUMBER.findall(text)[-1:] for text in own]
    if are_markers(own, arm):
        return
    if len(own) == len(arm.markers) == len({int(n[0]) for n in numbers if n}):
        order = sorted(own, key=lambda text: int(NUMBER.findall(text)[-1]))
        why = "the smallest number is the arm's first marker"
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
        elif name == SECTION and marked(texts, arm):
            yield Entry("columns", "marker", name)
            both = zip(texts, parts_in(texts, arm.markers), strict=True)
            yield from (Entry("words", arm.markers[k], text) for text, k in both)
        elif name == SHEETS:
            yield Entry("columns", "marker", name)
            yield from _targets(texts, arm)


def marked(titles: Sequence[str], arm: Arm) -> bool:
    """Tell whether lines of words are those of the arm's markers, such as "Marker P1", each once.

    Args:
        titles: The lines.
        arm: The arm, with the names of its markers.

    Returns:
        Whether they are.
    """
    rows = parts_in(titles, arm.markers)
    return bool((rows >= 0).all()) and len({*rows.tolist()}) == len(titles) > 1


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
        known = are_markers(kinds, arm) or any(map(is_decimal, kinds))
        if again and not known and 1 < len(kinds) <= SHOTS:
            unknown.append(kinds)
    if unknown:
        few = " and ".join(map(repr, min(unknown, key=len)[:3]))
        hint = (
            f'state it in a map, as [cells] {json.dumps(name)} = "{{pose}}_{{when}}", [words] before = "..."'
        )
        raise table.header_error(
            f"the meaning of {few} in names such as {texts[0]!r} is unknown; {hint}", name
        )


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
    columns = list(zip(*rows, strict=True))
    parts = list[str]()
    shots = False
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
            ("*", "marker" in own and are_markers(kinds, arm)),
            ("{marker}", are_markers(kinds, arm)),
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
