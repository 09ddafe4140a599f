"""Numbers as people write them in files and flags: ASCII decimals, such as 12, -0.5 and 2e-3.

Python's float also reads digits of any script, 1_000, inf and nan; programs that read the
same file do not.
"""

import re
from collections.abc import Iterable

NUMBER = r"^[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?$"
"""A number that is read, with a point as decimal mark."""
INTEGER = r"^[+-]?[0-9]{1,19}$"
WRITTEN = "such as 12, -0.5 or 2e-3"
DECIMAL, WHOLE = re.compile(NUMBER), re.compile(INTEGER)
LONGEST = 400  #: Characters of the longest number: 17 digits say all that a double holds.


def is_decimal(text: str) -> bool:
    """Whether a text is a number in ASCII digits."""
    return len(text) <= LONGEST and DECIMAL.fullmatch(text) is not None


def is_integer(text: str) -> bool:
    """Whether a text is an integer of 64 bits in ASCII digits."""
    return WHOLE.fullmatch(text) is not None and -(2**63) <= int(text) < 2**63


def read_decimals(words: Iterable[str]) -> list[float]:
    """Texts as numbers, infinite beyond what a double holds; ValueError at the first that is none."""
    words = list(words)
    for word in words:
        if not is_decimal(word):
            raise ValueError(f"expected a number {WRITTEN}, got {word[:80]!r}")
    return list(map(float, words))
