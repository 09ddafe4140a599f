"""A dataset of 100,000 runs: time a run, memory, and what the solve after it costs.

As a script, `python benchmarks/large_dataset.py RUNS`, it reduces one dataset and prints its memory as JSON.
"""

import json
import resource
import subprocess
import sys
import tracemalloc
from pathlib import Path
from unittest.mock import patch

import numpy as np
from measure import PAYLOAD, Row, at_most, cell, interleave, note, spread
from scipy.linalg import qr
from threadpoolctl import threadpool_limits

from testbench.bench import Cell
from testbench.dataset import Dataset, select
from testbench.identify import conic, gco, reduce
from testbench.structure import mgco147
from testbench.vjm import observation

RUNS = (10_000, 30_000, 100_000)
FEW_RUNS = 100
SIGMA = 50e-6
BLOCK = 1000
"""Runs whose readings are made at a time."""
SLACK_MB = 8.0
"""Growth of a process that is not the dataset: its allocator's."""


def synthetic(arm: Cell, runs: int, seed: int) -> Dataset:
    """Three markers under weights of 20 to 100 % of the payload: deflection = A @ truth + noise."""
    rng = np.random.default_rng(seed)
    structure = mgco147(arm.arm)
    truth = structure.entries(arm.arm.C_theta)
    q = rng.uniform(*arm.arm.limits, (runs, arm.arm.n_joints))
    wrench, point = np.zeros((runs, 6)), np.tile(arm.vjm.load, (runs, 1))
    wrench[:, 2] = -PAYLOAD * rng.uniform(0.2, 1.0, runs)
    before = SIGMA * rng.standard_normal((runs, len(arm.arm.markers), 3))
    after = SIGMA * rng.standard_normal(before.shape)
    for first in range(0, runs, BLOCK):
        k = slice(first, first + BLOCK)
        A = observation(arm.vjm, structure, q[k], wrench[k], point[k], targets=arm.vjm.markers)
        after[k] += A @ truth
    ids = np.arange(runs) + 1
    return Dataset(arm.arm.markers, ids, ids, q, wrench, point, before, after, SIGMA)


def size(data: Dataset) -> int:
    """Bytes of a dataset's arrays."""
    arrays = (data.run, data.pose, data.q, data.wrench, data.point, data.before, data.after)
    return sum(array.nbytes for array in arrays)


def reducing_large_datasets() -> list[Row]:
    """The rows of time, memory and solve."""
    arm = cell("kr500_l480")
    structure = mgco147(arm.arm)
    data = synthetic(arm, RUNS[-1], seed=3)
    parts = [first_runs(data, runs) for runs in RUNS]
    rows = np.random.default_rng(0).standard_normal((9 * BLOCK // 2, structure.n + 1))
    square = np.random.default_rng(0).standard_normal((1000, 1000))
    *times, plain, product = interleave(
        5,
        *[lambda part=part: reduce(arm.vjm, structure, part) for part in parts],  # type: ignore[misc]
        lambda: qr(rows, mode="r", check_finite=False),
        lambda: square @ square,
    )
    each = np.array(times) / np.array(RUNS)[:, None] * 1e6
    middle = np.median(each, axis=1)
    plain_us = plain / (BLOCK // 2) * 1e6
    uneven = np.median(each.max(axis=0) / each.min(axis=0)) - 1
    by_size = ", ".join(f"{runs // 1000}k {spread(us)} us" for runs, us in zip(RUNS, each, strict=True))
    return [
        at_most(
            f"(d) reducing {RUNS[-1]} runs of three markers to {structure.n} unknowns",
            middle[-1],
            "us a run",
            30,
            by_size,
        ),
        at_most("(d) time a run between 10k, 30k and 100k runs, largest difference", 100 * uneven, "%", 15, ""),
        note(
            "    machine: LAPACK's dgeqrf of the same rows alone",
            float(np.median(plain_us)),
            "us a run",
            f"{spread(plain_us)}; over reduce {spread(plain_us / each[-1])}; one matrix product "
            f"{spread(2 / product, digits=0)} GFlop/s",
        ),
        *memory_rows(),
        solve_row(arm, data),
    ]


def first_runs(data: Dataset, runs: int) -> Dataset:
    """The first runs of a dataset."""
    return select(data, np.arange(data.runs) < runs)


def memory_rows() -> list[Row]:
    """Memory of two processes that reduce a small and a large dataset."""
    few, many = (memory_of(runs) for runs in (RUNS[0], RUNS[-1]))
    grown, own = many["peak_mb"] - few["peak_mb"], many["dataset_mb"] - few["dataset_mb"]
    return [
        at_most(
            "(d) growth of a process from 10k to 100k runs, beyond the dataset's arrays",
            grown - own,
            "MB",
            SLACK_MB,
            f"peak {few['peak_mb']:.0f} and {many['peak_mb']:.0f} MB, dataset {few['dataset_mb']:.1f} and "
            f"{many['dataset_mb']:.1f} MB",
        ),
        at_most(
            "(d) growth of reduce's own allocations from 10k to 100k runs",
            many["reduce_mb"] - few["reduce_mb"],
            "MB",
            0.5,
            f"{few['reduce_mb']:.2f} and {many['reduce_mb']:.2f} MB at their peak, as Python counts them",
        ),
    ]


def memory_of(runs: int) -> dict[str, float]:
    """Memory of a process of its own that makes and reduces a dataset [MB]."""
    command = [sys.executable, str(Path(__file__).resolve()), str(runs)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return {name: float(value) for name, value in json.loads(done.stdout).items()}


def report_memory(runs: int) -> None:
    """Make and reduce a dataset and print this process's memory: the subprocess of `memory_of`."""
    arm = cell("kr500_l480")
    data = synthetic(arm, runs, seed=3)
    reduce(arm.vjm, mgco147(arm.arm), data)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    peak_mb = peak / 1e6 if sys.platform == "darwin" else peak / 1e3
    tracemalloc.start()
    reduce(arm.vjm, mgco147(arm.arm), data)
    own = tracemalloc.get_traced_memory()[1]
    print(json.dumps({"peak_mb": peak_mb, "dataset_mb": size(data) / 1e6, "reduce_mb": own / 1e6}))


def solve_row(arm: Cell, data: Dataset) -> Row:
    """What GCO costs once the dataset is reduced: many runs against few."""
    structure = mgco147(arm.arm)
    few = first_runs(data, FEW_RUNS)
    reduced = {part.runs: reduce(arm.vjm, structure, part) for part in (few, data)}

    def solve(part: Dataset) -> None:
        with patch.object(conic, "reduce", return_value=reduced[part.runs]):
            gco(arm.vjm, structure, part)

    many_s, few_s = interleave(15, lambda: solve(data), lambda: solve(few))
    return at_most(
        f"(d) solve after {data.runs} runs over solve after {FEW_RUNS}",
        float(np.median(many_s / few_s)),
        "x",
        1.5,
        f"{spread(many_s, 1e3)} ms and {spread(few_s, 1e3)} ms, ratio {spread(many_s / few_s, digits=2)}",
    )


if __name__ == "__main__":
    with threadpool_limits(1):
        report_memory(int(sys.argv[1]))
