"""The study of the default method as a stranger runs it: its files, its contract, its claims."""

from dataclasses import replace
from itertools import product
from unittest import mock

import numpy as np
import pytest
from run_here import app_of_study, check_files, quick_study

from testbench.identify.prior import cad_prior
from testbench.plant.true_arms import FAMILY_TRUE_ARMS
from testbench.studies.campaign import which_model
from testbench.studies.campaign.trial import cover, covers
from testbench.studies.campaign.which_model import POSES, RUNS, FamilySettings, pairs, read, scenario
from testbench.workflows.campaign import draw_poses, simulate_at, true_cell
from testbench.workflows.models import PRIORS, choose_model, prior_of, wrong_link

LINKS = [f"link_{k}" for k in range(7)]
JOINTS = [f"joint_{k}" for k in range(1, 7)]
APP = app_of_study("which_model")
SEEDS = range(2, 3)
METHODS = 14  # one is the default
FEW = (8, 12)  #: Of the numbers of poses.
quick, report, rows = quick_study(
    APP, "--seed", 2, "--seeds", len(SEEDS), less=lambda: mock.patch.object(which_model, "POSES", FEW)
)


def test_a_run_leaves_the_files_of_the_contract_and_says_where(quick):
    check_files(quick, "which_model.png")


def test_over_as_many_trials_as_priors_every_truth_meets_every_prior_once():
    for first in (0, 1000, 1003):
        met = [pair for seed in range(first, first + len(PRIORS)) for pair in pairs(seed)]
        assert sorted(met) == sorted(product(FAMILY_TRUE_ARMS, PRIORS))
    assert all([truth for truth, _ in pairs(seed)] == list(FAMILY_TRUE_ARMS) for seed in range(6))


def test_every_method_is_tried_in_every_case(rows):
    assert len(rows) == len(SEEDS) * len(FAMILY_TRUE_ARMS) * len(FEW) * METHODS
    cases = {(r["seed"], r["true_arm"], r["prior_error"]) for r in rows}
    assert cases == {(seed, *pair) for seed in SEEDS for pair in pairs(seed)}
    assert all(r["solved"] and r["conservative"] for r in rows if r["constraint"] == "psd")
    assert {r["prior"] for r in rows if r["name"].endswith(" + prior")} == {True}


def test_the_default_is_what_it_chose_with_its_intervals_and_its_doubts(rows):
    by = {(r["seed"], r["true_arm"], r["poses"], r["name"]): r for r in rows}
    chosen = [r for r in rows if r["name"] == "default"]
    assert len(chosen) == len(SEEDS) * len(FAMILY_TRUE_ARMS) * len(FEW)
    for own in chosen:
        fixed = by[own["seed"], own["true_arm"], own["poses"], own["chosen"]]
        same = ("rms_um", "p95_um", "cover.covered_percent", "cover.half_mm")
        for key in same:
            assert own[key] == pytest.approx(fixed[key], rel=1e-6)  # the same program, solved by itself
        assert (own["doubted.unchecked"] is None) == (own["prior_error"] != "link")
        assert set(own["doubted.contradicted"]) <= {*LINKS, *JOINTS, "joints"}
    assert all(r["chosen"] is None and r["doubted.contradicted"] is None for r in rows if r not in chosen)


def test_half_widths_cover_what_they_are_made_for(rng):
    """Of a known distribution: quantiles of errors by the book, and of half widths that are wrong."""
    error = rng.standard_normal((200, 3, 3)) * 1e-3
    true = rng.standard_normal(error.shape)
    right = covers(true + error, np.full(error.shape, 1.96e-3), true)
    assert right.covered_percent == pytest.approx(95, abs=2)  # 1800 components: four standard errors
    assert right.ideal_mm == pytest.approx(np.quantile(np.abs(error), 0.95) * 1e3)
    assert right.half_mm == pytest.approx(1.96)
    assert covers(true + error, np.full(error.shape, 0.674e-3), true).covered_percent == pytest.approx(
        50, abs=5
    )


def test_intervals_are_judged_against_the_truth_component_by_component(kr500):
    """Columns of the truth that are exchanged, or moved by ten half widths, are not covered."""
    asked = FamilySettings("kr500_l480", 2, workspace=40)
    campaign = simulate_at(kr500, scenario(asked), 2, draw_poses(kr500, scenario(asked), 2))
    _, estimate = choose_model(kr500, read(campaign)[-1], cad_prior(kr500.arm))
    right, truth = cover(kr500, estimate, campaign.truth), campaign.truth
    assert right.covered_percent > 90
    exchanged = replace(truth, before=truth.before[..., [2, 1, 0]], after=truth.after[..., [2, 1, 0]])
    assert cover(kr500, estimate, exchanged).covered_percent < 60
    moved = replace(truth, after=truth.after + 10e-3 * right.half_mm)
    assert cover(kr500, estimate, moved).covered_percent < 5


def test_the_wrong_link_is_the_one_that_the_prior_has_wrong(kr500, rows):
    for seed in range(20):
        own, base = (prior_of(kr500, name, seed).C_theta for name in ("link", "scaled"))
        assert set(np.argwhere(own != base)[:, 0] // 6) == {wrong_link(kr500, seed)}
    for row in rows:
        if row["prior_error"] == "link":
            assert row["wrong"] == LINKS[wrong_link(kr500, row["seed"])]
            assert 0 < row["link_share"] < 1
        else:
            assert row["wrong"] == ("joints" if row["prior_error"] == "joints" else None)
            assert row["link_share"] is None


def test_fewer_poses_are_the_first_of_the_same_readings(kr500):
    asked = FamilySettings("kr500_l480", 2, workspace=1)
    poses = draw_poses(kr500, scenario(asked), 2)
    campaign = simulate_at(true_cell(kr500, "cast", 2), scenario(asked), 2, poses)
    data = read(campaign)
    for own, count in zip(data, POSES, strict=True):
        assert own.n_runs == RUNS * count
        assert set(own.pose_id) == set(range(1, count + 1))
        np.testing.assert_array_equal(own.after, data[-1].after[: own.n_runs])
    assert not set(campaign.check.pose_id) & set(data[-1].pose_id)
    noise = data[-1].deflection - campaign.identification.deflection
    assert np.std(noise) == pytest.approx(np.sqrt(2) * 50e-6, rel=0.1)  # 360 components: 4 % standard error
    assert campaign.truth.sigma == asked.sigma
