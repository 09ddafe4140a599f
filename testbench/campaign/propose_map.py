"""A map proposed from an export's header and values: names, units, words, shots, the robot's log beside it.

What only values tell is a guess: it has a comment in the map, and `testbench data map` says it.
"""

import json
import os
import re
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from testbench.arm.decimal import is_decimal
from testbench.arm.folder import Arm
from testbench.data.clock import clock
from testbench.data.joined import joined
from testbench.data.mapping import Layout, Log
from testbench.data.names import XYZ, squeeze
from testbench.data.table import Table, read_table
from testbench.data.units import split_unit
from testbench.errors import InputError

KNOWN = tomllib.loads(Path(__file__).with_name("exports.toml").read_text(encoding="utf-8"))
STATES = {squeeze(word): state for state, words in KNOWN["states"].items() for word in words}
WORD = re.compile(r"\d+[.,]\d+|[^\W_]+")  #: Of a name such as P12_T1-loaded.
SHOTS = 20  #: Most shots of a point.
TURNS = 7.0  #: Joint coordinates beyond are degrees [rad].
TARGETS = 12  #: Most targets of a file.
LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
REACH = 1.0  #: What positions spread by, to an order of magnitude [m].
NOISE = 3e-5  #: What readings scatter by, likewise [m].


@dataclass
class Map:
    """A map as it grows: lines by table, and what was guessed."""

    tables: dict[str, dict[str, object]] = field(default_factory=dict)
    guesses: dict[tuple[str, str], str] = field(default_factory=dict)  #: By table and key.

    def add(self, table: str, key: str, value: object, guess: str = "") -> None:
        """A line; with why where it is a guess."""
        self.tables.setdefault(table, {})[key] = value
        if guess:
            self.guesses[table, key] = guess

    def text(self) -> str:
        """As TOML."""
        return "\n".join(self._lines()) + "\n"

    def _lines(self) -> Iterator[str]:
        for table, lines in self.tables.items():
            yield f"[{table}]"
            for key, value in lines.items():
                name = key if re.fullmatch(r"\w+", key, re.ASCII) else json.dumps(key, ensure_ascii=False)
                why = self.guesses.get((table, key))
                yield f"{name} = {json.dumps(value, ensure_ascii=False)}" + (
                    f"  # guess: {why}" if why else ""
                )


def meaning(name: str) -> str:
    """What a column is called for by its name; "" for an unknown one."""
    plain = re.sub(r"[\W_]+", "", (split_unit(name) or (name,))[0]).casefold()
    found = ((ours, re.fullmatch(own, plain)) for ours, own in KNOWN["columns"].items())
    return next((ours.format(**match.groupdict()) for ours, match in found if match), "")


def propose(path: Path, arm: Arm, log: Path | None, beside: Path) -> Map:
    """The map of an export, in the folder `beside`, and of the robot's log that belongs to it.

    Raises:
        InputError: When a file is no table, has no positions, or the two share neither names nor times.
    """
    found, table = Map(), _read(path)
    if not table.header:
        found.add("file", "names", list(table.names), "there is no header, columns are taken by their values")
    if log is not None:
        how = _join(table, _read(log))
        table = joined(table, _read(log), how)
        own = how.model_dump(exclude_none=True)
        own["file"] = os.path.relpath(log, beside)
        for key, value in own.items():
            why = "the nearest time; clocks have to agree" if key == "within_s" else ""
            found.add("log", key, value, why)
    known: dict[str, list[int]] = {}
    for k, name in enumerate(table.names):
        known.setdefault(meaning(name), []).append(k)
    _columns(found, table, known, arm)
    _names(found, table, known, arm)
    return found


def _read(path: Path) -> Table:
    """The table of a file, its columns called by what they hold where it has no header."""
    table = read_table(path, lambda name: bool(meaning(name)))
    if any(meaning(name) for name in table.names):
        return table
    kinds = ["x" if is_decimal(cell.replace(",", ".")) else "point" for cell in table.names]
    names, at = [], 0
    for k, kind in enumerate(kinds):
        axis = kind == "x" and at < len(XYZ)
        names.append(XYZ[at] if axis else f"point {k + 1}" if kind == "point" else f"column {k + 1}")
        at += axis
    return read_table(path, bool, Layout(names=names))


def _join(table: Table, log: Table) -> Log:
    """How rows of a log belong to those of a table: by names that it has all of, once each, else by time."""
    for ours in table.names:
        own = {squeeze(text) for text in table.texts(table.names.index(ours))}
        for theirs in log.names:
            texts = [squeeze(text) for text in log.texts(log.names.index(theirs))]
            if (
                len(own) > 1
                and own <= {*texts}
                and len({*texts}) == len(texts)
                and not all(map(is_decimal, own))
            ):
                return Log(file=log.path.name, on=ours, to=None if theirs == ours else theirs)
    on, to = ([name for name in own.names if meaning(name) == "when"] for own in (table, log))
    times = [_times(own, names) for own, names in ((table, on), (log, to))]
    if times[0] is None or times[1] is None:
        raise InputError(log.path, "", f"expected the names, or times, of {table.path.name}")
    apart = np.abs(times[0][:, None] - times[1]).min(axis=1)
    return Log(
        file=log.path.name, on=on, to=None if on == to else to, within_s=max(1.0, np.ceil(2 * apart.max()))
    )


def _times(table: Table, names: list[str]) -> np.ndarray | None:
    parts = [table.texts(table.names.index(name)) for name in names]
    return clock([" ".join(own) for own in zip(*parts, strict=True)])


