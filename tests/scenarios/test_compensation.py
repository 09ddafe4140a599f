"""The study of compensation: a quick run, and what its jobs, loads and corrections are."""

from contextlib import ExitStack, contextmanager
from dataclasses import replace
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest
from run_here import app_of_study, check_files, quick_study

from testbench.correct.predicted import path_tangents
from testbench.files.read_pairs import read_csv
from testbench.identify.posterior import model_of_estimate
from testbench.model.load import read_body_masses, sum_generalised_loads
from testbench.model.vjm import evaluate_chain, tool_poses
from testbench.plant.disturbance import TYPICAL_DISTURBANCES
from testbench.plant.true_arms import disturb
from testbench.runs.rows import trial_rng
from testbench.studies import compensation, panel
from testbench.studies.compensation import ADVISED, BOTH, DEFAULT, IDEAL, PERFECT, REAL
from testbench.workflows.cell import build_cell
from testbench.workflows.models import named_models, with_priors

APP = app_of_study("compensation")


def first_poses(spec, _criterion, q, *_):
    """A plan that is ready at once: planning is tested elsewhere."""
    load_index = np.arange(spec.n_poses) % len(spec.loads)
    return SimpleNamespace(q=q[: spec.n_poses], load_index=load_index)


def undisputed(cell, data, prior):
    """The default without rivals: that these are beaten is tested elsewhere."""
    [model] = with_priors(cell.arm, named_models(cell, ["ALL153"]), prior)
    return model.name, model.estimator(cell.vjm, model.structure, data)


LESS = {
    "compensation.QUICK_CANDIDATES": 14,
    "compensation.make_plan": first_poses,
    "compensation.choose_model": undisputed,
    "panel.HOLES": (3, 2),
    "panel.STEPS": 16,
}


@contextmanager
def less_work():
    """The study with fewer points, and without what other tests ask."""
    with ExitStack() as stack:
        for name, own in LESS.items():
            stack.enter_context(mock.patch(f"testbench.studies.{name}", own))
        yield


@pytest.fixture(scope="module")
def cell():
    return build_cell("kr500_l480")


quick, report, rows = quick_study(APP, "--seed", 4, "--seeds", 1, less=less_work)


@pytest.fixture(scope="module")
def asked(cell):
    """The program, and poses that need no search."""
    q = np.array(panel.START) + 0.3 * trial_rng(6).uniform(-1, 1, (12, 6))
    plan = compensation.CompensationPlanRow(BOTH, 12, tuple(q.ravel().tolist()), tuple(range(2)) * 6)
    program = [tuple(own) for job in panel.jobs() for own in panel.program(cell, job)]
    scene = compensation.CompensationScene(
        candidates=tuple(map(tuple, q)), program=tuple(program), plans=(plan,)
    )
    return compensation.CompensationSettings("kr500_l480", 4, (12,), 12, scene)


def test_a_run_leaves_the_files_of_the_contract_and_says_where(quick, report, blank_panes, cell):
    check_files(quick, "compensation.png")
    assert (quick[0] / "prepared").is_dir()
    assert report["points"] == {"drilling": 6, "milling": 16}
    assert blank_panes(quick[0] / "recording.rrd") == []
    page = (quick[0] / "report.html").read_text(encoding="utf-8")
    assert "off at each point, arm undisturbed (mm)" in page  # the answer is of the disturbed one
    data = read_csv(quick[0] / "dataset.csv", cell.arm)
    assert (data.n_runs, set(data.wrench[:, 1])) == (24, {0.0, 3000.0})


def left(rows, name, arm, loads):
    """Shares of the deflection that are left, point by point."""
    own = next(r for r in rows if (r["name"], r["arm"], r["loads"]) == (name, arm, loads))
    return np.array(own["after_mm"]) / own["before_mm"]


