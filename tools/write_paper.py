"""docs/paper.md from docs/paper.md.in and the report.json of every study: no number in it is typed by hand.

python tools/write_paper.py [RUNS] [--out FILE]

The template is jinja2's; under a study's name it finds its `report`, its `tables` and its `words`,
under `printed` what the printed matrices of section 5.1 tell, under `section_6` the paper's statements of
section 6 and what could explain its errors. Tables of section 6 that are too long for the page are CSV files
in docs/paper.
"""

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import section_6
import typer
from jinja2 import Environment, StrictUndefined, TemplateError
from pages import write_table
from printed_matrices import printed_matrices, tables
from read_reports import read_report

from testbench.arm.folder import find_arm
from testbench.errors import InputError
from testbench.report.markdown import as_markdown, counted, grid
from testbench.report.schema import Table, show_truth, written_out
from testbench.runs import command
from testbench.studies.paper import single_link
from testbench.workflows.cell import build_cell

ROOT = Path(__file__).resolve().parents[1]
RUNS, PAGE = ROOT / "runs" / "full", ROOT / "docs" / "paper.md"
TEMPLATE = ROOT / "docs" / "paper.md.in"
GRAVITY = "gravity_calibration"
BESIDE = ("claims", "candidates", "stopped")  #: Tables of section 6 that are files beside the page.
STUDIES = ("single_link", "six_dof_arm", "solver_comparison", "loaded_stiffness", GRAVITY)

app = typer.Typer(add_completion=False)


@app.command()
def main(
    runs: Annotated[Path, typer.Argument(help="Folder with one run of every study.")] = RUNS,
    out: Annotated[Path, typer.Option(help="Markdown to write.")] = PAGE,
) -> None:
    """Fill the template with the numbers of the reports."""
    reports = {name: read_report(runs / name / "report.json") for name in STUDIES}
    found = {k: {"report": own.numbers, "tables": own.tables, "words": own} for k, own in reports.items()}
    try:
        tried = section_6.tables(runs / GRAVITY, runs / "section_6.json")
        page = _filled(found | {"printed": printed(), "section_6": tried})
    except TemplateError as err:
        raise InputError(TEMPLATE, "", str(err)) from err
    try:
        out.write_text(page, encoding="utf-8")
        out.with_suffix("").mkdir(exist_ok=True)
        for name in BESIDE:
            write_table(tried[name], out.with_suffix("") / f"section_6_{name}.csv")
    except OSError as err:
        raise InputError(out, "", f"cannot be written: {err.strerror}") from err
    print(out)


def _filled(values: Mapping[str, object]) -> str:
    """The template with these values; what is no Markdown is escaped, of several blank lines one is left."""
    jinja = Environment(undefined=StrictUndefined, finalize=_kept, trim_blocks=True, lstrip_blocks=True)
    jinja.filters |= {"grid": grid, "counted": counted, "yes": show_truth, "in_words": in_words, "only": only}
    template = jinja.from_string(TEMPLATE.read_text(encoding="utf-8"))
    lines = written_out(template.render(values)).strip().split("\n")
    kept = [b for a, b in zip(["", *lines], lines, strict=False) if a.strip() or b.strip()]
    return "\n".join(line.rstrip() for line in kept) + "\n"


def in_words(table: Table) -> Table:
    """Keep the statements without a number of the paper; another table has its numbers beside ours."""
    [published] = [column for column in table.columns if column.key == "published"]
    return replace(
        table,
        columns=tuple(column for column in table.columns if column.key not in ("published", "found")),
        rows=[row for row in table.rows if published.value(row) is None],
    )


def only(table: Table, keys: str) -> Table:
    """Keep the columns with these keys, which blanks separate."""
    return replace(table, columns=tuple(column for column in table.columns if column.key in keys.split()))


def _kept(value: object) -> str:
    return value if isinstance(value, str) and hasattr(value, "__html__") else as_markdown(value)


def printed(seed: int = 1000) -> dict[str, object]:
    """Tables of what the printed matrices of section 5.1 tell, under the check loads of a seed."""
    cell, asked = build_cell(find_arm(single_link.NAME)), single_link.SingleLinkSettings()
    numbers = printed_matrices(cell, asked, single_link.measure(cell, asked, seed).truth)
    return {"tables": tables(numbers)}


if __name__ == "__main__":
    sys.exit(command.run(app))
