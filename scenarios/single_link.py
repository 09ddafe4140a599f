"""Section 5.1: one link, six loads, least squares against GCO over a thousand draws of noise.

python scenarios/single_link.py --seed 1 --out runs/single_link
"""

import sys
import time
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console
from rich.progress import track

from testbench import files
from testbench.bench.campaign import build_cell
from testbench.data.csvfile import write_csv
from testbench.shell import command
from testbench.studies.single_link import figure as figures_single_link
from testbench.studies.single_link import summary as single_link_report
from testbench.studies.single_link import trial as single_link
from testbench.studies.single_link import words as single_link_text
from testbench.trials import run_trials
from testbench.views.recording import write_single_link

ARM = Path(__file__).resolve().parents[1] / "models" / single_link.NAME
QUICK_DRAWS, ORDER_DRAWS, QUICK_ORDER_DRAWS, CHUNK = 100, 200, 10, 10

app = typer.Typer(add_completion=False)


@app.command()
def main(
    seed: Annotated[
        int, typer.Option(min=0, max=2**62, help="Of the first draw; the next have the next.")
    ] = 1,
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("runs") / single_link.NAME,
    quick: Annotated[bool, typer.Option("--quick", help="At most a hundred draws.")] = False,
    draws: Annotated[int, typer.Option(min=1, max=100_000, help="Draws of noise.")] = 1000,
    loads: Annotated[
        Literal["axes", "random"], typer.Option(help="One axis at a time, or six random wrenches.")
    ] = "axes",
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; one a core if not given.")] = None,
) -> None:
    """Identify the single link of section 5.1 by least squares and by GCO, over many draws of noise."""
    console = Console(highlight=False)
    draws = min(draws, QUICK_DRAWS) if quick else draws
    order_draws = min(draws, QUICK_ORDER_DRAWS if quick else ORDER_DRAWS)
    study = single_link.Study(draws=draws, order_draws=order_draws, loads=loads)
    seeds = range(seed, seed + draws)
    trial = partial(single_link.trials, ARM, study, seeds[:order_draws], time.perf_counter)
    cell = build_cell(ARM)
    with files.whole_folder(out) as folder:
        chunks = run_trials(trial, seeds, workers=workers, size=CHUNK)
        count = -(-draws // CHUNK)
        bar = track(chunks, "draws", total=count, console=console, transient=True)
        results = [result for chunk in bar for result in chunk]
        first = single_link.measure(cell, study, seed)
        report = single_link_report.summary(cell, study, first, results)
        write_csv(first.identification, (), folder / "dataset.csv")
        files.write_json(report, folder / "report.json")
        parameters, claims = study.model_dump(mode="json"), single_link_text.verdict(report).split("\n")
        write_single_link(folder / "recording.rrd", report, parameters, claims)
        (folder / "report.md").write_text(single_link_text.markdown(report), encoding="utf-8")
        files.write_manifest(
            folder,
            command=f"scenarios/{single_link.NAME}.py",
            scenario=study.model_dump(mode="json"),
            seed=seed,
            seeds=draws,
            arms=[ARM],
        )
        figures_single_link.single_link(report, folder / "single_link.png")
    console.print(single_link_text.title(report))
    console.print(single_link_text.table(report))
    console.print()
    console.print(single_link_text.first_draw(report))
    console.print()
    console.print(single_link_text.verdict(report))
    console.print()
    console.print(single_link_text.where(out), soft_wrap=True)
    console.print(f"recording  {out / 'recording.rrd'}", soft_wrap=True)


if __name__ == "__main__":
    sys.exit(command.run(app))
