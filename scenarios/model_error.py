"""What the model does not know: each disturbance of the true arm alone and all together, beside the noise.

python scenarios/model_error.py --out runs/model_error
"""

import sys
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from testbench import files
from testbench.bench.campaign import Scenario, build_cell, simulate, stream
from testbench.data.csvfile import write_csv
from testbench.shell import command
from testbench.shell.backend import Cluster, Insecure, Resume, Workers, choose_backend
from testbench.shell.progress import show_progress
from testbench.studies import sweeps
from testbench.studies.model_error import summary as model_error_report
from testbench.studies.model_error import trial as model_error
from testbench.studies.model_error import words as model_error_text
from testbench.studies.noise_sensitivity import figure as figures_noise
from testbench.studies.noise_sensitivity.summary import dataset
from testbench.studies.noise_sensitivity.trial import reread
from testbench.trials import Experiment, open_store, run_study, write_parquet
from testbench.views import tables
from testbench.views.recording import write_sweep

ROOT = Path(__file__).resolve().parents[1]
QUICK_TRIALS = 2

app = typer.Typer(add_completion=False)


@app.command()
def main(
    seed: Annotated[int, typer.Option(min=0, max=2**62, help="Root of all randomness.")] = 1,
    seeds: Annotated[int, typer.Option(min=1, help="Trials.")] = 100,
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("runs") / model_error.NAME,
    quick: Annotated[bool, typer.Option("--quick", help="Two trials, fewer poses.")] = False,
    scale: Annotated[
        float, typer.Option(min=0, max=10, help="Size of every disturbance over its typical one.")
    ] = 1.0,
    only: Annotated[
        list[str] | None, typer.Option(help="Switch on this disturbance alone; again for more.")
    ] = None,
    sigma_um: Annotated[float, typer.Option(min=0.001, max=10_000, help="Noise of a reading.")] = 50.0,
    arm: Annotated[Path, typer.Option(help="Folder of the arm.")] = ROOT / "models" / "kr500_l480",
    workers: Workers = None,
    cluster: Cluster = None,
    insecure: Insecure = False,
    resume: Resume = False,
) -> None:
    """Identify an arm that does what the model does not know, with noise and without."""
    console = Console(highlight=False)
    settings = model_error.Study(scale, sigma_um / 1e6, 20 if quick else 100, tuple(only or ()))
    roots = range(seed, seed + (min(seeds, QUICK_TRIALS) if quick else seeds))
    backend = choose_backend(workers, cluster, insecure)
    cell = build_cell(arm)
    plain: dict[str, Any] = {**asdict(settings), "cases": model_error.sizes(scale, settings.only)}
    study = Experiment(model_error.NAME, {"settings": plain, "models": files.digests(arm)}, roots)
    work = partial(model_error.trials, arm, settings)
    with (
        open_store(out, study, row=model_error.Row, resume=resume) as store,
        files.whole_folder(out) as folder,
    ):
        show_progress(run_study(work, store, backend), len(roots), "trials", console)
        rows = (asdict(row) for _, own in store.trials() for row in own)
        report = model_error_report.summary(rows, settings, cell.arm.name, seed, len(roots))
        write_parquet(store, folder)
        campaign = simulate(cell, Scenario(arm=cell.arm.name, noise=False, workspace_poses=1), seed)
        every = model_error.cases(scale, settings.only)[model_error.ALL]
        clean, _ = model_error.disturbed(cell, campaign, every, seed)
        first = reread(clean, settings.sigma, stream(seed, 1))
        write_csv(first, tuple(j.name for j in cell.arm.joints), folder / "dataset.csv")
        report["dataset"] = dataset(first)
        files.write_json(report, folder / "report.json")
        (folder / "report.md").write_text(model_error_text.markdown(report), encoding="utf-8")
        figures_noise.disturbances(report, folder / "model_error.png")
        write_sweep(folder / "recording.rrd", sweeps.model_error(report, plain))
        files.write_manifest(
            folder,
            command=f"scenarios/{model_error.NAME}.py",
            scenario=plain,
            seed=seed,
            seeds=len(roots),
            arms=[arm],
        )
    console.print(model_error_text.title(report))
    console.print(model_error_text.table(report))
    for text in model_error_text.statements(report):
        console.print(f"- {text}")
    console.print(f"trials     {out / 'trials.parquet'}", soft_wrap=True)
    console.print(tables.where(out, figures=("model_error.png",)), soft_wrap=True)


if __name__ == "__main__":
    sys.exit(command.run(app))
