"""The columns of the study of compensation, and its tables."""

from collections.abc import Sequence
from dataclasses import replace

from testbench.bench.truths import CALLED
from testbench.studies.compensation.report import ALL, CompensationReport, Group
from testbench.studies.compensation.settings import ARMS, IDEAL, IDENTIFIED, JOBS
from testbench.views.schema import Column, Table, pivot

MODEL = Column("model", "model")
CAMPAIGN = Column("campaign", "campaign")
POSES = Column("poses", "poses", form="d")
REMOVED = Column("removed", "removed", "%", ".1f", scale=100)
WORST = Column("worst", "worst case", "%", ".1f", scale=100)
NINE = Column("nine", "cases with 90 % or more removed", "%", ".1f", scale=100)
WORSE = Column("worse", "cases made worse", form="d")
COVERED = Column("covered", "inside 95 % intervals", "%", ".1f", scale=100)
UNSEEN = Column("unseen", "without bound", "%", ".1f", scale=100)
BUCKLED = Column("buckled", "trials without equilibrium", form="d")
AFTER = Column("after.median_mm", "after", "mm")
SIZES = (
    Column("before.median_mm", "before", "mm"),
    AFTER,
    Column("after.p95_mm", "after, 95th percentile", "mm"),
    Column("after.most_mm", "largest", "mm"),
)
FOUND = (MODEL, CAMPAIGN, POSES, REMOVED, WORST, NINE, WORSE, *SIZES, COVERED)
TRIALS = (
    MODEL,
    CAMPAIGN,
    POSES,
    Column("by_trial", "median removed, trial by trial", "%", ".1f", scale=100),
    Column("median_kept", "trials with a median of 97 %", form="yes"),
    Column("nine_kept", "trials with 90 % removed in 95 % of points", form="yes"),
    Column("trials_worse", "trials with a point made worse", form="d"),
    Column("covered_by_trial", "inside 95 % intervals, trial by trial", "%", ".1f", scale=100),
    Column("solved", "solved", form="yes"),
)
TRUTHS = (
    Column("truth", "true arm", called=CALLED),
    MODEL,
    Column("trials", "trials", form="d"),
    REMOVED,
    WORST,
    NINE,
    WORSE,
    AFTER,
    COVERED,
)


def tables(report: CompensationReport) -> dict[str, Table]:
    """Share removed by campaign and poses; all numbers; trial by trial, true arm by true arm."""
    found = {}
    for name in ARMS:
        groups = [g for g in report.groups if g.arm == name]
        every = [g for g in groups if g.job == ALL]
        own = [g for g in groups if g.poses in (0, report.featured)]
        found[f"{name}, both"] = _table(FOUND, every)
        for job in JOBS:
            found[f"{name}, {job}"] = _table(FOUND, [g for g in own if g.job == job])
        found[f"{name}, trials"] = _table(TRIALS, [g for g in own if g.job == ALL])
        found[f"{name}, truths"] = _table(TRUTHS, [g for g in report.by_truth if g.arm == name])
    own = [g for g in report.groups if g.arm == IDEAL and g.job == ALL and g.model in IDENTIFIED]
    title = "share of the deflection removed, median over all points, %"
    for model in IDENTIFIED:
        rows = Table((), [g for g in own if g.model == model], title)
        found[f"removed, {model}"] = pivot(rows, CAMPAIGN, replace(POSES, unit="poses"), REMOVED)
    at = Table((), [g for g in own if g.poses == report.featured], title)
    found["short"] = pivot(at, CAMPAIGN, MODEL, replace(REMOVED, exact=True))
    return found


def _table(columns: tuple[Column, ...], groups: Sequence[Group]) -> Table:
    """These columns, and what went wrong where anything did."""
    there = [column for column in (UNSEEN, BUCKLED) if any(getattr(g, column.key) for g in groups)]
    return Table((*columns, *there), groups)
