"""Forecast of a plan: the error of predicted deflections to expect after identification, with intervals.

A forecast is linear and normal: the error of a prediction is bias + spread @ N(0, 1). `inflate_intervals`
adds the effect of nonlinear arms and wrong priors.

`linear_fit` forecasts a model that leaves out some elastic links and joints. All unknowns of the arm are
x ~ N(e, u^2 1) in units of the prior from which the arm is drawn. The whitened readings are y = A x + noise.
The fit of a model is affine in them, x_m = K y + k. So its error at the tasks, whose deflections are T x, is
T x - T_m x_m = D x - T_m (K noise + k) with D = T - T_m K A: normal, with known mean and covariance.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from testbench.design.rows import (
    SCALE_UNCERTAINTY,
    DesignProblem,
    MeasurementSetup,
    PlanSpecification,
    deflection_rows,
)
from testbench.display import Displayed, span
from testbench.errors import Array, Mask
from testbench.identify.prior import PriorUncertainty, prior_rows
from testbench.identify.regression import RANK_TOLERANCE
from testbench.model.load import Load

INTERVAL_DRAWS = 4000  #: Number of random draws of the prediction error behind an interval.
POSES_AT_ONCE = 16  #: Number of poses whose draws are computed together.
INTERVAL_INFLATION, DEVIATION_INFLATION = (0.7, 1.25), 1.2
"""Factors on the ends of a 90 % interval and on a standard deviation, for nonlinear arms and wrong priors.

