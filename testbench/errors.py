"""What can go wrong, as few exception types as a caller can tell apart."""

import contextlib
import math
import os
import shlex
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Ids = npt.NDArray[np.int_]
Mask = npt.NDArray[np.bool_]

MAX_MESSAGE = 2000
"""Longest message about a file [characters]: a file of garbage is not repeated to its owner."""

SPREADSHEETS = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")
PLAIN = "expected a file, got a folder or a device"


def shown(text: str) -> str:
    """A stranger's text for people: one line, without what steers a terminal or turns the order of letters.

    Blanks and ends of lines of any kind are a blank; every other character that prints nothing is replaced,
    so also half of a surrogate pair, which stands for a byte of a file's name that is no text.
    """
    if text.isprintable():
        return text
    unseen = "\N{REPLACEMENT CHARACTER}"
    return "".join(c if c.isprintable() else " " if c.isspace() else unseen for c in text)


def word(path: Path) -> str:
    """A path as a word of a command line that people copy: quoted for the shell, and no flag."""
    text = str(path)
    return shlex.quote(f"./{text}" if text.startswith("-") else text)


def sheet_of(path: Path) -> tuple[Path, str]:
    """A file, and the sheet of it that FILE.xlsx#SHEET means; "" where none is said."""
    file, mark, sheet = path.name.partition("#")
    if mark and sheet and file.lower().endswith(SPREADSHEETS):
        return path.with_name(file), sheet
    return path, ""


def stem_of(path: Path) -> str:
    """What readings are called after their file: its name without what stands for its form, and the sheet."""
    file, sheet = sheet_of(path)
    return f"{file.stem} {sheet}".strip()


def cut(text: str, most: int) -> str:
    """A text of at most so many characters; dots stand for the rest."""
    return text if len(text) <= most else f"{text[: most - 3]}..."


class BenchError(Exception):
    """Anything that the user can mend; the command line prints it as one line and exits with 2."""


class InputError(BenchError):
    """A file that a user handed in is wrong.

    Args:
        file: The file at fault.
        place: Where in the file: a line, a key, an element.
        problem: What was expected, what was found.
    """

    def __init__(self, file: Path, place: str, problem: str) -> None:
        name = cut(str(file), MAX_MESSAGE // 2)
        message = f"{name}: {place}: {problem}" if place else f"{name}: {problem}"
        super().__init__(cut(shown(message), MAX_MESSAGE))


class Interrupted(BenchError):
    """Ctrl-C; says what is kept."""


class NoEquilibrium(BenchError):
    """The arm has no static equilibrium that Newton could find: too soft, or buckled."""


class PoseError(BenchError):
    """A pose that the arm cannot take: outside its limits or in collision."""


@contextlib.contextmanager
def open_file(path: Path, max_bytes: int) -> Iterator[BufferedReader]:
    """A file that a user handed in, to be read; no device, pipe or folder, which may have no end.

    Args:
        path: The file, or a sheet of it.
        max_bytes: Largest size that is read [byte].

    Raises:
        InputError: When it is missing, no plain file, too large, or cannot be read in the block.
    """
    try:
        file = open(sheet_of(path)[0], "rb", opener=_at_once)  # noqa: SIM115 - pathlib takes no opener
    except IsADirectoryError as err:
        raise InputError(path, "", PLAIN) from err
    except (OSError, ValueError) as err:  # also a zero byte in its name
        raise _unreadable(path, err) from err
    with file:
        try:
            status = os.fstat(file.fileno())  # of what is open: another file may take its name
            if not stat.S_ISREG(status.st_mode):
                raise InputError(path, "", PLAIN)
            if status.st_size > max_bytes:
                raise InputError(path, "", f"expected at most {max_bytes} bytes, got {status.st_size}")
            yield file
        except OSError as err:
            raise _unreadable(path, err) from err


def _unreadable(path: Path, err: OSError | ValueError) -> InputError:
    return InputError(path, "", f"cannot be read: {getattr(err, 'strerror', None) or err}")


def _at_once(path: str, flags: int) -> int:
    """Open without waiting for somebody who writes into a pipe; a device is not opened: some act on it."""
    mode = os.stat(path).st_mode  # noqa: PTH116 - links are followed, as by open
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        raise IsADirectoryError
    return os.open(path, flags | os.O_NONBLOCK | os.O_CLOEXEC)


def read_bytes(path: Path, max_bytes: int) -> bytes:
    """The content of a file that a user handed in; raises what `open_file` raises."""
    with open_file(path, max_bytes) as file:
        size = os.fstat(file.fileno()).st_size
        content = file.read(size + 1)
        if len(content) > size:  # as files of the kernel do, which say that they are empty
            raise InputError(path, "", "grows while it is read")
        return content


def read_text(path: Path, max_bytes: int) -> str:
    """The text of such a file without its byte order mark; InputError also when it is not UTF-8."""
    try:
        return read_bytes(path, max_bytes).decode("utf-8-sig")
    except UnicodeDecodeError as err:
        raise InputError(path, f"byte {err.start + 1}", f"expected UTF-8: {err.reason}") from err


def check_least(value: float, what: str, least: float = 0.0) -> None:
    """Refuse a number below the least one, a NaN or infinity with a BenchError."""
    if not least <= value < math.inf:
        raise BenchError(f"{what}: expected a finite number of at least {least:g}, got {value}")


def check_array(value: object, shape: tuple[int | None, ...], what: str) -> Array:
    """The value as a finite float64 array of the given shape.

    Args:
        value: Anything that numpy can read.
        shape: Expected shape; None admits any length of that axis.
        what: Name and unit of the quantity, for the message.

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


@contextlib.contextmanager
def of_flag(flag: str) -> Iterator[None]:
    """Name the flag that asked for what the block refuses."""
    try:
        yield
    except BenchError as err:
        raise BenchError(f"{flag}: {err}") from err


@dataclass(frozen=True)
class Doubt:
    """Name what may be wrong with an arm or with readings, for people."""

    name: str  #: A word for programs, such as "frame".
    sentence: str  #: What is seen, by how much, what to check.
    #: By how many nats the readings are likelier with the mistake than without; None for what is plain.
    evidence: float | None = None
