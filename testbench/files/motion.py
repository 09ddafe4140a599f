"""Writer of programs in robot languages: each from its template in testbench/languages.

A program stops at every point. Its name is valid, labels stay inside comments, and numbers are written in
full.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbench.arm.folder import ArmJoint, beyond_limits
from testbench.errors import Array, BenchError, Ids, Mask, check_array
from testbench.files.languages import FOLDER, Language, known_languages, language_of, with_mark
from testbench.runs.whole import write_whole

CSV = "csv"
"""Not a language: the table that `testbench.files.program` reads and writes."""
LONGEST_COMMENT = 80
"""Most characters of a label in a comment: a line of a controller's editor."""
LIMIT_ROUNDING = 1e-6
"""Largest excess of a joint over its limit, as in files that are read [rad, m]."""
FIT_PREFIX = "p_"
"""Prefix of a name that the language would not accept."""


@dataclass(frozen=True)
class Motion:
    """Hold the moves of a program.

    A point is written as its joints, or as the pose of the tool if `posed`; a language may need poses for
    linear moves.
    """

    q: Array  #: Joints of every point, (points, m) [rad, m], as files and pendants count them.
    joints: Sequence[ArmJoint]  #: Whose they are, `Arm.file_joints`.
    labels: Sequence[str] = ()  #: A comment a point, or none.
    linear: Mask | None = None  #: Which moves are along lines, (points,); None for none of them.
    posed: Mask | None = None  #: Which points are written as poses, (points,); None for none of them.
    position: Array | None = None  #: Positions of the tool, (points, 3) [m]; None without poses.
    rotation: Array | None = (
        None  #: Orientations, program's base from tool, (points, 3, 3); None without poses.
    )
    corrected: bool = False  #: Whether the points were corrected, which the program then says.


def format_of(path: Path) -> str:
    """Find the format of a file by its suffix.

    Args:
        path: The file.

    Returns:
        "csv" or the name of a language.

    Raises:
        BenchError: If the suffix states no format.
    """
    if path.suffix.lower() == f".{CSV}":
        return CSV
    language = language_of(path)
    if language is None:
        known = {CSV: [".csv"], **{name: own.suffixes for name, own in known_languages().items()}}
        ends = ", ".join(f"{suffixes[0]} ({name})" for name, suffixes in known.items())
        raise BenchError(f"{path}: expected a name that ends with one of {ends}")
    return language.name


def write_moves(path: Path, language: Language, motion: Motion, folder: Path = FOLDER) -> None:
    """Write a program named after its file, whole or not at all.

    Args:
        path: The file.
        language: One of `known_languages`.
        motion: The moves.
        folder: Folder of the language's template.

    Raises:
        BenchError: When the language has no place for such joints or moves, or the file cannot be written.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined  # here: few commands write programs

    points = _point_fields(language, motion)
    axes = axes_of(language, motion.joints)
    environment = Environment(
        loader=FileSystemLoader(folder),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    text = environment.get_template(f"{language.name}.j2").render(
        name=_identifier(path.stem, language),
        axes=[
            {
                "name": name,
                "title": _plain(motion.joints[k].name),
                "joint": f"{_plain(motion.joints[k].name)} [{motion.joints[k].display_unit}]",
            }
            for name, k in axes.items()
        ],
        points=points,
    )
    text = with_mark(text, language) if motion.corrected else text
    write_whole(text.replace("\n", language.newline), path)


def _point_fields(language: Language, motion: Motion) -> list[dict[str, object]]:
    """What a template is given of every point, numbers as texts."""
    q, count = _check_moves(motion), len(motion.q)
    axes = axes_of(language, motion.joints)
    scale = [scale_of(language, joint) for joint in motion.joints]
    joints = _texts(q * scale, language)
    linear, posed = (
        np.zeros(count, dtype=bool) if own is None else own for own in (motion.linear, motion.posed)
    )
    if language.linear_by == "pose" and (linear & ~posed).any():
        raise BenchError(f"{language.title}: expected a pose at every linear move")
    poses = [[""] * 7] * count
    if motion.position is not None and motion.rotation is not None:
        parts = (motion.position * language.per_metre, language.orientations(motion.rotation))
        poses = _texts(np.hstack(parts), language)
    elif posed.any():
        raise BenchError("position [m], rotation: expected poses of the tool, got none")
    main, external = (
        [axes[name] for name in names if name in axes] for names in (language.axes, language.external)
    )
    flags = turn_flags(language, q[:, main]) if main else np.zeros((count, 0), dtype=int)
    units = [motion.joints[k].display_unit for k in axes.values()]
    return [
        {
            "number": k,
            "comment": f"point {k + 1}: {_plain(motion.labels[k])}".rstrip(" :") if motion.labels else "",
            "linear": bool(linear[k]),
            "posed": bool(posed[k]),
            "main": [joints[k][j] for j in main],
            "external": [joints[k][j] for j in external],
            "position": poses[k][:3],
            "orientation": poses[k][3:],
            "named": list(zip(language.pose, poses[k], strict=False))
            if posed[k]
            else [(name, joints[k][j]) for name, j in axes.items()],
            "units": ["mm"] * 3 + ["deg"] * 3 if posed[k] else units,
            "flags": [*flags[k].tolist(), *[0] * len(language.axes)],
        }
        for k in range(count)
    ]


def _texts(values: Array, language: Language) -> list[list[str]]:
    """Write numbers with the language's decimals; no zero has a sign."""
    rounded = np.round(values, language.decimals) + 0.0
    return [[f"{x:.{language.decimals}f}" for x in row] for row in rounded.tolist()]


