"""How the paper's statements are judged: one rule for numbers, one for comparisons."""

import pytest

from testbench.runs.spread import Spread
from testbench.studies.paper.verdicts import comparison, number

WIDE = Spread(median=7.76, p05=4.18, p95=48.7)  #: What section 6 finds of MLS56, in per cent.
OURS = Spread(median=0.80, p05=0.67, p95=1.08)  #: What 5.2 finds of MGCO56, in per cent.


@pytest.mark.parametrize(
    ("ours", "paper", "verdict"),
    [
        (OURS, 0.67, "consistent"),
        (OURS, 1.08, "consistent"),
        (OURS, 0.62, "not confirmed"),
        (OURS, 1.09, "not confirmed"),
        (0.8, 0.8, "not confirmed"),  # one seed has no spread
        (WIDE, 4.19, "not excluded"),
        (WIDE, 20.0, "consistent"),
    ],
)
def test_a_number_is_consistent_inside_our_5_to_95_per_cent_and_nowhere_else(ours, paper, verdict):
    found = number("largest relative error, %", ours, paper)
    assert (found.verdict, found.published, found.found) == (verdict, paper, ours)


@pytest.mark.parametrize(
    ("won", "lost", "verdict", "p"),
    [
        (697, 303, "confirmed", 0.0),  # far from all seeds, and no chance
        (61, 39, "confirmed", 0.035),
        (60, 40, "no clear difference", 0.057),
        (39, 61, "contradicted", 0.035),
        (6, 0, "confirmed", 0.031),  # ties do not count
        (5, 0, "no clear difference", 0.0625),
        (0, 0, "no clear difference", 1.0),
    ],
)
def test_a_comparison_is_judged_by_a_sign_test_without_ties(won, lost, verdict, p):
    found = comparison("GCO is better", won, lost, 1000)
    assert (found.verdict, found.holds) == (verdict, won / 1000)
    assert found.p_value == pytest.approx(p, rel=0.02, abs=1e-30)
