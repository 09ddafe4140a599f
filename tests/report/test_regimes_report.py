"""What is said and drawn of the map of regimes is what its trials hold, of trials that are made up."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from checks import check_pivot, key_of, looks_differ
from made_up import of_one_trial
from reports import check, check_cells, check_duels, check_ranges, check_said, table_of

from testbench.studies.regimes.study import FREE, KINDS, STUDY, figures, pays, report
from testbench.studies.regimes.trial import (
    EQUAL,
    FULL_POSE,
    GCO,
    GRAVITY,
    JOINTS,
    LENT,
    PRIORS,
    SQUARES,
    MethodRow,
    Settings,
)
from testbench.trials.spread import Spread
from testbench.views.colours import look

SEEDS = range(3, 6)
SETTINGS = Settings(
    3,
    ("tubes", "cast"),
    gravity=replace(GRAVITY, poses=(8, 12), sigmas=(15e-6, 50e-6)),
    full_pose=replace(FULL_POSE, poses=(2, 4), sigmas=(25e-6, 100e-6)),
)
STRUCTURES = ("MGCO56", "ALL153")
METHODS = {GCO: "psd", SQUARES: "none", EQUAL: "free", LENT: "none", JOINTS: "none"}
EXPECTED = {"0 to 1 %": 0.005, "10 to 30 %": 0.2, "over 100 %": 2.0}


def made(given=lambda row: {}):
    """A report and its trials; `given` fixes columns of a row by what it is."""
    rng = np.random.default_rng(2021)

    def rows(seed):
        for kind, grid in SETTINGS.grids.items():
            cases = product(SETTINGS.truths, STRUCTURES, ("none", *PRIORS), grid.cells)
            for arm, structure, uncertainty, (poses, sigma) in cases:
                cell = {"part": kind, "true_arm": arm, "structure": structure, "poses": poses}
                cell |= {"uncertainty": uncertainty, "sigma_um": 1e6 * sigma}
                cell |= {"expected": float(rng.choice([*EXPECTED.values()]))}
                cell |= {"binds": bool(rng.integers(2)), "free": int(rng.integers(5))}
                for name, constraint in METHODS.items():
                    if uncertainty == "none" or name not in (EQUAL, LENT):
                        known = {**cell, "name": name, "constraint": constraint}
                        row = of_one_trial(MethodRow, rng, prior=uncertainty != "none", **known)
                        yield replace(row, **given(row))

    trials = table_of(SEEDS, lambda seed: [*rows(seed)])
    return report(SETTINGS, SEEDS, trials), trials


@pytest.fixture(scope="module")
def whole():
    return made()


def errors(trials, name, **alike):
    """Of one method, fit by fit: rows of the methods of a case follow one another."""
    return trials.where(name=name, **alike)["rms_um"]


def test_every_cell_is_ratios_fit_by_fit_of_its_own_rows(whole):
    found, trials = whole
    check(found, STUDY.printed)
    f, plain = found.numbers, trials.where(uncertainty="none")
    cell = ("part", "structure", "poses", "sigma_um")
    assert {row.trials for row in f["cells"]} == {len(SEEDS) * len(SETTINGS.truths)}
    assert len(f["cells"]) == len(plain.parts(*cell)) * (len(METHODS) - 1)
    check_duels(f["cells"], plain, *cell)
    check_cells(f["errors"], plain, *cell)
    for kind in KINDS:
        rows = [r | {"cell": f"{r.structure}, {r.poses} poses"} for r in f["cells"] if r.theirs == SQUARES]
        rows = [row for row in rows if row["part"] == kind]
        check_pivot(found.tables[kind], rows, ("cell", "sigma_um", "ratio"), "um")


def test_fits_are_sorted_by_what_is_expected_where_the_cone_binds(whole):
    found, trials = whole
    for kind, words in KINDS.items():
        every = trials.where(part=kind, uncertainty="none")
        levels = [row for row in found.numbers["levels"] if (row.part, row.theirs) == (kind, SQUARES)]
        assert [level.level for level in levels] == [*EXPECTED, FREE]
        for level in levels:
            binds = level.level != FREE
            own = {"binds": binds, **({"expected": EXPECTED[level.level]} if binds else {})}
            check_duels([level], every.where(**own))
            assert level.fits_share == level.trials / len(every.where(name=GCO))
            [shown] = [r for r in found.tables["levels"].rows if r["name"] == f"{words}: {level.level}"]
            assert (shown["c0"], shown["fits_share"]) == (level.ratio, level.fits_share)


def test_models_are_those_of_the_featured_cell_and_the_answer_is_of_the_best_structure(whole):
    found, trials = whole
    at = {"part": "gravity", "uncertainty": "none", "poses": 8, "sigma_um": 50}
    um = {name: np.median(errors(trials, GCO, structure=name, **at)) for name in STRUCTURES}
    mm = {m.name: m.workspace.rms_mm.median for m in found.numbers["models"]}
    assert mm["GCO, MGCO56"] == pytest.approx(1e-3 * um["MGCO56"])
    theirs = errors(trials, SQUARES, structure="MGCO56", **at)
    assert mm["least squares, MGCO56"] == pytest.approx(1e-3 * np.median(theirs))
    best = min(um, key=um.get)
    assert f", {best}: GCO {um[best]:.0f} um" in found.claims[0]
    assert f"in 6 cases of {best}, 8 poses, 50 um" in found.badge.words.replace("(", "in ")


def test_the_gain_of_the_cone_is_told_at_most_and_at_least_noise(whole):
    found, _ = whole
    levels = [r for r in found.numbers["levels"] if (r.part, r.theirs) == ("gravity", LENT)]
    low, high = (levels[k].ratio.median for k in (0, -2))
    said = f"{high:.2f} times their error where noise costs over 100 % of the deflection, {low:.2f} at 0 to"
    assert said in found.claims[1]


def gaining(row):
    """The cone halves the error with 2 poses, free directions do with 8; GCO costs with 12, one has free."""
    if row.uncertainty != "none":
        return {}
    small = row.structure == "MGCO56"
    ours = {2: 50.0, 4: 100.0, 8: 50.0, 12: 300.0}[row.poses]
    um = {GCO: ours, LENT: 50.0 if row.poses == 8 else 100.0, JOINTS: 60.0 if small else 40.0}
    return {"rms_um": um.get(row.name, 100.0), "free": 5 if small else 0}


def test_the_sentences_count_what_the_cone_does_by_itself():
    found, _ = made(gaining)
    assert found.answer.startswith("A weight, three markers: the cone by itself pays in ")  # as is asked
    check_said(
        found,
        "markers: the cone by itself pays in 0 of 8 cells; in 0 of these GCO beats",
        "full pose: the cone by itself pays in 4 of 8 cells; in 2 of these GCO beats",
        "Worst cell under a weight, medians: MGCO56, 12 poses, 15 um: GCO errs 3.00 times",
        "MGCO56: GCO 50 um, least squares without prior 100 um; 2.0 times smaller.",
        "Joint stiffness only 60 um, 1.2 times larger.",
    )
    better, _ = made(lambda row: gaining(row) | ({"rms_um": 40.0} if row.name == JOINTS else {}))
    assert "pays in 4 of 8 cells; in all of these joint stiffness only is better." in better.answer


def test_a_gain_that_is_small_or_not_in_nearly_all_fits_does_not_count():
    gains = {Spread(0.5, 0.1, 0.99): True, Spread(0.5, 0.1, 1.01): False, Spread(0.96, 0.95, 0.97): False}
    assert {ratio: pays(ratio) for ratio in gains} == gains


def test_the_figure_draws_the_ratios_beside_one_by_the_error_to_expect(whole):
    found, _ = whole
    drawn = figures(found)["regimes.png"]
    assert found.claims[1] in " ".join(drawn.get_suptitle().split())
    names = {"least squares": SQUARES, "same free directions": LENT, "joint stiffness only": JOINTS}
    kinds = (("MLS56", "none"), ("MLS56", "free"), ("Joints", "none"))
    looks, levels = {name: look(*kind) for name, kind in zip(names, kinds, strict=True)}, (*EXPECTED, FREE)
    for axes, kind in zip(drawn.axes, KINDS, strict=True):
        rows = {(r.theirs, r.level): r.ratio for r in found.numbers["levels"] if r.part == kind}
        check_ranges(axes, {n: [rows[key, level] for level in levels] for n, key in names.items()}, looks)
        assert any(line.get_linestyle() == ":" and set(line.get_xdata()) == {1} for line in axes.get_lines())
    assert [t.get_text() for t in drawn.axes[0].get_yticklabels()] == [*EXPECTED, FREE]
    looks_differ(key_of(drawn))
    lacking = (next(iter(KINDS)), list(EXPECTED)[1])
    least = [r for r in found.numbers["levels"] if (r.part, r.level) != lacking]
    short = replace(found, numbers=found.numbers | {"levels": least})
    labels = figures(short)["regimes.png"].axes[0].get_yticklabels()
    assert [t.get_text() for t in labels] == [*EXPECTED, FREE]  # one that the first pane lacks has its place
