"""Registration: frames and targets given back exactly, known as well as is said, or refused."""

from dataclasses import replace

import numpy as np
import pytest
from loads import random_q
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from serial_arms import write_arm

from testbench import BenchError, Dataset, Scenario, build_cell, simulate
from testbench.identify.base_frame import MAX_FRAME_ROTATION_DEVIATION, register_dataset, transform_to_base
from testbench.identify.base_frame import unloaded_series as series_of_stations
from testbench.identify.registration import Frame
from testbench.identify.registration import register as register_series
from testbench.model.vjm import tool_points
from testbench.workflows.read_runs import registration_notes

FINE = 1e-7  #: Noise said of exact readings [m]: nominal positions then pull by less than 1e-11 m.


def register(vjm, data, given=None):
    """Frames and targets of a dataset, expected where the model has its targets."""
    nominal = dict(zip(vjm.arm.markers, vjm.markers, strict=True))
    return register_series(vjm, series_of_stations(data), nominal, given)


@pytest.fixture(scope="module")
def arm_7r(tmp_path_factory):
    return build_cell(write_arm(tmp_path_factory.mktemp("arm") / "arm", "zyzyzyz", mount='euler="0.3 1 2"'))


def frames(rng, stations):
    """A random pose of the base for every station."""
    return Rotation.random(stations, rng=rng).as_matrix(), 5 * rng.standard_normal((stations, 3))


def read(data, R, t):
    """A dataset in base axes as its stations, numbered from 0, read it."""
    k = data.station
    before, after = (np.einsum("rxy,rmy->rmx", R[k], x) + t[k][:, None] for x in (data.before, data.after))
    return replace(data, before=before, after=after)


def unloaded(cell, rng, poses, *, targets=3, stations=1, noise=0.0, joints=None):
    """A model whose targets are nominally off by 20 mm an axis; readings by stations of the true ones."""
    vjm = cell.vjm
    q = random_q(cell, rng, poses)
    if joints is not None:
        q[:, np.setdiff1d(np.arange(q.shape[1]), joints)] = 0.3
    x, ids, zero = tool_points(vjm, q, vjm.markers[:targets]), np.arange(poses), np.zeros((poses, 6))
    x, names = x + noise * rng.standard_normal(x.shape), vjm.arm.markers[:targets]
    data = Dataset(names, ids, ids, q, zero, zero[:, :3], x, x, FINE, station=ids % stations)
    rough = replace(vjm, markers=vjm.markers + 0.02 * rng.standard_normal(vjm.markers.shape))
    return rough, data


@pytest.mark.parametrize("arm", ["kr500", "arm_7r", "slides"])
@pytest.mark.parametrize(
    ("targets", "stations", "named"), [(1, 1, True), (1, 3, False), (2, 3, True), (3, 1, False)]
)
def test_exact_readings_give_back_frames_and_targets(arm, targets, stations, named, request, rng):
    """Six poses a station; targets 20 mm off an axis, or not in the arm's folder at all."""
    cell = request.getfixturevalue(arm)
    vjm, data = unloaded(cell, rng, 6 * stations, targets=targets, stations=stations)
    if not named:
        data = replace(data, markers=("T0", "T1", "T2")[:targets])
    R, t = frames(rng, stations)
    found = register(vjm, read(data, R, t))
    np.testing.assert_allclose(errors(found, cell.vjm, R, t), 0, atol=1e-9)
    back = register_dataset(vjm, read(data, R, t))
    np.testing.assert_allclose(back.data.before, data.before, rtol=0, atol=1e-9)
    for name, target in zip(data.markers, cell.vjm.markers, strict=False):
        at = back.vjm.markers[back.vjm.arm.markers.index(name)]
        np.testing.assert_allclose(at, target, rtol=0, atol=1e-9)


def errors(found, vjm, R, t):
    parts = [
        (Rotation.from_matrix(R[k].T @ frame.rotation).as_rotvec(), frame.translation - t[k])
        for k, frame in enumerate(found.frames.values())
    ]
    return np.r_[np.ravel(parts), (found.targets - vjm.markers[: len(found.targets)]).ravel()]


@pytest.mark.study
def test_covariance_is_that_of_the_errors(kr500):
    """Mean normalised squared error of 60 campaigns, noise of 1 mm that no reading states.

    The band is chi-square's with one chance in 10^6, widened by 2 % for the noise being estimated.
    """
    found = []
    for seed in range(500, 560):
        rng = np.random.default_rng(seed)
        vjm, data = unloaded(kr500, rng, 30, stations=2, noise=1e-3)
        R, t = frames(rng, 2)
        one = register(vjm, read(data, R, t))
        e = errors(one, kr500.vjm, R, t)
        found.append(e @ np.linalg.solve(one.covariance, e))
        assert one.noise == pytest.approx(1e-3, rel=0.3)
    low, high = chi2.ppf([5e-7, 1 - 5e-7], 21 * len(found)) / len(found)
    assert low < np.mean(found) < 1.02 * high


@pytest.mark.parametrize("size", [0.01, 1.0, 100.0])
def test_wild_readings_hardly_move_anything(size, kr500, rng):
    """Every fifth reading off by `size`: errors stay within five of the deviations that are stated."""
    vjm, data = unloaded(kr500, rng, 20, noise=3e-4)
    R, t = frames(rng, 1)
    data = read(data, R, t)
    data.before.reshape(-1, 3)[::5] += size * rng.standard_normal((12, 3))
    found = register(vjm, data)
    e = errors(found, kr500.vjm, R, t)
    assert (np.abs(e) < 5 * np.sqrt(np.diag(found.covariance))).all()
    assert found.n_downweighted >= 11
    assert found.noise < 4e-4


