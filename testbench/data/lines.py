"""The lines of a text file as its owner sees them: letters, line breaks, comments, what is between cells."""

import csv
import re
from pathlib import Path
from typing import NamedTuple

from testbench.data.workbook import sheet_text
from testbench.errors import InputError, read_bytes

MAX_BYTES = 300_000_000
MAX_LINES = 1_000_000  #: That say something: each is held as a line of its own.
MARKS = {b"\xef\xbb\xbf": "utf-8", b"\xff\xfe": "utf-16-le", b"\xfe\xff": "utf-16-be"}
"""Byte order marks."""
WORKBOOK = b"PK\x03\x04"  #: Beginning of .xlsx.
PACKED = {
    WORKBOOK: "a workbook; export the sheet as CSV",
    b"\xd0\xcf\x11\xe0": "an old workbook, or one with a password; save it as .xlsx without one",
    b"\x1f\x8b": "a gzip file; unpack it first",
}
"""Beginnings of files that are no text, and what they are."""
COMMENTS = ("#", "//")
JOINED = 20  #: Most lines that one quoted cell may take.
LONGEST = 10_000_000  #: Letters of a line, with those of its quoted cells.
SEPARATORS = " ;,|\t"  #: A line of these alone is blank.
SAID = re.compile(f"^[{SEPARATORS}]*+[^{SEPARATORS}\n].*", re.MULTILINE)  #: Others are counted, never held.


class Line(NamedTuple):
    """A line with something in it."""

    number: int  #: In the file, from 1.
    text: str  #: Without its end; line breaks in quotes are blanks.

    @property
    def comment(self) -> bool:
        """Whether it is a comment."""
        return self.text.lstrip(' "').startswith(COMMENTS)


def read_letters(path: Path, encoding: str | None, mark: str) -> tuple[str, str]:
    """The text of a file without its byte order mark, and how it was read: by that mark, UTF-8, or cp1252.

    Args:
        path: The file, or FILE.xlsx#SHEET.
        encoding: What a map says of it.
        mark: The decimal mark of the numbers of a workbook, which have none.

    Raises:
        InputError: When it is missing, no plain file, too large, or no text.
    """
    content = read_bytes(path, MAX_BYTES)
    if content.startswith(WORKBOOK):
        return sheet_text(path, content, mark)
    return letters(path, content, encoding)


def letters(path: Path, content: bytes, encoding: str | None) -> tuple[str, str]:
    """The same of bytes that were read."""
    packed = next((what for begin, what in PACKED.items() if content.startswith(begin)), None)
    if packed:
        raise InputError(path, "", f"expected text, got {packed}")
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
        InputError: When quotes never end, or there is more than `LONGEST` in a line, or `MAX_LINES`.
    """
    found: list[Line] = []
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    first, begin, quotes, number, counted = 0, -1, 0, 1, 0
    for said in SAID.finditer(text):
        start, end = said.span()
        number, counted = number + text.count("\n", counted, start), start
        if begin < 0:
            first, begin, quotes = number, start, 0
        if end - begin > LONGEST:
            raise InputError(path, f"line {first}", f"expected at most {LONGEST} letters, got {end - begin}")
        if number - first > JOINED:
            break
        quotes += text.count('"', start, end)
        if quotes % 2:
            continue
        line = text[begin:end].replace("\n", " ")
        if not quotes or line.strip(f'{SEPARATORS}"'):
            found.append(Line(first, line))
        begin = -1
        if len(found) > MAX_LINES:
            raise InputError(path, f"line {number}", f"expected at most {MAX_LINES} lines of a table")
    if begin >= 0:
        raise InputError(path, f"line {first}", "not a table: quotes without an end")
    return found


def tabbed(line: str, runs: str) -> str:
    """A line whose runs of blanks outside of quotes, as many as these or more, are tabs."""
    pieces = line.strip().split('"')
    return '"'.join(p if k % 2 else re.sub(rf"\s{{{len(runs)},}}", "\t", p) for k, p in enumerate(pieces))


def cells_of(line: str, delimiter: str) -> list[str]:
    """Cells of a line without quotes around them; the line itself for what is no table."""
    if '"' not in line:
        return line.split(delimiter)
    try:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    except csv.Error:
        return [line]


def count_cells(line: str, delimiter: str) -> int:
    """How many cells a line has; delimiters in quotes do not count."""
    return 1 + "".join(line.split('"')[::2]).count(delimiter)
