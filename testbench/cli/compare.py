"""testbench compare RUN_A RUN_B: which inputs of two runs differ, and which run errs less."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from testbench.errors import BenchError
from testbench.report import terminal
from testbench.report.colours import look_of
from testbench.report.join import (
    KINDS,
    badge_of,
    inputs_differ,
    leading,
    models_compared,
    models_of,
    numbers_compared,
    refuse_unlike,
    seeds,
)
from testbench.report.markdown import Markdown
from testbench.report.report import Report, RunRequest, say, write_run
from testbench.report.scene import PageContent
from testbench.report.schema import Table, TableColumn
from testbench.report.table import Row
from testbench.runs.manifest import Finished, read_run
from testbench.runs.whole import claim_folder, reading
from testbench.workflows.model_names import first_mention
from testbench.workflows.options import Force, takes

if TYPE_CHECKING:
    from testbench.report.figure import Figure

COMMAND = "testbench compare"  #: As manifest.json names it.
PICTURE = "compare.png"
DIFFER = "Inputs that differ"
MAX_NUMBERS = 200  #: Numbers beside the models that are listed.
PRINTED = 20  #: Letters of an input in a terminal.


@dataclass(frozen=True)
class CompareOptions:
    """Hold the flags of the command."""

    a: Annotated[Path, typer.Argument(metavar="RUN_A", help="Folder of the first run.")]
    b: Annotated[Path, typer.Argument(metavar="RUN_B", help="Folder of the second run.")]
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the comparison.")] = Path("runs/compare")
    anyway: Annotated[bool, typer.Option("--anyway", help="Also compare different true arms or seeds.")] = (
        False
    )
    fail_if_worse: Annotated[
        bool, typer.Option("--fail-if-worse", help="Exit with 1 if RUN_B has larger errors.")
    ] = False
    force: Force = False


@takes(CompareOptions, draws=True)
def command(asked: CompareOptions) -> None:
    """Compare inputs and models of two runs; write the folder."""
    out = asked.out
    with claim_folder(out, COMMAND, own=frozenset(), inputs=[asked.a, asked.b], force=asked.force):
        with reading(asked.a), reading(asked.b):
            a, b = read_run(asked.a), read_run(asked.b)
            if not asked.anyway:
                refuse_unlike([a, b])
            said = report(a, b)
        flags = {"A": {str(a.folder): a.digest}, "B": {str(b.folder): b.digest}}
        names = f"{a.folder.name} (A), {b.folder.name} (B)"
        request = RunRequest(COMMAND, names, flags, [], PICTURE, draw=_figures)
        write_run(out, request, said, PageContent())
        lines = [
            *terminal.as_plain(said.title).split("; "),
            f"numbers    {out / 'report.json'}, {out / 'report.md'}",
            f"picture    {out / PICTURE}",
            *terminal.viewing_lines(out),
        ]
        tables = [_printed(table) for name, table in said.tables.items() if name != "others"]
        terminal.print_words(terminal.plain_console(), said, tables, lines)
    if asked.fail_if_worse and said.numbers["worse"]:
        raise typer.Exit(1)


def _figures(said: Report, seen: PageContent) -> "Mapping[str, Figure]":
    """Draw the picture of a run, which says below what A and B are."""
    from testbench.report.figure import RATIO, add_words, short  # here: matplotlib takes long
    from testbench.report.run_figure import overview

    a, b = (Path(run).name for run in said.numbers["runs"])
    words = f"error of {short(b)} (B) divided by the error of {short(a)} (A)"
    tables = [
        replace(
            table, columns=tuple(replace(c, heading=words) if c.key == RATIO else c for c in table.columns)
        )
        for table in seen.tables
    ]
    return {PICTURE: add_words(overview(said, replace(seen, tables=tables)), f"A: {a}; B: {b}.")}


def _printed(table: Table) -> Table:
    """Shorten the cells of a table of inputs: its three columns fit a terminal."""
    if table.title != DIFFER:
        return table
    return replace(table, rows=[Row(row, a=row.a[:PRINTED], b=row.b[:PRINTED]) for row in table.rows])  # type: ignore[attr-defined, call-overload]


def report(a: Finished, b: Finished) -> Report:
    """Report two runs: inputs that differ, errors of the models of both.

    Args:
        a: A finished run.
        b: Another one.

    Returns:
        The report.

    Raises:
        BenchError: When they have neither models nor numbers of the same names.
        InputError: When an error in a report, or the trials of a run, are damaged.
    """
    models, values = models_compared(a, b), numbers_compared(a, b)
    lead = leading(models, [a, b])
    if lead is None and not values:
        kinds = f"a run of {a.manifest.command} and one of {b.manifest.command} without any"
        raise BenchError(f"expected runs with a model or a number in common, got {kinds}")
    badge = None if lead is None else badge_of(lead, a, b)
    inputs = inputs_differ(a, b)
    led = [row for row in models if lead is not None and row.kind == lead.kind]
    apart = [row for row in values if row.verdict != "same"]
    far = sum(row.verdict in ("smaller", "larger") for row in values)
    answer = say("{far} of {all} numbers differ by more than 2 %.", far=far, all=len(values))
    if lead is not None:
        answer = say(
            "RMS error of {words} {where}: {a:.3f} mm in A, {b:.3f} mm in B.",
            lead,
            words=first_mention(lead.name),
            where=KINDS[lead.kind],
        )
    names = [{row.name for row in models_of(run).values()} for run in (a, b)]
    only = sorted(names[0] ^ names[1])
    tables = _tables(lead, models, [] if led else apart, inputs)
    tables = {name: table for name, table in tables.items() if table.rows}
    return Report(
        scenario="compare",
        question=say(
            "Do {a} (A) and {b} (B) differ, and which has the smaller error?",
            Row(a=a.folder.name, b=b.folder.name),
        ),
        title=say("A: {a} ({x}, {s}); B: {b} ({y}, {t})", _made(a, b)),
        answer=answer,
        claims=[say("These models are in only one of the runs: {only:list}.", only=only)]
        if only and led
        else [],
        numbers=Row(
            runs=[str(a.folder), str(b.folder)],
            inputs=inputs,
            models=models,
            numbers=values[:MAX_NUMBERS],
            equal=a.digest == b.digest,
            worse=bool(lead and lead.verdict == "larger") or bool(badge and badge.verdict == "do not use"),
        ),
        tables=tables,
        body=[*tables, Markdown("What tables and verdicts mean: docs/compare.md.")],
        badge=badge,
    )


def _made(a: Finished, b: Finished) -> Row:
    """Name folders, commands and seeds of both runs."""
    s, t = (f"{'seed' if run.manifest.seeds == 1 else 'seeds'} {seeds(run)}" for run in (a, b))
    return Row(a=str(a.folder), x=a.manifest.command, s=s, b=str(b.folder), y=b.manifest.command, t=t)


def _tables(
    lead: Row | None, models: Sequence[Row], numbers: Sequence[Row], inputs: Sequence[Row]
) -> dict[str, Table]:
    """Tabulate the models by the error that leads, their other errors, numbers and inputs that differ."""
    led = [row for row in models if lead is not None and row.kind == lead.kind]
    rest = [row for row in models if row not in led]
    looks = {row.name: look_of(row) for row in led if row.constraint}
    ratio = TableColumn("ratio", "error of B divided by the error of A", form=".2f", short="B / A")
    sides = TableColumn("a", "A", "mm"), TableColumn("b", "B", "mm")
    judged = TableColumn("by", "judged by", called={"one": "single numbers"})
    columns = TableColumn("verdict", "error of B is"), judged
    kind = TableColumn("kind", "where", called=KINDS)
    plain = (
        TableColumn("what", "number"),
        *(TableColumn(k, k.upper(), form=",.5g", exact=True) for k in "ab"),
        ratio,
    )
    texts = TableColumn("what", "input"), TableColumn("a", "A"), TableColumn("b", "B")
    where = f"RMS error {KINDS[lead.kind]}" if lead else ""
    return {
        "models": Table(
            (TableColumn("name", "model"), *sides, ratio, *columns),
            led,
            where,
            bold=lead.name if lead else "",
            headline="ratio",
            looks=looks,
        ),
        "others": Table((TableColumn("name", "model"), kind, *sides, ratio, *columns), rest, "Other errors"),
        "numbers": Table(plain, numbers[:MAX_NUMBERS], "Numbers that differ"),
        "inputs": Table(texts, inputs, DIFFER),
    }
