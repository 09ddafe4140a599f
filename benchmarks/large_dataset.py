"""A dataset of 100,000 runs: time a run, memory, and what the solve after it costs.

As a script, `python benchmarks/large_dataset.py RUNS`, it reduces one dataset and prints its memory as JSON.
"""

import json
import resource
import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from functools import partial
from pathlib import Path
from unittest.mock import patch

import numpy as np
from measure import MODELS, Row, at_most, hung, interleave, note, spread
from scipy.linalg.lapack import dgeqrf
from threadpoolctl import threadpool_limits

from testbench.arm.folder import load_arm
from testbench.data.dataset import Dataset, select_runs
from testbench.identify import method
from testbench.identify.method import paper_gco
from testbench.identify.regression import reduce
from testbench.model.kinematics import build_vjm
from testbench.model.structure import Structure, mgco147
from testbench.model.vjm import Vjm, evaluate_chain, observation_matrix

RUNS = (10_000, 30_000, 100_000)
FEW_RUNS = 100
SIGMA = 50e-6
BLOCK = 250
"""Runs whose readings are made at a time."""
REFERENCE_RUNS = 512
"""Runs whose rows LAPACK factorises for the machine's reference."""
SQUARE, PRODUCTS = 1000, 5
"""Size and number of the matrix products that measure the core."""
NOMINAL_GFLOPS = 50.0
"""Speed of one core at rest here; a busy machine gives 30, and every time is longer in proportion."""
QR = "LAPACK's dgeqrf of the same 9 rows a run, nothing else"
SLACK_MB = 8.0
"""Growth of a process that is not the dataset: its allocator's."""


def model() -> tuple[Vjm, Structure]:
    """The heavy arm and its 147 parameters."""
    arm = load_arm(MODELS / "kr500_l480")
    return build_vjm(arm), mgco147(arm)


def synthetic(vjm: Vjm, structure: Structure, runs: int, seed: int = 3) -> Dataset:
    """Three markers under 20 to 100 % of the payload: deflection = A @ truth + noise."""
    rng = np.random.default_rng(seed)
    truth = structure.parameters_of(vjm.arm.C_theta)
    lower, upper = vjm.arm.limits
    q = lower + (upper - lower) * rng.random((runs, vjm.arm.n_joints))
    wrench, point = hung(vjm, runs)
    wrench *= rng.uniform(0.2, 1.0, (runs, 1))
    before = SIGMA * rng.standard_normal((runs, len(vjm.markers), 3))
    after = SIGMA * rng.standard_normal(before.shape)
    for first in range(0, runs, BLOCK):
        k = slice(first, first + BLOCK)
        after[k] += (
            observation_matrix(evaluate_chain(vjm, q[k]), structure, wrench[k], point[k], vjm.markers) @ truth
        )
    ids = np.arange(runs) + 1
    return Dataset(vjm.arm.markers, ids, ids, q, wrench, point, before, after, SIGMA)


def first_runs(data: Dataset, runs: int) -> Dataset:
    """The first runs of a dataset."""
    return select_runs(data, np.arange(data.n_runs) < runs)


def reducing_large_datasets() -> list[Row]:
    """The rows of time, memory and solve."""
    vjm, structure = model()
    data = synthetic(vjm, structure, RUNS[-1])
    return [*time_rows(vjm, structure, data), *memory_rows(), solve_row(vjm, structure, data)]


