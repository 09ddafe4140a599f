"""What is said and drawn of corrected jobs is what their trials hold, of trials that are made up."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from checks import check_spread, unit_in
from reports import check, check_said, table_of

from testbench.campaign.true_arms import FAMILY, TRUTHS, member
from testbench.report.table import Row
from testbench.studies.compensation import settings as s
from testbench.studies.compensation.settings import ADVISED, DEFAULT, IDEAL, IDENTIFIED, LINEAR, NOWHERE, REAL
from testbench.studies.compensation.study import LOOKS, figures, group, report
from testbench.studies.compensation.trial import JobsRow
from testbench.views.colours import CHOICE, JOINTS

SETTINGS, SEEDS, POINTS = s.Settings("kr500_l480", 300), range(300, 306), 94
LEFT = {s.PERFECT: 1e-8, DEFAULT: 0.02, "Joints": 0.08, s.NOMINAL: 0.3, s.PRIOR: 0.7}
TIMES = {REAL: 5, LINEAR: 2, s.WEIGHT: 3}  #: As much is left.


def row(rng, seed, arm, way, name):
    before, identified = rng.uniform(0.5, 3.0, POINTS), name in IDENTIFIED
    left = LEFT.get(name, 0.5) * TIMES.get(arm, 1) * TIMES.get(way.loads, 1) * rng.uniform(0.5, 1.5, POINTS)
    return JobsRow(
        **{"true_arm": member(FAMILY, seed), "arm": arm, **vars(way), "name": name},
        chosen="ALL153 + prior" if name == DEFAULT else None,
        before_mm=tuple(before.tolist()),
        after_mm=tuple((left * before).tolist()),
        **{"inside": 270 * identified, "of": 282 * identified, "unseen": 0, "buckled": False},
    )


def made(spoil=lambda row: row):
    """A seed each true arm; `spoil` changes the default's row of the advised campaign in the first seed."""

    def rows(seed):
        rng = np.random.default_rng(seed)
        for arm in s.ARMS:
            for way, name in itertools.product((NOWHERE, *SETTINGS.ways(arm)), s.MODELS):
                if (name in IDENTIFIED) == (way != NOWHERE):
                    own = row(rng, seed, arm, way, name)
                    named = (seed, arm, way, name) == (SEEDS[0], REAL, ADVISED, DEFAULT)
                    yield spoil(own) if named else own

    trials = table_of(SEEDS, lambda seed: list(rows(seed)))
    return report(SETTINGS, SEEDS, trials), trials


@pytest.fixture(scope="module")
def found():
    return made()


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
    assert own.covered_percent == pytest.approx(100 * 270 / 282)
    by_truth = [g for g in found.numbers["by_truth"] if (g.name, g.arm) == (DEFAULT, REAL)]
    assert [(g.true_arm, g.cases) for g in by_truth] == [(name, POINTS) for name in TRUTHS]


def test_words_show_the_numbers(found):
    found, trials = found
    check(found, ["short"])
    f = Row(found.numbers)
    left = {name: np.median(points(trials, name, "after_mm"), axis=1) for name in IDENTIFIED}
    for name, gain in (("Joints", f.gains.joints), (s.LEAST_SQUARES, f.gains.least_squares)):
        check_spread(gain.times, left[name] / left[DEFAULT])
        medians = np.median(left[DEFAULT]), np.median(left[name])
        assert (gain.ours_mm.median, gain.theirs_mm.median) == pytest.approx(medians)
    default, joints, ls = (np.median(left[name]) for name in (DEFAULT, "Joints", s.LEAST_SQUARES))
    before = of_default(found).before.median_mm.median

    def removed(name, way=ADVISED, arm=REAL):
        return f"{group(f, name, way, arm).removed_percent.median:.1f} %"

    weight, plain = (removed(name, replace(ADVISED, loads=s.WEIGHT)) for name in (DEFAULT, "Joints"))
    ideal, ideal_joints = (removed(name, arm=IDEAL) for name in (DEFAULT, "Joints"))
    worst = [group(f, name, ADVISED, REAL).worst_percent for name in (DEFAULT, "Joints")]
    assert group(f, DEFAULT, ADVISED, REAL).removed_percent.trials == len(left[DEFAULT])  # not their points
    check_said(
        found,
        f"Disturbed arm, {ADVISED.poses} planned poses with weight and pull: the default leaves "
        f"{default:.3f} mm of {before:.3f} mm, joint stiffness only {joints:.3f} mm, ",
        f"Least squares without prior leaves {ls:.3f} mm, ",
        f"Worst point of all trials: {worst[0]:.0f} % removed, joint stiffness only {worst[1]:.0f} %.",
        f"never loads joint 1: {weight}, joint stiffness only {plain}. With the pull "
        f"{removed(DEFAULT)}, joint stiffness only {removed('Joints')}, perfect compliances "
        f"{removed(s.PERFECT, NOWHERE)}; undisturbed {ideal.removesuffix(' %')} and {ideal_joints}.",
        f"the default removes {removed(DEFAULT, arm=LINEAR)}.",
    )


def test_one_point_made_worse_in_one_trial_is_found():
    found, _ = made(lambda row: replace(row, after_mm=(1.01 * row.before_mm[0], *row.after_mm[1:])))
    own = of_default(found)
    assert (own.worse, own.worst_percent) == (1, pytest.approx(-1))
    assert f"makes 1 of {own.cases} points of {own.trials} trials worse" in found.claims[0]


def test_intervals_that_miss_lower_the_share_and_components_without_a_bound_count_in_none():
    found, _ = made(lambda row: replace(row, inside=0))
    covered = [group(Row(found.numbers), DEFAULT, ADVISED, arm).covered_percent for arm in (REAL, IDEAL)]
    assert covered == pytest.approx([100 * 5 * 270 / (6 * 282), 100 * 270 / 282])
    assert "hold {:.1f} % of what is left, undisturbed {:.1f} %; ".format(*covered) in found.claims[2]
    own = of_default(made(lambda row: replace(row, inside=40, of=40, unseen=242, buckled=True))[0])
    assert own.covered_percent == pytest.approx(100 * (40 + 5 * 270) / (40 + 5 * 282))
    assert (own.unseen_percent, own.buckled) == (pytest.approx(100 * 242 / (6 * 282)), 1)


def test_the_figure_draws_what_is_left_in_the_colour_of_each_model(found):
    f, panes = Row(found[0].numbers), figures(found[0])["compensation.png"].axes
    assert (LOOKS[DEFAULT], LOOKS["Joints"].colour) == (CHOICE, JOINTS)
    for pane, arm in zip(panes, (REAL, IDEAL), strict=True):
        for name in IDENTIFIED:
            [dots] = [line for line in pane.get_lines() if line.get_label() == name]
            every = [group(f, name, way, arm).after.median_mm for way in SETTINGS.ways(REAL)]
            assert dots.get_xdata() == pytest.approx([own.median for own in every])
            assert dots.get_color() == LOOKS[name].hex
            spreads = [line.get_xdata() for line in pane.get_lines() if len(line.get_xdata()) == 2]
            assert all(own.ends in [tuple(found) for found in spreads] for own in every)
        assert unit_in(pane.get_xlabel()) == "mm"
    assert panes[0].get_yticklabels()[0].get_text() == "planned, weight"
