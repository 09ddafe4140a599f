"""The tracker's noise has the stated standard deviation along every axis, and comes from the rng alone."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from testbench.errors import Array, BenchError
from testbench.plant.tracker import (
    IsotropicTracker,
    LaserTracker,
    deflection_precision,
    read_orientations,
    read_positions,
)
from testbench.studies.campaign.noise_sensitivity import drifted

DRAWS = 20_000
ERROR_RATE = 1e-6
"""Chance that a right tracker fails one comparison; the seeds are fixed, so it fails never or always."""


def check_noise(noise: Array, sigma: float):
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


def test_noise_has_sigma_along_and_about_every_world_axis():
    rng = np.random.default_rng(4)
    places, turns = rng.uniform(-3, 3, (DRAWS, 3)), Rotation.random(DRAWS, rng=rng)
    check_noise(read_positions(IsotropicTracker(30e-6), places, rng) - places, 30e-6)
    read = Rotation.from_rotvec(read_orientations(IsotropicTracker(1e-5, 1e-4), turns.as_matrix(), rng))
    check_noise((read * turns.inv()).as_rotvec(), 1e-4)  # world axes: reading = error * truth
    exact = IsotropicTracker(0.0, 0.0)
    np.testing.assert_array_equal(read_positions(exact, places, rng), places)
    read = Rotation.from_rotvec(read_orientations(exact, turns.as_matrix(), rng))
    np.testing.assert_allclose((read * turns.inv()).magnitude(), 0, atol=1e-14)  # rounding


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: IsotropicTracker(-1e-6), "sigma: expected a finite number of at least 0, got -1e-06"),
        (lambda: IsotropicTracker(np.inf), "sigma: expected a finite number of at least 0, got inf"),
        (lambda: IsotropicTracker(1e-5, -1.0), "sigma_rotation: expected a finite number .* got -1"),
        (
            lambda: read_orientations(IsotropicTracker(1e-5), np.eye(3)[None], np.random.default_rng(12)),
            "expected a sigma_rotation to read orientations, got None",
        ),
    ],
)
def test_what_no_tracker_can_be_is_refused(wrong, said):
    with pytest.raises(BenchError, match=said):
        wrong()


STATION = (4.0, -3.0, 1.5)
TARGET = np.array([1.0, 1.0, 1.5])
BEAM = (TARGET - STATION) / 5.0


def test_laser_tracker_is_sharp_along_the_beam_and_blunt_across():
    C = LaserTracker(STATION, mpe_fraction=1.0).covariance(TARGET)
    across = np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(BEAM @ C @ BEAM, (10e-6 + 5 * 0.3e-6) ** 2)
    np.testing.assert_allclose(across @ C @ across, (15e-6 + 5 * 6e-6) ** 2)
    np.testing.assert_allclose(np.linalg.eigvalsh(C), [11.5e-6**2, 45e-6**2, 45e-6**2])
    np.testing.assert_allclose(LaserTracker(STATION).covariance(TARGET), C / 4)  # half of it


def test_noise_is_the_symmetric_root_of_the_covariance():
    tracker, targets = LaserTracker(STATION), TARGET + np.random.default_rng(7).uniform(-2, 2, (50, 1, 3))
    units = SimpleNamespace(standard_normal=lambda shape: np.broadcast_to(np.eye(3), shape))  # a column each
    root = tracker.noise(np.broadcast_to(targets, (50, 3, 3)), units).swapaxes(-1, -2)
    np.testing.assert_allclose(root, root.swapaxes(-1, -2), atol=1e-20)
    np.testing.assert_allclose(root @ root, tracker.covariance(targets[:, 0]), rtol=1e-12, atol=1e-22)


def test_the_last_digit_of_a_position_does_not_move_its_reading():
    """As another processor would give it: an eigendecomposition as root moved readings by 0.1 mm."""
    true = np.random.default_rng(8).uniform(-3, 3, (500, 3, 3))
    moved = true * (1 + 1e-15 * np.random.default_rng(9).uniform(-1, 1, true.shape))
    assert (moved != true).any()
    one, other = (read_positions(LaserTracker(STATION), p, np.random.default_rng(10)) for p in (true, moved))
    # 3 m times 1e-15 and a digit of rounding; the noise, 1e-4 of the distance, adds 1e-4 of that
    np.testing.assert_allclose(other, one, rtol=0, atol=1e-14)


def test_precision_of_a_deflection_is_the_inverse_of_both_covariances():
    tracker, after = LaserTracker(STATION), TARGET - np.array([0.0, 0.0, 0.005])
    both = tracker.covariance(TARGET) + tracker.covariance(after)
    np.testing.assert_allclose(deflection_precision(tracker, TARGET, after) @ both, np.eye(3), atol=1e-9)


def test_drift_moves_all_targets_of_a_run_as_one_body():
    still = np.random.default_rng(1).uniform(-1, 1, (200, 3, 3))
    moved = drifted(still, STATION, np.random.default_rng(2))
    for a, b in ((0, 1), (1, 2), (0, 2)):
        before = np.linalg.norm(still[:, a] - still[:, b], axis=1)
        after = np.linalg.norm(moved[:, a] - moved[:, b], axis=1)
        np.testing.assert_allclose(after, before, atol=1e-9)  # turned by 5e-6: second order
    # at the station only the shift is left: 20 um a component, +-20 % with 600 draws
    there = drifted(np.tile(STATION, (200, 1, 1)), STATION, np.random.default_rng(2))
    assert (there - STATION).std() == pytest.approx(20e-6, rel=0.2)
