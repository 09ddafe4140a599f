"""Reader of programs in robot languages: motions in order, and where the numbers of their points are.

A language's table says what its points and moves look like. Comments and texts in quotes are blanked first,
so that a place in what is searched is the place in the file. The corrected program is the same text with
other numbers.

Writer of programs in robot languages: each from its template in testbench/languages.

A program stops at every point. Its name is valid, labels stay inside comments, and numbers are written in
full.
"""

import math
import re
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from testbench.arm.document import is_decimal
from testbench.arm.folder import ArmJoint
from testbench.errors import Array, BenchError, Ids, InputError, Mask, check_array, read_bytes
from testbench.files.languages import FLAGS, FOLDER, Language, TargetSyntax, known_languages, language_of
from testbench.runs.whole import write_whole

# --- Reader of programs in robot languages: motions in order, and where the numbers of their points are -----

MAX_BYTES = 50_000_000  #: Largest program that is read [byte].
MAX_SHOWN = 40  #: Most characters of a statement in a message.
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.])")
COMPUTED = re.compile(r"\s*[-+*/^]")  #: Behind a number that is a part of a formula.
SPLIT = re.compile(r"\s*,\s*[\d.]")  #: Behind a number with a decimal comma, where axes have names.
MARK = "Corrected by testbench"  #: Remark of a program whose points were corrected.
NO_FRAME = r"(?:tool|wobj|base)?0|\$NULLFRAME"  #: Name of a frame that is none.
ANY = "Linear moves and moves of the joints to points in the program are read"


@dataclass(frozen=True)
class Source:
    """Hold a file of a program."""

    path: Path
    text: str  #: All of it.
    code: str  #: The same with blanks for comments and for what is quoted.
    encoding: str  #: How its bytes are letters.

    @cached_property
    def _ends(self) -> list[int]:
        return [match.start() for match in re.finditer("\n", self.text)]

    def line(self, place: int) -> int:
        """Return the line of a place in the text, from 1."""
        return bisect_right(self._ends, place - 1) + 1

    def error(self, place: int, problem: str) -> InputError:
        """Make the error about a place in the text.

        Args:
            place: The place, from 0.
            problem: What was expected, and what was found.

        Returns:
            The error.
        """
        return InputError(self.path, f"line {self.line(place)}", problem)


@dataclass(frozen=True)
class Number:
    """Hold a number of a point."""

    value: float
    start: int  #: Where it begins in the text.
    end: int


@dataclass(frozen=True)
class PointText:
    """Hold a point of a program: its numbers, and where they are."""

    source: int  #: Number of its file.
    start: int  #: Where it begins.
    end: int  #: Where it ends.
    name: str  #: Its name; "" for one that stands in a move.
    posed: bool  #: Whether it is a pose, not joints.
    mode: str  #: Mode that was in force, in capitals.
    numbers: Mapping[str, Number]  #: By the language's name of the axis.
    flags: tuple[int, ...] = ()  #: Numbers of turns beside a pose, of the language's axes of flags.
    same: str = ""  #: Its configuration, which is not read.


@dataclass(frozen=True)
class MoveText:
    """Hold a move of a program."""

    start: int  #: Where it begins in the program.
    linear: bool
    point: PointText
    near: PointText | None = None  #: Joints that choose the configuration of its pose.


@dataclass(frozen=True)
class FrameText:
    """Hold the tool or the base that a program states."""

    text: str  #: Its name, its number, or its numbers.
    numbers: tuple[float, ...]  #: One pose, or two, the second one in the first; none if they are not known.


@dataclass(frozen=True)
class ProgramText:
    """Hold a program in a robot language."""

    language: Language
    sources: tuple[Source, ...]  #: The program, and the file of points beside it, if there is one.
    points: tuple[PointText, ...]  #: All points with numbers, in the order of the text.
    moves: tuple[MoveText, ...]  #: All moves to such points, in their order.
    notes: tuple[str, ...]  #: How the program was read.
    frames: Mapping[str, FrameText] = field(default_factory=dict)  #: What it states of `tool` and `base`.
    others: tuple[str, ...] = ()  #: Axes of its points that are not the robot's.
    mark: tuple[Path, int] | None = None  #: File and line that say that it was corrected; None if none does.

    @property
    def path(self) -> Path:
        """Return the program's file."""
        return self.sources[0].path

    @property
    def lines(self) -> Ids:
        """Return the line of every move, (moves,)."""
        return np.array([self.sources[0].line(move.start) for move in self.moves], dtype=int)

    @property
    def labels(self) -> tuple[str, ...]:
        """Name every move by its point, or by its number."""
        return tuple(move.point.name or str(k) for k, move in enumerate(self.moves, start=1))


