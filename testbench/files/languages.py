"""Robot languages: the conventions of each one as a TOML file of testbench/languages, beside its template.

Reader of programs in robot languages: motions in order, and where the numbers of their points are.

A language's table says what its points and moves look like. Comments and texts in quotes are blanked first,
so that a place in what is searched is the place in the file. The corrected program is the same text with
other numbers.
"""

import math
import re
import warnings
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field, ValidationError, model_validator

from testbench.arm.document import (
    StrictModel,
    first_invalid_value,
    is_decimal,
    parse_toml,
    text_matching,
    toml_place,
)
from testbench.errors import Array, Ids, InputError, read_bytes, read_text
from testbench.model.vjm import rotation_matrices

# --- Conventions of the languages --------------------------------------------------------------------------

FOLDER = Path(__file__).parents[1] / "languages"
MAX_BYTES = 20_000  #: Size of a language's table [byte].
MM = 1e-3  #: Metres per millimetre.
FLAGS = re.MULTILINE | re.IGNORECASE
Notation = Annotated[
    str,
    text_matching(
        "vector|quaternion|(intrinsic|extrinsic) [xyz]{3}",
        '"vector", "quaternion", "intrinsic xyz" or "extrinsic xyz" with the axes in their order',
    ),
]
"""How a pose states its orientation: three or four numbers behind those of the position."""


def _compiles(pattern: str) -> str:
    """Return a regular expression that compiles; else raise a ValueError, which pydantic reports."""
    try:
        re.compile(pattern, FLAGS)
    except re.error as err:
        raise ValueError(f"no regular expression: {err}") from err
    return pattern


Pattern = Annotated[str, AfterValidator(_compiles)]


class TargetSyntax(StrictModel):
    """Describe how a language writes the numbers of a point."""

    holds: Literal["joints", "pose"]
    #: Regular expression of a point. Its group `target` is all of the point, `name` its name, if it is
    #: declared here. Numbers are in the groups `main` and `external`, or `position` and `orientation`; or,
    #: behind names of axes, in the group `named`.
    pattern: Pattern
    modes: list[str] = Field(
        default=[]
    )  #: What `mode` must have said last before it; none for a language without modes.


class MoveSyntax(StrictModel):
    """Describe how a language writes motions."""

    joint: Pattern  #: Beginning of a move of the joints, up to its point.
    linear: Pattern  #: Beginning of a move along a line, up to its point.
    point: Pattern  #: Name of a point, in the group `name`.
    elsewhere: Pattern = r"(?!)"  #: Points whose numbers are not in the program: they stay as they are.
    others: Pattern = r"(?!)"  #: Axes of points that are not the robot's: they stay as they are.
    #: What follows a point, up to joints that choose its configuration.
    near: Pattern = r"(?!)"
    #: Beginning of an assignment to a point, up to what is assigned; the group `name` is the point's name.
    assigned: Pattern = r"(?!)"


class TurnFlags(StrictModel):
    """Describe the numbers beside a pose that say in which turn its joints are."""

    name: str  #: Their name in the language.
    period_deg: float = Field(gt=0)  #: A flag counts turns of so many degrees.
    offset_deg: float = 0.0  #: A turn begins at minus so many degrees.
    #: Regular expression of the flags in a point, a group for each; none for flags that are not read.
    pattern: Pattern = "(?!)"
    axes: list[str] = Field(default=[])  #: Axes of the flags, in their order.
    bits: bool = False  #: Whether one number has a bit for each axis: 1 for a negative angle.
    #: Regular expression of a configuration, in a group, that is not read and has to stay the same.
    same: Pattern = "(?!)"

    @property
    def read(self) -> bool:
        """Tell whether the flags choose the configuration of a pose."""
        return bool(self.axes)

    def found(self, point: str) -> tuple[int, ...]:
        """Read the flags of a point as numbers of turns, -1 for a bit.

        Args:
            point: All of the point.

        Returns:
            A number for each of the axes; none where the point has no flags.
        """
        match = re.search(self.pattern, point, FLAGS)
        if match is None:
            return ()
        if self.bits:
            return tuple(-(int(match[1]) >> k & 1) for k in range(len(self.axes)))
        return tuple(map(int, match.groups()))


