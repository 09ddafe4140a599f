"""Robot logs: a table, or a program in a known language whose joint targets become its rows."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from testbench.errors import InputError
from testbench.files.languages import FLAGS, Language, known_languages
from testbench.files.mapping import FileLayout
from testbench.files.motion_read import PointText, Source, read_points
from testbench.files.table import TableCells, read_table, table_of
from testbench.files.text import read_letters
from testbench.files.workbook import SHEET

OTHERS = r"MAIN\s*\(\)|\.PROGRAM\b"
"""Lines of programs of Kawasaki and others."""
ROBOT = 6
"""Axes of a robot."""
ASKED = "save a table with a row for every pose: its name or time, and a column for every joint"


def read_log(path: Path, known: Callable[[str], bool], layout: FileLayout | None = None) -> TableCells:
    """Read a robot's log: a table, or a program whose joint targets become rows.

    The columns of a program are the names of its targets, axes A1 to A6, and external axes from A7 on.

    Args:
        path: The file: a table, or a program in a known robot language.
        known: Tells whether a name is that of a wanted column.
        layout: How the table is written, if that cannot be found from it.

    Returns:
        The table.

    Raises:
        InputError: If the file cannot be read, is no table, or is a program without joint targets.
    """
    text, how = read_letters(path, None, ".")
    if not how.startswith(SHEET):
        languages = known_languages().values()
        for language in languages:
            if _has(language.text, text):
                return _read_targets(path, language)
        if _has(OTHERS, text):
            titles = ", ".join(f"{own.title} program" for own in languages)
            problem = f"expected a table, or one of {titles}, got a program in another language; {ASKED}"
            raise InputError(path, "", problem)
    return read_table(path, known, layout)


def _has(begins: str, text: str) -> bool:
    return re.search(rf"^[ \t]*({begins})", text, FLAGS) is not None


def _read_targets(path: Path, language: Language) -> TableCells:
    """Read the joint targets of a program: those with a name, else all in their order."""
    program, main = read_points(path, language), language.axes[:ROBOT]
    source = program.sources[0]
    found = [
        point
        for point in program.points
        if not point.source and not point.posed and {*main} <= point.numbers.keys()
        if not language.pulses or point.mode != language.pulses
    ]
    found = [point for point in found if point.name] or found
    if not found:
        raise InputError(
            path, "", f"expected joints in this {language.title} program, got no joint target; {ASKED}"
        )
    names = [point.name for point in found]
    if language.drop and all(name.casefold().startswith(language.drop.casefold()) for name in names):
        names = [name[len(language.drop) :] for name in names]
    names = [name and f"{language.begin}{name}" for name in names]
    outer = {axis: f"A{ROBOT + k}" for k, axis in enumerate(language.external, start=1)}
    beside = [
        axis
        for axis in outer
        if any(
            axis in point.numbers and 0 < abs(point.numbers[axis].value) < language.no_axis for point in found
        )
    ]
    units = [f"A{k} [{language.angle}]" for k in range(1, ROBOT + 1)]
    header = [*["name"] * any(names), *units, *(outer[axis] for axis in beside)]
    rows = [
        [*[name] * any(names), *(_text(source, point, axis) for axis in (*main, *beside))]
        for name, point in zip(names, found, strict=True)
    ]
    content = "\n".join("\t".join(row) for row in [header, *rows])
    table = table_of(path, (content, "utf-8"), bool, FileLayout(skip=0, delimiter="\t", decimal="."))
    lines = np.array([source.line(point.numbers[main[0]].start) for point in found])
    return replace(table, lines=lines, notes=(f"{len(rows)} joint targets of a {language.title} program",))


def _text(source: Source, point: PointText, axis: str) -> str:
    """The number of an axis as it is written; "" where the point has none."""
    number = point.numbers.get(axis)
    return source.text[number.start : number.end] if number else ""
