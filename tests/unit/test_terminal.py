"""What commands print: users' names as they are."""

import io
import re
from pathlib import Path

from rich.console import Console

import testbench
from testbench.report.table import Row
from testbench.trials.spread import spread
from testbench.views.schema import Column, Table
from testbench.views.terminal import grid, plain_console, print_table

STEERS = "a\x1b]0;b\x07\x9bc\u202ed\u200b"
SEEN = "a\ufffd]0;b\ufffd\ufffdc\ufffdd\ufffd"
NAMES = ("joint[/x]", "[red]two[/red]", "[bold]", ":bug:", "a\\[b]")
"""A closing tag of nothing, which ends a program that reads tags; tags and a picture's name, which vanish."""


def test_names_are_printed_as_they_are_but_for_what_steers_a_terminal(capsys):
    names = (*NAMES, STEERS)
    columns = (Column("name", "model"), *(Column("value", name) for name in names))
    rows = [{"name": name, "value": name} for name in names]
    console = plain_console()
    console.width = 300
    print_table(console, Table(columns, rows, title="".join(names), bold=NAMES[0]))
    console.print("".join(names), soft_wrap=True)
    title, head, *lines, last = capsys.readouterr().out.strip().splitlines()
    assert title.strip() == last == f"{''.join(NAMES)}{SEEN}"
    assert head.split() == ["model", *NAMES, SEEN]
    cells = [line.split()[-len(names) :] for line in lines[1:]]
    assert cells == [[name] * len(names) for name in (*NAMES, SEEN)]


def test_a_table_has_medians_and_below_them_the_ends_of_their_spread_and_the_papers_numbers():
    columns = (
        Column("name", "model", called={"a": "model A"}),
        Column("error", "RMS error", "mm", paper="error", short="RMS\nmm"),
        Column("n", "trials", form=".0f", exact=True),
        Column("solved", "solved", form="yes"),
        Column("um", "bias", "um", form=".1f", scale=1e3, none="no load"),
    )
    errors, n = spread([1.0, 2.0, 4.0]), spread([3, 5, 9])
    rows = [
        Row(name="a", error=errors, n=n, solved=0.5, um=0.002, paper=Row(error=1.5)),
        Row(name="b", error=0.25, n=None, solved=True, um=None, paper=Row()),
    ]
    found = grid(Table(columns, rows, bold="b"))
    heads = [str(column.header) for column in found.columns]
    assert heads == ["model", "RMS\nmm", "trials", "solved", "bias\num"]
    assert list(zip(*(column.cells for column in found.columns), strict=True)) == [
        ("* b", "0.250", "not fitted", "yes", "no load"),
        ("model A", "2.000", "5", "50 %", "2.0"),
        ("  least of 3", "1.000", "", "", ""),
        ("  most", "4.000", "", "", ""),
        ("  paper", "1.5", "", "", ""),
    ]


def test_all_of_the_package_prints_by_it_but_for_bars():
    package = Path(testbench.__file__).parent
    makers = [p for p in package.rglob("*.py") if re.search(r"\b\w*Console\(", p.read_text(encoding="utf-8"))]
    assert sorted(makers) == [package / "shell/follow.py", package / "views/terminal.py"]


def test_a_table_has_six_columns_at_most_and_among_them_that_of_the_answer():
    columns = [Column(f"c{k}", f"heading {k}") for k in range(9)]
    console = Console(width=80, file=io.StringIO())
    print_table(console, Table(tuple(columns), [Row({f"c{k}": "yes" for k in range(9)})], headline="c7"))
    assert re.findall(r"\d", console.file.getvalue()) == list("012347")
