"""testbench elastic ARM FILE: the elastic arm as plain MJCF."""

from pathlib import Path
from typing import Annotated

import typer

from testbench.arm.folder import find_arm
from testbench.campaign.campaign import build_cell
from testbench.cli.arguments import ArmName
from testbench.commands.elastic import write_elastic
from testbench.errors import word
from testbench.output.place import Kind, claim_file
from testbench.shell.options import Force
from testbench.views.terminal import plain_console

ELASTIC = Kind("an elastic arm", rb"<mujoco [^>]*model=\"[^\"]*_elastic\"")


def command(
    arm: ArmName, file: Annotated[Path, typer.Argument(help="MJCF to write.")], force: Force = False
) -> None:
    """Write the arm with its springs."""
    with claim_file(file, ELASTIC, inputs=[find_arm(arm)], force=force):
        write_elastic(build_cell(arm).arm, file)
        console = plain_console()
        console.print(f"{file}; open it with: python -m mujoco.viewer --mjcf={word(file)}", soft_wrap=True)
