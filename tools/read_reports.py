"""Reports as they were, read from report.json with their words and tables; numbers as rows."""

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from testbench.report.badge import Badge
from testbench.report.colours import Look
from testbench.report.markdown import Markdown
from testbench.report.report import PARTS, Report
from testbench.report.schema import Table, TableColumn
from testbench.report.table import Row, rows
from testbench.runs.manifest import read_plain
from testbench.runs.rows import nested

OWN = ("scenario", "badge", "said", "tables")  #: Keys of report.json that are no numbers.


def read_report(file: Path) -> Report:
    """Read a report; InputError where its file cannot be read."""
    return read(read_plain(file))  # type: ignore[arg-type]  # what is no table of keys raises


def read(found: Mapping[str, Any]) -> Report:
    """Read a report from what is in report.json."""
    said = found["said"]
    return Report(
        scenario=str(found["scenario"]),
        **{name: Markdown(said[name]) for name in PARTS},
        claims=[Markdown(claim) for claim in said["claims"]],
        body=[Markdown(part) if isinstance(part, str) else str(part["table"]) for part in said["body"]],
        numbers=rows({key: own for key, own in found.items() if key not in OWN}),
        badge=_badge(found["badge"]),
        tables={name: _table(own) for name, own in found["tables"].items()},
    )


def _badge(found: Any) -> Badge | None:
    """Who wins."""
    if found is None:
        return None
    lists = {"interval": found["interval"] and tuple(found["interval"]), "ties": tuple(found["ties"])}
    return Badge(**{own.name: found[own.name] for own in fields(Badge)} | lists)


def _table(found: Mapping[str, Any]) -> Table:
    """A table of its data; the paper's numbers are by place."""
    keys = [str(key) for key in found["keys"]]
    columns = [
        TableColumn(**own, key=key, paper=f"{k}")
        for k, (key, own) in enumerate(zip(keys, found["columns"], strict=True))
    ]
    cells = [
        Row(nested(dict(zip(keys, rows(own), strict=True))), paper={f"{k}": x for k, x in enumerate(paper)})
        for own, paper in zip(found["rows"], found["paper"], strict=True)
    ]
    return Table(
        tuple(columns),
        cells,
        title=str(found.get("title", "")),
        bold=str(found.get("bold", "")),
        headline=str(found.get("headline", "")),
        across=str(found.get("across", "")),
        looks={
            name: Look(tuple(own["colour"]), own["place"], own["prior"])
            for name, own in found["looks"].items()
        },
    )
