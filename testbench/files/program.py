"""A robot's program as a table: poses of the tool point by point, with the loads that act there.

Jumps are refused: between two such points the arm would take a path that the program does not define.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from itertools import takewhile
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.display import Displayed
from testbench.errors import Array, Ids, InputError, check_type
from testbench.files.beside import read_rotations
from testbench.files.columns import Columns, ReadColumn, find_columns, read_columns, vector, wrench
from testbench.files.languages import Language, language_of
from testbench.files.mapping import Names, read_map
from testbench.files.names import ALONG, ROTATIONS, SI, XYZ, Slot, What, columns_of, program_names, split_unit
from testbench.files.robot_program import RobotMotions, read_robot_program
from testbench.files.rows import joint_coordinates
from testbench.files.table import read_table

MAX_POINTS = 1_000_000
CORRECTION = "correction_"
"""Prefix of columns about a correction."""
MAX_LISTED = 12
"""Most columns that a sentence names."""
LOADS: Mapping[What, Sequence[str]] = {
    "force": [*(f"force_{axis}" for axis in XYZ), *ALONG],
    "moment": [f"moment_{axis}" for axis in XYZ],
    "mass": ["mass", "payload"],
}
"""Names of every kind of load."""
FARTHEST_TURN = math.radians(45)
"""Largest turn of a hinge, or of the tool, from one point to the next [rad]."""
UNIT_ROUNDING = 1e-3
"""Difference between a coordinate and the same one in another unit that rounding explains [deg, mm]."""
FARTHEST_STEP = 1.0
"""Largest motion of a slide, or of the tool, from one point to the next [m]."""
SLACK = 1 + 1e-9
"""Factor on these for rounding [1]."""


@dataclass(frozen=True, eq=False, repr=False)
class Program(Displayed):
    """Hold the points of a program in their order, as joints or as poses of the tool.

    With both, the poses are the target and the joints select the configuration.
    """

    labels: tuple[str, ...]  #: Names of the points in the file; numbers from 1 if it has none.
    #: Joints of the chain, (points, n) [rad, m]; None where poses of the tool alone are given.
    q: Array | None
    #: Position of the tool in the world, (points, 3) [m]; None if only joints are given.
    position: Array | None
    #: Orientation of the tool, world from tool, (points, 3, 3); None if only joints are given.
    rotation: Array | None
    wrench: Array  #: Force and moment on the tool at `point`, world axes, (points, 6) [N, N m].
    along: Array  #: Process force along the feed, across it, along the spindle, at `point`, (points, 3) [N].
    mass: Array  #: Mass of the payload, (points,) [kg].
    #: Point where wrench and process force act, tool's frame, (points, 3) [m]; None if the file states none.
    point: Array | None
    arm: Arm = field(repr=False)  #: The arm of the program.
    #: The cells of a table, or the moves of a program in a robot language. Joints of the latter are NaN where
    #: `position` and `rotation` are given, and the other way round.
    content: Columns | RobotMotions = field(repr=False)
    jumps: bool  #: Whether points may be any distance apart.

    def about(self) -> dict[str, object]:
        """Summarise the program: file, arm, points, and whether they are joints or poses of the tool."""
        kinds = {"joints": self.q, "poses": self.position}
        return {
            "file": self.path.name,
            "arm": self.arm.name,
            "points": self.points,
            "as": " and ".join(name for name, values in kinds.items() if values is not None),
        }

    @property
    def path(self) -> Path:
        """Return the file."""
        return self.content.table.path if isinstance(self.content, Columns) else self.content.text.path

    @property
    def line(self) -> Ids:
        """Return the line of every point in the file, (points,)."""
        return self.content.table.lines if isinstance(self.content, Columns) else self.content.text.lines

    @property
    def points(self) -> int:
        """Count the points."""
        return len(self.line)

    @property
    def joints(self) -> list[ReadColumn | None]:
        """Return the column of every file joint; None for a joint without one."""
        if not isinstance(self.content, Columns):
            return [None] * len(self.arm.file_joints)
        return [self.content.get(Slot("joint", k)) for k in range(len(self.arm.file_joints))]

    @property
    def other(self) -> tuple[str, ...]:
        """List the columns that are carried through, in the order of the file."""
        return self.content.ignored if isinstance(self.content, Columns) else ()

    @property
    def corrected(self) -> bool:
        """Tell whether the program was corrected; its points are then commands."""
        return self.mark is not None

    @property
    def mark(self) -> tuple[Path, int] | None:
        """Return file and line that say that the program was corrected; None if none does."""
        if not isinstance(self.content, Columns):
            return self.content.text.mark
        ours = {f"{CORRECTION}{joint.shown_column}" for joint in self.arm.file_joints}
        return (self.path, self.content.table.header) if ours & set(self.other) else None


def unread_columns(program: Program) -> tuple[str, ...]:
    """Describe each kind of unread columns; those that look like loads come first.

    Args:
        program: The program.

    Returns:
        Sentences, without full stop.
    """
    if not isinstance(program.content, Columns):
        return program.content.text.notes
    like = {name: _load_like(name) for name in program.other}
    found = [
        f"Not read though its unit is that of a load: {name}{near and f' ({near}?)'}; it counts for nothing"
        for name, near in like.items()
        if near is not None
    ]
    own = takewhile(lambda name: not name.startswith(CORRECTION), program.other)
    if rest := [name for name in own if like[name] is None]:
        more = f" and {len(rest) - MAX_LISTED} more" if len(rest) > MAX_LISTED else ""
        found.append(f"Not read: {', '.join(rest[:MAX_LISTED])}{more}")
    return tuple(found)


def _load_like(header: str) -> str | None:
    """Return the most similar name of a load, "" if none is similar; None if the unit is not a load's."""
    name, unit = split_unit(header) or ("", None)
    names = next((own for what, own in LOADS.items() if unit and unit.si in SI[what]), None)
    if unit is None or names is None:
        return None
    near = get_close_matches(name.casefold(), names, n=1, cutoff=0.7)
    return f"{near[0]}_{unit.name}" if near else ""


