"""Text of a table: its encoding, lines, header, and the cells of a row."""

import contextlib
import csv
import functools
import io
import re
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import date, datetime, time, timedelta
from itertools import accumulate, islice
from pathlib import Path

from python_calamine import CalamineError, CalamineWorkbook, SheetTypeEnum, SheetVisibleEnum

from testbench.arm.document import is_decimal
from testbench.errors import InputError, printable, read_bytes, sheet_of
from testbench.files.mapping import FileLayout
from testbench.files.names import (
    BRACKETS,
    KNOWN_EXPORTS,
    Unit,
    column_meaning,
    find_unit,
    number_of,
    state_of,
)

# --- Sheets of workbooks (.xlsx, .xls, .ods) as the text of a table, read by calamine -----------------------

MAX_UNPACKED = (
    600_000_000  #: Size of all parts of a workbook [byte]: calamine holds each cell, however small.
)
MAX_CELLS = 20_000_000
"""Rows times columns of a sheet: calamine holds 32 bytes for each cell between the first and the last one."""
CELL = re.compile(rb'<c r="([A-Z]{1,3})([0-9]{1,7})"')  #: Name of a cell in the XML of a sheet.
WORKBOOKS = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")
"""First bytes of the files: zip, and old .xls."""
SHEET = "sheet "
"""Prefix of a sheet's name where an encoding is stated for text files."""
UNIT_LABEL = re.compile("units?|einheit(en)?|unités?|unidad(es)?|unità|单位|単位", re.IGNORECASE)
"""First cell of a line of units."""
RULE = re.compile(r"[\s|+]*[-=_:]{2}[-=_:\s|+]*")  #: A line that only divides the rows of a drawn table.
DAY_0 = datetime(1899, 12, 30)
"""First day of a spreadsheet's dates."""

WITH_COMMA = re.compile(r"[+-]?(\d{1,3}(\.\d{3})+,\d+|\d+,(\d{1,2}|\d{4,})|0+,\d+)")
"""Text of a number with a decimal comma; 1,234 may be a thousand."""

Cell = float | str | bool | time | date | datetime | timedelta


def sheet_text(path: Path, content: bytes, mark: str) -> tuple[str, str]:
    """Return the cells of one sheet as text, one line per row, with tabs between the cells.

    The sheet is the one that the path names behind `#`, else the first one with a table that is not hidden. A
    formula is its last result. Calamine returns an error, and a formula without its result, as a blank cell.
    Numbers get a decimal comma if numbers that stand as text have one.

    Args:
        path: The file, and the sheet.
        content: The bytes of the file.
        mark: The decimal mark that numbers get.

    Returns:
        The text, and which sheet it is.

    Raises:
        InputError: If calamine cannot read the file, it has no such sheet, or it unpacks to too much.
    """
    with _workbook(path, content) as book:
        name = sheet_of(path)[1] or [*_tables(book), *_seen(book), *book.sheet_names][0]
        if name not in book.sheet_names:
            have = ", ".join(book.sheet_names)
            raise InputError(path, "", f"expected one of its sheets, {have}, got {name!r}")
        rows = book.get_sheet_by_name(name).to_python(skip_empty_area=False)
    if any(isinstance(cell, str) and WITH_COMMA.fullmatch(cell.strip()) for row in rows for cell in row):
        mark = ","
    return "\n".join("\t".join(_text(cell, mark) for cell in row) for row in rows), f"{SHEET}{name}"


def sheets_with_tables(path: Path, but: str = "") -> list[str]:
    """List the sheets of a workbook that hold tables of numbers and are not hidden.

    Args:
        path: The file.
        but: Name of a sheet that is not listed.

    Returns:
        Their names, in order; empty for a file that is no workbook, and if the path names a sheet.

    Raises:
        InputError: If the file cannot be read.
    """
    content = read_bytes(path, MAX_BYTES)
    if sheet_of(path)[1] or not content.startswith(WORKBOOKS):
        return []
    with _workbook(path, content) as book:
        return list(_tables(book, but))


