"""A corrected program as CSV: the columns of the program that was read, other joints, and what was found."""

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from testbench.data.cells import as_cell
from testbench.data.program import Program
from testbench.errors import Array, BenchError, InputError, check_array
from testbench.output.whole import write_whole


def write_program(
    path: str | Path, program: Program, q: Array, more: Mapping[str, Array | Sequence[str]] | None = None
) -> None:
    """Write a program with other joints; an existing file is replaced only by a whole one.

    Columns, their order and units are those of the file that was read. Joints that it lacks follow, in deg
    and mm, then what the caller adds. Numbers are written in full.

    Args:
        path: The file.
        program: As it was read.
        q: The joints instead, (points, n) [rad, m].
        more: Further columns by their names, numbers or words, (points,) each; NaN is a blank cell.

    Raises:
        BenchError: When joints or columns are not one a point.
        InputError: When the program has a column of that name, or the file cannot be written.
    """
    write_whole(program_text(program, q, more), Path(path))


def program_text(program: Program, q: Array, more: Mapping[str, Array | Sequence[str]] | None = None) -> str:
    """The same as text."""
    table, mark, arm = program.table, program.mark, program.arm
    q, more = check_array(q, (program.points, arm.n_joints), "q [rad, m]"), more or {}
    names = list(table.names)
    columns = [list(map(as_cell, table.texts(k))) for k in range(len(names))]
    units = [unit.name if unit else "" for unit in table.units]
    for joint, column, own in zip(arm.joints, program.joints, q.T, strict=True):
        if column is None:
            names.append(joint.shown_column)
            columns.append(_cells(joint.shown * own, mark))
        else:
            scale = column.unit.scale if column.unit else 1.0
            columns[column.index] = _cells(own / (column.sign * scale), mark)
    for name, values in more.items():
        if name in names:
            problem = f"there is a column {name!r} already; was the program corrected before?"
            raise InputError(program.path, f"line {table.header}", problem)
        if len(values) != program.points:
            raise BenchError(f"{name}: expected {program.points} cells, got {len(values)}")
        names.append(name)
        columns.append(_cells(values, mark) if isinstance(values, np.ndarray) else list(map(as_cell, values)))
    text = io.StringIO()
    writer = csv.writer(text, delimiter=";" if mark == "," else ",", lineterminator="\n")
    writer.writerow(map(as_cell, names))
    if any(units):
        writer.writerow(units + [""] * (len(names) - len(units)))
    writer.writerows(zip(*columns, strict=True))
    return text.getvalue()


def _cells(values: Array, mark: str) -> list[str]:
    """Numbers in full with a decimal mark; blank for NaN."""
    texts = ["" if value != value else repr(value) for value in values.tolist()]
    return texts if mark == "." else [text.replace(".", mark) for text in texts]
