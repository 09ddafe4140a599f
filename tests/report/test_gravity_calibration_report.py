"""What is said and drawn of a calibration is what its trials hold, of trials that are made up."""

from types import SimpleNamespace

import numpy as np
import pytest
from checks import at, tables_of
from made_up import of_one_trial
from page_checks import times_of
from reports import AT, campaign_row, check, check_forest, check_said, table_of

from testbench.campaign.campaign import Scenario, build_cell
from testbench.campaign.evaluation import CampaignRow
from testbench.campaign.models import EQUAL_FIT
from testbench.campaign.rows import ErrorRow
from testbench.identify.evaluate import deflections
from testbench.studies.calibration_scene import calibration_scene, runs_of
from testbench.studies.gravity_calibration.study import figures, report
from testbench.studies.gravity_calibration.trial import Settings, calibrate, results, trials
from testbench.views.colours import look
from testbench.views.markdown import grid

SEEDS = range(1, 4)
ARMS = ("off_10", "off_10", "cast")
#: Error over the workspace and at the check poses by seed; constraint, prior, unknowns.
MODELS = {
    "Joints": (((3.0, 3.0), (3.0, 3.0), (3.0, 3.0)), "none", False, 6),
    "MLS56": (((9.0, 1.5), (5.0, 1.5), (8.0, 9.5)), "none", False, 56),
    EQUAL_FIT: (((9.0, 1.5), (5.0, 1.5), (8.0, 9.5)), "free", False, 56),
    "MGCO56": (((2.0, 1.0), (4.0, 1.0), (6.0, 9.0)), "psd", False, 56),
    "MLS56 + prior": (((1.0, 1.0), (1.0, 1.0), (1.0, 1.0)), "none", True, 56),
    "MGCO56 + prior": (((1.0, 1.0), (1.0, 1.0), (1.0, 1.0)), "psd", True, 56),
    "LS153 + prior": (((1.2, 1.0), (1.2, 2.0), (1.6, 2.0)), "none", True, 153),
    "ALL153 + prior": (((1.5, 1.0), (1.5, 2.0), (2.0, 2.0)), "psd", True, 153),
}


def row(name, k, changes):
    sizes, constraint, prior, unknowns = MODELS[name]
    area, poses = sizes[k]
    rng = np.random.default_rng([k, *map(ord, name)])
    error = {
        part: of_one_trial(ErrorRow, rng, rms_mm=mm)
        for part, mm in (("workspace", area), ("check_true", poses), ("check", 1 / poses))
    }
    own = error | {
        "conservative": constraint == "psd" or name == "Joints",
        "places": AT if k == 0 else None,
        "place_mm": (0.7 * area, 1.2 * area) if k == 0 else None,
        "structure": name.split(" ")[0].split(",")[0],
        "status": "stalled" if (k, name) == (0, "MGCO56") else "solved",
        "held_by_trace_weight": name == "MGCO56",
    }
    own |= {"constraint": constraint, "prior": prior, "parameters": unknowns, "true_arm": ARMS[k]}
    return campaign_row(CampaignRow, rng, name, **own | changes.get(name, {}))


def made(count=3, **changes):
    asked = Settings("kr500_l480", Scenario(arm="kr500_l480"), 50.0)
    trials = table_of(SEEDS[:count], lambda seed: [row(name, seed - 1, changes) for name in MODELS])
    return report(asked, SEEDS[:count], trials)


def test_models_are_compared_seed_by_seed_by_their_true_errors_in_numbers_and_words():
    found = made()
    check(found, ["short"])
    f = found.numbers
    gain = f["gains"].gco_joints  # MGCO56 beside joint stiffness: 3/2, 3/4 and 3/6 of its error
    assert (gain.times.median, gain.won) == (pytest.approx(3 / 4), pytest.approx(1 / 3))
    assert (f["take"], f["recommended"]) == ("ALL153 + prior", "MGCO56 + prior")
    assert f["gains"].joints.times.median == pytest.approx(2.0)
    own = {(r.name, r.true_arm): r.workspace.rms_mm for r in f["by_arm"]}
    assert (own["MGCO56", "off_10"].median, own["MGCO56", "cast"]) == (3.0, 6.0)
    two = ("MLS56", "ALL153 + prior", "Joints", "MLS56 + prior")  # seeds, which cannot tell
    assert f["map"].compared == two
    check_said(
        found,
        "True workspace RMS error: ALL153 + prior 1.500 mm, least squares without prior 8.000 mm; ",
        "Joint stiffness only 3.000 mm, ",
        "Worst trial, seed 3, cast links: ALL153 + prior errs 2.000 mm, joint stiffness only 3.000 mm.",
        "z 1.00 m: ALL153 + prior errs 1.800 mm, joint stiffness only 3.600 mm.",
        "MGCO56 + prior has the fewest unknowns of the conservative models",
        "Without the cone the same unknowns and prior err 1.200 mm (LS153 + prior): ",
        "Without a prior, GCO (MGCO56) errs 4.000 mm, joint stiffness only ",
        "Do not use MGCO56 away from the measured poses",
    )


