"""Joint coordinates of a table, and what is likely wrong with those beyond the arm's limits."""

from collections.abc import Sequence

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.columns import Column, Columns
from testbench.data.names import Slot, split_unit
from testbench.errors import Array

SUSPECT = {"rad": (2.5 * np.pi, "degrees"), "m": (10.0, "millimetres")}
"""Coordinates that only another unit explains, and that unit."""


def joint_coordinates(columns: Columns, arm: Arm) -> Array:
    """Joint coordinates within the arm's limits, (rows, n) [rad, m].

    Raises:
        InputError: Names line and column.
    """
    found = [columns.said(Slot("joint", k)) for k in range(arm.n_joints)]
    units = {own.unit.si: own.unit.name for own in found if isinstance(own, Column) and own.unit}
    missing = [
        f"{joint.name}_{units.get(joint.unit, joint.unit)}"
        for joint, own in zip(arm.joints, found, strict=True)
        if own is None
    ]
    if missing:
        raise columns.lack(missing, _numbered(columns.ignored, arm.n_joints))
    none = np.empty((columns.table.rows, 0))  # an arm may have no joints
    q = np.column_stack([none, *(columns.every_row(own) for own in found)])
    _check_limits(columns, arm, q)
    return q


def _numbered(ignored: Sequence[str], count: int) -> str:
    """The line of a map for columns that are numbered as the joints are; empty where there are none."""
    units = dict(split_unit(name) or (name, None) for name in ignored)
    for name, unit in units.items():
        before, one, after = name.rpartition("1")
        if one and all(f"{before}{k}{after}" in units for k in range(1, count)):
            n = "{n}" if f"{before}{count}{after}" in units else "{n0}"
            if n == "{n0}" and f"{before}0{after}" not in units:
                continue
            ours = f"joint_{n}_{unit.name if unit else 'deg'}"
            return f"""; are they joints? [columns] of a map: "{ours}" = "{before}{n}{after}\""""
    return ""


def _check_limits(columns: Columns, arm: Arm, q: Array) -> None:
    """Refuse what is beyond the arm's limits; degrees are the first suspect."""
    lower, upper = arm.limits
    bad = np.argwhere((q < lower - 1e-6) | (q > upper + 1e-6))
    if not len(bad):
        return
    i, k = bad[0]
    joint, column = arm.joints[k], columns.get(Slot("joint", k))
    unit = column.unit if column else None
    name, scale = (unit.name, unit.scale) if unit else (joint.unit, 1.0)
    alike = [other.prismatic == joint.prismatic for other in arm.joints]
    most, suspect = SUSPECT[joint.unit]
    hint = f"; are these {suspect}?" if name == joint.unit and np.abs(q[:, alike]).max() > most else ""
    hint = hint or _other_columns(columns, arm, q, int(k))
    low, high, got = (x / scale for x in (joint.lower, joint.upper, q[i, k]))
    problem = f"expected {low:.4f} to {high:.4f} {name}, got {got:g}{hint}"
    raise columns.table.error(i, column.name if column else joint.name, problem)


def _other_columns(columns: Columns, arm: Arm, q: Array, k: int) -> str:
    """What brings a joint's column within the limits: the other sign, or another joint's column."""
    (lower, upper), found = arm.limits, list[str]()

    def within(joints: Sequence[int], values: Array) -> bool:
        return bool(((values >= lower[joints]) & (values <= upper[joints])).all())

    own, *others = (columns.get(Slot("joint", m)) for m in [k, *range(arm.n_joints)])
    if own is None:
        return ""
    if within([k], -q[:, [k]]):
        other = own.name if own.sign < 0 else f"-{own.name}"
        found.append(f"with the other sign ([columns] of a map reads it so as {other!r})")
    for m, column in enumerate(others):
        alike = m != k and arm.joints[m].prismatic == arm.joints[k].prismatic
        if column and alike and within([k, m], q[:, [m, k]]):
            found.append(f"with {own.name!r} and {column.name!r} exchanged")
    return f"; all rows are within {', or '.join(found)}" if found else ""
