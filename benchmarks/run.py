"""All benchmarks: `make bench`.

Speed is a ratio of two times measured side by side in this run, on one thread; medians, with (least-most).
Writes runs/bench/bench.json and returns 1 where a bar is missed.
"""

import dataclasses
import os
import sys
import time
from pathlib import Path
from typing import Annotated

import typer
from certified_gco import gco_against_its_solver_and_cvxpy
from equilibrium import newton_against_forward_passes, newton_against_stepping
from large_dataset import reducing_large_datasets
from measure import Row, processor
from rich.console import Console
from rich.table import Table

from testbench import command, files

BENCHMARKS = {
    "a": newton_against_forward_passes,
    "b": newton_against_stepping,
    "c": gco_against_its_solver_and_cvxpy,
    "d": reducing_large_datasets,
}

app = typer.Typer(add_completion=False)


@app.command()
def main(
    only: Annotated[str, typer.Option(help="Letters of the benchmarks to run.")] = "abcd",
    out: Annotated[Path, typer.Option(help="Folder of bench.json.")] = Path("runs") / "bench",
) -> int:
    """Run the benchmarks and judge them."""
    console = Console(highlight=False)
    start = time.perf_counter()
    rows: list[Row] = []
    for letter in only:
        with console.status(f"benchmark ({letter})"):
            rows += BENCHMARKS[letter]()
    console.print(table(rows))
    passed = all(row.passed for row in rows)
    elapsed = time.perf_counter() - start
    where = f"{processor()}, {os.cpu_count()} processors, one thread used"
    console.print(f"{where}; {elapsed:.0f} s; medians (least-most)")
    out.mkdir(parents=True, exist_ok=True)
    results = [{**dataclasses.asdict(row), "passed": row.passed} for row in rows]
    machine = {"processor": processor(), "processors": os.cpu_count(), "seconds": elapsed}
    record = {"passed": passed, "machine": machine, "versions": files.versions(), "results": results}
    files.write_json(record, out / "bench.json")
    console.print(f"{out / 'bench.json'}", soft_wrap=True)
    return 0 if passed else 1


def table(rows: list[Row]) -> Table:
    """The rows for a person."""
    view = Table(show_lines=False, pad_edge=False)
    for name, justify in (("benchmark", "left"), ("measured", "right"), ("bar", "right"), ("", "left")):
        view.add_column(name, justify=justify, no_wrap=name in ("measured", "bar"))
    view.add_column("behind it")
    for row in rows:
        bar, verdict = "", ""
        if row.bar is not None:
            bar = f"{'>=' if row.at_least else '<='} {row.bar:g}"
            verdict = "[green]pass[/]" if row.passed else "[bold red]FAIL[/]"
        view.add_row(row.benchmark, f"{row.value:.3g} {row.unit}", bar, verdict, row.behind)
    return view


if __name__ == "__main__":
    sys.exit(command.run(app))