def read_program(
    path: str | Path, arm: Arm, mapping: str | Path | None = None, *, jumps: bool = False
) -> Program:
    """Read a program: a table with one point a row, or a program in a robot language, by its suffix.

    Columns of a table: JOINT_deg or JOINT_rad of every joint, of a slide JOINT_mm or JOINT_m; or x_mm, y_mm,
    z_mm and an orientation of the tool in world axes; docs/formats.md lists all.

    Args:
        path: The file.
        arm: The arm.
        mapping: A map of other names, and of what three angles are; of a program in a robot language its
            base, tool and pulses.
        jumps: Whether two points may lie as far apart as they like; they always may in a robot language,
            which defines the path between them.

    Returns:
        The points in their order, with what acts at them.

    Raises:
        InputError: Names line and column, or the statement, and what was expected.
        BenchError: When arm is no Arm.
    """
    check_type(arm, Arm, "arm")
    path = Path(path)
    names = read_map(None if mapping is None else Path(mapping), arm, program_names)
    if (language := language_of(path)) is not None:
        return _robot_program(path, language, arm, names)
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
    acts, along, mass = wrench(columns), vector(columns, "process"), vector(columns, "mass", 1)
    return Program(
        labels=_labels(columns),
        q=q,
        position=position,
        rotation=rotation,
        wrench=np.zeros((rows, 6)) if acts is None else acts,
        along=np.zeros((rows, 3)) if along is None else along,
        mass=np.zeros(rows) if mass is None else mass[:, 0],
        point=vector(columns, "point"),
        arm=arm,
        content=columns,
        jumps=jumps,
    )


def _robot_program(path: Path, language: Language, arm: Arm, names: Names) -> Program:
    """Read a program in a robot language, which states no loads."""
    found = read_robot_program(path, language, arm, names.map.controller)
    count, posed = len(found.q), found.motions.posed
    return Program(
        labels=found.motions.text.labels,
        q=None if posed.all() else found.q,
        position=found.position if posed.any() else None,
        rotation=found.rotation if posed.any() else None,
        wrench=np.zeros((count, 6)),
        along=np.zeros((count, 3)),
        mass=np.zeros(count),
        point=None,
        arm=arm,
        content=found.motions,
        jumps=True,
    )


