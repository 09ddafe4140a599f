"""Estimators beside ours: other fillings of what data do not see, ridge regression, clipped eigenvalues.

What data do not see is filled in the metric of a prior by least trace or a log determinant. That prior is
Stein's divergence from what was expected: D(X, s) = tr(X) / s - log det(X / s) - n is zero at X = s and grows
without bound as X becomes singular: every compliance stays positive definite. Near X = s it is
|X / s - 1|^2 / 2, so that D / u^2 is the Gaussian penalty of relative uncertainty u there. The log
determinant is the barrier of interior points, which minimise chi^2 / 2 + D / u^2.

Ridge regression and clipping hold least squares down without a cone.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from testbench.data.dataset import Dataset
from testbench.errors import Array
from testbench.identify import cone, least_squares, reduce
from testbench.identify.cone import psd_part
from testbench.identify.conic import EXACT_FIT, norms_below, solve_gco
from testbench.identify.estimate import Estimate, make_estimate
from testbench.identify.interior import BlockProgram, interior
from testbench.identify.metric import Case, PriorScaling, Strength, WeightedPrior, weighted_rows
from testbench.identify.regression import Regression, f_m, reduce_parts
from testbench.identify.solve import solve_with_prior
from testbench.identify.trace import Fold, divide_poses, folds
from testbench.model.structure import Structure
from testbench.model.vjm import Vjm

UNCERTAINTIES = (0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.3, 2.0)
"""Relative uncertainties of a prior that cross-validation tries [1]."""
LEFT = 1e-10  #: Distance from the optimum up to which it is solved, over the cost of no model.
SLACK = 1e-2  #: Share by which F_M may exceed its optimum while the trace is made least.


def gco_stein(regression: Regression, metric: PriorScaling, strength: Strength) -> Estimate:
    """Identify by GCO with the log-determinant prior; the common scale is that of the Gaussian fit.

    Args:
        regression: The reduced dataset.
        metric: Metric of the prior.
        strength: Strength of the prior.

    Returns:
        The estimate.
    """
    case = Case(regression, WeightedPrior(metric, strength))
    pi, left = _minimum(case)
    estimate = make_estimate(regression, pi, method="GCO with log-det prior", constraint="psd")
    return replace(
        estimate, weighted_prior=case.belief, status="solved" if left <= LEFT else f"not solved: {left:.1g}"
    )


def stein_parameters(case: Case) -> Array:
    """Compute the parameters that `gco_stein` finds, (n,)."""
    return _minimum(case)[0]


def _minimum(case: Case) -> tuple[Array, float]:
    """Parameters, (n,), and how far they are from the optimum, over the cost of no model."""
    metric, n = case.belief.scaling, case.belief.scaling.structure.n
    e, (A, y) = metric.expected, weighted_rows(case.regression, metric)
    scale = max(1e-6, float(np.linalg.solve(metric.L, solve_with_prior("psd", case).pi) @ e / (e @ e)))
    # X in units of the scale, the cost in those of what the readings span
    T: Array = np.asarray(np.linalg.qr(np.c_[scale * A, y], mode="r"))[:n]
    size = float(T[:, n] @ T[:, n])
    R, z = T[None, :, :n] / math.sqrt(size), T[None, :, n] / math.sqrt(size)
    weight = 1 / (size * case.belief.strength.uncertainty**2)
    program = BlockProgram(R, z, np.zeros(1), weight * e, metric.sizes, squares=True, barrier=weight)
    iterate = interior(program)
    return np.asarray(scale * metric.L @ iterate.x), iterate.distance_from_optimum(program)


def gco_least_trace(regression: Regression, metric: PriorScaling) -> Estimate:
    """Identify by GCO without a prior: of models that fit as well as the best the one of least trace.

    The prior's compliances are a metric here and nothing more: the trace counts every compliance in units of
    what was expected. As well means an F_M within `SLACK` of the optimum, which itself may only be approached
    as unseen compliance grows without end.

    Args:
        regression: The reduced dataset.
        metric: Metric of the prior.

    Returns:
        The estimate.
    """
    best = solve_gco(regression).f_m
    n, count = metric.structure.n, len(regression.terms)
    allowed = (1 + SLACK) * max(best, EXACT_FIT * f_m(regression, np.zeros(n)))
    total = cone.Rows("nonnegative", np.r_[np.ones(count), np.zeros(n)][None], np.array([1.0]))
    parts = [(term.R @ metric.L, term.z, math.sqrt(term.unexplained)) for term in regression.terms]
    norms = norms_below(*(np.array(part) / allowed for part in zip(*parts, strict=True)))
    solution = cone.solve(
        cone.ConeProgram(
            cost=np.r_[np.zeros(count), metric.expected],
            blocks=(cone.free_block(0, count), *cone.psd_blocks(count, metric.sizes)),
            rows=(total, *norms),
        )
    )
    estimate = make_estimate(
        regression,
        metric.L @ metric.project(solution.x[count:]),
        method="GCO, least trace in the metric",
        constraint="psd",
        advice=(
            f"free directions: least trace in the metric of {metric.prior}, F_M within {100 * SLACK:g} %",
        ),
    )
    return replace(estimate, status=solution.status, solver_seconds=solution.seconds)


def every_fold(vjm: Vjm, structure: Structure, data: Dataset) -> list[Fold]:
    """Make the folds of the runs with a reading.

    Args:
        vjm: Kinematics of the arm.
        structure: The unknowns.
        data: Measured runs.

    Returns:
        The folds.
    """
    [parts] = reduce_parts(vjm, [structure], data, divide_poses(data))
    return folds(parts)


def choose_strength(held: Sequence[Fold], metric: PriorScaling, fit: Callable[[Case], Array]) -> Strength:
    """Choose the uncertainty of a prior that predicts held-out poses best.

    Args:
        held: The folds.
        metric: Metric of the prior.
        fit: Fits a case.

    Returns:
        The strength, its scale left to the data.
    """

    def error(strength: Strength) -> float:
        cases = ((fold, Case(fold.fitted, WeightedPrior(metric, strength))) for fold in held)
        return float(np.mean([f_m(fold.held_out, fit(case)) for fold, case in cases]))

    return min(map(Strength, UNCERTAINTIES), key=error)


UNSEEN = 1e-9  #: Length of a column over the longest one below which no reading sees it.
RIDGES = np.geomspace(1e-9, 1, 60)  #: Tried, over the largest eigenvalue.


def ridge(vjm: Vjm, structure: Structure, data: Dataset) -> Estimate:
    """Identify by ridge regression in columns of length one, its size by generalised cross-validation.

    Golub, Heath, Wahba 1979, "Generalized cross-validation as a method for choosing a good ridge parameter".

    Args:
        vjm: Kinematics of the arm.
        structure: The unknowns.
        data: Measured runs.

    Returns:
        The estimate.
    """
    regression = reduce(vjm, structure, data)
    A, y = regression.rows
    scale = np.linalg.norm(A, axis=0)
    scale[scale < UNSEEN * scale.max()] = np.inf  # what no reading sees is zero
    U, s, Vt = np.linalg.svd(A / scale, full_matrices=False)
    z = U.T @ y
    rest = y @ y - z @ z + sum(term.equations / 3 * term.unexplained for term in regression.terms)

    def score(size: float) -> float:
        left = size / (s**2 + size)
        return float(((left * z) @ (left * z) + rest) / (regression.equations - (1 - left).sum()) ** 2)

    size = min(RIDGES * s[0] ** 2, key=score)
    pi = Vt.T @ (s / (s**2 + size) * z) / scale
    return replace(make_estimate(regression, pi, method="ridge", constraint="ridge"), status="solved")


def clipped(vjm: Vjm, structure: Structure, data: Dataset) -> Estimate:
    """Identify by least squares, negative eigenvalues of every block set to zero afterwards.

    Args:
        vjm: Kinematics of the arm.
        structure: The unknowns.
        data: Measured runs.

    Returns:
        The estimate.
    """
    plain = least_squares(vjm, structure, data)
    C = plain.C_theta.copy()
    for block in structure.blocks:
        C[np.ix_(block, block)] = psd_part(C[np.ix_(block, block)])
    pi, regression = structure.entries(C), plain.regression
    return replace(
        make_estimate(regression, pi, method="clipped least squares", constraint="clipped"), status="solved"
    )
