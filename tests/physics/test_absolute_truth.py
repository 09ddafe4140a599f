"""Simulated absolute readings: MuJoCo's true arm against the model's chain, and against itself."""

from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest

from testbench.campaign.absolute_truth import AbsoluteCampaign, simulate_series
from testbench.errors import BenchError
from testbench.model.vjm import chain
from testbench.plant import Disturbances, GeometryErrors, settle_disturbed

EXACT = AbsoluteCampaign(
    poses=12,
    series=2,
    targets=3,
    orientations=True,
    noise=False,
    disturbances=Disturbances(own_weight=True),
)


def seen(truth, series, where):
    """Targets and mount of a chain as a tracker sees them: three frames, one after the other."""
    station, mount = truth.stations[series], truth.mounts[series]
    tool = where.rotation @ mount.rotation
    targets = np.einsum("rxy,my->rmx", where.rotation, truth.markers @ mount.rotation.T + mount.position)
    world = where.position[:, None] + targets
    return world @ station.rotation.T + station.position, station.rotation @ tool


def true_poses(truth, series, *at):
    """The same of the true arm at rest, in poses under loads."""
    rest = settle_disturbed(truth.arm, *at)
    return seen(truth, series, SimpleNamespace(position=rest.tool, rotation=rest.rotation))


def rms(x):
    return np.sqrt((x**2).mean())


def same(one, other):
    return all(
        np.asarray(getattr(one, f.name)).tobytes() == np.asarray(getattr(other, f.name)).tobytes()
        for f in fields(one)
    )


@pytest.mark.parametrize("name", ["kr500", "slides"])
def test_true_geometry_without_weight_is_the_chain_at_theta_0(name, request):
    """Errors of 5 mm and 10 mrad, of joints that slide too: not to first order, but exactly."""
    cell = request.getfixturevalue(name)
    errors = Disturbances(geometry=GeometryErrors(5e-3, 10e-3), sensor_offset=1e-3)
    both, truth = simulate_series(cell, EXACT.model_copy(update={"disturbances": errors}), 3)
    for k, series in enumerate(both):
        where = chain(cell.vjm, series.q, np.tile(truth.theta_0, (series.rows, 1)))
        position, rotation = seen(truth, k, where)
        np.testing.assert_allclose(series.position, position, rtol=0, atol=1e-12)  # rounding of 10 m
        np.testing.assert_allclose(series.rotation, rotation, rtol=0, atol=1e-12)
    assert np.abs(truth.theta_0).max() > 5e-3


def test_readings_come_from_the_seed_and_a_switch_leaves_all_else(kr500):
    asked = EXACT.model_copy(update={"noise": True, "outliers": 0.2, "repeatability": 1e-5})
    (first, second), truth = simulate_series(kr500, asked, 7)
    (again, _), _ = simulate_series(kr500, asked, 7)
    (alone,), _ = simulate_series(kr500, asked.model_copy(update={"series": 1}), 7)
    (other, _), _ = simulate_series(kr500, asked, 8)
    assert same(first, again)
    assert same(first, alone)
    assert not same(first, other)
    assert not np.array_equal(first.q, second.q)
    off = {"noise": False, "outliers": 0.0, "repeatability": 0.0}
    (clean, _), _ = simulate_series(kr500, asked.model_copy(update=off), 7)
    (wild, _), _ = simulate_series(kr500, asked.model_copy(update={**off, "outliers": 0.2}), 7)
    np.testing.assert_array_equal(clean.q, first.q)
    size = np.linalg.norm(wild.position - clean.position, axis=2)
    np.testing.assert_allclose(size, asked.outlier_size * truth.outliers[0], rtol=0, atol=1e-12)


def test_noise_is_as_large_as_the_series_says(kr500):
    asked = EXACT.model_copy(update={"noise": True, "poses": 300, "series": 1, "sigma_rotation": 1e-4})
    (read,), truth = simulate_series(kr500, asked, 3)
    position, rotation = true_poses(truth, 0, read.q)
    assert rms(read.position - position) == pytest.approx(50e-6, rel=0.06)  # 2,700 numbers: 1.4 %
    turn = read.rotation @ rotation.swapaxes(1, 2)
    assert rms(turn[:, [2, 0, 1], [1, 2, 0]]) == pytest.approx(1e-4, rel=0.1)  # 900 numbers: 2.4 %


def test_loads_hang_one_after_the_other_in_the_pose_that_was_approached(kr500):
    """A pair bends as the arm does from where it stands; scatter of the approach is common to it."""
    update = {"masses": (0.0, 460.3), "loaded_poses": 5, "repeatability": 1e-3, "series": 1}
    (pairs,), truth = simulate_series(kr500, EXACT.model_copy(update=update), 3)
    assert pairs.rows == 12 + 5
    assert pairs.pose.tolist() == sorted([*range(1, 13), *range(1, 6)])
    first, loaded = pairs.wrench[:, 2] == 0, pairs.wrench[:, 2] < 0
    assert np.unique(pairs.pose[loaded]).tolist() == [1, 2, 3, 4, 5]
    no_scatter = [
        true_poses(truth, 0, pairs.q[some], pairs.wrench[some], pairs.point[some])[0]
        for some in (first, loaded)
    ]
    moved = pairs.position[loaded] - pairs.position[first][:5]
    expected = no_scatter[1] - no_scatter[0][:5]
    assert rms(pairs.position[first] - no_scatter[0]) > 1e-3
    assert rms(moved - expected) < 5e-3 * rms(expected)  # a milliradian turns a deflection by 1e-3


def test_more_targets_than_markers_are_refused(kr500):
    with pytest.raises(BenchError, match="targets: expected at most 3, as kr500_l480 has P1, P2, P3"):
        simulate_series(kr500, AbsoluteCampaign(targets=4))
    with pytest.raises(BenchError, match="masses: expected different ones"):
        AbsoluteCampaign(masses=(1.0, 1.0))