Measured over the family of true arms and wrong priors, every pair twice (seeds 1 to 72; 8, 12 and 20 poses,
planned and random, on two grounds; all links and joints identified with a learnt prior). With these factors
3 % of the RMS errors were below the lower end and 4 % above the upper one; on cast links none and 17 %.
97 % of the errors of a deflection along one axis were within 1.2 times the normal interval of 95 %; on cast
links 92 %.
"""
#: Part of a prediction along unobservable directions, over all of it, of an error without bound [1].
MIN_UNOBSERVABLE_SHARE = 1e-6


@dataclass(frozen=True, repr=False)
class Forecast(Displayed):
    """Hold the expected RMS distances of predicted from true targets, in every pose and over all poses.

    The percentiles are those of the distances that noise and the remaining uncertainty of the prior cause.
    All are infinite in poses whose prediction depends on unobservable directions.
    """

    rms_error: Array  #: RMS distance of a target in every pose, (poses,) [m].
    percentile_5: Array  #: 5th percentile of this distance, (poses,) [m].
    percentile_95: Array  #: 95th percentile of this distance, (poses,) [m].
    axis_deviation: Array  #: RMS error of every target along every axis, (poses, 3 m) [m].
    overall_rms_error: float  #: RMS distance of a target over all poses [m].
    overall_percentile_5: float  #: 5th percentile of the distance over all poses [m].
    overall_percentile_95: float  #: 95th percentile of the distance over all poses [m].

    def summary(self) -> dict[str, object]:
        """Summarise the forecast: number of poses, RMS error over them and its 90 % interval."""
        overall = span(1e3 * np.array([self.overall_percentile_5, self.overall_percentile_95]))
        return {
            "poses": len(self.rms_error),
            "rms_mm": f"{1e3 * self.overall_rms_error:.3g}",
            "interval_mm": overall,
        }


def inflate_intervals(forecast: Forecast) -> Forecast:
    """Widen the 90 % intervals of a forecast to hold for nonlinear arms and wrong priors.

    The percentiles are multiplied by `INTERVAL_INFLATION`; all else is unchanged.

    Mathematics: `pose-11`.
    """
    below, above = INTERVAL_INFLATION
    return replace(
        forecast,
        percentile_5=below * forecast.percentile_5,
        percentile_95=above * forecast.percentile_95,
        overall_percentile_5=below * forecast.overall_percentile_5,
        overall_percentile_95=above * forecast.overall_percentile_95,
    )


def unbounded_predictions(problem: DesignProblem, rows: Array) -> Mask:
    """Tell which predictions depend on directions that no candidate observes and no prior bounds.

    Args:
        problem: Candidates, with the unobservable directions of x.
        rows: Predicted deflections of m targets per unit of x, (poses, 3 m, n) [m].

    Returns:
        True where the prediction error has no bound, (poses,).
    """
    open_ = np.linalg.norm(rows @ problem.unobservable_directions, axis=(1, 2))
    return np.asarray(open_ > MIN_UNOBSERVABLE_SHARE * np.linalg.norm(rows, axis=(1, 2)))


def forecast(problem: DesignProblem, M: Array, rows: Array) -> Forecast:
    """Forecast the errors of predictions after the poses of a plan were measured, by a linear normal model.

    The covariance of x is then lift M^-1 lift^T + remaining_covariance.

    Mathematics: `pose-11`.

    Args:
        problem: Candidates, with lift, remaining covariance and unobservable directions.
        M: Information matrix of the plan, (r, r) [1].
        rows: Predicted deflections of m targets per unit of x, (poses, 3 m, n) [m].

    Returns:
        The forecast; infinite in poses whose prediction depends on unobservable directions.
    """
    # a root of the covariance of x, lift M^-1 lift^T + remaining_covariance
    half = np.linalg.solve(np.linalg.cholesky(M), problem.lift.T)
    values, V = np.linalg.eigh(half.T @ half + problem.remaining_covariance)
    errors = forecast_normal_errors(np.zeros(rows.shape[:2]), rows @ (V * np.sqrt(np.maximum(values, 0))))
    return with_infinite_errors(errors, unbounded_predictions(problem, rows))


def with_infinite_errors(forecast: Forecast, unbounded: Mask) -> Forecast:
    """Set the expected errors of some poses, and with them the error over all poses, to infinity.

    Args:
        forecast: A forecast.
        unbounded: Which poses have an error without bound, (poses,).

    Returns:
        The forecast; unchanged if all poses have a bound.
    """
    if not unbounded.any():
        return forecast
    error, low, high = (
        np.where(unbounded, np.inf, end)
        for end in (forecast.rms_error, forecast.percentile_5, forecast.percentile_95)
    )
    deviation = np.where(unbounded[:, None], np.inf, forecast.axis_deviation)
    return Forecast(error, low, high, deviation, math.inf, math.inf, math.inf)


def forecast_normal_errors(bias: Array, spread: Array) -> Forecast:
    """Compute RMS distances and their percentiles for prediction errors bias + spread @ N(0, 1).

    Args:
        bias: Mean error of the m targets, (poses, 3 m) [m].
        spread: Root of the covariance of the errors, (poses, 3 m, k) [m].

    Returns:
        RMS distances, with 5th and 95th percentiles over `INTERVAL_DRAWS` draws.
    """
    parts = -(-len(bias) // POSES_AT_ONCE)
    pairs = zip(np.array_split(bias, parts), np.array_split(spread, parts), strict=True)
    # mean square distance of every draw in every pose, (poses, draws)
    square = np.concatenate([_square_distances(b, S) for b, S in pairs])
    variance = np.square(bias) + np.square(spread).sum(axis=2)
    mean = mean_square_distance(bias, spread)
    low, high = np.sqrt(np.percentile(square, [5, 95], axis=1, method="lower"))
    over = np.percentile(square.mean(axis=0), [5, 95], method="lower")
    return Forecast(np.sqrt(mean), low, high, np.sqrt(variance), *map(math.sqrt, (mean.mean(), *over)))


def _square_distances(bias: Array, spread: Array) -> Array:
    """Compute the mean square distance of a target by every draw of bias + spread @ N(0, 1), (poses, draws).

    One product for several poses is twice as fast as one for each.
    """
    poses, rows, k = spread.shape
    error = bias.reshape(-1, 1) + spread.reshape(-1, k) @ _draws(k)
    return np.asarray(np.square(error).reshape(poses, rows, -1).sum(axis=1) / (rows / 3))


def mean_square_distance(bias: Array, spread: Array) -> Array:
    """Compute mean square distances of targets for prediction errors bias + spread @ N(0, 1).

    Args:
        bias: Mean error of the m targets, (poses, 3 m) [m].
        spread: Root of the covariance of the errors, (poses, 3 m, k) [m].

    Returns:
        Mean square distance of a target, (poses,) [m^2].
    """
    variance = np.square(bias) + np.square(spread).sum(axis=2)
    return np.asarray(variance.sum(axis=1) / (bias.shape[1] / 3))


@lru_cache(maxsize=4)
def _draws(k: int) -> Array:
    """Draw the normal numbers that all forecasts share, (k, INTERVAL_DRAWS).

    Drawing takes as long as using them.
    """
    return np.random.Generator(np.random.Philox(0)).standard_normal((k, INTERVAL_DRAWS))


@dataclass(frozen=True)
class LinearFit:
    """Hold the fit of a model to whitened readings y of an arm with more unknowns than the model.

    The model's unknowns are x_m = K y + k.
    """

    full_setup: MeasurementSetup  #: The measurement with all N unknowns of the arm.
    arm_uncertainty: (
        float  #: Relative standard deviation u of the arm's compliances about their expectation [1].
    )
    model_setup: MeasurementSetup  #: The measurement with the n unknowns of the model.
    #: Response to noise: K, or a matrix of at most n columns with the same K K^T, (n, columns) [1].
    noise_response: Array
    constant: Array  #: Constant k of the fit, (n,) [1].
    unknowns_response: Array  #: K A: response of the fit to each unknown of the arm, (n, N) [1].


def linear_fit(
    full_setup: MeasurementSetup,
    arm_uncertainty: float,
    spec: PlanSpecification,
    whitened_rows: Callable[[PlanSpecification], Array],
) -> LinearFit:
    """Compute the fit of a model to the readings y of a plan, x_m = K y + k, on an arm with more unknowns.

    Mathematics: `pose-12`.

    Args:
        full_setup: The measurement with all unknowns of the arm.
        arm_uncertainty: Relative standard deviation of the arm's compliances about their expectation [1].
        spec: Specification with the model's unknowns and prior.
        whitened_rows: Function of a specification to the whitened rows of all readings of the plan per unit
            of its unknowns x, (poses, k, n) [1].
    """
    A = _flat(whitened_rows(replace(spec, setup=full_setup)))
    K, k = _fit(spec, _flat(whitened_rows(spec)))
    return LinearFit(full_setup, arm_uncertainty, spec.setup, _narrow(K), k, K @ A)


def forecast_fit(fit: LinearFit, q: Array, load: Load) -> Forecast:
    """Forecast the errors of predictions by a linear fit, with percentiles.

    Mathematics: `pose-12`.

    Args:
        fit: The fit of a model to the readings of a plan.
        q: Poses of the predictions, (poses, n_joints) [rad, m].
        load: Load in these poses, the same in all or with one row per pose.
    """
    return forecast_normal_errors(*_error(fit, q, load))


def fit_error(fit: LinearFit, q: Array, load: Load) -> Array:
    """Compute the RMS errors of predictions by a linear fit, without percentiles, which take most time.

    Args:
        fit: The fit of a model to the readings of a plan.
        q: Poses of the predictions, (poses, n_joints) [rad, m].
        load: Load in these poses, the same in all or with one row per pose.

    Returns:
        RMS distance of a target, (poses,) [m].
    """
    return np.sqrt(mean_square_distance(*_error(fit, q, load)))


def _error(fit: LinearFit, q: Array, load: Load) -> tuple[Array, Array]:
    """Compute bias and spread of the predictions, as `forecast_normal_errors` takes them."""
    # D = T - T_m K A acts on the arm's unknowns, T_m K on the noise
    T, model_rows = (deflection_rows(setup, q, load) for setup in (fit.full_setup, fit.model_setup))
    D = T - model_rows @ fit.unknowns_response
    bias = D @ fit.full_setup.scaling.expected_x - model_rows @ fit.constant
    return bias, np.concatenate([fit.arm_uncertainty * D, model_rows @ fit.noise_response], axis=2)


def _fit(spec: PlanSpecification, A: Array) -> tuple[Array, Array]:
    """Compute K and k of a fit x = K y + k from whitened rows, (readings, n)."""
    scaling = spec.setup.scaling
    if spec.prior_uncertainty is None:
        return np.asarray(np.linalg.pinv(A, rcond=RANK_TOLERANCE)), np.zeros(len(scaling.expected_x))
    B, c = prior_rows(scaling, PriorUncertainty(spec.prior_uncertainty, SCALE_UNCERTAINTY))
    M = A.T @ A + B.T @ B
    return np.asarray(np.linalg.solve(M, A.T)), np.asarray(np.linalg.solve(M, B.T @ c))


def _narrow(K: Array) -> Array:
    """Return a matrix with the same K K^T and no more columns than rows, so that noise is drawn as fast."""
    return K if K.shape[1] <= K.shape[0] else np.asarray(np.linalg.qr(K.T, mode="r")).T


def _flat(rows: Array) -> Array:
    return rows.reshape(-1, rows.shape[-1])
