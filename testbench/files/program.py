"""A robot's program as a table: poses of the tool point by point, with the loads that act there.

Jumps are refused: between two such points the arm would take a path that the program does not define.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from itertools import takewhile
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm, beyond_limits
from testbench.display import Displayed
from testbench.errors import Array, Ids, InputError, Mask, check_type, some_of
from testbench.files.beside import read_rotations
from testbench.files.columns import (
    JOINTS_BY_MAP,
    ROUNDED,
    SAME_POSE,
    Columns,
    ReadColumn,
    find_columns,
    joint_coordinates,
    read_columns,
    vector,
    wrench,
)
from testbench.files.languages import (
    Language,
    PointText,
    ProgramText,
    known_languages,
    language_of,
    read_motions,
    values_of,
)
from testbench.files.mapping import Controller, read_map
from testbench.files.motion import axes_of, scale_of, turn_flags
from testbench.files.names import (
    ALONG,
    ROTATIONS,
    SI,
    XYZ,
    Slot,
    What,
    columns_of,
    looks_like,
    program_names,
    split_unit,
)
from testbench.files.rearranged import OTHERS, has_line
from testbench.files.table import read_table
from testbench.files.text import read_letters

# --- Points of a program in a robot language: joints of the chain, or poses of the tool in the world --------

SHARED = 1e-4  #: Difference of two corrections of one point that counts as none [deg, mm, pulses].
FLAG_ROUNDING = np.radians(0.1)  #: Angle to the end of a turn within which a flag may state either [rad].
MIN_NORM = 0.5  #: Least norm of a quaternion, which rounding leaves near one [1].

Pose = tuple[Array, Array]
"""A rotation, (3, 3) or (points, 3, 3), and a position, (3,) or (points, 3) [m]."""


@dataclass(frozen=True, eq=False)
class RobotMotions:
    """Hold the moves of a program, and what the controller counts poses and joints by."""

    text: ProgramText
    linear: Mask  #: Which moves are along lines, (points,).
    posed: Mask  #: Which points are poses, (points,).
    base: Pose  #: The program's base in the arm's world.
    tool: Pose  #: The program's tool in the arm's tool.
    pulses_per_deg: tuple[float, ...]  #: Of every motor; empty if none is stated.
    near: Array  #: Joints of the chain that the program states for a pose, (points, n) [rad, m]; NaN if none.
    notes: tuple[str, ...]  #: How the program was read.
    kept: tuple[str, ...]  #: External axes that move and that the arm does not have.
    unknown_frames: str  #: Its tool and base if nothing says where they are; "" for none.

    def to_world(self, position: Array, rotation: Array) -> tuple[Array, Array]:
        """Convert poses of the program to poses of the arm's tool.

        Args:
            position: Positions of the program's tool in its base, (points, 3) [m].
            rotation: Its orientations, (points, 3, 3).

        Returns:
            Positions and orientations of the arm's tool in its world.
        """
        (R_base, p_base), (R_tool, p_tool) = self.base, self.tool
        R = R_base @ rotation @ R_tool.T
        return p_base + position @ R_base.T - R @ p_tool, R

    def to_program(self, position: Array, rotation: Array) -> tuple[Array, Array]:
        """Convert poses of the arm's tool to poses of the program; the inverse of `to_world`.

        Args:
            position: Positions of the arm's tool in its world, (points, 3) [m].
            rotation: Its orientations, (points, 3, 3).

        Returns:
            Positions and orientations of the program's tool in its base.
        """
        (R_base, p_base), (R_tool, p_tool) = self.base, self.tool
        return (position + rotation @ p_tool - p_base) @ R_base, R_base.T @ rotation @ R_tool


def flags_agree(motions: RobotMotions, arm: Arm, points: Ids, q: Array) -> Mask:
    """Tell whether joints are in the turns that the flags of poses state.

    Args:
        motions: The program.
        arm: The arm.
        points: Indices of moves, (k,).
        q: Joints of the chain there, (k, n) [rad, m].

    Returns:
        False where a flag states another turn, (k,).
    """
    text, turns = motions.text, motions.text.language.flags
    found = np.ones(len(points), dtype=bool)
    if turns is None or not turns.read:
        return found
    axes, in_file = axes_of(text.language, arm.file_joints), arm.to_file_joints(q)
    for row, k in enumerate(points):
        flags = text.moves[k].point.flags
        for name, flag in zip(turns.axes, flags, strict=False):
            if name in axes:
                near = in_file[row, axes[name]] + np.array([-FLAG_ROUNDING, 0.0, FLAG_ROUNDING])
                turn = turn_flags(text.language, near)
                found[row] &= bool(
                    ((np.minimum(turn, 0) < 0) == (flag < 0) if turns.bits else turn == flag).any()
                )
    return found


def refuse_other_configurations(motions: RobotMotions, *, started: bool) -> None:
    """Refuse poses whose configuration is not known where it would choose between several.

    Args:
        motions: The program.
        started: Whether joints before the first pose are known.

    Raises:
        InputError: If the program begins with such a pose, and neither joints nor flags are known; or if
            configurations that are not read differ.
    """
    text = motions.text
    turns = motions.text.language.flags
    same = ""
    unread = turns is not None and not turns.read
    start = text.moves[0].point
    if start.posed and not (started or start.flags or np.isfinite(motions.near[0]).all()):
        problem = "it does not state the configuration of the arm"
        if turns is not None and start.same:
            problem = f"the configuration {turns.name} {start.same.strip()!r} is not read"
        problem += "; begin with joints, or give compensate --start"
        raise text.sources[start.source].error(start.start, f"the program begins with a pose: {problem}")
    for point in (move.point for move in text.moves if unread and move.point.same):
        if turns is not None and same and point.same.split() != same.split():
            problem = (
                f"expected one configuration in all poses, got {same.strip()!r} and {point.same.strip()!r}"
            )
            raise text.sources[point.source].error(point.start, f"{turns.name} is not read: {problem}")
        same = same or point.same


def _program_poses(path: Path, language: Language, arm: Arm, motions: RobotMotions) -> tuple[Array, Array]:
    """Places, (poses, 3) [m], and rotations, (poses, 3, 3), of the poses of a program in the world."""
    if set(axes_of(language, arm.file_joints)) & set(language.external):
        raise InputError(path, "", "poses of an arm with external axes are not read: give joints")
    points = [move.point for move in motions.text.moves if move.point.posed]
    own = values_of(motions.text, points, language.pose_names())
    if language.rotation == "quaternion" and (np.linalg.norm(own[:, 3:], axis=1) < MIN_NORM).any():
        raise InputError(path, "", "expected quaternions of norm 1 in every pose")
    return motions.to_world(own[:, :3] / language.per_metre, language.rotations(own[:, 3:]))


def _frame(language: Language, numbers: Sequence[float]) -> Pose:
    """A frame by no pose in the language, by one, or by two, the second one in the first."""
    values = np.array(numbers).reshape(-1, len(language.pose_names()))
    R, p = np.eye(3), np.zeros(3)
    for R_own, p_own in zip(
        language.rotations(values[:, 3:]), values[:, :3] / language.per_metre, strict=True
    ):
        R, p = R @ R_own, p + R @ p_own
    return R, p


def _frame_notes(text: ProgramText, controller: Controller) -> tuple[tuple[str, ...], str]:
    """Say how the frames that a program states count where no map states them, and which are unknown."""
    notes, unknown = list[str](), list[str]()
    for what, frame in text.frames.items():
        R, p = _frame(text.language, frame.numbers)
        if getattr(controller, what) or (frame.numbers and np.allclose(R, np.eye(3)) and np.allclose(p, 0)):
            continue
        if what == "base" and frame.numbers:
            notes.append(f"The program's base, {frame.text}, is taken as a frame in the arm's world")
        else:
            unknown.append(f"{what} {frame.text}")
    if unknown:
        meant = "Its poses are taken as poses of the arm's tool" + " in the arm's world" * (not notes)
        hint = "unless [controller] of a map says where its tool and base are"
        notes.append(f"The program states {' and '.join(unknown)}. {meant}, {hint}")
    return tuple(notes), " and ".join(unknown)


def _external_axes(text: ProgramText, arm: Arm) -> dict[str, str]:
    """Find the external axes and other groups that move and that the arm does not have, with their range."""
    axes, moved = axes_of(text.language, arm.file_joints), dict[str, str]()
    for name in (name for name in text.language.external if name not in axes):
        every = [own.point.numbers[name].value for own in text.moves if name in own.point.numbers]
        values = [value for value in every if abs(value) < text.language.no_axis]
        if any(values):
            moved[name] = f"{name} {min(values):g} to {max(values):g}"
    return moved | {name: name for name in text.others}


def _program_joints(
    text: ProgramText, arm: Arm, points: Sequence[PointText], pulses_per_deg: Sequence[float]
) -> Array:
    """Joints of the chain of points that are no poses, (points, n) [rad, m], within limits."""
    joints = arm.file_joints
    axes, language = axes_of(text.language, joints), text.language
    values = values_of(text, points, list(axes))
    scale = np.array([scale_of(language, joints[k]) for k in axes.values()])
    found = np.empty_like(values)
    found[:, list(axes.values())] = values / scale
    counted = np.array([bool(language.pulses) and point.mode == language.pulses for point in points])
    if counted.any():
        per = pulses_per_deg
        if len(per) != len(joints):
            first = points[int(counted.argmax())]
            problem = (
                f"joints are pulses: expected pulses_per_deg of {len(joints)} motors in [controller] of a "
                f"map, got {len(per)}"
            )
            raise text.sources[first.source].error(first.start, problem)
        found[counted] = np.radians(values[counted] / np.array(per))
    q = arm.to_chain_joints(found)
    for some, values in ((joints, found), (arm.joints, q)):
        for row, problem in beyond_limits(some, values, ROUNDED):
            raise text.sources[points[row].source].error(points[row].start, problem)
    ends = arm.clip_to_limits(q)
    return np.asarray(np.where(np.abs(q - ends) > SAME_POSE, ends, q))


def changed_numbers(
    motions: RobotMotions, arm: Arm, q: Array, position: Array, rotation: Array
) -> Mapping[tuple[int, int], Mapping[str, float]]:
    """Compute the numbers of every point of a program that moves elsewhere.

    Args:
        motions: The program as it was read.
        arm: The arm.
        q: Joints of the chain, (points, n) [rad, m].
        position: Positions of the arm's tool that the controller should believe, (points, 3) [m].
        rotation: Its orientations, (points, 3, 3).

    Returns:
        Numbers by axis as the language writes them, for points by file and start.

    Raises:
        InputError: If two moves share a point, and need different numbers.
    """
    text, language = motions.text, motions.text.language
    axes, joints = axes_of(language, arm.file_joints), arm.file_joints
    scale = np.array([scale_of(language, joint) for joint in joints])
    as_joints, posed = arm.to_file_joints(q), motions.posed
    poses = np.zeros((len(posed), len(language.pose_names())))
    if posed.any():
        at = motions.to_program(position[posed], rotation[posed])
        poses[posed] = np.hstack([at[0] * language.per_metre, language.orientations(at[1])])
    found: dict[tuple[int, int], dict[str, float]] = {}
    line: dict[tuple[int, int], int] = {}
    lines = text.lines.tolist()
    for k, move in enumerate(text.moves):
        point, key = move.point, (move.point.source, move.point.start)
        if point.posed:
            names = language.pose_names()
            old = np.array([point.numbers[name].value for name in names])
            own = dict(zip(names, _near(language, poses[k], old).tolist(), strict=True))
        else:
            counts = bool(language.pulses) and point.mode == language.pulses
            per = np.degrees(motions.pulses_per_deg) if counts else scale
            own = {name: float(as_joints[k, j] * per[j]) for name, j in axes.items()}
            own = {name: float(round(x)) for name, x in own.items()} if counts else own
        first = found.setdefault(key, own)
        line.setdefault(key, lines[k])
        if max(abs(first[name] - own[name]) for name in own) > SHARED:
            problem = f"lines {line[key]} and {lines[k]} share the point {point.name}"
            raise InputError(text.path, "", f"{problem} but need different corrections: copy the point")
    return found


def _near(language: Language, pose: Array, old: Array) -> Array:
    """The same pose by the numbers nearest to earlier ones: angles by turns, a quaternion by its sign."""
    own, turn = pose[3:], 2 * np.pi * language.per_radian
    if language.rotation == "quaternion":
        tries = [own, -own]
    elif language.rotation == "vector":  # the same turn the other way round
        size = np.linalg.norm(own)
        tries = [own, own * (1 - turn / size)] if size else [own]
    else:
        tries = [own + turn * np.round((old[3:] - own) / turn)]
    nearest = min(tries, key=lambda other: float(np.linalg.norm(other - old[3:])))
    return np.concatenate([pose[:3], nearest])


# --- A robot's program as a table: poses of the tool point by point, with the loads that act there ----------

MAX_POINTS = 1_000_000
CORRECTION = "correction_"
"""Prefix of columns about a correction."""
LOADS: Mapping[What, Sequence[str]] = {
    "force": [*(f"force_{axis}" for axis in XYZ), *ALONG],
    "moment": [f"moment_{axis}" for axis in XYZ],
    "mass": ["mass", "payload"],
}
"""Names of every kind of load."""
FARTHEST_TURN = math.radians(45)
"""Largest turn of a hinge, or of the tool, from one point to the next [rad]."""
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

    def summary(self) -> dict[str, object]:
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
        return [self.content.found.get(Slot("joint", k)) for k in range(len(self.arm.file_joints))]

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
        ours = {f"{CORRECTION}{joint.display_column}" for joint in self.arm.file_joints}
        return (self.path, self.content.table.header) if ours & set(self.other) else None


def unread_columns(program: Program) -> tuple[str, ...]:
    """Describe each kind of unread columns; those that look like loads come first.

    Args:
        program: The program.

    Returns:
        Sentences, without full stop.
    """
    if not isinstance(program.content, Columns):
        return program.content.notes
    like = {name: _load_like(name) for name in program.other}
    found = [
        f"Not used, although it looks like a load: {name}{near and f' ({near}?)'}"
        for name, near in like.items()
        if near is not None
    ]
    own = takewhile(lambda name: not name.startswith(CORRECTION), program.other)
    if rest := [name for name in own if like[name] is None]:
        found.append(f"These columns are not read: {some_of(rest)}")
    return tuple(found)


def _load_like(header: str) -> str | None:
    """Return the most similar name of a load, "" if none is similar; None if name and unit are no load's."""
    name, unit = split_unit(header) or ("", None)
    names = next((own for what, own in LOADS.items() if unit and unit.si in SI[what]), None)
    if unit is None or names is None:
        return "" if unit is None and looks_like(header, "loads") else None
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
        jumps: Whether to allow any distance between two points. A robot language defines the path between
            them, so that it is always allowed there.

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
        return read_robot_program(path, language, arm, names.map.controller)
    if names.cells:
        raise names.error(path, "cells", "expected one column per quantity in a program")
    try:
        columns = read_columns(path, names, arm)
    except InputError as err:
        raise _other_program(path) or err from err
    table, rows = columns.table, columns.table.rows
    if not 1 <= rows <= MAX_POINTS:
        raise table.error(min(rows, MAX_POINTS), "", f"expected 1 to {MAX_POINTS} points, got {rows}")
    q, (position, rotation) = _joints(columns, arm), _poses(columns)
    if q is not None and not jumps:
        refuse_joint_jumps(path, arm, table.lines, q)
    if position is not None and rotation is not None and not jumps:
        _refuse_tool_jumps(path, table.lines, position, rotation)
    acts = wrench(columns)
    along = vector(columns, "process")
    mass = vector(columns, "mass", 1)
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


