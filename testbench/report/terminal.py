"""Tables and words for a terminal of 80 columns, by rich, and the next steps after a run."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from textwrap import wrap

from pydantic import JsonValue
from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from testbench.errors import printable, shell_word
from testbench.report.markdown import ReportWords
from testbench.report.markdown import as_plain as as_plain
from testbench.report.schema import Table, TableColumn, brackets, with_fewer_columns
from testbench.runs.interrupt import SESSION
from testbench.runs.manifest import read_manifest
from testbench.runs.spread import Spread

BADGES = {"Holds": "bold green", "Do not": "bold red"}  #: Styles of a badge by its first words.
MORE = "in report.md, section More"
NARROW = 9  #: Letters of a heading's line, unless a word has more.


class PlainConsole(Console):
    """Print for commands: of users' names nothing is markup, a picture or what steers a terminal."""

    def __init__(self) -> None:
        super().__init__(highlight=False, markup=False, emoji=False)

    def render_str(self, text: str, **how: object) -> Text:
        """Make text on its way into a table or a line plain.

        Args:
            text: The text.
            how: Passed on to rich.

        Returns:
            The text.
        """
        return super().render_str(_lines(text), **how)  # type: ignore[arg-type]


def plain_console() -> Console:
    """Make a console of standard output."""
    return PlainConsole()


def _lines(text: str) -> str:
    return "\n".join(map(printable, text.split("\n")))


