"""Solvers of Eq. (19) on the same data: the paper's search over b against a conic program with a certificate.

python scenarios/solver_comparison.py --seed 1 --out runs/solver_comparison
"""

import math
import sys
import time
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import track

from testbench import files
from testbench.bench.campaign import build_cell
from testbench.bench.full_pose import FullPose, simulate
from testbench.data.csvfile import write_csv
from testbench.identify.modelled import cvxpy
from testbench.shell import command
from testbench.studies.solver_comparison import summary as solvers_report
from testbench.studies.solver_comparison import trial as solvers
from testbench.studies.solver_comparison import words as solvers_text
from testbench.studies.solver_comparison.figure import solver_comparison
from testbench.trials import run_trials
from testbench.views.recording import write_solver

ROOT = Path(__file__).resolve().parents[1]
ARM = ROOT / "models" / "arm_6r"
QUICK_SEEDS, QUICK_GENERATIONS, QUICK_STARTS = 2, 60, 5
PER_READING = math.sqrt(2)
"""The paper's 25 um and 250 urad as those of a deflection, a difference of two readings."""

app = typer.Typer(add_completion=False)


@app.command()
def main(
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Root of all randomness.")] = 1,
    seeds: Annotated[int, typer.Option(min=1, help="That many seeds: median and spread.")] = 20,
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("runs") / solvers.NAME,
    quick: Annotated[bool, typer.Option("--quick", help="Two seeds, 60 generations, few starts.")] = False,
    model: Annotated[str, typer.Option(help="A GCO model of the paper.")] = "MGCO69",
    m: Annotated[int, typer.Option(min=1, max=6, help="Order of the vector space.")] = 6,
    generations: Annotated[int, typer.Option(min=1, help="Most, of the genetic algorithm.")] = 1000,
    trial_points: Annotated[int, typer.Option(min=1, help="Of the global search.")] = 1000,
    starts: Annotated[int, typer.Option(min=1, help="Local solves of the multistart.")] = 10,
    scs: Annotated[bool, typer.Option("--scs", help="SCS by way of cvxpy too (make bench has it).")] = False,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; one a core if not given.")] = None,
) -> None:
    """Minimise F_M by five solvers on the data of section 5.2, and certify what each of them found."""
    console = Console(highlight=False)
    study = solvers.Study(
        scenario=FullPose(
            arm=ARM.name,
            sigma=25e-6 / PER_READING,
            sigma_rotation=250e-6 / PER_READING,
            least=9e-3,
            most=41e-3,
        ),
        model=model,
        m=m,
        generations=min(generations, QUICK_GENERATIONS) if quick else generations,
        trial_points=trial_points,
        starts=min(starts, QUICK_STARTS) if quick else starts,
        scs=scs,
        minima_starts=QUICK_STARTS if quick else 50,
        minima_seeds=1 if quick else 3,
    )
    cell = build_cell(ARM)
    solvers.gco_model(cell, model)
    if scs:
        cvxpy("SCS")
    roots = range(seed, seed + (min(seeds, QUICK_SEEDS) if quick else seeds))
    trials = partial(solvers.trials, ARM, study, seed, time.perf_counter)
    with files.whole_folder(out) as folder:
        done = run_trials(trials, roots, workers=workers)
        shown = track(done, "seeds", total=len(roots), console=console, transient=True)
        report = solvers_report.summary(ARM, study, [r for chunk in shown for r in chunk])
        joints = tuple(j.name for j in cell.arm.joints)
        write_csv(simulate(cell, study.scenario, seed).identification, joints, folder / "dataset.csv")
        files.write_json(report, folder / "report.json")
        parameters, claims = study.model_dump(mode="json"), solvers_text.claims(report)
        write_solver(folder / "recording.rrd", report, parameters, claims)
        (folder / "report.md").write_text(solvers_text.markdown(report), encoding="utf-8")
        solver_comparison(report, folder / f"{solvers.NAME}.png")
        files.write_manifest(
            folder,
            command=f"scenarios/{solvers.NAME}.py",
            scenario=study.model_dump(mode="json"),
            seed=seed,
            seeds=len(roots),
            arms=[ARM],
        )
    console.print(solvers_text.title(report))
    console.print(solvers_text.table(report))
    console.print(solvers_text.verdict(report))
    console.print(
        f"\nresults    {out}: report.md, report.json, {solvers.NAME}.png, dataset.csv, recording.rrd",
        soft_wrap=True,
    )


if __name__ == "__main__":
    sys.exit(command.run(app))
