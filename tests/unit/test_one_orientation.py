"""Series in which the tool keeps its orientation: frame and mount cannot be told apart, and need not be."""

from dataclasses import replace

import numpy as np
import pytest

from testbench.correct.compensated import solve_inverse_kinematics
from testbench.correct.newton import Target
from testbench.data.dataset import select_rows
from testbench.errors import BenchError
from testbench.identify.absolute.align import align_all, fit_upright_frame, residuals, undetermined_frames
from testbench.identify.absolute.fit import CalibrationOptions
from testbench.identify.absolute.state import nominal_state
from testbench.model.load import read_body_masses
from testbench.model.vjm import tool_poses
from testbench.workflows.absolute import calibrate_with_masses, position_errors
from testbench.workflows.absolute_campaign import AbsoluteCampaign, simulate_series

HOME = (0.3, -1.4, 1.6, 0.4, 0.5, 0.2)
SPRINGS = CalibrationOptions(used_errors=frozenset({"joint springs"}), max_order=1)
POSES = 40


def constant(cell, kind, seed):
    """Poses on a line, a curve or a surface, the tool as it is in the first."""
    s, t = np.random.default_rng(seed).uniform(-1, 1, (2, POSES))
    ways = {"line": (0 * s, s, 0 * s), "curve": (np.cos(2 * s) - 0.5, np.sin(2 * s), 0.2 * s)}
    way = np.column_stack(ways.get(kind, (0.2 * s, s, t)))
    home = np.array([HOME])
    position, rotation = tool_poses(cell.vjm, home)
    at = Target(position + 0.12 * cell.vjm.reach * way, np.repeat(rotation, POSES, axis=0))
    found = solve_inverse_kinematics(cell.vjm, at, np.repeat(home, POSES, axis=0))
    assert found.converged.all()
    return found.q


def rms(state, series):
    """Root mean square distance of readings [mm]."""
    left = np.linalg.norm(residuals(state, series)[: len(series.markers)], axis=1)
    return 1e3 * float(np.sqrt((left**2).mean()))


@pytest.mark.parametrize(
    ("kind", "targets", "open_"),
    [
        ("line", 1, {"frame tracker 1", "mount mount 1"}),
        pytest.param("surface", 3, {"mount mount 1"}, marks=pytest.mark.study),
        pytest.param("curve", 1, {"mount mount 1"}, marks=pytest.mark.study),
    ],
)
def test_a_series_of_one_orientation_foretells_others_of_it(kr500, kind, targets, open_):
    """In its own frame and in a new one, nearer than the arm as drawn in its best frame; intervals hold."""
    campaign = AbsoluteCampaign(poses=POSES, targets=targets)
    (fit,), (fresh,) = (simulate_series(kr500, campaign, 4, constant(kr500, kind, k))[0] for k in (1, 2))
    assert undetermined_frames(kr500.vjm, (fit,)) == open_
    found = calibrate_with_masses(kr500.vjm, (fit,), SPRINGS)
    assert not found.calibration.issues  # nothing moved
    assert any(
        "of the frame cannot be separated: a prior holds the targets where the" in note
        for note in found.notes
    )
    assert any("a turn of its frame" in note for note in found.notes) == (len(open_) == 2)
    drawn = rms(align_all(nominal_state(kr500.vjm, read_body_masses(kr500.arm), np.ones(6)), (fit,)), fresh)
    model = found.calibration.model()
    again, new = (
        position_errors(model, [one], poses)
        for one, poses in ((fresh, None), (replace(fresh, frame="new", mount="new"), 20))
    )
    assert again.rms_mm < drawn
    assert new.rms_mm < drawn
    assert min(again.coverage_95, new.coverage_95) > 0.85


def test_another_series_of_the_target_tells_what_one_orientation_leaves_open(kr500):
    """Whatever their order; the target then lies where it was truly mounted, not where a prior has it."""
    campaign = AbsoluteCampaign(poses=POSES, series=2, share_target=True)
    (_, rich), truth = simulate_series(kr500, campaign, 6)
    (line, _), _ = simulate_series(kr500, campaign, 6, constant(kr500, "surface", 1))
    assert undetermined_frames(kr500.vjm, (line,)) == {"mount mount 1"}
    assert not undetermined_frames(kr500.vjm, (line, rich))
    found = calibrate_with_masses(kr500.vjm, (line, rich), SPRINGS)
    assert any("another series with the same target or frame determines it" in note for note in found.notes)
    true = truth.mounts[0].position + truth.mounts[0].rotation @ truth.markers[0]
    off = found.calibration.state.mounts["mount 1"].points[0] - true
    assert np.linalg.norm(off) < 3e-3


def test_a_wrong_joint_in_a_series_of_one_orientation_gets_no_target_metres_away(kr500):
    """With the sign of joint 5 the other way a target 30 m off would fit best: that is no target."""
    (one,), _ = simulate_series(kr500, AbsoluteCampaign(poses=POSES), 4, constant(kr500, "surface", 1))
    flipped = replace(one, q=one.q * np.where(np.arange(6) == 4, -1, 1))
    try:
        state = align_all(nominal_state(kr500.vjm, read_body_masses(kr500.arm), np.ones(6)), (flipped,))
    except BenchError:
        return
    assert np.abs(state.mounts[one.mount].points).max() < kr500.vjm.reach


def test_a_frame_is_upright_where_readings_on_a_line_tell_no_turn(rng):
    """By any heading; with points that span space it is the rotation that they have."""
    line = np.outer(rng.uniform(-1, 1, 20), (1.0, 0.0, 0.0))
    heading = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(fit_upright_frame(line, line @ heading.T).rotation, heading, atol=1e-12)
    tilted = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    tilted *= np.linalg.det(tilted)
    points = rng.standard_normal((20, 3))
    np.testing.assert_allclose(fit_upright_frame(points, points @ tilted.T + 1).rotation, tilted, atol=1e-3)


def test_sound_series_leave_nothing_open(kr500, ur10):
    """A few random poses of one target tell frame and mount."""
    for cell in (kr500, ur10):
        (one,), _ = simulate_series(cell, AbsoluteCampaign(poses=9), 2)
        assert not undetermined_frames(cell.vjm, (one,))
        assert not undetermined_frames(cell.vjm, (select_rows(one, np.arange(7)),))
