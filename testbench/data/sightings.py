"""Single readings of a file: which row, which marker, unloaded or loaded, and where the target was."""

from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.columns import Column, Columns
from testbench.data.dataset import Ids, Mask
from testbench.data.names import DEFLECTION, STATES, WHEN, XYZ, Slot, squeeze
from testbench.errors import Array


@dataclass(frozen=True)
class Sightings:
    """All readings of a file, one marker in one state each."""

    markers: tuple[str, ...]  #: Names, in the order in which they first appear.
    row: Ids  #: Row of the table, (s,).
    marker: Ids  #: Index of the marker, (s,).
    after: Mask  #: Whether the arm was loaded, (s,).
    position: Array  #: Where the target was, (s, 3) [m]; NaN where it was lost.
    long: bool  #: Whether a column of markers says which target a row is of.
    paired: bool  #: Whether both states stand in one row.


def drop_other_points(columns: Columns) -> tuple[Columns, int]:
    """Without the rows of points that the map calls no markers, and how many these are."""
    column = columns.get(Slot("marker"))
    if column is None or not columns.names.ignored:
        return columns, 0
    other = np.array([squeeze(text) in columns.names.ignored for text in columns.table.texts(column.index)])
    return replace(columns, table=columns.table.take(~other)), int(other.sum())


def read_sightings(columns: Columns, arm: Arm, loaded: Mask) -> Sightings:
    """All readings of a table; where no column says the state, the load of the row, (rows,), does.

    Raises:
        InputError: Names line and column.
    """
    blocks = _blocks(columns)
    everyone = np.arange(columns.table.rows)
    long = "" in {marker for marker, _ in blocks}
    names = _markers(columns, arm) if long else None
    kept = tuple(dict.fromkeys(names if names is not None else [marker for marker, _ in blocks]))
    place = {name: k for k, name in enumerate(kept)}
    paired = all(when for _, when in blocks)
    state = None if paired else _states(columns, loaded)
    parts = []
    for (name, when), triple in blocks.items():
        own = np.array([place[n] for n in names or [name] * len(everyone)])
        after = np.full(len(everyone), when != "before") if state is None else state
        position = _positions(columns, triple)
        if when == DEFLECTION:
            position = position + _positions(columns, blocks[name, "before"])
        parts.append((everyone, own, after, position))
    row, marker, loaded, position = (np.concatenate(x) for x in zip(*parts, strict=True))
    return Sightings(kept, row, marker, loaded, position, long, paired)


def _blocks(columns: Columns) -> dict[tuple[str, str], list[Column]]:
    """Three columns by marker and state."""
    found: dict[tuple[str, str], dict[int, Column]] = {}
    for column in columns.every("reading"):
        found.setdefault((column.slot.marker, column.slot.when), {})[column.slot.index] = column
    missing = [
        "_".join(filter(None, (marker, when, XYZ[k], "m")))
        for (marker, when), triple in found.items()
        for k in range(3)
        if k not in triple
    ]
    if not found:
        missing = [f"{when}_{axis}_m" for when in WHEN for axis in XYZ]
    for marker, when in found:
        others = ("after", DEFLECTION) if when == "before" else ("before",)
        if when and not any((marker, other) in found for other in others):
            missing += ["_".join(filter(None, (marker, others[0], axis, "m"))) for axis in XYZ]
    if missing:
        raise columns.lack(missing)
    return {key: [triple[k] for k in range(3)] for key, triple in found.items()}


def _markers(columns: Columns, arm: Arm) -> list[str]:
    """The marker of every row."""
    column, table = columns.get(Slot("marker")), columns.table
    if column is None:
        if len(arm.markers) == 1:
            return [arm.markers[0]] * table.rows
        raise columns.lack(["marker"])
    have = ", ".join(arm.markers)
    return _said(columns, column, arm.markers, f"in {arm.name}; markers are {have}")


def _states(columns: Columns, loaded: Mask) -> Mask:
    """Which rows are loaded, (rows,)."""
    column = columns.get(Slot("state"))
    if column is None:
        return loaded
    have = ", ".join(word for words in STATES.values() for word in words)
    blank = columns.table.blank(column.index)
    said = _said(columns, column, WHEN, f"is known; states are {have}", blank)
    return np.where(blank, loaded, np.array([word == "after" for word in said], dtype=bool))


def _said(
    columns: Columns, column: Column, known: tuple[str, ...], hint: str, unsaid: Mask | None = None
) -> list[str]:
    """What the cells of a column of words say in our words; under the mask `unsaid` they may say nothing."""
    texts = columns.table.texts(column.index)
    ours = {text: columns.names.word(text, known) for text in dict.fromkeys(texts)}
    for row, text in enumerate(texts):
        if not ours[text] and (unsaid is None or not unsaid[row]):
            problem = f"no {column.slot.what} {text[:80]!r} {hint}"
            raise columns.table.error(row, column.name, problem)
    return [ours[text] for text in texts]


def _positions(columns: Columns, triple: list[Column]) -> Array:
    """Where a target was, (rows, 3) [m]; NaN where all three cells are blank."""
    found = np.column_stack([columns.values(column) for column in triple])
    blank = np.isnan(found)
    part = np.argwhere(blank & ~blank.all(axis=1, keepdims=True))
    if len(part):
        row, k = part[0]
        raise columns.table.error(row, triple[k].name, "expected a finite number, got ''")
    if triple[0].slot.when != DEFLECTION:
        _check_places(columns, triple, found)
    return found


def _check_places(columns: Columns, triple: list[Column], found: Array) -> None:
    """Refuse three equal coordinates, as 9999 or 0: instruments write so for a lost target."""
    equal = np.flatnonzero((found == found[:, :1]).all(axis=1))
    if len(equal):
        text = columns.table.texts(triple[0].index)[equal[0]]
        problem = f"expected a place, got {text!r} three times; for a lost target say so in the map: "
        raise columns.table.error(equal[0], triple[0].name, f'{problem}[words] lost = "{text}"')
