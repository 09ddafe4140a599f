"""testbench score MODEL READINGS.csv: how far a calibrated arm is from readings that it never saw."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import typer

from testbench import files
from testbench.campaign.absolute import File, read_all, score
from testbench.campaign.arm_models import read_model
from testbench.campaign.campaign_flags import Load, MapFile, SigmaUm
from testbench.errors import sheet_of
from testbench.identify.registration import POSES
from testbench.shell.options import takes
from testbench.views.terminal import plain_console


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    model: Annotated[Path, typer.Argument(help="Folder of a calibrated arm.")]
    readings: Annotated[
        Path, typer.Argument(help="Absolute readings, CSV, any other text table, or FILE.xlsx#SHEET.")
    ]
    mapping: MapFile = None
    sigma_um: SigmaUm = None
    load: Load = None
    frame_poses: Annotated[
        int | None,
        typer.Option(
            min=POSES, help="Evenly spaced poses that register frame and target of a new series; not scored."
        ),
    ] = None
    at_most: Annotated[
        float | None,
        typer.Option(min=0, help="Largest mean distance that passes, in mm; above, exit with 1."),
    ] = None
    json: Annotated[bool, typer.Option("--json", help="Print the numbers as JSON, nothing else.")] = False


@takes(Options)
def command(asked: Options) -> None:
    """Compare positions with those of a calibrated arm; of a new series fit frame and target only."""
    model = read_model(asked.model)
    file = File(asked.readings, asked.mapping, asked.load, asked.sigma_um)
    series, notes = read_all([file], model.arm)
    if files.digest(sheet_of(asked.readings)[0]) in model.about.data.values():
        notes += ("the fit had these very readings: only others say how far it can be believed",)
    found = score(model, series, asked.frame_poses)
    failed = asked.at_most is not None and not found.mean_mm <= asked.at_most
    if asked.json:
        typer.echo(json.dumps(asdict(found)))
        if failed:
            raise typer.Exit(1)
        return
    verdict = ""
    if asked.at_most is not None:
        side = "more" if failed else "not more"
        head = "Do not use" if failed else "Holds"
        verdict = f"{head}: {found.mean_mm:.3f} mm mean are {side} than {asked.at_most:g} mm"
    console = plain_console()
    lines = [
        *filter(None, [verdict]),
        *notes,
        f"{found.n} positions: {found.mean_mm:.3f} mm mean, {found.rms_mm:.3f} RMS, "
        f"{found.p95_mm:.3f} for 95 %, {found.max_mm:.3f} at most",
        f"{100 * found.coverage_95:.1f} % lie inside their 95 % interval",
    ]
    console.print("\n".join(lines), soft_wrap=True)
    if failed:
        raise typer.Exit(1)
