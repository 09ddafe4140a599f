"""Records of several trials as one."""

from dataclasses import dataclass

import numpy as np

from testbench.trials.spread import Number, Share, Spread, merge, spread, wins


@dataclass(frozen=True)
class Row:
    f_m: Number
    solved: Share
    name: str
    advice: tuple[str, ...]


def test_numbers_have_a_spread_truths_a_share_and_what_is_the_same_stays():
    rows = [Row(float(k), k > 1, "MGCO47", ("weigh it",)) for k in range(1, 6)]
    assert merge(rows) == Row(Spread(3.0, 1.2, 4.8), 0.8, "MGCO47", ("weigh it",))


def test_a_spread_is_numpys_percentiles_to_the_bit(rng):
    many = [10.0 ** rng.integers(-9, 9) * rng.standard_normal(n) for n in range(1, 60)]
    for values in (*many, [1.0, np.nan, 2.0], [True, False, True], [3, 1, 2, 2]):
        own = spread(values)
        wanted = np.percentile(np.asarray(values, dtype=float), [50, 5, 95])
        np.testing.assert_array_equal([own.median, own.p05, own.p95], wanted)


def test_different_words_of_several_trials_are_listed_each_once():
    """A reader gets sentences, never a Python tuple."""
    rows = [
        Row(1.0, True, name, advice) for name, advice in (("b", ("x", "y")), ("a", ()), ("b", ("z", "x")))
    ]
    assert merge(rows) == Row(1.0, True, "a | b", ("x", "y", "z"))


def test_a_win_is_more_than_a_solvers_last_digits():
    assert wins([1.0, 1.0, 1.0 - 1e-9, 1.0 - 1e-5, 2.0], [1.0, 1.0 + 1e-9, 1.0, 1.0, 1.0]) == 1