def read_motions(path: Path, language: Language) -> ProgramText:
    """Read the moves of a program, and the points that they go to.

    Args:
        path: The program.
        language: Its language.

    Returns:
        The program.

    Raises:
        InputError: Names file, line and statement, if a motion is not linear or of the joints, a point has no
            numbers in the program, or tool or base change.
    """
    program = read_points(path, language)
    for source in program.sources:
        for what, pattern in language.refused.items():
            for found in re.finditer(pattern, source.code, FLAGS):
                got = " ".join(found[0].split())[:MAX_SHOWN]
                at = found.start() + len(found[0]) - len(found[0].lstrip())
                raise source.error(at, f"{what} is not read, got {got}. {ANY}")
    frames = _one_of_each_frame(program)
    moves, left = _moves(program)
    if not moves:
        raise InputError(path, "", f"expected moves in this {language.title} program, got none")
    _refuse_assigned(program, moves)
    notes = tuple(
        f"Moves to {name} are unchanged, because its coordinates are not in the program" for name in left
    )
    every = (re.findall(language.moves.others, source.code, FLAGS) for source in program.sources)
    others = tuple(sorted({found.upper() for own in every for found in own}))
    mark = _mark(program)
    return ProgramText(language, program.sources, program.points, moves, notes, frames, others, mark)


def _mark(program: ProgramText) -> tuple[Path, int] | None:
    """Find the first remark that says that the program was corrected."""
    said = re.compile(rf"{re.escape(program.language.comment)}[^\n]*\b{MARK}\b", re.IGNORECASE)
    found = ((source, match) for source in program.sources for match in said.finditer(source.text))
    return next(((source.path, source.line(match.start())) for source, match in found), None)


def with_mark(text: str, language: Language) -> str:
    """Add the remark that a program was corrected, behind its first line that may have one behind it.

    Args:
        text: The program, or a file of its points.
        language: Its language.

    Returns:
        The text with a further line; the first one where no line may have it behind it.
    """
    found = re.search(language.remark_after, text, FLAGS)
    newline = "\r\n" if "\r\n" in text else "\n"
    at = 0 if found is None else text.find("\n", found.start()) + 1
    return f"{text[:at]}{language.remark.format(MARK)}{newline}{text[at:]}"


def read_points(path: Path, language: Language) -> ProgramText:
    """Read the points of a program without its moves, as of a log of joints.

    Args:
        path: The program.
        language: Its language.

    Returns:
        The program, without moves.

    Raises:
        InputError: If a file cannot be read.
    """
    sources = tuple(_source(own, language) for own in files_of(path, language))
    points = [point for k, source in enumerate(sources) for point in _points(k, source, language)]
    return ProgramText(language, sources, tuple(points), (), ())


def files_of(path: Path, language: Language) -> list[Path]:
    """List the files of a program.

    Args:
        path: The program.
        language: Its language.

    Returns:
        The program, and the file beside it that may hold its points, if there is one.
    """
    if not language.beside or path.suffix.lower() not in language.suffixes:
        return [path]
    beside = path.with_suffix(language.beside.upper() if path.suffix.isupper() else language.beside)
    return [path, beside] if beside.is_file() else [path]


def _source(path: Path, language: Language) -> Source:
    content = read_bytes(path, MAX_BYTES)
    encoding = "utf-8"
    try:
        text = content.decode()
    except UnicodeDecodeError:
        encoding = "latin-1"  # gives every byte back
        text = content.decode(encoding)
    if "\0" in text:
        raise InputError(path, "", "expected a program as text, got a zero byte")
    hidden = re.compile(rf'"[^"\n]*"|{re.escape(language.comment)}[^\n]*')
    code = hidden.sub(lambda m: re.sub(r"[^\r]", " ", m[0]), text)
    return Source(path, text, code, encoding)


class _Stated:
    """Hold what a statement says along a text, in its group."""

    def __init__(self, pattern: str, code: str) -> None:
        found = [*re.finditer(pattern, code, FLAGS)]
        self._starts, self._words = [own.start() for own in found], [own[1] for own in found]

    def before(self, place: int) -> str:
        """Return what the last statement that begins before a place says; "" where there is none."""
        count = bisect_left(self._starts, place)
        return self._words[count - 1] if count else ""


def _points(k: int, source: Source, language: Language) -> Iterator[PointText]:
    """Find all points of a file that have numbers, in their order."""
    modes = _Stated(language.mode or "(?!)", source.code)
    turns, point_texts = language.flags, list[PointText]()
    same = _Stated("(?!)" if turns is None else turns.same, source.code)
    for syntax in language.targets:
        for match in re.finditer(syntax.pattern, source.code, FLAGS):
            mode = modes.before(match.start()).upper()
            if (not syntax.modes or mode in syntax.modes) and (
                numbers := _numbers(match, syntax, language, source)
            ):
                name = match["name"] or "" if "name" in match.re.groupindex else ""
                posed = syntax.holds == "pose"
                flags = turns.found(match["target"]) if turns and posed else ()
                kept = same.before(match.end()) if posed else ""
                point = PointText(k, *match.span("target"), name, posed, mode, numbers, flags, kept)
                point_texts.append(point)
    yield from sorted(point_texts, key=lambda point: point.start)


