"""A sheet of an .xlsx workbook as the text of a table: its cells as the file holds them, divided by tabs.

A date is never its number: a spreadsheet makes 1.2 the first of February. A formula is its last result. The
parts of a workbook, XML in a zip (ECMA-376), are read piece by piece within limits.
"""

import io
import re
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime, timedelta
from functools import lru_cache
from pathlib import Path
from xml.parsers import expat

from testbench.errors import InputError, sheet_of, shown

MAX_LETTERS, MAX_TAG, MAX_DEPTH = 300_000_000, 10_000_000, 100  #: Of a part or table, a tag, elements nested.
MAX_ELEMENTS = 3_000_000  #: Of a part: a cell with a number is two. Larger tables come as CSV.
MAX_PARTS, ROWS, COLUMNS = 10_000, 1_048_576, 16_384  #: Of a workbook, and of its largest sheet.
BLOCK = 100_000  #: Bytes that are parsed at a time: few, for the memory of their elements.
BOOK, LINKS, TEXTS, STYLES = (
    f"xl/{name}.xml{more}"
    for name, more in (("workbook", ""), ("_rels/workbook", ".rels"), ("sharedStrings", ""), ("styles", ""))
)
SHEET = "sheet"  #: Begins the words of what was read.
ENTRY = b"PK\x01\x02"  #: Before the name of every part.
TIMES = {*range(14, 23), 45, 46, 47}  #: Numbers of formats of dates and times that have no code.
MUTE = re.compile(r'"[^"]*"|\[(?!(?:h+|m+|s+)\])[^\]]*\]|[\\_*].', re.IGNORECASE)  #: Says nothing of a date.
DATE = re.compile("[ymdhs]", re.IGNORECASE)
DAY_0 = datetime(1899, 12, 30)
UNSAID = "a formula without its result: save the file in a spreadsheet"
Element = tuple[str, Mapping[str, str], str]  #: Name, attributes and letters, at its end.
Said = Callable[[Mapping[str, str], str], str]  #: What a cell of these attributes and letters says.


def sheet_text(path: Path, content: bytes, mark: str) -> tuple[str, str]:
    """The cells of the sheet that a path names behind `#`, else of the first that is not hidden.

    Args:
        path: The file, and the sheet.
        content: The bytes of the file.
        mark: The decimal mark that numbers get.

    Returns:
        A line a row, as it is numbered there, all of as many cells; and which sheet it is.

    Raises:
        InputError: When it is no workbook, has no such sheet, or is too large.
    """
    try:
        if content.count(ENTRY) > MAX_PARTS:
            raise ValueError(f"more than {MAX_PARTS} parts")
        with zipfile.ZipFile(io.BytesIO(content)) as book:
            part, name = _find_sheet(path, book)
            return _lines(_elements(book, part), _meaning(book, mark)), f"{SHEET} {name}"
    except (zipfile.BadZipFile, zlib.error, expat.ExpatError, EOFError, OSError) as err:
        raise InputError(path, "", f"not a whole .xlsx workbook: {err}") from err
    except (ValueError, LookupError, RuntimeError) as err:  # also a password, or a rare way of packing
        raise InputError(path, "", f"not a workbook that is read here: {err}; export it as CSV") from err


def _meaning(book: zipfile.ZipFile, mark: str) -> Said:
    """What cells say, by the texts that they share and their formats."""
    parts = book.namelist()
    words = list(_words(_elements(book, TEXTS))) if TEXTS in parts else []
    dates = _dates(_elements(book, STYLES)) if STYLES in parts else []

    def said(cell: Mapping[str, str], letters: str) -> str:
        kind, style = cell.get("t", "n"), int(cell.get("s", "0"))
        if kind == "n" and style < len(dates) and dates[style]:
            try:
                return str(DAY_0 + timedelta(milliseconds=round(86_400_000 * float(letters))))
            except OverflowError:  # ##### on the screen
                return letters
        if kind == "n":
            return shown(letters).strip().removesuffix(".0").replace(".", mark)
        known = {"s": words, "b": ["FALSE", "TRUE"]}.get(kind)
        text = shown(known[int(letters)] if known is not None else letters).strip()
        text = text.lstrip("#") if kind == "e" else text  # #N/A begins no comment
        return '"{}"'.format(text.replace('"', '""')) if '"' in text else text

    return said


def _words(elements: Iterator[Element]) -> Iterator[str]:
    """The shared texts, without how they are spoken."""
    pieces: list[str] = []
    for name, _, letters in elements:
        if name == "t":
            pieces.append(letters)
        elif name == "rPh":
            pieces.pop()
        elif name == "si":
            yield "".join(pieces)
            pieces.clear()


def _dates(elements: Iterator[Element]) -> list[bool]:
    """Of every style, whether it shows a date or time."""
    times, styles = {str(k) for k in TIMES}, list[bool]()
    for name, own, _ in elements:
        if name == "numFmt" and DATE.search(MUTE.sub("", own["formatCode"])):
            times.add(own["numFmtId"])
        elif name == "xf":
            styles.append(own.get("numFmtId") in times)
        elif name == "cellStyleXfs":
            styles.clear()
        elif name == "cellXfs":
            break
    return styles


