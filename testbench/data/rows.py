"""What every row of a table says: run, pose, set-up, joints, load; and where which target was.

A reading is one target in one state; a row may hold several.
"""

from dataclasses import dataclass, replace

import numpy as np

from testbench.arm.decimal import is_integer
from testbench.arm.folder import Arm
from testbench.arm.mjcf import GRAVITY, find_body, numbers, read_mjcf
from testbench.data.columns import Column, Columns, axes
from testbench.data.joint_columns import joint_coordinates
from testbench.data.names import DEFLECTION, LOADING, STATES, WHEN, XYZ, Slot, columns_of, squeeze
from testbench.errors import Array, Ids, Mask

SAME_POSE = 1e-6
"""Difference of two joint coordinates up to which two poses are one [rad, m]."""
POSES = "poses are numbered by equal joint angles"


@dataclass(frozen=True)
class Conditions:
    """Of every row of a table."""

    run: Ids | None  #: Identifier, (rows,); None where no column says it.
    pose: Ids  #: Identifier, (rows,).
    named: bool  #: Whether a column says the pose.
    station: Ids | None  #: Set-up of the tracker, (rows,).
    taken_off: Mask | None  #: Whether the load was taken off again before the unloaded reading, (rows,).
    q: Array  #: Joint coordinates, (rows, n) [rad, m].
    wrench: Array  #: Force and moment, world axes, (rows, 6) [N, N m].
    point: Array  #: Where it acts, tool's frame, (rows, 3) [m].
    notes: tuple[str, ...]  #: What was assumed.

    @property
    def loaded(self) -> Mask:
        """Which rows have a load, (rows,)."""
        return np.asarray(self.wrench.any(axis=1))


def read_conditions(columns: Columns, arm: Arm, *, needs_load: bool = True) -> Conditions:
    """Run, pose, set-up, joints and load of every row.

    Args:
        columns: Which column says what.
        arm: The arm that was measured.
        needs_load: Whether a file without any load is refused, rather than of unloaded readings.

    Raises:
        InputError: Names line and column.
    """
    q = joint_coordinates(columns, arm)
    wrench, load_notes = _wrench(columns, needed=needs_load)
    point, point_notes = _point(columns, arm)
    notes = [*load_notes, *(point_notes if wrench.any() else [])]
    ids: dict[str, Ids | None] = {}
    for what in (Slot("run"), Slot("pose"), Slot("station")):
        column = columns.get(what)
        ids[what.what], said = (None, "") if column is None else identifiers(columns, column)
        notes += [said] * bool(said)
    pose, named = ids["pose"], ids["pose"] is not None
    if pose is None:
        pose = same_poses(q)
        notes.append(f"{POSES}: {len(np.unique(pose))} of them")
    taken_off = _taken_off(columns)
    return Conditions(ids["run"], pose, named, ids["station"], taken_off, q, wrench, point, tuple(notes))


def _taken_off(columns: Columns) -> Mask | None:
    """What a column says of the loading, (rows,); blank is a load put on."""
    column = columns.get(Slot("loading"))
    if column is None:
        return None
    texts = columns.table.texts(column.index)
    wrong = np.array([squeeze(text) not in ("", *LOADING) for text in texts], dtype=bool)
    columns.table.refuse(
        wrong, column.name, lambda row: f"expected {' or '.join(LOADING)}, got {texts[row][:80]!r}"
    )
    return np.array([squeeze(text) == LOADING[1] for text in texts], dtype=bool)


def identifiers(columns: Columns, column: Column) -> tuple[Ids, str]:
    """Integers as they stand there; names by the number in each, or numbered in their order."""
    if columns.table.counts(column.index):
        return columns.table.integers(column.index), ""
    texts = columns.table.texts(column.index)
    names = list(dict.fromkeys(texts))
    if "" in names or any(map(is_integer, names)):
        return columns.table.integers(column.index), ""
    digits = ["".join(c for c in name if c in "0123456789") for name in names]
    plain = all(map(is_integer, digits)) and len({int(d) for d in digits}) == len(names)
    plain = plain and not any(set(".,") & set(name) for name in names)
    number = {name: int(digits[k]) if plain else k + 1 for k, name in enumerate(names)}
    few = ", ".join(f"{name[:20]!r} is {number[name]}" for name in names[:3])
    what = column.slot.what
    return np.array([number[text] for text in texts], dtype=int), f"{what}s have names: {few}"


