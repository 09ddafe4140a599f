"""Robot languages: the conventions of each one as a TOML file of testbench/languages, beside its template."""

import math
import re
import warnings
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field, ValidationError, model_validator

from testbench.arm.document import Strict, parse_toml
from testbench.errors import Array, InputError, read_text

FOLDER = Path(__file__).parents[1] / "languages"
MAX_BYTES = 20_000  #: Size of a language's table [byte].
MM = 1e-3  #: Metres per millimetre.
FLAGS = re.MULTILINE | re.IGNORECASE
ROTATION = r"^(vector|quaternion|(intrinsic|extrinsic) [xyz]{3})$"
"""How a pose states its orientation: three or four numbers behind those of the position."""


def _compiles(pattern: str) -> str:
    """Return a regular expression that compiles; else raise a ValueError, which pydantic reports."""
    try:
        re.compile(pattern, FLAGS)
    except re.error as err:
        raise ValueError(f"no regular expression: {err}") from err
    return pattern


Pattern = Annotated[str, AfterValidator(_compiles)]


class TargetSyntax(Strict):
    """Describe how a language writes the numbers of a point."""

    holds: Literal["joints", "pose"]
    #: Regular expression of a point. Its group `target` is all of the point, `name` its name, if it is
    #: declared here. Numbers are in the groups `main` and `external`, or `position` and `orientation`; or,
    #: behind names of axes, in the group `named`.
    pattern: Pattern
    modes: list[str] = Field(
        default=[]
    )  #: What `mode` must have said last before it; none for a language without modes.


class MoveSyntax(Strict):
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


class TurnFlags(Strict):
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


class NameSyntax(Strict):
    """Describe which names a program may have."""

    longest: int  #: Most characters of a name.
    words: str  #: Reserved words, in any case.
    patterns: list[Pattern]  #: Regular expressions of further reserved words.


class Language(Strict):
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
    rotation: Annotated[
        str, Field(pattern=ROTATION)
    ]  #: What an orientation is; a quaternion's first is real.
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
                raise ValueError(f"expected the groups target, and named or {' and '.join(numbers)}")
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
        from scipy.spatial.transform import Rotation  # here: it takes long to import, and few files need it

        if self.rotation == "quaternion":
            return np.asarray(Rotation.from_quat(values[:, [1, 2, 3, 0]]).as_matrix())
        angles = values / self.per_radian
        if self.rotation == "vector":
            return np.asarray(Rotation.from_rotvec(angles).as_matrix())
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
        first = err.errors(include_url=False, include_context=False)[0]
        raise InputError(path, ".".join(map(str, first["loc"])), first["msg"]) from err


def language_of(path: Path) -> Language | None:
    """Find the language of a file by its suffix.

    Args:
        path: The file.

    Returns:
        The language; None if no language has the suffix.
    """
    known = known_languages().values()
    return next((language for language in known if path.suffix.lower() in language.suffixes), None)
