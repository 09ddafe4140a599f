"""Poses to measure as CSV; a plan's poses can be read like any others."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm, Joint
from testbench.data.columns import find_columns, joint_coordinates
from testbench.data.mapping import read_map
from testbench.data.table import read_table
from testbench.errors import Array, InputError

SAME = 1e-3
"""Difference between a coordinate and the same in another unit that rounding explains [deg, mm]."""


def plan_columns(joints: Sequence[Joint], *, pulls: bool = False) -> list[str]:
    """The header of a plan, in order; a row is a run, in the order of measuring.

    run: integer. JOINT_rad, JOINT_deg: joint angle, twice; of a slide JOINT_m, JOINT_mm. load_kg: hung mass.
    force_*_N, of a plan that may pull: force at the load point, world axes; a run has either, the other is
    blank.
    expected_deflection_mm: RMS over the markers, by the prior. expected_error_*_mm: of predicting it after
    identification, with the 5th and 95th percentile. travel_deg: of the hinge that turns farthest from the
    run before; travel_mm: of the slide, where the arm has one. way: "start", "clear" where all joints can go
    straight, "via" where that way collides.
    """
    names = ["run", *(j.column for j in joints), *(j.shown_column for j in joints), "load_kg"]
    names += [f"force_{axis}_N" for axis in "xyz" if pulls]
    names += [f"expected_{what}_mm" for what in ("deflection", "error", "error_p05", "error_p95")]
    return [*names, "travel_deg", *["travel_mm"] * any(j.prismatic for j in joints), "way"]


def read_poses(path: Path, arm: Arm, mapping: Path | None = None) -> Array:
    """Read poses within the arm's limits, (poses, n) [rad, m]: one a row, a column for every joint.

    Other columns may be there. A plan has every angle twice, in radians and degrees. A map says how the file
    names the joints otherwise.

    Raises:
        InputError: Names the line and what was expected.
    """
    names = read_map(mapping, arm)
    table = read_table(path, lambda name: names.find(name) is not None, names.layout)
    joints = [
        (k, own)
        for k, name in enumerate(table.names)
        if (own := names.find(name)) and own.slot.what == "joint"
    ]
    first = {own.slot: k for k, own in reversed(joints)}
    again = {k for k, own in joints if k != first[own.slot]}
    columns = find_columns(table.only([k for k in range(len(table.names)) if k not in again]), names, arm)
    q = joint_coordinates(columns, arm)
    if not table.rows:
        raise table.error(0, "", "expected at least one pose")
    for k, own in joints:
        if k not in again or own.unit is None:
            continue
        joint = arm.joints[own.slot.index]
        here, other = q[:, own.slot.index], own.unit.scale * table.numbers(k, columns.mark)
        both = f"{table.names[first[own.slot]]} and {table.names[k]}"
        for i in np.flatnonzero(~(joint.shown * np.abs(here - other) <= SAME))[:1]:
            got = f"{joint.shown * here[i]:.4f} and {joint.shown * other[i]:g} {joint.shown_unit}"
            place = f"line {table.lines[i]}, columns {both}"  # whoever edits one must not be overheard
            raise InputError(path, place, f"expected the same twice, got {got}")
    return q


def absolute_columns(joints: Sequence[Joint], *, loaded: bool) -> list[str]:
    """The header of a plan of absolute readings, in order.

    As `plan_columns`, but for load_kg, where one mass hangs after the first reading of every pose;
    expected_sag_mm: RMS over the targets, by the prior, under all that hangs; expected_error_*_mm: of their
    positions after calibration.
    """
    names = plan_columns(joints)
    return [
        "expected_sag_mm" if name == "expected_deflection_mm" else name
        for name in names
        if name != "load_kg" or loaded
    ]
