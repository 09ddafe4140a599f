"""testbench compare RUN_A RUN_B: what differs between runs, given and found."""

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from testbench.commands.compare import COMMAND, LETTERS, input_lines, printed, report, write
from testbench.commands.compare_inputs import refuse_unlike
from testbench.commands.compare_rows import worse
from testbench.errors import BenchError
from testbench.output.manifest import read_run
from testbench.output.place import claim_folder
from testbench.output.whole import reading
from testbench.shell.options import Force, takes
from testbench.views import terminal
from testbench.views.markdown import as_plain


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    runs: Annotated[list[Path], typer.Argument(help="Folders of two runs or more; the first is A.")]
    out: Annotated[Path, typer.Option(help="Folder of the comparison.")] = Path("runs/compare")
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Compare runs of other true arms, or one seed with several.")
    ] = False
    fail_if_worse: Annotated[
        bool, typer.Option("--fail-if-worse", help="Exit with 1 when a run errs more than A.")
    ] = False
    force: Force = False


@takes(Options)
def command(asked: Options) -> None:
    """Say which run errs less and what they were given otherwise; write the folder."""
    if not 2 <= len(asked.runs) <= len(LETTERS):
        raise BenchError(f"runs: expected 2 to {len(LETTERS)} folders, got {len(asked.runs)}")
    with claim_folder(asked.out, COMMAND, own=frozenset(), inputs=asked.runs, force=asked.force):
        with ExitStack() as read:
            for folder in asked.runs:
                read.enter_context(reading(folder))
            runs = [read_run(folder) for folder in asked.runs]
            if not asked.anyway:
                refuse_unlike(runs)
            said = report(runs)
        write(runs, said, asked.out)
        console, out = terminal.plain_console(), asked.out
        terminal.print_answer(console, said)
        terminal.print_statements(console, said)
        for line in input_lines(said):
            console.print(line)
        for table in printed(said):
            console.print()
            terminal.print_table(console, table)
        lines = [
            "",
            *as_plain(said.title).split("; "),
            f"numbers    {out / 'report.json'}, {out / 'report.md'}",
            f"picture    {out / 'compare.png'}",
            *terminal.looked_at(out),
        ]
        console.print("\n".join(lines), soft_wrap=True)
    if asked.fail_if_worse and worse(said):
        raise typer.Exit(1)
