"""The badge: who wins beside the strongest rival of its class, by how much, and whether it holds."""

import json
from dataclasses import replace

import numpy as np
import pytest
from checks import MOST_WORDS, sentences
from made_up_run import REPORT
from read_reports import read
from scipy.stats import binom

from testbench.report import badge
from testbench.report.badge import Badge, decide, drawn, incumbents, of_models
from testbench.report.table import SHARED, Row, Trials, merged
from testbench.runs.spread import independent
from testbench.workflows.model_names import in_words

NOISE = np.exp(np.random.default_rng(3).normal(0, 0.3, 40))
MODELS = [
    Row(name="Joints", structure="Joints", constraint="none", prior=False),
    Row(name="MLS56", structure="MLS56", constraint="none", prior=False),
    Row(name="MGCO56", structure="MGCO56", constraint="psd", prior=False),
    Row(name="MLS56 + prior", structure="MLS56", constraint="none", prior=True),
    Row(name="Ridge", structure="MLS56", constraint="ridge", prior=False),
    Row(name="LS153 + prior", structure="LS153", constraint="none", prior=True),
    Row(name="ALL153 + prior", structure="ALL153", constraint="psd", prior=True),
]


TIMES = np.array([1.1, 1.2, 1.3, 1.4, 1.5, 1.6])


@pytest.mark.parametrize(
    ("ours", "theirs", "verdict", "winner", "factor"),
    [
        (NOISE, 2 * NOISE, "holds", "ours", 2),
        (2 * NOISE, NOISE, "do not use", "theirs", 2),
        (NOISE, NOISE[::-1], "tie", "ours", None),  # the interval covers one
        (NOISE, 1.01 * NOISE, "tie", "ours", 1.01),  # within two percent, however sure
        (1.01 * NOISE, NOISE, "tie", "ours", 1 / 1.01),
        (NOISE, 1.03 * NOISE, "holds", "ours", 1.03),
        (np.ones(6), TIMES, "holds", "ours", 1.35),  # six of six are enough, and five of six are not
        (np.ones(6), np.r_[0.9, TIMES[1:]], "tie", "ours", None),
        (3 * NOISE[:5], NOISE[:5], "undecided", "theirs", 3),
        (3 * NOISE[:1], NOISE[:1], "undecided", "theirs", 3),
        ([np.inf, np.nan], [1.0, 1.0], "undecided", "ours", None),
    ],
)
def test_a_verdict_is_by_the_median_of_the_ratios_and_its_interval(ours, theirs, verdict, winner, factor):
    own = decide(("ours", ours), ("theirs", theirs))
    assert (own.verdict, own.winner) == (verdict, winner)
    assert own.words.lower().startswith(verdict)
    assert own.n == np.isfinite(ours).sum()
    assert factor is None or own.factor == pytest.approx(factor)
    assert (own.interval is None) == (verdict == "undecided")
    if own.interval:
        low, high = own.interval
        assert low <= own.factor <= high
        assert verdict == "tie" or low > 1


def test_words_name_the_better_one_before_the_other_and_a_reason_is_no_use_whatever_the_numbers():
    words = decide(("ours", NOISE), ("theirs", 2 * NOISE)).words
    assert words.index("ours") < words.index("2.0x lower") < words.index("theirs")
    assert decide(("a", []), ("b", [])).words == "Undecided: no trial has errors of both a and b."
    own = decide(("a", NOISE), ("b", 9 * NOISE), why="see the warning")
    assert (own.winner, own.verdict, own.words) == ("a", "do not use", "Do not use a: see the warning.")


@pytest.mark.parametrize(
    ("ends", "said"),
    [
        ((1.02, 1.2), "1.02 to 1.20"),
        ((1.2, 12), "1.2 to 12.0"),
        ((10, 12), "10 to 12"),
        ((1.0031, 1.7099), "1.003 to 1.710"),  # what holds does not begin at one
    ],
)
def test_both_ends_of_an_interval_have_as_many_decimals(ends, said):
    own = Badge("a", "b", max(1.1, ends[0]), ends, 20, "holds")
    assert f"95 % interval {said})" in own.words


