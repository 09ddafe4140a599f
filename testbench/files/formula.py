"""Apostrophe before text that a spreadsheet would compute: written to our files, removed on reading."""

import re

from testbench.errors import printable

BEGINS = frozenset("=+-@\uff1d\uff0b\uff0d\uff20")
FORMULA = re.compile(r"[^+\-]|[+\-](?![\d.,\s]*(?:[eE][+-]?\d+)?\s*$)")
"""What a formula begins with, in letters of full width too, and how: a signed number is none."""
MARK = "'"


def as_cell(text: str) -> str:
    """Write text from a user's file as a cell of a CSV: on one line, and never a formula.

    Args:
        text: The text.

    Returns:
        The cell; text that a spreadsheet would take as a formula begins with MARK.
    """
    line = printable(text)
    return MARK + line if _is_formula(line) else line


def from_cell(text: str) -> str:
    """Read the text of a cell that `as_cell` wrote.

    Args:
        text: The cell.

    Returns:
        The text, without the guard against formulas.
    """
    return text[1:] if text.startswith(MARK) and _is_formula(text[1:]) else text


def _is_formula(text: str) -> bool:
    begins = text.lstrip()
    return begins[:1] in BEGINS and FORMULA.match(begins) is not None
