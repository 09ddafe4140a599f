"""Lilliefors' test: whether residuals come from a normal distribution of any mean and deviation.

The statistic is the largest distance between the distribution of the residuals and the normal one with their
own mean and deviation (Lilliefors 1967). Its distribution under normality has no closed form; it is simulated
with a fixed stream, so that one sample has one p value.
"""

from functools import lru_cache

import numpy as np
from scipy.special import ndtr

from testbench.errors import Array, BenchError, check_array

MIN_RESIDUALS = 5  #: Residuals from which on the test says anything.
NULL_SAMPLES, NULL_SEED = 2000, 1967
"""Normal samples that are simulated, so that p has a standard error of 0.5 points at 5 %, and their seed."""
MAX_NULL_SIZE = 100
"""Size of a simulated sample at most: beyond it `size_factor` leaves nothing that depends on the size."""


def lilliefors(residuals: Array) -> float:
    """Compute the p value of Lilliefors' test, D = max |F_n(x) - Phi((x - mean) / deviation)|.

    Source: H. W. Lilliefors, *On the Kolmogorov-Smirnov test for normality with mean and variance unknown*,
    JASA 62 (1967); factor of the size: M. A. Stephens, JASA 69 (1974).

    Args:
        residuals: The sample, (n,), in any unit.

    Returns:
        Share of normal samples whose D is at least as large [1]: below 0.05 normality is rejected at 5 %.

    Raises:
        BenchError: When the sample is too small, or all of it is one number.
    """
    x = check_array(residuals, (None,), "residuals")
    if len(x) < MIN_RESIDUALS or np.ptp(x) == 0:
        raise BenchError(f"residuals: expected at least {MIN_RESIDUALS} that differ, got {len(x)}")
    n = min(len(x), MAX_NULL_SIZE)
    null, own = size_factor(n) * _null_distances(n), size_factor(len(x)) * _distance(x[None])
    # the sample itself counts as one of the simulated ones, so that p is never zero
    return float((1 + (null >= own).sum()) / (1 + NULL_SAMPLES))


def size_factor(n: int) -> float:
    """Return the factor that makes D of n residuals comparable to that of other sizes.

    Args:
        n: Number of residuals.

    Returns:
        The factor [1].
    """
    return float(np.sqrt(n) - 0.01 + 0.85 / np.sqrt(n))


@lru_cache(maxsize=4)
def _null_distances(n: int) -> Array:
    """Simulate D of normal samples of a size, (NULL_SAMPLES,)."""
    return _distance(np.random.default_rng(NULL_SEED).standard_normal((NULL_SAMPLES, n)))


def _distance(samples: Array) -> Array:
    """Compute D of every sample, (k, n) -> (k,)."""
    centred = samples - samples.mean(axis=1, keepdims=True)
    normal = ndtr(np.sort(centred, axis=1) / samples.std(axis=1, ddof=1, keepdims=True))
    n = samples.shape[1]
    above, below = np.arange(1, n + 1) / n - normal, normal - np.arange(n) / n
    return np.asarray(np.maximum(above, below).max(axis=1))