@contextlib.contextmanager
def _workbook(path: Path, content: bytes) -> Iterator[CalamineWorkbook]:
    """Open a workbook; an InputError says why calamine cannot read it."""
    try:
        _check_size(content)
        book = CalamineWorkbook.from_filelike(io.BytesIO(content))
        if not book.sheet_names:
            raise ValueError("it has no sheet")
        yield book
    except (CalamineError, zipfile.BadZipFile, ValueError) as err:
        problem = f"expected a workbook: {err}; save it without a password, or export it as CSV"
        raise InputError(path, "", problem) from err


def _seen(book: CalamineWorkbook) -> list[str]:
    """The sheets that are not hidden, and are no charts."""
    tables = [sheet for sheet in book.sheets_metadata if sheet.typ == SheetTypeEnum.WorkSheet]
    return [sheet.name for sheet in tables if sheet.visible == SheetVisibleEnum.Visible]


def _tables(book: CalamineWorkbook, but: str = "") -> Iterator[str]:
    """The sheets of these with two rows of three numbers: a cover sheet has none."""
    for name in (name for name in _seen(book) if name != but):
        rows = book.get_sheet_by_name(name).to_python(skip_empty_area=False)
        if len([*islice((row for row in rows if sum(map(_is_number, row)) > 2), 2)]) == 2:
            yield name


def _is_number(cell: Cell) -> bool:
    if isinstance(cell, str):
        return number_of(cell.strip()) is not None
    return isinstance(cell, float | int) and not isinstance(cell, bool)


def _check_size(content: bytes) -> None:
    """Refuse, by ValueError, a workbook that would fill the memory by large parts or a cell far away."""
    if content.startswith(WORKBOOKS[0]):
        with zipfile.ZipFile(io.BytesIO(content)) as book:
            size = sum(part.file_size for part in book.infolist())
            if size > MAX_UNPACKED:
                raise ValueError(f"at most {MAX_UNPACKED} bytes when unpacked, got {size}")
            for part in book.namelist():
                if part.startswith("xl/worksheets/sheet"):
                    _check_extent(book.read(part))


def _check_extent(sheet: bytes) -> None:
    """Refuse, by ValueError, a sheet of which calamine would hold too many blank cells."""
    rows, columns = 0, set()
    for cell in CELL.finditer(sheet):
        rows = max(rows, int(cell[2]))
        columns.add(cell[1])
    last = max(columns, key=lambda name: (len(name), name), default=b"")
    count = functools.reduce(lambda x, letter: 26 * x + letter - ord("A") + 1, last, 0)
    if rows * count > MAX_CELLS:
        far = f"its cells reach from A1 to column {last.decode()} and row {rows}"
        raise ValueError(f"{far}, more than {MAX_CELLS} cells: delete the cells far from the table")


def _text(cell: Cell, mark: str) -> str:
    """Return a cell as text. A date is never its number: a spreadsheet makes 1.2 the first of February."""
    if isinstance(cell, bool):
        return str(cell).upper()
    if isinstance(cell, float | int):
        return repr(cell).removesuffix(".0").replace(".", mark)
    if isinstance(cell, timedelta):
        return str(DAY_0 + cell)
    if isinstance(cell, date) and not isinstance(cell, datetime):
        return str(datetime.combine(cell, time()))
    text = printable(str(cell)).strip()
    return '"{}"'.format(text.replace('"', '""')) if '"' in text else text


# --- Text of a table: its encoding, lines, header, and the cells of a row -----------------------------------

