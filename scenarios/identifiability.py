"""What the data cannot see: the KR 500 under gravity, with and without a prior, right and wrong.

python scenarios/identifiability.py --out runs/identifiability
"""

import sys
import time
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import track

from testbench import files
from testbench.bench.campaign import Scenario, build_cell, simulate
from testbench.data.csvfile import write_csv
from testbench.identify.identifiability import describe
from testbench.identify.prior import Strength, cad_prior
from testbench.model.structure import mgco68
from testbench.shell import command
from testbench.studies import sweeps
from testbench.studies.identifiability import figure as figures_identifiability
from testbench.studies.identifiability import trial as identifiability
from testbench.studies.identifiability import words as identifiability_text
from testbench.studies.identifiability.coverage import bent_table, coverage_table
from testbench.trials import run_trials
from testbench.views import tables
from testbench.views.identifiability.figure import shares
from testbench.views.identifiability.report import seen_report
from testbench.views.recording import write_sweep

ROOT = Path(__file__).resolve().parents[1]
SIX_DOF = ROOT / "models" / "arm_6r"
DATASETS, BOOTSTRAPS, QUICK_DATASETS = 1000, 100, 10
QUICK = identifiability.Study(
    structures=("MGCO56", "MGCO68"),
    scales=(0.5, 2.0),
    poses=(8, 20),
    choice=("joints", "MGCO56", "MGCO68"),
)

app = typer.Typer(add_completion=False)


@app.command()
def main(
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Root of all randomness.")] = 1,
    seeds: Annotated[int, typer.Option(min=1, help="That many seeds: median and spread.")] = 20,
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("runs") / identifiability.NAME,
    quick: Annotated[bool, typer.Option("--quick", help="Two seeds, fewer variants.")] = False,
    arm: Annotated[Path, typer.Option(help="Folder of the arm.")] = ROOT / "models" / "kr500_l480",
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; one a core if not given.")] = None,
) -> None:
    """Identify with and without a prior, and judge in 200 poses that were never measured."""
    console = Console(highlight=False)
    scenario = Scenario(arm=arm.resolve().name)
    study = QUICK if quick else identifiability.Study()
    datasets = QUICK_DATASETS if quick else DATASETS
    roots = range(seed, seed + (min(seeds, 2) if quick else seeds))
    trials = partial(identifiability.trials, arm, scenario, study, time.perf_counter)
    cell = build_cell(arm)
    first = simulate(cell, scenario, seed)
    found = describe(cell.vjm, mgco68(cell.arm), first.identification, cad_prior(cell.arm), Strength(0.3))
    seen = seen_report(found)
    with files.whole_folder(out) as folder:
        done = run_trials(trials, roots, workers=workers)
        shown = track(done, "seeds", total=len(roots), console=console, transient=True)
        reports = [r for chunk in shown for r in chunk]
        report = identifiability.summary(arm, scenario, first, reports) | {"seen": asdict(seen)}
        with console.status("coverage"):
            report["coverage"] = coverage_table(
                SIX_DOF,
                arm,
                datasets,
                bootstraps=min(datasets, BOOTSTRAPS),
                workers=workers,
            )
            report["bent_coverage"] = bent_table(arm, max(2, datasets // 5), workers=workers)
        write_csv(first.measured, tuple(j.name for j in cell.arm.joints), folder / "dataset.csv")
        files.write_json(report, folder / "report.json")
        (folder / "report.md").write_text(identifiability_text.markdown(report), encoding="utf-8")
        figures_identifiability.errors(report, folder / "identifiability.png")
        shares(seen).savefig(folder / "shares.png", dpi=120)
        parameters = scenario.model_dump(mode="json")
        write_sweep(folder / "recording.rrd", sweeps.identifiability(report, parameters))
        files.write_manifest(
            folder,
            command=f"scenarios/{identifiability.NAME}.py",
            scenario={**parameters, "study": asdict(study), "coverage_datasets": datasets},
            seed=seed,
            seeds=len(roots),
            arms=[arm, SIX_DOF],
        )
    console.print(identifiability_text.title(report))
    console.print(identifiability_text.table(report))
    console.print(identifiability_text.verdict(report))
    console.print(f"\nWhat the data of seed {seed} see of MGCO68:")
    for sentence in seen.sentences:
        console.print(f"- {sentence}")
    console.print()
    console.print(tables.where(out, figures=("identifiability.png", "shares.png")), soft_wrap=True)


if __name__ == "__main__":
    sys.exit(command.run(app))
