"""Trials on all cores: time on one worker over time on two, stored and written as in a study."""

import math
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from measure import MODELS, Row, at_least, interleave, note, spread

from testbench.identify.method import gco
from testbench.runs.engine import on_cores, run_study
from testbench.runs.store import TrialPlan, open_store, write_parquet
from testbench.studies.paper import single_link
from testbench.workflows.cell import build_cell

SEEDS = range(1, 2001)  # some 20 s on one process
CHUNK = 10
REPEATS = 3
BAR = 0.85


@dataclass(frozen=True)
class Draw:
    """A draw of noise, identified; seconds are its share of the chunk's time."""

    f_m: float
    min_eigenvalue: float
    seconds: float


def parallel_efficiency() -> list[Row]:
    """Half of the ratio of the times; the start of the two processes counts.

    The share of their time that workers spend in trials tells the engine's part from that of a busy machine.
    """
    shares: list[float] = []
    one, two = interleave(REPEATS, partial(study, 1, []), partial(study, 2, shares))
    chunk = 1e3 * np.median(one) * CHUNK / len(SEEDS)
    name = f"trials on 2 workers over 1, {len(SEEDS)} draws of section 5.1"
    behind = f"{spread(one)} s on one, {spread(two)} s on two, chunks of {chunk:.0f} ms"
    return [
        at_least(f"(g) parallel efficiency: {name}", np.median(one / two) / 2, "", BAR, behind),
        note("    of it the engine: share of 2 workers' time in trials", np.median(shares[1:]), "", ""),
    ]


def study(workers: int, shares: list[float]) -> None:
    """The study from an empty folder to its Parquet file; appends the share of the time spent in trials."""
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        asked = TrialPlan("many_trials", {}, SEEDS)
        with open_store(Path(name), asked, row=Draw, resume=False) as store:
            for _ in run_study(draws, store, partial(on_cores, workers=workers), size=CHUNK):
                pass
            write_parquet(store, Path(name))
            inside = math.fsum(row.seconds for row in store.rows())
    shares.append(inside / (workers * (time.perf_counter() - start)))


def draws(seeds: Sequence[int]) -> list[list[Draw]]:
    """Draws of noise on the single link, identified by certified GCO; each with its share of the time."""
    start = time.perf_counter()
    cell = build_cell(MODELS / single_link.NAME)
    asked = single_link.SingleLinkSettings()
    structure = single_link.models(cell)[-1].structure
    found = [gco(cell.vjm, structure, single_link.measure(cell, asked, s).identification) for s in seeds]
    each = (time.perf_counter() - start) / len(seeds)
    return [[Draw(e.f_m, e.min_eigenvalue, each)] for e in found]
