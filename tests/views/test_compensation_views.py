"""What people see of the study of compensation equals its report, for trials that are made up."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from checks import check_report, check_table, check_words

from testbench.bench.truths import FAMILY, member
from testbench.studies.compensation import figure
from testbench.studies.compensation.report import ALL
from testbench.studies.compensation.rows import Row
from testbench.studies.compensation.settings import (
    ADVISED,
    ARMS,
    DEFAULT,
    IDEAL,
    IDENTIFIED,
    JOBS,
    MODELS,
    PERFECT,
    REAL,
    Settings,
    Way,
)
from testbench.studies.compensation.study import STUDY

SETTINGS = Settings("kr500_l480", 300)
SEEDS = range(300, 306)
POINTS = {"drilling": 30, "milling": 64}
LEFT = {PERFECT: 1e-8, DEFAULT: 0.02, "Joints": 0.08}
WAY = "planned, weight and pull"
TRIALS = {
    "model": "model",
    "campaign": "campaign",
    "poses": "poses",
    "median removed, trial by trial, %": "by_trial",
    "trials with a median of 97 %": "median_kept",
    "trials with 90 % removed in 95 % of points": "nine_kept",
    "trials with a point made worse": "trials_worse",
    "inside 95 % intervals, trial by trial, %": "covered_by_trial",
    "solved": "solved",
}


def row_of(rng, seed, way, model, job, arm):
    before = rng.uniform(0.5, 3.0, POINTS[job])
    left = LEFT.get(model, 0.5) * (5 if arm == REAL else 1) * rng.uniform(0.5, 1.5, POINTS[job])
    of = 3 * POINTS[job] if model in IDENTIFIED else 0
    return Row(
        truth=member(FAMILY, seed),
        arm=arm,
        by=way.by,
        loads=way.loads,
        poses=way.poses,
        model=model,
        chosen="ALL153 + prior" if model == DEFAULT else None,
        job=job,
        force=2000.0,
        before_mm=tuple(before.tolist()),
        after_mm=tuple((left * before).tolist()),
        inside=round(0.95 * of),
        of=of,
        unseen=0,
        buckled=False,
        solved=POINTS[job],
    )


def trial(rng, seed):
    found = []
    for arm in ARMS:
        ways = (Way(), *SETTINGS.ways(arm))
        for way, model, job in itertools.product(ways, MODELS, JOBS):
            if (model in IDENTIFIED) == (way != Way()):
                found.append(row_of(rng, seed, way, model, job, arm))
    return found


@pytest.fixture(scope="module")
def trials():
    rng = np.random.default_rng(17)
    return [(seed, trial(rng, seed)) for seed in SEEDS]


@pytest.fixture(scope="module")
def report(trials):
    return STUDY.summary(SETTINGS, SEEDS, trials)


def rows_of(trials, model, job=None):
    return [
        row
        for _, rows in trials
        for row in rows
        if (row.model, row.by, row.loads, row.poses, row.arm) == (model, *vars(ADVISED).values(), IDEAL)
        and job in (None, row.job)
    ]


def spoilt(trials, **changes):
    """The default's rows of the campaign that is advised, changed in the first trial alone."""
    (seed, first), *others = trials
    advised = rows_of([(seed, first)], DEFAULT)
    return [(seed, [replace(row, **changes) if row in advised else row for row in first]), *others]


def test_cases_are_points_of_trials_and_shares_are_over_all_of_them(trials, report):
    own = report.group(DEFAULT, WAY, 12)
    shares = np.concatenate([row.removed for row in rows_of(trials, DEFAULT)])
    assert own.cases == len(shares) == 6 * 94
    assert (own.removed.p05, own.removed.median) == pytest.approx(tuple(np.percentile(shares, [5, 50])))
    assert own.worst == pytest.approx(shares.min())
    assert own.covered == pytest.approx(0.95, abs=0.005)
    medians = [
        np.median(np.concatenate([row.after_mm for row in pair]))
        for pair in zip(rows_of(trials, DEFAULT, JOBS[0]), rows_of(trials, DEFAULT, JOBS[1]), strict=True)
    ]
    assert own.after.median_mm.median == pytest.approx(np.median(medians))


