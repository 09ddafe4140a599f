"""A stranger's word in a cell of a CSV: what a spreadsheet would compute begins with an apostrophe there.

Numbers stay as they are, and `from_cell` takes the apostrophe away, so that what we write is read as it was.
"""

import re

from testbench.errors import shown

BEGINS = frozenset("=+-@\uff1d\uff0b\uff0d\uff20")
FORMULA = re.compile(r"[^+\-]|[+\-](?![\d.,\s]*(?:[eE][+-]?\d+)?\s*$)")
"""What a formula begins with, in letters of full width too, and how: a signed number is none."""
MARK = "'"


def as_cell(text: str) -> str:
    """The word on one line, and no formula."""
    line = shown(text)
    begins = line.lstrip()
    return MARK + line if begins[:1] in BEGINS and FORMULA.match(begins) else line


def from_cell(text: str) -> str:
    """The word of such a cell."""
    if not text.startswith(MARK):
        return text
    begins = text[1:].lstrip()
    return text[1:] if begins[:1] in BEGINS and FORMULA.match(begins) else text
