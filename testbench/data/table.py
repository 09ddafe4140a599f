"""The cells of a text file as its owner sees them; a wrong one is refused by line and column."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv

from testbench.arm.decimal import NUMBER, is_integer
from testbench.data.formula import from_cell
from testbench.data.header import Header, find_header, row_of
from testbench.data.lines import read_letters, split_lines
from testbench.data.mapping import Layout
from testbench.data.names import Unit, squeeze
from testbench.data.workbook import SHEET
from testbench.errors import Array, Ids, InputError, Mask, shown

COMMA = r"^[+-]?([0-9]+,[0-9]*|,[0-9]+)([eE][+-]?[0-9]+)?$"
DIVIDED = "|".join(f"({mark}[0-9]{{3}})+" for mark in ("X", "'", r"[ \x{00a0}\x{202f}]"))
GROUPED = {
    mark: f"^[+-]?[0-9]{{1,3}}({DIVIDED.replace('X', f'[{other}]')})[{mark}][0-9]+$"
    for mark, other in ((".", ","), (",", "."))
}
"""Numbers whose thousands are divided, by decimal mark; without one 1,234 is told from no other number."""


@dataclass(frozen=True)
class Table:
    """The cells of a text file."""

    path: Path  #: The file.
    names: tuple[str, ...]  #: Of the columns, as they stand in the file.
    units: tuple[Unit | None, ...]  #: Of the columns, by a line of units below the header.
    header: int  #: Line of the header in the file.
    delimiter: str  #: Between cells; blanks for runs of at least as many.
    lines: Ids  #: Line of every row in the file, (rows,).
    notes: tuple[str, ...]  #: How the file was read.
    decimal: str | None  #: The decimal mark; None where the cells decide.
    #: Of every column: texts, or numbers where all of a column were read as such.
    cells: Sequence["pa.Array"] = field(repr=False)

    @property
    def rows(self) -> int:
        """How many rows there are."""
        return len(self.lines)

    def error(self, row: int, column: str, problem: str) -> InputError:
        """What is wrong in a row, counted from 0, and in which column; "" for the whole row."""
        line = self.lines[row] if row < self.rows else 1 + max([self.header, *self.lines[-1:]])
        return InputError(self.path, f"line {line}" + (f", column {column}" if column else ""), problem)

    def header_error(self, problem: str) -> InputError:
        """What is wrong with the columns."""
        return InputError(self.path, f"line {self.header}", problem)

    def refuse(self, bad: Mask, columns: str | Sequence[str], problem: str | Callable[..., str]) -> None:
        """InputError at the first place under a mask, if there is any.

        Args:
            bad: (rows,), or (rows, k).
            columns: Name of the column, "" for the whole row; the names of k columns.
            problem: What is wrong, or that of row and column, counted from 0.
        """
        if bad.any():
            row, *k = np.argwhere(bad)[0].tolist()
            name = columns if isinstance(columns, str) else columns[k[0]]
            raise self.error(row, name, problem if isinstance(problem, str) else problem(row, *k))

    def texts(self, k: int) -> list[str]:
        """The cells of a column without blanks around them, nor what keeps spreadsheets from computing."""
        own = self.cells[k].dictionary_encode("encode")
        words = [from_cell(shown(str(word))) for word in own.dictionary.to_pylist()]
        return [words[place] for place in own.indices.to_numpy().tolist()]

    def blank(self, k: int) -> Mask:
        """Which cells of a column are blank, (rows,)."""
        if not pa.types.is_string(self.cells[k].type):
            return np.asarray(pc.is_null(self.cells[k]).to_numpy(zero_copy_only=False))
        return np.asarray(pc.equal(self.cells[k], "").to_numpy(zero_copy_only=False))

    def counts(self, k: int) -> bool:
        """Whether all of a column were read as integers."""
        return bool(pa.types.is_integer(self.cells[k].type))

    def take(self, rows: Mask | Ids) -> "Table":
        """Rows under a mask, or by their places, in any order."""
        places = np.arange(self.rows)[rows]
        return replace(self, lines=self.lines[rows], cells=[cells.take(places) for cells in self.cells])

    def beside(self, other: "Table", rows: Ids) -> "Table":
        """With those columns of another table that it has not, in these rows; decimal commas are points."""
        own = {squeeze(name) for name in self.names}
        kept = [k for k, name in enumerate(other.names) if squeeze(name) not in own]
        return replace(
            self,
            names=(*self.names, *(other.names[k] for k in kept)),
            units=(*self.units, *(other.units[k] for k in kept)),
            cells=[*map(_pointed, self.cells), *(_pointed(other.cells[k].take(rows)) for k in kept)],
            notes=(*self.notes, *(f"{other.path.name}: {note}" for note in other.notes)),
        )

    def with_numbers(self, k: int, values: Array) -> "Table":
        """With other numbers in a column, (rows,); blank where NaN."""
        cells = list(self.cells)
        cells[k] = pa.array(values, pa.float64())
        return replace(self, cells=cells)

    def filled(self, columns: Sequence[int]) -> "Table":
        """Blank cells of some columns take the value above, as below merged cells."""
        cells = list(self.cells)
        for k in columns:
            own = np.where(self.blank(k), 0, np.arange(self.rows))
            cells[k] = cells[k].take(pa.array(np.maximum.accumulate(own)))
        return replace(self, cells=cells)

    def with_parts(
        self, k: int, parts: Sequence[str], wholes: Sequence[re.Pattern[str]], expected: str
    ) -> "Table":
        """With a column more for every part of the combined cells of a column, blank where there is none.

        Raises:
            InputError: At the first cell that no pattern fits.
        """
        split: dict[str, dict[str, str]] = {"": {}}
        for row, text in enumerate(self.texts(k)):
            if text not in split:
                found = next((m for whole in wholes if (m := whole.fullmatch(text))), None)
                if found is None:
                    problem = f"expected {expected} as the map says, got {text[:80]!r}"
                    raise self.error(row, self.names[k], problem)
                split[text] = {part: value.strip() for part, value in found.groupdict().items()}
        cells = [[split[text].get(part, "") for text in self.texts(k)] for part in parts]
        return replace(
            self,
            names=(*self.names, *(f"{self.names[k]}, {part}" for part in parts)),
            units=(*self.units, *[None] * len(parts)),
            cells=[*self.cells, *(pa.array(own, pa.string()) for own in cells)],
        )

    def worded(self, columns: Sequence[int], words: Mapping[str, str]) -> "Table":
        """Cells of some columns that hold one of the words hold what it stands for."""
        cells = list(self.cells)
        for k in columns:
            for word, meant in words.items():
                cells[k] = pc.if_else(pc.equal(cells[k], word), meant, cells[k])
        return replace(self, cells=cells)

    def integers(self, k: int) -> Ids:
        """A column of integers of 64 bits, (rows,); InputError names the first cell that holds none."""
        if self.counts(k):
            return np.asarray(self.cells[k].to_numpy())
        texts = self.texts(k)
        found = {text: int(text) for text in dict.fromkeys(texts) if is_integer(text)}
        bad = np.array([text not in found for text in texts], dtype=bool)
        self.refuse(
            bad, self.names[k], lambda row: f"expected an integer of 64 bits, got {texts[row][:80]!r}"
        )
        return np.array([found[text] for text in texts], dtype=int)

    def mark(self, columns: Sequence[int]) -> str:
        """The decimal mark: what the map says, or what most numbers with one of these columns have."""
        if self.decimal:
            return self.decimal
        count = {",": 0, ".": 0}
        for k in columns:
            comma = pc.match_substring_regex(self.cells[k], f"{COMMA}|{GROUPED[',']}")
            count[","] += pc.sum(comma).as_py() or 0
            count["."] += pc.sum(pc.and_not(pc.match_substring(self.cells[k], "."), comma)).as_py() or 0
        return max(count, key=lambda mark: (count[mark], mark))

    def numbers(self, k: int, mark: str = ".", words: str = "") -> Array:
        """A column of finite numbers, (rows,); NaN where a cell is blank.

        Args:
            k: The column.
            mark: The decimal mark.
            words: What an error adds about cells that are no number in another way of writing.

        Raises:
            InputError: At the first cell that holds something else.
        """
        plain = self.cells[k]
        if pa.types.is_floating(plain.type):
            return np.asarray(plain.to_numpy(zero_copy_only=False))
        grouped = pc.match_substring_regex(plain, GROUPED[mark])
        if pc.any(grouped).as_py():
            whole = pc.replace_substring_regex(plain, rf"[^0-9{mark}+-]", "")
            plain = pc.if_else(grouped, whole, plain)
        if mark == ",":
            swapped = pc.replace_substring(plain, ".", "_")  # 1.234 is no number there
            plain = pc.replace_substring(swapped, ",", ".")
        blank = self.blank(k)
        sound = pc.match_substring_regex(plain, NUMBER)
        values = pc.cast(pc.if_else(sound, plain, "nan"), pa.float64()).to_numpy(zero_copy_only=False)
        bad = np.flatnonzero(~np.isfinite(values) & ~blank)
        if len(bad):
            text = self.texts(k)[bad[0]]
            marked = len(text) > 1 and text.strip("+-.,' 0123456789") == ""
            hint = f"the decimal mark here is {mark!r}; thousands are divided before one only"
            hint = f"; {hint}" if marked else words
            raise self.error(bad[0], self.names[k], f"expected a finite number, got {text[:80]!r}{hint}")
        return np.asarray(values)


def read_table(path: Path, known: Callable[[str], bool], layout: Layout | None = None) -> Table:
    """The table of a text file: its header is found by the names that are known.

    Args:
        path: The file.
        known: Whether a name is that of a column that is looked for.
        layout: What a map says of the file.

    Raises:
        InputError: When it cannot be read, is empty, or is no table.
    """
    layout = layout or Layout()
    text, how = read_letters(path, layout.encoding, layout.decimal or ".")
    if how.startswith(SHEET):
        layout = layout.model_copy(update={"delimiter": "\t" if "\t" in text else None})
    return table_of(path, (text, how), known, layout)


def table_of(path: Path, letters: tuple[str, str], known: Callable[[str], bool], layout: Layout) -> Table:
    """The same of a text and its encoding."""
    text, encoding = letters
    header = find_header(path, split_lines(path, text), layout, known)
    return Table(
        path=path,
        names=header.names,
        units=header.units,
        header=header.line,
        delimiter=header.delimiter,
        lines=np.array([line.number for line in header.body], dtype=int),
        notes=_notes(encoding, header),
        decimal=layout.decimal,
        cells=_parse(path, header),
    )


def _notes(encoding: str, header: Header) -> tuple[str, ...]:
    """How a file was read, in words."""
    between = {"\t": "tabs", " ": "runs of blanks", "  ": "runs of two or more blanks"}.get(
        header.delimiter, f"{header.delimiter!r}"
    )
    where = f"header in line {header.line}" if header.line else "the map names the columns"
    how = encoding if encoding.startswith(SHEET) else f"text in {encoding}"
    found = [f"{how}, {between} between the cells, {where}"]
    counts = {"before the header": header.skipped, "of comments or the header again": header.left_out}
    found += [f"{count} line{'s'[: count > 1]} {what} left out" for what, count in counts.items() if count]
    return (*found, *["the line below the header holds units"] * any(header.units))


TOGETHER = 20_000  #: Cells that are told apart at a time: each takes many times its letters.
NUMBER_CELL, ID_CELL, WORD_CELL = pa.float64(), pa.int64(), pa.string()
"""What plain cells of a column hold: a finite number or nothing, an integer, anything."""


def release() -> None:
    """Give memory of tables that are gone back to the system."""
    pa.default_memory_pool().release_unused()


def read_numbers(
    table: Table, content: bytes, number: int, kinds: Mapping[int, "pa.DataType"]
) -> Table | None:
    """More rows of a table, told apart by one byte, their columns read at once; no others are looked at.

    Args:
        table: The rows before.
        content: Whole lines.
        number: How many lines there are in the file before them.
        kinds: The columns that are read, and what their cells hold.

    Returns:
        None for anything that has to be looked at line by line: comments, quotes, blank lines, cells that are
        none of this.
    """
    if len(table.delimiter.encode()) > 1 or table.delimiter == " " or not content.isascii():
        return None
    if any(mark in content for mark in (b'"', b"#", b"//", b"\r", b"\0")):
        return None
    names = [str(k) for k in range(len(table.names))]
    try:
        read = csv.read_csv(
            pa.BufferReader(content),
            csv.ReadOptions(block_size=len(content) + 1, column_names=names),
            csv.ParseOptions(delimiter=table.delimiter, quote_char=False, ignore_empty_lines=False),
            csv.ConvertOptions(
                column_types={names[k]: kind for k, kind in kinds.items()},
                include_columns=[names[k] for k in kinds],
                null_values=[""],
                decimal_point=table.decimal or ".",
            ),
        )
    except pa.ArrowInvalid:
        return None
    rows = content.count(b"\n") + (not content.endswith(b"\n"))
    cells = [pa.nulls(rows)] * len(names)
    for k, kind in kinds.items():
        own = cells[k] = read[names[k]].combine_chunks()  # one at a time: they are large
        if kind is WORD_CELL:
            cells[k] = pc.utf8_trim_whitespace(own)
        endless = kind is NUMBER_CELL and pc.all(pc.is_finite(own)).as_py() is False
        if len(own) != rows or endless or (kind is ID_CELL and own.null_count):
            return None
    return replace(table, lines=number + 1 + np.arange(rows), cells=cells)


def _pointed(cells: "pa.Array") -> "pa.Array":
    """Decimal commas of a column of numbers as points."""
    plain = pc.match_substring_regex(cells, rf"{COMMA}|^[+-]?[0-9]*$")
    return pc.replace_substring(cells, ",", ".") if pc.all(plain).as_py() else cells


def _parse(path: Path, header: Header) -> list["pa.Array"]:
    """Cells without blanks around them, a column each."""
    count, lines = len(header.names), header.body
    step = 1 + TOGETHER // (1 + count)
    parts = (lines[k : k + step] for k in range(0, len(lines) or 1, step))
    rows = (pa.array([row_of(path, header, line) for line in part], pa.string()) for part in parts)
    cut = (pc.utf8_trim_whitespace(pc.split_pattern(part, "\n").flatten()) for part in rows)
    cells, begins = pa.concat_arrays(cut), count * np.arange(len(lines))
    return [cells.take(k + begins) for k in range(count)]
