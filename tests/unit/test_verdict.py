"""How the paper's statements are judged: one rule for numbers, one for comparisons."""

import pytest

from testbench.studies.paper import comparison, nearly, number
from testbench.trials.spread import Spread

WIDE = Spread(median=7.76, p05=4.18, p95=48.7)  #: What section 6 finds of MLS56, in per cent.
OURS = Spread(median=0.80, p05=0.67, p95=1.08)  #: What 5.2 finds of MGCO56, in per cent.


@pytest.mark.parametrize(
    ("ours", "paper", "verdict", "words"),
    [
        (OURS, 0.67, "consistent", "ours 0.8 (0.67 to 1.08)"),
        (OURS, 1.08, "consistent", "ours 0.8 (0.67 to 1.08)"),
        (OURS, 0.62, "not confirmed", "(0.67 to 1.08), the paper's lies below our 5 %: another arm"),
        (OURS, 1.09, "not confirmed", "(0.67 to 1.08), the paper's lies above our 95 %: another arm"),
        (0.8, 0.8, "not confirmed", "one seed has no spread"),
        (WIDE, 4.19, "not excluded", "at the edge of a wide interval"),
        (WIDE, 20.0, "consistent", "ours 7.76 (4.18 to 48.7)"),
    ],
)
def test_a_number_is_consistent_inside_our_5_to_95_per_cent_and_nowhere_else(ours, paper, verdict, words):
    found = number("0.62 % at most", ours, paper, "another arm")
    assert found.verdict == verdict
    assert words in found.why


@pytest.mark.parametrize(
    ("won", "lost", "verdict"),
    [
        (697, 303, "confirmed; p below 0.001"),  # far from all seeds, and no chance
        (61, 39, "confirmed; p = 0.035"),
        (60, 40, "no clear difference"),  # p = 0.057
        (39, 61, "contradicted"),
        (6, 0, "confirmed"),  # p = 0.03: ties do not count
        (5, 0, "no clear difference"),
        (0, 0, "no clear difference"),
    ],
)
def test_a_comparison_is_judged_by_a_sign_test_without_ties(won, lost, verdict):
    found = comparison("GCO is better", "its error is the smaller one", won, lost, 1000)
    verdict, _, chance = verdict.partition("; ")
    assert found.verdict == verdict
    equal = f", equal in {1000 - won - lost}" if won + lost < 1000 else ""
    counts = f"in {won} of 1000 seeds, not in {lost}{equal}; p "
    assert found.why.startswith(f"its error is the smaller one {counts}")
    assert found.why.endswith(chance)
    for held, said in ((950, "confirmed"), (949, "not confirmed")):
        assert nearly("GCO is as good", "they differ by at most 5 %", held, 1000).verdict == said
