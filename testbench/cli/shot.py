"""testbench shot DIR: the newest recording of a run as a picture, still or moving."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from testbench.cli.arguments import RunFolder
from testbench.errors import BenchError
from testbench.output.place import GIF, MP4, PNG, claim_file
from testbench.shell.options import Force, takes
from testbench.views.recording import shot
from testbench.views.terminal import plain_console

KINDS = {".png": PNG, ".gif": GIF, ".mp4": MP4}


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    folder: RunFolder
    out: Annotated[
        Path | None, typer.Option(help="Picture to write, .png, .gif or .mp4; default: recording.png.")
    ] = None
    gif: Annotated[bool, typer.Option("--gif", help="Moving along the timeline.")] = False
    tab: Annotated[str | None, typer.Option(help="Tab in front, such as Tables.")] = None
    timeline: Annotated[str | None, typer.Option(help="Active timeline, such as pose.")] = None
    at: Annotated[int | None, typer.Option(min=0, help="Place on the timeline; default: the first.")] = None
    size: Annotated[
        str | None,
        typer.Option(help=f"WIDTHxHEIGHT of the viewer in pixels; {shot.STILL}, moving {shot.MOVING}."),
    ] = None
    force: Force = False


@takes(Options)
def command(asked: Options) -> None:
    """Render it."""
    out = asked.out or Path("recording.gif" if asked.gif else "recording.png")
    suffixes = [".gif"] if asked.gif else list(KINDS)
    if out.suffix not in suffixes:
        raise BenchError(f"--out: expected a name that ends with {' or '.join(suffixes)}, got {out}")
    moving = out.suffix != ".png"
    if moving and asked.at is not None:
        raise BenchError(f"--at: {out} moves along the whole timeline; a .png shows one place")
    with claim_file(out, KINDS[out.suffix], inputs=[asked.folder], force=asked.force):
        sight = shot.Sight(asked.size, asked.tab, asked.timeline, asked.at)
        file = (shot.film if moving else shot.shot)(asked.folder, out, sight)
        plain_console().print(f"{out}: {file}", soft_wrap=True)
