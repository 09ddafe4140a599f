"""How good a model is: errors of predicted deflections, and whether residuals look like noise."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from testbench.dataset import Dataset
from testbench.errors import Array
from testbench.identify.estimate import Estimate
from testbench.identify.regression import marker_points
from testbench.vjm import Vjm, observation

LILLIEFORS_SAMPLES = 999


@dataclass(frozen=True)
class Score:
    """Distance errors of predicted deflections over a set of runs.

    Attributes:
        rms: Root mean square of the distance error over all points [m].
        p95: 95th percentile [m].
        max: Largest [m].
        max_relative: Largest error as a share of the measured deflection of its point [1].
    """

    rms: float
    p95: float
    max: float
    max_relative: float


@dataclass(frozen=True)
class Normality:
    """Whether residual components look like draws of one normal distribution.

    Attributes:
        mean: Mean of the components [m].
        std: Standard deviation [m].
        p_value: Of the Lilliefors test; below 0.05 normality is rejected [1].
    """

    mean: float
    std: float
    p_value: float


def predict(vjm: Vjm, estimate: Estimate, data: Dataset) -> Array:
    """Deflections of a dataset's markers by a model, Eq. (11), (runs, m, 3) [m].

    Args:
        vjm: The model's kinematics.
        estimate: The identified compliances.
        data: Gives poses, loads and markers; its readings are not used.
    """
    A = observation(
        vjm,
        estimate.structure,
        data.q,
        data.wrench,
        data.point,
        targets=marker_points(vjm, data.markers),
    )
    return np.asarray(A @ estimate.pi)


def score(predicted: Array, reference: Array) -> Score:
    """Distance errors of predictions against measured (or true) deflections.

    Args:
        predicted: (runs, m, 3) [m].
        reference: (runs, m, 3) [m].
    """
    error = np.linalg.norm(predicted - reference, axis=-1).ravel()
    size = np.linalg.norm(reference, axis=-1).ravel()
    return Score(
        rms=float(np.sqrt(np.mean(error**2))),
        p95=float(np.percentile(error, 95)),
        max=float(error.max()),
        max_relative=float((error / size).max()),
    )


def normality(residuals: Array, rng: np.random.Generator) -> Normality:
    """Lilliefors test of residual components (Lilliefors 1967).

    The Kolmogorov-Smirnov distance to the normal of the sample's own mean and standard deviation; its null
    distribution is simulated.

    Args:
        residuals: Any shape, all components pooled [m].
        rng: Source of the simulated null distribution.
    """
    x = residuals.ravel()
    fit = stats.goodness_of_fit(
        stats.norm, x, statistic="ks", n_mc_samples=LILLIEFORS_SAMPLES, rng=rng
    )
    return Normality(float(x.mean()), float(x.std(ddof=1)), float(fit.pvalue))
