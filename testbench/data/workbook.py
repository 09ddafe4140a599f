"""The parts of an .xlsx workbook, XML in a zip (ECMA-376), read piece by piece within limits."""

import zipfile
from collections.abc import Iterator, Mapping
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

Element = tuple[str, Mapping[str, str], str]  #: Name, attributes and letters, at its end.


def find_sheet(path: Path, book: zipfile.ZipFile) -> tuple[str, str]:
    """The part of the sheet that is meant, and its name."""
    own = {shown(one["name"]): one for name, one, _ in elements(book, BOOK) if name == "sheet"}
    seen = [name for name, one in own.items() if one.get("state", "visible") == "visible"]
    asked = sheet_of(path)[1] or next(iter(seen or own), "")
    if asked not in own:
        raise InputError(path, "", f"expected one of its sheets, {', '.join(own)}, got {asked!r}")
    targets = (one["Target"] for _, one, _ in elements(book, LINKS) if one.get("Id") == own[asked]["id"])
    target = next(targets, "")
    return target[1:] if target.startswith("/") else f"xl/{target}", asked


def elements(book: zipfile.ZipFile, part: str) -> Iterator[Element]:
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
