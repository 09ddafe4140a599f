"""The pages of docs/studies from full runs, and the numbers of README.md and docs: none is typed.

python tools/pages.py --runs runs/full
"""

import csv
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Annotated

import typer
from blocks import fill
from read_reports import read_report
from stamps import Stamp, digest, stamp

from testbench.errors import BenchError
from testbench.report.figure import log_ticks, quiet, save, say
from testbench.report.figure import page as blank
from testbench.report.markdown import capital, grid, titled
from testbench.report.report import Report
from testbench.report.schema import Table, TableColumn, with_fewer_columns
from testbench.runs import command
from testbench.runs.spread import Spread
from testbench.studies import find_study
from testbench.studies.run import headed_figures

ROOT = Path(__file__).resolve().parents[1]
PAGES, README = ROOT / "docs" / "studies", ROOT / "README.md"
MATHEMATICS = ROOT / "docs" / "mathematics"
STUDIES = (
    "gravity_calibration", "single_link", "six_dof_arm", "solver_comparison", "loaded_stiffness",
    "identifiability", "noise_sensitivity", "model_error", "pose_selection", "which_model",
    "regimes", "instruments", "real_ur10", "absolute_calibration", "compensation",
)  # fmt: skip
BENCH = "bench"  #: Its page is written by hand, around docs/leaderboard/*.csv.
BOARD = PAGES.parent / "leaderboard"  #: Folder of its tables; its picture has the same name.
RATIO = re.compile(r"([\d.]+)(?: \(([\d.]+) to ([\d.]+)\))?")
"""A ratio of errors in its tables, with its 95 % interval, but for the incumbent's own."""
ROWS = 9  #: Of the one table that a page shows, at most.
FEWEST, WORDS = 3, 500  #: Rows that it keeps, and words of a page: longer ones have fewer rows.
HAND = "<!-- by hand -->"  #: What follows on a study's page is not made of a run.
DEMO = re.compile(r"(<!-- demo -->\n).*?(<!-- end -->)", re.DOTALL)

app = typer.Typer(add_completion=False)


@app.command()
def main(
    runs: Annotated[Path, typer.Option(help="Folder with one folder a study.")] = ROOT / "runs" / "full",
    bench: Annotated[Path, typer.Option(help="What `make bench` wrote.")] = ROOT / "runs/bench/bench.json",
    demo: Annotated[bool, typer.Option(help="Run the demo and write its table into README.md.")] = True,
) -> None:
    """Write every page whose run is there."""
    found = [name for name in STUDIES if (runs / name / "report.md").is_file()]
    if not found and not (runs / BENCH).is_dir():
        raise BenchError(f"no run of a study in {runs}")
    for name in found:
        page(name, runs / name)
        print(PAGES / f"{name}.md")
    if (runs / BENCH / "report.json").is_file():
        leaderboard(runs / BENCH)
    for own in (README, *sorted(PAGES.parent.glob("*.md")), *sorted(MATHEMATICS.glob("*.md"))):
        if fill(own, runs, bench):
            print(own)
    if demo:
        text = README.read_text(encoding="utf-8")
        README.write_text(DEMO.sub(rf"\g<1>{shown()}\g<2>", text), encoding="utf-8")


def leaderboard(run: Path) -> None:
    """All tables of a run of the bench beside its page, which has parts of it."""
    found = read_report(run / "report.json")
    for key, _ in _tables(found, BOARD):
        print(BOARD / f"{key}.csv")
    draw_leaderboard()


def draw_leaderboard() -> Path:
    """Draw the errors of all entries from the tables beside the page, and stamp a digest of these.

    Returns:
        Path of the picture.
    """
    figure, picture = blank(6.6), BOARD.with_suffix(".png")
    panes = {"with_prior": "with the prior, over the default", "without_prior": "without, over joints"}
    for axes, (name, title) in zip(figure.subplots(1, 2), panes.items(), strict=True):
        with (BOARD / f"{name}.csv").open(encoding="utf-8", newline="") as file:
            found = {row["model"]: row["error divided by the incumbent's"] for row in csv.DictReader(file)}
        for y, text in enumerate(found.values()):
            middle, *ends = (float(own) for own in RATIO.findall(text)[0] if own)
            axes.plot(ends, [y] * len(ends), color="C0", linewidth=2.5)
            axes.plot(middle, y, "o", color="C0" if ends else "0.3")
        log_ticks(axes, "x", *axes.dataLim.intervalx)
        axes.axvline(1.0, color="0.6", linewidth=0.8, linestyle=":")
        axes.set_yticks(range(len(found)), list(found))
        axes.set(ylim=(len(found) - 0.5, -0.5), xlabel="ratio of errors")
        axes.set_title(title, fontsize="medium")
        quiet(axes)
    say(
        figure,
        "Errors of all entries over that of the incumbent: to the left is better",
        "Dot: geometric mean over simulated tasks and arms. Line: its 95 % interval. "
        "Dotted: as good as the incumbent.",
    )
    save(figure, picture)
    [command] = re.findall(r"^    (testbench bench .*)$", BOARD.with_suffix(".md").read_text(), re.MULTILINE)
    stamp(picture, Stamp(command, digest(BOARD)))
    return picture


