"""The paper's statements beside our numbers: rows of the table "paper, ours, verdict", all by one rule.

A number of the paper is consistent where it lies inside our 5 to 95 % over the seeds, of fewer than 20 inside
their range: one in ten lies outside even where nothing differs. It is not excluded, and no more, at the edge
of a wide interval. That one error is smaller than another is confirmed, or contradicted, by a sign test on
the same data, without ties; the best model has to beat the best of the others. That two errors are nearly the
same must hold in `MIN_EQUAL_SHARE` of the seeds, any other statement in all of them.
"""

import numpy as np
from scipy.stats import binomtest

from testbench.report.columns import columns
from testbench.report.schema import Table
from testbench.report.table import Row
from testbench.runs.spread import Number, Share, Spread, ends

TEST_LEVEL = 0.05  #: Of the sign test, two-sided.
MIN_EQUAL_SHARE = 0.95  #: Share of the seeds in which two errors must be nearly the same.
NUMBERS = "published found holds p_value"  #: What a statement may have; a table shows those that it has.
WIDE, EDGE = 2.0, 0.1
"""Ratio of the ends of a wide interval, and the share of its logarithm next to an end that is its edge."""


def verdict_table(rows: list[Row]) -> Table:
    """Make the table of statements: what the paper says, what we find, the verdict."""
    there = [c for c in columns(NUMBERS) if any(c.value(row) is not None for row in rows)]
    head, verdict = columns("claim verdict")
    return Table((head, *there, verdict), rows, "The paper's statements")


def _row(claim: str, verdict: str, **numbers: object) -> Row:
    return Row({**dict.fromkeys(NUMBERS.split()), **numbers}, claim=claim, verdict=verdict)


def statement_row(claim: str, verdict: bool, holds: Share | None) -> Row:
    """Judge a statement that holds, or not.

    Args:
        claim: What the paper says.
        verdict: Whether our numbers confirm it.
        holds: What they say: a truth value, or the share of seeds.
    """
    return _row(claim, "confirmed" if verdict else "not confirmed", holds=holds)


def number(claim: str, ours: Number, paper: float) -> Row:
    """Judge a number of the paper: consistent inside our 5 to 95 % over the seeds, but at their edge.

    Args:
        claim: What the number is, with its unit.
        ours: The same number over our seeds; without a spread nothing is consistent.
        paper: The paper's.
    """
    low, high = ends(ours)
    verdict = "consistent" if isinstance(ours, Spread) and low <= paper <= high else "not confirmed"
    if verdict == "consistent" and high > WIDE * low > 0:
        place = np.log(paper / low) / np.log(high / low)
        verdict = "not excluded" if min(place, 1 - place) < EDGE else verdict
    return _row(claim, verdict, published=paper, found=ours)


def comparison(claim: str, won: int, lost: int, seeds: int) -> Row:
    """Judge that one error is smaller than another on the same data, by a two-sided sign test.

    Args:
        claim: What the paper says.
        won: Seeds in which it is.
        lost: Seeds in which it is not; in the rest they are equal.
        seeds: All of them.
    """
    p = float(binomtest(won, won + lost).pvalue) if won + lost else 1.0
    verdict = "no clear difference" if p >= TEST_LEVEL else "confirmed" if won > lost else "contradicted"
    return _row(claim, verdict, holds=won / seeds, p_value=p)


def nearly(claim: str, held: int, seeds: int) -> Row:
    """Judge that two errors are nearly the same, or one hardly larger: in `MIN_EQUAL_SHARE` of the seeds."""
    return statement_row(claim, held >= MIN_EQUAL_SHARE * seeds, held / seeds)
