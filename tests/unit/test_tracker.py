"""The tracker's noise has the stated standard deviation along every axis, and comes from the rng alone."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from testbench.errors import Array, BenchError
from testbench.tracker import Tracker, read_orientations, read_positions

DRAWS = 20_000
ERROR_RATE = 1e-6
"""Chance that a right tracker fails one comparison; the seeds are fixed, so it fails never or always."""


def check_noise(noise: Array, sigma: float) -> None:
    """Zero mean, standard deviation sigma, no correlation between axes: (DRAWS, 3)."""
    n = len(noise)
    # sum of squares / sigma^2 follows chi-square with n degrees of freedom: +-2.5 % in sigma
    low, high = chi2.ppf([ERROR_RATE / 2, 1 - ERROR_RATE / 2], n)
    squares = (noise**2).sum(axis=0) / sigma**2
    assert ((low < squares) & (squares < high)).all()
    # mean and correlation are normal with standard deviation 1 / sqrt(n): 5 of them are 6e-7
    assert (np.abs(noise.mean(axis=0)) < 5 * sigma / np.sqrt(n)).all()
    correlation = np.corrcoef(noise.T)[np.triu_indices(3, 1)]
    assert (np.abs(correlation) < 5 / np.sqrt(n)).all()


@pytest.mark.parametrize("sigma", [1e-6, 30e-6, 1e-2])
def test_position_noise_has_sigma_along_every_axis(sigma: float) -> None:
    rng = np.random.default_rng(4)
    true = rng.uniform(-3, 3, (DRAWS, 3))
    check_noise(read_positions(Tracker(sigma), true, rng) - true, sigma)


def test_every_marker_of_every_run_has_noise_of_its_own() -> None:
    noise = read_positions(Tracker(1.0), np.zeros((5, 3, 3)), np.random.default_rng(5))
    assert noise.shape == (5, 3, 3)
    assert len(np.unique(noise)) == noise.size


def test_orientation_noise_has_sigma_about_every_world_axis() -> None:
    sigma, rng = 1e-4, np.random.default_rng(6)
    true = Rotation.random(DRAWS, rng=rng)
    readings = read_orientations(Tracker(1e-5, sigma), true.as_matrix(), rng)
    error = Rotation.from_rotvec(readings) * true.inv()  # world axes: reading = error * truth
    check_noise(error.as_rotvec(), sigma)


def test_tracker_without_noise_reads_the_truth() -> None:
    rng = np.random.default_rng(7)
    positions, rotations = rng.standard_normal((4, 3, 3)), Rotation.random(4, rng=rng)
    exact = Tracker(0.0, 0.0)
    np.testing.assert_array_equal(read_positions(exact, positions, rng), positions)
    read = Rotation.from_rotvec(read_orientations(exact, rotations.as_matrix(), rng))
    np.testing.assert_allclose((read * rotations.inv()).magnitude(), 0, atol=1e-14)  # rounding


def test_same_rng_gives_the_same_readings_and_another_gives_others() -> None:
    positions, rotations = np.zeros((4, 3, 3)), np.tile(np.eye(3), (4, 1, 1))
    tracker = Tracker(1e-5, 1e-5)

    def readings(seed: int) -> tuple[Array, Array]:
        rng = np.random.default_rng(seed)
        return read_positions(tracker, positions, rng), read_orientations(tracker, rotations, rng)

    for one, again, other in zip(readings(8), readings(8), readings(9), strict=True):
        np.testing.assert_array_equal(one, again)
        assert (one != other).all()


def test_second_reading_has_fresh_noise() -> None:
    rng = np.random.default_rng(10)
    one, two = (read_positions(Tracker(1e-5), np.zeros((4, 3)), rng) for _ in range(2))
    assert (one != two).all()


def test_true_positions_are_left_alone() -> None:
    positions = np.ones((4, 3))
    read_positions(Tracker(1.0), positions, np.random.default_rng(11))
    np.testing.assert_array_equal(positions, 1)


def test_tracker_of_positions_only_refuses_to_read_orientations() -> None:
    with pytest.raises(BenchError, match="expected a sigma_rotation to read orientations, got None"):
        read_orientations(Tracker(1e-5), np.eye(3)[None], np.random.default_rng(12))


@pytest.mark.parametrize("wrong", [-1e-6, np.nan, np.inf])
def test_sigma_must_be_finite_and_not_negative(wrong: float) -> None:
    with pytest.raises(BenchError, match=f"sigma: expected a finite number of at least 0, got {wrong}"):
        Tracker(wrong)
    with pytest.raises(BenchError, match=f"sigma_rotation: expected a finite number .* got {wrong}"):
        Tracker(1e-5, wrong)