def page(name: str, run: Path) -> None:
    """A study's page: command, answer, picture, its first table in short; all tables as CSV beside it."""
    found = read_report(run / "report.json")
    draw(name, run)
    links = [f"[{key}]({name}/{key}.csv)" for key, _ in _tables(found, PAGES / name)]
    text = ""
    for rows in range(ROWS, FEWEST - 1, -1):
        text = _text(name, run, found, rows, links)
        if len(text.split()) <= WORDS:
            break
    kept = PAGES / f"{name}.md"
    text += by_hand(kept.read_text(encoding="utf-8")) if kept.is_file() else ""
    kept.write_text(text, encoding="utf-8")


def by_hand(page: str) -> str:
    """What is written by hand on a page: all from its mark on; empty without one."""
    _, mark, words = page.partition(HAND)
    return f"\n{mark}{words}" if mark else ""


def asked(name: str, run: Path) -> str:
    """The command that made a run of a study, as its page has it."""
    manifest = json.loads((run / "manifest.json").read_text(encoding="utf-8"))
    flags = f"--seed {manifest['seed']} --seeds {manifest['seeds']}"
    if "campaigns" in manifest["scenario"]:
        flags += f" --campaigns {manifest['scenario']['campaigns']}"
    return f"python scenarios/{name}.py {flags} --out runs/{name}"


def made_with(run: Path) -> str:
    """The day and commit of the code that made a run, in a sentence; empty where they are not known."""
    commit = json.loads((run / "manifest.json").read_text(encoding="utf-8"))["git"].removesuffix("-dirty")
    if commit == "unknown":
        return ""
    show = ["git", "-C", str(ROOT), "show", "-s", "--format=%cs (%h)", "--abbrev=8", commit]
    day = subprocess.run(show, capture_output=True, text=True, check=True).stdout.strip()
    return f"The code of {day} computed these numbers."


def draw(name: str, run: Path) -> None:
    """A study's picture by today's code from the numbers of a run, and in it a digest of its tables."""
    found, png = read_report(run / "report.json"), PAGES / f"{name}.png"
    figures = headed_figures(find_study(name), found)
    save(figures.get(f"{name}.png") or next(iter(figures.values())), png)
    with tempfile.TemporaryDirectory() as tables:
        for _ in _tables(found, Path(tables) / name):
            pass
        stamp(png, Stamp(asked(name, run), digest(Path(tables) / name)))


def _text(name: str, run: Path, found: Report, rows: int, links: list[str]) -> str:
    """The page with so many rows in its table, below the command that made the run and the code it ran."""
    badge = found.block("badge")
    parts = [
        f"# {titled(name)}",
        f"    {asked(name, run)}",
        made_with(run),
        found.question,
        f"**{found.answer}**" if found.answer else "",
        f"> {badge}" if badge else "",
        f"![{name}]({name}.png)",
        found.worst,
        found.block("statements"),
        _short(next(iter(found.tables.values())), rows),
        found.title,
        f"All tables: {', '.join(links)}.",
    ]
    return "\n\n".join(filter(None, parts)) + "\n"


def _short(table: Table, most: int) -> str:
    """A table's first columns, the headline among them, and its first rows."""
    rows = sorted(table.rows, key=lambda row: table.columns[0].cell(row) != table.bold)[:most]
    short = replace(with_fewer_columns(table), rows=[row for row in table.rows if row in rows])
    left = len(table.rows) - len(rows)
    more = f"The CSV file has all {len(table.rows)} rows." if left else ""
    return "\n\n".join(filter(None, [f"## {capital(table.title)}" if table.title else "", grid(short), more]))


def _tables(found: Report, folder: Path) -> Iterator[tuple[str, Table]]:
    """Write every table that has rows into a folder."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for key, table in found.tables.items():
        if table.rows:
            write_table(table, folder / f"{key}.csv")
            yield key, table


def write_table(table: Table, file: Path) -> None:
    """Write a table as CSV: a column per quantity, two more for the ends of its spread."""
    cells = [[_cells(column, row) for column in table.columns] for row in table.rows]
    wide = [any(len(own) > 1 for own in column) for column in zip(*cells, strict=True)]
    heads = [_heads(c, spread) for c, spread in zip(table.columns, wide, strict=True)]
    with file.open("w", encoding="utf-8", newline="") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(chain.from_iterable(heads))
        for row in cells:
            filled = [[*own, *[""] * 2][: len(head)] for own, head in zip(row, heads, strict=True)]
            writer.writerow(chain.from_iterable(filled))


def _heads(column: TableColumn, spread: bool) -> list[str]:
    return [column.title, *[f"{column.title} ({end})" for end in ("low", "high") if spread]]


def _cells(column: TableColumn, row: object) -> list[str]:
    """A number as the report shows it, and the ends of its spread."""
    value = column.value(row)
    if isinstance(value, Spread):
        low, high = value.ends
        return [column.text(own) for own in (value.median, low, high)]
    return [column.text(value)]


def shown() -> str:
    """What the demo prints, up to its words."""
    with tempfile.TemporaryDirectory() as out:
        script = [sys.executable, ROOT / "scenarios" / "gravity_calibration.py"]
        flags = ["--seed", "1", "--true-arm", "cast", "--out", out]
        done = subprocess.run([*script, *flags], capture_output=True, text=True, check=True)
    lines = done.stdout.partition("\n •")[0].strip("\n").split("\n")
    return "\n".join(f"    {line}".rstrip() for line in lines) + "\n\n"


if __name__ == "__main__":
    sys.exit(command.run(app))
