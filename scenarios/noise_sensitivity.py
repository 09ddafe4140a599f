"""What noise costs, by method and structure, and what better instruments are worth.

python scenarios/noise_sensitivity.py --out runs/noise_sensitivity
"""

import sys
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from testbench import files
from testbench.bench.campaign import Scenario, build_cell, simulate, stream
from testbench.data.csvfile import write_csv
from testbench.errors import BenchError
from testbench.shell import command
from testbench.shell.backend import Cluster, Insecure, Resume, Workers, choose_backend
from testbench.shell.progress import show_progress
from testbench.studies import sweeps
from testbench.studies.noise_sensitivity import figure as figures_noise
from testbench.studies.noise_sensitivity import summary as noise_report
from testbench.studies.noise_sensitivity import trial as noise
from testbench.studies.noise_sensitivity import words as noise_text
from testbench.trials import Experiment, open_store, run_study, write_parquet
from testbench.views import tables
from testbench.views.recording import write_sweep

ROOT = Path(__file__).resolve().parents[1]
SIX_DOF, HEAVY = ROOT / "models" / "arm_6r", ROOT / "models" / "kr500_l480"
QUICK, QUICK_TRIALS = noise.Study(gravity_trials=2, instrument_trials=1, distances=(4.0,)), 4
MOST_UM = 10_000.0
"""Largest noise that an instrument can have [um]."""

app = typer.Typer(add_completion=False)


@app.command()
def main(
    seed: Annotated[int, typer.Option(min=0, max=2**62, help="Root of all randomness.")] = 1,
    seeds: Annotated[int, typer.Option(min=1, help="Trials of the 108-run study.")] = 1000,
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("runs") / noise.NAME,
    quick: Annotated[bool, typer.Option("--quick", help="Four trials, one distance.")] = False,
    sigma_um: Annotated[
        list[float] | None, typer.Option(help="Noise of a reading along an axis, beside 0; again for more.")
    ] = None,
    workers: Workers = None,
    cluster: Cluster = None,
    insecure: Insecure = False,
    resume: Resume = False,
) -> None:
    """Identify from readings of ever more noise, and judge by the true deflections."""
    console = Console(highlight=False)
    settings = QUICK if quick else noise.Study()
    if sigma_um:
        settings = replace(settings, sigmas=_in_range(sigma_um))
    roots = range(seed, seed + (min(seeds, QUICK_TRIALS) if quick else seeds))
    backend = choose_backend(workers, cluster, insecure)
    plain: dict[str, Any] = asdict(settings)
    models = {arm.name: files.digests(arm) for arm in (SIX_DOF, HEAVY)}
    study = Experiment(noise.NAME, {"settings": plain, "models": models}, roots)
    work = partial(noise.trials, SIX_DOF, HEAVY, settings, seed)
    with open_store(out, study, row=noise.Row, resume=resume) as store, files.whole_folder(out) as folder:
        show_progress(run_study(work, store, backend), len(roots), "trials", console)
        rows = (asdict(row) for _, own in store.trials() for row in own)
        report = noise_report.summary(rows, settings, seed, len(roots))
        write_parquet(store, folder)
        cell = build_cell(HEAVY)
        clean = simulate(cell, Scenario(arm=HEAVY.name, noise=False), seed).identification
        first = noise.reread(clean, 50e-6, stream(seed, 1))
        write_csv(first, tuple(j.name for j in cell.arm.joints), folder / "dataset.csv")
        report["dataset"] = noise_report.dataset(first)
        files.write_json(report, folder / "report.json")
        (folder / "report.md").write_text(noise_text.markdown(report), encoding="utf-8")
        figures_noise.sensitivity(report, folder / "noise_sensitivity.png")
        write_sweep(folder / "recording.rrd", sweeps.noise(report, plain))
        files.write_manifest(
            folder,
            command=f"scenarios/{noise.NAME}.py",
            scenario=plain,
            seed=seed,
            seeds=len(roots),
            arms=[SIX_DOF, HEAVY],
        )
    console.print(noise_text.title(report))
    for part in noise_report.PARTS:
        console.print(noise_text.table(report, part))
    for text in noise_text.statements(report):
        console.print(f"- {text}")
    console.print(f"trials     {out / 'trials.parquet'}", soft_wrap=True)
    console.print(tables.where(out, figures=("noise_sensitivity.png",)), soft_wrap=True)


def _in_range(sigma_um: list[float]) -> tuple[float, ...]:
    """Levels in metres, ascending, none at all among them.

    Raises:
        BenchError: When one is out of range or there twice, or none is above 0.
    """
    for value in sigma_um:
        if not 0 <= value <= MOST_UM or sigma_um.count(value) > 1:
            raise BenchError(f"--sigma-um: expected different values of 0 to {MOST_UM:g}, got {value:g}")
    if max(sigma_um) == 0:
        raise BenchError("--sigma-um: expected at least one level above 0")
    return tuple(value / 1e6 for value in sorted({0.0, *sigma_um}))


if __name__ == "__main__":
    sys.exit(command.run(app))
