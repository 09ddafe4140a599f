"""docs/paper.md from docs/paper.md.in and the report.json of every study: no number in it is typed by hand.

python tools/write_paper.py [RUNS] [--out FILE]
"""

import json
import re
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from testbench import command
from testbench.errors import InputError
from testbench.report import show, show_truth
from testbench.studies import six_dof_text, solvers_text
from testbench.tables import grid

ROOT = Path(__file__).resolve().parents[1]
TEMPLATE = ROOT / "docs" / "paper.md.in"
PLACE = re.compile(r"\{\{(.*?)\}\}")

app = typer.Typer(add_completion=False)


@app.command()
def main(
    runs: Annotated[Path, typer.Argument(help="Folder with one run of every study.")] = ROOT / "runs" / "paper",
    out: Annotated[Path, typer.Option(help="Markdown to write.")] = ROOT / "docs" / "paper.md",
) -> None:
    """Fill the template with the numbers of the reports."""
    text = TEMPLATE.read_text(encoding="utf-8")
    out.write_text(PLACE.sub(lambda match: fill(runs, match[1].strip()), text), encoding="utf-8")
    print(out)


def fill(runs: Path, place: str) -> str:
    """What stands at a place: `study path/to/number format`, or `table study`.

    A part of a path is a key, the name of a list's member, or its number from 0. A format of `%` shows a share,
    `?` a truth, another one is Python's.

    Args:
        runs: Folder of the runs.
        place: The words between the braces.

    Raises:
        InputError: When a report or what is asked of it does not exist.
    """
    study, *rest = place.split()
    if study == "table":
        return "\n".join(TABLES[rest[0]](report(runs, rest[1])))
    path, form = rest[0], rest[1] if len(rest) > 1 else ""
    value = look_up(report(runs, study), path, place)
    if form == "?":
        return show_truth(value)
    if form == "%":
        return show(scaled(value, 100), ".1f") + " %"
    return show(value, form) if form else str(value)


def report(runs: Path, study: str) -> dict[str, Any]:
    """report.json of a study.

    Raises:
        InputError: When there is none.
    """
    file = runs / study / "report.json"
    try:
        found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as err:
        raise InputError(file, "", f"expected the report of a run: {err}") from err
    return found


def look_up(value: Any, path: str, place: str) -> Any:
    """The value at a path.

    Raises:
        InputError: When there is none.
    """
    for part in path.split("/"):
        try:
            if isinstance(value, list) and not part.isdigit():
                value = next(v for v in value if part in (v.get("name"), v.get("key")))
            else:
                value = value[int(part) if isinstance(value, list) else part]
        except (KeyError, IndexError, StopIteration, TypeError) as err:
            raise InputError(TEMPLATE, f"{{{{{place}}}}}", f"no {part!r} in the report") from err
    return value


def scaled(value: Any, factor: float) -> Any:
    """A number or its summary, times a factor."""
    if isinstance(value, dict):
        return {key: factor * number for key, number in value.items()}
    return factor * value


def section_6(report: dict[str, Any]) -> list[str]:
    """Table III beside ours."""
    head = ["model", "conservative", "RMS id., mm", "RMS check, mm", "max check, mm", "max relative, %"]
    cells = (
        ("identification", "rms_mm", "identification_rms_mm"),
        ("check", "rms_mm", "check_rms_mm"),
        ("check", "max_mm", "check_max_mm"),
        ("check", "max_relative_percent", "check_max_relative_percent"),
    )
    rows = []
    for m in report["models"]:
        row = [m["name"], show_truth(m["conservative"])]
        for group, key, cell in cells:
            known = (m["paper"] or {}).get(cell)
            row.append(show(m[group][key]) + ("" if known is None else f" [{known:g}]"))
        rows.append(row)
    return grid(head, rows)


TABLES = {
    "linear": lambda r: six_dof_text.models_table(r["models"], paper=True),
    "nonlinear": lambda r: six_dof_text.models_table(r["nonlinear"]["models"], paper=False),
    "claims": lambda r: six_dof_text.claims_table(r),
    "orders": lambda r: six_dof_text.orders_table(r["order"]),
    "solvers": lambda r: solvers_text.solvers_table(r),
    "section_6": section_6,
}
"""Whole tables, by name."""

if __name__ == "__main__":
    sys.exit(command.run(app))
