"""What is said and drawn of noise is what its trials hold, of trials that are made up."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from checks import bands, check_pivot, check_spread, curves, ends_of, key_of, looks_differ, unit_in
from reports import check, check_cells, check_duels, fit_row, table_of

from testbench.campaign.true_arms import member
from testbench.studies.factorial.compare import DUELS
from testbench.studies.factorial.trial import FitRow
from testbench.studies.noise_sensitivity.study import (
    BANDS,
    CROWD,
    FILLED_CROWD,
    PARTS,
    STUDY,
    figures,
    report,
)
from testbench.studies.noise_sensitivity.trial import Settings
from testbench.views.colours import look

SEEDS = range(4, 9)
SETTINGS = Settings(first=4, sigmas=(0.0, 25e-6, 50e-6, 200e-6))
SIGMAS = (0.0, 25.0, 50.0, 200.0)
TRACKER = {"gravity": (50.0, "workspace"), "six_dof": (25.0, "check")}
PLAIN = {"Joints": "none", "MLS56": "none", "MGCO56": "psd", "MGCO69": "psd"}
DEFAULT = "ALL153 + prior"
MODELS = {name: (name, c, False) for name, c in PLAIN.items()} | {
    f"{name} + prior": (name, PLAIN[name], True) for name in ("MLS56", "MGCO56", "MGCO69")
}
MODELS |= {"LS153 + prior": ("LS153", "none", True), DEFAULT: ("ALL153", "psd", True)}
INSTRUMENTS = ("weighted", "flat weights", "weighted, maximum errors", "weighted, frame drifts")
READ_BY = ("MGCO56 + prior", DEFAULT)
TRUTHS = {"six_dof": "linear", "gravity": "nonlinear"}


def rows_of(rng):
    """Of one trial: every model at every noise, then instruments."""
    for (part, truth), sigma, name in product(TRUTHS.items(), SIGMAS, MODELS):
        yield fit_row(FitRow, rng, MODELS, name, part=part, truth=truth, sigma_um=sigma)
    read = [(READ_BY[0], name, x) for x in (2.0, 4.0) for name in INSTRUMENTS]
    read += [(READ_BY[0], "flat 50 um", 0.0), *((DEFAULT, name, 4.0) for name in INSTRUMENTS[:2])]
    for truth, (name, instrument, x) in product(TRUTHS.values(), read):
        own = {"part": "instrument", "truth": truth, "instrument": instrument, "distance_m": x}
        yield fit_row(FitRow, rng, MODELS, name, **own)


def made(change=lambda *_: {}):
    """A report of made-up trials, and these; `change` gives fields of a row, of it and its seed."""

    def rows(seed):
        own = rows_of(np.random.default_rng(seed))
        known = [replace(row, true_arm=member("family", seed)) for row in own]
        return [replace(row, **change(row, seed)) for row in known]

    trials = table_of(SEEDS, rows)
    return report(SETTINGS, SEEDS, trials), trials


@pytest.fixture(scope="module")
def whole():
    return made()


def test_numbers_are_medians_and_spreads_by_part_model_and_level_trial_by_trial(whole):
    found, trials = whole
    check(found, STUDY.printed)
    f = found.numbers
    models = {m.name: m for m in f["models"]}
    for part, words in PARTS.items():
        (sigma, judged), own = TRACKER[part], trials.where(part=part)
        check_cells(f["sweeps"][part], own, "sigma_um")
        for level in f["sweeps"][part]:
            calm, noisy = (own.where(name=level.name, sigma_um=x)["rms_um"] for x in (0.0, 200.0))
            check_spread(level.um_per_um, np.sqrt(np.maximum(0, noisy**2 - calm**2)) / 200)
        check_spread(f["gains"][part].joints.ours_mm, own.where(name=DEFAULT, sigma_um=sigma)["rms_um"] / 1e3)
        assert len(f["paired"][part]) == len(DUELS) * (len(SIGMAS) - 1)
        check_duels(f["paired"][part], own, "sigma_um")
        for name, (_, constraint, _) in MODELS.items():
            model, at = models[f"{name}, {words}"], own.where(name=name, sigma_um=sigma)
            check_spread(model[judged].rms_mm, at["rms_um"] / 1e3)
            check_spread(model[judged].p95_mm, at["p95_um"] / 1e3)
            assert model.method == {"none": "least squares", "psd": "GCO"}[constraint]
    assert len(f["weighted_over_flat"]) == 6
    read = trials.where(part="instrument")
    check_duels(f["weighted_over_flat"], read, "truth", "name", "distance_m", of="instrument")


def test_tables_show_errors_by_noise_with_its_cost(whole):
    f, tables = whole[0].numbers, whole[0].tables
    for part in PARTS:
        *levels, cost = tables[part].columns
        alone = replace(tables[part], columns=tuple(levels))
        check_pivot(alone, f["sweeps"][part], ("name", "sigma_um", "rms_um"), "um")
        shown = {row["name"]: cost.value(row) for row in tables[part].rows}
        assert shown == {level.name: level.um_per_um for level in f["sweeps"][part]}
    names = {row["name"].split(":")[0] for row in tables["instruments"].rows}
    assert names == {"linear truth", "nonlinear truth"}


def test_the_answer_is_at_the_noise_of_the_tracker_and_the_worst_at_the_largest():
    errors = {name: 1000.0 + 100 * k for k, name in enumerate(MODELS)} | {DEFAULT: 250.0}

    def change(row, _):
        if row.part == "instrument":
            return {}
        sizes = {TRACKER[row.part][0]: errors[row.name], 200.0: 2 * errors[row.name]}
        return {"rms_um": sizes.get(row.sigma_um, 1.0)}

    found, _ = made(change)
    both = (
        f"{DEFAULT} 250 um, least squares without prior 1100 um; 4.4 times smaller. Joint stiffness "
        "only 1000 um, 4.0 times larger."
    )
    assert found.answer == f"KR 500, 8 poses, 50 um of noise: {both}"
    assert found.claims[0] == f"108 runs of section 5.2, 25 um of noise: {both}"
    cone = "The cone by itself, KR 500, 8 poses, 50 um: MGCO56 beats MLS56 in 0 % (0 to 43 %) of 5 trials."
    assert found.claims[1].startswith(cone)
    assert found.worst == (
        f"Worst trial at 200 um, KR 500, 8 poses: {DEFAULT} 500 um, least squares without prior 2200 um, "
        "joint stiffness only 2000 um."
    )


@pytest.mark.parametrize("won", READ_BY)
def test_full_covariances_are_counted_by_truth_and_model(won):
    """They win with one truth and model, and lose in the other three cases."""

    def change(row, _):
        better = (row.truth, row.name) == ("nonlinear", won)
        own = {"flat weights": 40.0, "weighted": 20.0 if better else 80.0}
        return {"rms_um": own.get(row.instrument, 60.0)} if row.instrument else {}

    said = "4 m: full covariances help in 1 of 4 cases; error over that of flat weights 0.50 to 2.00"
    assert said in made(change)[0].claims[2]


def test_the_title_counts_the_true_arms(whole):
    arms = dict(zip(SEEDS, ("cast", "tubes", "cast", "tubes", "tubes"), strict=True))
    found, trials = made(lambda _, seed: {"true_arm": arms[seed]})
    assert "True arms in turn: cast links (2), links of tubes (3)." in found.title
    assert "True arm: cast links." in report(replace(SETTINGS, true_arm="cast"), SEEDS, trials).title


def test_the_figure_draws_the_numbers_in_the_colour_of_each_model(whole):
    f, drawn = whole[0].numbers, figures(whole[0])["noise_sensitivity.png"]
    seen = {name: own for name, own in MODELS.items() if name not in CROWD + FILLED_CROWD}
    for axes, (part, words) in zip(drawn.axes, PARTS.items(), strict=True):
        assert axes.get_title() == words
        assert (unit_in(axes.get_xlabel()), unit_in(axes.get_ylabel())) == ("um", "um")
        lines, levels = curves(axes), {}
        for name in seen:
            levels[name] = [row for row in f["sweeps"][part] if row.name == name and row.sigma_um > 0]
            assert np.transpose(lines[name]).tolist() == [[r.sigma_um, r.rms_um.median] for r in levels[name]]
        for name, band in zip([name for name in lines if name in BANDS], bands(axes), strict=True):
            np.testing.assert_allclose(band, [(r.sigma_um, *ends_of(r.rms_um)) for r in levels[name]])
        shades = {line.get_label(): line.get_color() for line in axes.get_lines()}
        assert shades == {name: look(*own).hex for name, own in seen.items()}
    looks_differ(key_of(drawn))
