"""What people see of the study of absolute calibration equals its report, for trials that are made up."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from checks import check_report, check_table, check_words

from testbench.studies.absolute_calibration import figure
from testbench.studies.absolute_calibration.rows import Held, Row
from testbench.studies.absolute_calibration.settings import (
    ABSOLUTE,
    ALL,
    ARMS,
    BY_POSES,
    CAMPAIGN,
    CAMPAIGNS,
    CHOSEN,
    HIDING,
    INCUMBENT,
    NO_GEARS,
    REAL,
    TRUE_ARMS,
    Settings,
)
from testbench.studies.absolute_calibration.study import STUDY

SETTINGS = Settings(ARMS, (50, 200), 0, 200)
SEEDS = range(300, 306)
CAMPAIGN_COLUMNS = {
    "campaign": "campaign",
    "arm": "arm",
    "poses": "poses",
    "readings": "readings",
    "model": "model",
    "error, own weight, mm": "error_mm",
    "error, payload, mm": "loaded_mm",
    "c2 off, RMS, %": "off_2",
    "c3 off, RMS, %": "off_3",
}


def row_of(rng, seed, true_arm, campaign, poses, model):
    optimum = rng.uniform(0.1, 0.2)
    return Row(
        arm=ARMS[seed % 2],
        true_arm=true_arm,
        campaign=campaign,
        poses=poses,
        readings=poses if campaign == ABSOLUTE else 200,
        model=model,
        kept=("joint springs", "joint errors") if model == CHOSEN and true_arm != NO_GEARS else (),
        error_mm=1.1 * optimum,
        loaded_mm=rng.uniform(0.1, 0.3),
        optimum_mm=optimum if true_arm == REAL and campaign == ABSOLUTE else None,
        positions=Held(100, 95),
        geometry=Held(30, 28 if seed % 3 else 30),
        joint_errors=Held(360, 342),
        joints=Held(6, 6) if model == ALL else Held(6, 3),
        entries=Held(100, 80),
        compliance_off=tuple(rng.normal(0, 0.2, 6)),
        geometry_off=rng.uniform(0.01, 0.05),
        seconds=1.0,
    )


def trial(rng, seed):
    own = [(REAL, ABSOLUTE, n, model) for n in SETTINGS.numbers for model in BY_POSES]
    own += [(REAL, ABSOLUTE, 200, "joint springs, links")]
    own += [(true, ABSOLUTE, 200, model) for true in [*TRUE_ARMS][1:] for model in HIDING]
    own += [(REAL, name, 100, model) for name in [*CAMPAIGNS][1:] for model in CAMPAIGN]
    return [row_of(rng, seed, *one) for one in own]


@pytest.fixture
def trials(rng):
    return [(seed, trial(rng, seed)) for seed in SEEDS]


@pytest.fixture
def report(trials):
    return STUDY.summary(SETTINGS, SEEDS, trials)


def test_shares_are_over_all_numbers_and_errors_over_the_optimum_of_their_own_trial(report):
    own = report.model("ur10", 200, ALL)
    assert own.trials == 3
    assert own.inside.geometry == pytest.approx((28 + 30 + 28) / 90)
    assert own.over_optimum == pytest.approx(1.1)
    words = STUDY.words(report)
    for g in report.gains:
        ours, springs = (report.model(g.arm, 200, name) for name in (CHOSEN, INCUMBENT))
        assert (g.springs.ours_mm, g.springs.theirs_mm) == (ours.error_mm, springs.error_mm)
        said = f"On {g.arm}, 200 poses: chosen by cross-validation {ours.error_mm.median:.3f} mm, "
        assert f"{said}joint springs {springs.error_mm.median:.3f} mm, " in words.block("answer")
    assert "1.10 times on ur10, 1.10 times on kr500_l480." in words.block("statements")


def test_joint_errors_that_are_kept_without_any_are_counted(trials, report):
    told = [
        (seed, [replace(row, kept=("joint errors",)) if row.true_arm == NO_GEARS else row for row in rows])
        for seed, rows in trials
    ]
    found = STUDY.summary(SETTINGS, SEEDS, told)
    assert found.hidden("ur10", NO_GEARS, CHOSEN).gears_kept == 1
    assert report.hidden("ur10", NO_GEARS, CHOSEN).gears_kept == 0
    said = "they are kept in 100 % of the trials (ur10), 100 % of the trials (kr500_l480)."
    assert said in STUDY.words(found).block("statements")


def test_what_hides_is_the_compliance_of_joints_two_and_three(trials, report):
    rows = [row for seed, own in trials if seed % 2 == 0 for row in own]
    off = np.array(
        [row.compliance_off for row in rows if (row.true_arm, row.model) == ("rigid links", INCUMBENT)]
    )
    own = report.hidden("ur10", "rigid links", INCUMBENT)
    assert (own.bias_2, own.bias_3) == pytest.approx(tuple(np.median(off[:, 1:3], axis=0)))
    assert (own.off_2, own.off_3) == pytest.approx(tuple(np.sqrt((off[:, 1:3] ** 2).mean(axis=0))))


def test_tables_and_words_show_the_reports_numbers(report):
    check_table(STUDY.tables(report)["campaigns"], report.campaigns, CAMPAIGN_COLUMNS)
    check_report(STUDY, report)
    check_words(STUDY.words(report))
    places = [(row.arm, row.poses, row.name) for row in report.models]
    assert places == list(itertools.product(ARMS, SETTINGS.numbers, BY_POSES))


def test_bars_of_the_figure_are_what_hides(report):
    hidden = figure.curves(report).axes[2]
    heights = [bar.get_height() for bar in hidden.patches]
    models = (INCUMBENT, "joint springs, joint errors", "joint springs, links", ALL)
    rows = [report.hidden("ur10", true, model) for model in models for true in figure.HIDDEN]
    assert heights == pytest.approx([100 * row.off_2 for row in rows])
