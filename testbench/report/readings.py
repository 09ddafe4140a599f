"""The report of a file of readings: which column is which quantity, what was understood, and doubts."""

import re
from collections.abc import Iterator, Sequence

from testbench.identify.registered import RegisteredDataset
from testbench.report.columns import columns
from testbench.report.markdown import Markdown, capital, ended
from testbench.report.report import Report, bullets, say
from testbench.report.schema import NUMBER, Table, plain, show, written_out
from testbench.report.table import Row
from testbench.workflows.file_contents import farthest_off
from testbench.workflows.read_runs import registration_notes
from testbench.workflows.rows import UM

MAX_LISTED = 6  #: Loads and names that are listed.
COLUMNS = columns("quantity file_columns unit values rows")


def written(row: Row) -> str:
    """Write the values of a column for people: lengths below 1 mm in um."""

    def length(number: re.Match[str]) -> str:
        metres = float(number[0])
        return f"{UM * metres:g} um" if 0 < abs(metres) < 1e-3 else plain(number[0])

    return NUMBER.sub(length, str(row["values"])) if row.unit == "m" else written_out(str(row["values"]))


def column_lines(rows: Sequence[Row]) -> list[str]:
    """Lay out columns of a file below one another, of any width."""
    table = [
        [column.heading for column in COLUMNS],
        *([row[column.key] for column in COLUMNS] for row in rows),
    ]
    widths = [2 + max(map(len, cells)) for cells in zip(*table, strict=True)]
    return ["".join(map(str.ljust, cells, widths)).rstrip() for cells in table]


def file_lines(f: Row, more: Sequence[str] = ()) -> list[str]:
    """List columns, numbers and notes of the file, for a terminal.

    Args:
        f: Numbers of the file.
        more: Other notes.

    Returns:
        Lines.
    """
    notes = [f"- {note}" for note in (*f.notes, *more)]
    return ["", *column_lines(f.columns), "", *(f"{what}: {value}" for what, value in _others(f)), *notes]


def _others(f: Row) -> Iterator[tuple[str, str]]:
    """Numbers of the file and its runs, with their units."""

    def few(names: Sequence[str], mark: str = ", ") -> str:
        more = f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else ""
        return (mark.join(names[:MAX_LISTED]) or "none") + more

    yield "rows, runs, poses, stations", f"{f.rows}, {f.runs}, {f.poses}, {f.stations}"
    yield "markers", f"{len(f.markers)}: {few(f.markers)}"
    yield "lost targets", f"{len(f.lost)} of {f.targets}: {few(f.lost)}"
    if f.without:
        yield "markers without an instrument", few(f.without)
    yield "loads", few(f.loads, "; ")
    yield "sigma of a reading, um", show(f.sigma_um, "g")
    yield "columns not read", few(f.ignored)
    if f.farthest:
        yield "largest deflection, mm", f"{f.deflection_mm.most:.3f}, {f.farthest}"
    if f.get("away"):
        away = f"{f.away.distance_mm:.3f}, {f.away.target}"
        yield "largest distance of an unloaded reading from the undeflected arm, mm", away
    if f.get("scale") is not None:
        yield "measured deflections over those predicted by the arm's folder", f"{f.scale:.2f}"


def report(found: Row, registered: RegisteredDataset) -> Report:
    """Report a file of measured runs.

    Args:
        found: What is in it, with its `dataset`, `doubts` and `scale`.
        registered: The runs in the base's frame.

    Returns:
        The report.
    """
    f = Row(found, arm=registered.vjm.arm.name, frame=registered.frame, away=farthest_off(registered))
    others = [Row(what=what, value=value) for what, value in _others(f)]
    tables = {"columns": Table(COLUMNS, f.columns, "Which column is which quantity")}
    tables["numbers"] = Table(columns("what value"), others, "The runs")
    notes = [ended(capital(note)) for note in (*f.notes, *registration_notes(registered))]
    return Report(
        scenario="data_check",
        question=say("What was understood of {dataset}?", f),
        title=say("{dataset} as runs of {arm}", f),
        answer=say(
            "{runs:counted run} in {poses:counted pose}: targets move {deflection_mm.least:.3f} to "
            "{deflection_mm.most:.3f} mm, median {deflection_mm.median:.3f} mm. Doubts: {count}.",
            f,
            count=len(f.doubts),
        ),
        claims=[say("**Doubt**: {text}", text=ended(text)) for text in f.doubts],
        numbers=f,
        tables=tables,
        body=[*tables, Markdown("## How the runs were read"), bullets(notes)],
    )
