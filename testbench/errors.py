"""Exceptions and checks of all packages: few exception types; arrays checked for shape and finiteness.

Readers of user files open them here, so that devices, pipes and oversized files are refused in one place.
"""

import contextlib
import math
import os
import shlex
import stat
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from types import NoneType

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Ids = npt.NDArray[np.int_]
Mask = npt.NDArray[np.bool_]

MAX_MESSAGE = 2000
"""Longest message about a file [characters]: a file of garbage is not repeated."""

SPREADSHEETS = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")  #: Suffixes of spreadsheets.
NOT_A_FILE = "expected a file, got a folder or a device"


def printable(text: str) -> str:
    """Make a text from outside safe to show: one line, without control of the terminal or of text direction.

    Blanks and line ends of any kind become a blank. Every other character that does not print is replaced by
    U+FFFD, also half of a surrogate pair, by which Python shows a byte of a file's name that is not UTF-8.

    Args:
        text: Any text.

    Returns:
        A printable text of one line.
    """
    if text.isprintable():
        return text
    unseen = "\N{REPLACEMENT CHARACTER}"
    return "".join(c if c.isprintable() else " " if c.isspace() else unseen for c in text)


def shell_word(path: Path) -> str:
    """Quote a path as a word of a command line that people copy: for the shell, and never taken for a flag.

    Args:
        path: Any path.

    Returns:
        The quoted text.
    """
    text = str(path)
    return shlex.quote(f"./{text}" if text.startswith("-") else text)


def sheet_of(path: Path) -> tuple[Path, str]:
    """Split FILE.xlsx#SHEET into the file and the name of its sheet.

    Args:
        path: Path of a file, or of a sheet of a spreadsheet.

    Returns:
        The file, and the sheet's name; "" where none is named.
    """
    file, mark, sheet = path.name.partition("#")
    if mark and sheet and file.lower().endswith(SPREADSHEETS):
        return path.with_name(file), sheet
    return path, ""


def stem_of(path: Path) -> str:
    """Name readings after their file: its name without the suffix, and the sheet if one is named.

    Args:
        path: Path of a file, or of a sheet of a spreadsheet.

    Returns:
        The name.
    """
    file, sheet = sheet_of(path)
    return f"{file.stem} {sheet}".strip()


def shorten(text: str, max_length: int) -> str:
    """Cut a text that is too long; three dots stand for the rest.

    Args:
        text: Any text.
        max_length: Largest number of characters of the result, 3 or more.

    Returns:
        The text, unchanged if it is short enough.
    """
    return text if len(text) <= max_length else f"{text[: max_length - 3]}..."


MAX_NAMES = 6  #: Most names that a sentence lists.


def some_of(names: Iterable[object], between: str = ", ") -> str:
    """List names in a sentence: a, b, c, d, e, f and 12 more.

    Args:
        names: The names, or numbers.
        between: Text between two of them.

    Returns:
        The first `MAX_NAMES`, and how many more there are; "none" without any.
    """
    words = list(map(str, names))
    more = f" and {len(words) - MAX_NAMES} more" * (len(words) > MAX_NAMES)
    return (between.join(words[:MAX_NAMES]) or "none") + more


class BenchError(Exception):
    """Signal an error that the user can fix; the command line prints it as one line and exits with code 2."""


