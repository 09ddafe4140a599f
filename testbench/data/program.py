"""A robot's program as a table: where the tool goes, point by point, and what acts on it there."""

from dataclasses import dataclass, field
from difflib import get_close_matches
from itertools import takewhile
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.data.columns import Column, Columns, find_columns, joint_coordinates
from testbench.data.components import components, vector
from testbench.data.dataset import Ids
from testbench.data.jumps import refuse_joint_jumps, refuse_tool_jumps
from testbench.data.mapping import read_map
from testbench.data.names import ALONG, ROTATIONS, SI, XYZ, Slot, What, program_names
from testbench.data.series_rotation import read_rotations
from testbench.data.table import Table, read_table
from testbench.data.units import Unit, split_unit
from testbench.errors import Array, InputError

MAX_POINTS = 1_000_000
CORRECTION = "correction_"  #: What begins the columns that tell of a correction.
LISTED = 12  #: Columns that a sentence names.
LOADS: tuple[tuple[What, tuple[str, ...]], ...] = (
    ("force", (*(f"force_{axis}" for axis in XYZ), *ALONG)),
    ("moment", tuple(f"moment_{axis}" for axis in XYZ)),
    ("mass", ("mass", "payload")),
)
"""Of every kind of load the names."""


@dataclass(frozen=True, eq=False)
class Program:
    """The points of a program in their order, as joints or as poses of the tool.

    With both, the poses are asked for and the joints say in which configuration.
    """

    name: str  #: Of the file, without its ending.
    path: Path  #: The file.
    line: Ids  #: Line of every point in the file, (points,).
    labels: tuple[str, ...]  #: What the file calls every point; numbers from 1 where it does not.
    q: Array | None  #: Joints, (points, n) [rad, m]; None where poses of the tool alone are given.
    position: Array | None  #: Tool in the world, (points, 3) [m]; None where joints alone are given.
    rotation: Array | None  #: Its orientation, world from tool, (points, 3, 3); None together with that.
    wrench: Array  #: Force and moment on the tool at `point`, world axes, (points, 6) [N, N m].
    along: Array  #: Process force along the feed, across it, along the spindle, at `point`, (points, 3) [N].
    mass: Array  #: Hung mass, (points,) [kg].
    #: Where wrench and process force act, tool's frame, (points, 3) [m]; None where the file is silent.
    point: Array | None
    other: tuple[str, ...]  #: Columns that are carried through, in the order of the file.
    arm: Arm = field(repr=False)  #: The arm that it is for.
    table: Table = field(repr=False)  #: The file's cells.
    #: The column of every joint, (n,); None where the file has none.
    joints: tuple[Column | None, ...] = field(repr=False)
    mark: str  #: The file's decimal mark.
    jumps: bool  #: Whether points may lie as far apart as they like.

    @property
    def points(self) -> int:
        """How many points there are."""
        return len(self.line)

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
        raise InputError(names.path or path, "cells", "expected a quantity a column in a program")
    table = read_table(path, lambda name: names.find(name) is not None, names.layout)
    columns = find_columns(table, names, arm)
    if not 1 <= table.rows <= MAX_POINTS:
        raise table.error(
            min(table.rows, MAX_POINTS), "", f"expected 1 to {MAX_POINTS} points, got {table.rows}"
        )
    q, (position, rotation) = _joints(columns, arm), _poses(columns)
    if q is not None and not jumps:
        refuse_joint_jumps(path, arm, table.lines, q)
    if position is not None and rotation is not None and not jumps:
        refuse_tool_jumps(path, table.lines, position, rotation)
    force, moment = (_or_zero(vector(columns, what), table.rows) for what in ("force", "moment"))
    mass, found = _mass(columns), [columns.get(Slot("process", k)) for k in range(len(ALONG))]
    return Program(
        name=path.stem,
        path=path,
        line=table.lines,
        labels=_labels(columns),
        q=q,
        position=position,
        rotation=rotation,
        wrench=np.hstack([force, moment]),
        along=_or_zero(components(columns, "process", found), table.rows),
        mass=mass,
        point=vector(columns, "point"),
        other=columns.ignored,
        arm=arm,
        table=table,
        joints=tuple(columns.get(Slot("joint", k)) for k in range(arm.n_joints)),
        mark=columns.mark,
        jumps=jumps,
    )


def _joints(columns: Columns, arm: Arm) -> Array | None:
    """Joints of every point; None where the table has poses of the tool alone."""
    stated = any(slot.what == "joint" for slot in columns.names.values)
    if columns.every("joint") or stated:
        return joint_coordinates(columns, arm)
    if columns.every("set_point"):
        return None
    missing = [joint.shown_column for joint in arm.joints]
    raise columns.lack(missing, "; or x_mm, y_mm, z_mm and an orientation of the tool")


def _poses(columns: Columns) -> tuple[Array, Array] | tuple[None, None]:
    """Positions and orientations of the tool; None where the table has joints alone."""
    found = [columns.get(Slot("set_point", k)) for k in range(3)]
    missing = [f"{axis}_mm" for axis, column in zip(XYZ, found, strict=True) if column is None]
    rotation = read_rotations(columns)
    if len(missing) == len(found) and rotation is None:
        return None, None
    if missing:
        raise columns.lack(missing)
    if rotation is None:
        quaternion = [f"quaternion_{part}" for part in "wxyz"]
        raise columns.lack(quaternion, "; or rotation_x_deg ... of a rotation vector, rotation_11 ...")
    blank = np.flatnonzero(np.isnan(rotation[:, 0, 0]))
    if len(blank):
        name = columns.every(*ROTATIONS)[0].name
        raise columns.table.error(blank[0], name, "expected an orientation at every point, got ''")
    position = components(columns, "set_point", found)
    assert position is not None
    return position, rotation


def _or_zero(values: Array | None, rows: int) -> Array:
    return np.zeros((rows, 3)) if values is None else values


def _mass(columns: Columns) -> Array:
    """Hung mass of every point, (points,) [kg]."""
    column = columns.get(Slot("mass"))
    mass = components(columns, "mass", [column])
    if mass is None:
        return np.zeros(columns.table.rows)
    low = np.flatnonzero(mass[:, 0] < 0)
    if len(low):
        problem = f"expected a mass of at least 0 kg, got {mass[low[0], 0]:g}"
        raise columns.table.error(low[0], column.name if column else "", problem)
    return mass[:, 0]


def _labels(columns: Columns) -> tuple[str, ...]:
    column = columns.get(Slot("label"))
    if column is None:
        return tuple(map(str, range(1, columns.table.rows + 1)))
    return tuple(columns.table.texts(column.index))