def same_poses(q: Array) -> Ids:
    """Poses numbered from 1 as they first appear, (rows,): equal in every joint."""
    labels = np.zeros(q.shape, dtype=int)
    for k, own in enumerate(q.T):
        order = np.argsort(own, kind="stable")
        labels[order, k] = np.cumsum(np.diff(own[order], prepend=own[order[:1]]) > SAME_POSE)
    return number_rows(labels) + 1


def number_rows(*parts: Array | Ids | Mask | None) -> Ids:
    """Rows equal in all parts, (rows,) or (rows, k), by one number each, from 0 as they first appear."""
    known = [part.reshape(len(part), -1) for part in parts if part is not None]
    code = np.zeros(len(known[0]), dtype=int)
    for column in (column for part in known for column in part.T):
        own, more = np.unique(column, return_inverse=True)
        code = np.unique(code * len(own) + more.reshape(-1), return_inverse=True)[1].reshape(-1)
    _, first, code = np.unique(code, return_index=True, return_inverse=True)
    place = np.empty(len(first), dtype=int)
    place[np.argsort(first, kind="stable")] = np.arange(len(first))
    return np.asarray(place[code.reshape(-1)])


def first_rows(code: Ids) -> Ids:
    """The first row of every group, (groups,), of groups numbered as they first appear."""
    return np.unique(code, return_index=True)[1]


def repeats(*parts: Ids) -> Ids:
    """How many rows that are equal in all parts stand before each row, (rows,)."""
    code = number_rows(*parts)
    order = np.argsort(code, kind="stable")
    size = np.bincount(code)
    found = np.empty(len(code), dtype=int)
    found[order] = np.arange(len(code)) - np.repeat(np.cumsum(size) - size, size)
    return found


def _wrench(columns: Columns, *, needed: bool) -> tuple[Array, list[str]]:
    """Load of every row, (rows, 6) [N, N m]; a blank cell of an unloaded reading is no load."""
    table, hung = columns.table, columns.said(Slot("mass"))
    acting = [*axes(columns, "force"), *axes(columns, "moment")]
    acts = any(own is not None for own in acting)
    told = columns.names.load if hung is None and not acts else None
    hung = hung if told is None else told
    if acts == (hung is not None):
        if not acts and not needed:
            return np.zeros((table.rows, 6)), ["no column says a load: the arm has its own weight alone"]
        if not acts:
            hint = "; one for the whole file stands in [values] of a map, as mass_kg = 150; "
            hint += "absolute readings without a load are for `testbench calibrate`"
            raise columns.lack(["mass_kg (or force_x_N, force_y_N, force_z_N)"], hint)
        raise table.header_error("expected a mass or forces, got both")
    if not acts:
        kg = _load(columns, hung)
        name = hung.name if isinstance(hung, Column) else ""
        table.refuse(kg < 0, name, lambda row: f"expected a mass of at least 0 kg, got {kg[row]:g}")
        weight = np.zeros((table.rows, 6))
        weight[:, 2] = -GRAVITY * kg
        notes = (
            [f"no column says a mass: {told:g} kg in loaded rows, as was said"] if told is not None else []
        )
        return weight, [*notes, "the mass hangs: force along z = -9.81 m/s2 times the mass, world axes"]
    names = [f"{what}_{x}" for what in ("force", "moment") for x in XYZ]
    zero = [name for name, own in zip(names, acting, strict=True) if own is None]
    wrench = np.column_stack([_load(columns, own) for own in acting])
    return wrench, [f"{', '.join(zero)}: no column, taken as 0"] if zero else []