@pytest.mark.parametrize("each", ["trial", badge.POSES])
def test_errors_that_are_rounding_are_so_much_lower_at_least_and_have_no_interval(each):
    own = decide(("ours", 1e-12 * NOISE), ("theirs", NOISE), each)
    assert json.loads(json.dumps(own.json()))["exact"] is True
    assert "at least" in own.words
    assert not decide(("ours", NOISE / 100), ("theirs", NOISE), each).exact
    assert not decide(("ours", 0 * NOISE), ("theirs", 0 * NOISE), each).exact


def test_few_errors_are_called_the_same_only_if_their_numbers_are():
    assert "the error of A is 1.01x lower than that of B in 1 pair of runs" in _of_two_runs(0.138, 0.136)
    assert "B and A have the same error in 1 pair of runs" in _of_two_runs(0.138, 0.13801)


def _of_two_runs(b, a):
    return decide(("B", [b]), ("A", [a]), "pair of runs").words


@pytest.mark.parametrize("n", [6, 8, 25, 60])
def test_the_interval_of_the_median_is_the_narrowest_that_covers_at_least_95_percent(n):
    """Its ends are the k-th from either side: all miss the median where k or fewer are on one side of it."""
    times = np.exp(np.linspace(-1, 1.1, n))
    low, high = np.searchsorted(times, decide(("a", np.ones(n)), ("b", times[::-1])).interval)
    assert low + high == n - 1
    assert 2 * binom.cdf(low, n, 0.5) <= 0.05 < 2 * binom.cdf(low + 1, n, 0.5)


def test_poses_of_one_arm_are_compared_by_the_ratio_of_the_rms_errors_of_tables():
    a, b = NOISE, 1.5 * NOISE[::-1]
    own = decide(("a", a), ("b", b), badge.POSES)
    assert own.factor == pytest.approx(np.sqrt((b**2).mean() / (a**2).mean()))
    assert own == decide(("a", a), ("b", b), badge.POSES)  # no chance in it
    # of the logarithm to first order; 2000 draws tell a quantile to a tenth of the deviation
    apart = b**2 / (b**2).mean() - a**2 / (a**2).mean()
    half = 1.96 * np.sqrt(np.square(apart).mean() / len(a)) / 2
    np.testing.assert_allclose(np.log(own.interval) - np.log(own.factor), [-half, half], atol=0.25 * half)


def test_a_class_is_least_squares_and_joints_with_a_prior_only_where_the_model_has_one():
    rivals = ["Joints", "MLS56", "MLS56 + prior", "Ridge", "LS153 + prior"]
    assert incumbents(MODELS, "ALL153 + prior") == rivals
    assert incumbents(MODELS, "MGCO56") == ["Joints", "MLS56", "Ridge"]


def table(**errors):
    """Trials of models by their errors."""
    rows = [(name, k, mm) for name, own in errors.items() for k, mm in enumerate(own)]
    names, seeds, mm = zip(*rows, strict=True)
    names = [name.replace("_", " + ") for name in names]
    return Trials({}).add(name=np.array(names, dtype=object), seed=seeds, mm=mm)


def test_the_rival_is_the_strongest_of_its_class_in_the_same_trials():
    trials = table(
        Joints=3 * NOISE, MLS56=9 * NOISE, MLS56_prior=2 * NOISE, ALL153_prior=NOISE, MGCO56=0.5 * NOISE
    )
    own = of_models(trials, MODELS, "ALL153 + prior", "mm")
    assert (own.rival, own.verdict) == ("MLS56 + prior", "holds")
    assert own.factor == pytest.approx(2)
    assert of_models(trials, MODELS, "MGCO56", "mm").rival == "Joints"
    assert of_models(table(MGCO56=NOISE), MODELS, "MGCO56", "mm") is None