def _numbers(
    match: re.Match[str], syntax: TargetSyntax, language: Language, source: Source
) -> dict[str, Number]:
    """The numbers of a point by axis; none where a part is no number."""
    names = language.pose_names() if syntax.holds == "pose" else language.axes
    if "named" in match.re.groupindex:
        ours = {name.casefold(): name for name in (*names, *language.external)}
        pairs = re.finditer(r"\b([A-Za-z]\d?)\s*=?\s*(?=[-+.\d])", match["named"])
        own = [(ours.get(pair[1].casefold(), ""), match.start("named") + pair.end()) for pair in pairs]
    else:
        parts = {"main": language.axes, "position": names[:3], "orientation": names[3:]}
        own = []
        for group, part in {**parts, "external": language.external}.items():
            if group in match.re.groupindex:
                places = [m.start() + match.start(group) for m in re.finditer(r"[^,\s]+", match[group])]
                own += list(zip([*part, *[""] * len(places)], places, strict=False))
    found: dict[str, Number] = {}
    for name, at in own:
        number = NUMBER.match(source.code, at)
        if name and number and is_decimal(number[0]):
            split = "named" in match.re.groupindex and SPLIT.match(source.code, number.end())
            if split or COMPUTED.match(source.code, number.end(), match.end()):
                return {}
            found.setdefault(name, Number(float(number[0]), *number.span()))
    return found


def _one_of_each_frame(program: ProgramText) -> dict[str, FrameText]:
    """Find what a program says of tool and base, tool0 and the like left out; refuse it if they change."""
    frames = dict[str, FrameText]()
    for what, patterns in program.language.frames.items():
        for pattern in patterns:
            first = ""
            for k, source in enumerate(program.sources):
                for found in re.finditer(pattern, source.code, FLAGS):
                    group = next((n for n, own in enumerate(found.groups(), 1) if own), 0)
                    said = " ".join(found[group].split()) if group else program.language.no_frame
                    if first and said.casefold() != first.casefold():
                        expected = f"expected one {what} in the program, got {first} and then {said}"
                        at = found.start() + len(found[0]) - len(found[0].lstrip())
                        raise source.error(at, f"the {what} changes: {expected}")
                    if not first and not re.fullmatch(NO_FRAME, said, FLAGS):
                        data = program.language.frame_data.get(what, "(?!)")
                        numbers = _frame_numbers(program, k, found.start(group), said, data)
                        frames[what] = FrameText(said, numbers)
                    first = first or said
    return frames


def _frame_numbers(program: ProgramText, k: int, at: int, name: str, data: str) -> tuple[float, ...]:
    """The numbers of a frame that stands at a place of a file, or is declared by name; none if it is not."""
    names = program.language.pose_names()
    for point in program.points:
        if (point.source, point.start) == (k, at) and all(own in point.numbers for own in names):
            return tuple(point.numbers[own].value for own in names)
    for source in program.sources:
        for found in re.finditer(data, source.code, FLAGS):
            numbers = tuple(float(own[0]) for own in NUMBER.finditer(found["numbers"]))
            if found["name"].casefold() == name.casefold() and len(numbers) % len(names) == 0:
                return numbers
    return ()


def _refuse_assigned(program: ProgramText, moves: Sequence[MoveText]) -> None:
    """Refuse a program that assigns anything but its numbers to a point to which it moves."""
    places = {(move.point.source, move.point.start) for move in moves}
    names = {move.point.name.casefold() for move in moves if move.point.name}
    for k, source in enumerate(program.sources):
        for found in re.finditer(program.language.moves.assigned, source.code, FLAGS):
            if found["name"].casefold() in names and (k, found.end()) not in places:
                got = re.split(r"[\n;]", source.text[found.start() :].strip())[0].strip()[:MAX_SHOWN]
                problem = f"point that changes while the program runs is not read, got {got}. {ANY}"
                raise source.error(found.start("name"), problem)


