"""A scenario of nothing but trials, as the tests of the engine run it.

python tests/scenarios/trial_study.py --out runs/trials
"""

import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import trial_work
import typer
from rich.console import Console

from testbench.output.run import whole_folder
from testbench.shell import command
from testbench.shell.backend import choose_backend
from testbench.shell.options import Common, takes
from testbench.shell.progress import show_progress
from testbench.trials.engine import run_study
from testbench.trials.experiment import Experiment
from testbench.trials.store import open_store, write_parquet

FIRST = 5  # seed of the first trial

app = typer.Typer(add_completion=False)


@dataclass(frozen=True)
class Toy:
    """Flags of its own."""

    where: Annotated[Path, typer.Argument()]
    trials: int = 30
    pause: Annotated[float, typer.Option(help="Of every trial [s].")] = 0.0
    name: str = "toy"
    pids: Annotated[Path | None, typer.Option(help="Folder for a file named after every process.")] = None


@app.command()
@takes(Common, Toy)
def main(common: Common, toy: Toy) -> None:
    """Run trials of a toy."""
    console = Console(highlight=False)
    roots = range(FIRST, FIRST + toy.trials)
    study = Experiment(toy.name, {"size": trial_work.SIZE}, roots)
    work = partial(trial_work.trials, toy.pause, str(toy.pids) if toy.pids else "")
    chosen = choose_backend(common)
    with (
        open_store(toy.where, study, row=trial_work.Toy, resume=common.resume) as store,
        whole_folder(toy.where) as folder,
    ):
        counts = run_study(work, store, chosen, size=2)
        show_progress(counts, toy.trials, "trials", console)
        write_parquet(store, folder)


if __name__ == "__main__":
    sys.exit(command.run(app))
