"""testbench identifiability ARM DATA: what runs can tell of a model, before any fit."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from testbench.bench.campaign import build_cell
from testbench.bench.models import named_models, plain_name
from testbench.cli.arguments import ArmName, Dataset
from testbench.data.csvfile import read_csv
from testbench.errors import InputError
from testbench.identify.identifiability import describe
from testbench.identify.prior import Strength, cad_prior
from testbench.views import terminal
from testbench.views.identifiability.figure import shares
from testbench.views.identifiability.report import seen_report, table


def command(
    arm: ArmName,
    dataset: Dataset,
    model: Annotated[
        str | None, typer.Option(help="Model whose parameters are asked for: MGCO68 of six joints.")
    ] = None,
    uncertainty_percent: Annotated[float, typer.Option(help="Of the CAD prior of the arm's folder.")] = 30.0,
    figure: Annotated[Path | None, typer.Option(help="PNG to write.")] = None,
) -> None:
    """Say what is seen, what is not, and what would help."""
    cell = build_cell(arm)
    if figure is not None and (figure.suffix != ".png" or not figure.parent.is_dir()):
        raise InputError(figure, "", "expected the name of a .png in a folder that exists")
    [entry] = named_models(cell, [model or plain_name(cell.arm)])
    data = read_csv(dataset, cell.arm)
    strength = Strength(uncertainty_percent / 100)
    seen = seen_report(describe(cell.vjm, entry.structure, data, cad_prior(cell.arm), strength))
    console = Console(highlight=False)
    console.print(terminal.grid(table(seen)))
    for sentence in seen.sentences:
        console.print(f"- {sentence}", markup=False)
    if figure is not None:
        shares(seen).savefig(figure, dpi=120)
        console.print(f"figure     {figure}", soft_wrap=True)