def axes_of(language: Language, joints: Sequence[ArmJoint]) -> dict[str, int]:
    """Assign joints to the axes of a language.

    The first joints are the robot's axes, as many as the language has. Of more, slides are external axes
    first, then the last hinges.

    Args:
        language: The language.
        joints: The joints as files count them.

    Returns:
        Indices of the joints by the names of axes: the robot's first, then external ones.

    Raises:
        BenchError: If there are more joints than axes, or joints that the language does not have.
    """
    main, external = len(language.axes), len(language.external)
    slides = [k for k, joint in enumerate(joints) if joint.prismatic]
    if language.exactly and (len(joints) != main or slides):
        got = f"{len(joints)}, {len(slides)} of them slides"
        raise BenchError(f"{language.title}: expected an arm of {main} joints that turn, got {got}")
    if len(joints) > main + external:
        raise BenchError(f"{language.title}: expected at most {main + external} joints, got {len(joints)}")
    hinges = [k for k, joint in enumerate(joints) if not joint.prismatic]
    outer = sorted([*slides, *reversed(hinges)][: max(len(joints) - main, 0)])
    inner = [k for k in range(len(joints)) if k not in outer]
    return dict(zip([*language.axes[: len(inner)], *language.external], [*inner, *outer], strict=False))


def scale_of(language: Language, joint: ArmJoint) -> float:
    """Return the size of a joint's unit in a language.

    Args:
        language: The language.
        joint: The joint.

    Returns:
        Its radian or metre in the language's units.
    """
    return language.per_metre if joint.prismatic else language.per_radian


def turn_flags(language: Language, q: Array) -> Ids:
    """Count the turns that a language states beside a pose.

    Args:
        language: The language.
        q: Joints as pendants count them, (points, k) [rad].

    Returns:
        Numbers of turns, (points, k); zero for a language without such flags.
    """
    if language.flags is None:
        return np.zeros(q.shape, dtype=int)
    period, offset = (math.radians(x) for x in (language.flags.period_deg, language.flags.offset_deg))
    return np.floor((q + offset) / period).astype(int)


def _identifier(name: str, language: Language) -> str:
    """Convert a name to a valid one: letters, digits and `_`, a letter first, not reserved."""
    fit = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_") or "program"
    if not fit[0].isalpha() or not language.takes(fit):
        fit = FIT_PREFIX + fit
    return fit[: language.names.longest].rstrip("_")


def _plain(text: str) -> str:
    """Convert a text to one line of printable ASCII, which cannot end a comment."""
    return re.sub(r"[^ -~]", "?", " ".join(text.split()))[:LONGEST_COMMENT].rstrip(" \\")


def _check_moves(motion: Motion) -> Array:
    """Check that joints, (points, m) [rad, m], are within limits and labels as many; else a BenchError."""
    joints, labels = motion.joints, motion.labels
    found = check_array(motion.q, (None, len(joints)), "q [rad, m]")
    for k, problem in beyond_limits(joints, found, LIMIT_ROUNDING):
        raise BenchError(f"point {k + 1}, {problem}")
    if len(labels) not in (0, len(found)):
        raise BenchError(f"labels: expected one for each of {len(found)} points, got {len(labels)}")
    return found
