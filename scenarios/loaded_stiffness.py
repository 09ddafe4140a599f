"""Eq. (7) in numbers: what the linear model loses under heavy loads, and what K_w gives back.

python scenarios/loaded_stiffness.py --seed 1 --out runs/loaded_stiffness
"""

import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.progress import track

from testbench import files
from testbench.bench.campaign import build_cell
from testbench.shell import command
from testbench.studies import sweeps
from testbench.studies.loaded_stiffness import figure as figures_loaded
from testbench.studies.loaded_stiffness import trial as loaded
from testbench.studies.loaded_stiffness import words as loaded_text
from testbench.views import tables
from testbench.views.recording import write_sweep

ROOT = Path(__file__).resolve().parents[1]
QUICK_POSES, QUICK_LOADS = 30, 4

app = typer.Typer(add_completion=False)


@app.command()
def main(
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Root of all randomness.")] = 1,
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("runs") / loaded.NAME,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer poses and loads.")] = False,
    arm: Annotated[Path, typer.Option(help="Folder of the arm.")] = ROOT / "models" / "kr500_l480",
    max_load_n: Annotated[float, typer.Option(help="Heaviest hung weight; the least is a tenth.")] = 10_000.0,
) -> None:
    """Hang weights on the arm all over its workspace; compare Eq. (6) and (7) with the true deflections."""
    console = Console(highlight=False)
    study = loaded.Study(
        arm=arm.resolve().name,
        max_load=max_load_n,
        loads=QUICK_LOADS if quick else 7,
        poses=QUICK_POSES if quick else 200,
    )
    cell = build_cell(arm)
    plants = dict(zip(loaded.TRUTHS, (loaded.weightless(cell.arm), cell.plant), strict=True))
    with files.whole_folder(out) as folder:
        q = loaded.draw(cell, study, seed)
        weights = np.geomspace(study.max_load / 10, study.max_load, study.loads)
        bar = track(weights, "loads", console=console, transient=True)
        loadings = [loaded.hang(cell, plants, q, float(load), study.max_load / 100) for load in bar]
        report = loaded.summary(study, seed, loadings)
        files.write_json(report, folder / "report.json")
        sweep = sweeps.loaded_stiffness(report, study.model_dump(mode="json"))
        write_sweep(folder / "recording.rrd", sweep)
        files.write_manifest(
            folder,
            command=f"scenarios/{loaded.NAME}.py",
            scenario=study.model_dump(mode="json"),
            seed=seed,
            seeds=1,
            arms=[arm],
        )
        (folder / "report.md").write_text(loaded_text.markdown(report), encoding="utf-8")
        loaded.write_errors(folder / "errors.csv", cell.arm, q, loadings)
        figures_loaded.loaded_stiffness(report, folder / "loaded_stiffness.png")
    console.print(loaded_text.table(report))
    console.print(loaded_text.verdict(report))
    console.print()
    console.print(tables.where(out, figures=("loaded_stiffness.png",), data="errors.csv"), soft_wrap=True)


if __name__ == "__main__":
    sys.exit(command.run(app))
