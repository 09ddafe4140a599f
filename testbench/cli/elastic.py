"""testbench elastic ARM FILE: the elastic arm as plain MJCF."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from testbench.arm.folder import load_arm
from testbench.cli.arguments import ArmName
from testbench.plant import write_elastic


def command(arm: ArmName, file: Annotated[Path, typer.Argument(help="MJCF to write.")]) -> None:
    """Write the arm with its springs."""
    write_elastic(load_arm(arm), file)
    console = Console(highlight=False)
    console.print(f"{file}; open it with: python -m mujoco.viewer --mjcf={file}", soft_wrap=True)