def test_the_loop_is_exact_where_the_arm_is_as_the_model_and_not_where_it_is_disturbed(rows):
    assert left(rows, PERFECT, IDEAL, "").max() < 1e-6  # Newton leaves 1e-10 m on both sides
    assert left(rows, PERFECT, REAL, "").max() > 0.02


def test_a_pull_from_the_side_is_what_the_default_needs(rows):
    milled = [np.median(left(rows, DEFAULT, IDEAL, loads)[6:]) for loads in (BOTH, compensation.WEIGHT)]
    assert milled[0] < 0.05 < milled[1]


def test_a_hung_weight_never_loads_joint_1_and_the_pull_does(cell):
    q = trial_rng(3).uniform(*cell.arm.limits, (20, 6))
    first = cell.arm.n_theta - 6
    for load, loaded in zip(compensation.loads(cell), (False, True), strict=True):
        torque = sum_generalised_loads(evaluate_chain(cell.vjm, q), [load.for_poses(20)])[first]
        assert (np.abs(torque) > 1e-6 * np.abs(load.wrench).max()).any() == loaded


def test_forces_resist_the_feed_and_the_spindle_and_keep_their_size(cell, asked):
    work, drilled = compensation.tasks_of(asked, 4), len(panel.jobs()[0].position)
    for job, part in zip(panel.jobs(), (slice(drilled), slice(drilled, None)), strict=True):
        force = work.load.wrench[part, :3]
        size = np.linalg.norm(force, axis=1)
        assert size == pytest.approx(size[0], rel=5e-3)  # a chord is not quite at right angles to the spindle
        assert 1e3 < size[0] < 3e3
        assert ((force * job.axis).sum(axis=1) < -0.1 * size).all()
        feed = path_tangents(job.position, np.ones(len(force), dtype=bool))
        if job.name == panel.MILLING:
            assert ((force * feed).sum(axis=1) < -0.1 * size).all()
        position, rotation = tool_poses(cell.vjm, work.q[part])
        assert np.allclose(position + rotation @ panel.TIP, job.position, atol=1e-8)
        assert np.allclose(rotation[:, :, 0], job.axis, atol=1e-8)


def test_a_model_that_buckles_under_the_process_commands_what_was_programmed(cell, asked):
    work, (settle, _) = compensation.tasks_of(asked, 4), compensation.true_arm(cell, 4, IDEAL)
    [data] = compensation.measure(cell, settle, asked, [ADVISED], 4)
    _, estimate = undisputed(cell, data, compensation.prior_in_turn(cell, 4))
    weights = read_body_masses(cell.arm)
    sound = model_of_estimate(cell.vjm, estimate, weights)
    soft = model_of_estimate(cell.vjm, replace(estimate, C_theta=1e5 * estimate.C_theta), weights)
    moved, still = (
        compensation.order(compensation.CorrectionModel(ADVISED, DEFAULT, m), work) for m in (sound, soft)
    )
    assert moved.corrected.all()
    assert np.abs(moved.q - work.q).max() > 1e-4
    assert still is None
    before, after, same = compensation.execute(settle, work, [moved, still])
    np.testing.assert_array_equal(before, same)
    row = compensation.row_of(compensation.CorrectionModel(ADVISED, DEFAULT, sound), still, before, same)
    assert (row.buckled, row.of, row.before_mm) == (True, 0, row.after_mm)
    assert np.linalg.norm(after) < 0.1 * np.linalg.norm(before)


def test_a_payload_weighed_wrongly_spoils_the_campaign_and_not_the_work(cell):
    found = disturb(cell.plant, TYPICAL_DISTURBANCES, trial_rng(4, 20))
    exact = compensation.with_exact_load(found)
    assert (
        found.disturbances
        == TYPICAL_DISTURBANCES
        == replace(exact.disturbances, mass_error=2e-3, load_point_sigma=2e-3)
    )
    assert found.load_point_error.any()
    assert (exact.disturbances.mass_error, np.abs(exact.load_point_error).max()) == (0, 0)
