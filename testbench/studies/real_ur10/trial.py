"""A seed: random poses of C in growing numbers, and what a model that learnt from them foretells."""

from collections.abc import Iterator, Sequence

import numpy as np

from testbench.bench.campaign import stream
from testbench.data.series import select_rows
from testbench.identify.absolute.fit import Options as Tried
from testbench.identify.absolute.fit import explain, gather
from testbench.identify.prior import cad_prior
from testbench.studies.real_ur10.ladder import ERRORS, SPRINGS, TWO
from testbench.studies.real_ur10.readings import Judged, Readings, read
from testbench.studies.real_ur10.rows import Error, SubsetRow, judge, left, placed
from testbench.studies.real_ur10.settings import ENOUGH, JUDGING, Settings

ALIGNED = 50  #: Rows of A that tell its frame and target.


def trials(asked: Settings, seeds: Sequence[int]) -> list[list[SubsetRow]]:
    """Rows of some seeds; the seed draws the poses, and nothing else."""
    readings = read(asked.thin)
    return [list(_trial(asked, readings, seed)) for seed in seeds]


def _trial(asked: Settings, readings: Readings, seed: int) -> Iterator[SubsetRow]:
    a, c = readings.series
    order = stream(seed).permutation(c.rows)
    rest = select_rows(c, order[max(asked.draws) :][:JUDGING])
    few = select_rows(a, np.unique(np.linspace(0, a.rows - 1, JUDGING + ALIGNED).astype(int)))
    tests = {"C": Judged(rest, None), "A": Judged(few, ALIGNED)}
    vjm = readings.cell.vjm
    for poses in [n for n, draws in asked.draws.items() if seed < asked.first + draws]:
        own = (select_rows(c, order[:poses]),)
        tried = Tried(orders=min(asked.orders, ENOUGH), only=frozenset({SPRINGS, ERRORS}))
        gathered = gather(vjm, own, cad_prior(vjm.arm), tried)
        for model in TWO:
            found = explain(gathered, model.options)
            for name, judged in tests.items():
                at = placed(found, judged)
                yield _row(poses, model.name, name, judge(found, at, judged, left(at, judged)))


def _row(poses: int, model: str, judged: str, error: Error) -> SubsetRow:
    return SubsetRow(
        poses=poses,
        model=model,
        judged=judged,
        mean_mm=error.mean_mm,
        p95_mm=error.p95_mm,
        p99_mm=error.p99_mm,
        max_mm=error.max_mm,
        coverage_95=error.coverage_95,
    )
