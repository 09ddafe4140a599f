"""A scenario of nothing but trials, as the tests of the engine run it.

python tests/scenarios/trial_study.py runs/trials
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import trial_work
import typer

from testbench.runs import command, interrupt
from testbench.runs.engine import run_study
from testbench.runs.store import TrialPlan, open_store, write_parquet
from testbench.runs.whole import claimed, whole_folder
from testbench.studies.run import choose_backend, show_progress
from testbench.workflows.options import Common, takes

FIRST = 5  # seed of the first trial

app = typer.Typer(add_completion=False)


@dataclass(frozen=True)
class Toy:
    """Flags of its own."""

    where: Annotated[Path, typer.Argument()]
    trials: int = 30
    name: str = "toy"
    pids: Annotated[Path | None, typer.Option(help="Folder for a file named after every process.")] = None
    endless: Annotated[bool, typer.Option(help="Late trials never end.")] = False


@app.command()
@takes(Common, Toy)
def main(common: Common, toy: Toy) -> None:
    """Run trials of a toy."""
    roots = range(FIRST, FIRST + toy.trials)
    study = TrialPlan(toy.name, {"size": trial_work.SIZE}, roots)
    pids = str(toy.pids) if toy.pids else ""
    work = partial(trial_work.endless_trials if toy.endless else trial_work.trials, 0.0, pids)
    chosen = choose_backend(common)
    with (
        claimed(toy.where),
        open_store(toy.where, study, row=trial_work.Toy, resume=common.resume) as store,
        whole_folder(toy.where) as folder,
    ):
        counts = run_study(work, store, chosen, size=2)
        show_progress(counts, toy.trials, "trials")
        write_parquet(store, folder)


if __name__ == "__main__":
    interrupt.leave(command.run(app))