MAX_BYTES = 300_000_000
"""Largest file that is read [byte]."""
MAX_LINES = 2_000_000
"""Most lines of a file."""
MARKS = {b"\xef\xbb\xbf": "utf-8", b"\xff\xfe": "utf-16-le", b"\xfe\xff": "utf-16-be"}
"""Byte order marks."""
EASTERN = (("cp932", "[\uff61-\uff9f]"), ("gb18030", "(?!)"))
"""Encodings of Japanese and Chinese, and letters that a text has if it is none in that encoding."""
OTHER_ENCODINGS = "cp932", "gb18030", "cp949", "cp1251"
"""Encodings of text without umlauts and accents: Japanese, Chinese, Korean, Russian."""
LOOKED_AT = 100_000  #: First bytes by which an encoding is guessed.
HEADER_LETTERS = 5000  #: First letters whose words tell an encoding.
NO_TABLES = {"JSON": r"\s*(\{\s*[\"}]|\[\s*\{)", "XML or HTML": r"\s*<[?!a-zA-Z]", "a PDF": "%PDF"}
"""Files that people take for tables, by their beginning."""
NO_TEXT = {
    b"\x1f\x8b": "a gzip file; unpack it first",
    b"\x89PNG": "a picture",
    b"\xff\xd8\xff": "a picture",
}
"""Files that are no text, by their first bytes."""
MINUS = "\u2212"  #: The sign of typesetters, which is read as a hyphen.
ROW_NAME = re.compile(r'\s*"\d+"')  #: Number of a row, which R writes in quotes and without a name.
COMMENTS = ("#", "//")
MAX_LINE_LENGTH = 1_000_000
"""Most letters of a line."""
JOINED = 20
"""Most lines of one quoted cell."""
BLANK = ' ;,|\t"'
"""Characters of a blank line."""
SEARCHED, WIDEST, COUNTED = 100, 20_000, 200
"""Lines in which a header is searched, most letters of the header, and most names of it that count."""
STATISTIC = re.compile(KNOWN_EXPORTS["statistics"]["row"])  #: First cell of a row of means or such.
WIDEST_WORD = 40  #: Most letters of it.
DELIMITERS = (";", "\t", ",", "|", " ", "  ")
"""Possible delimiters, in order of preference; blanks stand for runs of at least as many."""


def read_letters(path: Path, encoding: str | None, mark: str) -> tuple[str, str]:
    """Decode the text of a file, without its byte order mark.

    Args:
        path: The file, or FILE.xlsx#SHEET.
        encoding: Encoding that the map states; None for the byte order mark, then UTF-8, then cp1252.
        mark: The decimal mark for the numbers of a workbook, which have none.

    Returns:
        The text, and its encoding or sheet.

    Raises:
        InputError: If the file is missing, no plain file, too large, or no text.
    """
    content = read_bytes(path, MAX_BYTES)
    if content.startswith(WORKBOOKS):
        return sheet_text(path, content, mark)
    if what := next((what for begins, what in NO_TEXT.items() if content.startswith(begins)), ""):
        raise InputError(path, "", f"expected a table, got {what}")
    found = next((mark for mark in MARKS if content.startswith(mark)), b"")
    stated = MARKS.get(found, encoding)
    name = stated or _guessed_encoding(content)
    try:
        text = content[len(found) :].decode(name)
    except UnicodeDecodeError as err:
        wanted = name if stated else f"utf-8 or {name}"
        problem = f"expected text in {wanted}: {err.reason}; state the encoding in [file] of a map"
        raise InputError(path, f"byte {len(found) + err.start + 1}", problem) from err
    if what := next((what for what, begins in NO_TABLES.items() if re.match(begins, text)), ""):
        raise InputError(path, "line 1", f"expected a table, got {what}; save it as CSV or as a workbook")
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        hint = "if it is UTF-16 without a mark, state the encoding in a map"
        raise InputError(path, f"line {line}", f"expected text, got a zero byte; {hint}")
    return text.replace(MINUS, "-"), name


def _guessed_encoding(content: bytes) -> str:
    """Guess the encoding of text: UTF-8 if it is, else cp1252, unless most of its letters stand side by side.

    Then the encoding counts in which most words are known names of columns or states.
    """
    with contextlib.suppress(UnicodeDecodeError):
        content.decode("utf-8")
        return "utf-8"
    runs = re.findall(rb"[\x80-\xff]+", content[:LOOKED_AT])
    if 2 * sum(len(run) > 1 for run in runs) <= len(runs):
        return "cp1252"
    texts = dict[str, str]()
    for name in OTHER_ENCODINGS:
        with contextlib.suppress(UnicodeDecodeError):
            texts[name] = content.decode(name)
    known = {name: _known_words(text[:HEADER_LETTERS]) for name, text in texts.items()}
    if any(known.values()):
        return max(known, key=lambda name: known[name])
    for name, other in EASTERN:
        if name in texts and not re.search(other, texts[name]):
            return name
    return "cp1252"


