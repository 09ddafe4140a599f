"""CSV tables: a header and rows of one length; a wrong cell is refused by line and column."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from testbench.data.dataset import Ids, Mask
from testbench.errors import Array, InputError, read_text

MAX_BYTES = 300_000_000


@dataclass(frozen=True)
class Table:
    """The cells of a CSV file."""

    path: Path  #: The file.
    columns: dict[str, Sequence[str]]  #: Cells by column, in the order of the header.
    rows: int  #: How many, without the header.

    def error(self, row: int, column: str, problem: str) -> InputError:
        """What is wrong in a row, counted from 0, and in which column; "" for the whole row."""
        return InputError(self.path, f"line {row + 2}" + (f", column {column}" if column else ""), problem)

    def integers(self, name: str) -> Ids:
        """A column of integers of 64 bits, (rows,); InputError names the first cell that holds none."""
        found = np.zeros(self.rows, dtype=int)
        for row, text in enumerate(self.columns[name]):
            try:
                found[row] = int(text if "_" not in text else "none")  # Python reads 1_0 as 10
            except (ValueError, OverflowError):
                problem = f"expected an integer of 64 bits, got {text[:80]!r}"
                raise self.error(row, name, problem) from None
        return found

    def numbers(self, names: Sequence[str], absent: Mask | None = None) -> Array:
        """Columns of finite numbers, (rows, names); rows under the mask `absent` are zero.

        Raises:
            InputError: At the first cell of a column that holds none.
        """
        found = np.zeros((self.rows, len(names)))
        for k, name in enumerate(names):
            texts = self.columns[name]
            found[:, k] = np.fromiter(map(_number, texts), float, self.rows)
            if absent is not None:
                found[absent, k] = 0
            bad = np.flatnonzero(~np.isfinite(found[:, k]))
            if len(bad):
                raise self.error(bad[0], name, f"expected a finite number, got {texts[bad[0]][:80]!r}")
        return found


def _number(text: str) -> float:
    try:
        return float(text) if "_" not in text else np.nan
    except ValueError:
        return np.nan


def read_table(path: Path) -> Table:
    """Header and rows of a CSV file, all rows as long as the header.

    Raises:
        InputError: When it cannot be read, is empty, is no table or has a column twice.
    """
    reader = csv.reader(io.StringIO(read_text(path, MAX_BYTES), newline=""), strict=True)
    try:
        lines = list(reader)
    except csv.Error as err:
        raise InputError(path, f"line {reader.line_num}", f"not CSV: {err}") from err
    while lines and not lines[-1]:  # blank lines at the end, as editors leave them
        lines.pop()
    if not lines:
        raise InputError(path, "line 1", "expected a header, the file is empty")
    header, *rows = lines
    for number, row in enumerate(rows, start=2):
        if len(row) != len(header):
            raise InputError(path, f"line {number}", f"expected {len(header)} fields, got {len(row)}")
    if twice := [name for k, name in enumerate(header) if name in header[:k]]:
        raise InputError(path, "line 1", f"expected every column once, got {twice} more than once")
    cells = zip(*rows, strict=True) if rows else [()] * len(header)
    return Table(path, dict(zip(header, cells, strict=True)), len(rows))
