"""Numbers of several trials with their spread, and sentences each once."""

import numpy as np
import pytest

from testbench.trials.spread import Spread, dotted, inner, most_trials, spans, spread, twins_once, wins
from testbench.views import terminal
from testbench.views.page import page as html
from testbench.views.schema import Column, Table, brackets


def test_a_spread_is_numpys_percentiles_to_the_bit(rng):
    many = [10.0 ** rng.integers(-9, 9) * rng.standard_normal(n) for n in range(1, 60)]
    for values in (*many, [1.0, np.nan, 2.0], [True, False, True], [3, 1, 2, 2]):
        own = spread(values)
        wanted = np.percentile(np.asarray(values, dtype=float), [50, 5, 95])
        np.testing.assert_array_equal([own.median, own.p05, own.p95], wanted)


def test_sentences_that_differ_in_numbers_alone_are_told_once_with_their_ranges_and_count():
    """302 bullets of one report differed in a number; names of models are no numbers."""
    off = [(f"MGCO56: F_M is {f_m} where noise alone leaves 1.7",) for f_m in (3.54, 10.2, 6)]
    assert twins_once((*off, ("MGCO68: F_M is 3",), ("weigh it",))) == (
        "MGCO56: F_M is 3.54 to 10.2 where noise alone leaves 1.7 (3 of 5 trials)",
        "MGCO68: F_M is 3",
        "weigh it",
    )


def test_of_few_trials_the_ends_are_the_range_and_of_twenty_percentiles():
    """Percentiles of three numbers are no percentiles; report.json has both, with the number of trials."""
    few, many = spread([1.0, 2.0, 9.0]), spread(np.arange(20.0))
    assert (few.ends, few.trials, few.least, few.most) == ((1.0, 9.0), 3, 1.0, 9.0)
    assert many.ends == (many.p05, many.p95) == (pytest.approx(0.95), pytest.approx(18.05))
    assert few.scaled(2.0).ends == (2.0, 18.0)
    assert [most_trials(n) for n in (1, 3, 20)] == ["the trial", "all 3 trials", "95 % of 20 trials"]
    assert spans([few, many, 1.0]) == "5 to 95 %, of fewer than 20 trials their range"
    assert (spans([few]), spans([many]), spans([1.0])) == ("range of 3 trials", "5 to 95 % of 20 trials", "")


def test_a_terminal_and_a_page_say_of_few_trials_that_brackets_hold_their_range():
    for trials, ends, words in (
        (3, ["  least of 3", "  most"], "range of 3"),
        (20, ["  5 %", "  95 %"], "5 to 95 % of 20"),
    ):
        rows = [{"name": "a", "x": spread(np.arange(float(trials)))}]
        table = Table((Column("name", "model"), Column("x", "error", "mm")), rows)
        assert list(terminal.grid(table).columns[0].cells)[1:] == ends
        assert brackets(table) == f"{words} trials"
        assert html.grid(table)["brackets"] == f"{words} trials"


def test_a_picture_says_what_its_dots_and_lines_are():
    values = np.random.default_rng(2).uniform(1, 2, 250)
    few, many, most = (spread(values[:n]) for n in (3, 20, 250))
    assert dotted([few, 1.0, "word"]) == "dots: 3 trials"
    assert dotted([many, many]) == "dots: 20 trials; line: 95 % interval of their median"
    assert dotted([most]) == "dots: 100 of 250 trials; line: 95 % interval of their median"
    assert dotted([1.0]) == dotted([spread([1.0, 1.0])]) == ""
    assert dotted([Spread(2.0, 1.0, 3.0)]) == "lines: 5 to 95 %"


def test_a_spread_keeps_a_hundred_trials_of_all_kinds_and_the_interval_of_all_of_them():
    """Trials stand kind by kind, each with larger numbers than the last: dots are of all kinds alike."""
    values = np.sort(np.random.default_rng(2).uniform(1, 2, 250))
    own = spread(values).scaled(1000)
    assert len(own.values) == 100
    assert [sum(low <= x < low + 250 for x in own.values) for low in (1000, 1250, 1500, 1750)] == [
        pytest.approx(np.sum((low <= values) & (values < low + 0.25)) / 2.5, abs=1)
        for low in (1, 1.25, 1.5, 1.75)
    ]
    low, high = np.sort(values)[[109, 140]]  # the sign test's: 250 tosses are within 110 and 140 in 95 %
    assert own.interval == (1000 * low, 1000 * high)
    assert inner(own) == own.interval
    assert inner(spread(values[:19])) is None
    assert inner(Spread(2.0, 1.0, 3.0)) == (1.0, 3.0)


def test_a_win_is_more_than_a_solvers_last_digits():
    assert wins([1.0, 1.0, 1.0 - 1e-9, 1.0 - 1e-5, 2.0], [1.0, 1.0 + 1e-9, 1.0, 1.0, 1.0]) == 1