def _known_words(text: str) -> int:
    """Count the words beyond ASCII that are names of columns or states."""
    words = {word for word in re.findall(r"\w+", text) if not word.isascii()}
    return sum(bool(column_meaning(word) or state_of(word)) for word in words)


def split_lines(path: Path, text: str) -> list[str]:
    """Split a text into lines; a quoted cell with line breaks is joined into its first line.

    Lines that were joined into an earlier one become blank, so that the number of lines stays.

    Args:
        path: The file, for messages.
        text: Its text.

    Returns:
        The lines.

    Raises:
        InputError: If quotes never end, or there are more than `MAX_LINES`.
    """
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    if (count := text.count("\n")) > MAX_LINES:
        raise InputError(path, "", f"expected at most {MAX_LINES} lines, got {count}")
    lines, first = text.split("\n"), -1
    for k, line in enumerate(lines) if '"' in text else ():
        odd = line.count('"') % 2
        if first >= 0:
            lines[first] += f" {line}"
            lines[k] = ""
        if odd:
            first = k if first < 0 else -1
        if first >= 0 and k - first > JOINED:
            break
    if first >= 0:
        raise InputError(path, f"line {first + 1}", "not a table: a quote is never closed")
    return lines


def even_rows(lines: Sequence[str], delimiters: Sequence[str] = DELIMITERS[:4]) -> list[list[str]]:
    """Divide lines into rows of equally many cells, by the delimiter that leaves the fewest lines out.

    Args:
        lines: The lines of a file.
        delimiters: What may separate the cells.

    Returns:
        The cells of every row; lines with another number of cells, blank lines and comments are left out.
    """
    said = [line for line in lines if line.strip(BLANK) and not is_comment(line)]
    best: list[list[str]] = []
    for mark in delimiters:
        rows = [row for row in (cells_in(line, mark) for line in said) if len(row) > 1]
        counts = Counter(map(len, rows))
        rows = [row for row in rows if len(row) == max(counts, key=lambda count: counts[count])]
        best = rows if len(rows) > len(best) else best
    return best


class UnevenRows(InputError):
    """Signal a row with another number of cells than the header."""


@dataclass(frozen=True)
class TableHeader:
    """Hold the header of a table."""

    line: int  #: Its last line in the file, from 1; 0 if the map names the columns.
    skipped: int  #: Lines with content before it.
    delimiter: str  #: Delimiter of the cells; blanks stand for runs of at least as many.
    names: tuple[str, ...]  #: Names of the columns; blank ones at the end are left out.
    units: tuple[Unit | None, ...]  #: Units of the columns, from a line of units below.
    body: Sequence[int]  #: Indices of the rows among the lines.
    left_out: int  #: Comments and repeated headers among the rows, left out.
    no_readings: Sequence[str] = ()  #: First words of rows of means and such, and of remarks behind the rows.
    sections: Sequence[str] = ()  #: What the nearest line of words above each row says, if that is asked for.


