"""User estimators that failed in some trials of a study: counted, and left out of its other numbers."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from testbench.report.columns import columns
from testbench.report.report import Report, say
from testbench.report.schema import Table
from testbench.report.table import TRIAL, Row, Trials, find
from testbench.workflows.rows import FAILED

FAILURES = "failures"  #: Name of the table.
Failures = Mapping[tuple[str, int], str]
"""Why an estimator failed in a trial, by its name and the seed; of several cases the first."""


def failures(trials: Trials, model: str) -> Failures:
    """What the rows of trials say, of which a column names the models."""
    found: dict[tuple[str, int], str] = {}
    status = ".".join([*model.split(".")[:-1], "status"])
    for name, seed, why in zip(*(trials[own].tolist() for own in (model, TRIAL, status)), strict=True):
        if why and why.startswith(FAILED):
            found.setdefault((name, seed), why)
    return found


def fitted(trials: Trials, model: str, lost: Failures) -> Trials:
    """The other rows: who failed in one case of a trial has none of that trial, so that cases compare."""
    keys = zip(trials[model].tolist(), trials[TRIAL].tolist(), strict=True)
    return trials.pick(np.array([key not in lost for key in keys], dtype=bool))


def with_failures(report: Report, lost: Failures, trials: int) -> Report:
    """A report that says first who failed, how often, and why in the first of these trials."""
    rows = [Row(name=name, seed=seed, status=why) for (name, seed), why in lost.items()]
    count = Counter(row.name for row in rows)
    first = [Row(find(rows, name=name), failed=f"{n} of {trials}") for name, n in count.items()]
    sentence = "Your estimator {name} failed in {failed} trials, which its numbers leave out."
    return replace(
        report,
        numbers={**report.numbers, FAILURES: rows},
        tables={**report.tables, FAILURES: Table(columns("name failed seed status"), first, "Failures")},
        body=[*report.body, FAILURES],
        claims=[*(say(sentence, row) for row in first), *report.claims],
    )
