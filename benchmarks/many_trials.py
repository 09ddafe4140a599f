"""Trials on all cores: time on one worker over time on two, stored and written as in a study."""

import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from measure import MODELS, Row, at_least, interleave, spread

from testbench import trials
from testbench.bench import build_cell
from testbench.identify import gco
from testbench.studies import single_link

SEEDS = range(1, 201)
CHUNK = 10
REPEATS = 3
BAR = 0.85


def parallel_efficiency() -> list[Row]:
    """Half of the ratio of the times; the two processes are there from a call that is not counted."""
    one, two = interleave(REPEATS, partial(study, 1), partial(study, 2))
    chunk = 1e3 * np.median(one) * CHUNK / len(SEEDS)
    return [
        at_least(
            f"(g) trials on 2 workers over 1, parallel efficiency, {len(SEEDS)} draws of section 5.1",
            np.median(one / two) / 2,
            "",
            BAR,
            f"{spread(one)} s on one, {spread(two)} s on two, chunks of {chunk:.0f} ms",
        )
    ]


def study(workers: int) -> None:
    """The study from an empty folder to its Parquet file."""
    with tempfile.TemporaryDirectory() as name:
        asked = trials.Study("many_trials", {}, SEEDS)
        with trials.open_store(Path(name), asked, resume=False) as store:
            for _ in trials.run_study(draws, store, partial(trials.on_cores, workers=workers), size=CHUNK):
                pass
            trials.write_parquet(store, Path(name))


def draws(seeds: Sequence[int]) -> list[trials.Rows]:
    """A draw of noise on the single link, identified by certified GCO."""
    cell = build_cell(MODELS / single_link.NAME)
    asked = single_link.Study(draws=len(SEEDS), order_draws=1)
    structure = single_link.models(cell)[-1].structure
    found: list[trials.Rows] = []
    for seed in seeds:
        estimate = gco(cell.vjm, structure, single_link.measure(cell, asked, seed).identification)
        found.append([{"f_m": estimate.f_m, "min_eigenvalue": estimate.min_eigenvalue}])
    return found
