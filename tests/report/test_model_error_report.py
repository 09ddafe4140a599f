"""What is said and drawn of disturbances is what their trials hold, of trials that are made up."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from checks import check_pivot, check_spread, key_of, looks_differ
from reports import check, check_cells, check_duels, check_ranges, check_said, fit_row, table_of

from testbench.campaign.true_arms import CALLED, HELD_OUT, TRUTHS, member
from testbench.studies.factorial.trial import Cover
from testbench.studies.model_error.kinds import CALM, EVERY
from testbench.studies.model_error.settings import ALL, NONE, SIZES, STIFF, Settings, disturbances
from testbench.studies.model_error.study import STUDY, figures, report
from testbench.studies.model_error.trial import BESIDE, BESIDE_IT, IN_FAMILY, DisturbedRow
from testbench.views.colours import look

SEEDS = range(2, 7)
SETTINGS = Settings(arm="kr500_l480", first=2, sigma=40e-6)
CASES = list(disturbances(1.0))
PLAIN = "gravity compensator"
DEFAULT = "ALL153 + prior"
MODELS = {
    "Joints": ("Joints", "none", False),
    "MLS56": ("MLS56", "none", False),
    "MGCO56": ("MGCO56", "psd", False),
    "MLS56 + prior": ("MLS56", "none", True),
    "MGCO56 + prior": ("MGCO56", "psd", True),
    "LS153 + prior": ("LS153", "none", True),
    DEFAULT: ("ALL153", "psd", True),
}


def made(errors=None, beside=None, covered=None, seeds=SEEDS):
    """A report of made-up trials, and these.

    Args:
        errors: Some of the family's, by case, model and noise.
        beside: Some of those beside it, by true arm and model.
        covered: By seed, of the default on all arms.
        seeds: Of the trials.
    """

    def row(rng, seed, case, noise, name, part, arm, size, error):
        factors = {"part": part, "true_arm": arm, "size": size, "case": case, "sigma_um": noise}
        own = fit_row(DisturbedRow, rng, MODELS, name, **factors)
        seen = Cover(covered[seed] if covered else 100 * rng.uniform(), 0.1, 0.1)
        cover = seen if noise and name == DEFAULT else None
        return replace(own, rms_um=own.rms_um if error is None else error, cover=cover)

    def rows(seed):
        rng, own = np.random.default_rng(seed), member("family", seed)
        for case, noise, name in product(CASES, (0.0, 40.0), MODELS):
            error = (errors or {}).get((case, name, noise))
            yield row(rng, seed, case, noise, name, IN_FAMILY, own, 1.0, error)
        for arm, size in [*((own, size) for size in SIZES), *((arm, 1.0) for arm in HELD_OUT)]:
            for name in BESIDE:
                error = (beside or {}).get((arm, name))
                yield row(rng, seed, ALL, 40.0, name, BESIDE_IT, arm, size, error)

    trials = table_of(seeds, lambda seed: [*rows(seed)])
    return report(SETTINGS, seeds, trials), trials


@pytest.fixture(scope="module")
def whole():
    return made()


def test_numbers_are_medians_and_spreads_by_case_model_and_noise_trial_by_trial(whole):
    found, trials = whole
    f = found.numbers
    check(found, STUDY.printed)
    trials = trials.where(part=IN_FAMILY)
    check_cells(f["cells"], trials, "case", "sigma_um")
    check_duels(f["beats"], trials.where(case=ALL, sigma_um=40.0))

    def of(case, name, noise):
        return trials.where(case=case, name=name, sigma_um=noise)["rms_um"]

    for cell in f["cells"]:
        own = of(cell.case, cell.name, cell.sigma_um)
        check_spread(cell.added_um, own - of(NONE, cell.name, cell.sigma_um))
    workspace = {m.name: m.workspace.rms_mm for m in f["models"]}
    assert len(workspace) == 2 * len(MODELS)
    for case, name in product((NONE, ALL), MODELS):
        check_spread(workspace[f"{name}, {case}"], of(case, name, 40.0) / 1e3)
    assert len(f["claim"]) == 2 * len(MODELS)
    for row in f["claim"]:  # two readings of three axes
        own, none = (of(case, row.name, 40.0) for case in (row.case, NONE))
        read = np.sqrt(own**2 + 6 * 40.0**2) / np.sqrt(none**2 + 6 * 40.0**2) - 1
        for key, change in (("true", own / none - 1), ("read", read)):
            check_spread(row[f"{key}_change_percent"], 100 * change)
            assert row[f"{key}_within"] == np.mean(np.abs(change) <= 0.048)


def test_tables_show_the_numbers_with_noise_and_the_costliest_disturbance_first(whole):
    f, tables = whole[0].numbers, whole[0].tables
    noisy = [cell for cell in f["cells"] if cell.sigma_um == 40.0]
    check_pivot(tables["noisy"], noisy, ("case", "name", "rms_um"), called=({NONE: "no disturbance"}, {}))
    assert tables["noisy"].title == "RMS error, um, with noise of 40 um"
    added = [row.added_um.median for row in tables["ranking"].rows]
    assert added == sorted(added, reverse=True)
    assert {row.case for row in tables["ranking"].rows} == {*CASES} - {NONE, ALL}


def test_sizes_of_disturbances_are_said_in_their_units(whole):
    check_said(
        whole[0],
        "joint sensors: Joint sensors are off by 0.35 mrad.",
        "payload mass: The payload is 0.2 % heavier than recorded.",
        "payload centre: The hanging point is off by 2 mm.",
        "backlash: Joints have 50 urad of play to either side.",
        "nominal geometry: Frames are off by 0.5 mm and 0.87 mrad.",
        "stiffening joints: Joints are 10 % stiffer a mrad of turn.",
        "65 kN/m as joint 2 turns, 96000 kN/m as the arm deflects.",
    )


def test_the_answer_is_that_with_noise_and_all_disturbances():
    own = {"Joints": 90.0, "MLS56": 70.0, "MGCO56": 80.0} | {name: 50.0 for name in MODELS if MODELS[name][2]}
    found, _ = made({(ALL, name, 40.0): size for name, size in own.items()})
    assert found.answer == (
        f"Disturbed in every way, 40 um of noise: {DEFAULT} 50 um, least squares without prior 70 um; "
        "1.4 times smaller. Joint stiffness only 90 um, 1.8 times larger."
    )
    assert found.claims[3] == (
        "The cone by itself: MGCO56 beats MLS56 in 0 % (0 to 43 %) of 5 trials. ALL153 + prior beats LS153 + "
        "prior, the same without the cone, in 0 % (0 to 43 %), both err the same in 100 % (57 to 100 %); its "
        "error is 1.000 times theirs."
    )


def test_kinds_of_arms_have_their_own_errors_coverage_and_share_removed(whole):
    found, trials = whole
    noisy = trials.where(sigma_um=40.0)
    family, beside = (noisy.where(part=part) for part in (IN_FAMILY, BESIDE_IT))
    parts = {EVERY: family.where(case=ALL), CALM: family.where(case=NONE)}
    parts["stiff compensator alone"] = family.where(case=STIFF)
    parts |= {CALLED[arm]: beside.where(true_arm=arm) for arm in HELD_OUT}
    parts |= {f"disturbances times {size:g}": beside.where(size=size) for size in SIZES}
    met = [arm for arm in TRUTHS if arm in {member("family", seed) for seed in SEEDS}]
    parts |= {CALLED[arm]: family.where(case=ALL, true_arm=arm) for arm in met}
    rows = {row.kind: row for row in found.numbers["kinds"]}
    assert rows.keys() == parts.keys()
    assert list(rows)[: 1 + len(HELD_OUT)] == [EVERY, *(CALLED[arm] for arm in HELD_OUT)]
    for kind, part in parts.items():
        own, joints, same = (part.where(name=name) for name in (DEFAULT, "Joints", "MLS56 + prior"))
        row = rows[kind]
        for key, of in (("default", own), ("Joints", joints), ("same_prior", same)):
            check_spread(row[f"{key}_um"], of["rms_um"])
        covered = own["cover.covered_percent"]
        assert (row.trials, row.beats_joints) == (len(own), np.mean(own["rms_um"] < joints["rms_um"]))
        assert row.beats_same_prior == np.mean(own["rms_um"] < same["rms_um"])
        assert row.covered_percent == pytest.approx(np.mean(covered))
        assert row.worst_tenth_percent == min(covered)  # of at most five arms one
        check_spread(row.removed_percent, 100 * (1 - own["rms_um"] / own["deflection_um"]))


def test_the_worst_tenth_are_the_arms_that_are_covered_worst():
    seeds = range(2, 24)  # 22 arms: the worst three
    covered = dict.fromkeys(seeds, 90.0) | {5: 30.0, 11: 60.0, 20: 75.0}
    found, _ = made(covered=covered, seeds=seeds)
    [row] = [row for row in found.numbers["kinds"] if row.kind == EVERY]
    assert row.worst_tenth_percent == pytest.approx((30 + 60 + 75) / 3)
    assert row.covered_percent == pytest.approx((19 * 90 + 30 + 60 + 75) / 22)
    assert found.claims[0].startswith(
        "95 % intervals of ALL153 + prior cover 85.2 % of the disturbed family's deflections, 55 % in the "
        "worst tenth of arms."
    )


def test_where_the_default_loses_is_said_the_worst_first():
    sizes = {"Joints": 90.0, "MLS56 + prior": 90.0, DEFAULT: 50.0}
    errors = {(case, name, 40.0): um for case in CASES for name, um in sizes.items()}
    beside = {(arm, name): um for arm in [*HELD_OUT, *TRUTHS] for name, um in sizes.items()}
    won, _ = made(errors, beside)
    assert won.claims[1] == (
        "ALL153 + prior beats joint stiffness only on 100 % (57 to 100 %) of 5 arms of the family, LS with "
        "the same prior on 100 % (57 to 100 %). In the median it loses to joint stiffness only on no kind. "
        "It loses to LS with the same prior on no kind."
    )
    lost = {("coupled", "Joints"): 45.0, ("stiffer_30", "Joints"): 25.0, ("soft_link", "Joints"): 49.0}
    found, _ = made(errors, beside | lost | {("coupled", "MLS56 + prior"): 48.0})
    assert found.claims[1].endswith(
        "it loses to joint stiffness only on links 30 times stiffer, coupled links and 1 other kind. It "
        "loses to LS with the same prior on coupled links."
    )


@pytest.mark.parametrize("worst", ["own weight", pytest.param(STIFF, marks=pytest.mark.study)])
def test_the_costliest_disturbance_is_named_whichever_it_is(worst):
    errors = {(case, DEFAULT, 0.0): 20.0 + k for k, case in enumerate(CASES)}
    errors |= {(NONE, DEFAULT, 0.0): 20.0, (NONE, DEFAULT, 40.0): 45.0, (worst, DEFAULT, 0.0): 90.0}
    found, _ = made(errors)
    second, third = [c for c in CASES[::-1] if c not in (ALL, worst)][:2]
    assert found.worst == (
        f'Costliest without noise, medians: "{worst}" adds 70 um to the error of {DEFAULT}; '
        f'then come "{second}" +{CASES.index(second)} um, "{third}" +{CASES.index(third)} um.'
    )
    assert f"Noise of 40 um adds 25 um to the error of {DEFAULT}" in found.claims[2]
    assert found.numbers["above_noise"] == [worst]
    calm, _ = made({(case, DEFAULT, 0.0): 20.0 for case in CASES})
    assert calm.worst == f"Costliest without noise: no disturbance adds to the error of {DEFAULT}."


def test_the_true_change_by_the_compensator_stands_before_the_one_that_noise_hides():
    """50 um become 60: +20 %; beside 98 um of noise in quadrature they are +4.4 %."""
    errors = {(NONE, name, 40.0): 50.0 for name in MODELS} | {(STIFF, name, 40.0): 500.0 for name in MODELS}
    found, _ = made(errors | {(PLAIN, name, 40.0): 50.0 if name == "MLS56" else 60.0 for name in MODELS})
    said = f'"{PLAIN}" changes the true error of {DEFAULT} by +20.0 %; against readings it looks like +4.4 %.'
    assert said in found.claims
    claim = {(row.case, row.name): (row.true_within, row.read_within) for row in found.numbers["claim"]}
    assert claim[PLAIN, "MLS56"] == (True, True)
    assert claim[PLAIN, DEFAULT] == (False, True)
    assert claim[STIFF, DEFAULT] == (False, False)


def test_the_figure_draws_the_numbers_in_the_colour_of_each_model_and_joins_no_two_cases(whole):
    found, drawn = whole[0], figures(whole[0])["model_error.png"]
    looks = {name: look(*own) for name, own in MODELS.items()}
    panes = ((0.0, "without noise"), (40.0, "with noise of 40 um"))
    for axes, (noise, words) in zip(drawn.axes, panes, strict=True):
        assert axes.get_title() == words
        own = {(c.name, c.case): c.rms_um for c in found.numbers["cells"] if c.sigma_um == noise}
        check_ranges(axes, {name: [own[name, case] for case in CASES] for name in MODELS}, looks, "um")
    assert [t.get_text() for t in drawn.axes[0].get_yticklabels()] == ["no disturbance", *CASES[1:]]
    looks_differ(key_of(drawn))