def _lines(elements: Iterator[Element], said: Said) -> str:
    """The rows of a sheet, one a line, blank ones too; ValueError where they are too many."""
    lines, counts, size = list[str](), list[int](), 0
    for number, cells in _rows(elements, said):
        blank = (number or len(lines) + 1) - 1 - len(lines)
        if blank < 0 or len(lines) + blank >= ROWS:
            raise ValueError(f"row {number} stands behind row {len(lines)} of at most {ROWS}")
        lines += [""] * blank + ["\t".join(cells)]
        counts += [1] * blank + [max(1, len(cells))]
        size += len(lines[-1])
        if size > MAX_LETTERS:
            raise ValueError(f"expected at most {MAX_LETTERS} letters of a table")
    widest = max(counts, default=1)
    if size + widest * len(lines) > MAX_LETTERS:
        raise ValueError(f"expected at most {MAX_LETTERS} letters, got {len(lines)} rows of {widest} cells")
    return "\n".join(line + "\t" * (widest - k) for line, k in zip(lines, counts, strict=True))


def _rows(elements: Iterator[Element], said: Said) -> Iterator[tuple[int, list[str]]]:
    """Number, 0 if not said, and cells of every row, without blank ones at its end."""
    cells, letters, formula, column = list[str](), "", False, 0
    for name, own, text in elements:
        if name in ("v", "t"):
            letters += text
        elif name == "f":
            formula = True
        elif name == "c":
            column = _column(own.get("r", ""), column)
            cell = said(own, letters) if letters else UNSAID * formula
            cells += [*[""] * (column - 1 - len(cells)), cell] if cell else []
            letters, formula = "", False
        elif name == "row":
            yield int(own.get("r", "0")), cells
            cells, column = [], 0


def _column(place: str, last: int) -> int:
    """The column of a cell, counted from 1, behind the last one."""
    column = 0
    for letter in place.rstrip("0123456789")[:4]:
        column = 26 * column + int(letter, 36) - 9
    column = column or last + 1
    if not last < column <= COLUMNS:
        raise ValueError(f"cell {place[:20]!r} stands behind column {last} of at most {COLUMNS}")
    return column


def _find_sheet(path: Path, book: zipfile.ZipFile) -> tuple[str, str]:
    """The part of the sheet that is meant, and its name."""
    own = {shown(one["name"]): one for name, one, _ in _elements(book, BOOK) if name == "sheet"}
    seen = [name for name, one in own.items() if one.get("state", "visible") == "visible"]
    asked = sheet_of(path)[1] or next(iter(seen or own), "")
    if asked not in own:
        raise InputError(path, "", f"expected one of its sheets, {', '.join(own)}, got {asked!r}")
    targets = (one["Target"] for _, one, _ in _elements(book, LINKS) if one.get("Id") == own[asked]["id"])
    target = next(targets, "")
    return target[1:] if target.startswith("/") else f"xl/{target}", asked


def _elements(book: zipfile.ZipFile, part: str) -> Iterator[Element]:
    """The ends of all elements of a part, names without what stands before them.

    Raises:
        ValueError: When it is missing, too large or too deep, or has a document type, as entities need it.
    """
    if part not in book.namelist():
        raise ValueError(f"it has no {part}")
    found, opened, letters = list[Element](), list[tuple[str, dict[str, str]]](), list[str]()

    def begin(name: str, own: dict[str, str]) -> None:
        if len(opened) == MAX_DEPTH:
            refuse(f"more than {MAX_DEPTH} elements in one another")
        opened.append((_local(name), {_local(k): v for k, v in own.items()} if own else own))
        letters.clear()

    def end(_: str) -> None:
        found.append((*opened.pop(), "".join(letters)))
        letters.clear()

    def refuse(why: str, *_: object) -> None:
        raise ValueError(f"{part}: {why}")

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.CharacterDataHandler = letters.append
    parser.StartDoctypeDeclHandler = lambda *_: refuse("document types are not allowed")
    most = f"expected at most {MAX_LETTERS} bytes, {MAX_TAG} of an element, {MAX_ELEMENTS} elements"
    size = silent = count = 0
    with book.open(part) as file:  # to count is quick, to parse is not
        while block := file.read(BLOCK):
            size, count = size + len(block), count + block.count(b"<")
            if size > MAX_LETTERS or count > 2 * MAX_ELEMENTS:
                refuse(most)
    count = 0
    with book.open(part) as file:
        while block := file.read(BLOCK):
            silent += len(block)
            if silent > MAX_TAG or count > MAX_ELEMENTS:
                refuse(most)
            parser.Parse(block)
            silent, count = 0 if found else silent, count + len(found)
            yield from found
            found.clear()
    parser.Parse(b"", True)
    yield from found


@lru_cache(1000)
def _local(name: str) -> str:
    """A name without what stands before its colon."""
    return name.rpartition(":")[2]