def _columns(found: Map, table: Table, known: dict[str, list[int]], arm: Arm) -> None:
    """Joints, positions, scatter, mass: which column, in which unit."""
    shift = 1 if "joint 0" in known else 0
    wanted = {f"joint {k + 1 - shift}": f"joint_{k + 1}" for k in range(arm.n_joints)}
    wanted |= (
        {axis: axis for axis in XYZ} if set(XYZ) <= known.keys() else {"axis": "axis", "position": "position"}
    )
    wanted |= {f"{what}_{x}": f"sigma_{x}" for what in ("sigma", "u95") for x in XYZ}
    wanted |= {"mass": "mass", "temperature": "temperature"}
    for theirs, ours in wanted.items():
        if theirs not in known:
            if theirs in XYZ or theirs in ("axis", "position") or theirs.startswith("joint"):
                raise table.header_error(f"no column looks like {ours}; columns are {list(table.names)}")
            continue
        first, *more = known[theirs]
        why = f"{', '.join(repr(table.names[k]) for k in more)} fits too" if more else ""
        unit, guess = _unit(table, first, ours)
        guess = "; ".join(filter(None, (guess, why)))
        key = f"{ours}_{unit}" if unit else ours
        found.add("columns", key, table.names[first], guess)
        if theirs.startswith("u95"):
            found.add("scale", key, 0.5, "taken for two standard deviations, as U95")
    _lost(found, table, [k for x in (*XYZ, "position") for k in known.get(x, [])[:1]])


def _unit(table: Table, k: int, ours: str) -> tuple[str, str]:
    """The unit of a column whose header has none, by its values, and that in words; both empty otherwise."""
    name = table.names[k]
    if split_unit(name) or table.units[k] or ours in ("axis", "temperature"):
        return "", ""
    texts = [text.replace(",", ".") for text in table.texts(k)]
    size = np.abs([float(text) for text in texts if is_decimal(text)] or [0.0])
    if ours.startswith("joint"):
        every = [m for m in range(len(table.names)) if meaning(table.names[m]).startswith("joint")]
        most = max(
            float(t.replace(",", "."))
            for m in every
            for t in table.texts(m)
            if is_decimal(t.replace(",", "."))
        )
        unit = "deg" if most > TURNS else "rad"
        return unit, f"joints up to {most:.4g}"
    if ours == "mass":
        return "kg", "no unit"
    typical = NOISE if ours.startswith("sigma") else REACH
    middle = float(np.median(size)) or 1.0
    unit = min(LENGTHS, key=lambda unit: abs(np.log(middle * LENGTHS[unit] / typical)))
    return unit, f"numbers around {middle:.4g}"


def _lost(found: Map, table: Table, columns: Sequence[int]) -> None:
    """Words in the place of positions are those of lost targets."""
    words = {t for k in columns for t in table.texts(k) if t and not is_decimal(t.replace(",", "."))}
    if words:
        found.add("words", "lost", sorted(words), "no numbers")


def _names(found: Map, table: Table, known: dict[str, list[int]], arm: Arm) -> None:
    """What columns of names say: poses, targets, states, loads, shots."""
    for k in known.get("name", []):
        texts = table.texts(k)
        if len(set(texts)) < 2:
            continue
        name = table.names[k]
        if pattern := _pattern(texts, arm):
            found.add("cells", name, pattern, f"of {texts[0]!r}")
            words = {word for text in texts for word in WORD.findall(text)}
            _states(found, [w for w in words if squeeze(w) in STATES] if "{when}" in pattern else [])
            if "*" in pattern:
                found.add("file", "average", True, "the last number of names counts shots")
        elif {squeeze(text) for text in texts} <= {*STATES}:
            found.add("columns", "state", name)
            _states(found, texts)
        else:
            changes = 1 + sum(a != b for a, b in pairwise(texts))
            if changes > len(set(texts)) and len(set(texts)) <= TARGETS:
                found.add("columns", "marker", name)
                if not {*texts} <= {*arm.markers}:
                    found.add("series", "markers", list(dict.fromkeys(texts)), "no markers of the arm")
            else:
                found.add("columns", "pose", name)
                if changes == len(set(texts)) < len(texts) / 1.5 and "marker" not in found.tables["columns"]:
                    found.add("file", "average", True, "names stand several times in a row: shots")


def _states(found: Map, texts: Sequence[str]) -> None:
    for state in ("before", "after"):
        words = [t for t in dict.fromkeys(texts) if STATES[squeeze(t)] == state]
        if words:
            found.add("words", state, words)


def _pattern(texts: Sequence[str], arm: Arm) -> str:
    """What names of several parts hold, as "P{pose}_{marker}_*"; "" where they have one part that differs."""
    rows = [WORD.findall(text) for text in texts]
    rest = {tuple(WORD.split(text)) for text in texts}
    if len({*map(len, rows)}) > 1 or len(rest) > 1:
        return ""
    parts, holes = [], 0
    markers = {squeeze(name) for name in arm.markers}
    columns = list(zip(*rows, strict=True))
    for k, words in enumerate(columns):
        kinds, part = {squeeze(word) for word in words}, words[0]
        after = columns[k + 1][0] if k + 1 < len(columns) else ""
        if len(kinds) > 1:
            holes += 1
            if kinds <= markers:
                part = "{marker}"
            elif kinds <= {*STATES}:
                part = "{when}"
            elif squeeze(after) in ("kg", "lb"):
                part = f"{{mass_{after.casefold()}}}"
            elif all(re.fullmatch(r"\d+kg", kind) for kind in kinds):
                part = "{mass_kg}kg"
            elif "{pose}" not in parts:
                part = "{pose}"
            elif len(kinds) <= SHOTS:
                part = "*"
            else:
                return ""
        parts.append(part)
    [between] = rest
    whole = "".join(a + b for a, b in zip(between, [*parts, ""], strict=True))
    return whole if holes > 1 else ""
