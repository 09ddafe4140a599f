"""testbench shot DIR: the newest recording of a run as a picture."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from testbench.cli.arguments import RunFolder
from testbench.output.place import PNG, check_file
from testbench.shell.options import Force, takes
from testbench.views.recording import viewer


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    folder: RunFolder
    out: Annotated[Path, typer.Option(help="PNG to write.")] = Path("recording.png")
    tab: Annotated[str | None, typer.Option(help="Tab in front, such as Errors.")] = None
    timeline: Annotated[str | None, typer.Option(help="Active timeline, such as load.")] = None
    at: Annotated[int, typer.Option(min=0, help="Place on the timeline.")] = 0
    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT in pixels.")] = "1600x1000"
    force: Force = False


@takes(Options)
def command(asked: Options) -> None:
    """Render it."""
    check_file(asked.out, PNG, inputs=[asked.folder], force=asked.force)
    sight = viewer.Sight(asked.size, asked.tab, asked.timeline, asked.at)
    file = viewer.shot(asked.folder, asked.out, sight)
    Console(highlight=False).print(f"{asked.out}: {file}", soft_wrap=True)
