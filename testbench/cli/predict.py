"""testbench predict MODEL POSES.csv --out DIR: where loads bring the tool, how sure, how stiff it is."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from testbench.arm.mjcf import GRAVITY
from testbench.campaign.arm_models import load_model
from testbench.campaign.campaign_flags import MapFile, Payload
from testbench.campaign.plan_input import box, overloads, payload_of
from testbench.campaign.program import FORCE, predicted, read_asked
from testbench.cli.arguments import ArmCheck, plain
from testbench.commands.predict import COMMAND, PICTURE, TABLE, printed, report, write
from testbench.model.poses import WorkArea
from testbench.output.place import claim_folder
from testbench.shell.options import Force, takes
from testbench.views.terminal import looked_at, plain_console, print_words


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    model: Annotated[Path, typer.Argument(help="Folder of an identified or calibrated arm.")]
    poses: Annotated[Path, typer.Argument(help="Poses and their loads: a program, tasks or a plan.")]
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("runs/predict")
    arm: ArmCheck = None
    mapping: MapFile = None
    payload: Payload = None
    linear: Annotated[
        bool, typer.Option("--linear", help="By Eq. (6) instead of the loaded equilibrium of Eq. (7).")
    ] = False
    push: Annotated[
        float | None,
        typer.Option(
            "--push", min=0.001, max=1e6, help="Force of the map in N; default: the weight of the payload."
        ),
    ] = None
    box: Annotated[
        str | None, typer.Option(help="Corners of the map in m, x0,y0,z0,x1,y1,z1; else the workspace.")
    ] = None
    force: Force = False


@takes(Options)
def command(asked: Options) -> None:
    """Predict where loads bring the tool, with intervals; map how stiff it is."""
    given = [asked.model, asked.poses, *([asked.mapping] if asked.mapping else [])]
    with claim_folder(asked.out, COMMAND, own=frozenset(), inputs=given, force=asked.force):
        area = None if asked.box is None else WorkArea(*box(asked.box))
        model = load_model(asked.model, asked.arm)
        poses = read_asked(
            asked.poses, model, asked.mapping, lambda: payload_of(model.arm, asked.payload, "--load")
        )
        console = plain_console()
        push = asked.push or (GRAVITY * model.arm.payload if model.arm.payload else FORCE)
        made = predicted(model, poses, push, area, linear=asked.linear)
        said, out = report(made), asked.out
        write(made, said, plain(asked, read="poses") | {"model": asked.model.name}, out)
        heavy = overloads(model.arm, poses.hung.tolist())
        lines = [
            *(f"- {words}" for words in heavy),
            f"poses      {out / TABLE}",
            f"report     {out / 'report.md'}, {out / 'report.json'}, {out / PICTURE}",
            *looked_at(out, model=asked.model),
        ]
        print_words(console, said, [printed(said)], lines)
