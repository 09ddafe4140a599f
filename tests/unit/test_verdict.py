"""How the paper's statements are judged: one rule for numbers, one for comparisons."""

import pytest

from testbench.studies.paper import RULE, comparison, nearly, number
from testbench.trials.spread import Spread

OURS = Spread(median=0.80, p05=0.67, p95=1.08)  #: What 5.2 finds of MGCO56, in per cent.


@pytest.mark.parametrize(
    ("paper", "verdict", "words"),
    [
        (0.80, "confirmed", ""),
        (0.67, "confirmed", ""),
        (1.08, "confirmed", ""),
        (0.62, "not confirmed", ", the paper's lies below our 5 %: another arm"),
        (1.09, "not confirmed", ", the paper's lies above our 95 %: another arm"),
    ],
)
def test_a_number_is_confirmed_inside_our_5_to_95_per_cent_and_nowhere_else(paper, verdict, words):
    found = number("0.62 % at most", OURS, paper, "another arm")
    assert found.verdict == verdict
    assert found.why == f"ours 0.8 (0.67 to 1.08){words}"


def test_one_seed_confirms_no_number_even_an_equal_one():
    found = number("0.8 % at most", 0.8, 0.8, "another arm")
    assert found.verdict == "not confirmed"
    assert "one seed has no spread" in found.why


@pytest.mark.parametrize(
    ("won", "lost", "verdict"),
    [
        (697, 303, "confirmed"),  # p = 2e-36: far from all seeds, and no chance
        (61, 39, "confirmed"),  # p = 0.035
        (60, 40, "no clear difference"),  # p = 0.057
        (39, 61, "contradicted"),
        (6, 0, "confirmed"),  # p = 0.03: ties do not count
        (5, 0, "no clear difference"),
        (0, 0, "no clear difference"),
    ],
)
def test_a_comparison_is_judged_by_a_sign_test_without_ties(won, lost, verdict):
    found = comparison("GCO is better", "its error is the smaller one", won, lost, 1000)
    assert found.verdict == verdict
    assert found.why.startswith(f"its error is the smaller one in {won} of 1000 seeds, larger in {lost}")


def test_the_sign_test_says_its_chance():
    assert comparison("", "smaller", 697, 303, 1000).why.endswith("p below 0.001")
    assert comparison("", "smaller", 61, 39, 100).why.endswith("p = 0.035")


@pytest.mark.parametrize(("held", "verdict"), [(95, "confirmed"), (94, "not confirmed")])
def test_two_are_nearly_the_same_from_95_per_cent_of_the_seeds_on(held, verdict):
    assert nearly("GCO is as good", "they differ by at most 5 %", held, 100).verdict == verdict


def test_the_rule_says_the_shares_that_are_used():
    assert "5 to 95 %" in RULE
    assert "hold in 95 % of the seeds" in RULE
    assert "sign test on the same data at 5 %" in RULE