def test_all_that_tie_are_named_the_strongest_first_and_a_weaker_one_is_no_rival():
    same = {"LS153_prior": 0.999 * NOISE, "MLS56_prior": 1.01 * NOISE}
    trials = table(Joints=3 * NOISE, ALL153_prior=NOISE, **same)
    own = of_models(trials, MODELS, "ALL153 + prior", "mm")
    assert (own.verdict, own.rival, own.ties) == ("tie", "LS153 + prior", ("LS153 + prior", "MLS56 + prior"))
    assert read(json.loads(json.dumps(replace(REPORT, badge=own).json()))).badge == own
    three = replace(own, ties=("MGCO56 + prior", *own.ties[::-1]))
    assert in_words("LS153 + prior") in three.words
    assert "2 others" in three.words
    assert in_words("MLS56 + prior") not in three.words
    places = Trials({}).add(
        name=np.array(["ALL153 + prior", "LS153 + prior", "Joints"], dtype=object),
        seed=[1, 1, 1],
        mm=[1.0, 1.0, 3.0],
        **{badge.PLACES: [tuple(own) for own in (NOISE, NOISE, 3 * NOISE)]},
    )
    alone = of_models(places, MODELS, "ALL153 + prior", "mm")
    assert (alone.verdict, alone.ties, alone.each) == ("tie", ("LS153 + prior",), badge.POSES)


def test_cases_that_share_a_trial_have_an_interval_by_trial_and_too_few_trials_have_none():
    """Thirty arms in six trials, alike within a trial: as sure as six trials are, not as thirty."""
    trial, rng = np.repeat(np.arange(12), 30), np.random.default_rng(2)
    ratio = np.exp(np.linspace(-0.3, 0.5, 12))[trial] * np.exp(rng.normal(0, 0.02, len(trial)))
    rows = [
        (name, k, mm) for name, own in (("a", 1 / ratio), ("b", 0 * ratio + 1)) for k, mm in enumerate(own)
    ]
    names, seeds, mm = zip(*rows, strict=True)
    plain = Trials({}).add(name=np.array(names, dtype=object), seed=seeds, mm=mm)
    shared = plain.add(**{SHARED: np.tile(trial, 2)})
    sure, own = (badge.of_rivals(t, "a", ["b"], "mm", "case") for t in (plain, shared))
    assert own.factor == sure.factor
    assert np.log(own.interval[1] / own.interval[0]) > 3 * np.log(sure.interval[1] / sure.interval[0])
    five = shared.pick(shared[SHARED] < 5)
    assert badge.of_rivals(five, "a", ["b"], "mm", "case").verdict == "undecided"
    [row] = merged(shared.where(name="a").keep("mm", SHARED))
    assert (row.mm.trials, len(row.mm.values)) == (12, 12)
    assert row.mm.median == np.median(1 / ratio)  # numbers of models do not move


def test_a_share_of_cases_is_as_sure_as_its_trials_allow():
    trial, rng = np.repeat(np.arange(100), 6), np.random.default_rng(1)
    alike, free = (rng.random(100) < 0.3)[trial], rng.random(600) < 0.3
    assert independent(alike, trial) == 100
    assert 400 < independent(free, trial) <= 600
    assert independent(np.zeros(600), trial) == 100  # nothing tells how alike cases of a trial are


def test_every_picture_has_the_rival_joint_stiffness_and_on_top_the_winner():
    names = [m.name for m in MODELS]
    own = decide(("ALL153 + prior", NOISE), ("MLS56 + prior", 2 * NOISE))
    assert drawn(own, names, "MLS56") == ["MLS56", "MLS56 + prior", "Joints", "ALL153 + prior"]
    lost = decide(("ALL153 + prior", 2 * NOISE), ("Joints", NOISE))
    assert drawn(lost, names, "MLS56") == ["MLS56", "ALL153 + prior", "Joints"]
    assert drawn(None, names, "MLS56") == ["MLS56", "Joints"]


@pytest.mark.parametrize(
    "own",
    [
        decide(("ALL153 + prior", NOISE), ("MLS56 + prior", k * NOISE), each)
        for k in (0.2, 0.99, 1, 3.7, 1e6)
        for each in ("trial", badge.POSES)
    ]
    + [Badge("a", "b", None, None, 0, "undecided"), decide(("a", [1]), ("b", [2]))],
)
def test_the_words_are_one_short_sentence_that_begins_with_the_verdict(own):
    assert own.words.lower().startswith(own.verdict)
    [one] = sentences(own.words)
    assert len(one.split()) <= MOST_WORDS + 12  # two names in words, and the trials with their interval
