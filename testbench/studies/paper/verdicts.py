"""The paper's statements beside our numbers: rows of the table "paper, ours, verdict", all by one rule.

A number of the paper is consistent where it lies inside our 5 to 95 % over the seeds, of fewer than 20 inside
their range: one in ten lies outside even where nothing differs. It is not excluded, and no more, at the edge
of a wide interval. That one error is smaller than another is confirmed, or contradicted, by a sign test on
the same data, without ties; the best model has to beat the best of the others. That two errors are nearly the
same must hold in `MIN_EQUAL_SHARE` of the seeds, any other statement in all of them.

The paper's numbers of sections 5.1, 5.2 and 6, to compare with ours.
"""

import numpy as np
from scipy.stats import binomtest

from testbench.report.schema import Table, columns
from testbench.report.table import Row
from testbench.runs.spread import Number, Share, Spread, ends

SECTION_6: dict[str, dict[str, float]] = {
    "MLS32": {"identification_rms_mm": 0.107},
    "MLS56": {
        "identification_rms_mm": 0.085,
        "check_rms_mm": 0.144,
        "check_max_relative_percent": 4.19,
    },
    "MGCO47": {"identification_rms_mm": 0.152},
    "MGCO56": {
        "identification_rms_mm": 0.240,
        "check_max_mm": 0.354,
        "check_max_relative_percent": 6.28,
    },
    "MGCO68": {
        "identification_rms_mm": 0.119,
        "check_rms_mm": 0.136,
        "check_max_relative_percent": 3.98,
    },
}

SECTION_5_2: dict[str, dict[str, float]] = {
    "MLS56": {"check_p95_mm": 0.085, "check_max_relative_percent": 0.94},
    "MLS32": {"check_p95_mm": 0.078, "check_max_relative_percent": 0.80},
    "MGCO147": {"check_max_relative_percent": 0.87},
    "MGCO69": {"check_p95_mm": 0.084},
    "MGCO56": {"check_p95_mm": 0.072, "check_max_relative_percent": 0.62},
}
"""The cells of Table II that the text of section 5.2 gives.

They stand beside our errors against readings: that the paper's 120 check runs carry noise is our reading.
"""

Matrix = tuple[tuple[float, ...], ...]

EQ_22: Matrix = (
    (-7.32e-7, -2.15e-6, 2.05e-6, 1.29e-6, -2.25e-6, -6.89e-7),
    (-1.58e-6, 7.58e-5, -2.10e-6, 6.52e-7, -9.35e-7, 3.91e-4),
    (-3.00e-6, 1.79e-6, 3.43e-5, -1.95e-6, -1.73e-4, 1.03e-6),
    (8.39e-6, -1.74e-5, -3.59e-5, 3.80e-3, -1.80e-5, 2.50e-5),
    (-3.16e-5, -1.19e-5, -1.79e-4, -1.72e-5, 1.10e-3, 1.85e-5),
    (2.26e-5, 4.33e-4, 2.66e-5, 6.69e-5, 3.21e-5, 2.60e-3),
)
"""Compliance that least squares found in section 5.1, as printed in Eq. (22) [m/N, rad/N, rad/(N m)].

The truth, Eq. (21), is the compliance of models/single_link.
"""

EQ_23: Matrix = (
    (1.12e-7, -1.31e-6, 3.06e-7, 1.87e-6, -9.50e-7, 5.49e-7),
    (-1.31e-6, 7.62e-5, -8.24e-7, -8.45e-7, -4.65e-7, 3.92e-4),
    (3.06e-7, -8.24e-7, 2.95e-5, -2.68e-6, -1.75e-4, 6.63e-7),
    (1.87e-6, -8.45e-7, -2.68e-6, 3.80e-3, -1.79e-5, 6.47e-5),
    (-9.50e-7, -4.65e-7, -1.75e-4, -1.79e-5, 1.05e-3, 3.45e-5),
    (5.49e-7, 3.92e-4, 6.63e-7, 6.47e-5, 3.45e-5, 2.60e-3),
)
"""Compliance that GCO found from the same data, as printed in Eq. (23), same units."""


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

    Returns:
        The row.
    """
    return _row(claim, "confirmed" if verdict else "not confirmed", holds=holds)


def number(claim: str, ours: Number, paper: float) -> Row:
    """Judge a number of the paper: consistent inside our 5 to 95 % over the seeds, but at their edge.

    Args:
        claim: What the number is, with its unit.
        ours: The same number over our seeds; without a spread nothing is consistent.
        paper: The paper's.

    Returns:
        The row.
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

    Returns:
        The row.
    """
    p = float(binomtest(won, won + lost).pvalue) if won + lost else 1.0
    verdict = "no clear difference" if p >= TEST_LEVEL else "confirmed" if won > lost else "contradicted"
    return _row(claim, verdict, holds=won / seeds, p_value=p)


def nearly(claim: str, held: int, seeds: int) -> Row:
    """Judge that two errors are nearly the same, or one hardly larger: in `MIN_EQUAL_SHARE` of the seeds.

    Args:
        claim: What the paper says.
        held: Seeds in which it holds.
        seeds: Number of seeds.

    Returns:
        The row.
    """
    return statement_row(claim, held >= MIN_EQUAL_SHARE * seeds, held / seeds)