def find_header(
    path: Path, lines: Sequence[str], layout: FileLayout, known: Callable[[str], bool]
) -> TableHeader:
    """Find the header: the line with most known names.

    Args:
        path: The file, for messages.
        lines: All of its lines.
        layout: What the map states about the layout.
        known: Tells whether a name is that of a wanted column.

    Returns:
        The header, and which lines are rows.

    Raises:
        InputError: If the file is empty.
    """
    # Lines with content, between the skipped ones and the footer.
    said = [k for k, line in enumerate(lines) if line.strip(BLANK) and not RULE.fullmatch(line)]
    said = [k for k in said[: len(said) - layout.footer] if k >= (layout.skip or 0)]
    if not said:
        raise InputError(path, "line 1", "expected a header, the file is empty")
    if layout.names:
        return _without_header(lines, said, layout)
    at, delimiter = _most_names([lines[k] for k in said[: SEARCHED + layout.header]], layout, known)
    head = [lines[k] for k in said[at : at + layout.header]]
    if len(head[0]) > WIDEST:
        problem = f"expected a header of at most {WIDEST} letters, got {len(head[0])}"
        raise InputError(path, f"line {said[at] + 1}", problem)
    # Names of the columns, and the rows below without comments and repeated headers.
    names, below = _names(head, delimiter), said[at + layout.header :]
    if any(_has_row_name(lines[k], delimiter, len(names)) for k in below[:1]):
        names.insert(0, "")
    again = {line.strip() for line in head}  # of the next page
    rows = [k for k in below if not is_comment(lines[k]) and lines[k].strip() not in again]
    rows, others = _without_summaries(lines, rows, delimiter, 0 if layout.sections else len(names))
    rows, sections = _below_titles(lines, said, rows, delimiter, len(names) * layout.sections)
    # a line of units below the header
    units = units_in(lines[rows[0]], delimiter, len(names)) if rows else None
    if units:
        kept = [n for n, k in enumerate(rows) if lines[k].strip() != lines[rows[0]].strip()]
        rows, sections = [rows[n] for n in kept], [sections[n] for n in kept if sections]
    last = said[min(at + layout.header, len(said)) - 1]
    width = width_of([lines[k] for k in (last, *rows)], delimiter)
    names += [""] * (width - len(names))
    return TableHeader(
        line=last + 1,
        skipped=at,
        delimiter=delimiter,
        names=tuple(names),
        units=tuple(units or [None] * len(names)),
        body=rows,
        left_out=len(below) - len(rows) - bool(units) - len(others),
        no_readings=[_first_word(lines[k], delimiter) for k in others],
        sections=sections,
    )


def _most_names(lines: Sequence[str], layout: FileLayout, known: Callable[[str], bool]) -> tuple[int, str]:
    """Find the line with most known names, and the delimiter of its cells."""
    best = (-1, False, False, 0)
    at = 0
    delimiter = ","
    searched = 1 if layout.skip is not None else min(len(lines), SEARCHED)
    for mark in (layout.delimiter,) if layout.delimiter else DELIMITERS:
        if _blanks(mark) and best[0] > 1 and not _blanks(delimiter):
            break  # blanks stand within names too
        for k in (k for k in range(searched) if len(lines[k]) <= WIDEST):
            names, below = _names(lines[k : k + layout.header], mark), lines[k + layout.header :][:1]
            fits = any(
                _full(cells_in(line, mark), len(names)) or _has_row_name(line, mark, len(names))
                for line in below
            )
            # Blanks stand within names too: they divide a header only if they divide the row below alike.
            count = sum(map(known, names[:COUNTED])) if fits or not below or not _blanks(mark) else 0
            score = count, not is_comment(lines[k]), fits, len(names)
            if score[:3] > best[:3] or (not best[0] and score > best):
                best = score
                at = k
                delimiter = mark
    return at, delimiter


def _has_row_name(line: str, delimiter: str, count: int) -> bool:
    """Tell whether a row has the number of the row before as many cells as the header has."""
    return ROW_NAME.match(line) is not None and len(cells_in(line, delimiter)) == count + 1


def _title(line: str, delimiter: str, count: int) -> str:
    """The text of a line of words with less than half as many cells as the header; "" of any other line."""
    cells = [cell for cell in cells_in(line, delimiter) if cell]
    return "" if 2 * len(cells) >= count or any(map(is_decimal, cells)) else " ".join(cells)


def _is_remark(line: str, delimiter: str, count: int) -> bool:
    """Tell whether a line behind a table is a remark: words in one cell, or in fewer than a row has."""
    cells = cells_in(line, delimiter)
    alone = sum(map(bool, cells)) == 1 or len(cells) < count
    return alone and bool(_title(line, delimiter, count))


def _is_statistic(line: str, delimiter: str) -> bool:
    """Tell whether a row is of means, deviations or such over others, by its first word."""
    begins = line.lstrip(BLANK)[:WIDEST_WORD].casefold()
    return STATISTIC.match(begins) is not None and bool(
        STATISTIC.fullmatch(_first_word(line, delimiter).casefold())
    )