def test_stations_of_lost_or_of_too_few_readings(kr500, rng):
    """The tenth run by a station of its own: all its targets lost, then one of them read."""
    vjm, data = unloaded(kr500, rng, 10)
    data = replace(data, station=np.repeat([1, 2], [9, 1]))
    P = np.tile(np.eye(3) / FINE**2, (10, 3, 1, 1))
    P[9] = 0
    found = register_dataset(vjm, replace(read(data, *frames(rng, 3)), precision=P))
    assert list(found.registration.frames) == ["station 1"]
    np.testing.assert_allclose(found.data.before[:9], data.before[:9], rtol=0, atol=1e-9)
    P[9, 0] = P[0, 0]
    with pytest.raises(BenchError, match="station 2 read 1 targets; expected at least 3"):
        register_dataset(vjm, replace(data, precision=P), "tracker")


def test_frame_that_is_hardly_known_or_open_is_refused_or_the_base(kr500, rng):
    """One pose: three targets 20 mm off tell a rotation to some degrees. One joint leaves a target open."""
    vjm, data = unloaded(kr500, rng, 1)
    (found,) = register(vjm, data).frames.values()
    assert found.rotation_deviation > MAX_FRAME_ROTATION_DEVIATION
    said = r"frame of station 0 is uncertain by \d\.\d deg; expected more poses"
    with pytest.raises(BenchError, match=said):
        register_dataset(vjm, data, "tracker")
    assert register_dataset(vjm, data).frame == "base"
    vjm, data = unloaded(kr500, rng, 20, targets=1, joints=[0], noise=1e-4)
    with pytest.raises(BenchError, match=r"20 poses, in which joint_1 turns, do not determine"):
        register_dataset(vjm, replace(data, markers=("T",)), "tracker")


def test_readings_in_the_bases_frame_stay_as_they_are_and_those_of_another_arm_are_said(kr500, rng):
    data = simulate(kr500, Scenario(arm="kr500_l480", workspace_poses=1), 500).measured
    for choice in ("auto", "base"):
        found = register_dataset(kr500.vjm, data, choice)
        assert (found.frame, found.data, found.vjm) == ("base", data, kr500.vjm)
    vjm, data = unloaded(kr500, rng, 10)
    found = register_dataset(vjm, replace(data, q=data.q[:, ::-1].copy()))
    assert found.data.before is data.before
    assert "the unloaded readings do not fit the arm in any frame" in registration_notes(found)[0]


def test_given_frame_is_taken_and_other_stations_are_found(kr500, rng):
    vjm, data = unloaded(kr500, rng, 12, stations=2, noise=1e-3)
    R, t = frames(rng, 2)
    given = Frame(R[1], t[1])
    found = register_dataset(vjm, read(data, R, t), {"station 1": given}).registration
    np.testing.assert_array_equal(found.frames["station 1"].rotation, R[1])
    assert np.linalg.norm(found.frames["station 0"].translation - t[0]) < 3e-3
    with pytest.raises(BenchError, match="frame of station 7: the readings are of station 0, station 1"):
        register(vjm, data, {"station 7": given})


def test_uncertain_rotation_is_added_to_every_deflection(kr500, rng):
    """Against 20 000 draws of a frame that is off by its covariance; 5 % is six deviations.

    The tracker reads ten times worse across than along, and its axes are not the base's.
    """
    vjm, data = unloaded(kr500, rng, 8)
    data = replace(data, after=data.before + 0.01 * rng.standard_normal(data.before.shape), sigma=1e-5)
    R, t = frames(rng, 1)
    found, y = register(vjm, read(data, R, t)), read(data, R, t)
    axes = np.array([1e-5, 1e-4, 1e-4])
    y = replace(y, precision=np.broadcast_to(np.diag(axes**-2), (*data.before.shape, 3)))
    C = np.zeros((6, 6))
    C[:3, :3] = np.diag([1, 4, 9]) * 1e-6
    got = np.linalg.inv(transform_to_base(replace(found, covariance=C), y).precision[0, 0])
    off = Rotation.from_rotvec(rng.standard_normal((20_000, 3)) * [1e-3, 2e-3, 3e-3])
    drawn = off.apply(data.deflection[0, 0]) + (axes * rng.standard_normal((20_000, 3))) @ R[0]
    np.testing.assert_allclose(got, np.cov(drawn.T), rtol=0, atol=0.05 * got.max())


def test_a_frame_of_something_else_is_as_sure_as_draws_of_the_frame_are_there(rng):
    """Covariance of R exp(phi), t moved to a body far away and turned; against differences of every draw."""
    root = 1e-6 * np.tril(rng.standard_normal((6, 6))) @ np.diag([1, 5, 2, 9, 3, 4])
    frame = Frame(*(own[0] for own in frames(rng, 1)), root @ root.T)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec([1.0, -2.0, 0.5]).as_matrix(), [2.0, -1.0, 3.0]
    there = frame.with_base_at(pose)
    moves = []
    for phi, shift in zip(root.T[:, :3], root.T[:, 3:], strict=True):
        turned = frame.rotation @ Rotation.from_rotvec(phi).as_matrix()
        moved = Frame(turned, frame.translation + shift).with_base_at(pose)
        turn = Rotation.from_matrix(there.rotation.T @ moved.rotation).as_rotvec()
        moves.append(np.r_[turn, moved.translation - there.translation])
    expected = np.array(moves).T @ np.array(moves)
    np.testing.assert_allclose(there.covariance, expected, rtol=0, atol=1e-4 * expected.max())
    np.testing.assert_allclose(there.covariance[:3, :3], expected[:3, :3], rtol=0, atol=1e-16)
