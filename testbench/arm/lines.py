"""Where in a person's file a value stands, for the message about it: line and column, counted from 1."""

import re
from collections.abc import Sequence
from pathlib import Path

from testbench.errors import InputError, read_text

MAX_BYTES = 16_000_000  #: More than any file whose places are told.
HEADER = re.compile(r"\s*(\[\[?)\s*([\w.-]+)\s*\]")
KEY = re.compile(r"\s*([\w.-]+)\s*=")

Keys = tuple[str | int, ...]


def toml_place(path: Path, keys: Sequence[str | int]) -> str:
    """Line, column and name of a value in TOML, or of the table that lacks it.

    Args:
        path: The file, read before.
        keys: Names of tables and keys, places in arrays counted from 0, such as ("link", 0, "name").
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
    """The keys of a table from its header; of an array of tables the one that was opened last."""
    if array:
        seen[name] = seen.get(name, -1) + 1
    path: Keys = ()
    parts = name.split(".")
    for k, part in enumerate(parts, start=1):
        whole = ".".join(parts[:k])
        path = (*path, part, seen[whole]) if whole in seen else (*path, part)
    return path


def _inside(line: str, start: int, keys: Sequence[str | int]) -> int:
    """Where keys of an inline table stand in a line, as far as they are there."""
    for key in keys:
        found = re.search(rf"\b{re.escape(str(key))}\s*=", line[start:])
        if not found:
            break
        start += found.start()
    return start
