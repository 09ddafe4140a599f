"""testbench view DIR: the newest recording of a run in the viewer, in a window or in a browser."""

import getpass
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from testbench.cli.arguments import RunFolder
from testbench.errors import BenchError, Interrupted, word
from testbench.output.manifest import read_manifest
from testbench.shell.options import takes
from testbench.shell.serve import HERE, Server
from testbench.views.recording import viewer
from testbench.views.recording.viewer import opener, web_viewer
from testbench.views.terminal import plain_console

PAGE = "report.html"
RECORDING, FILE, VIEWER = "recording", "recording.rrd", "viewer/"
"""Paths of what is served beside the run's own files: what opens the recording, itself, and the viewer."""


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    folder: RunFolder
    web: Annotated[
        bool, typer.Option("--web", help="Serve recording and page to a browser of this machine.")
    ] = False
    port: Annotated[int | None, typer.Option(min=1024, max=65535, help="Of --web; default: a free one.")] = (
        None
    )


@takes(Options)
def command(asked: Options) -> None:
    """Open it."""
    if asked.port is not None and not asked.web:
        raise BenchError("--port: expected with --web")
    file = viewer.newest(asked.folder)
    if asked.web:
        viewer.check_whole(file)
        _serve(file, asked.port or 0)
    if not viewer.has_display():
        raise BenchError(f"no display to open {file} on: {_ways(asked.folder, file)}")
    viewer.check_whole(file)
    viewer.view(file)


def _ways(folder: Path, file: Path) -> str:
    """What there is without a display."""
    run = word(folder)
    page = file.with_name(PAGE)
    more = f", {page} opens anywhere" if page.is_file() else ""
    return f"`testbench view {run} --web` shows it in a browser, `testbench shot {run}` as a picture{more}"


def _serve(file: Path, port: int) -> None:
    """Serve a recording and its run's page until Ctrl-C.

    Raises:
        Interrupted: In the end.
    """
    run, start = _of_run(file), opener(FILE, VIEWER)
    content: dict[str, bytes | Path] = {f"{VIEWER}{name}": data for name, data in web_viewer().items()}
    content |= {"": run.get(PAGE, start), RECORDING: start, FILE: file, **run}
    with Server(content, port) as server:
        root, to = server.root, f"{server.port}:{HERE}:{server.port}"
        page = f"{root}{PAGE}" if PAGE in run else f"none: {file.parent} has no {PAGE}"
        plain_console().print(
            f"recording  {root}{RECORDING}\npage       {page}\n"
            f"elsewhere  ssh -C -N -L {to} {getpass.getuser()}@{os.uname().nodename}, then the same there\n"
            "Ctrl-C ends it",
            soft_wrap=True,
        )
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            raise Interrupted(f"nothing is served any more on {HERE}:{server.port}") from None


def _of_run(file: Path) -> dict[str, Path]:
    """The page and the figures of a recording's run by their paths, and nothing else of its folder."""
    listed = read_manifest(file.parent).files or {PAGE}
    own = [path for path in file.parent.iterdir() if path.name == PAGE or path.suffix == ".png"]
    return {p.name: p for p in own if p.name in listed and p.is_file() and not p.is_symlink()}
