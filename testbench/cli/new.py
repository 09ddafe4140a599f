"""testbench new NAME --from FILE: a robot's URDF or MJCF as an arm's folder."""

from pathlib import Path
from typing import Annotated

import typer

from testbench.campaign.campaign import build_cell
from testbench.campaign.new_arm import write_arm
from testbench.commands.new import read_wishes
from testbench.errors import BenchError, InputError, word
from testbench.output.place import new_folder
from testbench.plant.import_robot.chain import read_chain
from testbench.views.terminal import plain_console


def command(  # noqa: PLR0913
    name: Annotated[Path, typer.Argument(help="Folder to make.")],
    source: Annotated[Path, typer.Option("--from", help="The robot: URDF, or MJCF.")],
    tip: Annotated[
        str | None, typer.Option(help="Link, body or site where the tool is; else the end of the arm.")
    ] = None,
    payload_kg: Annotated[float | None, typer.Option(help="Rated payload; else by the arm's mass.")] = None,
    tool: Annotated[
        str | None, typer.Option(help="x,y,z[,rx,ry,rz] of the tool from the tip, m, deg.")
    ] = None,
    marker: Annotated[list[str] | None, typer.Option(help="NAME=x,y,z in the tool's frame, m.")] = None,
    load: Annotated[str | None, typer.Option(help="x,y,z of the load point in the tool's frame, m.")] = None,
) -> None:
    """Make an arm's folder from a robot's URDF or MJCF."""
    if not name.name:
        raise BenchError(f"NAME: expected the name of a new folder, got {str(name)!r}")
    wishes = read_wishes(payload_kg, tool, marker or [], load)
    with new_folder(name) as folder:
        chain = read_chain(source, tip)
        try:
            notes = write_arm(chain, wishes, folder)
            arm = build_cell(folder).arm
        except BenchError as err:  # which names a part of the robot
            raise InputError(source, "", str(err)) from err
    console = plain_console()
    first = f"{name}: {len(arm.joints)} joints, tool at {chain.tip.name!r}, {chain.mass:.4g} kg"
    last = f"next       testbench check {word(name)} --out runs/{word(Path(name.name))}"
    for line in (first, *(f"  {note}" for note in notes), last):
        console.print(line, soft_wrap=True)
