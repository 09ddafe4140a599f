"""Poses to measure as CSV; a plan's poses can be read like any others."""

from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.table import read_table
from testbench.errors import Array, InputError

XYZ = ("x", "y", "z")
SAME_ANGLE = 1e-3
"""Difference between an angle in radians and the same in degrees that rounding explains [deg]."""


def plan_columns(joints: tuple[str, ...]) -> list[str]:
    """The header of a plan, in order; a row is a run, in the order of measuring.

    run: integer. JOINT_rad, JOINT_deg: joint angle, twice. load_kg: hung mass. expected_deflection_mm: RMS
    over the markers, by the prior. expected_error_*_mm: of predicting it after identification, with the 5th
    and 95th percentile. travel_deg: of the joint that turns farthest from the run before. way: "start",
    "clear" where all joints can go straight, "via" where that way collides.
    """
    names = ["run", *(f"{j}_rad" for j in joints), *(f"{j}_deg" for j in joints), "load_kg"]
    names += [f"expected_{what}_mm" for what in ("deflection", "error", "error_p05", "error_p95")]
    return [*names, "travel_deg", "way"]


def read_poses(path: Path, arm: Arm) -> Array:
    """Read poses within the arm's limits, (poses, n) [rad]: one a row, a column JOINT_rad for every joint.

    A plan's other columns may be there.

    Raises:
        InputError: Names the line and what was expected.
    """
    table, joints = read_table(path), tuple(j.name for j in arm.joints)
    expected = [f"{j}_rad" for j in joints]
    if not set(expected) <= table.columns.keys() <= set(plan_columns(joints)):
        got = ",".join(table.columns)
        problem = f"expected the columns {','.join(expected)} or those of a plan, got {got}"
        raise InputError(path, "line 1", problem)
    if not table.rows:
        raise InputError(path, "line 2", "expected at least one pose")
    q = table.numbers(expected)
    for k, name in enumerate(f"{joint}_deg" for joint in joints):
        degrees = table.numbers([name])[:, 0] if name in table.columns else np.rad2deg(q[:, k])
        apart = np.flatnonzero(np.abs(np.rad2deg(q[:, k]) - degrees) > SAME_ANGLE)
        if len(apart):  # whoever edits one of them must not be overheard
            i = apart[0]
            problem = f"expected the same angle twice, got {np.rad2deg(q[i, k]):.4f} and {degrees[i]:g} deg"
            raise InputError(path, f"line {i + 2}, columns {expected[k]} and {name}", problem)
    check_limits(path, arm, q)
    return q


def check_limits(path: Path, arm: Arm, q: Array, *, unit: str = "rad") -> None:
    """Refuse joint angles of a file, (rows, n) [rad], beyond the arm's limits; degrees are the first suspect.

    `unit` is that of the file, "rad" or "deg".

    Raises:
        InputError: Names line and joint.
    """
    lower, upper = arm.limits
    bad = np.argwhere((q < lower - 1e-6) | (q > upper + 1e-6))
    if len(bad):
        i, k = bad[0]
        joint = arm.joints[k]
        hint = "; are these degrees?" if unit == "rad" and np.abs(q).max() > 2.5 * np.pi else ""
        scale = 1.0 if unit == "rad" else 180 / np.pi
        lower, upper, got = scale * joint.lower, scale * joint.upper, scale * q[i, k]
        raise InputError(
            path,
            f"line {i + 2}, column {joint.name}_{unit}",
            f"expected {lower:.4f} to {upper:.4f} {unit}, got {got:g}{hint}",
        )
