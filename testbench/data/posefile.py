"""Poses as CSV: to be measured, to be worked in; a plan's poses can be read like any others."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm, Joint
from testbench.data.table import Table, read_table
from testbench.errors import Array, InputError

XYZ = ("x", "y", "z")
SAME = 1e-3
"""Difference between a coordinate and the same in another unit that rounding explains [deg, mm]."""
SUSPECT = {"rad": (2.5 * np.pi, "degrees"), "m": (10.0, "millimetres")}
"""Coordinates that only another unit explains, and that unit."""


def plan_columns(joints: Sequence[Joint]) -> list[str]:
    """The header of a plan, in order; a row is a run, in the order of measuring.

    run: integer. JOINT_rad, JOINT_deg: joint angle, twice; of a slide JOINT_m, JOINT_mm. load_kg: hung mass.
    expected_deflection_mm: RMS over the markers, by the prior. expected_error_*_mm: of predicting it after
    identification, with the 5th and 95th percentile. travel_deg: of the hinge that turns farthest from the
    run before; travel_mm: of the slide, where the arm has one. way: "start", "clear" where all joints can go
    straight, "via" where that way collides.
    """
    names = ["run", *(j.column for j in joints), *(j.shown_column for j in joints), "load_kg"]
    names += [f"expected_{what}_mm" for what in ("deflection", "error", "error_p05", "error_p95")]
    return [*names, "travel_deg", *["travel_mm"] * any(j.prismatic for j in joints), "way"]


def read_poses(path: Path, arm: Arm) -> Array:
    """Read poses within the arm's limits, (poses, n) [rad, m]: one a row, a column a joint as `read_joints`.

    A plan's other columns may be there.

    Raises:
        InputError: Names the line and what was expected.
    """
    table = read_table(path)
    if not table.columns.keys() <= set(plan_columns(arm.joints)):
        raise InputError(
            path, "line 1", f"{_expected(arm)} or those of a plan, got {','.join(table.columns)}"
        )
    if not table.rows:
        raise InputError(path, "line 2", "expected at least one pose")
    return read_joints(table, arm)


def read_joints(table: Table, arm: Arm) -> Array:
    """The joints of every row within the arm's limits, (rows, n) [rad, m].

    Columns: JOINT_rad or JOINT_deg, of a slide JOINT_m or JOINT_mm; where both are there they must agree.

    Raises:
        InputError: Names the line and what was expected.
    """
    q = np.empty((table.rows, arm.n_joints))
    used = []
    for k, joint in enumerate(arm.joints):
        given = [name for name in (joint.column, joint.shown_column) if name in table.columns]
        if not given:
            raise InputError(table.path, "line 1", f"{_expected(arm)}, got {','.join(table.columns)}")
        values = table.numbers(given)
        q[:, k] = values[:, 0] if given[0] == joint.column else joint.of_shown(values[:, 0])
        used.append(given[0])
        shown = joint.shown * q[:, k]
        twice = values[:, 1] if len(given) == 2 else shown
        apart = np.flatnonzero(np.abs(shown - twice) > SAME)
        if len(apart):  # whoever edits one of them must not be overheard
            i = apart[0]
            problem = f"expected the same twice, got {shown[i]:.4f} and {twice[i]:g} {joint.shown_unit}"
            raise InputError(table.path, f"line {i + 2}, columns {' and '.join(given)}", problem)
    check_limits(table.path, arm, q, used)
    return q


def _expected(arm: Arm) -> str:
    """The columns of an arm's joints."""
    units = dict.fromkeys((f"_{j.unit}", f"_{j.shown_unit}") for j in arm.joints)
    others = ", ".join(f"{own} or {other}" for own, other in units)
    return f"expected the columns {','.join(j.column for j in arm.joints)} (each {others})"


def check_limits(path: Path, arm: Arm, q: Array, columns: Sequence[str] | None = None) -> None:
    """Refuse joints of a file, (rows, n) [rad, m], beyond the arm's limits; the unit is the first suspect.

    `columns` are those that they were read from; in rad and m if not given.

    Raises:
        InputError: Names line and joint.
    """
    lower, upper = arm.limits
    bad = np.argwhere((q < lower - 1e-6) | (q > upper + 1e-6))
    if not len(bad):
        return
    i, k = bad[0]
    joint = arm.joints[k]
    column = joint.column if columns is None else columns[k]
    alike = [other.prismatic == joint.prismatic for other in arm.joints]
    most, other = SUSPECT[joint.unit]
    own = column == joint.column
    hint = f"; are these {other}?" if own and np.abs(q[:, alike]).max() > most else ""
    unit, scale = (joint.unit, 1.0) if own else (joint.shown_unit, joint.shown)
    low, high, got = scale * joint.lower, scale * joint.upper, scale * q[i, k]
    problem = f"expected {low:.4f} to {high:.4f} {unit}, got {got:g}{hint}"
    raise InputError(path, f"line {i + 2}, column {column}", problem)
