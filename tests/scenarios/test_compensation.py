"""The study of compensation: a quick run, and what its jobs, loads and corrections are."""

import json
from contextlib import ExitStack
from dataclasses import replace
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest
from pyarrow import parquet
from run_here import app_of_study, check_files, check_refused, here

from testbench.campaign.campaign import build_cell, stream
from testbench.campaign.model_selection import Choice, with_priors
from testbench.campaign.models import named_models
from testbench.correct.arm_model import of_estimate
from testbench.correct.process import tangents
from testbench.model.load import on_joints
from testbench.model.vjm import chain, tool_pose
from testbench.model.weights import read_weights
from testbench.plant import TYPICAL, disturb
from testbench.studies.compensation import jobs, plans, settings, trial
from testbench.studies.compensation.settings import (
    ARMS,
    BOTH,
    DEFAULT,
    DRILLING,
    IDEAL,
    MILLING,
    PERFECT,
    REAL,
    PlanRow,
    Scene,
    Way,
)
from testbench.studies.compensation.trial import exactly_loaded, measure, true_arm

APP = app_of_study("compensation")
CANDIDATES = 14
STUDY = "testbench.studies.compensation"


def first_poses(spec, _criterion, q, *_):
    """A plan that is ready at once: planning is tested elsewhere."""
    return SimpleNamespace(q=q[: spec.poses], load=np.arange(spec.poses) % len(spec.loads))


def undisputed(cell, data, prior):
    """The default without rivals: that these are beaten is tested elsewhere."""
    [model] = with_priors(named_models(cell, ["ALL153"]), prior)
    return Choice(model.name, model.estimator(cell.vjm, model.structure, data), "")


@pytest.fixture(scope="module")
def cell():
    return build_cell("kr500_l480")


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    out = tmp_path_factory.mktemp("quick")
    less = {
        "settings.QUICK_CANDIDATES": CANDIDATES,
        "plans.make_plan": first_poses,
        "trial.choose": undisputed,
        "jobs.HOLES": (3, 2),
        "jobs.STEPS": 16,
    }
    with ExitStack() as stack:
        for name, own in less.items():
            stack.enter_context(mock.patch(f"{STUDY}.{name}", own))
        done = here(APP, "--seed", 4, "--seeds", 1, "--out", out, "--quick", "--workers", 1)
    assert done.returncode == 0, done.stderr
    return out, done


@pytest.fixture(scope="module")
def rows(quick):
    return parquet.read_table(quick[0] / "trials.parquet").to_pylist()


@pytest.fixture(scope="module")
def work(cell):
    """The jobs of a trial."""
    own = [tuple(map(tuple, plans.program(cell, one))) for one in jobs.jobs()]
    scene = Scene(drilling=own[0], milling=own[1])
    return trial.work(settings.Settings("kr500_l480", 4, scene=scene), 4)


def test_a_run_leaves_the_files_of_the_contract_and_says_where(quick):
    check_files(quick, "compensation.png")
    assert (quick[0] / "prepared").is_dir()
    report = json.loads((quick[0] / "report.json").read_text())
    assert report["points"] == {DRILLING: 6, MILLING: 16}


def test_no_pane_of_the_recording_is_blank_on_any_timeline(quick, blank_panes):
    assert blank_panes(quick[0] / "recording.rrd") == []


def test_the_loop_is_exact_where_the_arm_is_as_the_model_and_not_where_it_is_disturbed(rows):
    most = {
        own: max(max(r["after_mm"]) for r in rows if (r["name"], r["arm"]) == (PERFECT, own)) for own in ARMS
    }
    assert most[IDEAL] < 1e-6  # Newton leaves 1e-10 m on both sides
    assert most[REAL] > 0.02


def test_a_pull_from_the_side_is_what_the_default_needs(rows):
    def removed(loads):
        own = [r for r in rows if (r["name"], r["loads"], r["arm"]) == (DEFAULT, loads, IDEAL)]
        shares = [1 - np.array(r["after_mm"]) / np.array(r["before_mm"]) for r in own if r["job"] == MILLING]
        return np.median(shares)

    assert removed(BOTH) > 0.95 > removed(settings.WEIGHT)


def test_a_hung_weight_never_loads_joint_1_and_the_pull_does(cell):
    q = stream(3).uniform(*cell.arm.limits, (20, 6))
    first = cell.arm.n_theta - 6
    for load, loaded in zip(plans.loads(cell), (False, True), strict=True):
        torque = on_joints(chain(cell.vjm, q), [load.over(20)])[first]
        assert (np.abs(torque) > 1e-6 * np.abs(load.wrench).max()).any() == loaded


def test_forces_resist_the_feed_and_the_spindle_and_keep_their_size(cell, work):
    for job, part, size in zip(jobs.jobs(), work.parts, work.sizes, strict=True):
        force = work.load.wrench[part, :3]
        # a chord of the curved panel is not quite at right angles to the spindle
        assert np.linalg.norm(force, axis=1) == pytest.approx(size, rel=5e-3)
        assert 1e3 < size < 3e3
        assert ((force * job.axis).sum(axis=1) < -0.1 * size).all()
        feed = tangents(job.position, np.ones(len(force), dtype=bool))
        if job.name == MILLING:
            assert ((force * feed).sum(axis=1) < -0.1 * size).all()
        position, rotation = tool_pose(cell.vjm, work.q[part])
        assert np.allclose(position + rotation @ jobs.TIP, job.position, atol=1e-8)
        assert np.allclose(rotation[:, :, 0], job.axis, atol=1e-8)


def test_a_model_that_buckles_under_the_process_commands_what_was_programmed(cell, work):
    asked = settings.Settings("kr500_l480", 4, (12,), 12, scene())
    way = Way(settings.PLANNED, BOTH, 12)
    [data] = measure(cell, true_arm(cell, 4, IDEAL), asked, [way], 4)
    estimate = undisputed(cell, data, trial.prior_in_turn(cell, 4)).estimate
    weights = read_weights(cell.arm)
    sound = of_estimate(cell.vjm, estimate, weights)
    soft = of_estimate(cell.vjm, replace(estimate, C_theta=1e5 * estimate.C_theta), weights)
    moved, still = (trial.order(trial.Fit(way, DEFAULT, m), work) for m in (sound, soft))
    assert moved.solved.all()
    assert np.abs(moved.q - work.q).max() > 1e-4
    assert not still.solved.any()
    assert np.array_equal(still.q, work.q)
    assert still.half is None
    assert (moved.buckled, still.buckled) == (False, True)


def scene():
    """Poses that need no search."""
    q = np.array(plans.START) + 0.3 * stream(6).uniform(-1, 1, (12, 6))
    plan = PlanRow(BOTH, 12, tuple(q.ravel().tolist()), tuple(range(2)) * 6)
    return Scene(candidates=tuple(map(tuple, q.tolist())), plans=(plan,))


def test_a_payload_weighed_wrongly_spoils_the_campaign_and_not_the_work(cell):
    found = disturb(cell.plant, TYPICAL, stream(4, 20))
    exact = exactly_loaded(found)
    assert found.disturbances.mass_error
    assert found.centre.any()
    assert not exact.disturbances.mass_error
    assert not exact.centre.any()
    assert replace(exact.disturbances, mass_error=2e-3, centre_error=2e-3) == TYPICAL


def test_another_arm_is_refused(tmp_path):
    check_refused(APP, tmp_path / "out", ["--arm", "ur10"], "expected kr500_l480")
