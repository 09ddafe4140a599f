"""Parts of hand-written pages that are numbers: each stands between a mark and `<!-- end -->`.

`<!-- from STUDY: PART; PART -->`: of the report of a full run, tables by name or blocks of its template, such
as title and answer. `<!-- bench -->`: the rows of bench.json. `<!-- times -->`: how long the full runs took.
A part whose run is not there stays as it was.
"""

import importlib
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from testbench.errors import InputError
from testbench.report.report import LISTS, PARTS, Report, read_report
from testbench.views.markdown import grid, lines

FROM = re.compile(r"(<!-- from (\w+): ([^>]*?) -->\n)(.*?)(<!-- end -->)", re.DOTALL)
PLAIN = re.compile(r"(<!-- (bench|times) -->\n)(.*?)(<!-- end -->)", re.DOTALL)


def fill(page: Path, runs: Path, bench: Path) -> bool:
    """Write the parts of a page whose runs are there; whether it has any.

    Args:
        page: Markdown.
        runs: Folder with one folder a study.
        bench: bench.json.

    Raises:
        InputError: When a mark names a study or part that there is not, or a report is of another version.
    """
    text = page.read_text(encoding="utf-8")
    found = FROM.sub(lambda mark: _from(page, runs, mark), text)
    tables: dict[str, Callable[[], str]] = {"bench": lambda: bars(bench), "times": lambda: times(runs)}
    found = PLAIN.sub(lambda mark: _put(mark[1], tables[mark[2]](), mark[3], mark[4]), found)
    if found != text:
        page.write_text(found, encoding="utf-8")
    return bool(FROM.search(text) or PLAIN.search(text))


def _put(mark: str, new: str, old: str, end: str) -> str:
    return f"{mark}{new}\n\n{end}" if new else f"{mark}{old}{end}"


def _from(page: Path, runs: Path, mark: re.Match[str]) -> str:
    name = mark[2]
    try:
        importlib.import_module(f"testbench.studies.{name}.study")
    except ImportError as err:
        raise InputError(page, mark[1].strip(), f"no study {name!r}") from err
    if not (runs / name / "report.json").is_file():
        return mark[0]
    report = read_report(runs / name / "report.json")
    parts = [_part(page, report, part.strip()) for part in mark[3].split(";")]
    return _put(mark[1], "\n\n".join(parts), mark[4], mark[5])


def _part(page: Path, report: Report, name: str) -> str:
    if name in report.tables:
        return grid(report.tables[name])
    if name in (*PARTS, *LISTS) and report.block(name):
        return report.block(name)
    raise InputError(page, name, f"no such block, and no such table; tables are {', '.join(report.tables)}")


def bars(file: Path) -> str:
    """What `make bench` measured where there is a bar to hold; empty where it did not run."""
    if not file.is_file():
        return ""
    record = json.loads(file.read_text(encoding="utf-8"))
    held = [row for row in record["results"] if row["bar"] is not None]
    rows = [[row["benchmark"], f"{row['value']:.3g} {row['unit']}", _bar(row)] for row in held]
    table, processor = lines(["what", "measured", "bar"], rows), record["machine"]["processor"]
    return f"{table}\n\nMedians of one run on one thread of {processor}."


def _bar(row: dict[str, Any]) -> str:
    return f"{'at least' if row['at_least'] else 'at most'} {row['bar']:g}"


def times(runs: Path) -> str:
    """How long each study took, by its manifest; empty where none ran."""
    manifests = [
        json.loads(file.read_text(encoding="utf-8")) for file in sorted(runs.glob("*/manifest.json"))
    ]
    rows = [
        [Path(own["command"]).stem.replace("_", " "), str(own["seeds"]), f"{own['seconds']:.0f} s"]
        for own in manifests
        if "seconds" in own
    ]
    return lines(["study", "seeds", "full run"], rows) if rows else ""
