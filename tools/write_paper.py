"""docs/paper.md from docs/paper.md.in and the report.json of every study: no number in it is typed by hand.

python tools/write_paper.py [RUNS] [--out FILE]
"""

import json
import re
import shutil
import sys
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer
from pydantic import TypeAdapter

from testbench.errors import InputError
from testbench.shell import command
from testbench.studies import gravity_calibration, loaded_stiffness
from testbench.studies.single_link import words as single_link_text
from testbench.studies.six_dof_arm import words as six_dof_text
from testbench.studies.solver_comparison import words as solvers_text
from testbench.studies.study import Study
from testbench.views.markdown import Words, grid
from testbench.views.report import show, show_truth

ROOT = Path(__file__).resolve().parents[1]
RUNS, PAGE = ROOT / "runs" / "paper", ROOT / "docs" / "paper.md"
TEMPLATE = ROOT / "docs" / "paper.md.in"
FIGURES = re.compile(r"\]\((\w+\.png)\)")
PLACE = re.compile(r"\{\{(.*?)\}\}")

app = typer.Typer(add_completion=False)


@app.command()
def main(
    runs: Annotated[Path, typer.Argument(help="Folder with one run of every study.")] = RUNS,
    out: Annotated[Path, typer.Option(help="Markdown to write.")] = PAGE,
) -> None:
    """Fill the template with the numbers of the reports."""
    text = TEMPLATE.read_text(encoding="utf-8")
    page = PLACE.sub(lambda match: fill(runs, match[1].strip()), text)
    try:
        out.write_text(page, encoding="utf-8")
        for name in FIGURES.findall(page):
            shutil.copyfile(runs / Path(name).stem / name, out.parent / name)
    except OSError as err:
        raise InputError(
            Path(err.filename or out), "", f"cannot be copied or written: {err.strerror}"
        ) from err
    print(out)


def fill(runs: Path, place: str) -> str:
    """What stands at a place: `study path/to/number format`, `table study name` or `words study`.

    A table is one of the study's, by name; words are its answer and statements.

    A part of a path is a key, the name of a list's member, or its number from 0. A format of `%` shows a
    share, `?` a truth, another one is Python's.

    Args:
        runs: Folder of the runs.
        place: The words between the braces.

    Raises:
        InputError: When a report or what is asked of it does not exist.
    """
    study, *rest = place.split()
    if study == "table" and rest[0] in STUDIES:
        known = STUDIES[rest[0]]
        return grid(known.tables(typed(runs, known))[rest[1]])
    if study == "words" and rest[0] in STUDIES:
        known = STUDIES[rest[0]]
        return in_words(known.words(typed(runs, known)))
    if study == "table":
        text = MARKDOWN[rest[0]](report(runs, rest[0]))
        return tables_of(text)[int(rest[1]) - 1].rstrip()
    if study == "words":
        return WORDS[rest[0]](report(runs, rest[0]))
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


def typed(runs: Path, study: Study[Any, Any, Any, Any]) -> Any:
    """report.json of a study as its dataclass."""
    return TypeAdapter(get_type_hints(study.summary)["return"]).validate_python(report(runs, study.name))


def in_words(words: Words) -> str:
    """What a study found: its answer, then what else is to be said."""
    return "\n\n".join([words.block("answer"), words.block("statements")])


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


def tables_of(text: str) -> list[str]:
    """Every table of a Markdown text."""
    return re.findall(r"^(?:\|.*\n)+", text + "\n", re.MULTILINE)


STUDIES = {study.name: study for study in (gravity_calibration.STUDY, loaded_stiffness.STUDY)}
MARKDOWN = {
    "single_link": single_link_text.markdown,
    "six_dof_arm": six_dof_text.markdown,
    "solver_comparison": solvers_text.markdown,
}
"""report.md of a report, by study."""
WORDS = {
    "solver_comparison": lambda r: "\n".join(f"- {claim}" for claim in solvers_text.claims(r)),
}
"""Verdict of a report, by study."""

if __name__ == "__main__":
    sys.exit(command.run(app))
