"""testbench identifiability ARM DATA: what runs can tell of a model, before any fit."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.markdown import Markdown

from testbench.arm.folder import find_arm
from testbench.campaign.campaign import build_cell
from testbench.campaign.campaign_flags import Readings
from testbench.campaign.identifiability import describe
from testbench.campaign.models import named_models, plain_name
from testbench.campaign.registration_notes import registration_notes
from testbench.campaign.runs import files_read, read, register
from testbench.commands.identifiability import report, write
from testbench.identify.prior import Strength, cad_prior
from testbench.output.place import PNG, check_file
from testbench.output.whole import whole_file
from testbench.shell.options import Force, of_flag, takes
from testbench.views import terminal


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    model: Annotated[
        str | None, typer.Option(help="Model whose parameters are checked; default for six joints: MGCO68.")
    ] = None
    uncertainty_percent: Annotated[
        float, typer.Option(min=1e-4, max=1e8, help="Uncertainty of the CAD prior from the arm's folder.")
    ] = 30.0
    more: Annotated[bool, typer.Option("--more", help="List every unobservable direction.")] = False
    figure: Annotated[Path | None, typer.Option(help="PNG to write.")] = None
    force: Force = False


@takes(Readings, Options)
def command(runs: Readings, asked: Options) -> None:
    """Say what is seen, what is not, and what would help."""
    png = asked.figure
    if png is not None:
        check_file(png, PNG, inputs=[find_arm(runs.arm), *files_read(runs)], force=asked.force)
    cell = build_cell(runs.arm)
    with of_flag("--model"):
        [entry] = named_models(cell, [asked.model or plain_name(cell)])
    export = read(cell, runs)
    cell, found = register(cell, export, runs)
    strength = Strength(asked.uncertainty_percent / 100)
    told = describe(cell.vjm, entry.structure, found.data, cad_prior(cell.arm), strength)
    said = report(told, cell.arm.name)
    console = terminal.plain_console()
    console.print(terminal.as_plain(said.title))
    where = "" if asked.more else "with --more"
    terminal.print_words(console, said, [said.tables["help"]], where=where)
    if asked.more:
        console.print(Markdown(said.block("more")))
    console.print(
        "\n".join(f"- {note}" for note in (*export.notes, *registration_notes(found))), soft_wrap=True
    )
    if png is not None:
        with whole_file(png) as part:
            write(said, part)
        console.print(f"figure     {png}", soft_wrap=True)