def time_rows(vjm: Vjm, structure: Structure, data: Dataset) -> list[Row]:
    """Time a run at three sizes, beside two references of the machine."""
    parts = [first_runs(data, runs) for runs in RUNS]
    times_each = [RUNS[-1] // runs for runs in RUNS]  # as long as the largest, so that noise is alike

    def reduce_often(part: Dataset, count: int) -> None:
        for _ in range(count):
            reduce(vjm, structure, part)

    *times, factorised, multiplied = interleave(
        5,
        *[partial(reduce_often, part, count) for part, count in zip(parts, times_each, strict=True)],
        *references(structure.n_parameters + 1),
    )
    each = 1e6 * np.array(times) / (np.array(RUNS) * times_each)[:, None]
    least = each.min(axis=1)  # what the rest of the machine does only adds to a time
    sizes = [f"{runs // 1000}k {spread(us)} us" for runs, us in zip(RUNS, each, strict=True)]
    reference = 1e6 * factorised / REFERENCE_RUNS
    speed = 2e-9 * SQUARE**3 * PRODUCTS / multiplied
    at_nominal = each[-1] * speed / NOMINAL_GFLOPS
    name = f"reducing {data.n_runs} runs of {len(data.markers)} markers to {structure.n_parameters} unknowns"
    return [
        at_most(
            f"(d) {name}, on a core of {NOMINAL_GFLOPS:g} GFlop/s",
            np.median(at_nominal),
            "us a run",
            30,
            f"{spread(at_nominal)} us; this core does {spread(speed, digits=0)} GFlop/s in a matrix product",
        ),
        note("    the same on this core as it was", np.median(each[-1]), "us a run", ", ".join(sizes)),
        note(f"    machine: {QR}", np.median(reference), "us a run", spread(reference)),
        at_most(
            "(d) least time a run at 10k, 30k and 100k runs, largest over smallest, less one",
            100 * (least.max() / least.min() - 1),
            "%",
            15,
            f"over 100k: {', '.join(spread(ratio, digits=2) for ratio in each / each[-1])}",
        ),
    ]


def references(columns: int) -> tuple[Callable[[], object], Callable[[], object]]:
    """What the machine does anyway: LAPACK's QR of rows of as many columns, and a matrix product."""
    rng = np.random.default_rng(0)
    rows = np.asfortranarray(rng.standard_normal((9 * REFERENCE_RUNS, columns)))
    square = rng.standard_normal((SQUARE, SQUARE))
    return lambda: dgeqrf(rows), lambda: [square @ square for _ in range(PRODUCTS)]


def memory_rows() -> list[Row]:
    """Memory of two processes that make and reduce a small and a large dataset."""
    few, many = memory_of(RUNS[0]), memory_of(RUNS[-1])
    grown = {name: many[name] - few[name] for name in few}
    return [
        at_most(
            "(d) growth of a process from 10k to 100k runs, less the dataset's arrays",
            grown["process"] - grown["dataset"],
            "MB",
            SLACK_MB,
            f"peak {few['process']:.0f} and {many['process']:.0f} MB, arrays {few['dataset']:.1f} and "
            f"{many['dataset']:.1f} MB",
        ),
        at_most(
            "(d) growth of what reduce itself allocates",
            grown["reduce"],
            "MB",
            1.0,  # an index of eight bytes a run
            f"peak {few['reduce']:.2f} and {many['reduce']:.2f} MB, as tracemalloc counts them",
        ),
    ]


def memory_of(runs: int) -> dict[str, float]:
    """Memory of a process of its own that makes and reduces a dataset [MB]."""
    command = [sys.executable, str(Path(__file__).resolve()), str(runs)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return {name: float(value) for name, value in json.loads(done.stdout).items()}


def report_memory(runs: int) -> dict[str, float]:
    """Make and reduce a dataset: peak of this process, of its arrays and of reduce alone [MB]."""
    vjm, structure = model()
    data = synthetic(vjm, structure, runs)
    reduce(vjm, structure, data)
    process = peak_memory()
    arrays = (data.run_id, data.q, data.wrench, data.point, data.before, data.after)
    tracemalloc.start()
    reduce(vjm, structure, data)
    own = tracemalloc.get_traced_memory()[1]
    return {"process": process, "dataset": sum(a.nbytes for a in arrays) / 1e6, "reduce": own / 1e6}


def peak_memory() -> float:
    """Largest resident memory of this process so far [MB].

    Linux's getrusage counts in what the process was before it became this program; VmHWM does not.
    """
    status = Path("/proc/self/status")
    if status.exists():
        line = next(x for x in status.read_text(encoding="utf-8").splitlines() if x.startswith("VmHWM"))
        return float(line.split()[1]) * 1024 / 1e6
    unit = 1e6 if sys.platform == "darwin" else 1e3  # bytes there, kilobytes elsewhere
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def solve_row(vjm: Vjm, structure: Structure, data: Dataset) -> Row:
    """What GCO with a given weight costs once the dataset is reduced: many runs against few."""
    few = first_runs(data, FEW_RUNS)
    reduced = {part.n_runs: reduce(vjm, structure, part) for part in (few, data)}

    def solve(part: Dataset) -> None:
        with patch.object(method, "reduce", return_value=reduced[part.n_runs]):
            paper_gco(vjm, structure, part)

    many_s, few_s = interleave(15, lambda: solve(data), lambda: solve(few))
    ratio = many_s / few_s
    return at_most(
        f"(d) GCO's solve after {data.n_runs} runs over the same after {FEW_RUNS}",
        np.median(ratio),
        "x",
        1.5,
        f"ratio {spread(ratio, digits=2)}: {spread(many_s, 1e3)} ms and {spread(few_s, 1e3)} ms",
    )


if __name__ == "__main__":
    with threadpool_limits(1):
        print(json.dumps(report_memory(int(sys.argv[1]))))