class NameSyntax(StrictModel):
    """Describe which names a program may have."""

    longest: int  #: Most characters of a name.
    words: str  #: Reserved words, in any case.
    patterns: list[Pattern]  #: Regular expressions of further reserved words.


class Language(StrictModel):
    """Hold the conventions of a robot language."""

    name: str  #: Name of its file.
    title: str  #: Name in reports.
    source: str  #: Source of the facts.
    text: Pattern  #: Beginning of a line that only such programs have.
    suffixes: list[str] = Field(min_length=1)  #: Suffixes of its files; the first one is written.
    beside: str = ""  #: Suffix of a file beside it that may hold its points.
    newline: Literal["\n", "\r\n"]  #: Line ending that is written.
    comment: str  #: Mark of a comment, up to the end of its line.
    remark: str  #: Line of a comment, with {} for its text.
    remark_after: Pattern  #: Beginning of the line behind which such a line may stand.
    begins: Pattern  #: Beginning of a file that we wrote.
    decimals: int  #: Decimals of a number.
    angle: Literal["deg", "rad"]  #: Unit of angles.
    length: Literal["mm", "m"]  #: Unit of lengths.
    rotation: Notation  #: What an orientation is; a quaternion's first is real.
    axes: list[str]  #: Names of the robot's axes.
    external: list[str] = Field(default=[])  #: Names of external axes.
    pose: list[str] = Field(default=[])  #: Names of a pose's numbers, where it has names.
    no_axis: float = math.inf  #: Least value that stands for an external axis that is not there.
    exactly: bool = False  #: Whether an arm must have as many axes, all of which turn.
    linear_by: Literal["joints", "pose"] = "joints"  #: What the point of a linear move may be.
    mode: Pattern = ""  #: Statement that says what the points behind it are, in its group.
    pulses: str = ""  #: The mode in which joints count pulses of the motors.
    drop: str = ""  #: Prefix that is removed from the points' names if all have it.
    begin: str = ""  #: Prefix that is added to a point's name.
    targets: list[TargetSyntax]
    moves: MoveSyntax
    refused: dict[str, Pattern]  #: Regular expressions of what is not read, by what it is.
    frames: dict[Literal["tool", "base"], list[Pattern]]  #: Statements of a frame, in a group.
    no_frame: str = ""  #: The frame of a statement that states none.
    #: Statements with the numbers of a frame: groups `name` and `numbers`, of one pose or of two.
    frame_data: dict[Literal["tool", "base"], Pattern] = Field(default={})
    flags: TurnFlags | None = None
    names: NameSyntax

    @model_validator(mode="after")
    def _has_groups(self) -> "Language":
        for target_syntax in self.targets:
            groups = re.compile(target_syntax.pattern).groupindex
            numbers = {"main"} if target_syntax.holds == "joints" else {"position", "orientation"}
            if "target" not in groups or not ("named" in groups or numbers <= groups.keys()):
                raise ValueError(
                    f"expected a group target in the pattern, and a group named or {' and '.join(numbers)}"
                )
        return self

    @property
    def suffix(self) -> str:
        """Return the suffix of its files."""
        return self.suffixes[0]

    @property
    def per_radian(self) -> float:
        """Return the size of a radian in its unit of angles."""
        return 1.0 if self.angle == "rad" else 180 / math.pi

    @property
    def per_metre(self) -> float:
        """Return the size of a metre in its unit of lengths."""
        return 1.0 if self.length == "m" else 1 / MM

    def takes(self, name: str) -> bool:
        """Tell whether a name is free to use: no reserved word of the language.

        Args:
            name: The name.

        Returns:
            False for a reserved word or a pattern of the language.
        """
        taken = "|".join([*self.names.words.split(), *self.names.patterns])
        return re.fullmatch(taken, name, re.IGNORECASE) is None

    def pose_names(self) -> list[str]:
        """Name the numbers of a pose, position first; by their place where the language has no names."""
        return self.pose or list(map(str, range(7 if self.rotation == "quaternion" else 6)))

    def rotations(self, values: Array) -> Array:
        """Convert orientations as the language writes them.

        Args:
            values: Three angles or four parts of a quaternion a point, (points, k) [its unit].

        Returns:
            Rotation matrices, (points, 3, 3).
        """
        if self.rotation == "vector":
            return rotation_matrices(values / self.per_radian)
        from scipy.spatial.transform import Rotation  # here: it takes long to import, and few files need it

        if self.rotation == "quaternion":
            return np.asarray(Rotation.from_quat(values[:, [1, 2, 3, 0]]).as_matrix())
        angles = values / self.per_radian
        return np.asarray(Rotation.from_euler(self._order(), angles).as_matrix())

    def orientations(self, rotation: Array) -> Array:
        """Convert orientations to numbers as the language writes them; the inverse of `rotations`.

        Args:
            rotation: Rotation matrices, (points, 3, 3).

        Returns:
            Three angles or four parts of a quaternion a point, (points, k) [its unit].
        """
        from scipy.spatial.transform import Rotation  # here: the same

        R = Rotation.from_matrix(rotation)
        if self.rotation == "quaternion":
            return np.asarray(R.as_quat()[:, [3, 0, 1, 2]])
        if self.rotation == "vector":
            return np.asarray(self.per_radian * R.as_rotvec())
        with warnings.catch_warnings():  # where two axes coincide, one of the angles is chosen as zero
            warnings.simplefilter("ignore", UserWarning)
            angles = R.as_euler(self._order())  # type: ignore[call-overload]  # one of its 24 words
            return np.asarray(self.per_radian * angles)

    def _order(self) -> str:
        """The axes of Euler angles as scipy writes them: capitals turn with the body."""
        kind, axes = self.rotation.split()
        return axes.upper() if kind == "intrinsic" else axes


