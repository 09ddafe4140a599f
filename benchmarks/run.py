"""All benchmarks: `make bench`.

Speed is a ratio of times measured side by side in this run on one thread; medians, with (least-most).
Writes runs/bench/bench.json; the exit code is 1 where a bar is missed.
"""

import dataclasses
import os
import sys
import time
from pathlib import Path
from typing import Annotated

import typer
from absolute import calibrating_by_absolute_poses
from agreement import agreement_with_the_referee
from certified_gco import gco_against_its_solver_and_cvxpy
from corrections import correcting_ten_thousand_points
from equilibrium import newton_against_forward_passes, newton_against_stepping
from families import families_of_fits
from large_dataset import reducing_large_datasets
from large_file import identifying_a_large_file
from learnt_fits import learnt_fits
from many_trials import parallel_efficiency
from measure import Row, processor
from planning import planning_of_many_poses
from recordings import logging_two_hundred_poses
from rich.console import Console
from rich.table import Table
from single_fits import single_fits

from testbench.runs import command
from testbench.runs import manifest as files

BENCHMARKS = {
    "a": newton_against_forward_passes,
    "b": newton_against_stepping,
    "c": gco_against_its_solver_and_cvxpy,
    "d": reducing_large_datasets,
    "e": logging_two_hundred_poses,
    "g": parallel_efficiency,
    "h": agreement_with_the_referee,
    "i": families_of_fits,
    "j": single_fits,
    "k": planning_of_many_poses,
    "l": calibrating_by_absolute_poses,
    "m": correcting_ten_thousand_points,
    "n": identifying_a_large_file,
    "o": learnt_fits,
}

app = typer.Typer(add_completion=False)


@app.command()
def main(
    only: Annotated[str, typer.Option(help="Letters of the benchmarks to run.")] = "".join(BENCHMARKS),
    out: Annotated[Path, typer.Option(help="Folder of bench.json.")] = Path("runs") / "bench",
) -> int:
    """Run the benchmarks and judge them."""
    console = Console(highlight=False)
    start = time.perf_counter()
    rows: list[Row] = []
    for letter in only:
        with console.status(f"benchmark ({letter})"):
            rows += BENCHMARKS[letter]()
    passed = all(row.passed for row in rows)
    machine = {
        "processor": processor(),
        "processors": os.cpu_count(),
        "threads": 1,
        "seconds": time.perf_counter() - start,
    }
    results = [{**dataclasses.asdict(row), "passed": row.passed} for row in rows]
    record = {"passed": passed, "machine": machine, "versions": files.versions(), "results": results}
    out.mkdir(parents=True, exist_ok=True)
    files.write_json(record, out / "bench.json")
    console.print(table(rows))
    console.print(
        f"medians (least-most) on one thread of {machine['processors']}, {machine['processor']}; "
        f"{machine['seconds']:.0f} s; {out / 'bench.json'}",
        soft_wrap=True,
    )
    return 0 if passed else 1


def table(rows: list[Row]) -> Table:
    """The rows for a person, what is behind a figure under its name."""
    view = Table(show_lines=True)
    view.add_column("benchmark")
    view.add_column("measured", justify="right", no_wrap=True)
    view.add_column("bar", justify="right", no_wrap=True)
    view.add_column("")
    for row in rows:
        bar, verdict = "", ""
        if row.bar is not None:
            bar = f"{'>=' if row.at_least else '<='} {row.bar:g}"
            verdict = "[green]pass[/]" if row.passed else "[bold red]FAIL[/]"
        name = f"{row.benchmark}\n[dim]{row.behind}[/]" if row.behind else row.benchmark
        view.add_row(name, f"{row.value:.3g} {row.unit}", bar, verdict)
    return view


if __name__ == "__main__":
    sys.exit(command.run(app))
