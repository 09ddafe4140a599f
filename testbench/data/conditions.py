"""Under what the readings of a row were taken: run, pose, set-up, joints, load."""

from dataclasses import dataclass

import numpy as np

from testbench.arm.decimal import is_integer
from testbench.arm.folder import Arm
from testbench.arm.mjcf import GRAVITY, find_body, numbers, read_mjcf
from testbench.data.columns import Column, Columns, axes, joint_coordinates
from testbench.data.dataset import Ids, Mask
from testbench.data.names import WHEN, Slot
from testbench.errors import Array, InputError

SAME_POSE = 1e-6
"""Difference of two joint coordinates up to which two poses are one [rad, m]."""


@dataclass(frozen=True)
class Conditions:
    """Of every row of a table."""

    run: Ids | None  #: Identifier, (rows,); None where no column says it.
    pose: Ids  #: Identifier, (rows,).
    named: bool  #: Whether a column says the pose.
    station: Ids | None  #: Set-up of the tracker, (rows,).
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
        notes.append(f"poses are numbered by equal joint angles: {len(np.unique(pose))} of them")
    return Conditions(ids["run"], pose, named, ids["station"], q, wrench, point, tuple(notes))


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


def number_rows(values: Array | Ids) -> Ids:
    """Equal rows of a table by one number, from 0 as they first appear, (rows,)."""
    code = np.zeros(len(values), dtype=int)
    for column in values.T:
        own, more = np.unique(column, return_inverse=True)
        code = np.unique(code * len(own) + more.reshape(-1), return_inverse=True)[1].reshape(-1)
    _, first, code = np.unique(code, return_index=True, return_inverse=True)
    place = np.empty(len(first), dtype=int)
    place[np.argsort(first, kind="stable")] = np.arange(len(first))
    return np.asarray(place[code.reshape(-1)])


def _wrench(columns: Columns, *, needed: bool) -> tuple[Array, list[str]]:
    """Load of every row, (rows, 6) [N, N m]; a blank cell of an unloaded reading is no load."""
    mass, constant = columns.get(Slot("mass")), columns.constant(Slot("mass"))
    vectors = [axes(columns, what) for what in ("force", "moment")]
    stated = [[columns.constant(Slot(what, k)) for k in range(3)] for what in ("force", "moment")]
    acts = any(c is not None for v in vectors for c in v) or any(x is not None for v in stated for x in v)
    has_mass = mass is not None or constant is not None
    table = columns.table
    if acts == has_mass:
        if not acts and not needed:
            return np.zeros((table.rows, 6)), ["no column says a load: the arm has its own weight alone"]
        if not acts:
            hint = "; one for the whole file stands in [values] of a map, as mass_kg = 150"
            raise columns.lack(["mass_kg (or force_x_N, force_y_N, force_z_N)"], hint)
        raise InputError(table.path, f"line {table.header}", "expected a mass or forces, got both")
    wrench = np.zeros((table.rows, 6))
    if has_mass:
        kg = _load(columns, mass) if mass else np.full(table.rows, constant)
        low = np.flatnonzero(kg < 0)
        if len(low):
            raise table.error(
                low[0], mass.name if mass else "", f"expected a mass of at least 0 kg, got {kg[low[0]]:g}"
            )
        wrench[:, 2] = -GRAVITY * kg
        return wrench, ["the mass hangs: force along z = -9.81 m/s2 times the mass, world axes"]
    zero = []
    for i, what in enumerate(("force", "moment")):
        for k in range(3):
            column, value = vectors[i][k], stated[i][k]
            wrench[:, 3 * i + k] = _load(columns, column) if column else value or 0.0
            zero += [f"{what}_{'xyz'[k]}"] * (column is None and value is None)
    return wrench, [f"{', '.join(zero)}: no column, taken as 0"] if zero else []


def _load(columns: Columns, column: Column) -> Array:
    """A component of the load, (rows,): zero in an unloaded row, and where nothing says of a blank mass."""
    values, state = columns.values(column), columns.get(Slot("state"))
    idle = np.zeros(len(values), dtype=bool)
    if state is not None:
        words = columns.table.texts(state.index)
        idle = np.array([columns.names.word(word, WHEN) == "before" for word in words], dtype=bool)
    elif column.slot.what == "mass" and not any(c.slot.when for c in columns.every("reading")):
        idle = np.isnan(values)  # nothing hangs
    bare = np.flatnonzero(np.isnan(values) & ~idle)
    if len(bare):
        raise columns.table.error(bare[0], column.name, "expected a finite number in a loaded row, got ''")
    return np.where(idle, 0.0, values)


def load_point(arm: Arm) -> Array:
    """The arm's load point in the tool's frame, (3,) [m]: its body is a child of the tool's."""
    body = find_body(arm.rigid, read_mjcf(arm.rigid), arm.load)
    return np.array(numbers(arm.rigid, body, "pos", 3) if "pos" in body.attrib else [0.0] * 3)


def _point(columns: Columns, arm: Arm) -> tuple[Array, list[str]]:
    """Where the load acts, (rows, 3) [m]."""
    found, rows = axes(columns, "point"), columns.table.rows
    stated = [columns.constant(Slot("point", k)) for k in range(3)]
    if not any(found) and all(x is None for x in stated):
        return np.tile(load_point(arm), (rows, 1)), [f"the load acts at the arm's load point {arm.load}"]
    parts = [columns.full(c) if c else np.full(rows, x) for c, x in zip(found, stated, strict=True)]
    return np.column_stack(parts), []
