"""What is said and drawn of the map of regimes is what its trials hold, of trials that are made up."""

from dataclasses import replace

import numpy as np
import pytest
from checks import check_pivot, check_spread, check_table, ends_of, unit_in
from made_up import of_one_trial
from reports import check, table_of

from testbench.bench.rows import DatasetRow
from testbench.studies.regimes.study import FREE, KINDS, STUDY, costs, figures, pays, report
from testbench.studies.regimes.trial import FULL_POSE, GRAVITY, PRIORS, CellRow, Settings
from testbench.trials.spread import Spread
from testbench.views import ratio_figure

SEEDS = range(3, 6)
SETTINGS = Settings(
    ("tubes", "cast"),
    gravity=replace(GRAVITY, poses=(8, 12), sigmas=(15e-6, 50e-6)),
    full_pose=replace(FULL_POSE, poses=(2, 4), sigmas=(25e-6, 100e-6)),
)
STRUCTURES = ("MGCO56", "ALL153")
RATIOS = {
    "gco_over_ls": ("gco_um", "ls_um"),
    "gco_over_equal": ("gco_um", "equal_um"),
    "gco_over_lent": ("gco_um", "lent_um"),
    "gco_over_joints": ("gco_um", "joints_um"),
    "lent_over_ls": ("lent_um", "ls_um"),
    "fitted": ("gco_fitted_um", "ls_fitted_um"),
}
DRAWN = ("gco_over_ls", "gco_over_lent")
EXPECTED = {"0 to 1 %": 0.005, "10 to 30 %": 0.2, "over 100 %": 2.0}


def made(given=lambda row: {}):
    """A report and its trials; `given` fixes columns of a row by what it is."""
    rng = np.random.default_rng(2021)

    def row(uncertainty, **known):
        rest = {} if uncertainty == "none" else {"equal_um": None, "lent_um": None}
        expected = float(rng.choice([*EXPECTED.values()]))
        own = of_one_trial(CellRow, rng, uncertainty=uncertainty, expected=expected, measured=None, **known)
        return replace(own, **rest, **given(own))

    def rows(seed):
        found = [
            row(uncertainty, kind=kind, true_arm=arm, structure=name, poses=poses, sigma_um=1e6 * sigma)
            for kind, cells in SETTINGS.grids.items()
            for arm in SETTINGS.truths
            for name in STRUCTURES
            for uncertainty in ("none", *PRIORS)
            for poses, sigma in cells.cells
        ]
        return [replace(found[0], measured=of_one_trial(DatasetRow, rng)), *found[1:]]

    trials = table_of(SEEDS, rows)
    return report(SETTINGS, SEEDS, trials), trials


@pytest.fixture(scope="module")
def whole():
    return made()


def over(own, ratio):
    ours, theirs = RATIOS[ratio]
    return own[ours] / own[theirs]


def test_every_cell_and_prior_is_ratios_fit_by_fit_of_its_own_rows(whole):
    found, trials = whole
    check(found, STUDY.printed)
    for kind, cells in found.numbers["cells"].items():
        assert len(cells) == len(STRUCTURES) * len(SETTINGS.grids[kind].cells)
        for cell in cells:
            known = {name: cell[name] for name in ("kind", "structure", "poses", "sigma_um")}
            own = trials.where(uncertainty="none", **known)
            assert len(own) == cell.fits == len(SEEDS) * len(SETTINGS.truths)
            for name in RATIOS:
                check_spread(cell[name], over(own, name))
            assert cell.better_in == np.mean(own["gco_um"] < own["ls_um"])
            assert cell.beats_joints_in == np.mean(own["gco_um"] < own["joints_um"])
            assert (cell.binds_in, cell.solved_in) == (np.mean(own["binds"]), np.mean(own["solved"]))
            assert cell.cell == f"{cell.structure}, {cell.poses} poses"
        check_pivot(found.tables[kind], cells, ("cell", "sigma_um", "gco_over_ls"), "um")
        for row in found.numbers["priors"][kind]:
            own = trials.where(kind=kind, uncertainty=row.uncertainty)
            check_spread(row.gco_over_ls, over(own, "gco_over_ls"))
            assert row.binds_in == np.mean(own["binds"])


def test_fits_are_sorted_by_what_is_expected_where_the_cone_binds(whole):
    found, trials = whole
    for kind, levels in found.numbers["levels"].items():
        every = trials.where(kind=kind, uncertainty="none")
        assert [level.level for level in levels] == [*EXPECTED, FREE]
        for level in levels:
            binds = level.level != FREE
            own = every.where(binds=binds, **({"expected": EXPECTED[level.level]} if binds else {}))
            assert level.fits_share == len(own) / len(every)
            check_spread(level.gco_over_ls, over(own, "gco_over_ls"))
    rows = [
        r | {"level": f"{KINDS[k]}: {r.level}"} for k, own in found.numbers["levels"].items() for r in own
    ]
    means = {"expected error": "level", "of the fits": "fits_share", "GCO over least squares": "gco_over_ls"}
    means |= {"GCO over least squares, same free directions": "gco_over_lent", "GCO better": "better_in"}
    means |= {"GCO over joints alone": "gco_over_joints", "beats joints": "beats_joints_in"}
    check_table(found.tables["levels"], rows, means)


