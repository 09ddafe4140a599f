"""What people see of the study of noise equals its report, for trials that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import (
    bands,
    check_pivot,
    check_report,
    check_spread,
    check_table,
    check_words,
    curves,
    ends_of,
    looks_differ,
    summaries,
    unit_in,
)
from made_up import of_one_trial

from testbench.bench.truths import CALLED, TRUTHS, member
from testbench.studies.noise_sensitivity import figure
from testbench.studies.noise_sensitivity.study import STUDY
from testbench.studies.noise_sensitivity.trial import NoiseRow, Settings
from testbench.views.markdown import grid

SEEDS = range(4, 9)
SETTINGS = Settings(first=4, sigmas=(0.0, 25e-6, 50e-6, 200e-6))
DISTANCES = (2.0, 4.0)
WORDS = {"gravity": "KR 500, 8 poses", "six_dof": "108 runs of section 5.2"}
PLAIN = {"Joints": "none", "MLS56": "none", "MGCO56": "psd", "MGCO69": "psd"}
FILLED = ("MLS56", "MGCO56", "MGCO69")
MODELS = {name: (name, c, False) for name, c in PLAIN.items()} | {
    f"{name} + prior": (name, PLAIN[name], True) for name in FILLED
}
DEFAULT = "ALL153 + prior"
MODELS[DEFAULT] = ("ALL153", "psd", True)
PAIRS = {
    ("MGCO56", "MLS56"): True,
    ("MGCO56 + prior", "MLS56 + prior"): True,
    ("MGCO56", "Joints"): False,
    ("MGCO56 + prior", "Joints"): False,
    (DEFAULT, "Joints"): False,
}
"""Who is compared with whom, and whether the cone is all in which they differ."""
INSTRUMENTS = ("weighted", "flat weights", "weighted, maximum errors", "weighted, frame drifts")
WEIGHED_BY = {"instrument": "MGCO56 + prior", "default": DEFAULT}
"""The model by which instruments are read, by part."""


def trials(rng, cost=None):
    """Made-up rows; `cost` fixes the errors of the largest noise, by part and model, or of an instrument.

    Without noise such a model has no error.
    """
    found = []
    for seed in SEEDS:
        rows = []
        for part in WORDS:
            for sigma in SETTINGS.sigmas:
                for name, (structure, constraint, prior) in MODELS.items():
                    fixed = {"structure": structure, "constraint": constraint, "prior": prior}
                    if sigma == SETTINGS.sigmas[-1] and (part, name) in (cost or {}):
                        fixed["rms_um"] = cost[part, name]
                    if sigma == 0 and (part, name) in (cost or {}):
                        fixed["rms_um"] = 0.0
                    rows.append(of_one_trial(NoiseRow, rng, part=part, model=name, x=sigma, **fixed))
        for truth in ("linear", "nonlinear"):
            read = [("instrument", n, x) for x in DISTANCES for n in INSTRUMENTS]
            read += [("instrument", "flat 50 um", 0.0), *(("default", n, 4.0) for n in INSTRUMENTS[:2])]
            for kind, name, x in read:
                part = f"{kind}_{truth}"
                fixed = {"rms_um": cost[part, name]} if (part, name) in (cost or {}) else {}
                rows.append(of_one_trial(NoiseRow, rng, part=part, model=name, x=x, **fixed))
        found.append((seed, [replace(row, true_arm=member("family", seed)) for row in rows]))
    return found


def changed(found, change):
    """The same rows with some fields changed."""
    return [(seed, [replace(row, **change(row)) for row in rows]) for seed, rows in found]


summed, made, report = summaries(STUDY, SETTINGS, SEEDS, trials)


def numbers(made, part, model, x, key="rms_um"):
    """Of all trials, in the order of the seeds."""
    own = [r for _, rows in made for r in rows if (r.part, r.model, r.x) == (part, model, x)]
    return np.array([getattr(r, key) for r in own], dtype=float)


def test_the_report_is_medians_and_spreads_by_part_model_and_level(made, report):
    for part in WORDS:
        assert len(report.sweeps[part]) == len(MODELS) * len(SETTINGS.sigmas)
        for level in report.sweeps[part]:
            own = (made, part, level.model, level.x)
            check_spread(level.rms_um, numbers(*own))
            check_spread(level.p95_um, numbers(*own, "p95_um"))
            assert level.conservative == numbers(*own, "conservative").mean()
            assert level.solved == numbers(*own, "solved").mean()
            assert level.sigma_um == pytest.approx(1e6 * level.x)
        for name, slope in report.slopes[part].items():
            calm, noisy = (numbers(made, part, name, x) for x in (0.0, 200e-6))
            check_spread(slope.um_per_um, np.sqrt(np.maximum(0, noisy**2 - calm**2)) / 200)
            check_spread(slope.noise_free_um, calm)
        own = [p for p in report.paired if p.part == part]
        assert len(own) == len(PAIRS) * (len(SETTINGS.sigmas) - 1)
        for pair in own:
            ours, theirs = (numbers(made, part, n, pair.sigma_um / 1e6) for n in (pair.ours, pair.theirs))
            check_spread(pair.ratio, ours / theirs)
            assert (pair.better_in, pair.alike_in) == (np.mean(ours < theirs), 0)
        assert {(c.ours, c.theirs): c.cone for c in report.compared[part]} == PAIRS
    for truth, rows in report.weighted_over_flat.items():
        assert [(r.model, r.distance_m) for r in rows] == [
            ("MGCO56 + prior", 2),
            ("MGCO56 + prior", 4),
            (DEFAULT, 4),
        ]
        for row in rows:
            kind = next(k for k, model in WEIGHED_BY.items() if model == row.model)
            full, flat = (
                numbers(made, f"{kind}_{truth}", name, row.distance_m)
                for name in ("weighted", "flat weights")
            )
            check_spread(row.ratio, full / flat)
            assert (row.better_in, row.trials) == (np.mean(full < flat), len(SEEDS))


def test_models_are_those_at_the_noise_of_the_papers_trackers(made, report):
    by_name = {m.name: m for m in report.models}
    assert len(by_name) == 2 * len(MODELS)
    for part, sigma, key in (("six_dof", 25e-6, "check"), ("gravity", 50e-6, "workspace")):
        for name, (_, constraint, _) in MODELS.items():
            model = by_name[f"{name}, {WORDS[part]}"]
            check_spread(getattr(model, key).rms_mm, numbers(made, part, name, sigma) / 1e3)
            check_spread(getattr(model, key).p95_mm, numbers(made, part, name, sigma, "p95_um") / 1e3)
            assert model.method == {"none": "least squares", "psd": "GCO"}[constraint]


def test_tables_show_the_reports_numbers_with_their_units(report):
    tables = STUDY.tables(report)
    for part in WORDS:
        paths = ("model", "sigma_um")
        check_pivot(tables[f"{part}_rms"], report.sweeps[part], (*paths, "rms_um"), "um")
        check_pivot(tables[f"{part}_p95"], report.sweeps[part], (*paths, "p95_um"), "um")
        check_pivot(tables[f"{part}_short"], report.sweeps[part], (*paths, "rms_um"), "um")
        slopes = {"model": "model", "error without noise, um": "noise_free_um"}
        slopes["cost of a um of noise, um"] = "um_per_um"
        check_table(tables[f"{part}_slopes"], list(report.slopes[part].values()), slopes)
        pairs = [p for p in report.paired if p.part == part]
        means = {"model": "ours", "against": "theirs", "noise of a reading, um": "sigma_um"}
        means |= {"error over its": "ratio", "better": "better_in", "alike": "alike_in"}
        check_table(tables[f"{part}_paired"], pairs, means)
    weighted = [row for rows in report.weighted_over_flat.values() for row in rows]
    means = {"truth": "truth", "model": "model", "distance, m": "distance_m", "full over flat": "ratio"}
    means["full better"] = "better_in"
    check_table(tables["weighted"], weighted, means)
    means = {"truth": "truth", "instrument": "model", "distance, m": "x"}
    check_table(tables["instruments"], report.instruments, {**means, "RMS over the workspace, um": "rms_um"})
    text = check_report(STUDY, report)
    check_words(STUDY.words(report))
    for part, words in WORDS.items():  # each table below its own heading
        section = text.split(f"## {words}: RMS error, um")[1].split("##")[0]
        assert grid(tables[f"{part}_rms"]) in section
        section = text.split(f"## {words}: 95 % error, um")[1].split("##")[0]
        assert grid(tables[f"{part}_p95"]) in section


@pytest.mark.parametrize("part", WORDS)
@pytest.mark.parametrize("best", MODELS)
def test_the_gain_and_the_best_are_those_at_the_noise_of_the_papers_tracker(rng, part, best):
    sigma = {"six_dof": 25e-6, "gravity": 50e-6}[part]
    errors = {name: 1000.0 + 100 * k for k, name in enumerate(MODELS)} | {best: 10.0}

    def fixed(row):
        return {"rms_um": errors[row.model]} if (row.part, row.x) == (part, sigma) else {}

    words = STUDY.words(summed(changed(trials(rng), fixed)))
    plain = min((n for n in PLAIN if n != "Joints"), key=errors.get)
    said = f"{WORDS[part]}, {1e6 * sigma:g} um of noise: least error {best} 10 um, without a prior {plain} "
    assert f"{said}{errors[plain]:.0f} um." in words.block("more")
    size = errors["MLS56"] / errors[DEFAULT]
    ratio = f"{size:.0f} times less" if size > 1 else f"{1 / size:.{0 if size < 0.1 else 1}f} times as much"
    both = f"{DEFAULT} {errors[DEFAULT]:.0f} um, least squares {errors['MLS56']:.0f} um"
    if part == "gravity":
        assert words.block("answer").startswith(f"{WORDS[part]}, 50 um of noise: {both}; {ratio}. ")
        assert f"Joints alone {errors['Joints']:.0f} um, " in words.block("answer")
    else:
        said = f"- Section 5.2, 25 um of noise: {both}, {ratio}; joints alone {errors['Joints']:.0f} um."
        assert said in words.block("statements")


@pytest.mark.parametrize("part", WORDS)
@pytest.mark.parametrize("best", MODELS)
def test_the_models_to_which_noise_costs_least_and_most_are_named(rng, part, best):
    cost = {(part, name): 1000.0 + 100 * k for k, name in enumerate(MODELS)}
    cost[part, best] = 10.0
    text = STUDY.words(summed(trials(rng, cost))).block("more")
    groups = [{n: cost[part, n] for n in MODELS if MODELS[n][2] == prior} for prior in (False, True)]
    (least, most), (filled, _) = [(min(g, key=g.get), max(g, key=g.get)) for g in groups]
    assert (
        f"- {WORDS[part]}: 1 um of noise costs {cost[part, least] / 200:.2f} um of error with {least}, "
        f"{cost[part, most] / 200:.2f} um with {most}, and {cost[part, filled] / 200:.2f} um with {filled}."
    ) in text


def test_models_to_which_noise_costs_the_same_are_alike(rng):
    cost = {("gravity", name): 500.0 for name in MODELS} | {("gravity", "MGCO69"): 900.0}
    text = STUDY.words(summed(trials(rng, cost))).block("more")
    assert "2.50 um of error with Joints, MLS56 and MGCO56 (alike), 4.50 um with MGCO69, and 2.50" in text
    assert "with MLS56 + prior, MGCO56 + prior, MGCO69 + prior and ALL153 + prior (alike)." in text


def test_a_prior_is_said_to_lower_the_errors_that_it_lowers(rng):
    cost = {("gravity", "MGCO56"): 90.0, ("gravity", "MGCO56 + prior"): 80.0}
    cost |= {("gravity", "MGCO69"): 30.0, ("gravity", "MGCO69 + prior"): 40.0}
    cost |= {("gravity", "MLS56"): 40.0, ("gravity", "MLS56 + prior"): 40.0}
    text = STUDY.words(summed(trials(rng, cost))).block("more")
    assert "KR 500, 8 poses: at the largest noise the prior lowers the cost of noise to MGCO56;" in text


def test_shares_of_least_squares_and_gco_are_not_exchanged(rng):
    found = changed(trials(rng), lambda row: {"conservative": row.constraint == "psd"})
    text = STUDY.words(summed(found)).block("more")
    for words in (
        "joints alone in 0 %,",
        " least squares in 0 %,",
        "GCO in 100 %,",
        "with prior in 100 % of",
    ):
        assert words in text


@pytest.mark.parametrize("share", [0, 100])
@pytest.mark.parametrize("pair", PAIRS)
def test_a_model_is_better_in_the_trials_in_which_it_is(rng, pair, share):
    errors = dict(zip(pair, (10.0, 12.0) if share else (12.0, 10.0), strict=True))
    found = changed(trials(rng), lambda row: {"rms_um": errors.get(row.model, row.rms_um)})
    text = STUDY.words(summed(found)).block("more")
    for words in WORDS.values():
        said = f"{words}, the same readings, 25, 50, 200 um of noise: {pair[0]} is better than {pair[1]} in"
        assert f"{said} {share} % of the trials." in text


def test_the_cone_does_nothing_where_two_methods_err_alike_in_all_trials(rng):
    found = changed(trials(rng), lambda row: {"rms_um": 7.0 if row.prior else row.rms_um})
    text = STUDY.words(summed(found)).block("more")
    assert "MGCO56 + prior and MLS56 + prior err alike in all trials: there the cone does nothing." in text
    assert text.count("the cone does nothing") == len(WORDS)


@pytest.mark.parametrize("kind", WEIGHED_BY)
@pytest.mark.parametrize(
    ("full", "flat", "said"),
    [
        (20.0, 40.0, ("full covariances have the smaller median", "0.50")),
        (40.0, 20.0, ("flat weights have the smaller median", "2.00")),
        (20.0, 20.0, ("full covariances and flat weights are alike", "1.00")),
    ],
)
def test_the_better_weights_are_called_better(rng, full, flat, said, kind):
    cost = {(f"{kind}_nonlinear", "weighted"): full, (f"{kind}_nonlinear", "flat weights"): flat}
    text = STUDY.words(summed(trials(rng, cost))).block("more")
    below = "below 1 in 100 %" if full < flat else "below 1 in 0 %"
    ratio = f"error with full covariances over error with flat weights {said[1]} in 5 trials, {below}."
    assert f"Laser tracker at 4 m, nonlinear truth, {WEIGHED_BY[kind]}: {said[0]}; {ratio}" in text


def test_the_first_table_and_chart_are_of_the_arm_that_the_answer_speaks_of(report):
    """The page draws the first table beside the answer, the figure the first pane below it."""
    arm = STUDY.tables(report)[STUDY.printed[0]].title.partition(":")[0]
    assert STUDY.words(report).block("answer").startswith(f"{arm}, ")
    drawn = figure.sensitivity(report)
    assert drawn.axes[0].get_title() == arm
    assert drawn.get_suptitle().startswith(f"{arm}, ")


def test_weights_are_told_of_every_row_and_not_of_the_one_in_which_they_are_better(rng):
    """Full covariances win with one truth and model, and lose with the other three."""
    parts = [f"{kind}_{truth}" for kind in WEIGHED_BY for truth in ("linear", "nonlinear")]
    cost = {(part, "flat weights"): 40.0 for part in parts}
    cost |= {(part, "weighted"): 20.0 if part == "default_nonlinear" else 80.0 for part in parts}
    text = STUDY.words(summed(trials(rng, cost))).block("statements")
    assert "4 m: full covariances help in 1 of 4 cases; error over that of flat weights 0.50 to 2.00" in text
    assert "are better" not in text


@pytest.mark.parametrize("best", INSTRUMENTS)
def test_the_best_and_the_worst_instrument_are_named(rng, best):
    cost = {("instrument_linear", name): 60.0 + 10 * k for k, name in enumerate((*INSTRUMENTS, "flat 50 um"))}
    cost["instrument_linear", best] = 17.0
    text = STUDY.words(summed(trials(rng, cost))).block("more")
    assert (
        f'linear truth, MGCO56 + prior: least error 17 um ("{best}"), largest 100 um ("flat 50 um").' in text
    )


def test_a_headline_that_differs_by_true_arm_has_a_table_and_no_other_has(rng):
    """Two trials of each of two arms: the default errs 10 and 11 um with one, 40 and 41 with the other."""
    arms = ["cast", "tubes", "cast", "tubes"]
    errors = dict(zip(SEEDS[:4], (40.0, 10.0, 41.0, 11.0), strict=True))

    def fixed(seed, row):
        arm = {"true_arm": arms[seed - SEEDS[0]]}
        if row.part == "gravity" and row.model == DEFAULT:
            return arm | {"rms_um": errors[seed]}
        if row.part == "default_nonlinear" and row.model == "weighted":
            return arm | {"rms_um": errors[seed] / 20}
        return arm | {"rms_um": 1.0 if row.part.startswith(("default", "instr")) else 50.0 + seed}

    made = [(seed, [replace(r, **fixed(seed, r)) for r in rows]) for seed, rows in trials(rng)[:4]]
    report = STUDY.summary(SETTINGS, SEEDS[:4], made)
    assert report.by_arm["six_dof"] == []
    assert [(b.headline, b.true_arm, b.trials) for b in report.by_arm["gravity"]] == [
        (DEFAULT, "tubes", 2),
        (DEFAULT, "cast", 2),
    ]
    check_spread(report.by_arm["gravity"][0].value, [10, 11])
    check_spread(report.by_arm["gravity"][1].value, [40, 41])
    assert {b.headline for b in report.weighted_by_arm} == {f"nonlinear, {DEFAULT}"}
    check_spread(report.weighted_by_arm[1].value, [2, 2.05])
    tables = STUDY.tables(report)
    check_pivot(
        tables["gravity_by_arm"],
        report.by_arm["gravity"],
        ("headline", "true_arm", "value"),
        called=({}, CALLED),
    )
    check_pivot(
        tables["weighted_by_arm"],
        report.weighted_by_arm,
        ("headline", "true_arm", "value"),
        called=({}, CALLED),
    )
    text = STUDY.words(report).whole()
    assert grid(tables["gravity_by_arm"]) in text.split("KR 500, 8 poses: RMS error, um, by true arm")[1]
    assert "section 5.2: RMS error, um, by true arm" not in text
    said = "by true arm differ by more than their spread the errors of"
    assert f"KR 500, 8 poses, 50 um of noise: {said} {DEFAULT}." in text
    assert f"{said} no model that is named above." in text


def test_the_title_counts_the_trials_of_every_true_arm(report):
    counts = [[member("family", seed) for seed in SEEDS].count(arm) for arm in TRUTHS]
    said = ", ".join(f"{CALLED[arm]} ({n})" for arm, n in zip(TRUTHS, counts, strict=True) if n)
    assert f"True arms in turn: {said}." in STUDY.words(report).block("title")
    one = STUDY.summary(replace(SETTINGS, true_arm="cast"), SEEDS, trials(np.random.default_rng(1)))
    assert "True arm: cast links." in STUDY.words(one).block("title")


def test_the_figure_draws_the_reports_numbers(report):
    drawn = figure.sensitivity(report)
    *left, right = drawn.axes
    own = report.gains["gravity"].least_squares
    assert f"{own.ours} {1e3 * own.ours_mm.median:.0f} um; least squares" in drawn.get_suptitle()
    for axes, (part, words) in zip(left, WORDS.items(), strict=True):
        assert axes.get_title() == words
        assert (unit_in(axes.get_xlabel()), unit_in(axes.get_ylabel())) == ("um", "um")
        lines = curves(axes)
        assert set(lines) == set(MODELS)
        for name, (x, y) in lines.items():
            own = sorted((r for r in report.sweeps[part] if r.model == name), key=lambda r: r.sigma_um)
            np.testing.assert_allclose(x, [r.sigma_um for r in own])
            np.testing.assert_allclose(y, [r.rms_um.median for r in own])
        banded = [name for name in lines if name in figure.BANDS]
        for name, band in zip(banded, bands(axes), strict=True):
            own = sorted((r for r in report.sweeps[part] if r.model == name), key=lambda r: r.sigma_um)
            np.testing.assert_allclose(band, [(r.sigma_um, *ends_of(r.rms_um)) for r in own])
        assert [t.get_text() for t in axes.get_legend().get_texts()] == list(MODELS)
        looks_differ(axes.get_legend())
        low, high = axes.get_ylim()
        assert low <= min(r.rms_um.median for r in report.sweeps[part]) < max(y) < high
    assert (unit_in(right.get_xlabel()), unit_in(right.get_ylabel())) == ("m", "um")
    lines = {name: line for name, line in curves(right).items() if name in INSTRUMENTS}
    assert set(lines) == set(INSTRUMENTS)
    for name, (x, y) in lines.items():
        own = [r for r in report.instruments if r.model == name and r.part == "instrument_linear"]
        np.testing.assert_allclose((x, y), np.transpose([(r.x, r.rms_um.median) for r in own]))
    [flat] = [r.rms_um.median for r in report.instruments if r.x == 0 and r.truth == "linear"]
    assert any(np.allclose(line.get_ydata(), flat) for line in right.get_lines())
    looks_differ(right.get_legend())
