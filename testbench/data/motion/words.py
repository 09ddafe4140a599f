"""What every language asks of a program: a legal name, comments that stay comments, numbers in full."""

import re
from collections.abc import Sequence

import numpy as np

from testbench.arm.folder import Joint
from testbench.errors import Array, BenchError, check_array

LONGEST_COMMENT = 80  #: Characters of a label in a comment: a line of a controller's editor.
MAIN, EXTERNAL = 6, 6  #: Axes of a robot, and axes beside it, that KRL and RAPID know.
ROUNDING = 1e-6  #: By which a joint may be beyond its limit, as in files that are read [rad, m].
MARK = "p_"  #: Stands before a name that the language would not take.


def taken(words: str, *patterns: str) -> re.Pattern[str]:
    """Names that a language has a meaning for, in any case: words, and regular expressions of whole names."""
    return re.compile("|".join([*words.split(), *patterns]), re.IGNORECASE)


def identifier(name: str, longest: int, reserved: re.Pattern[str]) -> str:
    """A name as a language takes it: letters, digits and `_`, a letter first, no name that it has.

    Args:
        name: Any text.
        longest: Most characters.
        reserved: Names that the language has, see `taken`.
    """
    fit = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_") or "program"
    if not fit[0].isalpha() or reserved.fullmatch(fit):
        fit = MARK + fit
    return fit[:longest].rstrip("_")


def plain(text: str) -> str:
    """A text that no comment breaks at: one line of printable ASCII."""
    return re.sub(r"[^ -~]", "?", " ".join(text.split()))[:LONGEST_COMMENT].rstrip(" \\")


def comment(point: int, label: str) -> str:
    """What a comment says of a point, by its number from 1; so no label begins one (KRL's ;FOLD)."""
    return f"point {point}: {plain(label)}".rstrip(" :")


def check_moves(q: Array, joints: Sequence[Joint], labels: Sequence[str]) -> Array:
    """The joints, (points, n) [rad, m], within limits, labels as many or none; else a BenchError."""
    found = check_array(q, (None, len(joints)), "q [rad, m]")
    lower, upper = (np.array([getattr(joint, end) for joint in joints]) for end in ("lower", "upper"))
    for k, j in np.argwhere((found < lower - ROUNDING) | (found > upper + ROUNDING))[:1]:
        own = joints[j]
        low, high, got = (own.shown * x for x in (own.lower, own.upper, found[k, j]))
        limits = f"expected {low:.4f} to {high:.4f} {own.shown_unit}, its limits"
        raise BenchError(f"point {k + 1}, {plain(own.name)}: {limits}, got {got:.4f}")
    if len(labels) not in (0, len(found)):
        raise BenchError(f"labels: expected one for each of {len(found)} points, got {len(labels)}")
    return found


def split_axes(joints: Sequence[Joint]) -> tuple[list[int], list[int]]:
    """Which joints are axes of the robot and which are external, as KRL and RAPID count them.

    Up to six joints are the robot's. Of more, slides are external first, then the last hinges.

    Raises:
        BenchError: When there are more than both hold.
    """
    if len(joints) > MAIN + EXTERNAL:
        raise BenchError(f"joints: expected at most {MAIN + EXTERNAL}, got {len(joints)}")
    slides = [k for k, joint in enumerate(joints) if joint.prismatic]
    hinges = [k for k, joint in enumerate(joints) if not joint.prismatic]
    external = sorted([*slides, *reversed(hinges)][: max(len(joints) - MAIN, 0)])
    return [k for k in range(len(joints)) if k not in external], external


def numbers(values: Array, decimals: int) -> list[str]:
    """Numbers with fixed decimals; no zero has a sign."""
    return [f"{x:.{decimals}f}" for x in np.round(values, decimals) + 0.0]