def _load(columns: Columns, own: Column | float | None) -> Array:
    """A component of the load, (rows,): zero in an unloaded row, and where nothing says of a blank mass."""
    values = columns.values(own) if isinstance(own, Column) else columns.every_row(own)
    state = columns.get(Slot("state"))
    idle = np.zeros(len(values), dtype=bool)
    if state is not None:
        words = columns.table.texts(state.index)
        idle = np.array([columns.names.word(word, WHEN) == "before" for word in words], dtype=bool)
    elif (
        isinstance(own, Column)
        and own.slot.what == "mass"
        and not any(c.slot.when for c in columns.every("reading"))
    ):
        idle = np.isnan(values)  # nothing hangs
    problem = "expected a finite number in a loaded row, got ''"
    columns.table.refuse(np.isnan(values) & ~idle, own.name if isinstance(own, Column) else "", problem)
    return np.where(idle, 0.0, values)


def load_point(arm: Arm) -> Array:
    """The arm's load point in the tool's frame, (3,) [m]: its body is a child of the tool's."""
    body = find_body(arm.rigid, read_mjcf(arm.rigid), arm.load)
    return np.array(numbers(arm.rigid, body, "pos", 3) if "pos" in body.attrib else [0.0] * 3)


def _point(columns: Columns, arm: Arm) -> tuple[Array, list[str]]:
    """Where the load acts, (rows, 3) [m]."""
    found, rows = axes(columns, "point"), columns.table.rows
    if all(own is None for own in found):
        return np.tile(load_point(arm), (rows, 1)), [f"the load acts at the arm's load point {arm.load}"]
    return np.column_stack([columns.every_row(own) for own in found]), []


@dataclass(frozen=True)
class Readings:
    """All readings of a file, one marker in one state each."""

    markers: tuple[str, ...]  #: Names, in the order in which they first appear.
    row: Ids  #: Row of the table, (s,).
    marker: Ids  #: Index of the marker, (s,).
    after: Mask  #: Whether the arm was loaded, (s,).
    position: Array  #: Where the target was, (s, 3) [m]; NaN where it was lost.
    long: bool  #: Whether a column of markers says which target a row is of.
    paired: bool  #: Whether both states stand in one row.


def placed(read: Readings, code: Ids, some: Mask | slice = slice(None)) -> Array:
    """Some readings by their group and marker, (groups, m, 3) [m]; NaN where there are none.

    Args:
        read: The readings.
        code: The group of every row, (rows,).
        some: Which of them.
    """
    found: Array = np.full((int(code.max()) + 1, len(read.markers), 3), np.nan)
    found[code[read.row[some]], read.marker[some]] = read.position[some]
    return found


def markers_only(columns: Columns) -> tuple[Columns, list[str]]:
    """Without the rows of points that the map calls no markers, and that in words.

    Raises:
        InputError: Where there are no rows.
    """
    table, column = columns.table, columns.get(Slot("marker"))
    if not table.rows:
        raise table.error(0, "", "expected at least one row")
    if column is None or not columns.names.ignored:
        return columns, []
    other = np.array([squeeze(text) in columns.names.ignored for text in table.texts(column.index)])
    words = f"{other.sum()} rows of points that the map calls no markers are left out"
    return replace(columns, table=table.take(~other)), [words] * bool(other.any())


def read_readings(columns: Columns, arm: Arm, loaded: Mask) -> Readings:
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
    return Readings(kept, row, marker, loaded, position, long, paired)


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
        missing = [name for when in WHEN for name in columns_of("reading", when)]
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
    return _said(columns, column, arm.markers, f"in {arm.name}; markers are {', '.join(arm.markers)}")


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
    found = [ours[text] for text in texts]
    bad = np.array([not text for text in found], dtype=bool)
    if unsaid is not None:
        bad &= ~unsaid
    columns.table.refuse(bad, column.name, lambda row: f"no {column.slot.what} {texts[row][:80]!r} {hint}")
    return found


def _positions(columns: Columns, triple: list[Column]) -> Array:
    """Where a target was, (rows, 3) [m]; NaN where all three cells are blank.

    Three equal coordinates, as 9999 or 0, are refused: instruments write so for a lost target.
    """
    found, _ = columns.together(triple)
    if triple[0].slot.when != DEFLECTION:
        table, first = columns.table, triple[0]

        def problem(row: int) -> str:
            text = table.texts(first.index)[row]
            hint = f'for a lost target say so in the map: [words] lost = "{text}"'
            return f"expected a place, got {text!r} three times; {hint}"

        table.refuse((found == found[:, :1]).all(axis=1), first.name, problem)
    return found
