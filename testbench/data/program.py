"""A robot's program as a table: where the tool goes, point by point, and what acts on it there.

A path that jumps is refused: between two such points the arm would go a way that nobody wrote down.
"""

import math
from dataclasses import dataclass, field
from difflib import get_close_matches
from itertools import takewhile
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.columns import (
    Column,
    Columns,
    find_columns,
    read_columns,
    vector,
)
from testbench.data.joint_columns import joint_coordinates
from testbench.data.mapping import read_map
from testbench.data.names import (
    ALONG,
    ROTATIONS,
    SI,
    XYZ,
    Slot,
    Unit,
    What,
    columns_of,
    program_names,
    split_unit,
)
from testbench.data.rotation import read_rotations
from testbench.data.table import read_table
from testbench.errors import Array, Ids, InputError

MAX_POINTS = 1_000_000
CORRECTION = "correction_"  #: What begins the columns that tell of a correction.
LISTED = 12  #: Columns that a sentence names.
LOADS: tuple[tuple[What, tuple[str, ...]], ...] = (
    ("force", (*(f"force_{axis}" for axis in XYZ), *ALONG)),
    ("moment", tuple(f"moment_{axis}" for axis in XYZ)),
    ("mass", ("mass", "payload")),
)
"""Of every kind of load the names."""
FARTHEST_TURN = math.radians(45)
"""Largest turn of a hinge, or of the tool, from one point to the next [rad]."""
SAME = 1e-3
"""Difference between a coordinate and the same in another unit that rounding explains [deg, mm]."""
FARTHEST_STEP = 1.0  #: Largest way of a slide, or of the tool [m].


@dataclass(frozen=True, eq=False)
class Program:
    """The points of a program in their order, as joints or as poses of the tool.

    With both, the poses are asked for and the joints say in which configuration.
    """

    labels: tuple[str, ...]  #: What the file calls every point; numbers from 1 where it does not.
    q: Array | None  #: Joints, (points, n) [rad, m]; None where poses of the tool alone are given.
    position: Array | None  #: Tool in the world, (points, 3) [m]; None where joints alone are given.
    rotation: Array | None  #: Its orientation, world from tool, (points, 3, 3); None together with that.
    wrench: Array  #: Force and moment on the tool at `point`, world axes, (points, 6) [N, N m].
    along: Array  #: Process force along the feed, across it, along the spindle, at `point`, (points, 3) [N].
    mass: Array  #: Hung mass, (points,) [kg].
    #: Where wrench and process force act, tool's frame, (points, 3) [m]; None where the file is silent.
    point: Array | None
    arm: Arm = field(repr=False)  #: The arm that it is for.
    columns: Columns = field(repr=False)  #: The file's cells.
    jumps: bool  #: Whether points may lie as far apart as they like.

    @property
    def path(self) -> Path:
        """The file."""
        return self.columns.table.path

    @property
    def line(self) -> Ids:
        """Line of every point in the file, (points,)."""
        return self.columns.table.lines

    @property
    def points(self) -> int:
        """How many points there are."""
        return len(self.line)

    @property
    def joints(self) -> list[Column | None]:
        """The column of every joint; None where the file has none."""
        return [self.columns.get(Slot("joint", k)) for k in range(self.arm.n_joints)]

    @property
    def other(self) -> tuple[str, ...]:
        """Columns that are carried through, in the order of the file."""
        return self.columns.ignored

    @property
    def corrected(self) -> bool:
        """Whether it was corrected: its joints are what is commanded."""
        return any(name.startswith(CORRECTION) for name in self.other)


def unread(program: Program) -> tuple[str, ...]:
    """Sentences on columns that were not read, without a full stop; first those that look like loads."""
    found = []
    for name in program.other:
        said = split_unit(name)
        if said and (like := _load_like(*said)) is not None:
            hint = f" ({like}?)" if like else ""
            found.append(f"Not read though its unit is that of a load: {name}{hint}; it counts for nothing")
    own = takewhile(lambda name: not name.startswith(CORRECTION), program.other)
    rest = [name for name in own if not ((said := split_unit(name)) and _load_like(*said) is not None)]
    if rest:
        more = f" and {len(rest) - LISTED} more" if len(rest) > LISTED else ""
        found.append(f"Not read: {', '.join(rest[:LISTED])}{more}")
    return tuple(found)


def _load_like(name: str, unit: Unit) -> str | None:
    """The load's name that is nearest, "" if none is near; None where the unit is not that of a load."""
    for what, names in LOADS:
        if unit.si in SI[what]:
            near = get_close_matches(name.casefold(), names, n=1, cutoff=0.7)
            return f"{near[0]}_{unit.name}" if near else ""
    return None


