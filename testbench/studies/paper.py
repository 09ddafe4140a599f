"""What the paper says, to stand beside ours: its numbers of sections 5 and 6, and its statements judged."""

import numpy as np
from scipy.stats import binomtest

from testbench.campaign.campaign import Cell, stream
from testbench.data.dataset import Dataset
from testbench.identify import Estimate
from testbench.model.structure import Structure
from testbench.report.table import Row
from testbench.studies.estimators.factorised import LARGEST_ORDER, LocalSolves
from testbench.trials.spread import Number, Spread, ends
from testbench.views.schema import show

LEVEL = 0.05  #: Of the sign test, two-sided.
MOST = 0.95  #: Share of the seeds in which two errors must be nearly the same.
HELD = ("confirmed", "consistent")  #: Verdicts of what our numbers do not speak against.
WIDE, EDGE = 2.0, 0.1
"""Ratio of the ends of a wide interval, and the share of its logarithm next to an end that is its edge."""
RULE = (
    "A number is consistent where the paper's lies inside our 5 to 95 % over the seeds, of fewer than 20 "
    "their range: one in ten lies outside even where nothing differs. It is not excluded, and no more, at "
    "the edge of a wide interval: one whose ends differ by a factor above 2, in the outer tenth of its "
    "logarithm. "
    "That one error is smaller than another is confirmed, or contradicted, by a sign test on the same data "
    "at 5 %, without ties; the best has to beat the best of the others. That two are nearly the same must "
    "hold in 95 % of the seeds, any other statement in all of them."
)
"""How every verdict is made."""


def judged(claim: str, holds: bool, why: str) -> Row:
    """A statement that holds, or not; one of seeds has to hold in all of them."""
    return Row(claim=claim, verdict="confirmed" if holds else "not confirmed", why=why)


def number(claim: str, ours: Number, paper: float, differs: str) -> Row:
    """A number of the paper: consistent inside our 5 to 95 % over the seeds, but at the edge of a wide one.

    Args:
        claim: What the paper says.
        ours: The same number over our seeds; without a spread nothing is consistent.
        paper: The paper's.
        differs: Why the two may be apart, in words behind "not inside".
    """
    low, high = ends(ours)
    inside = isinstance(ours, Spread) and low <= paper <= high
    why = f"ours {show(ours, '.3g')}"
    if inside and high > WIDE * low > 0:
        place = np.log(paper / low) / np.log(high / low)
        if min(place, 1 - place) < EDGE:
            edge = f"{why}: the paper's lies at the edge of a wide interval"
            return Row(claim=claim, verdict="not excluded", why=edge)
    if inside:
        return Row(claim=claim, verdict="consistent", why=why)
    if not isinstance(ours, Spread):
        return judged(claim, False, f"{why}; one seed has no spread to judge by")
    least, most = ("least", "most") if ours.few else ("5 %", "95 %")
    side = f"above our {most}" if paper > high else f"below our {least}"
    return judged(claim, False, f"{why}, the paper's lies {side}: {differs}")


def comparison(claim: str, test: str, won: int, lost: int, seeds: int) -> Row:
    """That one error is smaller than another on the same data, by a two-sided sign test.

    Args:
        claim: What the paper says.
        test: What is counted, in words before "in 3 of 100 seeds".
        won: Seeds in which it is.
        lost: Seeds in which it is not; in the rest they are equal.
        seeds: All of them.
    """
    p = binomtest(won, won + lost).pvalue if won + lost else 1.0
    verdict = "no clear difference" if p >= LEVEL else "confirmed" if won > lost else "contradicted"
    chance = f"= {p:.2g}" if p >= 1e-3 else "below 0.001"
    equal = f", equal in {seeds - won - lost}" if won + lost < seeds else ""
    why = f"{test} in {won} of {seeds} seeds, not in {lost}{equal}; p {chance}"
    return Row(claim=claim, verdict=verdict, why=why)


def nearly(claim: str, test: str, held: int, seeds: int) -> Row:
    """That two errors are nearly the same, or one hardly larger: in `MOST` of the seeds."""
    return judged(claim, held >= MOST * seeds, f"{test} in {held} of {seeds} seeds")


def every_order(cell: Cell, structure: Structure, data: Dataset, starts: int, seed: int) -> list[Estimate]:
    """GCO over vectors of Eq. (16), of every order m from 1 to 6: the best of some local solves."""
    return [
        LocalSolves(stream(seed, 10 + m), m, starts)(cell.vjm, structure, data)
        for m in range(1, LARGEST_ORDER + 1)
    ]


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