def grid(table: Table) -> RichTable:
    """Make a table without its title: medians with percentiles or range, and the paper's numbers.

    Of a quantity over two factors only the medians: report.md and the page have its spread, and columns
    beyond `MAX_COLUMNS`.
    """
    table = with_fewer_columns(table)
    found = RichTable(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    for k, column in enumerate(table.columns):
        words = all(isinstance(column.value(row), str) for row in table.rows)
        found.add_column(_head(column), justify="left" if words or not k else "right", no_wrap=True)
    for row in table.rows:
        first, *others = (_end(column, row) for column in table.columns)
        marked = table.marks(row)
        found.add_row(f"* {first}" if marked else first, *others, style="bold green" if marked else "")
        spreads = [not (c.exact or table.across) and _spreads(c.value(row)) for c in table.columns]
        for end, name in enumerate(_ends_named(table, row)) if any(spreads) else ():
            cells = [_end(c, row, end) if s else "" for c, s in zip(table.columns, spreads, strict=True)]
            found.add_row(f"  {name}", *cells[1:], style="dim")
        known = [column.known(row) for column in table.columns]
        if any(known):
            found.add_row("  paper", *known[1:], style="italic")
    return found


def _head(column: TableColumn) -> str:
    """A heading in narrow lines of whole words."""
    if column.short:
        return column.short
    parts = column.title.split(", ")
    lines = (wrap(part, NARROW, break_long_words=False, break_on_hyphens=False) for part in parts)
    return "\n".join(chain.from_iterable(lines))


def print_table(console: Console, table: Table) -> None:
    """Print a table below its title, which may be wider.

    Args:
        console: Where to print.
        table: The table.
    """
    if table.title:
        console.print(table.title, style="italic")
    console.print(grid(table))


def _spreads(value: object) -> bool:
    return isinstance(value, Spread) and value.ends[0] < value.ends[1]


def _ends_named(table: Table, row: object) -> tuple[str, str]:
    """What the two ends of a row's spreads are."""
    words = brackets(replace(table, rows=[row]))
    if words.startswith("range"):
        return f"least{words.removeprefix('range').removesuffix(' trials')}", "most"
    return ("5 %, least", "95 %, most") if "range" in words else ("5 %", "95 %")


def _end(column: TableColumn, row: object, end: int | None = None) -> str:
    """The median, or an end of the spread."""
    value = column.value(row)
    if isinstance(value, Spread):
        return column.text(value.median if end is None else value.ends[end])
    return column.text(value)


def print_words(
    console: Console,
    words: ReportWords,
    tables: Sequence[Table] = (),
    lines: Sequence[str] = (),
    where: str = MORE,
) -> None:
    """Print the answer, tables, what else is to be said, and lines below it.

    Args:
        console: A plain one.
        words: Of the report.
        tables: In their order; those without rows are left out.
        lines: Of any length.
        where: The statements that are not printed are.
    """
    print_headline(console, words)
    for table in tables:
        if table.rows:
            print_table(console, table)
    print_statements(console, words, where)
    if lines:
        console.print("\n".join(lines), soft_wrap=True)


def print_headline(console: Console, words: ReportWords) -> None:
    """Print the badge, the answer, and where it is worst.

    Args:
        console: Where to print.
        words: Words of the report.
    """
    if badge := as_plain(words.block("badge")):
        console.print(
            badge, style=next((own for k, own in BADGES.items() if badge.startswith(k)), "bold yellow")
        )
    if words.block("answer"):
        console.print(as_plain(words.block("answer")), style="bold")
    if words.block("worst"):
        console.print(as_plain(words.block("worst")))


def print_statements(console: Console, words: ReportWords, where: str = MORE) -> None:
    """Print what else is to be said, a list; there are more where it says.

    Args:
        console: Where to print.
        words: Words of the report.
        where: Where those stand that are not printed.
    """
    if words.block("statements"):
        from rich.markdown import Markdown  # here: its library takes long to import, and few commands need it

        console.print(Markdown(words.block("statements")))
    if words.block("more"):
        count = len(words.block("more").splitlines())
        console.print(f" {count} more note{'s'[: count > 1]} {where}")


def viewing_lines(
    out: Path, given: Sequence[Path] = (), *, recording: bool = True, **known: str | Path
) -> list[str]:
    """Say where page and recording of a run are, how to open them, and what comes next.

    Args:
        out: Folder of the results.
        given: Readings that a plan was made beside.
        recording: Whether the run left a recording.
        known: See `next_lines`.

    Returns:
        Lines.
    """
    opened = f"recording  {out / 'recording.rrd'}; open it with: testbench view {shell_word(out)}"
    return [
        f"page       {out / 'report.html'}: opens in any browser",
        *([opened] if recording else []),
        *next_lines(out, given, **known),
    ]


def print_places(console: Console, out: Path, *, figures: list[str], data: str) -> None:
    """Print where the results are, and how to open them.

    Args:
        console: Where to print.
        out: Folder of the results.
        figures: Names of the figures.
        data: Name of the data file.
    """
    lines = [
        f"numbers    {out / 'report.json'}, {out / 'report.md'}, {out / 'trials.parquet'}, {out / data}",
        f"figures    {', '.join(str(out / name) for name in figures)}",
        *viewing_lines(out),
    ]
    console.print("\n".join(lines), soft_wrap=True)


MISSING = {
    "check": "your confirmation of the numbers in elastic.toml, and a table of task poses",
    "plan": "readings of all poses of plan.csv, {readings}",
    "data check": "a map file, if a column was misunderstood",
    "identify": "a table of poses, or a program",
    "calibrate": "a new series of readings, to score the model",
    "predict": "a program as a table",
}
"""What only the user can give, by command."""

COMMANDS = {
    "check": ["plan {arm} --task TASKS.csv --poses 12 --load KG --out {beside}plan"],
    "plan": [
        "simulate {arm} {run}/plan.csv{flags} --out rehearsal.csv",
        "data check {arm} MEASURED.csv --out {beside}data",
        "identify {arm} MEASURED.csv{fit} --out {beside}model",
    ],
    "plan absolute": [
        "simulate {arm} {run}/plan.csv{flags} --out rehearsal.csv",
        "calibrate {arm} {given}MEASURED.csv --out {beside}model",
    ],
    "data check": ["identify {arm} {data}{flags} --out {beside}model"],
    "identify": ["predict {run} POSES.csv", "compensate {run} PROGRAM.csv --out CORRECTED.csv"],
    "calibrate": [
        "calibrate {run} READINGS.csv --score --frame-poses 50",
        "compensate {run} PROGRAM.csv --out CORRECTED.csv",
    ],
    "predict": ["compensate {model} PROGRAM.csv --out CORRECTED.csv"],
    "study": ["compare {run} OTHER_RUN", "new MY_ARM --from ROBOT.urdf"],
}
"""The commands that follow, by command."""
LEFT_OUT = {
    "arm": " {arm}",
    "load": " --load KG",
}  #: Their words that a project file makes needless, by its keys.


def next_lines(run: Path, given: Sequence[Path] = (), **known: str | Path) -> list[str]:
    """Say what is missing after a run, and the next command, filled in as far as the run tells.

    Args:
        run: Its folder.
        given: Readings that a plan was made beside; else their names that the run has.
        known: `arm`, `model` or `data` as the user named it; else the name that the run has, found here or
            beside the run.

    Returns:
        Lines; none of a folder that is not that of a finished run.
    """
    about = read_manifest(run)
    name = about.command.removeprefix("testbench ")
    asked = about.scenario if isinstance(about.scenario, dict) else {}
    absolute = bool(asked.get("absolute"))
    named = printable(next(iter(about.models), "ARM"))
    data, names = asked.get("data"), asked.get("given")
    if not given and isinstance(names, list):
        given = [_placed(run, str(name)) for name in names]
    fields = {
        "run": shell_word(run),
        "beside": "" if run.parent == Path() else f"{shell_word(run.parent)}/",
        "readings": "of the planned instruments" * bool(asked.get("instruments"))
        or ("in the tracker's frame" if absolute else "without and with the load"),
        "flags": _rehearsal(asked) if absolute else printable(str(asked.get("flags", ""))) + _gauges(asked),
        "fit": _fit(asked),
        "given": "".join(f"{shell_word(path)} " for path in given),
        "arm": named,
        "model": shell_word(_placed(run, next(iter(about.models), "MODEL"))),
        "data": shell_word(_placed(run, data)) if isinstance(data, str) else "MEASURED.csv",
    } | {key: shell_word(Path(value)) for key, value in known.items()}
    key = "plan absolute" if name == "plan" and absolute else name
    texts = list(COMMANDS.get(key, COMMANDS["study"] if name.startswith("scenarios/") else ()))
    for key, words in LEFT_OUT.items():
        texts = [text.replace(words, "") for text in texts] if key in SESSION.get().known else texts
    mapped = "--map" in fields["flags"] or "map" in SESSION.get().taken
    lines = [f"{'needed':<11}{MISSING[name]}"] if name in MISSING and not mapped else []
    lines += [f"{'' if k else 'next':<11}testbench {text}" for k, text in enumerate(texts)]
    return [line.format_map(fields) for line in lines]


def _placed(run: Path, name: str) -> Path:
    """What a run has by its name alone: as it is here, else beside the run if it is there."""
    beside = run.parent / name
    return beside if os.path.lexists(beside) and not os.path.lexists(name) else Path(name)


def _rehearsal(asked: Mapping[str, JsonValue]) -> str:
    """Flags of `simulate` that rehearse a plan of absolute readings."""
    flags = " --absolute"
    for key, flag in (("gear_urad", "--gear-urad"), ("geometry_mm", "--geometry-mm")):
        value = asked.get(key)
        flags += f" {flag} {value:g}" if isinstance(value, float) else ""
    loads = asked.get("loads_kg")
    masses = [kg for kg in loads if isinstance(kg, float)] if isinstance(loads, list) else []
    flags += " --orientations" if asked.get("orientations") else ""
    instruments = asked.get("instruments")
    for text in instruments if isinstance(instruments, list) else []:
        flags += f" --instrument {shell_word(Path(str(text)))}"
    return flags + (f" --loads {','.join(f'{kg:g}' for kg in masses)}" if len(masses) > 1 else "")


def _gauges(asked: Mapping[str, JsonValue]) -> str:
    """Flag of `simulate` that reads the gauges of a plan."""
    return " --instrument planned" if asked.get("gauges") else ""


def _fit(asked: Mapping[str, JsonValue]) -> str:
    """Flags of `identify` that fit the model that a plan was made for."""
    model = asked.get("model")
    named = f" --model {printable(model)}" if isinstance(model, str) else ""
    return named + (" --no-prior" if asked.get("uncertainty_percent") is None else "")
