"""Forecast of a plan on an arm of which every link and joint is elastic, where the model leaves some out.

The arm's unknowns are x ~ N(e, u^2 1) in the metric of the prior from which it is drawn. Its whitened
readings are y = A x + noise. A model's fit is affine in them, x_m = K y + k. So its error at the tasks is T x
- T_m x_m = D x - T_m (K noise + k) with D = T - T_m K A: normal, with known mean and covariance.
"""

from dataclasses import dataclass

import numpy as np

from testbench.design.forecast import Forecast, forecast_of, mean_square_of
from testbench.design.rows import (
    SCALE_UNCERTAINTY,
    MeasurementSetup,
    Specification,
    deflection_rows,
    loads_of,
    measured_rows,
    reading_rows,
)
from testbench.errors import Array, Ids
from testbench.identify.metric import precision_root
from testbench.identify.prior import Strength
from testbench.identify.regression import RANK_TOLERANCE
from testbench.model.load import Load


@dataclass(frozen=True)
class LinearFit:
    """Hold the affine fit of a model to what a plan reads of an arm that has more unknowns, x_m = K y + k."""

    whole: MeasurementSetup  #: The measurement with every unknown of the arm.
    uncertainty: float  #: Relative uncertainty u of the arm's compliances around their expectation [1].
    model: MeasurementSetup  #: The measurement with the model's unknowns, n of them.
    scatter: Array  #: K of the fit, or a matrix of at most n columns with the same K K^T, (n, columns) [1].
    k: Array  #: Constant k of the fit, (n,) [1].
    gain: Array  #: K A, response of the fit to each of the arm's unknowns, (n, unknowns of the arm) [1].


def fit_of(
    whole: MeasurementSetup, uncertainty: float, spec: Specification, q: Array, load: Ids
) -> LinearFit:
    """Fit a specification's model, with or without its prior, to a plan that is measured on the whole arm.

    Mathematics: `pose-12`.

    Args:
        whole: The same measurement with every unknown of the arm.
        uncertainty: Relative uncertainty of the arm's compliances around their expectation [1].
        spec: Specification with the model's unknowns and its prior.
        q: Poses measured, (poses, n_joints) [rad, m].
        load: Index of the load in each pose, (poses,).

    Returns:
        The fit x_m = K y + k.
    """
    A = _flat(reading_rows(whole, q, loads_of(spec, load)))
    K, k = _fit(spec, _flat(measured_rows(spec, q, load)))
    return LinearFit(whole, uncertainty, spec.experiment, _narrow(K), k, K @ A)


def forecast_on(fit: LinearFit, q: Array, load: Load) -> Forecast:
    """Forecast the errors of the fit's predictions, with intervals.

    Mathematics: `pose-12`.

    Args:
        fit: The fit.
        q: Poses of the predictions, (poses, n_joints) [rad, m].
        load: Load there, the same in all poses or with one row per pose.

    Returns:
        RMS distances with their intervals.
    """
    return forecast_of(*_error(fit, q, load))


def error_on(fit: LinearFit, q: Array, load: Load) -> Array:
    """Compute the RMS errors of the fit's predictions without intervals, which take most of the time.

    Args:
        fit: The fit.
        q: Poses of the predictions, (poses, n_joints) [rad, m].
        load: Load there, the same in all poses or with one row per pose.

    Returns:
        RMS distance of a target, (poses,) [m].
    """
    return np.sqrt(mean_square_of(*_error(fit, q, load)))


def _error(fit: LinearFit, q: Array, load: Load) -> tuple[Array, Array]:
    """Compute bias and spread of the predictions, as `forecast_of` takes them."""
    # D = T - T_m K A acts on the arm's unknowns, T_m K on the noise
    T, own = (deflection_rows(experiment, q, load) for experiment in (fit.whole, fit.model))
    D = T - own @ fit.gain
    bias = D @ fit.whole.scaling.expected - own @ fit.k
    return bias, np.concatenate([fit.uncertainty * D, own @ fit.scatter], axis=2)


def _fit(spec: Specification, A: Array) -> tuple[Array, Array]:
    """Compute K and k of a fit x = K y + k from whitened rows, (readings, n)."""
    scaling = spec.experiment.scaling
    if spec.uncertainty is None:
        return np.asarray(np.linalg.pinv(A, rcond=RANK_TOLERANCE)), np.zeros(len(scaling.expected))
    B, c = precision_root(scaling, Strength(spec.uncertainty, SCALE_UNCERTAINTY))
    M = A.T @ A + B.T @ B
    return np.asarray(np.linalg.solve(M, A.T)), np.asarray(np.linalg.solve(M, B.T @ c))


def _narrow(K: Array) -> Array:
    """Return a matrix with the same K K^T and no more columns than rows, so that noise is drawn as fast."""
    return K if K.shape[1] <= K.shape[0] else np.asarray(np.linalg.qr(K.T, mode="r")).T


def _flat(rows: Array) -> Array:
    return rows.reshape(-1, rows.shape[-1])