def _below_titles(
    lines: Sequence[str], said: Sequence[int], rows: list[int], delimiter: str, count: int
) -> tuple[list[int], list[str]]:
    """The rows without lines of words, and the nearest such line above each; with 0 columns all, and none."""
    if not count:
        return rows, []
    titles = {k: own for k in said if (own := _title(lines[k], delimiter, count))}
    kept = [k for k in rows if k not in titles]
    return kept, [next((titles[k] for k in range(row, -1, -1) if k in titles), "") for row in kept]


def _without_summaries(
    lines: Sequence[str], rows: Sequence[int], delimiter: str, count: int
) -> tuple[list[int], list[int]]:
    """The rows that are readings; and those of means, and of remarks behind a table of so many columns."""
    others = [k for k in rows if _is_statistic(lines[k], delimiter)]
    others = _summaries(lines, others, [k for k in rows if k not in {*others}], delimiter)
    kept = [k for k in rows if k not in {*others}]
    while len(kept) > 1 and count and _is_remark(lines[kept[-1]], delimiter, count):
        others.append(kept.pop())
    return kept, others


def _summaries(lines: Sequence[str], some: Sequence[int], rows: Sequence[int], delimiter: str) -> list[int]:
    """Those of some rows that sum others up: a pose called Max is as full, and has targets or rows below."""
    if not some or not rows:
        return [*some]
    every = [cells_in(lines[k], delimiter) for k in rows]
    words = {(n, cell) for row in every for n, cell in enumerate(row) if cell}
    named = {(n, cell) for n, cell in words if number_of(cell) is None}
    full = max(sum(map(bool, row)) for row in every)
    found = []
    for k in some:
        cells = cells_in(lines[k], delimiter)
        whole = sum(map(bool, cells)) >= full and k < rows[-1]
        if not whole and not {*enumerate(cells)} & named:
            found.append(k)
    return found


def _first_word(line: str, delimiter: str) -> str:
    return next((cell for cell in cells_in(line, delimiter) if cell), "")


def width_of(lines: Sequence[str], delimiter: str) -> int:
    """Count the columns of a table, with those that the header gives a blank cell but rows fill.

    Args:
        lines: The header, and the rows below.
        delimiter: What separates their cells.

    Returns:
        Number of the last column that the header names, or that it has and one of the first rows fills.
    """
    header, *rows = [cells_in(line, delimiter) for line in lines[: 1 + SEARCHED]]
    widths = [max((k for k, cell in enumerate(row, start=1) if cell), default=0) for row in (header, *rows)]
    return max(widths[0], min(len(header), max(widths)))


def _without_header(lines: Sequence[str], said: Sequence[int], layout: FileLayout) -> TableHeader:
    """Make the header from the names of the map; the delimiter that splits most rows correctly is used."""
    rows, count = [k for k in said if not is_comment(lines[k])], len(layout.names)

    def divided(mark: str) -> int:
        return sum(_full(cells_in(lines[k], mark), count) for k in rows)

    return TableHeader(
        line=0,
        skipped=0,
        delimiter=layout.delimiter or max(DELIMITERS, key=divided),
        names=tuple(layout.names),
        units=(None,) * count,
        body=rows,
        left_out=len(said) - len(rows),
    )


def is_comment(line: str) -> bool:
    """Tell whether a line is a comment.

    Args:
        line: The line.

    Returns:
        Whether it begins with the sign of a comment.
    """
    return line.lstrip(' "').startswith(COMMENTS)


def _blanks(delimiter: str) -> bool:
    return not delimiter.strip(" ")


def cells_in(line: str, delimiter: str) -> list[str]:
    """Split a line into cells without surrounding blanks, the sign of a comment left out.

    Args:
        line: The line.
        delimiter: What separates the cells; blanks stand for runs of at least as many.

    Returns:
        The cells.
    """
    text, mark = _divided(line.lstrip().lstrip("#/") if is_comment(line) else line, delimiter)
    return [cell.strip() for cell in _cells(text, mark)]


def _divided(line: str, delimiter: str) -> tuple[str, str]:
    """Return a line and its delimiter: runs of blanks outside quotes become tabs."""
    if not _blanks(delimiter):
        return line, delimiter
    parts, runs = line.strip().split('"'), rf"\s{{{len(delimiter)},}}"
    return '"'.join(part if k % 2 else re.sub(runs, "\t", part) for k, part in enumerate(parts)), "\t"


