"""testbench dataset build DIR: simulated campaigns with their truth, for anybody's estimator."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from testbench.campaign.public_dataset import GRID, ROUNDS
from testbench.commands import dataset
from testbench.shell.options import Force, takes
from testbench.views.terminal import plain_console

group = typer.Typer(no_args_is_help=True)


@dataclass(frozen=True)
class Options:
    """Flags of the command."""

    out: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the dataset.")]
    campaigns: Annotated[
        int, typer.Option(min=GRID, max=GRID * 1000, help=f"How many, a multiple of {GRID}.")
    ] = GRID * ROUNDS
    seed: Annotated[int, typer.Option(min=0, max=2**62, help="Seed of the first campaign.")] = 100_000
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; default: one per core.")] = None
    force: Force = False


@group.callback()
def commands() -> None:
    """Make the public dataset of simulated campaigns."""


@group.command("build")
@takes(Options)
def build(asked: Options) -> None:
    """Simulate the campaigns; write readings, truth, card and metadata."""
    seeds = range(asked.seed, asked.seed + asked.campaigns)
    dataset.build(asked.out, seeds, asked.workers, plain_console(), force=asked.force)
