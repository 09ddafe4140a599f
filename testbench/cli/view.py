"""testbench view DIR: the newest recording of a run in the Rerun viewer, in a window or in a browser."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from testbench.errors import BenchError, shell_word
from testbench.report.recording import stream as viewer
from testbench.workflows.options import RunFolder, takes

PAGE = "report.html"


@dataclass(frozen=True)
class ViewOptions:
    """Hold the flags of the command."""

    folder: RunFolder
    web: Annotated[bool, typer.Option("--web", help="Open the viewer in a browser; print the address.")] = (
        False
    )


@takes(ViewOptions)
def command(asked: ViewOptions) -> None:
    """Open it."""
    file = viewer.newest(asked.folder)
    if not asked.web and not viewer.has_display():
        raise BenchError(f"there is no display to open {file}: {_other_ways(asked.folder, file)}")
    viewer.check_whole(file)
    viewer.view(file, web=asked.web)


def _other_ways(folder: Path, file: Path) -> str:
    """Say what there is without a display."""
    page = file.with_name(PAGE)
    more = f", {page} opens anywhere" if page.is_file() else ""
    return f"`testbench view {shell_word(folder)} --web` shows it in a browser{more}"
