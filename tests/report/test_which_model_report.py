"""What is said and drawn of the default method is what its trials hold, of trials that are made up."""

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from checks import check_pivot, check_spread
from reports import check, check_cells, check_forest, fit_row, place_of, table_of

from testbench.campaign.perturbed_prior import PRIORS, PRIORS_CALLED
from testbench.campaign.true_arms import CALLED
from testbench.studies.which_model.study import STUDY, figures, report
from testbench.studies.which_model.trial import COVERED, POSES, Cover, Doubted, MethodRow, Settings, pairs
from testbench.trials.spread import middle
from testbench.views.colours import CHOICE, look
from testbench.views.gains import share

SEEDS = range(2, 14)
DEFAULT = "default"
FIXED = {
    "Joints": ("Joints", "none", False),
    "MLS56, PSD of equal fit": ("MLS56", "free", False),
    "MLS56": ("MLS56", "none", False),
    "MGCO56": ("MGCO56", "psd", False),
    "MLS56 + prior": ("MGCO56", "none", True),
    "ALL153 + prior": ("ALL153", "psd", True),
}
METHODS = {DEFAULT: ("ALL153", "psd", True), **FIXED}
LINKS = ("link_1", "link_2")


@cache
def rows_of(seed):
    """Of a trial, in every case; what is known of some methods alone is None of the others."""
    return tuple(_rows_of(seed))


def _rows_of(seed):
    rng = np.random.default_rng(seed)
    for arm, prior in pairs(seed):
        wrong = {"link": LINKS[seed % 2], "joints": "joints"}.get(prior)
        share = rng.uniform(0.01, 0.04) + 0.05 * (wrong == LINKS[1]) if prior == "link" else None
        case = {"true_arm": arm, "prior_error": prior, "wrong": wrong, "link_share": share}
        for name, poses in product(METHODS, POSES):
            heard = tuple(n for n in (*LINKS, "joints") if rng.random() < 0.4)
            unread = tuple(n for n in LINKS if rng.random() < 0.5) if prior == "link" else None
            own = {
                "rms_um": rng.uniform(100, 900),
                "chosen": rng.choice(list(FIXED)).item() if name == DEFAULT else None,
                "cover": Cover(*rng.uniform(20, 90, 3)) if name in COVERED else None,
                "doubted": Doubted(heard, unread) if name == DEFAULT else None,
            }
            yield fit_row(MethodRow, rng, METHODS, name, poses=poses, **case, **own)


def made(change=lambda row: {}):
    """Rows of all trials, and the report of them; `change` fixes fields of a row by what it is."""
    rows = {seed: [replace(row, **change(row)) for row in rows_of(seed)] for seed in SEEDS}
    trials = table_of(SEEDS, rows.__getitem__)
    every = [(seed, row) for seed in SEEDS for row in rows[seed]]
    return every, report(Settings("kr500_l480", 2, sigma=40e-6), SEEDS, trials), trials


@pytest.fixture(scope="module")
def of_all():
    return made()


def test_every_method_is_compared_case_by_case_with_joints_alone(of_all):
    _, found, trials = of_all
    check(found, STUDY.printed)
    f = found.numbers
    check_cells(f.family, trials, "poses")
    check_cells(f.cells, trials.where(name=DEFAULT), "poses", "true_arm", "prior_error")
    for poses in POSES:
        every = {name: trials.where(poses=poses, name=name)["rms_um"] for name in METHODS}
        for own in [m for m in f.family if m.poses == poses]:
            over = every[own.name] / every["Joints"]
            check_spread(own.over_joints, over)
            assert own.loses == pytest.approx(np.mean(over > 1.05))
        squares, joints = f.gains[poses].least_squares, f.gains[poses].joints
        assert (squares.theirs, joints.theirs) == ("MLS56", "Joints")
        check_spread(joints.times, every["Joints"] / every[DEFAULT])


def test_a_method_loses_beyond_five_per_cent():
    sizes = {"Joints": 200.0, "MLS56": 208.0, "MGCO56": 212.0}
    f = made(lambda row: {"rms_um": sizes.get(row.name, row.rms_um)})[1].numbers
    assert {(m.name, m.loses) for m in f.family if m.name in ("MLS56", "MGCO56")} == {
        ("MLS56", False),
        ("MGCO56", True),
    }


def test_the_worst_case_and_the_losses_are_those_of_the_default():
    """Of a default that loses with cast links alone, by more with more poses."""

    def lost(row):
        um = 500.0 if row.name == "Joints" else 1900.0
        if row.name == DEFAULT:
            um = 30.0 * row.poses + 300 if row.true_arm == "cast" else 100.0
        return {"rms_um": um}

    found = made(lost)[1]
    assert found.worst.endswith(", 20 poses: 900 um, 1.80 times theirs.")
    assert found.claims[0] == (
        "The default errs over 5 % more than joint stiffness only in 17 % (10 to 27 %), 17 % (10 to 27 "
        "%) and 17 % (10 to 27 %) of 72 cases with 8, 12 and 20 poses."
    )


