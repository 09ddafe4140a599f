"""Cells of a text file or workbook as their author sees them; errors name line and column.

Apostrophe before text that a spreadsheet would compute: written to our files, removed on reading.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv

from testbench.arm.document import DECIMAL_PATTERN, is_integer
from testbench.errors import Array, Ids, InputError, Mask, printable, some_of
from testbench.files.mapping import FileLayout
from testbench.files.names import Unit, find_unit, squeeze
from testbench.files.text import (
    DELIMITERS,
    SHEET,
    TableHeader,
    even_rows,
    find_header,
    read_letters,
    rows_of,
    split_lines,
)

BEGINS = frozenset("=+-@\uff1d\uff0b\uff0d\uff20")
FORMULA = re.compile(r"[^+\-]|[+\-](?![\d.,\s]*(?:[eE][+-]?\d+)?\s*$)")
"""What a formula begins with, in letters of full width too, and how: a signed number is none."""
MARK = "'"
SECTION = "section"  #: Column of what lines of words say of the rows below them.
SHEETS = "sheet"  #: Column of the names of sheets that stand below each other.
NUMBER_BEFORE = r"[+-]?[0-9][0-9.,']*(?:[eE][+-]?[0-9]+)?"
WITH_UNIT = re.compile(rf"({NUMBER_BEFORE})\s*([^\d\s.,'+-][^\d\s.,'+-]*)")  #: Such as "12.5 mm".
MAX_SEARCHED = 40  #: Cells of a column in which its first text is looked for.
UNNAMED = re.compile(r"column \d+")  #: What a column without a heading is called, by its place from 1.


def as_cell(text: str) -> str:
    """Write text from a user's file as a cell of a CSV: on one line, and never a formula.

    Args:
        text: The text.

    Returns:
        The cell; text that a spreadsheet would take as a formula begins with MARK.
    """
    line = printable(text)
    return MARK + line if _is_formula(line) else line


def from_cell(text: str) -> str:
    """Read the text of a cell that `as_cell` wrote.

    Args:
        text: The cell.

    Returns:
        The text, without the guard against formulas.
    """
    return text[1:] if text.startswith(MARK) and _is_formula(text[1:]) else text


def _is_formula(text: str) -> bool:
    begins = text.lstrip()
    return begins[:1] in BEGINS and FORMULA.match(begins) is not None


COMMA = r"^[+-]?([0-9]+,[0-9]*|,[0-9]+)([eE][+-]?[0-9]+)?$"
DIVIDED = "|".join(f"({mark}[0-9]{{3}})+" for mark in ("X", "'", r"[ \x{00a0}\x{202f}]"))
GROUPED = {
    mark: f"^[+-]?[0-9]{{1,3}}({DIVIDED.replace('X', f'[{other}]')})[{mark}][0-9]+$"
    for mark, other in ((".", ","), (",", "."))
}
"""Numbers with grouped thousands, by decimal mark; without a decimal mark 1,234 is ambiguous."""


@dataclass(frozen=True)
class TableCells:
    """Hold the cells of a text file or a sheet."""

    path: Path  #: The file.
    names: tuple[str, ...]  #: Names of the columns in the file.
    units: tuple[Unit | None, ...]  #: Units of the columns, from a line of units below the header.
    header: int  #: Line of the header in the file.
    lines: Ids  #: Line of every row in the file, (rows,).
    notes: tuple[str, ...]  #: How the file was read.
    decimal: str | None  #: The decimal mark; None to find it in the cells.
    sheet: str  #: Name of the sheet, in which a blank cell may be an error; "" of a text file.
    transposed: bool  #: Whether lines here are columns of the file.
    #: Of every column: texts, or numbers that were computed.
    cells: Sequence["pa.Array"] = field(repr=False)
    #: Tables whose rows stand below those of the first, and which table each row is of, (rows,).
    others: Sequence["TableCells"] = field(default=(), repr=False)
    source: Ids | None = field(default=None, repr=False)

    @property
    def rows(self) -> int:
        """Count the rows."""
        return len(self.lines)

    def error(self, row: int, column: str, problem: str) -> InputError:
        """Make the error about a cell or a row.

        Args:
            row: The row, from 0.
            column: Name of the column; "" for the whole row.
            problem: Expected and actual value.

        Returns:
            The error; it names the line in the file.
        """
        line = self.lines[row] if row < self.rows else 1 + max([self.header, *self.lines[-1:]])
        own = [self, *self.others][
            int(self.source[row]) if self.source is not None and row < self.rows else 0
        ]
        return InputError(own.path, own.place(int(line), column), problem)

    def header_error(self, problem: str, column: str = "") -> InputError:
        """Make the error about the columns, or about the header of one.

        Args:
            problem: Expected and actual columns.
            column: Name of the column; "" for all.

        Returns:
            The error.
        """
        return InputError(self.path, self.place(self.header, column), problem)

    def place(self, line: int, column: str = "") -> str:
        """Describe a place in the file.

        Args:
            line: Line in the file, or row of the sheet, from 1; 0 for the header of a file without one.
            column: Name of the column; "" for the whole line.

        Returns:
            Such as "line 3, column x_mm".
        """
        sheet, (row, cell) = f"sheet {self.sheet}, " * bool(self.sheet), ("line", "column")
        row = "row" if self.sheet else row
        row, cell = ("column", "row") if self.transposed else (row, cell)
        where = f"{row} {line}" if line else "no header"
        return f"{sheet}{where}, {cell} {column}" if column else f"{sheet}{where}"

    def refuse(self, bad: Mask, columns: str | Sequence[str], problem: str | Callable[..., str]) -> None:
        """Raise an InputError at the first marked row or cell, if there is any.

        Args:
            bad: Marked rows, (rows,), or cells, (rows, k).
            columns: Name of the column, "" for the whole row; names of k columns for cells.
            problem: Expected and actual value, or a function that writes it from row and column, counted from
                0.

        Raises:
            InputError: If anything is marked.
        """
        if bad.any():
            row, *k = np.argwhere(bad)[0].tolist()
            name = columns if isinstance(columns, str) else columns[k[0]]
            raise self.error(row, name, problem if isinstance(problem, str) else problem(row, *k))

    def texts(self, k: int) -> list[str]:
        """Read the cells of a column as text, without surrounding blanks and guards against formulas.

        Args:
            k: Place of the column.

        Returns:
            The cells.
        """
        own = self.cells[k].dictionary_encode("encode")
        words = [from_cell(printable(str(word))) for word in own.dictionary.to_pylist()]
        return [words[place] for place in own.indices.to_numpy().tolist()]

    def blank(self, k: int) -> Mask:
        """Tell which cells of a column are blank.

        Args:
            k: Place of the column.

        Returns:
            Mask of the rows, (rows,).
        """
        if not pa.types.is_string(self.cells[k].type):
            return np.asarray(pc.is_null(self.cells[k]).to_numpy(zero_copy_only=False))
        return np.asarray(pc.equal(self.cells[k], "").to_numpy(zero_copy_only=False))

    def take(self, rows: Mask | Ids) -> "TableCells":
        """Select rows, in any order.

        Args:
            rows: A mask, (rows,), or places of rows.

        Returns:
            The table with these rows.
        """
        places = np.arange(self.rows)[rows]
        source = None if self.source is None else self.source[rows]
        cells = [cells.take(places) for cells in self.cells]
        return replace(self, lines=self.lines[rows], source=source, cells=cells)

    def above(self, others: Sequence["TableCells"], name: str, words: Sequence[str]) -> "TableCells":
        """Put the rows of other tables below those of this one, with a column that tells them apart.

        Args:
            others: The other tables, whose columns have the same names and units.
            name: Name of the new column.
            words: Its cells in rows of this table, and of each other one.

        Returns:
            The table of all.

        Raises:
            InputError: If the columns are not the same.
        """
        every = [self.cells, *(other.cells_like(self) for other in others)]
        tables = (self, *others)
        source = np.repeat(np.arange(len(tables)), [table.rows for table in tables])
        notes = [f"{own.sheet or own.path.name}: {note}" for own in others for note in own.notes]
        return replace(
            self,
            names=(*self.names, name),
            units=(*self.units, None),
            lines=np.concatenate([table.lines for table in tables]),
            notes=(*self.notes, *notes),
            cells=[
                *map(pa.concat_arrays, zip(*every, strict=True)),
                pa.array([words[k] for k in source.tolist()], pa.string()),
            ],
            others=others,
            source=source,
        )

    def stacked(
        self, columns: Mapping[str, Sequence[int]], labels: Mapping[str, Sequence[str]]
    ) -> "TableCells":
        """Put columns below each other; the rows of all other columns are repeated.

        Args:
            columns: Places of the columns that become one, by its name; all of n columns.
            labels: The n cells of each new column that tells them apart, by its name.

        Returns:
            The table, with n times as many rows.
        """
        gone = {k for places in columns.values() for k in places}
        kept = [k for k in range(len(self.names)) if k not in gone]
        first = [places[0] for places in columns.values()]
        count = len(next(iter(columns.values())))
        whole = self.take(np.tile(np.arange(self.rows), count))
        return replace(
            whole,
            names=(*(self.names[k] for k in kept), *columns, *labels),
            units=(*(self.units[k] for k in (*kept, *first)), *[None] * len(labels)),
            cells=[
                *(whole.cells[k] for k in kept),
                *(pa.concat_arrays([self.cells[k] for k in places]) for places in columns.values()),
                *(pa.array(np.repeat(words, self.rows).tolist(), pa.string()) for words in labels.values()),
            ],
        )

    def spread(self, tidy: Sequence[str]) -> "TableCells":
        """Turn rows of one quantity each into rows of one point each.

        Rows are of one point if they agree in all other columns. Columns that number the rows do not count.

        Args:
            tidy: The columns that hold the name, the value and (optional) the unit of each quantity.

        Returns:
            The table with one column per quantity, such as "x [mm]"; blank where a point has no value.

        Raises:
            InputError: If a column is missing, or a point has a quantity twice.
        """
        if missing := [name for name in tidy if name not in self.names]:
            raise self.header_error(f"no column {missing[0]!r}; columns are {some_of(self.names)}")
        name, value, *unit = (self.names.index(own) for own in tidy)
        every = {k: self.texts(k) for k in range(len(self.names)) if k not in (name, value, *unit)}
        shared = {k: texts for k, texts in every.items() if len({*texts}) < self.rows}
        quantities = self.texts(name)
        if unit:
            units = self.texts(unit[0])
            quantities = [f"{own} [{of}]" if of else own for own, of in zip(quantities, units, strict=True)]
        # The row of the value for each point and quantity.
        at = dict[tuple[str, ...], dict[str, int]]()
        for row, (point, own) in enumerate(zip(zip(*shared.values(), strict=True), quantities, strict=True)):
            if at.setdefault(point, {}).setdefault(own, row) != row:
                problem = f"expected every quantity once per point, got {own[:80]!r} again"
                raise self.error(row, self.names[name], problem)
        columns = list(dict.fromkeys(quantities))
        points = self.take(np.array([min(rows.values()) for rows in at.values()], dtype=np.int64))
        places = [pa.array([rows.get(own) for rows in at.values()], pa.int64()) for own in columns]
        return replace(
            points,
            names=(*(self.names[k] for k in shared), *columns),
            units=(*(self.units[k] for k in shared), *[self.units[value]] * len(columns)),
            cells=[
                *(points.cells[k] for k in shared),
                *(pc.fill_null(self.cells[value].take(own), "") for own in places),
            ],
        )

    def cells_like(self, first: "TableCells") -> list["pa.Array"]:
        """List the columns in the order of another table.

        Args:
            first: The other table.

        Returns:
            The cells of each of its columns here.

        Raises:
            InputError: If the columns are not the same.
        """
        place = {squeeze(own): k for k, own in enumerate(self.names)}
        missing = [own for own in first.names if squeeze(own) not in place]
        further = place.keys() - {*map(squeeze, first.names)}
        if missing or further:
            differ = f"missing here: {some_of(missing)}; only here: {len(further)} columns"
            raise self.header_error(f"expected the same columns as in {first.path.name}; {differ}")
        order = [place[squeeze(own)] for own in first.names]
        if first.units != tuple(self.units[k] for k in order):
            raise self.header_error(f"expected the same units as in {first.path.name}")
        return [self.cells[k] for k in order]

    def with_columns_of(self, other: "TableCells", rows: Ids) -> "TableCells":
        """Append the columns of another table that this table lacks; decimal commas become points.

        Args:
            other: The other table.
            rows: The row of the other table that belongs to each row here, (rows,).

        Returns:
            The joined table.
        """
        own = {squeeze(name) for name in self.names}
        kept = [k for k, name in enumerate(other.names) if squeeze(name) not in own]
        return replace(
            self,
            names=(*self.names, *(other.names[k] for k in kept)),
            units=(*self.units, *(other.units[k] for k in kept)),
            cells=[
                *map(_decimal_points, self.cells),
                *(_decimal_points(other.cells[k].take(rows)) for k in kept),
            ],
            notes=(*self.notes, *(f"{other.path.name}: {note}" for note in other.notes)),
        )

    def with_numbers(self, k: int, values: Array) -> "TableCells":
        """Replace the numbers of a column.

        Args:
            k: Place of the column.
            values: The numbers, (rows,); NaN for a blank cell.

        Returns:
            The changed table.
        """
        cells = list(self.cells)
        cells[k] = pa.array(values, pa.float64())
        return replace(self, cells=cells)

    def filled(self, columns: Sequence[int]) -> "TableCells":
        """Fill blank cells of some columns with the value above, as below merged cells.

        Args:
            columns: Places of the columns.

        Returns:
            The filled table.
        """
        cells = list(self.cells)
        for k in columns:
            own = np.where(self.blank(k), 0, np.arange(self.rows))
            cells[k] = cells[k].take(pa.array(np.maximum.accumulate(own)))
        return replace(self, cells=cells)

    def with_parts(
        self, k: int, parts: Sequence[str], divide: Callable[[str], Mapping[str, str] | None], expected: str
    ) -> "TableCells":
        """Append one column for each part of the combined cells of a column; a missing part is blank.

        Args:
            k: Place of the combined column.
            parts: Names of the parts.
            divide: Function that divides a cell into its parts; None for a cell that is written otherwise.
            expected: How cells should be written, for the message.

        Returns:
            The extended table.

        Raises:
            InputError: At the first cell that is written otherwise.
        """
        split: dict[str, dict[str, str]] = {"": {}}
        for row, text in enumerate(self.texts(k)):
            if text not in split:
                found = divide(text)
                if found is None:
                    raise self.error(row, self.names[k], f"expected {expected}, got {text[:80]!r}")
                split[text] = {part: value.strip() for part, value in found.items()}
        cells = [[split[text].get(part, "") for text in self.texts(k)] for part in parts]
        return replace(
            self,
            names=(*self.names, *(f"{self.names[k]}, {part}" for part in parts)),
            units=(*self.units, *[None] * len(parts)),
            cells=[*self.cells, *(pa.array(own, pa.string()) for own in cells)],
        )

    def worded(self, columns: Sequence[int], words: Mapping[str, str]) -> "TableCells":
        """Replace words in some columns by what they stand for.

        Args:
            columns: Places of the columns.
            words: Replacements by word.

        Returns:
            The changed table.
        """
        cells = list(self.cells)
        for k in columns:
            for word, meant in words.items():
                cells[k] = pc.if_else(pc.equal(cells[k], word), meant, cells[k])
        return replace(self, cells=cells)

    def counts(self, k: int) -> Ids | None:
        """Read a column of digits as integers.

        Args:
            k: Place of the column.

        Returns:
            The integers, (rows,); None if a cell holds anything but 1 to 18 digits.
        """
        if not pc.all(pc.match_substring_regex(self.cells[k], "^[0-9]{1,18}$")).as_py():
            return None
        return np.asarray(pc.cast(self.cells[k], pa.int64()).to_numpy())

    def integers(self, k: int) -> Ids:
        """Read a column as integers of 64 bits.

        Args:
            k: Place of the column.

        Returns:
            The integers, (rows,).

        Raises:
            InputError: Names the first cell that is no such integer.
        """
        if (counted := self.counts(k)) is not None:
            return counted
        texts = self.texts(k)
        found = {text: int(text) for text in dict.fromkeys(texts) if is_integer(text)}
        bad = np.array([text not in found for text in texts], dtype=bool)
        self.refuse(
            bad, self.names[k], lambda row: f"expected an integer of 64 bits, got {texts[row][:80]!r}"
        )
        return np.array([found[text] for text in texts], dtype=int)

    def mark(self, columns: Sequence[int]) -> str:
        """Find the decimal mark: as the map states, or as in most numbers of these columns that have one.

        Args:
            columns: Places of the columns.

        Returns:
            "." or ",".
        """
        if self.decimal:
            return self.decimal
        count = {",": 0, ".": 0}
        for k in columns:
            if pc.any(pc.match_substring(self.cells[k], ",")).as_py():
                comma = pc.match_substring_regex(self.cells[k], f"{COMMA}|{GROUPED[',']}")
                count[","] += pc.sum(comma).as_py() or 0
                count["."] += pc.sum(pc.and_not(pc.match_substring(self.cells[k], "."), comma)).as_py() or 0
            else:
                count["."] += pc.sum(pc.match_substring(self.cells[k], ".")).as_py() or 0
        return max(count, key=lambda mark: (count[mark], mark))

    def numbers(self, k: int, mark: str = ".", words: str = "") -> Array:
        """Read a column as finite numbers.

        Args:
            k: Place of the column.
            mark: The decimal mark.
            words: Hint for the error about a cell without a number.

        Returns:
            Numbers, (rows,); NaN where the cell is blank.

        Raises:
            InputError: At the first cell with anything else.
        """
        plain = self.cells[k]
        if pa.types.is_floating(plain.type):
            return np.asarray(plain.to_numpy(zero_copy_only=False))
        blank = self.blank(k)
        try:
            values = _parsed(pc.if_else(blank, None, _pointed(plain, mark)))
        except pa.ArrowInvalid:
            values = np.full(self.rows, np.nan)
        if not (np.isfinite(values) | blank).all():  # thousands, or what is no number
            grouped = pc.match_substring_regex(plain, GROUPED[mark])
            whole = pc.replace_substring_regex(plain, rf"[^0-9{mark}+-]", "")
            pointed = _pointed(pc.if_else(grouped, whole, plain), mark)
            values = _parsed(
                pc.if_else(pc.match_substring_regex(pointed, DECIMAL_PATTERN.pattern), pointed, "nan")
            )
        bad = np.flatnonzero(~np.isfinite(values) & ~blank)
        if len(bad):
            text = self.texts(k)[bad[0]]
            marked = len(text) > 1 and text.strip("+-.,' 0123456789") == ""
            hint = f"the decimal mark here is {mark!r}; a thousands separator must come before it"
            hint = f"; {hint}" if marked else words
            raise self.error(bad[0], self.names[k], f"expected a finite number, got {text[:80]!r}{hint}")
        return values


def _pointed(cells: "pa.Array", mark: str) -> "pa.Array":
    """Replace the decimal mark by a point; with a decimal comma 1.234 is not a number."""
    return cells if mark == "." else pc.replace_substring(pc.replace_substring(cells, ".", "_"), ",", ".")


def _parsed(cells: "pa.Array") -> Array:
    """Convert text to numbers, (rows,), NaN for null."""
    return np.asarray(pc.cast(cells, pa.float64()).to_numpy(zero_copy_only=False))


def read_table(path: Path, known: Callable[[str], bool], layout: FileLayout | None = None) -> TableCells:
    """Read the table of a text file or a workbook; the header is the line with most known names.

    Args:
        path: The file.
        known: Tells whether a name is that of a wanted column.
        layout: What a map states about the layout; None for nothing.

    Returns:
        The table.

    Raises:
        InputError: If the file cannot be read, is empty, or is no table.
    """
    layout = layout or FileLayout()
    paths = [path.with_name(f"{path.name}#{sheet}") for sheet in layout.sheets] or [path]

    def wanted(name: str) -> bool:
        return known(name) or name in layout.tidy

    tables = [
        table_of(own, read_letters(own, layout.encoding, layout.decimal or "."), wanted, layout)
        for own in paths
    ]
    table = tables[0]
    if layout.sheets:
        table = replace(table.above(tables[1:], SHEETS, layout.sheets), path=path)
    return table.spread(layout.tidy) if layout.tidy else table


def table_of(
    path: Path, letters: tuple[str, str], known: Callable[[str], bool], layout: FileLayout
) -> TableCells:
    """Split the text of a file into a table.

    Args:
        path: The file, for messages.
        letters: Its text, and how it was decoded, from `read_letters`.
        known: Tells whether a name is that of a wanted column; the header has most of them.
        layout: What the map states about the layout.

    Returns:
        The table.

    Raises:
        InputError: If the text is empty or no table.
    """
    text, encoding = letters
    if encoding.startswith(SHEET):
        layout = layout.model_copy(update={"delimiter": "\t" if "\t" in text else None})
    lines = split_lines(path, text)
    if layout.transposed:
        rows = even_rows(lines, [layout.delimiter] if layout.delimiter else DELIMITERS[:4])
        lines = ["\t".join(column) for column in zip(*rows, strict=True)] or [""]
        layout = layout.model_copy(update={"delimiter": "\t"})
    header = find_header(path, lines, layout, known)
    sections = [pa.array([printable(own) for own in header.sections], pa.string())] * layout.sections
    cells = _cells(*rows_of(path, header, lines), len(header.names))
    behind = [_unit_behind(own, unit) for own, unit in zip(cells, header.units, strict=True)]
    names = [
        name or ("" if _is_blank(own) else f"column {k}")
        for k, (name, own) in enumerate(zip(header.names, cells, strict=True), start=1)
    ]
    return TableCells(
        path=path,
        names=(*names, *[SECTION] * layout.sections),
        units=(*(unit for _, unit in behind), *[None] * layout.sections),
        header=header.line,
        lines=np.array(header.body, dtype=int) + 1,
        notes=_notes(encoding, header),
        decimal=layout.decimal,
        sheet=encoding.removeprefix(SHEET) if encoding.startswith(SHEET) else "",
        transposed=layout.transposed,
        cells=[*(own for own, _ in behind), *sections],
    )


def _is_blank(cells: "pa.Array") -> bool:
    """Whether a column holds nothing."""
    return bool(pc.all(pc.equal(cells, "")).as_py())


def _unit_behind(cells: "pa.Array", unit: Unit | None) -> tuple["pa.Array", Unit | None]:
    """The numbers of a column and their unit, if each of its cells has the same one, as "12.5 mm"."""
    first = next((text for text in cells[:MAX_SEARCHED].to_pylist() if text), "")
    found = WITH_UNIT.fullmatch(first)
    word = found[2] if found else ""
    own = find_unit(word) if word else None
    if own is None or (unit and unit != own):
        return cells, unit
    same = rf"^({NUMBER_BEFORE})\s*{re.escape(word)}$"
    if not pc.all(pc.or_(pc.equal(cells, ""), pc.match_substring_regex(cells, same))).as_py():
        return cells, unit
    return pc.replace_substring_regex(cells, same, r"\1"), own


def _notes(encoding: str, header: TableHeader) -> tuple[str, ...]:
    """Describe how a file was read."""
    between = {"\t": "tabs", " ": "runs of blanks", "  ": "runs of two or more blanks"}.get(
        header.delimiter, f"{header.delimiter!r}"
    )
    sheet = encoding.startswith(SHEET)
    where = f"header in {'row' if sheet else 'line'} {header.line}"
    where = where if header.line else "the map names the columns"
    how = encoding if sheet else f"text in {encoding}, cells separated by {between}"
    found = [f"{how}, {where}"]
    counts = {"before the header": header.skipped, "of comments or the header again": header.left_out}
    found += [f"{count} line{'s'[: count > 1]} {what} left out" for what, count in counts.items() if count]
    if header.no_readings:
        words = ", ".join(dict.fromkeys(map(printable, header.no_readings)))
        found += [f"rows that are not readings are left out: {words}"]
    return (*found, *["the line below the header holds units"] * any(header.units))


def _cells(content: bytes, mark: str, count: int) -> list["pa.Array"]:
    """Parse rows of CSV to cells without surrounding blanks, one array per column."""
    if not content:
        return [pa.array([], pa.string())] * count
    names = list(map(str, range(count)))
    read = csv.read_csv(
        pa.BufferReader(content),
        csv.ReadOptions(column_names=names, block_size=len(content) + 1),
        csv.ParseOptions(delimiter=mark, ignore_empty_lines=False),
        csv.ConvertOptions(column_types=dict.fromkeys(names, pa.string())),
    )
    return [pc.utf8_trim_whitespace(read[name].combine_chunks()) for name in names]


def _decimal_points(cells: "pa.Array") -> "pa.Array":
    """Replace decimal commas in a column of numbers by points."""
    plain = pc.match_substring_regex(cells, rf"{COMMA}|^[+-]?[0-9]*$")
    return pc.replace_substring(cells, ",", ".") if pc.all(plain).as_py() else cells
