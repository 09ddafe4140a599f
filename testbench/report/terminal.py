"""Tables and words for a terminal of 80 columns, by rich."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from textwrap import wrap

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from testbench.errors import printable, shell_word
from testbench.report.markdown import ReportWords
from testbench.report.markdown import as_plain as as_plain
from testbench.report.schema import Table, TableColumn, brackets, with_fewer_columns
from testbench.runs.next_step import next_lines
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
        console.print(f" {len(words.block('more').splitlines())} more {where}")


def viewing_lines(out: Path, given: Sequence[Path] = (), **known: str | Path) -> list[str]:
    """Say where page and recording of a run are, how to open them, and what comes next.

    Args:
        out: Folder of the results.
        given: Readings that a plan was made beside.
        known: See `next_lines`.

    Returns:
        Lines.
    """
    return [
        f"page       {out / 'report.html'}: opens in any browser",
        f"recording  {out / 'recording.rrd'}; open it with: testbench view {shell_word(out)}",
        *next_lines(out, given, **known),
    ]


def print_places(console: Console, out: Path, *, figures: list[str], data: str = "dataset.csv") -> None:
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
