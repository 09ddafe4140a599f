"""What is said and drawn of the map of regimes is what its trials hold, of trials that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import check_pivot, check_spread, ends_of, unit_in
from made_up import of_one_trial
from reports import check, table_of

from testbench.campaign.rows import DatasetRow
from testbench.studies.regimes.study import FREE, KINDS, STUDY, costs, figures, pays, report
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
from testbench.views import ratio_figure

SEEDS = range(3, 6)
SETTINGS = Settings(
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
        found = []
        for kind, grid in SETTINGS.grids.items():
            for arm in SETTINGS.truths:
                for structure in STRUCTURES:
                    for uncertainty in ("none", *PRIORS):
                        for poses, sigma in grid.cells:
                            cell = {"part": kind, "true_arm": arm, "structure": structure, "poses": poses}
                            cell |= {"uncertainty": uncertainty, "sigma_um": 1e6 * sigma, "measured": None}
                            cell |= {"expected": float(rng.choice([*EXPECTED.values()]))}
                            cell |= {"binds": bool(rng.integers(2)), "free": int(rng.integers(5))}
                            plain = uncertainty == "none"
                            for name, constraint in METHODS.items():
                                if plain or name not in (EQUAL, LENT):
                                    known = {**cell, "name": name, "constraint": constraint}
                                    row = of_one_trial(MethodRow, rng, prior=not plain, **known)
                                    found.append(replace(row, **given(row)))
        return [replace(found[0], measured=of_one_trial(DatasetRow, rng)), *found[1:]]

    trials = table_of(SEEDS, rows)
    return report(SETTINGS, SEEDS, trials), trials


@pytest.fixture(scope="module")
def whole():
    return made()


def errors(trials, name, **alike):
    """Of one method, fit by fit: rows of the methods of a case follow one another."""
    return trials.where(name=name, **alike)["rms_um"]


def test_every_cell_and_prior_is_ratios_fit_by_fit_of_its_own_rows(whole):
    found, trials = whole
    check(found, STUDY.printed)
    f, cell = found.numbers, ("part", "structure", "poses", "sigma_um")
    cells = sum(len(grid.cells) for grid in SETTINGS.grids.values()) * len(STRUCTURES)
    assert len(f["cells"]) == cells * (len(METHODS) - 1)
    for row in f["cells"]:
        at = {"uncertainty": "none", **{name: row[name] for name in cell}}
        ours, theirs = (errors(trials, name, **at) for name in (GCO, row.theirs))
        assert len(ours) == row.trials == len(SEEDS) * len(SETTINGS.truths)
        check_spread(row.ratio, ours / theirs)
        assert row.won == np.mean(ours < theirs)
    for row in f["errors"]:
        check_spread(row.rms_um, errors(trials, row.name, uncertainty="none", **{n: row[n] for n in cell}))
    for row in f["priors"]:
        at = {"part": row.part, "uncertainty": row.uncertainty}
        check_spread(row.ratio, errors(trials, GCO, **at) / errors(trials, row.theirs, **at))
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
            ours, theirs = (errors(every, name, **own) for name in (GCO, SQUARES))
            assert level.fits_share == len(ours) / len(every.where(name=GCO))
            check_spread(level.ratio, ours / theirs)
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
    assert f", {best}: GCO {um[best]:.0f} um" in found.answer


def test_the_gain_of_the_cone_is_told_at_most_and_at_least_noise(whole):
    found, _ = whole
    levels = [r for r in found.numbers["levels"] if (r.part, r.theirs) == ("gravity", LENT)]
    low, high = (levels[k].ratio.median for k in (0, -2))
    said = f"{high:.2f} times their error where noise costs over 100 % of the deflection, {low:.2f} at 0 to"
    assert said in found.claims[2]


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
    g, f = (found.numbers["counts"][kind] for kind in KINDS)
    assert (g.cone_pays, g.pay, g.pay_and_beat_joints, g.cost, g.cost_with_free) == (0, 4, 2, 4, 2)
    assert (f.cone_pays, f.cone_pays_and_beats_joints, f.cost) == (4, 2, 0)
    text = "\n".join(found.claims)
    assert "markers: the cone by itself pays in 0 of 8 cells; in 0 of these GCO beats" in text
    assert "full pose: the cone by itself pays in 4 of 8 cells; in 2 of these GCO beats" in text
    assert found.worst.startswith("Worst under a weight: MGCO56, 12 poses, 15 um: GCO errs 3.00 times")
    assert "MGCO56: GCO 50 um, least squares 100 um; 2.0 times smaller." in found.answer
    assert "Joint stiffness only 60 um, 1.2 times larger." in found.answer
    better, _ = made(lambda row: gaining(row) | ({"rms_um": 40.0} if row.name == JOINTS else {}))
    assert "pays in 4 of 8 cells; in all of these joint stiffness only is better." in better.claims[1]


def test_a_gain_that_is_small_or_not_in_nearly_all_fits_does_not_count():
    for ratio, gains, loses in (
        (Spread(0.5, 0.1, 0.99), True, False),
        (Spread(0.5, 0.1, 1.01), False, False),
        (Spread(0.96, 0.95, 0.97), False, False),
        (Spread(2.0, 1.01, 3.0), False, True),
        (Spread(1.02, 1.01, 1.03), False, False),
    ):
        assert (pays(ratio), costs(ratio)) == (gains, loses)


def test_the_figure_draws_medians_hatches_what_is_open_and_frames_what_beats_joints(whole):
    found, _ = whole
    cells = {(r.part, r.structure, r.poses, r.sigma_um, r.theirs): r for r in found.numbers["cells"]}
    panels = [axes for axes in figures(found)["regimes.png"].axes if axes.images]
    wanted = [(kind, theirs, name) for kind in KINDS for theirs in (SQUARES, LENT) for name in STRUCTURES]
    for axes, (kind, theirs, structure) in zip(panels, wanted, strict=True):
        grid = SETTINGS.grids[kind]
        noise, poses = ([1e6 * sigma for sigma in grid.sigmas], list(grid.poses))
        texts = {t.get_position(): t.get_text() for t in axes.texts}
        marks = {"hatched": set(), "framed": set()}
        for patch in axes.patches:
            centre = tuple(np.rint(np.add(patch.get_xy(), 0.5)).astype(int).tolist())
            marks["hatched" if patch.get_hatch() else "framed"].add(centre)
        for x, sigma in enumerate(noise):
            for y, count in enumerate(poses):
                ratio = cells[kind, structure, count, sigma, theirs].ratio
                assert axes.images[0].get_array()[y, x] == ratio.median
                assert texts[x, y] == f"{ratio.median:.2f}"
                assert ((x, y) in marks["hatched"]) == (ends_of(ratio)[0] < 1 < ends_of(ratio)[1])
                beats = cells[kind, structure, count, sigma, JOINTS].won > 0.5
                assert ((x, y) in marks["framed"]) == beats
        assert [t.get_text() for t in axes.get_xticklabels()] == [f"{x:g}" for x in noise]
        assert [t.get_text() for t in axes.get_yticklabels()] == [f"{count}" for count in poses]
        assert (unit_in(axes.get_xlabel()), axes.get_ylabel()) == ("um", "poses")
        assert structure in axes.get_title()
    green, brown = (ratio_figure.COLOURS(ratio_figure.SCALE(ratio)) for ratio in (0.2, 5.0))
    assert green[1] > green[0]
    assert brown[0] > brown[1]
