"""Section 5.2: the illustrative 6R arm, full poses, LS against GCO, Tables I and II, and the order m.

python scenarios/six_dof_arm.py --out runs/six_dof_arm
"""

import math
import sys
import time
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.console import Console
from rich.progress import track

from testbench import files
from testbench.bench.campaign import build_cell, named_models
from testbench.bench.full_pose import FullPose, identify, simulate
from testbench.bench.rows import fit_row
from testbench.data.csvfile import write_csv
from testbench.shell import command
from testbench.studies.six_dof_arm import trial as six_dof
from testbench.studies.six_dof_arm import words as six_dof_text
from testbench.studies.six_dof_arm.figure import six_dof_arm
from testbench.trials import run_trials
from testbench.trials.spread import Spread
from testbench.views import tables
from testbench.views.recording import write_calibration
from testbench.views.recording.drawing import Calibration
from testbench.views.schema import Column, Table

ROOT = Path(__file__).resolve().parents[1]
QUICK_SEEDS = 5
ORDER_SEEDS, QUICK_ORDER_SEEDS = 20, 1
ORDER_STARTS, QUICK_ORDER_STARTS = 5, 2
CHUNK = 5

ERRORS = (Column("name", "model"), Column("p95", "95 %, truth", "mm"), Column("rms", "RMS, truth", "mm"))

app = typer.Typer(add_completion=False)


def _spreads(model: dict[str, Any]) -> dict[str, Any]:
    cells = {key: model["check"][f"{key}_mm"] for key in ("p95", "rms")}
    return {k: Spread(**v) if isinstance(v, dict) else v for k, v in cells.items()}


@app.command()
def main(
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Root of all randomness.")] = 1,
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("runs") / six_dof.NAME,
    quick: Annotated[bool, typer.Option("--quick", help="Five seeds.")] = False,
    seeds: Annotated[int, typer.Option(min=1, help="That many seeds: median and spread.")] = 100,
    arm: Annotated[Path, typer.Option(help="Folder of the arm.")] = ROOT / "models" / "arm_6r",
    per: Annotated[
        Literal["deflection", "reading"],
        typer.Option(help="What the noise of 25 um and 250 urad is that of."),
    ] = "deflection",
    magnification: Annotated[
        float, typer.Option(min=1, max=10_000, help="Of the deflections drawn in the recording.")
    ] = 10.0,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; one a core if not given.")] = None,
) -> None:
    """Identify the five models of Table I from 108 runs, and check them on 120 others."""
    console = Console(highlight=False)
    share = math.sqrt(2) if per == "deflection" else 1.0
    scenario = FullPose(
        arm=arm.resolve().name,
        sigma=25e-6 / share,
        sigma_rotation=250e-6 / share,
        least=9e-3,
        most=41e-3,
    )
    roots = range(seed, seed + (min(seeds, QUICK_SEEDS) if quick else seeds))
    ordered = roots[: QUICK_ORDER_SEEDS if quick else ORDER_SEEDS]
    starts = QUICK_ORDER_STARTS if quick else ORDER_STARTS
    study = partial(six_dof.trials, arm, scenario, ordered, starts, time.perf_counter)
    with files.whole_folder(out) as folder:
        cell = build_cell(arm)
        chunks = -(-len(roots) // CHUNK)
        done = run_trials(study, roots, workers=workers, size=CHUNK)
        shown = track(done, "seeds", total=chunks, console=console, transient=True)
        report = six_dof.summary(arm, scenario, per, [r for chunk in shown for r in chunk])
        campaign = simulate(cell, scenario, seed)
        joints = tuple(j.name for j in cell.arm.joints)
        write_csv(campaign.identification, joints, folder / "dataset.csv")
        results = identify(cell, campaign, named_models(cell, six_dof.MODELS), time.perf_counter)
        path = folder / "recording.rrd"
        rows = [fit_row(r.model.name, r.estimate, r.seconds) for r in results]
        about = Calibration(
            scenario=six_dof.NAME,
            parameters=scenario.model_dump_json(),
            summary=f"### {six_dof_text.title(report)}\n\n{six_dof_text.verdict(report)}",
            notes="",
            errors=Table(ERRORS, [{**m, **_spreads(m)} for m in report["models"]]),
            models=rows,
            best=4,
            shown=(0, 4),
            magnification=magnification,
        )
        write_calibration(path, about, cell, campaign, results)
        files.write_json(report, folder / "report.json")
        (folder / "report.md").write_text(six_dof_text.markdown(report), encoding="utf-8")
        six_dof_arm(report, folder / "six_dof_arm.png")
        files.write_manifest(
            folder,
            command=f"scenarios/{six_dof.NAME}.py",
            scenario={**scenario.model_dump(mode="json"), "truths": ["linear", "nonlinear"], "per": per},
            seed=seed,
            seeds=len(roots),
            arms=[arm],
        )
    console.print(six_dof_text.title(report))
    console.print(six_dof_text.table(report))
    console.print(six_dof_text.verdict(report))
    console.print()
    console.print(tables.where(out, figures=("six_dof_arm.png",)), soft_wrap=True)


if __name__ == "__main__":
    sys.exit(command.run(app))