def test_the_gain_is_what_is_left_in_the_median_point_trial_by_trial(trials, report):
    def left(model):
        pairs = zip(rows_of(trials, model, JOBS[0]), rows_of(trials, model, JOBS[1]), strict=True)
        return np.array([np.median(np.concatenate([row.after_mm for row in pair])) for pair in pairs])

    for gain, name in ((report.gains.joints, "Joints"), (report.gains.least_squares, "MLS56")):
        assert gain.ours_mm.median == pytest.approx(np.median(left(DEFAULT)))
        assert gain.times.median == pytest.approx(np.median(left(name) / left(DEFAULT)))
    answer = STUDY.words(report).block("answer")
    assert f"leave {report.gains.joints.ours_mm.median:.3f} mm by default" in answer


def test_one_point_made_worse_in_one_trial_is_found(trials):
    [drilling] = rows_of(trials[:1], DEFAULT, "drilling")
    after = (1.01 * drilling.before_mm[0], *drilling.after_mm[1:])
    (seed, first), *others = trials
    told = [(seed, [replace(row, after_mm=after) if row is drilling else row for row in first]), *others]
    report = STUDY.summary(SETTINGS, SEEDS, told)
    own = report.group(DEFAULT, WAY, 12)
    assert (own.trials_worse, own.worst) == (1, pytest.approx(-0.01))
    assert f"makes 1 of {own.cases} points worse" in STUDY.words(report).block("statements")


def test_intervals_that_miss_in_one_trial_lower_the_share(trials, report):
    told = STUDY.summary(SETTINGS, SEEDS, spoilt(trials, inside=0)).group(DEFAULT, WAY, 12)
    assert told.covered == pytest.approx(report.group(DEFAULT, WAY, 12).covered * 5 / 6)
    assert told.covered_by_trial.p05 < 0.5


def test_components_without_a_bound_count_in_no_share_and_are_shown(trials, report):
    """Some of one trial, and a model that buckles in it."""
    few = spoilt(trials, inside=40, of=40, unseen=50, buckled=True)
    told = STUDY.summary(SETTINGS, SEEDS, few)
    own = told.group(DEFAULT, WAY, 12)
    assert report.group(DEFAULT, WAY, 12).covered < own.covered < 1
    assert own.unseen == pytest.approx(2 * 50 / (2 * 90 + 5 * 3 * 94))
    assert own.buckled == 1
    shown = {name: {c.heading for c in t.columns} for name, t in STUDY.tables(told).items()}
    assert {"without bound", "trials without equilibrium"} <= shown["undisturbed, trials"]
    assert "without bound" not in {c.heading for c in STUDY.tables(report)["undisturbed, trials"].columns}


def test_truths_are_told_apart(report):
    own = [g for g in report.by_truth if g.model == DEFAULT and g.arm == IDEAL]
    assert [g.truth for g in own] == ["tubes", "off_10", "off_20", "off_40", "cast", "joints"]
    assert {g.cases for g in own} == {94}


def test_tables_and_words_show_the_reports_numbers(report):
    groups = [g for g in report.groups if g.job == ALL and g.arm == IDEAL and g.poses in (0, 12)]
    check_table(STUDY.tables(report)["undisturbed, trials"], groups, TRIALS)
    check_report(STUDY, report)
    check_words(STUDY.words(report))


def test_dots_of_the_figure_are_what_is_left(report):
    panes = figure.removed(report).axes
    assert len(panes) == 6
    dots = [line for line in panes[1].get_lines() if line.get_marker() not in ("None", "")]
    every = [report.group(model, WAY, n) for n in SETTINGS.numbers for model in IDENTIFIED]
    assert [line.get_ydata()[0] for line in dots] == pytest.approx([1 - g.removed.median for g in every])
    path = {line.get_label(): line.get_ydata() for line in panes[5].get_lines()}
    assert path["corrected, default"] == pytest.approx(report.shown.after_mm[DEFAULT])
