"""What people see of the study of model error equals its report, for trials that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import (
    check_pivot,
    check_report,
    check_spread,
    check_table,
    check_words,
    curves,
    ends_of,
    key_of,
    looks_differ,
    summaries,
    tables_of,
    unit_in,
)
from made_up import of_one_trial

from testbench.bench.truths import CALLED, member
from testbench.studies.model_error import figure
from testbench.studies.model_error.cases import ALL, NONE, STIFF, cases
from testbench.studies.model_error.study import STUDY
from testbench.studies.model_error.trial import CaseRow, Settings
from testbench.views.gains import ratio as ratio_of
from testbench.views.markdown import grid

SEEDS = range(2, 7)
SETTINGS = Settings(arm="kr500_l480", sigma=40e-6)
CASES = list(cases(1.0))
CALLED_CASES = {NONE: "no disturbance"}
NAMES = [CALLED_CASES.get(case, case) for case in CASES]
MODELS = {
    "Joints": ("Joints", "none", False),
    "MLS56": ("MLS56", "none", False),
    "MGCO56": ("MGCO56", "psd", False),
    "MLS56 + prior": ("MLS56", "none", True),
    "MGCO56 + prior": ("MGCO56", "psd", True),
    "MGCO68 + prior": ("MGCO68", "psd", True),
    "ALL153 + prior": ("ALL153", "psd", True),
}
FEATURED = "ALL153 + prior"
CHART = "/rms_error_over_the_workspace_with_noise_of_40_um_um"
MEANS = {"disturbance": "case", "moves deflections by, um": "moved_um", "adds to the error, um": "added_um"}
CLAIM = {
    "disturbance": "case",
    "model": "model",
    "against the truth, %": "against_truth",
    "true within the claim": "within_true",
    "against readings, %": "against_readings",
    "within the claim": "within_claim",
}
BEATS = {"model": "ours", "against": "theirs", "better in trials": "better", "alike in trials": "alike"}
BEATS["error over its"] = "ratio"
TOGETHER = {"model": "model", "without disturbance, um": "none_um", "all together, um": "all_um"}


def trials(rng, errors=None):
    """Made-up rows; `errors` fixes RMS errors by case, model and noise."""
    found = []
    for seed in SEEDS:
        rows = []
        for case in CASES:
            for noise in (0.0, 40.0):
                for name, (structure, constraint, prior) in MODELS.items():
                    fixed = {"structure": structure, "constraint": constraint, "prior": prior}
                    if (case, name, noise) in (errors or {}):
                        fixed["rms_um"] = errors[case, name, noise]
                    fixed["true_arm"] = member("family", seed)
                    rows.append(of_one_trial(CaseRow, rng, case=case, model=name, noise_um=noise, **fixed))
        found.append((seed, rows))
    return found


summed, made, report = summaries(STUDY, SETTINGS, SEEDS, trials)


def numbers(made, case, model, noise, key="rms_um"):
    """Of all trials, in the order of the seeds."""
    own = [r for _, rows in made for r in rows if (r.case, r.model, r.noise_um) == (case, model, noise)]
    return np.array([getattr(r, key) for r in own], dtype=float)


def test_the_report_is_medians_and_spreads_by_case_model_and_noise(made, report):
    assert len(report.cells) == len(CASES) * len(MODELS) * 2
    for cell in report.cells:
        own = (made, cell.case, cell.model, cell.noise_um)
        check_spread(cell.rms_um, numbers(*own))
        check_spread(cell.p95_um, numbers(*own, "p95_um"))
        check_spread(cell.moved_um, numbers(*own, "moved_um"))
        check_spread(cell.added_um, numbers(*own) - numbers(made, NONE, cell.model, cell.noise_um))
        assert cell.conservative == numbers(*own, "conservative").mean()
        assert cell.solved == numbers(*own, "solved").mean()
    by_name = {m.name: m for m in report.models}
    assert len(by_name) == 2 * len(MODELS)
    for case in (NONE, ALL):
        for name in MODELS:
            check_spread(by_name[f"{name}, {case}"].workspace.rms_mm, numbers(made, case, name, 40.0) / 1e3)
            said = by_name[f"{name}, {case}"].method
            assert said == {"none": "least squares", "psd": "GCO"}[MODELS[name][1]]


def test_the_claim_is_judged_with_the_noise_of_two_readings_in_quadrature(made, report):
    assert {(c.case, c.model) for c in report.claim} == {
        (case, m) for case in ("gravity compensator", STIFF) for m in MODELS
    }
    for claim in report.claim:
        own, none = (numbers(made, case, claim.model, 40.0) for case in (claim.case, NONE))
        seen = np.sqrt(own**2 + 6 * 40.0**2) / np.sqrt(none**2 + 6 * 40.0**2) - 1
        check_spread(claim.against_truth, own / none - 1)
        check_spread(claim.against_readings, seen)
        assert claim.within_true == np.mean(np.abs(own / none - 1) <= 0.048)
        assert claim.within_claim == np.mean(np.abs(seen) <= 0.048)


def test_tables_show_the_reports_numbers_with_their_units(report):
    tables = STUDY.tables(report)
    for name, noise in (("calm", 0.0), ("noisy", 40.0)):
        cells = [c for c in report.cells if c.noise_um == noise]
        for key in (name, f"{name}_short"):
            check_pivot(tables[key], cells, ("case", "model", "rms_um"), called=(CALLED_CASES, {}))
    calm = [c for c in report.cells if c.noise_um == 0 and c.model == FEATURED]
    alone = [c for c in calm if c.case not in (NONE, ALL)]
    check_table(tables["ranking"], sorted(alone, key=lambda c: c.added_um.median, reverse=True), MEANS)
    check_table(tables["claim"], report.claim, CLAIM)
    [(_, lines)] = tables_of(grid(tables["claim"]))
    assert all(line[k].endswith(" %") for line in lines for k in (3, 5))
    check_table(tables["beats"], report.beats, BEATS)
    check_table(tables["together"], report.together, TOGETHER)
    for row in report.together:
        for case, shown in ((NONE, row.none_um), (ALL, row.all_um)):
            key = (case, row.model, 40.0)
            [cell] = [c for c in report.cells if (c.case, c.model, c.noise_um) == key]
            assert shown == cell.rms_um
    text = check_report(STUDY, report)
    check_words(STUDY.words(report))
    assert grid(tables["calm"]) in text.split("## RMS error, um, without noise")[1].split("##")[0]
    assert grid(tables["noisy"]) in text.split("## RMS error, um, with noise of 40 um")[1].split("##")[0]
    assert tables["calm_short"].title.endswith("um, without noise")
    assert tables["noisy_short"].title.endswith("um, with noise of 40 um")


@pytest.mark.parametrize("best", MODELS)
def test_the_gain_and_the_best_model_are_those_with_all_disturbances(rng, best):
    errors = {(ALL, name, 40.0): 60.0 + 10 * k for k, name in enumerate(MODELS)} | {(ALL, best, 40.0): 31.0}
    words = STUDY.words(summed(trials(rng, errors)))
    own = {name: errors[ALL, name, 40.0] for name in MODELS}
    assert f"with noise, the least error is that of {best}: 31 um." in words.block("statements")
    size = own["MLS56"] / own[FEATURED]
    ratio = f"{ratio_of(size)} times less" if size > 1 else f"{ratio_of(1 / size)} times as much"
    assert words.block("answer").startswith(
        f"Disturbed in every way, 40 um of noise: {FEATURED} {own[FEATURED]:.0f} um, "
        f"least squares {own['MLS56']:.0f} um; {ratio}. Joints alone {own['Joints']:.0f} um, "
    )


def test_models_that_bear_disturbances_as_well_are_alike(rng):
    errors = {(ALL, name, 40.0): 50.0 for name in MODELS} | {(ALL, "MGCO56", 40.0): 70.0}
    words = STUDY.words(summed(trials(rng, errors)))
    said = "MLS56 + prior, MGCO56 + prior, MGCO68 + prior and ALL153 + prior (alike): 50 um"
    assert said in words.block("statements")
    assert "least squares 50 um; alike. Joints alone 50 um, alike." in words.block("answer")


@pytest.mark.parametrize("worst", [c for c in CASES if c not in (NONE, ALL)])
def test_the_costliest_disturbance_is_named_whichever_it_is(rng, worst):
    errors = {(case, FEATURED, 0.0): 20.0 + k for k, case in enumerate(CASES)}
    errors |= {(NONE, FEATURED, 0.0): 20.0, (NONE, FEATURED, 40.0): 45.0, (worst, FEATURED, 0.0): 90.0}
    words = STUDY.words(summed(trials(rng, errors)))
    said, others = words.block("worst"), words.block("statements")
    assert said.startswith(f'Worst without noise: "{worst}" adds 70 um to the error of {FEATURED}; then come')
    rest = sorted((c for c in CASES if c not in (NONE, ALL, worst)), key=CASES.index, reverse=True)[:2]
    assert "; then come " + ", ".join(f'"{c}" +{CASES.index(c)} um' for c in rest) + "." in said
    assert f"Noise of 40 um adds 25 um to the error of {FEATURED} on the undisturbed arm. 1 of" in others
    assert f'Without noise "{worst}" adds more than noise does.' in words.block("more")


def test_the_claim_holds_for_the_models_for_which_it_does(rng):
    errors = {(case, m, 40.0): 50.0 for case in (NONE, "gravity compensator", STIFF) for m in MODELS}
    errors |= {("gravity compensator", "MLS56", 40.0): 500.0}
    errors |= {(STIFF, m, 40.0): 500.0 for m in MODELS}
    text = STUDY.words(summed(trials(rng, errors))).block("more")
    held = "Joints, MGCO56, MLS56 + prior, MGCO56 + prior, MGCO68 + prior and ALL153 + prior"
    assert (
        f'"gravity compensator": within 4.8 % in at least 95 % of the trials are {held} against the' in text
    )
    assert f"truth, {held} against readings." in text
    assert f'"{STIFF}": within 4.8 % in at least 95 % of the trials are no model against the truth' in text
    assert "at most 4.8 % apart" in text


def test_the_true_change_by_the_compensator_stands_before_the_one_that_noise_hides(rng):
    """50 um become 60: +20 %; beside 98 um of noise in quadrature they are +4.4 %."""
    errors = {(NONE, m, 40.0): 50.0 for m in MODELS} | {
        ("gravity compensator", m, 40.0): 60.0 for m in MODELS
    }
    words = STUDY.words(summed(trials(rng, errors))).block("more")
    [said] = [line for line in words.split("\n") if '"gravity compensator" changes the true error' in line]
    assert f"of {FEATURED} by +20.0 (+20.0 to +20.0) %. Against readings" in said
    assert "noise adds in quadrature to both errors, it looks like +4.4 (+4.4 to +4.4) %" in said


def test_trials_are_counted_in_which_a_model_beats_another(rng):
    errors = {(ALL, "MGCO56", 40.0): 30.0, (ALL, "Joints", 40.0): 20.0}
    errors |= {(ALL, name, 40.0): 10.0 for name in ("MGCO56 + prior", "MLS56 + prior")}
    made = summed(trials(rng, errors))
    found = {(b.ours, b.theirs): (b.better, b.alike, b.cone) for b in made.beats}
    assert found["MGCO56", "Joints"] == (0, 0, False)
    assert found["MGCO56 + prior", "Joints"] == (5, 0, False)
    assert found["MGCO56 + prior", "MLS56 + prior"] == (0, 5, True)
    text = STUDY.words(made).block("more")
    assert "MGCO56 beats Joints in 0 of 5 trials, 1.50 times its error." in text
    assert "MGCO56 + prior and MLS56 + prior err alike in all 5 trials: there the cone does nothing." in text


def test_errors_and_changes_that_differ_by_true_arm_have_tables(rng):
    """Joints alone err alike with both arms; the default 10 and 11 um with one, 40 and 41 with the other."""
    arms, errors = ["cast", "tubes"] * 2, [40.0, 10.0, 41.0, 11.0]
    made = []
    for k, (seed, rows) in enumerate(trials(rng)[:4]):
        rows = [replace(r, true_arm=arms[k], rms_um=60.0 + k) for r in rows]
        made.append((seed, [replace(r, rms_um=errors[k]) if with_all(r) else r for r in rows]))
    report = STUDY.summary(SETTINGS, SEEDS[:4], made)
    assert [(b.headline, b.true_arm, b.trials) for b in report.together_by_arm] == [
        (FEATURED, "tubes", 2),
        (FEATURED, "cast", 2),
    ]
    check_spread(report.together_by_arm[1].value, [40, 41])
    assert {b.headline for b in report.claim_by_arm} == {STIFF}
    check_spread(report.claim_by_arm[1].value, [40 / 60 - 1, 41 / 62 - 1])
    tables, text = STUDY.tables(report), STUDY.words(report).whole()
    by_arm = ("headline", "true_arm", "value")
    check_pivot(tables["together_by_arm"], report.together_by_arm, by_arm, called=({}, CALLED))
    assert grid(tables["together_by_arm"]) in text.split("By true arm, RMS error, um:")[1]
    assert grid(tables["claim_by_arm"]) in text.split("against the truth, by true arm, %:")[1]
    assert "-33.6" in grid(tables["claim_by_arm"])
    assert f"by true arm differ by more than their spread the errors of {FEATURED}." in text


def with_all(row):
    return row.model == FEATURED and row.case in (ALL, STIFF)


def test_the_sizes_of_disturbances_are_told_in_their_units(report):
    text = check_report(STUDY, report)
    for said in (
        "- no disturbance: nothing.",
        "joint sensors: Joint sensors are off by 0.35 mrad.",
        "payload mass: The payload is 0.2 % heavier than recorded.",
        "payload centre: The hanging point is off by 2 mm.",
        "backlash: Joints have 50 urad of play to either side.",
        "hysteresis: Joints have 30 urad of hysteresis to either side.",
        "nominal geometry: Frames are off by 0.5 mm and 0.87 mrad.",
        "stiffening joints: Joints are 10 % stiffer a mrad of turn.",
        "65 kN/m as joint 2 turns, 96000 kN/m as the arm deflects.",
    ):
        assert said in text


def test_the_figure_draws_the_reports_numbers_and_joins_no_two_cases(report):
    drawn = figure.disturbances(report)
    left, right = drawn.axes
    for axes, noise, words in ((left, 0.0, "without noise"), (right, 40.0, "with noise of 40 um")):
        assert axes.get_title() == words
        assert unit_in(axes.get_xlabel()) == "um"
        points = curves(axes)
        assert list(points) == list(MODELS)
        spreads = [line.get_data() for line in axes.get_lines() if line.get_label().startswith("_")]
        assert all(y[0] == y[1] for _, y in spreads)
        for name, (x, y) in points.items():
            own = {c.case: c.rms_um for c in report.cells if (c.model, c.noise_um) == (name, noise)}
            np.testing.assert_allclose(x, [own[case].median for case in CASES])
            assert np.rint(y).tolist() == list(range(len(CASES)))
            for case, place in zip(CASES, y, strict=True):
                assert any(np.allclose(s, [ends_of(own[case]), (place, place)]) for s in spreads)
        for line in axes.get_lines():
            assert line.get_linestyle() == "None" or len(line.get_xdata()) == 2
    assert [t.get_text() for t in left.get_yticklabels()] == NAMES
    assert left.get_ylim()[0] > left.get_ylim()[1]  # the first case on top
    legend = key_of(drawn)
    assert [t.get_text() for t in legend.get_texts()] == list(MODELS)
    looks_differ(legend)
