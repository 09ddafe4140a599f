"""Robot logs: a table, or a program in a known language whose joint targets become its rows."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from testbench.arm.document import is_decimal
from testbench.errors import InputError
from testbench.files.layouts import Program, known_layouts
from testbench.files.mapping import FileLayout
from testbench.files.table import TableCells, read_table, table_of
from testbench.files.text import read_letters
from testbench.files.workbook import SHEET

OTHERS = r"/JOB\b|//INST\b|MAIN\s*\(\)|\.PROGRAM\b"
"""Lines of programs of Yaskawa and others."""
NAMED = re.compile(r"\b([AEJ]\d+)\s*=?\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)(?![\w.])")
"""An axis and its number."""
ROBOT = tuple(f"A{k}" for k in range(1, 7))
"""Axes of a robot."""
OUTER = {f"E{k}": f"A{k + 6}" for k in range(1, 7)}
"""External axes, renumbered from A7 on."""
NO_AXIS = 9e8
"""Least value that RAPID writes, 9E9, for a missing external axis."""
ASKED = "save a table with a row for every pose: its name or time, and a column for every joint"


def read_log(path: Path, known: Callable[[str], bool], layout: FileLayout | None = None) -> TableCells:
    """Read a robot's log: a table, or a program whose joint targets become rows.

    The columns of a program are the names of its targets, axes A1 to A6, and external axes from A7 on.

    Args:
        path: The file: a table, or a program in a language of the layouts.
        known: Tells whether a name is that of a wanted column.
        layout: How the table is written, if that cannot be found from it.

    Returns:
        The table.

    Raises:
        InputError: If the file cannot be read, is no table, or is a program without joint targets.
    """
    text, how = read_letters(path, None, ".")
    if not how.startswith(SHEET):
        programs = [own for own in known_layouts().values() if own.program]
        for export_layout in programs:
            if _has(export_layout.fits.text or "", text) and export_layout.program:
                return _read_targets(path, text, export_layout.title, export_layout.program)
        if _has(OTHERS, text):
            titles = ", ".join(own.title for own in programs)
            problem = f"expected a table, or one of {titles}, got a program in another language; {ASKED}"
            raise InputError(path, "", problem)
    return read_table(path, known, layout)


def _has(begins: str, text: str) -> bool:
    return re.search(rf"^[ \t]*({begins})", text, re.MULTILINE | re.IGNORECASE) is not None


def _read_targets(path: Path, text: str, title: str, language: Program) -> TableCells:
    """Read the joint targets of a program: those with a name, else those of its moves in order."""
    code = "\n".join(line.split(language.comment)[0] for line in text.splitlines())
    found = [(m, _axes(m["axes"])) for m in re.finditer(language.target, code, re.IGNORECASE)]
    found = [(m, axes) for m, axes in found if {*ROBOT} <= axes.keys()]
    found = [(m, axes) for m, axes in found if m["name"]] or found
    if not found:
        raise InputError(path, "", f"expected joints in this {title}, got no joint target; {ASKED}")
    names = [m["name"] or "" for m, _ in found]
    if language.drop and all(name.casefold().startswith(language.drop.casefold()) for name in names):
        names = [name[len(language.drop) :] for name in names]
    names = [name and f"{language.begin}{name}" for name in names]
    beside = sorted(
        {axis for _, axes in found for axis, x in axes.items() if 0 < abs(float(x)) < NO_AXIS} - {*ROBOT}
    )
    header = [*["name"] * any(names), *(f"{axis} [{language.unit}]" for axis in ROBOT), *beside]
    rows = [
        [*[name] * any(names), *(axes.get(axis, "") for axis in (*ROBOT, *beside))]
        for name, (_, axes) in zip(names, found, strict=True)
    ]
    content = "\n".join("\t".join(row) for row in [header, *rows])
    table = table_of(path, (content, "utf-8"), bool, FileLayout(skip=0, delimiter="\t", decimal="."))
    lines = np.array([code.count("\n", 0, m.start("axes")) + 1 for m, _ in found])
    return replace(table, lines=lines, notes=(f"{len(rows)} joint targets of a {title}",))


def _axes(text: str) -> dict[str, str]:
    """Parse the numbers of a target by axis: A1 to A6 of the robot, external ones from A7 on."""
    if "[" in text:
        own = [part.split(",") for part in re.findall(r"\[([^\]]*)\]", text)]
        pairs = [[f"{'AE'[row]}{k}", x] for row, part in enumerate(own) for k, x in enumerate(part, start=1)]
    else:
        pairs = [[axis.upper().replace("J", "A"), x] for axis, x in NAMED.findall(text)]
    named: dict[str, str] = {}
    for axis, number in pairs:
        if is_decimal(number.strip()):
            named.setdefault(OUTER.get(axis, axis), number.strip())
    return named
