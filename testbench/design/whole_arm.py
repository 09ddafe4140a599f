"""What a model leaves on an arm of which every link and joint gives, as most models leave some of them out.

The arm's unknowns are x ~ N(e, u^2 1) in the metric of the prior that it is drawn from; its readings are
y = A x + noise, whitened. A model's fit is affine in them, x_m = K y + k, and so is its error at the tasks,
T x - T_m x_m = D x - T_m (K noise + k) with D = T - T_m K A: its mean square is known without any draw.
"""

import math

import numpy as np

from testbench.design.rows import SCALE_UNCERTAINTY, Experiment, Ids, deflection_rows, reading_rows
from testbench.design.specification import Specification, loads_of, measured_rows, task_rows
from testbench.errors import Array
from testbench.identify.metric import precision_root
from testbench.identify.prior import Strength
from testbench.identify.regression import RANK_TOLERANCE


def error_on(whole: Experiment, uncertainty: float, spec: Specification, q: Array, load: Ids) -> float:
    """Error to expect at the tasks of a plan's model on an arm that has more unknowns, RMS distance [m].

    Args:
        whole: The same measurement with every unknown of the arm.
        uncertainty: Of the arm's compliances around its metric's expectation, relative [1].
        spec: The model, with its prior or without, and the tasks.
        q: Poses measured, (poses, n) [rad].
        load: Which of the loads hangs in each, (poses,).
    """
    A = _flat(reading_rows(whole, q, loads_of(spec, load)))
    T, own = _flat(deflection_rows(whole, spec.tasks.q, spec.tasks.load)), _flat(task_rows(spec))
    K, k = _fit(spec, _flat(measured_rows(spec, q, load)))
    D = T - own @ (K @ A)
    bias = D @ whole.metric.expected - own @ k
    square = bias @ bias + uncertainty**2 * np.square(D).sum() + np.square(own @ K).sum()
    return math.sqrt(square / (len(own) / 3))


def _fit(spec: Specification, A: Array) -> tuple[Array, Array]:
    """K and k of a fit x = K y + k from whitened rows (readings, n)."""
    own = spec.experiment.metric
    if spec.uncertainty is None:
        return np.asarray(np.linalg.pinv(A, rcond=RANK_TOLERANCE)), np.zeros(len(own.expected))
    B, c = precision_root(own, Strength(spec.uncertainty, SCALE_UNCERTAINTY))
    M = A.T @ A + B.T @ B
    return np.asarray(np.linalg.solve(M, A.T)), np.asarray(np.linalg.solve(M, B.T @ c))


def _flat(rows: Array) -> Array:
    return rows.reshape(-1, rows.shape[-1])
