"""Shares, powers of ten and places as readers see them."""

import pytest

from testbench.report.markdown import place
from testbench.report.schema import plain, show, written_out
from testbench.runs.spread import Spread


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
