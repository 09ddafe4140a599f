"""docs/paper.md from docs/paper.md.in and the report.json of every study: no number in it is typed by hand.

python tools/write_paper.py [RUNS] [--out FILE]

The template is jinja2's; under a study's name it finds its `report`, its `tables` and its `words`.
"""

import json
import sys
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, get_type_hints

import typer
from jinja2 import TemplateError
from pydantic import TypeAdapter, ValidationError

from testbench.errors import InputError
from testbench.shell import command
from testbench.studies.gravity_calibration.study import STUDY as GRAVITY_CALIBRATION
from testbench.studies.loaded_stiffness.study import STUDY as LOADED_STIFFNESS
from testbench.studies.single_link.study import STUDY as SINGLE_LINK
from testbench.studies.six_dof_arm.study import STUDY as SIX_DOF_ARM
from testbench.studies.solver_comparison.study import STUDY as SOLVER_COMPARISON
from testbench.studies.study import Study
from testbench.views.markdown import Words
from testbench.views.schema import Table

ROOT = Path(__file__).resolve().parents[1]
RUNS, PAGE = ROOT / "runs" / "full", ROOT / "docs" / "paper.md"
TEMPLATE = ROOT / "docs" / "paper.md.in"
STUDIES: tuple[Study[Any, Any, Any, Any], ...] = (
    SINGLE_LINK,
    SIX_DOF_ARM,
    SOLVER_COMPARISON,
    LOADED_STIFFNESS,
    GRAVITY_CALIBRATION,
)

app = typer.Typer(add_completion=False)


@dataclass(frozen=True)
class Found:
    """What a run found, as a report, in tables and in words."""

    report: Any
    tables: dict[str, Table]
    words: Words


@app.command()
def main(
    runs: Annotated[Path, typer.Argument(help="Folder with one run of every study.")] = RUNS,
    out: Annotated[Path, typer.Option(help="Markdown to write.")] = PAGE,
) -> None:
    """Fill the template with the numbers of the reports."""
    found = {study.name: read(runs, study) for study in STUDIES}
    try:
        page = Words(TEMPLATE.parent, found, TEMPLATE.name).whole()
    except TemplateError as err:
        raise InputError(TEMPLATE, "", str(err)) from err
    try:
        out.write_text(page, encoding="utf-8")
    except OSError as err:
        raise InputError(out, "", f"cannot be written: {err.strerror}") from err
    print(out)


def read(runs: Path, study: Study[Any, Any, Any, Any]) -> Found:
    """What a run of a study found, from its report.json.

    Raises:
        InputError: When there is none, or it is of an earlier version.
    """
    file = runs / study.name / "report.json"
    kind = TypeAdapter(get_type_hints(study.summary)["return"])
    names = renamed(sys.modules[study.summary.__module__])
    try:
        text = file.read_text(encoding="utf-8")
        plain = json.loads(text, object_hook=lambda found: {names.get(k, k): v for k, v in found.items()})
        report = kind.validate_python(plain)
    except (OSError, ValueError, ValidationError) as err:
        raise InputError(file, "", f"expected the report of a run: {err}") from err
    return Found(report, dict(study.tables(report)), study.words(report))


def renamed(module: ModuleType) -> dict[str, str]:
    """Fields by the keys that they have in report.json, where these differ (see `run.to_json`)."""
    kinds = [kind for kind in vars(module).values() if is_dataclass(kind)]
    return {f.metadata["key"]: f.name for kind in kinds for f in fields(kind) if "key" in f.metadata}


if __name__ == "__main__":
    sys.exit(command.run(app))
