"""A seed: random poses of C in growing numbers, and what a model that learnt from them foretells."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from testbench.bench.absolute_model import belief_of
from testbench.bench.campaign import stream
from testbench.bench.rows import MM
from testbench.data.series import select_rows
from testbench.errors import Array
from testbench.identify.absolute.fit import ORDERS, Calibration, explain, gather
from testbench.identify.absolute.fit import Options as Tried
from testbench.identify.absolute.posterior import Placed, evenly, inside, known, place, predict
from testbench.identify.absolute.scatter import residuals
from testbench.identify.prior import cad_prior
from testbench.studies.real_ur10.ladder import ERRORS, LADDER, QUICK, SPRINGS, TWO
from testbench.studies.real_ur10.readings import THIN, Judged, Readings, read

SPLITS = ("both", "blocks", "C to A", "A to C")
"""The dearest first."""
DRAWS: Mapping[int, int] = {50: 20, 100: 20, 200: 6, 500: 3, 1000: 3}
"""Random poses of C that a model learns from, and in how many seeds at most: many are dear."""
QUICK_DRAWS: Mapping[int, int] = {60: 1}
ENOUGH = 50  #: Highest order where the number of poses is in question: more change little and cost twice.
QUICK_ORDERS = 30  #: Highest order of periodic errors with --quick.
JUDGING = 200  #: Random poses of C, never of those that trained, and about as many of A, that judge these.
ALIGNED = 50  #: Rows of A that tell its frame and target.
INTERVALS = 250  #: Positions, evenly spaced, whose 95 % ellipsoids are worked out.


@dataclass(frozen=True)
class Error:
    """Distances of positions that were not fitted from a model."""

    n: int
    mean_mm: float
    rms_mm: float
    p95_mm: float
    p99_mm: float
    max_mm: float
    inside_95_percent: float  #: Share of some positions inside their 95 % ellipsoid.


@dataclass(frozen=True)
class LadderRow:
    """A model of the ladder; its numbers as the readings that trained it made them."""

    split: str
    name: str  #: Of the model.
    judged: str | None  #: Series that judges it; None of the row that says what the model is.
    error: Error | None
    left_um: tuple[
        float, ...
    ]  #: Readings minus model of all judged rows, base axes, (3 rows,); of some models.
    poses: int  #: That trained it.
    method: str | None  #: How compliances were found; None of a rigid arm.
    parameters: int  #: Unknowns of the arm, frames and targets not counted.
    conservative: bool
    min_eigenvalue: float  #: Smallest of a block of the compliances [m/N, rad/(N m)].
    duality_gap: float | None
    joints: tuple[float, ...]  #: Compliances of the joints, (n,) [rad/(N m)].
    waves: tuple[float, ...]  #: Coefficients of periodic errors, joint by joint, sines then cosines [rad].
    kept: tuple[str, ...]  #: Errors that cross-validation kept, and declined.
    declined: tuple[str, ...]


@dataclass(frozen=True)
class SubsetRow:
    """A model trained on random poses of C, judged on poses of C that it never saw, or on A."""

    poses: int
    name: str  #: Of the model.
    judged: str
    error: Error


@dataclass(frozen=True)
class Options:
    """Flags of the study: none, its readings are what they are."""


@dataclass(frozen=True)
class Settings:
    """What is tried."""

    thin: int  #: Every so many rows of the readings are taken.
    orders: int  #: Highest order of periodic errors.
    models: tuple[str, ...]  #: Of the ladder.
    splits: tuple[str, ...]
    first: int  #: The first seed.
    draws: Mapping[int, int]  #: Random poses that train, and in how many seeds, from the first, at most.
    #: Made of the rest by `trained.prepare`; empty before.
    ladder: Annotated[tuple[LadderRow, ...], Field(exclude=True)] = ()


def settings(_: Options, quick: bool, seeds: range) -> Settings:
    """What the flags ask for."""
    return Settings(
        thin=THIN if quick else 1,
        orders=QUICK_ORDERS if quick else ORDERS,
        models=tuple(one.name for one in (QUICK if quick else LADDER)),
        splits=SPLITS,
        first=seeds[0],
        draws=QUICK_DRAWS if quick else DRAWS,
    )


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
                error = judge(found, at, judged, left(at, judged))
                yield SubsetRow(poses, model.name, name, error)


def placed(found: Calibration, judged: Judged) -> Placed:
    """The frame and target of readings that judge a model."""
    belief, series = belief_of(found), judged.series
    if judged.frame_poses is None:
        return known(found.state, belief, series)
    return place(found.state, belief, series, evenly(series, judged.frame_poses))


def left(at: Placed, judged: Judged) -> Array:
    """Readings minus model in base axes, those that told frame and target left out, (rows, 3) [m]."""
    every = residuals(at.state, judged.series)[0].T
    return np.asarray(np.delete(every, at.rows, axis=0))


def judge(found: Calibration, at: Placed, judged: Judged, off: Array) -> Error:
    """Distances of readings from a model, `off` being what is `left`, and how many lie where it was sure."""
    far = MM * np.linalg.norm(off, axis=1)
    rest = np.setdiff1d(np.arange(judged.series.rows), at.rows)
    some = rest[np.linspace(0, len(rest) - 1, min(len(rest), INTERVALS)).astype(int)]
    within = inside(predict(at, belief_of(found), select_rows(judged.series, some)))
    p95, p99 = np.percentile(far, [95, 99])
    return Error(
        n=len(far),
        mean_mm=float(far.mean()),
        rms_mm=float(np.sqrt((far**2).mean())),
        p95_mm=float(p95),
        p99_mm=float(p99),
        max_mm=float(far.max()),
        inside_95_percent=float(100 * within.mean()),
    )