@cache
def known_languages() -> Mapping[str, Language]:
    """Read all languages of the library's folder.

    Returns:
        The languages by name.

    Raises:
        InputError: Names the file and the key that are wrong.
    """
    return {path.stem: read_language(path) for path in sorted(FOLDER.glob("*.toml"))}


def read_language(path: Path) -> Language:
    """Read the table of a language; its template is the file of the same name that ends with .j2.

    Args:
        path: The TOML file.

    Returns:
        The language.

    Raises:
        InputError: Names the key that is wrong.
    """
    try:
        return Language.model_validate({"name": path.stem} | parse_toml(path, read_text(path, MAX_BYTES)))
    except ValidationError as err:
        keys, _, problem = first_invalid_value(err)
        raise InputError(path, toml_place(path, keys), problem) from err


def language_of(path: Path) -> Language | None:
    """Find the language of a file by its suffix.

    Args:
        path: The file.

    Returns:
        The language; None if no language has the suffix.
    """
    known = known_languages().values()
    return next((language for language in known if path.suffix.lower() in language.suffixes), None)


# --- Reader of programs in robot languages: motions in order, and where the numbers of their points are -----

MAX_PROGRAM_BYTES = 50_000_000  #: Largest program that is read [byte].
MAX_SHOWN = 40  #: Most characters of a statement in a message.
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.])")
COMPUTED = re.compile(r"\s*[-+*/^]")  #: Behind a number that is a part of a formula.
SPLIT = re.compile(r"\s*,\s*[\d.]")  #: Behind a number with a decimal comma, where axes have names.
MARK = "Corrected by testbench"  #: Remark of a program whose points were corrected.
NO_FRAME = r"(?:tool|wobj|base)?0|\$NULLFRAME"  #: Name of a frame that is none.
ANY = "Linear and joint moves are read, if their target points are in the program"


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
    content = read_bytes(path, MAX_PROGRAM_BYTES)
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


def values_of(program: ProgramText, points: Sequence[PointText], names: Sequence[str]) -> Array:
    """Read numbers of points.

    Args:
        program: The program.
        points: Some of its points.
        names: Names of the axes, k of them.

    Returns:
        Numbers as the language writes them, (points, k).

    Raises:
        InputError: Names line and axis of the first number that is missing.
    """
    found = np.empty((len(points), len(names)))
    for row, point in enumerate(points):
        for k, name in enumerate(names):
            if name not in point.numbers:
                source = program.sources[point.source]
                problem = f"expected a number for each of {', '.join(names)}, got none for {name}"
                raise source.error(point.start, f"point {point.name}".strip() + f": {problem}")
            found[row, k] = point.numbers[name].value
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