def read_program(path: Path, arm: Arm, mapping: Path | None = None, *, jumps: bool = False) -> Program:
    """Read a program, one point a row.

    Columns: JOINT_deg or JOINT_rad of every joint, of a slide JOINT_mm or JOINT_m; or x_mm, y_mm, z_mm and an
    orientation of the tool in world axes; docs/formats.md lists all.

    Args:
        path: The file.
        arm: The arm.
        mapping: A map of other names, and of what three angles are.
        jumps: Whether two points may lie as far apart as they like.

    Returns:
        The points in their order, with what acts at them.

    Raises:
        InputError: Names line and column, and what was expected.
    """
    names = read_map(mapping, arm, program_names)
    if names.cells:
        raise names.error(path, "cells", "expected a quantity a column in a program")
    columns = read_columns(path, names, arm)
    table, rows = columns.table, columns.table.rows
    if not 1 <= rows <= MAX_POINTS:
        raise table.error(min(rows, MAX_POINTS), "", f"expected 1 to {MAX_POINTS} points, got {rows}")
    q, (position, rotation) = _joints(columns, arm), _poses(columns)
    if q is not None and not jumps:
        refuse_joint_jumps(path, arm, table.lines, q)
    if position is not None and rotation is not None and not jumps:
        _refuse_tool_jumps(path, table.lines, position, rotation)
    force, moment = (_or_zero(vector(columns, what), rows) for what in ("force", "moment"))
    mass = _mass(columns)
    return Program(
        labels=_labels(columns),
        q=q,
        position=position,
        rotation=rotation,
        wrench=np.hstack([force, moment]),
        along=_or_zero(vector(columns, "process"), rows),
        mass=mass,
        point=vector(columns, "point"),
        arm=arm,
        columns=columns,
        jumps=jumps,
    )


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


def _joints(columns: Columns, arm: Arm) -> Array | None:
    """Joints of every point; None where the table has poses of the tool alone."""
    stated = any(slot.what == "joint" for slot in columns.names.values)
    if columns.every("joint") or stated or not arm.joints:
        return joint_coordinates(columns, arm)
    if columns.every("set_point"):
        return None
    missing = [joint.shown_column for joint in arm.joints]
    raise columns.lack(missing, "; or x_mm, y_mm, z_mm and an orientation of the tool")


def _poses(columns: Columns) -> tuple[Array, Array] | tuple[None, None]:
    """Positions and orientations of the tool; None where the table has joints alone."""
    rotation = read_rotations(columns)
    found = columns.whole(wanted := columns_of("set_point"))
    if not found and rotation is None:
        return None, None
    if not found:
        raise columns.lack(list(wanted))
    if rotation is None:
        raise columns.lack(
            list(columns_of("quaternion")), "; or rotation_x_deg ... of a rotation vector, rotation_11 ..."
        )
    name, blank = columns.every(*ROTATIONS)[0].name, np.isnan(rotation[:, 0, 0])
    columns.table.refuse(blank, name, "expected an orientation at every point, got ''")
    position = vector(columns, "set_point")
    assert position is not None
    return position, rotation


def _or_zero(values: Array | None, rows: int) -> Array:
    return np.zeros((rows, 3)) if values is None else values


def _mass(columns: Columns) -> Array:
    """Hung mass of every point, (points,) [kg]."""
    mass = vector(columns, "mass", 1)
    if mass is None:
        return np.zeros(columns.table.rows)
    name = own.name if (own := columns.get(Slot("mass"))) else ""
    problem = "expected a mass of at least 0 kg, got {:g}"
    columns.table.refuse(mass[:, 0] < 0, name, lambda row: problem.format(mass[row, 0]))
    return mass[:, 0]


def _labels(columns: Columns) -> tuple[str, ...]:
    column = columns.get(Slot("label"))
    if column is None:
        return tuple(map(str, range(1, columns.table.rows + 1)))
    return tuple(columns.table.texts(column.index))


def refuse_joint_jumps(path: Path, arm: Arm, line: Ids, q: Array) -> None:
    """Refuse joints of which one goes too far from one point to the next.

    Args:
        path: The program's file.
        arm: The arm.
        line: Line of every point, (points,).
        q: Joints, (points, n) [rad, m].

    Raises:
        InputError: Names the first two lines and the joint.
    """
    most = np.array([FARTHEST_STEP if joint.prismatic else FARTHEST_TURN for joint in arm.joints])
    far = np.argwhere(np.abs(np.diff(q, axis=0)) > most * (1 + 1e-9))
    if not len(far):
        return
    i, k = far[0]
    joint = arm.joints[k]
    here, there = (joint.shown * q[[i, i + 1], k]).tolist()
    got = f"{joint.name} from {here:g} to {there:g} {joint.shown_unit}"
    _refuse(path, line[i : i + 2], got, f"{joint.shown * most[k]:g} {joint.shown_unit}")


def _refuse_tool_jumps(path: Path, line: Ids, position: Array, rotation: Array) -> None:
    """InputError at the first two poses, (points, 3) [m] and (points, 3, 3), that lie too far apart."""
    step = np.linalg.norm(np.diff(position, axis=0), axis=1)
    far = np.flatnonzero(step > FARTHEST_STEP)
    if len(far):
        _refuse(path, line[far[0] : far[0] + 2], f"the tool by {step[far[0]]:g} m", f"{FARTHEST_STEP:g} m")
    cosine = (np.einsum("pxy,pxy->p", rotation[1:], rotation[:-1]) - 1) / 2
    turn = np.arccos(np.clip(cosine, -1, 1))
    far = np.flatnonzero(turn > FARTHEST_TURN * (1 + 1e-9))
    if len(far):
        got = f"the tool by {math.degrees(turn[far[0]]):g} deg"
        _refuse(path, line[far[0] : far[0] + 2], got, f"{math.degrees(FARTHEST_TURN):g} deg")


def _refuse(path: Path, lines: Ids, got: str, most: str) -> None:
    problem = f"the path jumps, {got}: expected at most {most} from point to point; --jumps allows it"
    raise InputError(path, f"lines {lines[0]} and {lines[1]}", problem)
