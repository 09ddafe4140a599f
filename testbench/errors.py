"""What can go wrong, as few exception types as a caller can tell apart."""

import math
import stat
from pathlib import Path

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

MAX_MESSAGE = 2000
"""Longest message about a file [characters]: a file of garbage is not repeated to its owner."""


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
        message = f"{file}: {place}: {problem}" if place else f"{file}: {problem}"
        line = " ".join(message.splitlines())  # names from the file may hold line breaks
        super().__init__(line if len(line) <= MAX_MESSAGE else line[: MAX_MESSAGE - 3] + "...")


class Interrupted(BenchError):
    """Ctrl-C; says what is kept."""


class NoEquilibrium(BenchError):
    """The arm has no static equilibrium that Newton could find: too soft, or buckled."""


class PoseError(BenchError):
    """A pose that the arm cannot take: outside its limits or in collision."""


def read_bytes(path: Path, max_bytes: int) -> bytes:
    """The content of a file that a user handed in.

    Args:
        path: The file.
        max_bytes: Largest size that is read [byte].

    Raises:
        InputError: When it is missing, no plain file, or too large.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):  # a device or a pipe has no end
            raise InputError(path, "", "expected a file, got a folder or a device")
        if status.st_size > max_bytes:
            raise InputError(path, "", f"expected at most {max_bytes} bytes, got {status.st_size}")
        return path.read_bytes()
    except OSError as err:
        raise InputError(path, "", f"cannot be read: {err.strerror}") from err


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
