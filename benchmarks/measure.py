"""What benchmarks share: times measured side by side, one row of the table, and the arm with its load."""

import gc
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from testbench.arm.mjcf import GRAVITY
from testbench.errors import Array
from testbench.model.vjm import Vjm, WorkArea, random_poses
from testbench.plant.rigid_cell import collision_free
from testbench.workflows.cell import Cell

MODELS = Path(__file__).resolve().parents[1] / "models"
PAYLOAD = 460.3 * GRAVITY
"""Weight hung on the arm [N]."""
ANYWHERE = WorkArea((-9.0, -9.0, -9.0), (9.0, 9.0, 9.0))


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes:
        benchmark: What was measured.
        value: The figure.
        unit: Its unit, "x" for a ratio.
        bar: What it has to reach; None for a line that only informs.
        at_least: Whether the bar is a lower one.
        behind: The medians behind it, with (least-most).
    """

    benchmark: str
    value: float
    unit: str
    bar: float | None
    at_least: bool
    behind: str

    @property
    def passed(self) -> bool:
        """Whether the bar is reached."""
        if self.bar is None:
            return True
        return self.value >= self.bar if self.at_least else self.value <= self.bar


def at_most(benchmark: str, value: float, unit: str, bar: float, behind: str) -> Row:
    """A row with an upper bar."""
    return Row(benchmark, float(value), unit, bar, False, behind)


def at_least(benchmark: str, value: float, unit: str, bar: float, behind: str) -> Row:
    """A row with a lower bar."""
    return Row(benchmark, float(value), unit, bar, True, behind)


def note(benchmark: str, value: float, unit: str, behind: str) -> Row:
    """A row without a bar."""
    return Row(benchmark, float(value), unit, None, True, behind)


def seconds(run: Callable[[], object]) -> float:
    """Wall time of one call [s], without collecting the garbage of calls before it, as of timeit."""
    gc.disable()
    start = time.perf_counter()
    run()
    taken = time.perf_counter() - start
    gc.enable()
    return taken


def interleave(repeats: int, *runs: Callable[[], object]) -> Array:
    """Wall times of several calls in turns, so that a slow spell of the machine falls on all of them.

    Args:
        repeats: Times each is measured, after one call that is not.
        runs: The calls.

    Returns:
        (len(runs), repeats) [s].
    """
    for run in runs:
        run()
    return np.array([[seconds(run) for run in runs] for _ in range(repeats)]).T


def spread(values: Array | Sequence[float], scale: float = 1.0, digits: int = 1) -> str:
    """Median and range, such as "1.2 (1.1-1.4)"."""
    low, middle, high = scale * np.quantile(values, (0, 0.5, 1))
    return f"{middle:.{digits}f} ({low:.{digits}f}-{high:.{digits}f})"


def feasible_poses(arm: Cell, count: int, seed: int) -> Array:
    """Random poses inside the joint limits, clear of the floor and of the arm, (count, n) [rad]."""
    clear = partial(collision_free, arm.room)
    return random_poses(arm.vjm, ANYWHERE, count, clear, np.random.default_rng(seed))


def hung(vjm: Vjm, runs: int) -> tuple[Array, Array]:
    """The payload at the arm's load point: wrench (runs, 6) [N, N m] and point (runs, 3) [m]."""
    wrench = np.zeros((runs, 6))
    wrench[:, 2] = -PAYLOAD
    return wrench, np.tile(vjm.load_point, (runs, 1))


def processor() -> str:
    """Name of the processor, as far as the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
