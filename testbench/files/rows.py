"""Conditions of every row of a table: run, pose, station, joints, load."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.arm.document import is_integer
from testbench.arm.folder import Arm
from testbench.arm.joint_map import ArmJoint
from testbench.arm.mjcf import GRAVITY, find_body, numbers, read_mjcf
from testbench.errors import Array, Ids, Mask
from testbench.files.columns import Columns, ReadColumn, axes, numbered_joints
from testbench.files.names import LOADING, WHEN, XYZ, Slot, looks_like, squeeze

SAME_POSE = 1e-6
"""Largest difference of joint coordinates in one pose [rad, m]."""
ROUNDED = 1e-4
"""Excess over a limit that rounding in a file explains; the coordinate is then set to the limit [rad, m]."""
POSES_BY_ANGLES = "poses are numbered by equal joint angles"
SUSPECT = {"rad": (2.5 * np.pi, "degrees"), "m": (10.0, "millimetres")}
"""Coordinates that only another unit explains, and that unit."""


@dataclass(frozen=True)
class RowConditions:
    """Hold the conditions of every row of a table."""

    run: Ids | None  #: Identifier of the run, (rows,); None if no column states it.
    pose: Ids  #: Identifier of the pose, (rows,).
    named: bool  #: Whether a column states the pose.
    station: Ids | None  #: Station of the tracker, (rows,).
    taken_off: Mask | None  #: Whether the load was taken off before the unloaded reading, (rows,).
    q: Array  #: Joint coordinates, (rows, n) [rad, m].
    wrench: Array  #: Force and moment, world axes, (rows, 6) [N, N m].
    point: Array  #: Point where the load acts, tool's frame, (rows, 3) [m].
    notes: tuple[str, ...]  #: Assumptions that were made.

    @property
    def loaded(self) -> Mask:
        """Tell which rows have a load, (rows,)."""
        return np.asarray(self.wrench.any(axis=1))


def read_conditions(columns: Columns, arm: Arm, *, needs_load: bool = True) -> RowConditions:
    """Read run, pose, station, joints and load of every row.

    Args:
        columns: The columns of the file.
        arm: The arm that was measured.
        needs_load: Whether a file without any load is refused; otherwise all of its readings are unloaded.

    Returns:
        The conditions.

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
        notes.append(f"{POSES_BY_ANGLES}: {len(np.unique(pose))} of them")
    taken_off = _taken_off(columns)
    return RowConditions(ids["run"], pose, named, ids["station"], taken_off, q, wrench, point, tuple(notes))


def _taken_off(columns: Columns) -> Mask | None:
    """Read the column of loading, (rows,); blank is a load put on."""
    column = columns.get(Slot("loading"))
    if column is None:
        return None
    texts = columns.table.texts(column.index)
    wrong = np.array([squeeze(text) not in ("", *LOADING) for text in texts], dtype=bool)
    columns.table.refuse(
        wrong, column.name, lambda row: f"expected {' or '.join(LOADING)}, got {texts[row][:80]!r}"
    )
    return np.array([squeeze(text) == LOADING[1] for text in texts], dtype=bool)


def identifiers(columns: Columns, column: ReadColumn) -> tuple[Ids, str]:
    """Read a column of identifiers as integers.

    Names are replaced by the number that each contains, or else by 1, 2, ... in the order of the file.

    Args:
        columns: The columns of the file.
        column: The column.

    Returns:
        Identifiers, (rows,), and a note on replaced names; "" if there is none.

    Raises:
        InputError: If numbers and names are mixed, or a cell is blank.
    """
    if (counted := columns.table.counts(column.index)) is not None:
        return counted, ""
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
    """Number poses in order of appearance; two are the same if they agree in every joint.

    Args:
        q: Actuated joints, (rows, n) [rad, m].

    Returns:
        Number of the pose of every row, from 1, (rows,).
    """
    labels = np.zeros(q.shape, dtype=int)
    for k, own in enumerate(q.T):
        order = np.argsort(own, kind="stable")
        labels[order, k] = np.cumsum(np.diff(own[order], prepend=own[order[:1]]) > SAME_POSE)
    return number_rows(labels) + 1


def number_rows(*parts: Array | Ids | Mask | None) -> Ids:
    """Number the groups of equal rows in order of appearance.

    Args:
        parts: Arrays that are compared together, (rows,) or (rows, k) each; None is left out.

    Returns:
        Group of every row, from 0, (rows,).
    """
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
    """Find the first row of every group.

    Args:
        code: Group of every row, numbered in order of appearance, (rows,).

    Returns:
        Index of the first row, (groups,).
    """
    return np.unique(code, return_index=True)[1]


