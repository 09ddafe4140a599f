"""The lines of a text file as its owner sees them: letters, line breaks, comments, what is between cells."""

import csv
import re
from dataclasses import dataclass
from pathlib import Path

from testbench.errors import InputError, read_bytes

MAX_BYTES = 300_000_000
MARKS = {b"\xef\xbb\xbf": "utf-8", b"\xff\xfe": "utf-16-le", b"\xfe\xff": "utf-16-be"}
"""Byte order marks."""
WORKBOOK = b"PK\x03\x04"  #: Beginning of an .xlsx or .ods file.
COMMENTS = ("#", "//")
JOINED = 20  #: Most lines that one quoted cell may take.


@dataclass(frozen=True)
class Line:
    """A line with something in it."""

    number: int  #: In the file, from 1.
    text: str  #: Without its end; line breaks in quotes are blanks.

    @property
    def comment(self) -> bool:
        """Whether it is a comment."""
        return self.text.lstrip(' "').startswith(COMMENTS)


def read_letters(path: Path, encoding: str | None) -> tuple[str, str]:
    """The text of a file without its byte order mark, and its encoding: that of the mark, UTF-8, or cp1252.

    Raises:
        InputError: When it is missing, no plain file, too large, or no text.
    """
    content = read_bytes(path, MAX_BYTES)
    if content.startswith(WORKBOOK):
        raise InputError(path, "", "expected text, got a workbook; export the sheet as CSV")
    mark = next((mark for mark in MARKS if content.startswith(mark)), b"")
    tried = [MARKS[mark]] if mark else [encoding] if encoding else ["utf-8", "cp1252"]
    for name in tried:
        try:
            text = content[len(mark) :].decode(name)
        except UnicodeDecodeError as err:
            if name == tried[-1]:
                words = " or ".join(tried)
                place = f"byte {len(mark) + err.start + 1}"
                problem = f"expected text in {words}: {err.reason}; a map's [file] may say the encoding"
                raise InputError(path, place, problem) from err
        else:
            if "\0" in text:
                line = text.count("\n", 0, text.index("\0")) + 1
                problem = (
                    "expected text, got a zero byte; for UTF-16 without a mark say the encoding in a map"
                )
                raise InputError(path, f"line {line}", problem)
            return text, name
    raise AssertionError


def split_lines(path: Path, text: str) -> list[Line]:
    """All lines but blank ones; a line ends where no quotes are open.

    Raises:
        InputError: When quotes never end.
    """
    found: list[Line] = []
    first, parts = 0, list[str]()
    for number, line in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), start=1):
        if not parts and '"' not in line:  # nearly all
            if _says_something(line):
                found.append(Line(number, line))
            continue
        first = first if parts else number
        parts.append(line)
        whole = " ".join(parts)
        if whole.count('"') % 2 == 0:
            if _says_something(whole):
                found.append(Line(first, whole))
            parts = []
        elif len(parts) > JOINED:
            break
    if parts:
        raise InputError(path, f"line {first}", "not a table: quotes without an end")
    return found


def _says_something(line: str) -> bool:
    return bool(line.strip(' ;,|\t"'))


def tabbed(line: str, runs: str) -> str:
    """A line whose runs of blanks outside of quotes, as many as these or more, are tabs."""
    pieces = line.strip().split('"')
    return '"'.join(p if k % 2 else re.sub(rf"\s{{{len(runs)},}}", "\t", p) for k, p in enumerate(pieces))


def count_cells(line: str, delimiter: str) -> int:
    """How many cells a line has; delimiters in quotes do not count."""
    return 1 + sum(piece.count(delimiter) for piece in line.split('"')[::2])


def cells_of(line: str, delimiter: str) -> list[str]:
    """Cells of a line without quotes and blanks around them; none for what is no table."""
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))]
    except csv.Error:
        return []
