"""Poses that pay: plans by every criterion against random poses, verified by full simulation.

python scenarios/pose_selection.py --out runs/pose_selection
"""

import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, TypeVar

import typer
from rich.console import Console
from rich.progress import track

from testbench import files
from testbench.bench.campaign import build_cell, stream
from testbench.data.csvfile import write_csv
from testbench.shell import command
from testbench.studies.pose_selection import figure as figures_pose_selection
from testbench.studies.pose_selection import ground as pose_ground
from testbench.studies.pose_selection import promise as pose_promise
from testbench.studies.pose_selection import study as pose_selection
from testbench.studies.pose_selection import trial as pose_bench
from testbench.studies.pose_selection import words as text
from testbench.studies.pose_selection.scene import scene
from testbench.studies.pose_selection.summary import Findings, summary
from testbench.trials import run_trials
from testbench.views import tables
from testbench.views.recording import write_plan

ROOT = Path(__file__).resolve().parents[1]
QUICK = pose_ground.Study(
    poses=(12,), criteria=("test", "D"), candidates=120, tasks=6, workspace=30, variants=1
)
QUICK_SEEDS = 2
FIGURES = ("curves.png", "featured.png")

app = typer.Typer(add_completion=False)
T = TypeVar("T")


@app.command()
def main(
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Root of all randomness.")] = 1,
    seeds: Annotated[int, typer.Option(min=1, help="That many seeds: median and spread.")] = 50,
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("runs") / pose_ground.NAME,
    quick: Annotated[
        bool, typer.Option("--quick", help="Two seeds, 12 poses, two criteria, few candidates.")
    ] = False,
    arm: Annotated[Path, typer.Option(help="Folder of the arm.")] = ROOT / "models" / "kr500_l480",
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; one a core if not given.")] = None,
) -> None:
    """Plan 4 to 40 poses by six criteria, measure them, identify, and judge where the robot works."""
    console = Console(highlight=False)
    study = QUICK if quick else pose_ground.Study()
    roots = range(seed, seed + (min(seeds, QUICK_SEEDS) if quick else seeds))
    cell = build_cell(arm)
    ground = pose_ground.lay_ground(cell, arm, study, seed)
    jobs = [(name, poses) for name in study.criteria for poses in study.poses]

    def every(work: Callable[[Sequence[int]], list[T]], over: range, words: str) -> list[T]:
        done = run_trials(work, over, workers=workers)
        shown = track(done, words, total=len(over), console=console, transient=True)
        return [r for chunk in shown for r in chunk]

    with files.whole_folder(out) as folder:
        made = every(partial(pose_ground.plans, ground, time.perf_counter, jobs), range(len(jobs)), "plans")
        chosen = {job: plan for job, (plan, _) in zip(jobs, made, strict=True)}
        variants = range(study.variants)
        found = Findings(
            plans=[report for _, report in made],
            trials=every(partial(pose_selection.trials, ground, chosen), roots, "trials"),
            replanned=every(partial(pose_selection.replanned, ground), roots, "planned anew"),
            promises=every(partial(pose_promise.promises, ground, chosen), roots, "promises"),
            worth=every(partial(pose_promise.worth, ground, tuple(roots)), variants, "what else helps"),
        )
        featured = chosen["test", study.featured]
        bench = pose_bench.build_bench(cell, ground)
        first = pose_bench.measure_plan(
            bench, ground, featured, stream(seed, pose_ground.NOISE + study.featured)
        )
        report = summary(ground, first, found)
        write_csv(first, tuple(j.name for j in cell.arm.joints), folder / "dataset.csv")
        files.write_json(report, folder / "report.json")
        (folder / "report.md").write_text(text.markdown(report), encoding="utf-8")
        figures_pose_selection.curves(report, folder / FIGURES[0])
        figures_pose_selection.featured(report, folder / FIGURES[1])
        prior = pose_ground.wrong_prior(cell, seed)
        specification = pose_ground.specification_for(cell, ground, prior, study.featured)
        write_plan(folder / "recording.rrd", scene(cell, ground, specification, featured, first, report))
        files.write_manifest(
            folder,
            command=f"scenarios/{pose_ground.NAME}.py",
            scenario=report["study"],
            seed=seed,
            seeds=len(roots),
            arms=[arm],
        )
    console.print(text.title(report))
    console.print(text.table(report))
    console.print(text.verdict(report))
    console.print()
    console.print(tables.where(out, figures=FIGURES), soft_wrap=True)


if __name__ == "__main__":
    sys.exit(command.run(app))