def test_intervals_and_doubts_are_counted_over_all_cases_and_over_parts(of_all):
    rows, found, _ = of_all
    default = [row for _, row in rows if row.name == DEFAULT]
    linked = [row for row in default if row.prior_error == "link"]
    others = {
        link: np.mean([link in row.doubted.unchecked for row in linked if row.wrong != link])
        for link in LINKS
    }
    parts = {
        "all": default,
        "12 poses": [row for row in default if row.poses == 12],
        "cast links": [row for row in default if row.true_arm == "cast"],
        **{
            f"prior {PRIORS_CALLED[name]}": [row for row in default if row.prior_error == name]
            for name in PRIORS
        },
        "a link off, less than 5 % of the deflection": [row for row in linked if row.link_share < 0.05],
        "a link off, more than 5 % of the deflection": [row for row in linked if row.link_share > 0.05],
    }
    promises = {(p.where, p.name): p for p in found.numbers["promises"]}
    assert {name for _, name in promises} == set(COVERED) & set(METHODS)
    for where, own in parts.items():
        p, covers = promises[where, DEFAULT], [row.cover for row in own]
        assert p.cases == len(own)
        assert p.covered_percent == pytest.approx(np.mean([c.covered_percent for c in covers]))
        check_spread(p.half_mm, [c.half_mm for c in covers])
        check_spread(p.over_ideal, [c.half_mm / c.ideal_mm for c in covers])
        assert p.doubted == pytest.approx(np.mean([len(row.doubted.contradicted) > 0 for row in own]))
        told = [row.wrong in row.doubted.contradicted for row in own if row.wrong]
        assert p.told == (pytest.approx(np.mean(told)) if told else None)
        link = [row for row in own if row.prior_error == "link"]
        named = [row.wrong in row.doubted.unchecked for row in link]
        assert p.unchecked == (pytest.approx(np.mean(named)) if link else None)
        assert p.otherwise == (pytest.approx(np.mean([others[row.wrong] for row in link])) if link else None)
        both = [row.wrong in (*row.doubted.unchecked, *row.doubted.contradicted) for row in link]
        assert p.either == (pytest.approx(np.mean(both)) if link else None)
    joints = np.mean([row.cover.covered_percent for _, row in rows if row.name == "Joints"])
    ours = promises["all", DEFAULT].covered_percent
    assert found.claims[1].startswith(f"Its 95 % intervals cover {ours:.1f} % of the true deflections. ")
    assert found.claims[1].endswith(f"only cover {joints:.0f} %: they count noise alone.")
    link, off = (
        share(promises[f"prior {name}", DEFAULT].doubted, "36") for name in ("one link off", "joints off")
    )
    said = f"one link off, in {link} of 36 cases; joints off, in {off} of 36 cases."
    assert found.claims[2] == f"Readings raise a doubt of a prior ten times off: {said}"


def test_the_answer_is_the_default_beside_its_rivals_with_fewest_poses():
    errors = {name: 400.0 + 100 * k for k, name in enumerate(FIXED)} | {DEFAULT: 300.0, ("Joints", 20): 1.0}
    found = made(lambda row: {"rms_um": errors.get((row.name, row.poses), errors[row.name])})[1]
    both = "least squares without prior 600 um; 2.0 times smaller. "
    both += "Joint stiffness only 400 um, 1.3 times larger."
    assert found.answer == f"8 poses: default 300 um, {both}"
    assert "8, 12 or 20 poses" in found.question


def test_tables_show_methods_by_poses_and_the_default_by_arm_and_prior(of_all):
    f, tables = of_all[1].numbers, of_all[1].tables
    check_pivot(tables["short"], [m | {"at": f"{m.poses} poses"} for m in f.family], ("name", "at", "rms_um"))
    assert tables["short"].title == "RMS error over the workspace, um"
    few = [m for m in f.cells if m.poses == 8]
    paths = ("true_arm", "prior_error", "over_joints")
    check_pivot(tables["cells"], few, paths, called=(CALLED, PRIORS_CALLED))


def test_the_figure_draws_the_numbers_in_the_colour_of_each_method(of_all):
    found = of_all[1]
    looks = [CHOICE if name == DEFAULT else look(*own) for name, own in METHODS.items()]
    for axes, poses in zip(figures(found)["which_model.png"].axes, POSES, strict=True):
        assert axes.get_title() == f"{poses} poses"
        errors = {m.name: m.rms_um for m in found.numbers.family if m.poses == poses}
        check_forest(axes, [errors[name] for name in METHODS], looks, "um", place_of(found, METHODS))
        [joints] = [line for line in axes.get_lines() if line.get_linestyle() == ":"]
        assert set(joints.get_xdata()) == {middle(errors["Joints"])}
