"""testbench calibrate ARM READINGS.csv ... --out MODEL: geometry, gears, elasticity by absolute readings."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, TypeVar

import typer

from testbench.arm.folder import find_arm
from testbench.campaign.absolute import File, calibrated, read_all
from testbench.campaign.campaign import build_cell
from testbench.campaign.campaign_flags import ArmName, SigmaUm, mass
from testbench.campaign.plan import gain_of_more
from testbench.cli.arguments import plain
from testbench.commands.calibrate import COMMAND, PICTURE, report, seen, write
from testbench.commands.calibrate_numbers import left_of
from testbench.errors import BenchError, PoseError
from testbench.identify.absolute.fit import NAMES, ORDERS
from testbench.identify.absolute.fit import Options as Tried
from testbench.identify.absolute.posterior import model_of
from testbench.output.place import claim_folder
from testbench.shell.options import Force, of_flag, takes
from testbench.views.terminal import looked_at, plain_console, print_words

EACH = "Again: one for each file."
T = TypeVar("T")


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    arm: ArmName
    readings: Annotated[
        list[Path], typer.Argument(help="Absolute readings, CSV, any other text table, or FILE.xlsx#SHEET.")
    ]
    out: Annotated[Path, typer.Option(help="Folder of the calibrated arm.")] = Path("runs/calibrate")
    mapping: Annotated[
        list[Path] | None,
        typer.Option("--map", help="TOML file that says how tables name our quantities. " + EACH),
    ] = None
    sigma_um: SigmaUm = None
    load: Annotated[
        list[float] | None,
        typer.Option(
            parser=mass, metavar="MASS", help="Hangs in loaded rows where a file gives none. " + EACH
        ),
    ] = None
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
    given = [arm, *asked.readings, *filter(None, asked.mapping or [])]
    with claim_folder(asked.out, COMMAND, own=frozenset(), inputs=given, force=asked.force):
        cell = build_cell(asked.arm)
        series, notes = read_all(_files(asked), cell.arm)
        with of_flag("--without"):
            tried = Tried(orders=asked.orders, without=frozenset(asked.without or ()))
        if asked.least_squares:
            tried = replace(tried, constraint="none")
        console = plain_console()
        found = calibrated(cell.vjm, series, tried, notes)
        left = left_of(found)
        more = None
        with suppress(PoseError):  # an arm that can be nowhere has no workspace
            more = gain_of_more(cell, model_of(found.calibration), series[0].sigma)
        said = report(found, left, more)
        if said.numbers["rejected"]:
            nothing = "rejected   nothing is written: such a model is worse than none"
            print_words(console, said, [], [*(f"- {note}" for note in found.notes), nothing])
            raise typer.Exit(1)
        drawn = seen(cell, found, left)
        write(found, said, drawn, plain(asked, read="readings", without=("arm",)), asked.out)
        out = asked.out
        lines = [
            *(f"- {note}" for note in found.notes),
            f"model      {out / 'model.json'}",
            f"report     {out / 'report.md'}, {out / 'report.json'}, {out / PICTURE}",
            *looked_at(out),
        ]
        print_words(console, said, [said.tables["steps"]], lines)


def _files(asked: Options) -> list[File]:
    """The files of readings, each with its map and load."""
    count = len(asked.readings)
    both = zip(_each("--map", asked.mapping, count), _each("--load", asked.load, count), strict=True)
    return [File(path, *own, asked.sigma_um) for path, own in zip(asked.readings, both, strict=True)]


def _each(flag: str, given: Sequence[T] | None, count: int) -> Sequence[T | None]:
    """What a flag says of every file; BenchError where it stands neither once nor once a file."""
    if given and len(given) not in (1, count):
        raise BenchError(f"{flag}: expected it once, or once for each of {count} files, got {len(given)}")
    return given if given and len(given) == count else [given[0] if given else None] * count
