"""Section 6 in simulation: a heavy arm, 460.3 kg, three markers, LS against GCO.

python scenarios/gravity_calibration.py --seed 1 --out runs/demo
"""

import sys
import time
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console
from rich.progress import track

from testbench import files
from testbench.bench.campaign import (
    Campaign,
    Cell,
    Result,
    Scenario,
    build_cell,
    identify,
    named_models,
    simulate,
)
from testbench.data.csvfile import write_csv
from testbench.shell import command
from testbench.studies.paper import SECTION_6
from testbench.views import figures, tables
from testbench.views.recording import write_calibration
from testbench.views.report import Report, report, summarise

NAME = "gravity_calibration"
ROOT = Path(__file__).resolve().parents[1]
QUICK_WORKSPACE = 40
PAPERS_ARM = "kr500_l480"

app = typer.Typer(add_completion=False)


@app.command()
def main(
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Root of all randomness.")] = 1,
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("runs") / NAME,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer workspace poses.")] = False,
    seeds: Annotated[int, typer.Option(min=1, help="That many seeds: median and spread.")] = 1,
    arm: Annotated[Path, typer.Option(help="Folder of the arm.")] = ROOT / "models" / PAPERS_ARM,
    payload_kg: Annotated[float, typer.Option(help="Hung mass.")] = 460.3,
    sigma_um: Annotated[float, typer.Option(help="Noise of a reading along an axis.")] = 50.0,
    truth: Annotated[Literal["nonlinear", "linear"], typer.Option(help="Kind of truth.")] = "nonlinear",
    noise: Annotated[bool, typer.Option(help="Noisy readings.")] = True,
    magnification: Annotated[
        float, typer.Option(min=1, max=10_000, help="Of the deflections drawn in the recording.")
    ] = 50.0,
) -> None:
    """Calibrate the arm under gravity as section 6 of the paper does, and judge five models."""
    console = Console(highlight=False)
    scenario = Scenario(
        arm=arm.resolve().name,
        payload=payload_kg,
        sigma=sigma_um / 1e6,
        truth=truth,
        noise=noise,
        workspace_poses=QUICK_WORKSPACE if quick else 200,
    )
    cell = build_cell(arm)
    models = named_models(cell)
    paper = SECTION_6 if cell.arm.name == PAPERS_ARM else {}
    with files.whole_folder(out) as folder:
        reports = []
        for k in track(range(seeds), "seeds", console=console, transient=True, disable=seeds == 1):
            campaign = simulate(cell, scenario, seed + k)
            results = identify(cell, campaign, models, time.perf_counter)
            reports.append(report(NAME, campaign, results, paper))
            if k == 0:
                first = campaign, results
        final = reports[0] if seeds == 1 else summarise(reports)
        write_views(folder, final, cell, *first, magnification)
        write_numbers(folder, final, scenario, seed, seeds, arm)
        figures.models(final, folder / "models.png")
    console.print(tables.title(final))
    console.print(tables.models(final))
    console.print(tables.verdict(final))
    console.print()
    console.print(tables.where(out, figures=("models.png", "residuals.png")), soft_wrap=True)


def write_views(
    folder: Path,
    final: Report,
    cell: Cell,
    campaign: Campaign,
    results: list[Result],
    magnification: float,
) -> None:
    """Dataset and residual figure of the first seed; recording of it, with the numbers of all."""
    joints = tuple(j.name for j in cell.arm.joints)
    write_csv(campaign.measured, joints, folder / "dataset.csv")
    figures.residuals(campaign, results, folder / "residuals.png")
    path = folder / "recording.rrd"
    write_calibration(path, final, cell, campaign, results, magnification=magnification)


def write_numbers(folder: Path, final: Report, scenario: Scenario, seed: int, seeds: int, arm: Path) -> None:
    """report.json, report.md and the manifest that runs it again."""
    files.write_json(final, folder / "report.json")
    (folder / "report.md").write_text(tables.markdown(final), encoding="utf-8")
    files.write_manifest(
        folder,
        command=f"scenarios/{NAME}.py",
        scenario=scenario.model_dump(mode="json"),
        seed=seed,
        seeds=seeds,
        arms=[arm],
    )


if __name__ == "__main__":
    sys.exit(command.run(app))
