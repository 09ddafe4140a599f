"""Sheets of workbooks (.xlsx, .xls, .ods) as the text of a table, read by calamine."""

import functools
import io
import re
import zipfile
from collections.abc import Sequence
from datetime import date, datetime, time, timedelta
from pathlib import Path

from python_calamine import CalamineError, CalamineWorkbook, SheetTypeEnum, SheetVisibleEnum

from testbench.errors import InputError, printable, sheet_of

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
DAY_0 = datetime(1899, 12, 30)
"""First day of a spreadsheet's dates."""

Cell = float | str | bool | time | date | datetime | timedelta


def sheet_text(path: Path, content: bytes, mark: str) -> tuple[str, str]:
    """Return the cells of one sheet as text, one line per row, with tabs between the cells.

    The sheet is the one that the path names behind `#`, else the first that is not hidden. A formula is its
    last result. Calamine returns an error, and a formula without its result, as a blank cell.

    Args:
        path: The file, and the sheet.
        content: The bytes of the file.
        mark: The decimal mark that numbers get.

    Returns:
        The text, and which sheet it is.

    Raises:
        InputError: If calamine cannot read the file, it has no such sheet, or it unpacks to too much.
    """
    try:
        _check_size(content)
        book = CalamineWorkbook.from_filelike(io.BytesIO(content))
        tables = [sheet for sheet in book.sheets_metadata if sheet.typ == SheetTypeEnum.WorkSheet]
        seen = [sheet.name for sheet in tables if sheet.visible == SheetVisibleEnum.Visible]
        if not book.sheet_names:
            raise ValueError("it has no sheet")
        name = sheet_of(path)[1] or [*seen, *book.sheet_names][0]
        if name not in book.sheet_names:
            have = ", ".join(book.sheet_names)
            raise InputError(path, "", f"expected one of its sheets, {have}, got {name!r}")
        rows = book.get_sheet_by_name(name).to_python(skip_empty_area=False)
    except (CalamineError, zipfile.BadZipFile, ValueError) as err:
        problem = f"expected a workbook: {err}; save it without a password, or export it as CSV"
        raise InputError(path, "", problem) from err
    return "\n".join(_line(row, mark) for row in rows), f"{SHEET}{name}"


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
        raise ValueError(f"{far}, more than {MAX_CELLS} cells: delete what stands far from the table")


def _line(row: Sequence[Cell], mark: str) -> str:
    return "\t".join([_text(cell, mark) for cell in row])


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