def test_models_are_those_of_the_featured_cell_and_the_answer_is_of_the_best_structure(whole):
    found, trials = whole
    own = trials.where(kind="gravity", uncertainty="none", poses=8, sigma_um=50)
    errors = {name: np.median(own.where(structure=name)["gco_um"]) for name in STRUCTURES}
    mm = {m.name: m.workspace.rms_mm.median for m in found.numbers["models"]}
    assert mm["MGCO56, GCO"] == pytest.approx(1e-3 * errors["MGCO56"])
    assert mm["MGCO56, least squares"] == pytest.approx(
        1e-3 * np.median(own.where(structure="MGCO56")["ls_um"])
    )
    best = min(errors, key=errors.get)
    assert f", {best}: GCO {errors[best]:.0f} um" in found.answer


def test_the_gain_of_the_cone_is_told_at_most_and_at_least_noise(whole):
    found, _ = whole
    low, high = (found.numbers["levels"]["gravity"][k].gco_over_lent.median for k in (0, -2))
    said = (
        f"{high:.2f} times their error where noise costs over 100 % of the deflection, {low:.2f} at 0 to 1 %."
    )
    assert said in found.claims[2]


def gaining(row):
    """The cone halves the error with 2 poses, free directions do with 8; GCO costs with 12, one has free."""
    if row.uncertainty != "none":
        return {}
    ours = {2: 50.0, 4: 100.0, 8: 50.0, 12: 300.0}[row.poses]
    small = row.structure == "MGCO56"
    lent, free, joints = 50.0 if row.poses == 8 else 100.0, 5 if small else 0, 60.0 if small else 40.0
    return {"ls_um": 100.0, "gco_um": ours, "lent_um": lent, "free": free, "joints_um": joints}


def test_the_sentences_count_what_the_cone_does_by_itself():
    found, _ = made(gaining)
    g, f = (found.numbers["counts"][kind] for kind in KINDS)
    assert (g.cone_pays, g.pay, g.pay_and_beat_joints, g.cost, g.cost_with_free) == (0, 4, 2, 4, 2)
    assert (f.cone_pays, f.cone_pays_and_beats_joints, f.cost) == (4, 2, 0)
    text = "\n".join(found.claims)
    assert "markers: the cone by itself pays in 0 of 8 cells; in 0 of these GCO beats" in text
    assert "full pose: the cone by itself pays in 4 of 8 cells; in 2 of these GCO beats" in text
    assert found.worst.startswith("Worst under a weight: MGCO56, 12 poses, 15 um: GCO errs 3.00 times")
    assert "MGCO56: GCO 50 um, least squares 100 um; 2.0 times less." in found.answer
    assert "Joints alone 60 um, 1.2 times as much." in found.answer
    better, _ = made(lambda row: {**gaining(row), "joints_um": 40.0})
    assert "pays in 4 of 8 cells; in all of these joints alone are better." in better.claims[1]


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
    panels = [axes for axes in figures(found)["regimes.png"].axes if axes.images]
    wanted = [(kind, key, name) for kind in KINDS for key in DRAWN for name in STRUCTURES]
    for axes, (kind, key, structure) in zip(panels, wanted, strict=True):
        grids = SETTINGS.grids[kind]
        noise, poses = ([1e6 * sigma for sigma in grids.sigmas], list(grids.poses))
        texts = {t.get_position(): t.get_text() for t in axes.texts}
        marks = {"hatched": set(), "framed": set()}
        for patch in axes.patches:
            centre = tuple(np.rint(np.add(patch.get_xy(), 0.5)).astype(int).tolist())
            marks["hatched" if patch.get_hatch() else "framed"].add(centre)
        for cell in (c for c in found.numbers["cells"][kind] if c.structure == structure):
            at, ratio = (noise.index(cell.sigma_um), poses.index(cell.poses)), cell[key]
            assert axes.images[0].get_array()[at[::-1]] == ratio.median
            assert texts[at] == f"{ratio.median:.2f}"
            assert (at in marks["hatched"]) == (ends_of(ratio)[0] < 1 < ends_of(ratio)[1])
            assert (at in marks["framed"]) == (cell.beats_joints_in > 0.5)
        assert [t.get_text() for t in axes.get_xticklabels()] == [f"{x:g}" for x in noise]
        assert [t.get_text() for t in axes.get_yticklabels()] == [f"{count}" for count in poses]
        assert (unit_in(axes.get_xlabel()), axes.get_ylabel()) == ("um", "poses")
        assert structure in axes.get_title()
    green, brown = (ratio_figure.COLOURS(ratio_figure.SCALE(ratio)) for ratio in (0.2, 5.0))
    assert green[1] > green[0]
    assert brown[0] > brown[1]