def test_of_models_alike_the_conservative_one_of_fewest_unknowns_is_recommended():
    same = {"workspace": of_one_trial(ErrorRow, np.random.default_rng(0), rms_mm=0.5)}
    names = ["Joints", "MGCO56", "ALL153 + prior"]
    assert made(**dict.fromkeys(names, same)).numbers["recommended"] == "Joints"
    more = {name: {**same, "parameters": 30, "conservative": True} for name in names}
    assert made(**more).numbers["recommended"] == "MGCO56"  # by construction
    best = made(**{"ALL153 + prior": same})
    assert best.claims[0] == "Take ALL153 + prior: no other conservative model errs less over the workspace."


def test_tables_hold_every_model_but_a_completion_that_exists_in_no_seed():
    found, one = made(), made(1)
    check(one, ["short"])
    assert (" to " in grid(one.tables["models"]), one.numbers["by_arm"]) == (False, [])
    names = sorted(MODELS, key=lambda name: name != found.badge.winner)
    assert [r.name for r in found.tables["models"].rows] == names
    assert [r.name for r in found.tables["short"].rows] == [n for n in names if n != EQUAL_FIT]
    [(head, cells)] = tables_of(grid(found.tables["by_arm"]))
    assert head == ["model", "links 10 % off tubes", "cast links"]
    assert ["MGCO56", "3.000 (2.000 to 4.000)", "6.000"] in cells
    assert ["[0.24]" in grid(found.tables[name]) for name in ("models", "short")] == [True, False]


def test_the_figure_draws_the_numbers_in_the_colour_of_each_model():
    found = made()
    rows = found.tables["short"].rows
    looks = [look(m.structure, m.constraint, m.prior) for m in rows]
    panes = ("workspace.rms_mm", "check_true.rms_mm", "check.rms_mm")
    for axes, path in zip(figures(found)["models.png"].axes, panes, strict=True):
        check_forest(axes, [at(m, path) for m in rows], looks, first=(0, bool(found.winner)))


@pytest.mark.study
def test_arrows_lead_from_where_markers_go_to_where_each_model_has_them_of_stored_rows_alone():
    asked = Settings("kr500_l480", Scenario(arm="kr500_l480", workspace_poses=5), 37.0)
    table = table_of(range(1, 2), lambda seed: trials(asked, [seed])[0])
    found = report(asked, range(1, 2), table)
    true, campaign = calibrate(build_cell("kr500_l480"), asked, 1)
    measured, over = runs_of(true, table)
    np.testing.assert_array_equal(measured.after, campaign.measured.after)
    seen = calibration_scene(
        SimpleNamespace(report=found, first=table, settings=asked), true, asked.scenario, 8
    )
    moved, arrows = times_of(seen.scene.title)
    assert moved == 37.0
    named = {r.model.name: r.estimate for r in results(true, campaign)}
    order = [campaign.truth.run.tolist().index(run) for run in found.numbers["map"].run]
    for group, data, rows in zip(seen.scene.groups, (over, measured), (order, slice(None)), strict=True):
        dots, _, *errors = group.layers
        np.testing.assert_allclose(dots.at, (data.before + moved * data.deflection)[rows], atol=4e-3)
        for layer, name in zip(
            errors, dict.fromkeys((*found.numbers["map"].compared, "Joints")), strict=True
        ):
            off = deflections(true.vjm, named[name], data) - data.deflection
            np.testing.assert_allclose(layer.to - layer.at, arrows * off[rows], atol=1e-6 * arrows)
            assert layer.name == f"error of {name}"
