"""Programs of joint moves in robot languages: KUKA KRL, ABB RAPID, URScript of Universal Robots.

A program stops at every point. Its name is valid, labels stay inside comments, and numbers are written in
full.
"""

import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbench.arm.folder import ArmJoint
from testbench.errors import Array, BenchError, check_array
from testbench.runs.whole import write_whole

CSV = "csv"
"""Not a language: the table that `testbench.files.program` reads and writes."""
LONGEST_COMMENT = 80
"""Most characters of a label in a comment: a line of a controller's editor."""
MAIN, EXTERNAL = 6, 6
"""Most robot axes and external axes in KRL and RAPID."""
LIMIT_ROUNDING = 1e-6
"""Largest excess of a joint over its limit, as in files that are read [rad, m]."""
MARK = "p_"
"""Prefix of a name that the language would not accept."""
KRL_SETTINGS = ("BAS(#INITMOV,0)", "BAS(#VEL_PTP,10)", "BAS(#ACC_PTP,20)")
"""Speed and acceleration, shares of what every axis can do [%]."""
RAPID_PREFIX = "run_"  #: Of the procedure: a module and a procedure in it have different names.
RAPID_SPEED = "[100,30,100,30]"
"""Of the tool [mm/s, deg/s] and of external axes [mm/s, deg/s]."""
NO_AXIS = "9E9"  #: An external axis of RAPID that is not there.
URSCRIPT_RATES = "a=0.5, v=0.25"  #: Acceleration and speed of the joint that leads [rad/s^2, rad/s].


@dataclass(frozen=True)
class _Moves:
    """Hold the content of a program."""

    name: str  #: Name, valid in the language.
    joints: tuple[str, ...]  #: Name and unit of every joint, in comments.
    main: list[int]  #: Joints that are robot axes.
    external: list[int]  #: Joints that are external axes.
    points: list[list[str]]  #: Numbers of every point, one per joint.
    comments: list[str]  #: One comment per point, or none.

    def lines(self, mark: str, move: Callable[[list[str], list[str]], str]) -> Iterator[str]:
        """Every point: its comment behind a mark, then the move of main and external axes."""
        for k, point in enumerate(self.points):
            if self.comments:
                yield f"{mark} {self.comments[k]}"
            yield move(*([point[j] for j in own] for own in (self.main, self.external)))


def _krl(moves: _Moves) -> Iterator[str]:
    """Write a .src of PTP moves of the axes A1 to A6 and E1 on."""
    axes = [f"A{k + 1}" for k in range(len(moves.main))]
    axes += [f"E{k + 1}" for k in range(len(moves.external))]

    def move(main: list[str], external: list[str]) -> str:
        every = zip(axes, [*main, *external], strict=True)
        return f"PTP {{{','.join(f'{axis} {x}' for axis, x in every)}}}"

    yield f"DEF {moves.name}()"
    for axis, k in zip(axes, [*moves.main, *moves.external], strict=True):
        yield f"; {axis} is {moves.joints[k]}"
    yield from KRL_SETTINGS
    yield from moves.lines(";", move)
    yield "END"


def _rapid(moves: _Moves) -> Iterator[str]:
    """Write a module of MoveAbsJ; joints beyond six, and slides, are external axes."""

    def move(main: list[str], external: list[str]) -> str:
        robot = ",".join(main + ["0"] * (MAIN - len(main)))
        beside = ",".join(external + [NO_AXIS] * (EXTERNAL - len(external)))
        return f"    MoveAbsJ [[{robot}],[{beside}]]\\NoEOffs,vMove,fine,tool0;"

    yield f"MODULE {moves.name}"
    for k, joint in enumerate(moves.main):
        yield f"  ! rax_{k + 1} is {moves.joints[joint]}"
    for letter, joint in zip("abcdef", moves.external, strict=False):
        yield f"  ! eax_{letter} is {moves.joints[joint]}"
    yield f"  LOCAL CONST speeddata vMove:={RAPID_SPEED};"
    yield f"  PROC {RAPID_PREFIX}{moves.name}()"
    yield from moves.lines("    !", move)
    yield "  ENDPROC"
    yield "ENDMODULE"


def _urscript(moves: _Moves) -> Iterator[str]:
    """Write a function of movej."""
    yield f"def {moves.name}():"
    yield f"  # joints [rad]: {', '.join(joint.removesuffix(' [deg]') for joint in moves.joints)}"
    yield from moves.lines("  #", lambda main, _: f"  movej([{', '.join(main)}], {URSCRIPT_RATES})")
    yield "end"


@dataclass(frozen=True)
class JointSyntax:
    """Describe a robot language."""

    lines: Callable[[_Moves], Iterator[str]]
    title: str  #: Name in reports.
    suffix: str  #: Suffix of its files.
    newline: str  #: Line ending.
    begins: str  #: Regular expression of the beginning of a file that we wrote.
    longest: int  #: Most characters of a name.
    words: str  #: Reserved words, in any case.
    patterns: list[str]  #: Regular expressions of further reserved words.
    decimals: int  #: Decimals of a number; a controller keeps about seven digits of degrees and millimetres.
    radians: bool = False  #: Whether it has six hinges in radians; otherwise degrees and millimetres.

    def takes(self, name: str) -> bool:
        """Tell whether a name is free to use: no reserved word of the language.

        Args:
            name: The name.

        Returns:
            False for a reserved word or a pattern of the language.
        """
        taken = "|".join([*self.words.split(), *self.patterns])
        return re.fullmatch(taken, name, re.IGNORECASE) is None


