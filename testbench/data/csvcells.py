"""CSV files cell by cell: lines of one length, finite numbers, whole files or none."""

import contextlib
import csv
import io
import math
from pathlib import Path

import numpy as np

from testbench.errors import InputError, read_text

MAX_BYTES = 300_000_000


def read_lines(path: Path) -> tuple[list[str], list[list[str]]]:
    """Header and rows of a CSV file, all rows as long as the header.

    Raises:
        InputError: When it cannot be read, is empty or no table.
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
    for number, line in enumerate(lines[1:], start=2):
        if len(line) != len(lines[0]):
            raise InputError(path, f"line {number}", f"expected {len(lines[0])} fields, got {len(line)}")
    return lines[0], lines[1:]


def number(path: Path, line: int, name: str, text: str) -> float:
    """The number in a cell.

    Raises:
        InputError: When it is none, or not finite; names line and column.
    """
    try:
        value = math.nan if "_" in text else float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        problem = f"expected a finite number, got {text[:80]!r}"
        raise InputError(path, f"line {line}, column {name}", problem)
    return value


def integer(path: Path, line: int, name: str, text: str) -> int:
    """The integer in a cell.

    Raises:
        InputError: When it is none of 64 bits; names line and column.
    """
    try:
        if "_" in text:  # Python reads 1_0 as 10
            raise ValueError
        return int(np.int64(int(text)))
    except (ValueError, OverflowError):
        problem = f"expected an integer of 64 bits, got {text[:80]!r}"
        raise InputError(path, f"line {line}, column {name}", problem) from None


def write_whole(text: str, path: Path) -> None:
    """Write a text file; an existing one is replaced only by a whole one.

    Raises:
        InputError: When the file cannot be written.
    """
    part = path.with_name(path.name + ".part")
    try:
        part.write_bytes(text.encode())
        part.replace(path)
    except OSError as err:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        raise InputError(path, "", f"cannot be written: {err.strerror}") from err
