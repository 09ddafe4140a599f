"""Numbers as people write them in files and flags: ASCII decimals, such as 12, -0.5 and 2e-3.

Python's float also reads digits of any script, 1_000, inf and nan; other programs that read the same file do
not.
"""

import re
from collections.abc import Iterable

NUMBER = r"^[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?$"
"""Pattern of a number, with a point as decimal mark."""
INTEGER = r"^[+-]?[0-9]{1,19}$"
WRITTEN = "such as 12, -0.5 or 2e-3"
DECIMAL, WHOLE = re.compile(NUMBER), re.compile(INTEGER)
MAX_CHARACTERS = 400  #: Most characters of a number: 17 digits hold all that a double does.


def is_decimal(text: str) -> bool:
    """Tell whether a text is a decimal number in ASCII digits, at most `MAX_CHARACTERS` characters long."""
    return len(text) <= MAX_CHARACTERS and DECIMAL.fullmatch(text) is not None


def is_integer(text: str) -> bool:
    """Tell whether a text is an integer of 64 bits in ASCII digits."""
    return WHOLE.fullmatch(text) is not None and -(2**63) <= int(text) < 2**63


def read_decimals(words: Iterable[str]) -> list[float]:
    """Convert texts to numbers; a number beyond what a double holds becomes infinite.

    Args:
        words: Texts, one number each.

    Returns:
        The numbers, in order.

    Raises:
        ValueError: At the first text that is no number.
    """
    words = list(words)
    for word in words:
        if not is_decimal(word):
            raise ValueError(f"expected a number {WRITTEN}, got {word[:80]!r}")
    return list(map(float, words))
