"""Gains, powers of ten and places as readers see them, and the check of all words itself."""

import numpy as np
import pytest
from checks import word_faults

from testbench.report.gains import beside, gained, less, more, share, wilson
from testbench.report.markdown import place
from testbench.report.report import say
from testbench.report.schema import plain, show, written_out
from testbench.runs.spread import Spread, median_interval


def test_a_ratio_is_that_of_each_seed_and_not_of_the_medians():
    """Medians 1 and 4, ratios 10, 4 and 1: in the median 4."""
    gain = gained("ours", "theirs", [0.1, 1.0, 4.0], [1.0, 4.0, 4.0])
    assert (gain.ours_mm.median, gain.theirs_mm.median, gain.trials) == (1.0, 4.0, 3)
    assert gain.times == Spread(4.0, pytest.approx(1.3), pytest.approx(9.4))


def test_of_fewer_than_twenty_trials_the_range_is_told_and_their_number():
    """Percentiles of three seeds are none: 19 seeds tell their range, 20 what lies between 5 and 95 %."""
    for trials, middle, ends, of in (
        (3, "", "2.0 to 20", " in 3 seeds"),
        (19, ", 95 %: 6.0 to 16", "2.0 to 20", " in 19 seeds"),
        (20, ", 95 %: 6.7 to 15", "2.9 to 19", " in 90 %"),
    ):
        gain = gained("ours", "theirs", [1.0] * trials, np.linspace(2.0, 20.0, trials).tolist())
        assert less(gain, "seed") == f"11 times smaller (median of ratios{middle}; {ends}{of})"
        assert less(gain) == f"11 times smaller (median of ratios{middle}; {ends})"
        assert more(gain, "seed") == f"11 times larger (median of ratios{middle}; {ends}{of})"


def test_the_title_of_a_figure_says_how_much_more_the_others_err():
    gain = gained("ours", "theirs", [0.1, 1.0, 4.0], [1.0, 4.0, 8.0])
    known = {"least squares": gain, "joints alone": None, "both": gained("ours", "same", [0.2], [0.2])}
    told = "ours 1.000 mm; least squares 4.000 mm, 4.0 times larger; "
    told += "both 0.200 mm, no clear difference"
    assert beside(known) == told
    assert beside({"least squares": gain}, "um").startswith("ours 1000 um; least squares 4000 um, ")
    assert beside({"joints alone": None}) == ""
    apart = gained("ours", "theirs", [0.1, 1.0, 4.0], [1.0, 4.0, 4.0])  # medians alike, ratios 10, 4 and 1
    odd = gained("ours", "theirs", [1.0, 1.0, 4.0], [2.0, 3.0, 4.4])  # 3.0 over 1.0 is not 2.0
    assert "(median of ratios)" not in beside({"a": apart})
    assert beside({"a": odd}) == "ours 1.000 mm; a 3.000 mm, 2.0 times larger (median of ratios)"


def test_there_is_no_clear_difference_where_the_interval_of_the_median_holds_1():
    gain = gained("ours", "theirs", [1.0, 1.0, 1.0], [0.5, 1.2, 2.0])
    assert gain.tie
    assert less(gain) == more(gain) == "no clear difference"
    told = "no clear difference (0.50 to 2.0 times in 3 seeds)"
    assert less(gain, "seed") == more(gain, "seed") == told
    same = gained("ours", "theirs", [1.0, 2.0], [1.001, 2.002])
    assert less(same, "seed") == "no clear difference"


def test_the_interval_of_the_median_decides_where_trials_differ_in_which_is_better():
    """Of 100 ratios 80 are 2 and 20 are 0.8: the sign test is clear, though 90 % of them hold 1."""
    gain = gained("ours", "theirs", [1.0] * 100, [2.0] * 80 + [0.8] * 20)
    assert gain.interval == (2.0, 2.0)
    assert not gain.tie
    assert less(gain, "seed") == "2.0 times smaller (median of ratios; 0.80 to 2.0 times in 90 %)"
    assert more(gain, "seed") == "2.0 times larger (median of ratios; 0.50 to 1.2 times in 90 %)"
    half = gained("ours", "theirs", [1.0] * 100, [2.0] * 55 + [0.8] * 45)
    assert half.tie


