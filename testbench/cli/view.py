"""testbench view DIR: the newest recording of a run in the Rerun viewer, in a window or in a browser."""

from dataclasses import dataclass
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
        page = file.with_name(PAGE)
        more = f", {page} opens anywhere" if page.is_file() else ""
        way = f"`testbench view {shell_word(asked.folder)} --web` shows it in a browser{more}"
        raise BenchError(f"there is no display to open {file}: {way}")
    viewer.check_whole(file)
    viewer.view(file, web=asked.web)
