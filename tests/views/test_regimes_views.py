"""What people see of the study of regimes equals its report, for trials that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import (
    check_pivot,
    check_report,
    check_spread,
    check_table,
    check_words,
    ends_of,
    summaries,
)
from made_up import fill, of_one_trial, single
from matplotlib.colors import to_rgba

from testbench.bench.rows import DatasetRow
from testbench.studies.regimes import figure
from testbench.studies.regimes.study import STUDY
from testbench.studies.regimes.trial import FULL_POSE, GRAVITY, PRIORS, CellRow, Settings
from testbench.trials.spread import Spread
from testbench.views.markdown import grid

SEEDS = range(3, 6)
SETTINGS = Settings(
    ("tubes", "cast"),
    gravity=replace(GRAVITY, poses=(8, 12), sigmas=(15e-6, 50e-6)),
    full_pose=replace(FULL_POSE, poses=(2, 4), sigmas=(25e-6, 100e-6)),
)
STRUCTURES = ("MGCO56", "ALL153")
MAPS = {
    "over_ls": "gco_over_ls", "over_equal": "gco_over_equal", "over_lent": "gco_over_lent",
    "over_joints": "gco_over_joints", "fitted": "fitted", "better": "better_in", "binds": "binds_in",
}  # fmt: skip
LEVELS = {
    "of the fits": "share",
    "GCO over least squares": "gco_over_ls",
    "GCO over least squares, same free directions": "gco_over_lent",
    "GCO better": "better_in",
    "GCO over joints alone": "gco_over_joints",
    "beats joints": "beats_joints_in",
}
PRIOR = {
    "uncertainty": "prior",
    "noise of a reading, um": "noise_um",
    "cone binds": "binds_in",
    "GCO over least squares": "gco_over_ls",
    "where it binds": "where_it_binds",
    "GCO over joints alone": "gco_over_joints",
    "beats joints": "beats_joints_in",
}


def trials(rng, given=lambda row: {}):
    """Made-up rows; `given` fixes fields of a row by what it is."""
    found = []
    for seed in SEEDS:
        own = [
            row_of(rng, kind=kind, truth=truth, structure=structure, prior=prior, poses=poses, noise=sigma)
            for kind, cells in SETTINGS.grids.items()
            for truth in SETTINGS.truths
            for structure in STRUCTURES
            for prior in ("none", *PRIORS)
            for poses, sigma in cells.cells
        ]
        own = [replace(row, **given(row)) for row in own]
        measured = single(fill(DatasetRow, rng))
        found.append((seed, [replace(own[0], measured=measured), *own[1:]]))
    return found


def row_of(rng, *, prior, noise, **fixed):
    nothing = {} if prior == "none" else {"equal_um": None, "lent_um": None}
    expected = float(rng.choice([0.005, 0.2, 2.0]))
    row = of_one_trial(
        CellRow, rng, prior=prior, noise_um=round(1e6 * noise), expected=expected, measured=None, **fixed
    )
    return replace(row, noise_um=float(row.noise_um), **nothing)


summed, made, report = summaries(STUDY, SETTINGS, SEEDS, trials)


def picked(made, **fixed):
    """Rows of all trials with these fields."""
    rows = [row for _, own in made for row in own]
    return [row for row in rows if all(getattr(row, key) == value for key, value in fixed.items())]


def over(rows, ours, theirs):
    return np.array([getattr(row, ours) / getattr(row, theirs) for row in rows])


def test_every_cell_is_ratios_fit_by_fit_of_its_own_rows(made, report):
    for kind, cells in report.cells.items():
        assert len(cells) == len(STRUCTURES) * len(SETTINGS.grids[kind].cells)
        for cell in cells:
            rows = picked(
                made, kind=kind, structure=cell.structure, prior="none", poses=cell.poses,
                noise_um=cell.noise_um,
            )  # fmt: skip
            assert len(rows) == cell.fits == len(SEEDS) * len(SETTINGS.truths)
            check_spread(cell.gco_over_ls, over(rows, "gco_um", "ls_um"))
            check_spread(cell.gco_over_equal, over(rows, "gco_um", "equal_um"))
            check_spread(cell.gco_over_lent, over(rows, "gco_um", "lent_um"))
            check_spread(cell.lent_over_ls, over(rows, "lent_um", "ls_um"))
            check_spread(cell.gco_over_joints, over(rows, "gco_um", "joints_um"))
            check_spread(cell.fitted, over(rows, "gco_fitted_um", "ls_fitted_um"))
            assert cell.better_in == np.mean([row.gco_um < row.ls_um for row in rows])
            assert cell.beats_joints_in == np.mean([row.gco_um < row.joints_um for row in rows])
            assert cell.binds_in == np.mean([row.binds for row in rows])
            assert cell.conservative_in == np.mean([row.conservative for row in rows])


def test_fits_are_sorted_by_what_is_expected_where_the_cone_binds(made, report):
    for kind, levels in report.levels.items():
        rows = picked(made, kind=kind, prior="none")
        assert [level.name for level in levels] == ["0 to 1 %", "10 to 30 %", "over 100 %"]
        for level, expected in zip(levels, (0.005, 0.2, 2.0), strict=True):
            own = [row for row in rows if row.binds and row.expected == expected]
            assert level.share == len(own) / len(rows)
            check_spread(level.gco_over_ls, over(own, "gco_um", "ls_um"))
        free = [row for row in rows if not row.binds]
        assert report.free[kind].share == len(free) / len(rows)
        check_spread(report.free[kind].gco_over_lent, over(free, "gco_um", "lent_um"))


def test_a_prior_is_judged_by_what_it_is_compared_with_and_where_the_cone_binds(made, report):
    for kind, found in report.priors.items():
        assert [own.prior for own in found] == list(PRIORS)
        for own in found:
            rows = picked(made, kind=kind, prior=own.prior)
            check_spread(own.gco_over_ls, over(rows, "gco_um", "ls_um"))
            check_spread(own.where_it_binds, over([row for row in rows if row.binds], "gco_um", "ls_um"))
            assert own.binds_in == np.mean([row.binds for row in rows])


def gaining(row):
    """The cone halves the error with 2 poses, free directions do with 8; GCO costs with 12, one has free."""
    if row.prior != "none":
        return {}
    ours = {2: 50.0, 4: 100.0, 8: 50.0, 12: 300.0}[row.poses]
    lent = 50.0 if row.poses == 8 else 100.0
    small = row.structure == "MGCO56"
    fixed = {"ls_um": 100.0, "gco_um": ours, "lent_um": lent, "free": 5 if small else 0}
    return {**fixed, "joints_um": 60.0 if small else 40.0}


def test_the_answer_counts_what_the_cone_does_by_itself(rng):
    found = summed(trials(rng, gaining))
    g, f = found.counts["gravity"], found.counts["full_pose"]
    assert (g.cone_pays, g.pay, g.pay_and_beat_joints, g.cost, g.cost_with_free) == (0, 4, 2, 4, 2)
    assert (f.cone_pays, f.cone_pays_and_beats_joints, f.cost) == (4, 2, 0)
    words = STUDY.words(found)
    text = words.block("statements")
    assert "markers: the cone by itself pays in 0 of 8 cells; in 0 of these GCO beats" in text
    assert "full pose: the cone by itself pays in 4 of 8 cells; in 2 of these GCO beats" in text
    assert "joints alone are better" not in text
    assert "Worst under a weight: MGCO56, 12 poses, 15 um: GCO errs 3.00 times" in words.block("worst")
    assert "GCO (MGCO56) 50 um, least squares 100 um; 2.0 times less." in words.block("answer")
    assert "Joints alone 60 um, 1.2 times as much." in words.block("answer")


def test_it_is_said_where_the_cone_pays_and_joints_alone_are_better(rng):
    found = summed(trials(rng, lambda row: {**gaining(row), "joints_um": 40.0}))
    words = STUDY.words(found)
    said = words.block("more")
    assert "Six wrenches, full pose: the cone by itself pays against least squares" in said
    assert "A weight, three markers: the cone by itself pays against" not in said
    assert "pays in 4 of 8 cells; in all of these joints alone are better." in words.block("statements")


def test_a_gain_that_is_small_or_not_in_nearly_all_arms_does_not_count(report):
    cell = report.cells["gravity"][0]
    for ratio, pays, costs in (
        (Spread(0.5, 0.1, 0.99), True, False),
        (Spread(0.5, 0.1, 1.01), False, False),
        (Spread(0.96, 0.95, 0.97), False, False),
        (Spread(2.0, 1.01, 3.0), False, True),
        (Spread(1.02, 1.01, 1.03), False, False),
    ):
        own = replace(cell, gco_over_ls=ratio, gco_over_lent=ratio)
        assert (own.pays, own.cone_pays, own.costs) == (pays, pays, costs)
    assert [replace(cell, beats_joints_in=share).beats_joints for share in (0.5, 0.51)] == [False, True]


def test_tables_show_the_reports_numbers_with_their_units(report):
    tables = STUDY.tables(report)
    for kind, cells in report.cells.items():
        for name, key in MAPS.items():
            check_pivot(tables[f"{kind}_{name}"], cells, ("name", "noise_um", key), "um")
        check_pivot(tables[f"{kind}_short"], cells, ("name", "noise_um", "gco_over_ls"), "um")
        levels = [*report.levels[kind], report.free[kind]]
        check_table(tables[f"{kind}_levels"], levels, {"expected error": "name", **LEVELS})
        check_table(tables[f"{kind}_truths"], report.truths[kind], {"true arm": "name", **LEVELS})
        check_table(tables[f"{kind}_priors"], report.priors_by_noise[kind], PRIOR)
    text = check_report(STUDY, report)
    check_words(STUDY.words(report))
    for kind, words in (("gravity", "A weight, three markers"), ("full_pose", "Six wrenches, full pose")):
        part = text.split(f"## {words}: GCO over least squares with the same free directions")[1]
        assert grid(tables[f"{kind}_over_lent"]) in part.split("##")[0]


def test_the_figure_draws_medians_hatches_what_is_open_and_frames_what_beats_joints(report):
    drawn = figure.maps(report)
    panels = [axes for axes in drawn.axes if axes.images]
    keys = [("gravity", key) for key in ("gco_over_ls", "gco_over_equal", "gco_over_lent")]
    keys += [("full_pose", key) for key in ("gco_over_ls", "gco_over_lent")]
    wanted = [(kind, key, structure) for kind, key in keys for structure in STRUCTURES]
    assert len(panels) == len(wanted)
    asked = SETTINGS.grids
    for axes, (kind, key, structure) in zip(panels, wanted, strict=True):
        noise, poses = ([1e6 * sigma for sigma in asked[kind].sigmas], list(asked[kind].poses))
        texts = {t.get_position(): t.get_text() for t in axes.texts}
        marks = {"hatched": set(), "framed": set()}
        for patch in axes.patches:
            centre = tuple(np.rint(np.add(patch.get_xy(), 0.5)).astype(int).tolist())
            marks["hatched" if patch.get_hatch() else "framed"].add(centre)
        values = axes.images[0].get_array()
        for cell in (c for c in report.cells[kind] if c.structure == structure):
            at = noise.index(pytest.approx(cell.noise_um)), poses.index(cell.poses)
            ratio = getattr(cell, key)
            assert values[at[::-1]] == ratio.median
            assert float(texts[at]) == pytest.approx(ratio.median, abs=0.0051)
            assert (at in marks["hatched"]) == (ends_of(ratio)[0] < 1 < ends_of(ratio)[1])
            assert (at in marks["framed"]) == cell.beats_joints
    for k, kind in ((4, "gravity"), (8, "full_pose")):  # the last panel in the first column
        across, up = panels[k].get_xticklabels(), panels[k].get_yticklabels()
        assert [t.get_text() for t in across] == [f"{1e6 * sigma:g}" for sigma in asked[kind].sigmas]
        assert [t.get_text() for t in up] == [f"{count}" for count in asked[kind].poses]
        assert panels[k].get_xlabel().endswith("[um]")
    green, brown = (figure.COLOURS(figure.SCALE(ratio)) for ratio in (0.2, 5.0))
    assert green[1] > green[0]
    assert brown[0] > brown[1]
    assert to_rgba(figure.COLOURS(figure.SCALE(1.0)))[:3] == pytest.approx((0.96, 0.96, 0.96), abs=0.01)
