"""The report of corrected jobs holds and draws what their trials hold, of trials that are made up."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from checks import check_spread, unit_in
from reports import check, table_of

from testbench.plant.true_arms import FAMILY_NAME, FAMILY_TRUE_ARMS, true_arm_of_seed
from testbench.report.colours import CHOICE, JOINTS
from testbench.report.table import Row, find
from testbench.studies.compensation import (
    ADVISED,
    ARMS,
    DEFAULT,
    IDEAL,
    IDENTIFIED,
    LEAST_SQUARES,
    LINEAR,
    LOOKS,
    MODELS,
    NOMINAL,
    NOWHERE,
    PERFECT,
    PRIOR,
    REAL,
    STUDY,
    WEIGHT,
    CompensationSettings,
    JobsRow,
)
from testbench.studies.study import DEFAULT_WITHOUT_CONE
from testbench.workflows.model_names import row_words

SETTINGS, SEEDS, POINTS = CompensationSettings("kr500_l480", 300), range(300, 306), 10
LEFT = {PERFECT: 1e-8, DEFAULT: 0.02, "Joints": 0.08, NOMINAL: 0.3, PRIOR: 0.7}
TIMES = {REAL: 5, LINEAR: 2, WEIGHT: 3}  #: As much is left.


def row(rng, seed, arm, way, name):
    before, identified = rng.uniform(0.5, 3.0, POINTS), name in IDENTIFIED
    left = LEFT.get(name, 0.5) * TIMES.get(arm, 1) * TIMES.get(way.loads, 1) * rng.uniform(0.5, 1.5, POINTS)
    return JobsRow(
        **{"true_arm": true_arm_of_seed(FAMILY_NAME, seed), "arm": arm, **vars(way), "name": name},
        chosen="ALL153 + prior" if name == DEFAULT else None,
        before_mm=tuple(before.tolist()),
        after_mm=tuple((left * before).tolist()),
        **{"inside": 27 * identified, "of": 3 * POINTS * identified, "unseen": 0, "buckled": False},
    )


def made(spoil=lambda row: row):
    """A seed each true arm; `spoil` changes the default's row of the advised campaign in the first seed."""

    def rows(seed):
        rng = np.random.default_rng(seed)
        for arm in ARMS:
            for way, name in itertools.product((NOWHERE, *SETTINGS.ways(arm)), MODELS):
                if (name in IDENTIFIED) == (way != NOWHERE):
                    own = row(rng, seed, arm, way, name)
                    named = (seed, arm, way, name) == (SEEDS[0], REAL, ADVISED, DEFAULT)
                    yield spoil(own) if named else own

    trials = table_of(SEEDS, lambda seed: list(rows(seed)))
    return STUDY.report(SETTINGS, SEEDS, trials), trials


@pytest.fixture(scope="module")
def found():
    return made()


def group(f, name, way, arm):
    return find(f.groups, name=name, campaign=way.campaign, poses=way.poses, arm=arm)


def of_default(found):
    return group(Row(found.numbers), DEFAULT, ADVISED, REAL)


def points(trials, name, key):
    """Of every trial of the campaign that is advised."""
    return np.array([*trials.where(**vars(ADVISED), arm=REAL, name=name)[key]])


def test_cases_are_points_of_trials_and_shares_are_over_all_of_them(found):
    found, trials = found
    before, after = (points(trials, DEFAULT, key) for key in ("before_mm", "after_mm"))
    shares, own = 100 * (1 - after / before), of_default(found)
    assert (own.cases, own.trials, own.worse) == (6 * POINTS, 6, 0)
    check_spread(own.removed_percent, shares.ravel())
    check_spread(own.after.median_mm, np.median(after, axis=1))
    check_spread(own.before.p95_mm, np.percentile(before, 95, axis=1))
    assert (own.worst_percent, own.after.most_mm) == pytest.approx((shares.min(), after.max()))
    assert own.nine_percent == pytest.approx(100 * np.mean(shares >= 90))
    assert own.covered_percent == pytest.approx(90)
    by_truth = [g for g in found.numbers["by_truth"] if (g.name, g.arm) == (DEFAULT, REAL)]
    assert [(g.true_arm, g.cases) for g in by_truth] == [(name, POINTS) for name in FAMILY_TRUE_ARMS]


def test_the_default_is_judged_beside_the_strongest_rival_by_what_is_left(found):
    found, trials = found
    check(found, ["short"])
    left = {name: np.median(points(trials, name, "after_mm"), axis=1) for name in IDENTIFIED}
    rivals = {name: np.median(left[name]) for name in (LEAST_SQUARES, "Joints", DEFAULT_WITHOUT_CONE)}
    strongest = min(rivals, key=rivals.get)
    assert (found.badge.winner, found.badge.rival, found.badge.verdict) == (DEFAULT, strongest, "holds")
    assert found.badge.factor == pytest.approx(np.median(left[strongest] / left[DEFAULT]))


def test_one_point_made_worse_in_one_trial_is_found():
    found, _ = made(lambda row: replace(row, after_mm=(1.01 * row.before_mm[0], *row.after_mm[1:])))
    own = of_default(found)
    assert (own.worse, own.worst_percent) == (1, pytest.approx(-1))


def test_intervals_that_miss_lower_the_share_and_components_without_a_bound_count_in_none():
    found, _ = made(lambda row: replace(row, inside=0))
    covered = [group(Row(found.numbers), DEFAULT, ADVISED, arm).covered_percent for arm in (REAL, IDEAL)]
    assert covered == pytest.approx([100 * 5 * 27 / (6 * 30), 90])
    own = of_default(made(lambda row: replace(row, inside=4, of=4, unseen=26, buckled=True))[0])
    assert own.covered_percent == pytest.approx(100 * (4 + 5 * 27) / (4 + 5 * 30))
    assert (own.unseen_percent, own.buckled) == (pytest.approx(100 * 26 / (6 * 30)), 1)


def test_the_figure_draws_what_is_left_in_the_colour_of_each_model(found):
    f, panes = Row(found[0].numbers), STUDY.figures(found[0])["compensation.png"].axes
    assert (LOOKS[DEFAULT], LOOKS["Joints"].colour) == (CHOICE, JOINTS)
    for pane, arm in zip(panes, (REAL, IDEAL), strict=True):
        for name in IDENTIFIED:
            [dots] = [line for line in pane.get_lines() if line.get_label() == row_words(name)]
            every = [group(f, name, way, arm).after.median_mm for way in SETTINGS.ways(REAL)]
            assert dots.get_xdata() == pytest.approx([own.median for own in every])
            assert dots.get_color() == LOOKS[name].hex
            spreads = [line.get_xdata() for line in pane.get_lines() if len(line.get_xdata()) == 2]
            assert all(own.ends in [tuple(found) for found in spreads] for own in every)
        assert unit_in(pane.get_xlabel()) == "mm"
    assert panes[0].get_yticklabels()[0].get_text() == "planned, weight"