def _other_program(path: Path) -> InputError | None:
    """The error about a robot's program whose suffix is of none of our languages; None for other files."""
    text, languages = read_letters(path, None, ".")[0], known_languages().values()
    for language in languages:
        if has_line(language.text, text):
            points = f", which has the points of a {language.suffixes[0]}" * (path.suffix == language.beside)
            problem = f"this is {language.title}{points}: expected the suffix {language.suffixes[0]}"
            return InputError(path, "", problem)
    if has_line(OTHERS, text):
        read = ", ".join(f"{own.title} ({own.suffixes[0]})" for own in languages)
        return InputError(path, "", f"a program in another language; testbench reads {read}, and tables")
    return None


def read_robot_program(path: Path, language: Language, arm: Arm, controller: Controller) -> Program:
    """Read a program in a robot language, which states no loads.

    Args:
        path: The program.
        language: Its language.
        arm: The arm.
        controller: What a map says of base, tool and pulses.

    Returns:
        The points in the order of their moves.

    Raises:
        InputError: As `read_motions`; also if the arm's joints have no axes in the language, are beyond their
            limits, or an arm with external axes has poses.
    """
    text = read_motions(path, language)
    points = [move.point for move in text.moves]
    posed = np.array([point.posed for point in points], dtype=bool)
    # Joints of the moves, and joints that choose the configuration of poses.
    count, pulses = len(points), tuple(controller.pulses_per_deg)
    q, near = np.full((2, count, arm.n_joints), np.nan)
    if not posed.all():
        q[~posed] = _program_joints(text, arm, [own for own in points if not own.posed], pulses)
    if chosen := {k: move.near for k, move in enumerate(text.moves) if move.near is not None}:
        near[list(chosen)] = _program_joints(text, arm, list(chosen.values()), pulses)
    # Frames of poses.
    for what, numbers in (("base", controller.base), ("tool", controller.tool)):
        if len(numbers) not in (0, size := len(language.pose_names())):
            expected = f"expected {size} numbers as a pose in {language.title}, got {len(numbers)}"
            raise InputError(path, f"controller.{what}", expected)
    stated = text.frames.get("base")
    frame_notes, unknown = _frame_notes(text, controller) if posed.any() else ((), "")
    outer = _external_axes(text, arm)
    why = f"{arm.name} has no such joint, so we assume that they move neither the arm nor its workpiece"
    kept = f"External axes are unchanged: {', '.join(outer.values())}. {why}"
    motions = RobotMotions(
        text,
        linear=np.array([move.linear for move in text.moves], dtype=bool),
        posed=posed,
        base=_frame(language, controller.base or (stated.numbers if stated else ())),
        tool=_frame(language, controller.tool),
        pulses_per_deg=pulses,
        near=near,
        notes=(*text.notes, *frame_notes, *[kept] * bool(outer)),
        kept=tuple(outer),
        unknown_frames=unknown,
    )
    position, rotation = np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan)
    if posed.any():
        position[posed], rotation[posed] = _program_poses(path, language, arm, motions)
    return Program(
        labels=text.labels,
        q=None if posed.all() else q,
        position=position if posed.any() else None,
        rotation=rotation if posed.any() else None,
        wrench=np.zeros((count, 6)),
        along=np.zeros((count, 3)),
        mass=np.zeros(count),
        point=None,
        arm=arm,
        content=motions,
        jumps=True,
    )