class InputError(BenchError):
    """Signal a wrong file of the user; the message names file, place and problem.

    Args:
        file: The file at fault.
        place: Where in the file: a line, a key, an element; "" for the whole file.
        problem: What was expected, and what was found.
    """

    def __init__(self, file: Path, place: str, problem: str) -> None:
        name = shorten(str(file), MAX_MESSAGE // 2)
        message = f"{name}: {place}: {problem}" if place else f"{name}: {problem}"
        super().__init__(shorten(printable(message), MAX_MESSAGE))


class Interrupted(BenchError):
    """Signal that the user pressed Ctrl-C; the message says what is kept."""


class NoEquilibrium(BenchError):
    """Signal that no static equilibrium was found: the arm is too soft for its load, or buckles."""


class PoseError(BenchError):
    """Signal a pose that the arm cannot take: outside its limits or in collision."""


@contextlib.contextmanager
def open_file(path: Path, max_bytes: int) -> Iterator[BufferedReader]:
    """Open a file of the user for reading; a device, pipe or folder is refused, because it may have no end.

    Args:
        path: The file, or a sheet of it.
        max_bytes: Largest size that is read [byte].

    Yields:
        The open file, at its beginning.

    Raises:
        InputError: When it is missing, no plain file, too large, or cannot be read in the block.
    """
    try:
        file = open(sheet_of(path)[0], "rb", opener=_at_once)  # noqa: SIM115 - pathlib takes no opener
    except IsADirectoryError as err:
        raise InputError(path, "", NOT_A_FILE) from err
    except (OSError, ValueError) as err:  # also a zero byte in its name
        raise _unreadable(path, err) from err
    with file:
        try:
            status = os.fstat(file.fileno())  # of what is open: another file may take its name
            if not stat.S_ISREG(status.st_mode):
                raise InputError(path, "", NOT_A_FILE)
            if status.st_size > max_bytes:
                raise InputError(path, "", f"expected at most {max_bytes} bytes, got {status.st_size}")
            yield file
        except OSError as err:
            raise _unreadable(path, err) from err


def _unreadable(path: Path, err: OSError | ValueError) -> InputError:
    return InputError(path, "", f"cannot be read: {getattr(err, 'strerror', None) or err}")


def _at_once(path: str, flags: int) -> int:
    """Open without waiting for a writer of a pipe; a device is not opened, because opening acts on some."""
    mode = os.stat(path).st_mode  # noqa: PTH116 - links are followed, as by open
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        raise IsADirectoryError
    return os.open(path, flags | os.O_NONBLOCK | os.O_CLOEXEC)


def read_bytes(path: Path, max_bytes: int) -> bytes:
    """Read the content of a file of the user.

    Args:
        path: The file, or a sheet of it.
        max_bytes: Largest size that is read [byte].

    Returns:
        Its bytes.

    Raises:
        InputError: When it is missing, no plain file, or too large.
    """
    with open_file(path, max_bytes) as file:
        content = file.read(max_bytes + 1)
    if len(content) > max_bytes:  # as files of the kernel have, which say that they are empty
        raise InputError(path, "", f"expected at most {max_bytes} bytes")
    return content


def read_text(path: Path, max_bytes: int) -> str:
    """Read the text of a file of the user, without its byte order mark.

    Args:
        path: The file.
        max_bytes: Largest size that is read [byte].

    Returns:
        Its text.

    Raises:
        InputError: When it cannot be read as by `read_bytes`, or is not UTF-8.
    """
    try:
        return read_bytes(path, max_bytes).decode("utf-8-sig")
    except UnicodeDecodeError as err:
        raise InputError(path, f"byte {err.start + 1}", f"expected UTF-8: {err.reason}") from err


def check_least(value: float, what: str, least: float = 0.0) -> None:
    """Refuse a number that is below a bound, NaN or infinite.

    Args:
        value: The number.
        what: Name and unit of the quantity, for the message.
        least: Least value that is allowed.

    Raises:
        BenchError: When the number is refused.
    """
    if not least <= value < math.inf:
        raise BenchError(f"{what}: expected a finite number of at least {least:g}, got {value}")


def check_array(value: object, shape: tuple[int | None, ...], what: str) -> Array:
    """Convert a value to a float64 array, and check its shape and that it is finite.

    Args:
        value: Anything that numpy can read.
        shape: Expected shape; None admits any length of that axis.
        what: Name and unit of the quantity, for the message.

    Returns:
        The array, with the given shape.

    Raises:
        BenchError: When it is not numeric, has another shape or is not finite.
    """
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError) as err:
        raise BenchError(f"{what}: expected numbers, got {type(value).__name__}") from err
    expected = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
    fits = array.ndim == len(shape) and all(
        n is None or n == have for n, have in zip(shape, array.shape, strict=True)
    )
    if not fits:
        raise BenchError(f"{what}: expected shape {expected}, got {array.shape}")
    if not np.isfinite(array).all():
        raise BenchError(f"{what}: expected finite numbers, got NaN or infinity")
    return array


def check_type(value: object, expected: type | tuple[type, ...], name: str) -> None:
    """Check the type of an argument.

    The message is such as "vjm: expected Vjm, got Cell; it has one as .vjm".

    Args:
        value: The argument.
        expected: The type, or several.
        name: Name of the argument.

    Raises:
        BenchError: When it is of another type.
    """
    if not isinstance(value, expected):
        every = expected if isinstance(expected, tuple) else (expected,)
        wanted = " or ".join("None" if each is NoneType else each.__name__ for each in every)
        has = getattr(value, name, None)
        hint = f"; it has one as .{name}" if has is not None and isinstance(has, expected) else ""
        got = type(value).__name__
        raise BenchError(f"{name}: expected {wanted}, got {got}{hint}")


def check_items(values: object, expected: type, name: str) -> None:
    """Check that an argument is a list or tuple, and the type of its items.

    Args:
        values: The argument.
        expected: Type of every item.
        name: Name of the argument.

    Raises:
        BenchError: When it is no list or tuple, or an item is of another type.
    """
    if not isinstance(values, list | tuple):
        raise BenchError(f"{name}: expected a list of {expected.__name__}, got {type(values).__name__}")
    for k, value in enumerate(values):
        check_type(value, expected, f"{name}[{k}]")


@contextlib.contextmanager
def of_flag(flag: str) -> Iterator[None]:
    """Begin the message of a BenchError that the block raises with the name of a flag."""
    try:
        yield
    except BenchError as err:
        raise BenchError(f"{flag}: {err}") from err


@contextlib.contextmanager
def in_flags(flags: Mapping[str, str]) -> Iterator[None]:
    """Replace the argument's name with which a BenchError of the block begins by the name of its flag.

    Args:
        flags: Name of the flag by the name of the argument.

    Raises:
        BenchError: The error of the block, with its first word replaced.
    """
    try:
        yield
    except BenchError as err:
        argument, colon, problem = str(err).partition(":")
        if argument not in flags:
            raise
        raise BenchError(f"{flags[argument]}{colon}{problem}") from err


@dataclass(frozen=True)
class Doubt:
    """Warn of a possible mistake in an arm's folder or in readings."""

    name: str  #: Short name for programs, such as "frame".
    sentence: str  #: What was observed, its size, and what to check.
    #: Log-likelihood that the readings gain by assuming the mistake [1]; None if it was not estimated.
    evidence: float | None = None
