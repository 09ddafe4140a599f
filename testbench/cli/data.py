"""testbench data check ARM FILE: what is in a file of measured runs, and how it was understood."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from testbench.arm.folder import find_arm
from testbench.campaign.absolute import kinematic_misfit
from testbench.campaign.campaign import build_cell
from testbench.campaign.campaign_flags import ArmName, Readings
from testbench.campaign.propose_map import map_text, propose
from testbench.campaign.runs import files_read, look_at, read, register
from testbench.cli.arguments import ShownFolder
from testbench.commands.data import COMMAND, column_lines, column_rows, listed, report, understand, write
from testbench.data.read_series import read_series
from testbench.errors import BenchError, sheet_of
from testbench.output.place import Kind, check_file, claim_folder
from testbench.output.whole import whole_file
from testbench.shell.options import Force, takes
from testbench.shell.project import ProjectCommand
from testbench.views.terminal import looked_at, plain_console, print_words

group = typer.Typer(no_args_is_help=True)
MAP = Kind("a map that testbench data map wrote", b"# A map of ")


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    out: ShownFolder = None
    force: Force = False


@group.callback()
def commands() -> None:
    """Read a file of measured runs; say what was understood."""


@group.command("check", cls=ProjectCommand)
@takes(Readings, Options)
def check(runs: Readings, asked: Options) -> None:
    """Say which column is which quantity, what was assumed, and show the runs on the arm."""
    given = [find_arm(runs.arm), *files_read(runs)]
    with claim_folder(asked.out, COMMAND, own=frozenset(), inputs=given, force=asked.force):
        filed = build_cell(runs.arm)
        export = read(filed, runs)
        found, console = understand(export), plain_console()
        columns = "\n".join(listed(found))
        try:
            cell, registered = register(filed, export, runs)
        except BenchError:
            console.print(columns, soft_wrap=True)  # what was understood helps where no frame is found
            raise
        doubts, scale = look_at(filed, export, registered, runs)
        found.update(dataset=runs.dataset.name, scale=scale, doubts=[own.sentence for own in doubts])
        said = report(found, registered)
        lines = [columns]
        if asked.out is not None:
            write(cell, registered, said, runs.words, asked.out)
            lines += [
                f"picture    {asked.out / 'data.png'}",
                *looked_at(asked.out, arm=runs.arm, data=runs.dataset),
            ]
        print_words(console, said, lines=lines)


@dataclass(frozen=True)
class MapOptions:
    """Flags of the command that proposes a map."""

    arm: ArmName
    dataset: Annotated[
        Path, typer.Argument(help="Export of an instrument, any text table, or FILE.xlsx#SHEET.")
    ]
    log: Annotated[
        Path | None, typer.Option(help="The robot's joints in another file: joined by name, else by time.")
    ] = None
    out: Annotated[Path | None, typer.Option(help="Map to write; default: FILE.toml beside it.")] = None
    force: Force = False


@group.command("map", cls=ProjectCommand)
@takes(MapOptions)
def propose_map(asked: MapOptions) -> None:
    """Propose a map of an export, guesses as comments; show what it reads, and whether that fits the arm."""
    file = sheet_of(asked.dataset)[0]
    out, console = asked.out or file.with_suffix(".toml"), plain_console()
    inputs = [find_arm(asked.arm), file, *([asked.log] if asked.log else [])]
    check_file(out, MAP, inputs=inputs, force=asked.force)
    cell = build_cell(asked.arm)
    entries = propose(asked.dataset, cell.arm, asked.log, out.parent)
    with whole_file(out) as part:
        part.write_text(
            f"# A map of {file.name}, proposed by testbench data map\n{map_text(entries)}", "utf-8"
        )
    guesses = {why: [own.key for own in entries if own.why == why] for *_, why in entries if why}
    said = (f"guess      {', '.join(keys)}: {why}" for why, keys in guesses.items())
    console.print("\n".join([f"map        {out}", *said, ""]), soft_wrap=True)
    export = read_series(asked.dataset, cell.arm, out)
    rows = sum(one.rows for one in export.series)
    lines = [
        *column_lines(list(column_rows(export.columns))),
        "",
        *(f"- {note}" for note in export.notes),
    ]
    console.print("\n".join([*lines, f"{rows} readings"]), soft_wrap=True)
    off = 1e3 * kinematic_misfit(cell.vjm, export.series)
    console.print(f"They fit the arm as drawn to {off:.3g} mm (median).")