def repeats(*parts: Ids) -> Ids:
    """Count the earlier rows that are equal to each row in all parts.

    Args:
        parts: Arrays that are compared together, (rows,) each.

    Returns:
        The counts, (rows,).
    """
    code = number_rows(*parts)
    order = np.argsort(code, kind="stable")
    size = np.bincount(code)
    found = np.empty(len(code), dtype=int)
    found[order] = np.arange(len(code)) - np.repeat(np.cumsum(size) - size, size)
    return found


def _wrench(columns: Columns, *, needed: bool) -> tuple[Array, list[str]]:
    """Read the load of every row, (rows, 6) [N, N m]; a blank cell of an unloaded reading is no load."""
    table, hung = columns.table, columns.source_of(Slot("mass"))
    acting = [*axes(columns, "force"), *axes(columns, "moment")]
    acts = any(own is not None for own in acting)
    told = columns.names.load if hung is None and not acts else None
    hung = hung if told is None else told
    if acts == (hung is not None):
        if not acts and not needed:
            return np.zeros((table.rows, 6)), ["no column gives a load: only own weight is assumed"]
        if not acts:
            hint = "; one for the whole file is said by --load, or in [values] of a map, as mass_kg = 150; "
            hint += "absolute readings without a load are for `testbench calibrate`"
            if own := [name for name in columns.ignored if looks_like(name, "forces")]:
                hint = f"; {', '.join(own[:6])}: forces in world axes are named in [columns] of a map, as "
                hint += 'force_x = "Fx"; a mass by --load'
            raise columns.lack(["mass_kg (or force_x_N, force_y_N, force_z_N)"], hint)
        raise table.header_error("expected a mass or forces, got both")
    if not acts:
        kg = _load(columns, hung)
        name = hung.name if isinstance(hung, ReadColumn) else ""
        table.refuse(kg < 0, name, lambda row: f"expected a mass of at least 0 kg, got {kg[row]:g}")
        weight = np.zeros((table.rows, 6))
        weight[:, 2] = -GRAVITY * kg
        notes = (
            [f"no column says a mass: {told:g} kg in loaded rows, as was said"] if told is not None else []
        )
        return weight, [
            *notes,
            "the load is a hung mass: its force is -9.81 m/s2 times the mass along the world's z",
        ]
    names = [f"{what}_{x}" for what in ("force", "moment") for x in XYZ]
    zero = [name for name, own in zip(names, acting, strict=True) if own is None]
    wrench = np.column_stack([_load(columns, own) for own in acting])
    return wrench, [f"{', '.join(zero)}: no column, taken as 0"] if zero else []


def _load(columns: Columns, own: ReadColumn | float | None) -> Array:
    """Read a component of the load, (rows,): zero in an unloaded row and for a blank mass."""
    values = columns.values(own) if isinstance(own, ReadColumn) else columns.values_of(own)
    state = columns.get(Slot("state"))
    idle = np.zeros(len(values), dtype=bool)
    if state is not None:
        words = columns.table.texts(state.index)
        idle = np.array([columns.names.word(word, WHEN) == "before" for word in words], dtype=bool)
    elif (
        isinstance(own, ReadColumn)
        and own.slot.what == "mass"
        and not columns.table.sheet  # a formula without its result
        and not any(c.slot.when for c in columns.all_of("reading"))
    ):
        idle = np.isnan(values)  # nothing hangs
    hint = "; say 0 where nothing hangs" if columns.table.sheet else ""
    problem = f"expected a finite number in a loaded row, got ''{hint}"
    columns.table.refuse(np.isnan(values) & ~idle, own.name if isinstance(own, ReadColumn) else "", problem)
    return np.where(idle, 0.0, values)


def load_point(arm: Arm) -> Array:
    """Find the arm's load point; its body is a child of the tool's.

    Args:
        arm: The arm.

    Returns:
        The point in the tool's frame, (3,) [m].

    Raises:
        InputError: When rigid.xml has no such body, or its position is not three numbers.
    """
    body = find_body(arm.rigid, read_mjcf(arm.rigid), arm.load)
    return np.array(numbers(arm.rigid, body, "pos", 3) if "pos" in body.attrib else [0.0] * 3)


def _point(columns: Columns, arm: Arm) -> tuple[Array, list[str]]:
    """Read the point where the load acts, (rows, 3) [m]."""
    found, rows = axes(columns, "point"), columns.table.rows
    if all(own is None for own in found):
        return np.tile(load_point(arm), (rows, 1)), [f"the load acts at the arm's load point, {arm.load!r}"]
    return np.column_stack([columns.values_of(own) for own in found]), []