_LINES = {"krl": _krl, "rapid": _rapid, "urscript": _urscript}
_DECLARED = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
WRITERS: Mapping[str, JointSyntax] = {
    name: JointSyntax(lines, **_DECLARED[name]) for name, lines in _LINES.items()
}


def format_of(path: Path) -> str:
    """Find the format of a file by its suffix.

    Args:
        path: The file.

    Returns:
        "csv" or a key of `WRITERS`.

    Raises:
        BenchError: If the suffix states no format.
    """
    known = {CSV: ".csv", **{name: language.suffix for name, language in WRITERS.items()}}
    found = [name for name, suffix in known.items() if suffix == path.suffix.lower()]
    if not found:
        pairs = ", ".join(f"{suffix} ({name})" for name, suffix in known.items())
        raise BenchError(f"{path}: expected a file called {pairs}")
    return found[0]


def write_moves(
    path: Path, language: JointSyntax, q: Array, joints: Sequence[ArmJoint], labels: Sequence[str] = ()
) -> None:
    """Write a program named after its file, whole or not at all.

    Args:
        path: The file.
        language: One of `WRITERS`.
        q: Joints of every point, (points, n) [rad, m], as files and pendants count them.
        joints: Whose they are, `Arm.file_joints`.
        labels: A comment a point, or none.

    Raises:
        BenchError: When the language has no place for such joints, or the file cannot be written.
    """
    q = _check_moves(q, joints, labels)
    slides = sum(joint.prismatic for joint in joints)
    if language.radians and (len(joints) != MAIN or slides):
        got = f"{len(joints)}, {slides} of them slides"
        raise BenchError(f"{language.title}: expected an arm of {MAIN} joints that turn, got {got}")
    main, external = _split_axes(joints)
    scale = 1.0 if language.radians else np.array([joint.shown for joint in joints])
    numbers = np.round(q * scale, language.decimals) + 0.0  # no zero has a sign
    moves = _Moves(
        name=_identifier(path.stem, language),
        joints=tuple(f"{_plain(joint.name)} [{joint.shown_unit}]" for joint in joints),
        main=main,
        external=external,
        points=[[f"{x:.{language.decimals}f}" for x in point] for point in numbers.tolist()],
        comments=[f"point {k}: {_plain(label)}".rstrip(" :") for k, label in enumerate(labels, start=1)],
    )
    write_whole("".join(f"{line}{language.newline}" for line in language.lines(moves)), path)


def _identifier(name: str, language: JointSyntax) -> str:
    """Convert a name to a valid one: letters, digits and `_`, a letter first, not reserved."""
    fit = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_") or "program"
    if not fit[0].isalpha() or not language.takes(fit):
        fit = MARK + fit
    return fit[: language.longest].rstrip("_")


def _plain(text: str) -> str:
    """Convert a text to one line of printable ASCII, which cannot end a comment."""
    return re.sub(r"[^ -~]", "?", " ".join(text.split()))[:LONGEST_COMMENT].rstrip(" \\")


def _check_moves(q: Array, joints: Sequence[ArmJoint], labels: Sequence[str]) -> Array:
    """Check that joints, (points, n) [rad, m], are within limits and labels as many; else a BenchError."""
    found = check_array(q, (None, len(joints)), "q [rad, m]")
    lower, upper = (np.array([getattr(joint, end) for joint in joints]) for end in ("lower", "upper"))
    for k, j in np.argwhere((found < lower - LIMIT_ROUNDING) | (found > upper + LIMIT_ROUNDING))[:1]:
        own = joints[j]
        low, high, got = (own.shown * x for x in (own.lower, own.upper, found[k, j]))
        limits = f"expected {low:.4f} to {high:.4f} {own.shown_unit}, its limits"
        raise BenchError(f"point {k + 1}, {_plain(own.name)}: {limits}, got {got:.4f}")
    if len(labels) not in (0, len(found)):
        raise BenchError(f"labels: expected one for each of {len(found)} points, got {len(labels)}")
    return found


def _split_axes(joints: Sequence[ArmJoint]) -> tuple[list[int], list[int]]:
    """Divide the joints into robot axes and external axes, as KRL and RAPID count them.

    Up to six joints are robot axes. Of more, slides are external first, then the last hinges.

    Raises:
        BenchError: If there are more than both can hold.
    """
    if len(joints) > MAIN + EXTERNAL:
        raise BenchError(f"joints: expected at most {MAIN + EXTERNAL}, got {len(joints)}")
    slides = [k for k, joint in enumerate(joints) if joint.prismatic]
    hinges = [k for k, joint in enumerate(joints) if not joint.prismatic]
    external = sorted([*slides, *reversed(hinges)][: max(len(joints) - MAIN, 0)])
    return [k for k in range(len(joints)) if k not in external], external
