"""The report of all trials: models and campaigns over the cases, which are points of trials."""

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np

from testbench.arm.catalogue import find_arm
from testbench.bench.baselines import JOINTS
from testbench.bench.truths import TRUTH_WORDS, TRUTHS
from testbench.errors import Array
from testbench.studies.compensation.jobs import job, way_along
from testbench.studies.compensation.report import (
    ALL,
    ChosenAt,
    CompensationReport,
    DatasetRow,
    Gains,
    Group,
    Shown,
    Sizes,
)
from testbench.studies.compensation.rows import Row
from testbench.studies.compensation.settings import (
    ADVISED,
    ARMS,
    DEFAULT,
    FORCE,
    IDEAL,
    IDENTIFIED,
    JOBS,
    LEAST_SQUARES,
    MILLING,
    MODELS,
    NAME,
    PAYLOAD,
    PULL,
    RUNS,
    SIGMA,
    Settings,
    Way,
)
from testbench.studies.study import Rows
from testbench.trials.gain import gained
from testbench.trials.spread import grouped, spread

Of = tuple[int, Row]  #: A row and its seed.
NOWHERE = Way()
MEDIAN = 0.97  #: Share removed that a trial's median is asked about.
PART, OFTEN = 0.9, 0.95  #: Share removed, and the share of cases in which a trial is asked about it.
COUNTS = ("inside", "of")  #: Of a row.


def summary(asked: Settings, seeds: range, trials: Rows[Row]) -> CompensationReport:
    """Over all truths, and truth by truth for the campaign that is advised."""
    every = [(seed, row) for seed, rows in trials for row in rows]
    groups = gathered(asked, every)
    advised = [own for own in every if way_of(own[1]) == ADVISED]
    by_truth = grouped(advised, lambda own: own[1].truth)
    met = [name for name in TRUTHS if name in by_truth]
    first = every[: len(JOBS)]
    chosen = grouped((row for _, row in every if row.chosen and row.job == JOBS[0]), lambda row: row.chosen)
    return CompensationReport(
        scenario=NAME,
        seed=list(seeds) if len(seeds) > 1 else seeds[0],
        trials=len(seeds),
        arm=find_arm(asked.arm).resolve().name,
        payload=PAYLOAD,
        pull=PULL,
        runs=RUNS,
        sigma_um=1e6 * SIGMA,
        force=FORCE,
        points={row.job: len(row.removed) for _, row in first},
        featured=ADVISED.poses,
        numbers=asked.numbers,
        truths={name: TRUTH_WORDS[name] for name in met},
        gains=gains([own for own in advised if own[1].arm == IDEAL]),
        groups=groups,
        by_truth=[g for name in met for g in gathered(asked, by_truth[name], name) if g.job == ALL],
        chosen=[ChosenAt(str(name), len(own)) for name, own in sorted(chosen.items(), key=str)],
        shown=shown(advised),
        dataset=DatasetRow(RUNS * ADVISED.poses, ADVISED.poses, 1e6 * SIGMA),
    )


def shown(advised: Sequence[Of]) -> Shown:
    """The milling path of the first trial."""
    seed = advised[0][0]
    own = {row.model: row for at, row in advised if at == seed and row.job == MILLING and row.arm == IDEAL}
    first = own[DEFAULT]
    return Shown(
        seed=seed,
        truth=first.truth,
        force=first.force,
        way_m=tuple(way_along(job(MILLING)).tolist()),
        before_mm=first.before_mm,
        after_mm={name: row.after_mm for name, row in own.items()},
    )


def way_of(row: Row) -> Way:
    """The campaign of a row."""
    return Way(row.by, row.loads, row.poses)


def gathered(asked: Settings, rows: Sequence[Of], truth: str = "") -> list[Group]:
    """By disturbance, campaign, model and job, in the order of the report."""
    groups = grouped(rows, lambda own: (own[1].arm, way_of(own[1]), own[1].model))
    found = []
    for arm in ARMS:
        ways = (NOWHERE, *asked.ways(arm))
        for way, model in product(ways, MODELS):
            own = groups.get((arm, way, model), [])
            if (model in IDENTIFIED) == (way != NOWHERE) and own:
                found += [_group(own, truth, job) for job in (ALL, *JOBS)]
    return found


def _group(rows: Sequence[Of], truth: str, job: str) -> Group:
    own = [one for one in rows if job in (ALL, one[1].job)]
    trials = [[row for _, row in some] for some in grouped(own, lambda one: one[0]).values()]
    first = own[0][1]
    before, after = (_distances(trials, key) for key in ("before_mm", "after_mm"))
    removed = [1 - new / old for old, new in zip(before, after, strict=True)]
    shares, worse = np.concatenate(removed), [int((some < 0).sum()) for some in removed]
    inside, of = (np.array([sum(getattr(row, key) for row in some) for some in trials]) for key in COUNTS)
    unseen = sum(row.unseen for _, row in own)
    held = (inside[of > 0] / of[of > 0]).tolist()
    return Group(
        truth=truth,
        arm=first.arm,
        by=first.by,
        loads=first.loads,
        poses=first.poses,
        model=first.model,
        job=job,
        trials=len(trials),
        cases=len(shares),
        before=_sizes(before),
        after=_sizes(after),
        removed=spread(shares.tolist()),
        worst=float(shares.min()),
        nine=nine(shares),
        by_trial=spread([float(np.median(some)) for some in removed]),
        median_kept=_share(removed, lambda some: float(np.median(some)) >= MEDIAN),
        nine_kept=_share(removed, lambda some: nine(some) >= OFTEN),
        worse=sum(worse),
        trials_worse=sum(map(bool, worse)),
        covered=float(inside.sum() / of.sum()) if held else None,
        covered_by_trial=spread(held) if held else None,
        unseen=unseen / (unseen + float(of.sum())) if held or unseen else None,
        buckled=sum(any(row.buckled for row in some) for some in trials),
        solved=sum(row.solved for _, row in own) / len(shares),
    )


def gains(advised: Sequence[Of]) -> Gains:
    """The default beside least squares and joints alone, by what is left in the median point of a trial."""

    def left(model: str) -> list[float]:
        own = grouped(((seed, row) for seed, row in advised if row.model == model), lambda own: own[0])
        return [float(np.median(np.concatenate([row.after_mm for _, row in some]))) for some in own.values()]

    return Gains(*(gained(DEFAULT, name, left(DEFAULT), left(name)) for name in (LEAST_SQUARES, JOINTS)))


def nine(shares: Array) -> float:
    """Share of cases with nine tenths or more removed."""
    return float(np.mean(shares >= PART))


def _share(each: Sequence[Array], kept: Callable[[Array], bool]) -> float:
    return float(np.mean([kept(some) for some in each]))


def _distances(trials: Sequence[Sequence[Row]], key: str) -> list[Array]:
    """Of every trial those of all its rows [mm]."""
    return [np.concatenate([getattr(row, key) for row in some]) for some in trials]


def _sizes(trials: Sequence[Array]) -> Sizes:
    medians, p95 = (spread([float(np.percentile(own, p)) for own in trials]) for p in (50, 95))
    return Sizes(medians, p95, max(float(own.max()) for own in trials))
