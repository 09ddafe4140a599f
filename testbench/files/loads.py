"""Loads in words: masses such as "460.3 kg" or "2 x 20 kg + 5 kg", and codes that a legend explains."""

import re
from collections.abc import Sequence
from itertools import pairwise

from testbench.files.names import state_of

TERM = re.compile(
    r"(?<![\d.,])(?:(?P<count>\d+)\s*[x×*]\s*)?(?P<number>\d+(?:[.,]\d+)?)\s*(?P<unit>kg|lbs?|t)\b",
    re.IGNORECASE,
)
"""A mass in a text, such as "with 150 kg", or several equal ones, such as "3 x 50 kg"."""
THOUSANDS = re.compile(r"(?<![\d.,])[1-9][.,' \u00a0\u202f]\d{3}(?:[.,]\d+)?\s*(?:kg|lb|t\b)", re.IGNORECASE)
"""A mass that may be one or a thousand: "1,000 lb"."""
COUNTED = re.compile(r"(?<![\w.,])\d+\s+(?:[^\W\d]+\s+)*@?\s*$")
"""A number before a mass that may count it, as in "2 plates of 20 kg"; that of "Load 2: 20 kg" does not."""
ALONE = re.compile(r"(?<![\w.,])\d+(?![\w])")  #: A number of its own behind a mass, as in "20 kg (2 times)".
MAX_CODES = 12  #: Most codes of loads that a legend may explain.


def masses_in(texts: Sequence[str]) -> dict[str, str]:
    """Find the masses of texts such as "no load", "with 240 kg" and "2 x 20 kg + 5 kg", all in one unit.

    Args:
        texts: The texts of a column, or the names of sheets.

    Returns:
        The mass of each text, as "240 kg" or "0"; empty unless each has one or says that none hangs.
    """
    found = {text: _mass_in(text) for text in dict.fromkeys(texts)}
    units = {mass.partition(" ")[2] for mass in found.values()} - {""}
    return found if len(units) == 1 and all(found.values()) else {}


def _mass_in(text: str) -> str:
    """The mass of a text, "0" where it says that none hangs; "" where nobody knows it."""
    terms = [*TERM.finditer(text)]
    if not terms:
        return "0" if state_of(text) == "before" else ""
    between = [text[a.end() : b.start()].strip() for a, b in pairwise(terms)]
    units = {term["unit"].casefold()[:2] for term in terms}
    unclear = len(units) > 1 or {*between} - {"+"} or THOUSANDS.search(text)
    if unclear or COUNTED.search(text[: terms[0].start()]) or ALONE.search(text[terms[-1].end() :]):
        return ""
    whole = sum(int(term["count"] or 1) * float(term["number"].replace(",", ".")) for term in terms)
    if whole and state_of(text) == "before":
        return ""
    return f"{whole:.12g} {units.pop()}" if whole else "0"


def explained(codes: Sequence[str], text: str) -> dict[str, str]:
    """Find what a legend says of codes, such as "L1 = 150 kg" in a line beside the table.

    Args:
        codes: The codes, such as those of a column of loads.
        text: The text of the file.

    Returns:
        The meaning of each code; empty unless the file explains each of them in one way.
    """
    if not 1 < len(codes) <= MAX_CODES or not all(codes):
        return {}
    found = {}
    for code in codes:
        told = re.findall(rf"(?<!\w){re.escape(code)}[ ]*[=:][ ]*([^;,|\t\r\n]*[^\s;,|\"])", text)
        if len({*told}) != 1:
            return {}
        found[code] = told[0]
    return found