def _cells(line: str, mark: str) -> list[str]:
    """Split a line into cells without quotes; a line that is no table stays whole."""
    if '"' not in line:
        return line.split(mark)
    try:
        return next(csv.reader([line], delimiter=mark, skipinitialspace=True))
    except csv.Error:
        return [line]


def _names(lines: Sequence[str], delimiter: str) -> list[str]:
    """Combine the names of the columns; merged cells above also name the blank cells to their right."""
    *upper, lowest = [cells_in(line, delimiter) for line in lines]
    while lowest and not lowest[-1]:
        lowest.pop()
    merged = [filled_right(row, len(lowest)) for row in upper]
    names = (" ".join(_unit_last(column)) for column in zip(*merged, lowest, strict=True))
    return list(map(printable, names))


def _unit_last(parts: Sequence[str]) -> list[str]:
    """The parts of a name from the upper line on; a unit in brackets stands behind all of them."""
    found = list(filter(None, parts))
    upper = BRACKETS.match(found[0]) if len(found) > 1 else None
    return found if upper is None or find_unit(upper[2]) is None else [upper[1], *found[1:], f"[{upper[2]}]"]


def filled_right(cells: Sequence[str], count: int) -> list[str]:
    """Let the cells of a line above a header name the blank cells to their right, as merged cells do.

    Args:
        cells: The cells of the line.
        count: Number of columns.

    Returns:
        A text for every column.
    """
    return list(accumulate([*cells, *[""] * count][:count], _kept))


def _kept(left: str, own: str) -> str:
    return own or left


def _full(cells: Sequence[str], count: int) -> bool:
    """Tell whether a row has enough cells, and only blank ones beyond."""
    return len(cells) >= count and not any(cells[count:])


def units_in(line: str, delimiter: str, count: int) -> list[Unit | None] | None:
    """Read the units of a line that holds nothing but units.

    Args:
        line: The line below a header.
        delimiter: What separates its cells.
        count: Number of columns.

    Returns:
        The unit of every column, None for a blank cell; None for a line with other words.
    """
    words = [cell.strip("[]() ") for cell in cells_in(line, delimiter)][:count]
    words[:1] = [word for word in words[:1] if not UNIT_LABEL.fullmatch(word)] or [""]
    units = [find_unit(word) for word in words]
    other = [word for word, unit in zip(words, units, strict=True) if unit is None and word.strip("-1")]
    if other or not any(units):
        return None
    return units + [None] * (count - len(units))


def rows_of(path: Path, header: TableHeader, lines: Sequence[str]) -> tuple[bytes, str]:
    """Convert the rows below a header to CSV, without surplus blank cells.

    Args:
        path: The file, for messages.
        header: The header.
        lines: All lines of the file.

    Returns:
        The CSV, and the delimiter of its cells.

    Raises:
        UnevenRows: If a row has another number of cells than the header.
        InputError: If a line has more than `MAX_LINE_LENGTH` letters.
    """
    count, (_, mark) = len(header.names), _divided("", header.delimiter)
    blanks, rows = _blanks(header.delimiter), list[str]()
    for k, line in enumerate(lines, start=1):
        if len(line) > MAX_LINE_LENGTH:
            problem = f"expected at most {MAX_LINE_LENGTH} letters, got {len(line)}"
            raise InputError(path, f"line {k}", problem)
    for k in header.body:
        line = _divided(lines[k], header.delimiter)[0] if blanks else lines[k]
        if '"' in line or line.count(mark) != count - 1:
            cells = _cells(line, mark)
            while len(cells) > count and not cells[-1].strip():
                cells.pop()
            if len(cells) != count:
                hint = (
                    "; for a line after the table, write footer = 1, and if such lines name the rows below, "
                )
                hint += "sections = true, in [file] of a map"
                problem = f"expected {count} fields, got {len(cells)}{hint * (len(cells) < count)}"
                raise UnevenRows(path, f"line {k + 1}", problem)
            line = mark.join('"{}"'.format(cell.replace('"', '""')) for cell in cells)
        rows.append(line)
    return "\n".join(rows).encode(), mark
