"""A hundred thousand runs of three markers, identified from our own CSV: time and memory of the command."""

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from large_dataset import model, synthetic
from measure import Row, at_most

from testbench.files.write import write_csv
from testbench.model.vjm import tool_points

RUNS, BLOCK = 100_000, 10_000
SECONDS, MEGABYTES = 120, 2000
COMMAND = "from testbench.cli import main; main()"
BESIDE = """import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3)"""
"""A small process that measures another: what a program begins with counts the memory of whoever began it."""


def identifying_a_large_file() -> list[Row]:
    """The rows of time and memory."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "runs.csv"
        write_runs(file, RUNS)
        seconds, own, memory = identified(file)
        size = file.stat().st_size / 1e6
    name = f"(n) identify of {RUNS} runs of three markers"
    behind = f"{size:.0f} MB of CSV, all models of the default; {own:.0f} s of the processor"
    return [
        at_most(f"{name}, on {os.cpu_count()} processors", seconds, "s", SECONDS, behind),
        at_most(f"{name}: largest resident memory", memory, "MB", MEGABYTES, "as getrusage has it"),
    ]


def write_runs(file: Path, runs: int) -> None:
    """A campaign of the heavy arm in as many poses, a block at a time."""
    vjm, structure = model()
    part = file.with_suffix(".part")
    with file.open("wb") as whole:
        for first in range(0, runs, BLOCK):
            data = synthetic(vjm, structure, min(BLOCK, runs - first), seed=first)
            at = tool_points(vjm, data.q, vjm.markers)
            number = first + data.run_id
            data = replace(
                data, run_id=number, pose_id=number, before=at + data.before, after=at + data.after
            )
            write_csv(data, vjm.arm, part)
            head, _, rows = part.read_bytes().partition(b"\n")
            whole.write(rows if first else head + b"\n" + rows)
    part.unlink()


def identified(file: Path) -> tuple[float, float, float]:
    """Wall time and processor time [s] and largest memory [MB] of the command."""
    command = [sys.executable, "-c", COMMAND, "identify", "kr500_l480", str(file)]
    command += ["--out", str(file.with_name("out"))]
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", BESIDE, *command], capture_output=True, text=True, check=True
    )
    own, memory = map(float, done.stdout.split())
    return time.perf_counter() - start, own, memory


if __name__ == "__main__":
    write_runs(Path(sys.argv[1]), int(sys.argv[2]))
    print(*identified(Path(sys.argv[1])))
