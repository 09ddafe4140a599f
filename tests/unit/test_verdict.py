"""How the paper's statements are judged: one rule for numbers, one for comparisons."""

import pytest

from testbench.studies.paper import RULE, comparison, number
from testbench.trials.spread import Spread

OURS = Spread(median=0.80, p05=0.67, p95=1.08)  #: What 5.2 finds of MGCO56, in per cent.


@pytest.mark.parametrize(
    ("paper", "verdict", "words"),
    [
        (0.80, "confirmed", "1.00 times the paper's, which lies inside"),
        (0.67, "confirmed", "which lies inside"),
        (1.08, "confirmed", "which lies inside"),
        (0.62, "not confirmed", "1.29 times the paper's, which lies below our 5 %: another arm"),
        (1.09, "not confirmed", "0.73 times the paper's, which lies above our 95 %: another arm"),
    ],
)
def test_a_number_is_confirmed_inside_our_5_to_95_per_cent_and_nowhere_else(paper, verdict, words):
    found = number("0.62 % at most", OURS, paper, "another arm")
    assert found.verdict == verdict
    assert found.why.startswith("ours 0.8 (0.67 to 1.08), ")
    assert words in found.why


def test_one_seed_confirms_no_number_even_an_equal_one():
    found = number("0.8 % at most", 0.8, 0.8, "another arm")
    assert found.verdict == "not confirmed"
    assert "one seed has no spread" in found.why


@pytest.mark.parametrize(("held", "verdict"), [(100, "confirmed"), (95, "confirmed"), (94, "not confirmed")])
def test_a_comparison_is_confirmed_from_95_per_cent_of_the_seeds_on(held, verdict):
    found = comparison("GCO is better", "its error is the smaller one", held, 100)
    assert (found.verdict, found.why) == (verdict, f"its error is the smaller one in {held} of 100 seeds")


def test_the_rule_says_the_shares_that_are_used():
    assert "5 to 95 %" in RULE
    assert "at least 95 % of the seeds" in RULE
