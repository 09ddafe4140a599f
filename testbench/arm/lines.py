"""Places of values in a user's file for messages: line and column, counted from 1."""

import re
from collections.abc import Sequence
from pathlib import Path

from testbench.errors import InputError, read_text

MAX_BYTES = 16_000_000  #: Largest file in which places are found [byte].
HEADER = re.compile(r"\s*(\[\[?)\s*([\w.-]+)\s*\]")
KEY = re.compile(r"\s*([\w.-]+)\s*=")

Keys = tuple[str | int, ...]
"""Keys of nested tables, and indices into arrays from 0."""


def toml_place(path: Path, keys: Sequence[str | int]) -> str:
    """Find line, column and name of a value in TOML, or of the table that lacks it.

    Args:
        path: The file, already read once.
        keys: Names of tables and keys, and indices into arrays from 0, such as ("link", 0, "name").

    Returns:
        The place as text, such as "line 12, column 1, link.0.name"; the keys alone if it cannot be found.
    """
    table: Keys = ()
    seen: dict[str, int] = {}
    best, place = 0, ""
    for number, line in enumerate(_lines(path), start=1):
        if header := HEADER.match(line):
            table = _table(header[2], seen, array=header[1] == "[[")
            here, start = table, header.start(2)
        elif key := KEY.match(line):
            here, start = (*table, *key[1].split(".")), key.start(1)
        else:
            continue
        if len(here) > best and here == tuple(keys[: len(here)]):
            best, place = len(here), f"line {number}, column {_inside(line, start, keys[len(here) :]) + 1}, "
    return place + ".".join(map(str, keys))


def _lines(path: Path) -> list[str]:
    try:
        return read_text(path, MAX_BYTES).splitlines()
    except InputError:  # it has changed since it was read
        return []


def _table(name: str, seen: dict[str, int], *, array: bool) -> Keys:
    """Return the keys of a table from its header; in an array of tables those of the last one opened."""
    if array:
        seen[name] = seen.get(name, -1) + 1
    path: Keys = ()
    parts = name.split(".")
    for k, part in enumerate(parts, start=1):
        whole = ".".join(parts[:k])
        path = (*path, part, seen[whole]) if whole in seen else (*path, part)
    return path


def _inside(line: str, start: int, keys: Sequence[str | int]) -> int:
    """Find where keys of an inline table stand in a line, as far as they are there."""
    for key in keys:
        found = re.search(rf"\b{re.escape(str(key))}\s*=", line[start:])
        if not found:
            break
        start += found.start()
    return start
