"""testbench init: the project file of a cell, from what it is told and what it finds in this folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from testbench.campaign.plan_input import place
from testbench.cli.arguments import FrameName, MapFile, SigmaUm
from testbench.commands.init import found_here, project_text
from testbench.errors import BenchError
from testbench.output.place import Kind, claim_file, look
from testbench.output.whole import whole_file
from testbench.shell.options import Force, takes
from testbench.shell.project import NAME, Project, parse_project
from testbench.views.terminal import plain_console

PROJECT = Kind("a project file", b"# What testbench takes")


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    arm: Annotated[str | None, typer.Option(help="Folder of the arm; default: the only one here.")] = None
    urdf: Annotated[Path | None, typer.Option(help="The robot's own; default: the only one here.")] = None
    mapping: MapFile = None
    sigma_um: SigmaUm = None
    frame: FrameName = "auto"
    target: Annotated[list[str] | None, typer.Option(help="Target that the arm's folder lacks.")] = None
    tracker: Annotated[str | None, typer.Option(help="Where it stands: x,y,z in m.")] = None
    load: Annotated[list[str] | None, typer.Option(help="To hang when measuring, such as 240.")] = None
    payload: Annotated[str | None, typer.Option(help="That programs carry, such as 120kg.")] = None
    force: Force = False


@takes(Options)
def command(asked: Options) -> None:
    """Write testbench.toml into this folder: commands that start here need none of its flags."""
    if look(NAME) is not None and not asked.force:
        raise BenchError(f"{NAME}: exists already; edit it, or --force to write it anew")
    told: dict[str, object] = {
        "arm": asked.arm,
        "urdf": asked.urdf and str(asked.urdf),
        "map": asked.mapping and str(asked.mapping),
        "sigma_um": asked.sigma_um,
        "frame": None if asked.frame == "auto" else asked.frame,
        "targets": asked.target,
        "tracker": None if asked.tracker is None else list(place(asked.tracker)),
        "load": asked.load,
        "payload": asked.payload,
    }
    found = found_here(Path())
    both = {**found, **{key: value for key, value in told.items() if value}}
    values = {key: both[key] for key in Project.model_fields if key in both}
    text = project_text(values)
    parse_project(NAME, text)
    with claim_file(NAME, PROJECT, inputs=[], force=True), whole_file(NAME) as part:
        part.write_text(text, encoding="utf-8")
    names = [f"{key} ({'told' if told.get(key) else 'found'})" for key in values]
    plain_console().print(f"{NAME}: {', '.join(names) or 'all keys as comments'}", soft_wrap=True)
