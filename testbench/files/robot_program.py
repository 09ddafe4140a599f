"""Points of a program in a robot language: joints of the chain, or poses of the tool in the world."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbench.arm.folder import Arm
from testbench.errors import Array, Ids, InputError, Mask
from testbench.files.languages import Language
from testbench.files.mapping import Controller
from testbench.files.motion import axes_of, scale_of, turn_flags
from testbench.files.motion_read import PointText, ProgramText, read_motions, values_of
from testbench.files.rows import ROUNDED, SAME_POSE

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
    axes, in_file = axes_of(text.language, arm.file_joints), arm.to_file(q)
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
    """Refuse poses whose configuration is not read where it would choose between several.

    Args:
        motions: The program.
        started: Whether joints before the first pose are known.

    Raises:
        InputError: If the program begins with such a pose and no joints are known; or if such configurations
            differ.
    """
    text, turns, first = motions.text, motions.text.language.flags, ""
    if turns is None or turns.read:
        return
    for k, move in enumerate(text.moves):
        point, source = move.point, text.sources[move.point.source]
        if not point.same:
            continue
        if k == 0 and not started:
            problem = f"the configuration {turns.name} {point.same.strip()!r} is not read; "
            problem += "begin with joints, or give compensate --start"
            raise source.error(point.start, f"the program begins with a pose: {problem}")
        if first and point.same.split() != first.split():
            problem = (
                f"expected one configuration in all poses, got {first.strip()!r} and {point.same.strip()!r}"
            )
            raise source.error(point.start, f"{turns.name} is not read: {problem}")
        first = first or point.same


@dataclass(frozen=True, eq=False)
class RobotPoints:
    """Hold what `read_robot_program` finds."""

    motions: RobotMotions
    q: Array  #: Joints of the chain, (points, n) [rad, m]; NaN at a pose.
    position: Array  #: Positions of the arm's tool in the world, (points, 3) [m]; NaN at joints.
    rotation: Array  #: Its orientations, (points, 3, 3); NaN at joints.


def read_robot_program(path: Path, language: Language, arm: Arm, controller: Controller) -> RobotPoints:
    """Read a program in a robot language.

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
    count = len(points)
    motions = RobotMotions(
        text,
        linear=np.array([move.linear for move in text.moves], dtype=bool),
        posed=posed,
        base=_frame(path, language, controller.base, "controller.base"),
        tool=_frame(path, language, controller.tool, "controller.tool"),
        pulses_per_deg=tuple(controller.pulses_per_deg),
    )
    q = np.full((count, arm.n_joints), np.nan)
    if not posed.all():
        q[~posed] = _program_joints(motions, arm)
    position, rotation = np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan)
    if posed.any():
        axes = axes_of(language, arm.file_joints)
        if set(axes) & set(language.external):
            raise InputError(path, "", "poses of an arm with external axes are not read: give joints")
        own = values_of(text, [point for point in points if point.posed], language.pose_names())
        if language.rotation == "quaternion" and (np.linalg.norm(own[:, 3:], axis=1) < MIN_NORM).any():
            raise InputError(path, "", "expected quaternions of norm 1 in every pose")
        position[posed], rotation[posed] = motions.to_world(
            own[:, :3] / language.per_metre, language.rotations(own[:, 3:])
        )
    return RobotPoints(motions, q, position, rotation)


def _frame(path: Path, language: Language, numbers: list[float], place: str) -> Pose:
    """A frame as the language writes a pose; none is the identity."""
    if not numbers:
        return np.eye(3), np.zeros(3)
    names = language.pose_names()
    if len(numbers) != len(names):
        expected = f"expected {len(names)} numbers as a pose in {language.title}, got {len(numbers)}"
        raise InputError(path, place, expected)
    values = np.array([numbers], dtype=float)
    return language.rotations(values[:, 3:])[0], values[0, :3] / language.per_metre


def _program_joints(motions: RobotMotions, arm: Arm) -> Array:
    """Joints of the chain of all points that are no poses, (points, n) [rad, m], within limits."""
    text, joints = motions.text, arm.file_joints
    axes, language = axes_of(text.language, joints), text.language
    points = [move.point for move in text.moves if not move.point.posed]
    for point in points:
        outer = [name for name in language.external if name in point.numbers and name not in axes]
        moved = [name for name in outer if 0 < abs(point.numbers[name].value) < language.no_axis]
        if moved:
            problem = f"expected no external axis {moved[0]}: {arm.name} has {len(joints)} joints"
            raise text.sources[point.source].error(point.start, problem)
    values = values_of(text, points, list(axes))
    scale = np.array([scale_of(language, joints[k]) for k in axes.values()])
    found = np.empty_like(values)
    found[:, list(axes.values())] = values / scale
    counted = np.array([bool(language.pulses) and point.mode == language.pulses for point in points])
    if counted.any():
        per = motions.pulses_per_deg
        if len(per) != len(joints):
            first = points[int(counted.argmax())]
            problem = (
                f"joints are pulses: expected pulses_per_deg of {len(joints)} motors in [controller] of a "
                f"map, got {len(per)}"
            )
            raise text.sources[first.source].error(first.start, problem)
        found[counted] = np.radians(values[counted] / np.array(per))
    _check_limits(motions, arm, points, found)
    q = arm.to_model(found)
    ends = arm.within(q)
    if (np.abs(q - ends) > ROUNDED).any():
        row, k = np.argwhere(np.abs(q - ends) > ROUNDED)[0]
        problem = f"{arm.joints[k].name} of the chain is beyond its limits"
        raise text.sources[points[row].source].error(points[row].start, problem)
    return np.asarray(np.where(np.abs(q - ends) > SAME_POSE, ends, q))


def _check_limits(motions: RobotMotions, arm: Arm, points: Sequence[PointText], q: Array) -> None:
    """Refuse joints as files count them, (points, m) [rad, m], beyond their limits."""
    joints = arm.file_joints
    lower, upper = (np.array([getattr(joint, end) for joint in joints]) for end in ("lower", "upper"))
    for row, k in np.argwhere((q < lower - ROUNDED) | (q > upper + ROUNDED))[:1].tolist():
        joint, point = joints[k], points[row]
        low, high, got = (joint.shown * x for x in (joint.lower, joint.upper, q[row, k]))
        problem = f"{joint.name}: expected {low:.4f} to {high:.4f} {joint.shown_unit}, got {got:.4f}"
        raise motions.text.sources[point.source].error(point.start, problem)


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
    as_joints, posed = arm.to_file(q), motions.posed
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