def test_nothing_is_one_time_smaller():
    gain = gained("ours", "theirs", [1.0] * 100, [1.004] * 70 + [1.2] * 30)
    assert less(gain, "seed") == "less than 1 % smaller (median of ratios; 1.00 to 1.2 in 90 %)"
    assert more(gain, "seed") == "less than 1 % larger (median of ratios; 1.00 to 1.2 in 90 %)"


def test_the_interval_of_a_median_is_that_of_the_sign_test():
    """Of 100 values the 40th and the 61st: 39 or fewer of 100 tosses are heads in 1.8 %."""
    values = np.random.default_rng(0).permutation(100.0 + np.arange(100))
    assert median_interval(values) == (139.0, 160.0)
    assert median_interval(np.arange(5.0)) is None
    assert median_interval(np.arange(6.0)) == (0.0, 5.0)


@pytest.mark.parametrize(
    ("ours", "theirs", "words"),
    [(0.11, 0.944, "8.6 times smaller"), (0.4, 0.1, "4.0 times larger"), (1.0, 1.01, "no clear difference")],
)
def test_of_one_seed_the_ratio_is_plain(ours, theirs, words):
    assert less(gained("ours", "theirs", [ours], [theirs]), "seed") == words
    assert words in more(gained("theirs", "ours", [theirs], [ours]), "seed")


@pytest.mark.parametrize(
    ("number", "words"),
    [
        ("1.23e+03", "1230"),
        ("1e+03", "1000"),
        ("2.9e-03", "0.0029"),
        ("-1.2e-08", "-1.2 x 10^-8"),
        ("0.0e+00", "0"),
        ("5.0e+00", "5.0"),
        ("4e+07", "4 x 10^7"),
        ("0.25", "0.25"),
    ],
)
def test_powers_of_ten_are_written_out(number, words):
    assert plain(number) == words


def test_numbers_beyond_all_are_words_and_a_place_has_its_axes_and_unit():
    assert show(float("inf")) == "infinite"
    assert show(Spread(1.0, 0.5, float("inf")), ".1f") == "1.0 (0.5 to infinite)"
    assert show(float("nan")) == "-"
    assert place((1.2, -0.354, 2)) == "x 1.20, y -0.35, z 2.00 m"


def test_numbers_in_sentences_of_others_are_written_out_but_not_in_commands():
    said = "they lie 1.23e+03 mm off, weight 1e-08. `--tol 1e-06`, run 2e-3b, 1.5e-05 m."
    out = "they lie 1230 mm off, weight 1 x 10^-8. `--tol 1e-06`, run 2e-3b, 1.5 x 10^-5 m."
    assert written_out(said) == out


GOOD = {"answer": "A errs less.", "worst": "Worst in pose 3.", "statements": "- One.\n- Two."}
LONG = " ".join(["word"] * 26)


@pytest.mark.parametrize(
    ("block", "text", "fault"),
    [
        ("answer", f"{LONG}.", "26 words"),
        ("statements", "- A.\n- B.\n- C.\n- D.\n- E.\n- F.", "6 statements"),
        ("statements", "- A errs less.", "said twice"),
        ("statements", "- Of 9 bars one is missed.", "a goal"),
        ("statements", "- The check_true.rms_mm is small.", "a key of the report"),
    ],
)
def test_the_check_of_words_sees_every_fault(block, text, fault):
    def faults(blocks):
        return word_faults(blocks, "\n\n".join(blocks.values()))

    assert faults(GOOD) == []
    assert any(fault in found for found in faults(GOOD | {block: text}))


def test_a_share_has_the_interval_of_its_score_test():
    """At the ends (p - s)^2 = z^2 s (1 - s) / n: what lies outside does not go with the trials."""
    for won, n in ((0, 20), (79, 100), (612, 612)):
        p = won / n
        ends = wilson(p, n)
        for s in ends:
            assert (p - s) ** 2 == pytest.approx(1.959964**2 * s * (1 - s) / n, abs=1e-12)
        assert 0 <= ends[0] <= p <= ends[1] <= 1
    assert share(0.79, "100") == "79 % (70 to 86 %)"
    assert share(1 / 612, "612") == "0.2 % (0.0 to 0.9 %)"
    assert say("{won:share {n}} of {n}", won=1.0, n=20) == "100 % (84 to 100 %) of 20"
