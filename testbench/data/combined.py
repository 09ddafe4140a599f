"""Cells that hold several quantities at once, taken apart as the map says."""

import re
from collections import Counter

from testbench.data.mapping import Names
from testbench.data.names import recognise
from testbench.data.table import Table
from testbench.errors import InputError

MOST_STARS = 2  #: Wildcards in a pattern: more take long to match.


def take_apart(table: Table, names: Names) -> tuple[Table, list[str]]:
    """The table with a column more for every part of its combined cells, and how its columns are called.

    A name that stands in the header again is called by its number too, as "X (2)", where the map does so.

    Raises:
        InputError: At a pattern that is none, or a cell that none of its patterns fits.
    """
    read_as = _numbered(table.names, names)
    for header, patterns in names.cells.items():
        place, wholes = f"cells.{header}", []
        if header not in table.names:
            have = ", ".join(map(repr, table.names))
            raise InputError(names.path or table.path, place, f"no such column; columns are {have}")
        for pattern in patterns:
            parts = re.findall(r"\{(\w+)\}", pattern)
            known = all(recognise(part, names.ours) for part in parts)
            if not parts or not known or len(set(parts)) < len(parts) or pattern.count("*") > MOST_STARS:
                problem = (
                    "expected quantities such as {run}, {pose}, {marker}, each once, * for anything else, "
                    f"got {pattern!r}"
                )
                raise InputError(names.path or table.path, place, problem)
            wholes.append(_expression(pattern))
        parts = list(dict.fromkeys(part for whole in wholes for part in whole.groupindex))
        table = table.with_parts(table.names.index(header), parts, wholes, " or ".join(map(repr, patterns)))
        read_as += parts
        if not names.maps(header):
            read_as[table.names.index(header)] = ""  # one of our names, but its parts count
    return table, read_as


def _numbered(header: tuple[str, ...], names: Names) -> list[str]:
    """The names of a header; those that stand there again with their number, where the map has it."""
    count, found = Counter[str](), list[str]()
    for name in header:
        count[name] += 1
        numbered = f"{name} ({count[name]})"
        found.append(numbered if count[name] > 1 and names.maps(numbered) else name)
    return found


def _expression(pattern: str) -> re.Pattern[str]:
    """A pattern as a regular expression: {part} is as short as may be, * anything."""
    pieces = re.split(r"\{(\w+)\}", pattern)
    literal = [re.escape(piece).replace(r"\*", ".*") for piece in pieces[::2]]
    groups = [f"(?P<{part}>.+?)" for part in pieces[1::2]]
    return re.compile("".join(a + b for a, b in zip(literal, [*groups, ""], strict=True)), re.IGNORECASE)
