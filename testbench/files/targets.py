"""Robot logs: a table, or a program in RAPID, KRL or URScript whose joint targets become rows."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from testbench.arm.decimal import is_decimal
from testbench.errors import InputError
from testbench.files.mapping import Layout
from testbench.files.table import Table, read_table, table_of
from testbench.files.text import read_letters
from testbench.files.workbook import SHEET

NUMBERS = r"[-+\d.eE,\s]*"
"""Numbers between two brackets."""


class Language(NamedTuple):
    """Describe how a robot language writes joint targets."""

    title: str  #: Name in messages.
    comment: str  #: Beginning of a comment.
    unit: str  #: Unit of the robot's axes.
    begins: str  #: Regular expression of a line that only its programs have.
    target: str  #: Regular expression of joints, with the groups name, blank for a move, and axes.


LANGUAGES = (
    Language(
        "RAPID",
        "!",
        "deg",
        r"MODULE\s+\w|(LOCAL\s+|TASK\s+)?(CONST|PERS|VAR)\s+(joint|rob)target\s|MoveAbsJ\s",
        rf"(?:jointtarget\s+(?P<name>\w+)\s*:=\s*)?\[\s*(?P<axes>\[{NUMBERS}\]\s*,\s*\[{NUMBERS}\])\s*\]",
    ),
    Language(
        "KRL",
        ";",
        "deg",
        r"&ACCESS|DEFDAT\s|DEF\s+\w+\s*\([^)]*\)\s*$|(DECL\s+)?(GLOBAL\s+)?(E6)?(AXIS|POS)\s+\w+\s*=|PTP\s*\{",
        r"(?:(?P<name>\w+)\s*=\s*)?\{(?:\s*(?:E6)?AXIS\s*:)?\s*(?P<axes>[^{}]*\bA1\s[^{}]*)\}",
    ),
    Language(
        "URScript",
        "#",
        "rad",
        r"def\s+\w+\(.*\)\s*:|movej\s*\(",
        rf"(?:(?P<name>\w+)\s*=\s*|movej\s*\(\s*)(?P<axes>\[{NUMBERS}\])",
    ),
)
OTHERS = r"/PROG\b|/JOB\b|//INST\b|MAIN\s*\(\)|\.PROGRAM\b"
"""Lines of programs of FANUC, Yaskawa and others."""
ROBOT = tuple(f"A{k}" for k in range(1, 7))
"""Axes of a robot."""
OUTER = {f"E{k}": f"A{k + 6}" for k in range(1, 7)}
"""External axes, renumbered from A7 on."""
NO_AXIS = 9e8
"""Least value that RAPID writes, 9E9, for a missing external axis."""
ASKED = "save a table with a row for every pose: its name or time, and a column for every joint"


def read_log(path: Path, known: Callable[[str], bool]) -> Table:
    """Read a robot's log: a table, or a program whose joint targets become rows.

    The columns of a program are the names of its targets, axes A1 to A6, and external axes from A7 on.

    Args:
        path: The file.
        known: Tells whether a name is that of a wanted column.

    Returns:
        The table.

    Raises:
        InputError: If the file cannot be read, is no table, or is a program without joint targets.
    """
    text, how = read_letters(path, None, ".")
    if not how.startswith(SHEET):
        for language in LANGUAGES:
            if _has(language.begins, text):
                return _read_targets(path, text, language)
        if _has(OTHERS, text):
            titles = ", ".join(language.title for language in LANGUAGES)
            problem = f"expected a table, or a program in {titles}, got one in another language; {ASKED}"
            raise InputError(path, "", problem)
    return read_table(path, known)


def _has(begins: str, text: str) -> bool:
    return re.search(rf"^[ \t]*({begins})", text, re.MULTILINE | re.IGNORECASE) is not None


def _read_targets(path: Path, text: str, language: Language) -> Table:
    """Read the joint targets of a program: those with a name, else those of its moves in order."""
    code = "\n".join(line.split(language.comment)[0] for line in text.splitlines())
    found = [(m, _axes(m["axes"])) for m in re.finditer(language.target, code, re.IGNORECASE)]
    found = [(m, axes) for m, axes in found if {*ROBOT} <= axes.keys()]
    found = [(m, axes) for m, axes in found if m["name"]] or found
    if not found:
        problem = f"expected joints in this program in {language.title}, got no joint target; {ASKED}"
        raise InputError(path, "", problem)
    names = [m["name"] or "" for m, _ in found]
    if language.title == "KRL" and all(name[:1] in ("X", "x") for name in names):
        names = [name[1:] for name in names]  # an inline form keeps its point P1 as XP1
    beside = sorted(
        {axis for _, axes in found for axis, x in axes.items() if 0 < abs(float(x)) < NO_AXIS} - {*ROBOT}
    )
    header = [*["name"] * any(names), *(f"{axis} [{language.unit}]" for axis in ROBOT), *beside]
    rows = [
        [*[name] * any(names), *(axes.get(axis, "") for axis in (*ROBOT, *beside))]
        for name, (_, axes) in zip(names, found, strict=True)
    ]
    content = "\n".join("\t".join(row) for row in [header, *rows])
    table = table_of(path, (content, "utf-8"), bool, Layout(skip=0, delimiter="\t", decimal="."))
    lines = np.array([code.count("\n", 0, m.start("axes")) + 1 for m, _ in found])
    return replace(table, lines=lines, notes=(f"{len(rows)} joint targets of a program in {language.title}",))


def _axes(text: str) -> dict[str, str]:
    """Parse the numbers of a target by axis: A1 to A6 of the robot, external ones from A7 on."""
    if "[" in text:
        own = [part.split(",") for part in re.findall(r"\[([^\]]*)\]", text)]
        pairs = [[f"{'AE'[row]}{k}", x] for row, part in enumerate(own) for k, x in enumerate(part, start=1)]
    else:
        pairs = [pair for part in text.split(",") if len(pair := part.split()) == 2]
    named = {axis.upper(): number.strip() for axis, number in pairs if is_decimal(number.strip())}
    return {OUTER.get(axis, axis): number for axis, number in named.items()}