def read_poses(path: Path, arm: Arm, mapping: Path | None = None) -> Array:
    """Read poses within the arm's limits: one per row, a column for every joint.

    Other columns may be there. A plan has every angle twice, in radians and degrees.

    Args:
        path: The file.
        arm: The arm.
        mapping: Map of column names; None for none.

    Returns:
        Joint angles, (poses, n) [rad, m].

    Raises:
        InputError: Names the line and what was expected.
    """
    names = read_map(mapping, arm)
    table = read_table(path, names.knows, names.map.file)
    read_as = {k: named for k, name in enumerate(table.names) if (named := names.find(name))}
    joints = {k: own for k, own in read_as.items() if own.slot.what == "joint"}
    first = {own.slot: k for k, own in reversed(joints.items())}
    again = {k: own for k, own in joints.items() if k != first[own.slot]}
    once = replace(table, names=tuple("" if k in again else name for k, name in enumerate(table.names)))
    columns = find_columns(once, names, arm)
    q = joint_coordinates(columns, arm)
    if not table.rows:
        raise table.error(0, "", "expected at least one pose")
    in_file = arm.to_file(q)
    for k, named in again.items():
        joint, here = arm.file_joints[named.slot.index], in_file[:, named.slot.index]
        other = here if named.unit is None else named.unit.scale * table.numbers(k, columns.mark)
        both = f"{table.names[first[named.slot]]} and {table.names[k]}"
        for i in np.flatnonzero(~(joint.shown * np.abs(here - other) <= UNIT_ROUNDING))[:1]:
            got = f"{joint.shown * here[i]:.4f} and {joint.shown * other[i]:g} {joint.shown_unit}"
            place = f"line {table.lines[i]}, columns {both}"  # an edit of one of them counts
            raise InputError(path, place, f"expected the same twice, got {got}")
    return q


def _joints(columns: Columns, arm: Arm) -> Array | None:
    """Read the joints of every point; None if the table has only poses of the tool."""
    stated = any(slot.what == "joint" for slot in columns.names.values)
    if columns.all_of("joint") or stated or not arm.joints:
        return joint_coordinates(columns, arm)
    if columns.all_of("set_point"):
        return None
    missing = [joint.shown_column for joint in arm.file_joints]
    raise columns.lack(missing, "; or x_mm, y_mm, z_mm and an orientation of the tool")


def _poses(columns: Columns) -> tuple[Array, Array] | tuple[None, None]:
    """Read positions and orientations of the tool; None if the table has only joints."""
    rotation = read_rotations(columns)
    found = columns.complete_set(wanted := columns_of("set_point"))
    if not found and rotation is None:
        return None, None
    if not found:
        raise columns.lack(list(wanted))
    if rotation is None:
        raise columns.lack(
            list(columns_of("quaternion")), "; or rotation_x_deg ... of a rotation vector, rotation_11 ..."
        )
    name, blank = columns.all_of(*ROTATIONS)[0].name, np.isnan(rotation[:, 0, 0])
    columns.table.refuse(blank, name, "expected an orientation at every point, got ''")
    position = vector(columns, "set_point")
    assert position is not None
    return position, rotation


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
        q: Joints of the chain, (points, n) [rad, m].

    Raises:
        InputError: Names the first two lines and the file joint.
    """
    q, joints = arm.to_file(q), arm.file_joints
    most = np.array([FARTHEST_STEP if joint.prismatic else FARTHEST_TURN for joint in joints])
    for i, k in np.argwhere(np.abs(np.diff(q, axis=0)) > most * SLACK)[:1].tolist():
        joint = joints[k]
        here, there = (joint.shown * q[[i, i + 1], k]).tolist()
        got = f"{joint.name} from {here:g} to {there:g} {joint.shown_unit}"
        _refuse(path, line[i : i + 2], got, f"{joint.shown * most[k]:g} {joint.shown_unit}")


def _refuse_tool_jumps(path: Path, line: Ids, position: Array, rotation: Array) -> None:
    """Refuse two neighbouring poses, (points, 3) [m] and (points, 3, 3), that are too far apart."""
    step = np.linalg.norm(np.diff(position, axis=0), axis=1)
    cosine = (np.einsum("pxy,pxy->p", rotation[1:], rotation[:-1]) - 1) / 2
    turn = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    for size, most, unit in ((step, FARTHEST_STEP, "m"), (turn, math.degrees(FARTHEST_TURN), "deg")):
        for i in np.flatnonzero(size > most * SLACK)[:1].tolist():
            _refuse(path, line[i : i + 2], f"the tool by {size[i]:g} {unit}", f"{most:g} {unit}")


def _refuse(path: Path, lines: Ids, got: str, most: str) -> None:
    problem = f"the path jumps, {got}: expected at most {most} from point to point unless jumps are allowed"
    raise InputError(path, f"lines {lines[0]} and {lines[1]}", problem)
