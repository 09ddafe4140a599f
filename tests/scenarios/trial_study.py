"""A scenario of nothing but trials, as the tests of the engine run it.

python tests/scenarios/trial_study.py --out runs/trials
"""

import sys
from functools import partial
from pathlib import Path
from typing import Annotated

import trial_work
import typer
from rich.console import Console

from testbench import files
from testbench.shell import backend as options
from testbench.shell import command
from testbench.shell.progress import show_progress
from testbench.trials import Experiment, open_store, run_study, write_parquet

app = typer.Typer(add_completion=False)


@app.command()
def main(
    out: Path,
    seed: int = 5,
    trials: int = 30,
    pause: Annotated[float, typer.Option(help="Of every trial [s].")] = 0.0,
    name: str = "toy",
    pids: Annotated[Path | None, typer.Option(help="Folder for a file named after every process.")] = None,
    workers: options.Workers = None,
    cluster: options.Cluster = None,
    insecure: options.Insecure = False,
    resume: options.Resume = False,
) -> None:
    """Run trials of a toy."""
    console = Console(highlight=False)
    study = Experiment(name, {"size": trial_work.SIZE}, range(seed, seed + trials))
    work = partial(trial_work.trials, pause, str(pids) if pids else "")
    chosen = options.choose_backend(workers, cluster, insecure)
    with (
        open_store(out, study, row=trial_work.Toy, resume=resume) as store,
        files.whole_folder(out) as folder,
    ):
        counts = run_study(work, store, chosen, size=2)
        show_progress(counts, trials, "trials", console)
        write_parquet(store, folder)


if __name__ == "__main__":
    sys.exit(command.run(app))
