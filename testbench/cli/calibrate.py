"""testbench calibrate ARM READINGS.csv ... --out MODEL: geometry, gears, elasticity by absolute readings."""

from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from testbench.arm.catalogue import find_arm
from testbench.campaign.absolute import calibrated, read_all
from testbench.campaign.campaign import build_cell
from testbench.campaign.plan import gain_of_more
from testbench.cli.arguments import ArmName, MapFile, SigmaUm, plain
from testbench.commands.calibrate import COMMAND, PICTURE, report, seen, write
from testbench.commands.calibrate_numbers import left_of
from testbench.errors import PoseError
from testbench.identify.absolute.fit import NAMES, ORDERS
from testbench.identify.absolute.fit import Options as Tried
from testbench.identify.absolute.posterior import model_of
from testbench.output.place import claim_folder
from testbench.shell.options import Force, of_flag, takes
from testbench.views.terminal import looked_at, plain_console, print_words


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    arm: ArmName
    readings: Annotated[
        list[Path], typer.Argument(help="Absolute readings, CSV, any other text table, or FILE.xlsx#SHEET.")
    ]
    out: Annotated[Path, typer.Option(help="Folder of the calibrated arm.")] = Path("runs/calibrate")
    mapping: MapFile = None
    sigma_um: SigmaUm = None
    without: Annotated[
        list[str] | None, typer.Option(help=f"Errors not to try: {', '.join(NAMES)}; again for more.")
    ] = None
    orders: Annotated[
        int, typer.Option(min=1, max=400, help="Highest order of periodic errors; too low biases the fit.")
    ] = ORDERS
    least_squares: Annotated[
        bool, typer.Option("--least-squares", help="Least squares, not GCO: compliances may be negative.")
    ] = False
    force: Force = False


@takes(Options)
def command(asked: Options) -> None:
    """Calibrate an arm by where a tracker saw its tool; write the model."""
    arm = find_arm(asked.arm)
    given = [*asked.readings, *([asked.mapping] if asked.mapping else [])]
    with claim_folder(asked.out, COMMAND, own=frozenset(), inputs=[arm, *given], force=asked.force):
        cell = build_cell(asked.arm)
        sigma = None if asked.sigma_um is None else 1e-6 * asked.sigma_um
        series, notes = read_all(asked.readings, cell.arm, asked.mapping, sigma)
        with of_flag("--without"):
            tried = Tried(orders=asked.orders, without=frozenset(asked.without or ()))
        if asked.least_squares:
            tried = replace(tried, constraint="none")
        console = plain_console()
        with console.status("calibrating") as status:
            found = calibrated(cell.vjm, series, tried, notes)
            status.update("writing")
            left = left_of(found)
            more = None
            with suppress(PoseError):  # an arm that can be nowhere has no workspace
                more = gain_of_more(cell, model_of(found.calibration), series[0].sigma)
            said = report(found, left, more)
            write(found, said, seen(cell, found, left), plain(asked, "readings", without=("arm",)), asked.out)
        out = asked.out
        lines = [
            *(f"- {note}" for note in found.notes),
            f"model      {out / 'model.json'}",
            f"report     {out / 'report.md'}, {out / 'report.json'}, {out / PICTURE}",
            *looked_at(out),
        ]
        print_words(console, said, [said.tables["steps"]], lines)
