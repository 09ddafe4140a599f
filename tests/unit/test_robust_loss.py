"""The robust loss: what a reading pulls, and the scatter beside sound and wild ones."""

import numpy as np
import pytest
from scipy.stats import chi2

from testbench.identify.registration import FRAME_LOSS, PAIR_LOSS, READING_LOSS

LOSSES = pytest.mark.parametrize("loss", [PAIR_LOSS, FRAME_LOSS, READING_LOSS])


@LOSSES
def test_a_reading_pulls_in_full_up_to_the_bend_and_no_harder_beyond(loss):
    length = loss.threshold * np.array([0.0, 0.5, 1.0, 2.0, 1e6])
    np.testing.assert_allclose(loss.weight(length) * length, loss.threshold * np.array([0, 0.5, 1, 1, 1]))


@LOSSES
def test_the_mean_square_is_that_of_normal_readings(loss):
    b = loss.threshold**2
    assert loss.normal_mean_square == pytest.approx(3 * chi2.cdf(b, 5) + b * chi2.sf(b, 3), abs=1e-3)


@LOSSES
def test_a_scatter_beside_the_readings_is_found_though_some_are_wild(loss, rng):
    """Axes of one reading may differ."""
    variance = np.square([1e-5, 1e-4, 3e-4]) * rng.uniform(0.5, 2, (20_000, 1))
    sound = rng.standard_normal(variance.shape) * np.sqrt(variance + 2e-4**2)
    assert loss.extra_noise(sound, variance, 1.0) == pytest.approx(2e-4, rel=0.02)
    wild = sound.copy()
    wild[:200] += 1.0
    assert loss.extra_noise(wild, variance, 1.0) == pytest.approx(2e-4, rel=0.06)
    assert loss.extra_noise(0.5 * rng.standard_normal(variance.shape) * np.sqrt(variance), variance, 1.0) == 0
    assert loss.extra_noise(np.zeros((0, 3)), np.zeros((0, 3)), 1.0) == 0
