"""What is said and drawn of noise is what its trials hold, of trials that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import bands, check_pivot, check_spread, check_table, curves, ends_of, looks_differ, unit_in
from made_up import of_one_trial
from reports import check, table_of

from testbench.bench.truths import CALLED, member
from testbench.report.campaigns import DUELS
from testbench.studies.noise_sensitivity import figure
from testbench.studies.noise_sensitivity.report import PARTS, figures, report
from testbench.studies.noise_sensitivity.study import STUDY
from testbench.studies.noise_sensitivity.trial import NoiseRow, Settings
from testbench.views.colours import look
from testbench.views.gains import ratio

SEEDS = range(4, 9)
SETTINGS = Settings(first=4, sigmas=(0.0, 25e-6, 50e-6, 200e-6))
SIGMAS = (0.0, 25.0, 50.0, 200.0)
TRACKER = {"gravity": (50.0, "workspace"), "six_dof": (25.0, "check")}
PLAIN = {"Joints": "none", "MLS56": "none", "MGCO56": "psd", "MGCO69": "psd"}
DEFAULT = "ALL153 + prior"
MODELS = {name: (name, c, False) for name, c in PLAIN.items()} | {
    f"{name} + prior": (name, PLAIN[name], True) for name in ("MLS56", "MGCO56", "MGCO69")
}
MODELS[DEFAULT] = ("ALL153", "psd", True)
INSTRUMENTS = ("weighted", "flat weights", "weighted, maximum errors", "weighted, frame drifts")
READ_BY = ("MGCO56 + prior", DEFAULT)


def rows_of(rng):
    """Of one trial: every model at every noise, then instruments."""

    def row(name, part, truth, **own):
        structure, constraint, prior = MODELS[name]
        fixed = {"structure": structure, "constraint": constraint, "prior": prior, "instrument": None}
        known = {"name": name, "part": part, "truth": truth, "distance_m": None, "sigma_um": None}
        return of_one_trial(NoiseRow, rng, **fixed | known | own)

    for part, truth in (("six_dof", "linear"), ("gravity", "nonlinear")):
        for sigma in SIGMAS:
            yield from (row(name, part, truth, sigma_um=sigma) for name in MODELS)
    for truth in ("linear", "nonlinear"):
        read = [(READ_BY[0], name, x) for x in (2.0, 4.0) for name in INSTRUMENTS]
        read += [(READ_BY[0], "flat 50 um", 0.0), *((DEFAULT, name, 4.0) for name in INSTRUMENTS[:2])]
        for name, instrument, x in read:
            yield row(name, "instrument", truth, instrument=instrument, distance_m=x)


def made(change=lambda *_: {}):
    """A report of made-up trials, and these; `change` gives fields of a row, of it and its seed."""

    def rows(seed):
        own = rows_of(np.random.default_rng(seed))
        known = [replace(row, true_arm=member("family", seed)) for row in own]
        return [replace(row, **change(row, seed)) for row in known]

    trials = table_of(SEEDS, rows)
    return report(SETTINGS, SEEDS, trials), trials


def told(found):
    return "\n".join(found.claims)


def test_numbers_are_medians_and_spreads_by_part_model_and_level_trial_by_trial():
    found, trials = made()
    check(found, STUDY.printed)
    f = found.numbers
    by_name = {m.name: m for m in f["models"]}
    for part, words in PARTS.items():
        sigma, judged = TRACKER[part]
        assert len(f["sweeps"][part]) == len(MODELS) * len(SIGMAS)
        for level in f["sweeps"][part]:
            own = trials.where(part=part, name=level.name, sigma_um=level.sigma_um)
            check_spread(level.rms_um, own["rms_um"])
            check_spread(level.p95_um, own["p95_um"])
            assert (level.conservative, level.solved) == (own["conservative"].mean(), own["solved"].mean())
        own = trials.where(part=part, name=DEFAULT, sigma_um=sigma)["rms_um"]
        check_spread(f["gains"][part].joints.ours_mm, own / 1e3)
        for name, slope in f["slopes"][part].items():
            calm, noisy = (trials.where(part=part, name=name, sigma_um=x)["rms_um"] for x in (0.0, 200.0))
            check_spread(slope.um_per_um, np.sqrt(np.maximum(0, noisy**2 - calm**2)) / 200)
            check_spread(slope.noise_free_um, calm)
        assert len(f["paired"][part]) == len(DUELS) * (len(SIGMAS) - 1)
        for pair in f["paired"][part]:
            at = trials.where(part=part, sigma_um=pair.sigma_um)
            a, b = (at.where(name=name)["rms_um"] for name in (pair.ours, pair.theirs))
            check_spread(pair.ratio, a / b)
            assert (pair.won, pair.tied) == (np.mean(a < b), 0)
        for name, (_, constraint, _) in MODELS.items():
            model, own = by_name[f"{name}, {words}"], trials.where(part=part, name=name, sigma_um=sigma)
            check_spread(model[judged].rms_mm, own["rms_um"] / 1e3)
            check_spread(model[judged].p95_mm, own["p95_um"] / 1e3)
            assert model.method == {"none": "least squares", "psd": "GCO"}[constraint]
    assert len(f["weighted_over_flat"]) == 6
    for row in f["weighted_over_flat"]:
        at = trials.where(part="instrument", truth=row.truth, name=row.name, distance_m=row.distance_m)
        full, flat = (at.where(instrument=name)["rms_um"] for name in INSTRUMENTS[:2])
        check_spread(row.ratio, full / flat)
        assert row.won == np.mean(full < flat)


def test_tables_show_the_numbers_under_headings_with_their_units():
    found, _ = made()
    f = found.numbers
    for part in PARTS:
        for key, what, words in (
            ("rms", "rms_um", "RMS"),
            ("short", "rms_um", "RMS"),
            ("p95", "p95_um", "95 %"),
        ):
            table = found.tables[f"{part}_{key}"]
            check_pivot(table, f["sweeps"][part], ("name", "sigma_um", what), "um")
            assert table.title == f"{PARTS[part]}: {words} error, um, by noise of a reading"
        slopes = {"model": "name", "error without noise, um": "noise_free_um"}
        slopes["cost of a um of noise, um"] = "um_per_um"
        check_table(found.tables[f"{part}_slopes"], [*f["slopes"][part].values()], slopes)
        pairs = {"model": "ours", "against": "theirs", "noise of a reading, um": "sigma_um"}
        pairs |= {"its error over the other's": "ratio", "better in": "won", "alike in": "tied"}
        check_table(found.tables[f"{part}_paired"], f["paired"][part], pairs)
    weights = {"truth": "truth", "model": "name", "distance, m": "distance_m"}
    weights |= {"its error over the other's": "ratio", "better in": "won"}
    check_table(found.tables["weighted"], f["weighted_over_flat"], weights)
    read = {name: name for name in ("truth", "instrument")}
    read |= {"distance, m": "distance_m", "RMS error, um": "rms_um"}
    check_table(found.tables["instruments"], f["instruments"], read)


@pytest.mark.parametrize("best", MODELS)
def test_best_and_gain_are_those_at_the_noise_of_the_tracker_and_costs_those_up_to_the_largest(best):
    errors = {name: 1000.0 + 100 * k for k, name in enumerate(MODELS)} | {best: 10.0}

    def change(row, _):
        if row.part == "instrument":
            return {}
        sizes = {0.0: 0.0, TRACKER[row.part][0]: errors[row.name], 200.0: 2 * errors[row.name]}
        return {"rms_um": sizes.get(row.sigma_um, 1.0)}

    found, _ = made(change)
    plain = min((n for n in PLAIN if n != "Joints"), key=errors.get)
    groups = [{n: errors[n] for n in MODELS if MODELS[n][2] == prior} for prior in (False, True)]
    (least, most), (filled, _) = [(min(g, key=g.get), max(g, key=g.get)) for g in groups]
    size = errors["MLS56"] / errors[DEFAULT]
    less = f"{ratio(size)} times less" if size > 1 else f"{ratio(1 / size)} times as much"
    both = f"{DEFAULT} {errors[DEFAULT]:.0f} um, least squares {errors['MLS56']:.0f} um; {less}."
    joints = f"Joints alone {errors['Joints']:.0f} um, "
    assert found.answer.startswith(f"{PARTS['gravity']}, 50 um of noise: {both} {joints}")
    assert f"{PARTS['six_dof']}, 25 um of noise: {both} {joints}" in told(found)
    assert f"Worst at 200 um of noise, KR 500, 8 poses: {DEFAULT} {2 * errors[DEFAULT]:.0f} um" in found.worst
    for part, (sigma, _) in TRACKER.items():
        said = f"{PARTS[part]}, {sigma:g} um of noise: least error {best} 10 um, without a prior {plain} "
        assert f"{said}{errors[plain]:.0f} um." in found.claims
        assert (
            f"{PARTS[part]}: 1 um of noise costs {errors[least] / 100:.2f} um of error with {least}, "
            f"{errors[most] / 100:.2f} um with {most}. With a prior it costs least with {filled}: "
            f"{errors[filled] / 100:.2f} um."
        ) in found.claims


def test_models_that_err_alike_are_alike_and_then_the_cone_does_nothing():
    def change(row, _):
        free = {"conservative": row.constraint == "psd"}
        same = {"MGCO69": 900.0, "MGCO56": 80.0}.get(row.name, 500.0) if row.sigma_um != 0 else 0.0
        return free | ({"rms_um": same} if row.part == "gravity" else {})

    found, _ = made(change)
    text = told(found)
    assert (
        "0.40 um of error with MGCO56, 4.50 um with MGCO69. With a prior it costs least with MLS56 + p"
        in text
    )
    assert "MLS56 + prior, MGCO56 + prior, MGCO69 + prior and ALL153 + prior (alike): 2.50 um." in text
    assert "8 poses: at the largest noise the prior lowers the cost of noise to MGCO69; without noise" in text
    assert (
        "MGCO56 beats MLS56 in 100 % of 5 trials. With the prior it does in 0 %, and they err alike in"
        in text
    )
    for words in (
        "joints alone in 0 %,",
        " least squares in 0 %,",
        "GCO in 100 %,",
        "with prior in 100 % of",
    ):
        assert words in text


@pytest.mark.parametrize("won", READ_BY)
def test_weights_are_told_of_every_case_and_instruments_by_name(won):
    """Full covariances win with one truth and model, and lose in the other three cases."""

    def change(row, _):
        better = (row.truth, row.name) == ("nonlinear", won)
        own = {"flat weights": 40.0, "weighted": 20.0 if better else 80.0, "flat 50 um": 99.0}
        return {"rms_um": own.get(row.instrument, 60.0)} if row.instrument else {}

    text = told(made(change)[0])
    assert "4 m: full covariances help in 1 of 4 cases; error over that of flat weights 0.50 to 2.00" in text
    assert 'MGCO56 + prior: least error 40 um ("flat weights"), largest 99 um ("flat 50 um").' in text


def test_errors_by_true_arm_are_those_of_its_trials_and_the_title_counts_them():
    arms = dict(zip(SEEDS, ("cast", "tubes", "cast", "tubes", "tubes"), strict=True))

    def change(row, seed):
        size = 40.0 if arms[seed] == "cast" else 10.0
        return {"true_arm": arms[seed], "rms_um": size + seed * (row.instrument != "flat weights")}

    found, trials = made(change)
    gravity, weights = found.numbers["by_arm"]["gravity"], found.numbers["weighted_by_arm"]
    own = {(row.name, row.true_arm): row.rms_um for row in gravity}
    check_spread(own[DEFAULT, "cast"], [44, 46])
    check_spread(own[DEFAULT, "tubes"], [15, 17, 18])
    named = [row | {"name": f"{row.truth} truth, {row.name}"} for row in weights]
    for name, value, rows in (("gravity_by_arm", "rms_um", gravity), ("weighted_by_arm", "ratio", named)):
        check_pivot(found.tables[name], rows, ("name", "true_arm", value), called=({}, CALLED))
    assert "True arms in turn: cast links (2), links of tubes (3)." in found.title
    one = report(replace(SETTINGS, true_arm="cast"), SEEDS, trials)
    assert "True arm: cast links." in one.title


def test_the_figure_draws_the_numbers_in_the_colour_of_each_model():
    found, _ = made()
    f = found.numbers
    drawn = figures(found)["noise_sensitivity.png"]
    *left, right = drawn.axes
    first = found.tables[STUDY.printed[0]].title.partition(":")[0]
    size = f["leaders"]["gravity"].default_um.median
    assert f"{first}, 50 um of noise: {DEFAULT} {size:.0f} um; least" in " ".join(
        drawn.get_suptitle().split()
    )
    for axes, (part, words) in zip(left, PARTS.items(), strict=True):
        assert axes.get_title() == words
        assert (unit_in(axes.get_xlabel()), unit_in(axes.get_ylabel())) == ("um", "um")
        lines, levels = curves(axes), {}
        for name in MODELS:
            levels[name] = [row for row in f["sweeps"][part] if row.name == name]
            assert np.transpose(lines[name]).tolist() == [[r.sigma_um, r.rms_um.median] for r in levels[name]]
        banded = [name for name in lines if name in figure.BANDS]
        for name, band in zip(banded, bands(axes), strict=True):
            np.testing.assert_allclose(band, [(r.sigma_um, *ends_of(r.rms_um)) for r in levels[name]])
        shades = {line.get_label(): line.get_color() for line in axes.get_lines()}
        assert shades == {name: look(*own).hex for name, own in MODELS.items()}
        looks_differ(axes.get_legend())
    assert (unit_in(right.get_xlabel()), unit_in(right.get_ylabel())) == ("m", "um")
    linear = [row for row in f["instruments"] if row.truth == "linear"]
    for name in INSTRUMENTS:
        own = [[r.distance_m, r.rms_um.median] for r in linear if r.instrument == name]
        assert np.transpose(curves(right)[name]).tolist() == own
    [flat] = [row.rms_um.median for row in linear if row.distance_m == 0]
    assert any(np.allclose(line.get_ydata(), flat) for line in right.get_lines())
    looks_differ(right.get_legend())