def read_poses(path: Path, arm: Arm, mapping: Path | None = None) -> Array:
    """Read poses within the arm's limits: one per row, a column for every joint.

    Other columns may be there. A plan has every angle twice, in radians and degrees; both must agree.

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
    columns = find_columns(table, names, arm)
    if further := [name for name in columns.ignored if looks_like(name, "joints")]:
        problem = f"expected the joints of {arm.name} only, got also {some_of(further)}; remove them"
        raise table.header_error(problem)
    q = joint_coordinates(columns, arm)
    if not table.rows:
        raise table.error(0, "", "expected at least one pose")
    return q


def _joints(columns: Columns, arm: Arm) -> Array | None:
    """Read the joints of every point; None if the table has only poses of the tool."""
    stated = any(slot.what == "joint" for slot in columns.names.values)
    if columns.all_of("joint") or stated or not arm.joints:
        return joint_coordinates(columns, arm)
    if columns.all_of("set_point"):
        return None
    missing = [joint.display_column for joint in arm.file_joints]
    hint = "; or x_mm, y_mm, z_mm and an orientation of the tool"
    raise columns.lack(missing, hint + JOINTS_BY_MAP)


def _poses(columns: Columns) -> tuple[Array, Array] | tuple[None, None]:
    """Read positions and orientations of the tool; None if the table has only joints."""
    rotation = read_rotations(columns)
    found = columns.complete_set(wanted := columns_of("set_point"))
    if not found and rotation is None:
        return None, None
    if not found:
        raise columns.lack(list(wanted))
    if rotation is None:
        angles = (
            "rotation_1_deg ... in [columns] of a map for three angles, with their order in [series] rotation"
        )
        hint = f"; or rotation_x_deg ... of a rotation vector, rotation_11 ..., or {angles}"
        raise columns.lack(list(columns_of("quaternion")), hint + JOINTS_BY_MAP)
    name, blank = columns.all_of(*ROTATIONS)[0].name, np.isnan(rotation[:, 0, 0])
    columns.table.refuse(blank, name, "expected an orientation at every point, got ''")
    position = vector(columns, "set_point")
    assert position is not None
    return position, rotation


def _labels(columns: Columns) -> tuple[str, ...]:
    column = columns.found.get(Slot("label"))
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
    q, joints = arm.to_file_joints(q), arm.file_joints
    most = np.array([FARTHEST_STEP if joint.prismatic else FARTHEST_TURN for joint in joints])
    for i, k in np.argwhere(np.abs(np.diff(q, axis=0)) > most * SLACK)[:1].tolist():
        joint = joints[k]
        here, there = (joint.display_factor * q[[i, i + 1], k]).tolist()
        got = f"{joint.name} from {here:g} to {there:g} {joint.display_unit}"
        _refuse(path, line[i : i + 2], got, f"{joint.display_factor * most[k]:g} {joint.display_unit}")


def _refuse_tool_jumps(path: Path, line: Ids, position: Array, rotation: Array) -> None:
    """Refuse two neighbouring poses, (points, 3) [m] and (points, 3, 3), that are too far apart."""
    step = np.linalg.norm(np.diff(position, axis=0), axis=1)
    cosine = (np.einsum("pxy,pxy->p", rotation[1:], rotation[:-1]) - 1) / 2
    turn = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    for size, most, unit in ((step, FARTHEST_STEP, "m"), (turn, math.degrees(FARTHEST_TURN), "deg")):
        for i in np.flatnonzero(size > most * SLACK)[:1].tolist():
            _refuse(path, line[i : i + 2], f"the tool by {size[i]:g} {unit}", f"{most:g} {unit}")


def _refuse(path: Path, lines: Ids, got: str, most: str) -> None:
    allowed = (
        f"expected at most {most} between two points, unless --jumps (in Python: jumps=True) allows more"
    )
    raise InputError(path, f"lines {lines[0]} and {lines[1]}", f"the path jumps, {got}: {allowed}")
