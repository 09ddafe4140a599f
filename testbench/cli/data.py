"""testbench data check ARM FILE: what is in a file of measured runs, and how it was understood."""

from dataclasses import dataclass

import typer

from testbench.arm.catalogue import find_arm
from testbench.campaign.campaign import build_cell
from testbench.campaign.runs import files_read, look_at, read, register
from testbench.cli.arguments import RunFlags, ShownFolder, claimed
from testbench.commands.data import COMMAND, listed, report, understand, write
from testbench.errors import BenchError
from testbench.shell.options import Force, takes
from testbench.shell.project import ProjectCommand
from testbench.views.terminal import looked_at, plain_console, print_words

group = typer.Typer(no_args_is_help=True)


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    out: ShownFolder = None
    force: Force = False


@group.callback()
def commands() -> None:
    """Read a file of measured runs; say what was understood."""


@group.command("check", cls=ProjectCommand)
@takes(RunFlags, Options)
def check(runs: RunFlags, asked: Options) -> None:
    """Say which column is which quantity, what was assumed, and show the runs on the arm."""
    arm, given = find_arm(runs.arm), runs.readings
    with claimed(asked.out, COMMAND, [arm, *files_read(given)], force=asked.force):
        filed = build_cell(runs.arm)
        export = read(filed, given)
        found, console = understand(export), plain_console()
        columns = "\n".join(listed(found))
        try:
            cell, registered = register(filed, export, given)
        except BenchError:
            console.print(columns, soft_wrap=True)  # what was understood helps where no frame is found
            raise
        doubts, scale = look_at(filed, export, registered, given)
        found.update(dataset=runs.dataset.name, scale=scale, doubts=[own.sentence for own in doubts])
        said = report(found, registered)
        lines = [columns]
        if asked.out is not None:
            write(cell, registered, said, asked.out)
            lines += [
                f"picture    {asked.out / 'data.png'}",
                *looked_at(asked.out, arm=runs.arm, data=runs.dataset),
            ]
        print_words(console, said, lines=lines)
