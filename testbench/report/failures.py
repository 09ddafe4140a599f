"""Estimators of one's own that failed in some trials of a study: counted, and out of its other numbers."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from testbench.campaign.rows import FAILED
from testbench.report.columns import columns
from testbench.report.report import Report, say
from testbench.report.table import MODEL, TRIAL, Row, Trials, find
from testbench.views.schema import Table

FAILURES = "failures"  #: Name of the table.
STATUS = "status"  #: Column of a fit, perhaps below another name.
Failures = Mapping[tuple[str, int], str]
"""Why an estimator failed in a trial, by its name and the seed; of several cases the first."""


def failures(trials: Trials) -> Failures:
    """What the rows of trials say."""
    found: dict[tuple[str, int], str] = {}
    head = _head(trials)
    rows = (trials[name].tolist() for name in (head + MODEL, TRIAL, head + STATUS))
    for name, seed, status in zip(*rows, strict=True):
        if status and status.startswith(FAILED):
            found.setdefault((name, seed), status)
    return found


def _head(trials: Trials) -> str:
    """What stands before the columns of a fit."""
    return next(name for name in trials.made if name.endswith(STATUS)).removesuffix(STATUS)


def fitted(trials: Trials, lost: Failures) -> Trials:
    """The other rows: who failed in one case of a trial has none of that trial, so that cases compare."""
    keys = zip(trials[_head(trials) + MODEL].tolist(), trials[TRIAL].tolist(), strict=True)
    return trials.pick(np.array([key not in lost for key in keys], dtype=bool))


def with_failures(report: Report, lost: Failures, trials: int) -> Report:
    """A report that says first who failed, how often, and why in the first of these trials."""
    rows = [Row(name=name, seed=seed, status=why) for (name, seed), why in lost.items()]
    count = Counter(row.name for row in rows)
    first = [Row(find(rows, name=name), failed=f"{n} of {trials}") for name, n in count.items()]
    sentence = "Your estimator {name} failed in {failed} trials: its numbers are of the others."
    return replace(
        report,
        numbers={**report.numbers, FAILURES: rows},
        tables={**report.tables, FAILURES: Table(columns("name failed seed status"), first, "Failures")},
        body=[*report.body, FAILURES],
        claims=[*(say(sentence, row) for row in first), *report.claims],
    )
