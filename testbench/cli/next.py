"""testbench next RUN: what was done, what is missing, the next command."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from testbench.errors import BenchError, shown
from testbench.output.manifest import NAME, read_manifest
from testbench.output.next_step import next_lines
from testbench.shell.options import takes
from testbench.views.terminal import plain_console

RUNS = Path("runs")  #: Where commands leave their folders.


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    run: Annotated[Path | None, typer.Argument(help="Folder of a run; default: the newest one in runs/.")] = (
        None
    )


@takes(Options)
def command(asked: Options) -> None:
    """Say what was done, what is missing, and the next command."""
    run = asked.run or _newest()
    about = read_manifest(run)
    if not about.command:
        raise BenchError(f"{run}: expected the folder of a finished run, with {NAME}")
    lines = next_lines(run) or ["nothing follows by itself: testbench --help lists the commands"]
    of = "".join(f" {shown(name)}" for name in about.models)
    plain_console().print(
        "\n".join([f"done       {shown(about.command)}{of}: {run}", *lines]), soft_wrap=True
    )


def _newest() -> Path:
    """The run that was finished last."""
    finished = [path for path in RUNS.glob(f"*/{NAME}") if read_manifest(path.parent).command]
    if not finished:
        raise BenchError(
            f"{RUNS}: expected the folder of a run, there is none; begin with "
            "`testbench new my_arm --from ROBOT.urdf`, or `testbench demo`"
        )
    return max(finished, key=lambda path: path.stat().st_mtime).parent
