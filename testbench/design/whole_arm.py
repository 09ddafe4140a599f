"""What a plan promises on an arm of which every link and joint gives, as most models leave some of them out.

The arm's unknowns are x ~ N(e, u^2 1) in the metric of the prior that it is drawn from; its readings are
y = A x + noise, whitened. A model's fit is affine in them, x_m = K y + k, and so is its error at the tasks,
T x - T_m x_m = D x - T_m (K noise + k) with D = T - T_m K A: normal, its mean and covariance known.
"""

from dataclasses import dataclass

import numpy as np

from testbench.design.forecast import Forecast, forecast_of, mean_square_of
from testbench.design.rows import (
    SCALE_UNCERTAINTY,
    Experiment,
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
class Fitted:
    """A model, fitted to what a plan reads of an arm that has more unknowns."""

    whole: Experiment  #: The measurement with every unknown of the arm.
    uncertainty: float  #: Of the arm's compliances around its metric's expectation, relative [1].
    model: Experiment  #: The measurement with the model's unknowns.
    scatter: Array  #: K of the fit x_m = K y + k, or no more than n columns with the same K K^T, (n, ...).
    k: Array  #: (n,).
    gain: Array  #: K A: what is found of each of the arm's unknowns, (n, all).


def fit_of(whole: Experiment, uncertainty: float, spec: Specification, q: Array, load: Ids) -> Fitted:
    """A specification's model, with its prior or without, after a plan was measured on the whole arm.

    Args:
        whole: The same measurement with every unknown of the arm.
        uncertainty: Of the arm's compliances around its metric's expectation, relative [1].
        spec: The model.
        q: Poses measured, (poses, n) [rad, m].
        load: Which of the loads hangs in each, (poses,).
    """
    A = _flat(reading_rows(whole, q, loads_of(spec, load)))
    K, k = _fit(spec, _flat(measured_rows(spec, q, load)))
    return Fitted(whole, uncertainty, spec.experiment, _narrow(K), k, K @ A)


def promise_on(fit: Fitted, q: Array, load: Load) -> Forecast:
    """Errors to expect of the fit's predictions in poses, (poses, n) [rad, m], under a load."""
    return forecast_of(*_error(fit, q, load))


def error_on(fit: Fitted, q: Array, load: Load) -> Array:
    """The same without intervals, which take most of the time, (poses,) [m]."""
    return np.sqrt(mean_square_of(*_error(fit, q, load)))


def _error(fit: Fitted, q: Array, load: Load) -> tuple[Array, Array]:
    """Bias and spread of the predictions, see `forecast_of`."""
    T, own = (deflection_rows(experiment, q, load) for experiment in (fit.whole, fit.model))
    D = T - own @ fit.gain
    bias = D @ fit.whole.metric.expected - own @ fit.k
    return bias, np.concatenate([fit.uncertainty * D, own @ fit.scatter], axis=2)


def _fit(spec: Specification, A: Array) -> tuple[Array, Array]:
    """K and k of a fit x = K y + k from whitened rows (readings, n)."""
    own = spec.experiment.metric
    if spec.uncertainty is None:
        return np.asarray(np.linalg.pinv(A, rcond=RANK_TOLERANCE)), np.zeros(len(own.expected))
    B, c = precision_root(own, Strength(spec.uncertainty, SCALE_UNCERTAINTY))
    M = A.T @ A + B.T @ B
    return np.asarray(np.linalg.solve(M, A.T)), np.asarray(np.linalg.solve(M, B.T @ c))


def _narrow(K: Array) -> Array:
    """A matrix with the same K K^T and no more columns than rows: noise of many readings is drawn as fast."""
    return K if K.shape[1] <= K.shape[0] else np.asarray(np.linalg.qr(K.T, mode="r")).T


def _flat(rows: Array) -> Array:
    return rows.reshape(-1, rows.shape[-1])