def joint_coordinates(columns: Columns, arm: Arm) -> Array:
    """Read the joint coordinates of the arm's chain, within its limits.

    Args:
        columns: The columns of the file.
        arm: The arm.

    Returns:
        Joint coordinates, (rows, n) [rad, m].

    Raises:
        InputError: Names line and column.
    """
    joints = arm.file_joints
    found = [columns.source_of(Slot("joint", k)) for k in range(len(joints))]
    units = {own.unit.si: own.unit.name for own in found if isinstance(own, ReadColumn) and own.unit}
    missing = [
        f"{joint.name}_{units.get(joint.unit, joint.unit)}"
        for joint, own in zip(joints, found, strict=True)
        if own is None
    ]
    if missing:
        hint = numbered_joints(columns.ignored, len(joints))
        raise columns.lack(missing, hint and f"{hint}; testbench data check proposes a map")
    none = np.empty((columns.table.rows, 0))  # an arm may have no joints
    q = np.column_stack([none, *(columns.values_of(own) for own in found)])
    _check_limits(columns, joints, q)
    q = arm.to_model(q)
    _check_chain(columns, arm, q)
    ends = arm.clip_to_limits(q)
    return np.where(np.abs(q - ends) > SAME_POSE, ends, q)


def _check_chain(columns: Columns, arm: Arm, q: Array) -> None:
    """Refuse poses, (rows, n) [rad, m], in which a joint of the chain is beyond its limits."""
    if arm.joint_map is None:
        return  # its limits are those of the file's joints
    lower, upper = arm.limits
    for i, k in np.argwhere((q < lower - ROUNDED) | (q > upper + ROUNDED))[:1]:
        joint = arm.joints[k]
        low, high, got = (joint.shown * x for x in (joint.lower, joint.upper, q[i, k]))
        limits = f"expected {low:.4f} to {high:.4f} {joint.shown_unit}, got {got:.4f}"
        problem = f"{joint.name} of the arm, in file joints {arm.joint_map.sum_text(int(k))}: {limits}"
        raise columns.table.error(i, "", problem)


def _check_limits(columns: Columns, joints: Sequence[ArmJoint], q: Array) -> None:
    """Refuse file joints beyond their limits, with a hint if another unit or sign would fit."""
    lower, upper = (np.array([getattr(joint, end) for joint in joints]) for end in ("lower", "upper"))
    bad = np.argwhere((q < lower - ROUNDED) | (q > upper + ROUNDED))
    if not len(bad):
        return
    i, k = bad[0]
    joint, column = joints[k], columns.get(Slot("joint", int(k)))
    unit = column.unit if column else None
    name, scale = (unit.name, unit.scale) if unit else (joint.unit, 1.0)
    alike = [other.prismatic == joint.prismatic for other in joints]
    most, suspect = SUSPECT[joint.unit]
    hint = f"; are these {suspect}?" if name == joint.unit and np.abs(q[:, alike]).max() > most else ""
    hint = hint or _other_columns(columns, joints, q, int(k))
    low, high, got = (x / scale for x in (joint.lower, joint.upper, q[i, k]))
    problem = f"expected {low:.4f} to {high:.4f} {name}, got {got:g}{hint}"
    raise columns.table.error(i, column.name if column else joint.name, problem)


def _other_columns(columns: Columns, joints: Sequence[ArmJoint], q: Array, k: int) -> str:
    """Find what brings a joint's column within the limits: the other sign, or another joint's column."""
    lower, upper = (np.array([getattr(joint, end) for joint in joints]) for end in ("lower", "upper"))
    found = list[str]()

    def within(some: Sequence[int], values: Array) -> bool:
        return bool(((values >= lower[some] - ROUNDED) & (values <= upper[some] + ROUNDED)).all())

    own, *others = (columns.get(Slot("joint", m)) for m in [k, *range(len(joints))])
    if own is None:
        return ""
    if within([k], -q[:, [k]]):
        other = own.name if own.sign < 0 else f"-{own.name}"
        found.append(f"with the other sign ([columns] of a map reads it so as {other!r})")
    for m, column in enumerate(others):
        alike = m != k and joints[m].prismatic == joints[k].prismatic
        if column and alike and within([k, m], q[:, [m, k]]):
            found.append(f"with {own.name!r} and {column.name!r} exchanged")
    return f"; all rows are within {', or '.join(found)}" if found else ""
