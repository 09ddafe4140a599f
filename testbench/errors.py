"""What can go wrong, as few exception types as a caller can tell apart."""

from pathlib import Path

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


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
        super().__init__(f"{file}: {place}: {problem}" if place else f"{file}: {problem}")


class NoEquilibrium(BenchError):
    """The arm has no static equilibrium that Newton could find: too soft, or buckled."""


class PoseError(BenchError):
    """A pose that the arm cannot take: outside its limits or in collision."""


class RankError(BenchError):
    """A dataset that cannot answer the question asked of it."""


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