def _moves(program: ProgramText) -> tuple[tuple[MoveText, ...], list[str]]:
    """The moves to points with numbers, and the names of points that stay as they are."""
    language, source = program.language, program.sources[0]
    syntax, named = language.moves, dict[str, PointText]()
    here = {point.start: point for point in program.points if point.source == 0}
    twice = dict[str, PointText]()
    for point in program.points:
        if point.name and named.setdefault(point.name.casefold(), point) is not point:
            twice[point.name.casefold()] = point
    starts = [
        (match, linear)
        for linear, pattern in ((False, syntax.joint), (True, syntax.linear))
        for match in re.finditer(pattern, source.code, FLAGS)
    ]

    def point_at(at: int, place: int) -> PointText | None:
        """The point that stands at a place of the program, or is named there."""
        name = re.compile(syntax.point, FLAGS).match(source.code, at)
        if at in here or name is None:
            return here.get(at)
        if name["name"].casefold() in twice:
            raise source.error(place, f"the program defines the point {name['name']} twice")
        return named.get(name["name"].casefold())

    moves, left = list[MoveText](), dict[str, None]()
    for match, linear in sorted(starts, key=lambda own: own[0].start()):
        at = match.end()
        place = match.start() + len(match[0]) - len(match[0].lstrip())
        if (goal := point_at(at, place)) is not None:
            behind = re.compile(syntax.near, FLAGS).match(
                source.code, goal.end if at in here else at + len(goal.name)
            )
            near = point_at(behind.end(), place) if behind else None
            moves.append(MoveText(place, linear, goal, None if near is None or near.posed else near))
        elif stays := re.compile(syntax.elsewhere, FLAGS).match(source.code, at):
            left[" ".join(stays[0].split())] = None
        else:
            got = re.split(r"[\n;]", source.text[at:])[0].strip()[:MAX_SHOWN]
            where = f" or in {program.path.stem}{language.beside} beside it" * bool(language.beside)
            problem = f"expected a point whose coordinates are in the program{where}, got {got!r}"
            raise source.error(place, problem)
    return tuple(moves), list(left)


def values_of(
    program: ProgramText, points: Sequence[PointText], names: Sequence[str], optional: int | None = None
) -> Array:
    """Read numbers of points.

    Args:
        program: The program.
        points: Some of its points.
        names: Names of the axes, k of them.
        optional: Count of the first axes that must be there; None for all.

    Returns:
        Numbers as the language writes them, (points, k); NaN for one that may be missing.

    Raises:
        InputError: Names line and axis of the first number that is missing.
    """
    found = np.full((len(points), len(names)), np.nan)
    for row, point in enumerate(points):
        for k, name in enumerate(names):
            if name in point.numbers:
                found[row, k] = point.numbers[name].value
            elif optional is None or k < optional:
                source = program.sources[point.source]
                problem = f"expected a number for each of {', '.join(names)}, got none for {name}"
                raise source.error(point.start, f"point {point.name}".strip() + f": {problem}")
    return found


def changed_texts(
    program: ProgramText, changes: Mapping[tuple[int, int], Mapping[str, float]]
) -> list[tuple[Source, bytes]]:
    """Write the files of a program with other numbers; all else stays as it is, byte for byte.

    A number that changes by less than half of the last decimal that the language writes stays as it is.

    Args:
        program: The program.
        changes: New numbers by axis, for points by file and start.

    Returns:
        Every file with its new content.
    """
    decimals = program.language.decimals
    pieces: list[list[tuple[int, int, str]]] = [[] for _ in program.sources]
    for point in program.points:
        for name, value in changes.get((point.source, point.start), {}).items():
            old = point.numbers[name]
            if abs(value - old.value) >= 0.5 * 10**-decimals:
                pieces[point.source].append(
                    (old.start, old.end, f"{round(value, decimals) + 0.0:.{decimals}f}")
                )
    found = []
    for source, own in zip(program.sources, pieces, strict=True):
        text, at = list[str](), 0
        for start, end, number in sorted(own):
            text += [source.text[at:start], number]
            at = end
        found.append((source, "".join([*text, source.text[at:]]).encode(source.encoding)))
    return found


# --- Writer of programs in robot languages: each from its template in testbench/languages -------------------

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
        pairs = ", ".join(f"{suffixes[0]} ({name})" for name, suffixes in known.items())
        raise BenchError(f"{path}: expected a file called {pairs}")
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
                "joint": f"{_plain(motion.joints[k].name)} [{motion.joints[k].shown_unit}]",
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
    units = [motion.joints[k].shown_unit for k in axes.values()]
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
    lower, upper = (np.array([getattr(joint, end) for joint in joints]) for end in ("lower", "upper"))
    for k, j in np.argwhere((found < lower - LIMIT_ROUNDING) | (found > upper + LIMIT_ROUNDING))[:1]:
        own = joints[j]
        low, high, got = (own.shown * x for x in (own.lower, own.upper, found[k, j]))
        limits = f"expected {low:.4f} to {high:.4f} {own.shown_unit}, its limits"
        raise BenchError(f"point {k + 1}, {_plain(own.name)}: {limits}, got {got:.4f}")
    if len(labels) not in (0, len(found)):
        raise BenchError(f"labels: expected one for each of {len(found)} points, got {len(labels)}")
    return found
