"""Where the table of a file begins: the line with most of the names that are known, and what divides it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path

from testbench.data.lines import Line, cells_of, count_cells, tabbed
from testbench.data.mapping import Layout
from testbench.data.names import Unit, find_unit
from testbench.errors import InputError, shown

SEARCHED, WIDEST, COUNTED = 100, 20_000, 200
"""Lines in which a header is looked for, letters of the longest one, and names of it that count."""
DELIMITERS = (";", "	", ",", "|", " ", "  ")
"""Between cells; blanks stand for runs of at least as many. The first of equals is taken."""


@dataclass(frozen=True)
class Header:
    """The header of a table."""

    line: int  #: Its last line in the file, from 1; 0 where the map names the columns.
    skipped: int  #: Lines with something in them before it.
    delimiter: str  #: Between cells; blanks for runs of at least as many.
    names: tuple[str, ...]  #: Of the columns; those without any at the end are left out.
    units: tuple[Unit | None, ...]  #: Of the columns, by a line of units below.
    body: Sequence[Line]  #: The rows.
    left_out: int  #: Lines of comments and the header again among them, left out.


def find_header(path: Path, lines: Sequence[Line], layout: Layout, known: Callable[[str], bool]) -> Header:
    """The header, by how many of its names are known.

    Args:
        path: The file.
        lines: All of its lines that say something.
        layout: What the map says of the file.
        known: Whether a name is that of a column that is looked for.

    Raises:
        InputError: When the file is empty.
    """
    lines = lines[: len(lines) - layout.footer]
    first = next((k for k, line in enumerate(lines) if line.number > (layout.skip or 0)), len(lines))
    if first == len(lines):
        raise InputError(path, "line 1", "expected a header, the file is empty")
    if layout.names:
        return _without_header(lines[first:], layout)
    last = first + 1 if layout.skip is not None else min(len(lines), first + SEARCHED)
    best, at, delimiter = (-1, False, False, 0), first, ","
    for mark in (layout.delimiter,) if layout.delimiter else DELIMITERS:
        if _blanks(mark) and best[0] > 1 and not _blanks(delimiter):
            break  # blanks stand within names too
        for k in (k for k in range(first, last) if len(lines[k].text) <= WIDEST):
            names = _names(lines[k : k + layout.header], mark)
            known_here = sum(map(known, names[:COUNTED]))
            below = lines[k + layout.header : k + layout.header + 1]
            fits = any(_full(cells_in(line, mark), len(names)) for line in below)
            score = known_here, not lines[k].comment, fits, len(names)
            if score[:3] > best[:3] or (not best[0] and score > best):
                best, at, delimiter = score, k, mark
    if len(lines[at].text) > WIDEST:
        problem = f"expected a header of at most {WIDEST} letters, got {len(lines[at].text)}"
        raise InputError(path, f"line {lines[at].number}", problem)
    body = at + layout.header
    names = _names(lines[at:body], delimiter)
    again = {line.text.strip() for line in lines[at:body]}  # of the next page
    rows = [line for line in lines[body:] if not line.comment and line.text.strip() not in again]
    units = _units(rows[0], delimiter, len(names)) if rows else None
    if units:
        rows = [line for line in rows if line.text.strip() != rows[0].text.strip()]
    return Header(
        line=lines[min(body, len(lines)) - 1].number,
        skipped=at - first,
        delimiter=delimiter,
        names=tuple(names),
        units=tuple(units or [None] * len(names)),
        body=rows,
        left_out=len(lines) - body - len(rows) - bool(units),
    )


def _without_header(lines: Sequence[Line], layout: Layout) -> Header:
    """The columns as the map names them; what divides most lines into as many cells divides them all."""
    rows = [line for line in lines if not line.comment]
    count = len(layout.names)
    return Header(
        line=0,
        skipped=0,
        delimiter=layout.delimiter
        or max(DELIMITERS, key=lambda mark: sum(_full(cells_in(line, mark), count) for line in rows)),
        names=tuple(layout.names),
        units=(None,) * count,
        body=rows,
        left_out=len(lines) - len(rows),
    )


def _blanks(delimiter: str) -> bool:
    return delimiter.strip(" ") == ""


def cells_in(line: Line, delimiter: str) -> list[str]:
    """Cells of a line as of a header; a comment's are those behind its mark."""
    text, mark = _divided(line.text.lstrip().lstrip("#/") if line.comment else line.text, delimiter)
    return [cell.strip() for cell in cells_of(text, mark)]


def _divided(text: str, delimiter: str) -> tuple[str, str]:
    """A line, and the letter between its cells: a tab for runs of blanks."""
    return (tabbed(text, delimiter), "\t") if _blanks(delimiter) else (text, delimiter)


def _names(lines: Sequence[Line], delimiter: str) -> list[str]:
    """Names of the columns; those of merged cells above hold for the blank ones to their right."""
    *upper, lowest = [cells_in(line, delimiter) for line in lines]
    while lowest and not lowest[-1]:
        lowest.pop()
    merged = [[*accumulate(row, _kept), *[""] * len(lowest)] for row in upper]
    names = (" ".join(filter(None, column)) for column in zip(*merged, lowest, strict=False))
    return list(map(shown, names))


def _full(cells: list[str], count: int) -> bool:
    """Whether a row has as many cells, or more that are blank."""
    return len(cells) >= count and not any(cells[count:])


def _kept(left: str, own: str) -> str:
    return own or left


def _units(line: Line, delimiter: str, count: int) -> list[Unit | None] | None:
    """The units of a line that holds nothing else."""
    words = [cell.strip("[]() ") for cell in cells_in(line, delimiter)][:count]
    units = [find_unit(word) for word in words]
    other = [word for word, unit in zip(words, units, strict=True) if unit is None and word.strip("-1")]
    if other or not any(units):
        return None
    return units + [None] * (count - len(units))


def row_of(path: Path, header: Header, line: Line) -> str:
    """A row with ends of lines between its cells, without surplus blank ones; InputError for other counts."""
    text, mark = _divided(line.text, header.delimiter)
    count, got = len(header.names), count_cells(text, mark)
    row = "\n".join(cells_of(text, mark)) if '"' in text else text.replace(mark, "\n")
    whole = row.count("\n") == got - 1
    if whole and got > count:
        bare = row.rstrip()
        got = max(count, 1 + bare.count("\n"))
        row = bare + "\n" * (got - 1 - bare.count("\n"))
    if got != count or not whole:
        said = ", quotes around whole cells" * (not whole) + f", got {got}" * (got != count)
        hint = "; for a line behind the table say footer = 1 in the map's [file]"
        problem = f"expected {count} fields{said}" + hint * (line is header.body[-1])
        raise InputError(path, f"line {line.number}", problem)
    return row
