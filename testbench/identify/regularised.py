"""Least squares and GCO with the same prior: the likelihood times a Gaussian around what was expected.

Both minimise chi^2 + |x - s e|^2 / u^2 in the metric of the prior, x the compliance in units of what was
expected, e its expectation, u the relative uncertainty; GCO keeps every block positive semi-definite. The
scale s common to all compliances is left to the data: a CAD model that is wrong by one factor costs nothing.
"""

from dataclasses import dataclass

import clarabel
import numpy as np
from scipy import sparse

from testbench.errors import Array, BenchError
from testbench.identify.conic import EXACT, optimum, solver_settings
from testbench.identify.estimate import Constraint, Estimate, make_estimate
from testbench.identify.prior import Metric, whitened
from testbench.identify.regression import Regression, f_m

RANGE = 1e-6, 1e6
"""Relative uncertainties of a prior that mean something [1]."""
SLACK = 1e-2
"""Share by which F_M may exceed its optimum while the trace is made least."""
GAP = 1e-6
"""Duality gap, relative to the cost, below which a conic program counts as solved."""


@dataclass(frozen=True)
class Strength:
    """How firmly a prior is believed.

    Attributes:
        uncertainty: Relative standard deviation u of a compliance around its expectation [1].
        scale_uncertainty: The same of the factor common to all; infinite leaves it to the data.
    """

    uncertainty: float
    scale_uncertainty: float = np.inf

    def __post_init__(self) -> None:
        """Refuse what is no standard deviation.

        Raises:
            BenchError: When the uncertainty is out of RANGE, or that of the scale not above 0.
        """
        low, high = RANGE
        if not low <= self.uncertainty <= high:
            raise BenchError(f"uncertainty: expected {low:g} to {high:g}, got {self.uncertainty}")
        if not self.scale_uncertainty > 0:
            raise BenchError(f"scale_uncertainty: expected more than 0, got {self.scale_uncertainty}")


def precision_root(metric: Metric, strength: Strength) -> tuple[Array, Array]:
    """Rows that the prior adds to those of the data: B and c with |B x - c|^2 its penalty.

    With s left to the data, |x - s e|^2 is least at s = <x, e> / <e, e>: a projection. A finite uncertainty v
    of s gives back (s - 1)^2 / v^2 along e.

    Returns:
        B, (n, n), and c, (n,).
    """
    e = metric.expected / np.linalg.norm(metric.expected)
    size = np.linalg.norm(metric.expected)
    along = 1 / np.hypot(strength.uncertainty, size * strength.scale_uncertainty)
    B = (np.eye(len(e)) - np.outer(e, e)) / strength.uncertainty + along * np.outer(e, e)
    return B, along * size * e


def least_squares_with(regression: Regression, metric: Metric, strength: Strength) -> Estimate:
    """Weighted least squares with a prior; not conservative where the data pull it out of the cone.

    Args:
        regression: The reduced dataset.
        metric: The structure in the metric of the prior.
        strength: How firmly it is believed.
    """
    M, r = _stack(regression, metric, strength)
    x = np.asarray(np.linalg.lstsq(M, r, rcond=None)[0], dtype=float)
    return estimate_of(regression, metric, strength, x, method="least squares with prior", status="solved")


def gco_with(regression: Regression, metric: Metric, strength: Strength) -> Estimate:
    """GCO with a prior: the conservative model of greatest posterior density, a conic program.

    Args:
        regression: The reduced dataset.
        metric: The structure in the metric of the prior.
        strength: How firmly it is believed.
    """
    M, r = _stack(regression, metric, strength)
    n = metric.structure.n
    R: Array = np.asarray(np.linalg.qr(np.c_[M, r], mode="r"))
    unit = max(1.0, abs(R[n, n]))
    cone = np.zeros((n + 2, n + 1))
    cone[0, 0] = -1
    cone[1:, 1:] = R[:, :n] / unit
    psd = np.hstack([np.zeros((n, 1)), -np.eye(n)])
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix((n + 1, n + 1)),
        np.r_[1.0, np.zeros(n)],
        sparse.csc_matrix(np.vstack([cone, psd])),
        np.r_[0.0, R[:, n] / unit, np.zeros(n)],
        [clarabel.SecondOrderConeT(n + 2), *map(clarabel.PSDTriangleConeT, metric.sizes)],
        solver_settings(),
    )
    solution = solver.solve()
    x = project(metric, np.array(solution.x)[1:])
    return estimate_of(
        regression,
        metric,
        strength,
        x,
        method="GCO with prior",
        constraint="psd",
        status=status_of(solution),
        solver_seconds=solution.solve_time,
    )


def gco_least_trace(regression: Regression, metric: Metric) -> Estimate:
    """GCO without a prior: of the models that fit as well as the best, the one of least trace of X.

    The prior's compliances are a metric here and nothing more: the trace counts every compliance in units of
    what was expected. As well means an F_M within `SLACK` of the optimum, which itself may only be approached
    as unseen compliance grows without end.

    Args:
        regression: The reduced dataset.
        metric: The structure in the metric of a prior.
    """
    best = optimum(regression).f_m
    n, terms = metric.structure.n, len(regression.terms)
    allowed = (1 + SLACK) * max(best, EXACT * f_m(regression, np.zeros(n)))
    blocks = [np.r_[np.ones(terms), np.zeros(n)][None]]
    offsets, cones = [np.array([1.0])], [clarabel.NonnegativeConeT(1)]
    for k, term in enumerate(regression.terms):
        rows = np.zeros((n + 2, terms + n))
        rows[0, k] = -1
        rows[1:-1, terms:] = term.R @ metric.L / allowed
        blocks.append(rows)
        offsets.append(np.r_[0.0, term.z, np.sqrt(term.rest)] / allowed)
        cones.append(clarabel.SecondOrderConeT(n + 2))
    blocks.append(np.hstack([np.zeros((n, terms)), -np.eye(n)]))
    offsets.append(np.zeros(n))
    cones += map(clarabel.PSDTriangleConeT, metric.sizes)
    solution = clarabel.DefaultSolver(
        sparse.csc_matrix((terms + n, terms + n)),
        np.r_[np.zeros(terms), metric.expected],
        sparse.csc_matrix(np.vstack(blocks)),
        np.concatenate(offsets),
        cones,
        solver_settings(),
    ).solve()
    return make_estimate(
        regression,
        metric.L @ project(metric, np.array(solution.x)[terms:]),
        method="GCO, least trace in the metric",
        constraint="psd",
        status=status_of(solution),
        solver_seconds=solution.solve_time,
        advice=(
            f"free directions: least trace in the metric of {metric.prior}, F_M within {100 * SLACK:g} %",
        ),
    )


def status_of(solution: clarabel.DefaultSolution) -> str:
    """Whether the cost of a conic program lies within GAP of the bound that its dual proves."""
    cost, bound = solution.obj_val, solution.obj_val_dual
    if abs(cost - bound) <= GAP * max(1.0, abs(cost)):
        return "solved"
    return f"not solved: Clarabel says {solution.status}"


def blocks_of(metric: Metric, x: Array) -> list[Array]:
    """X of every block."""
    found, first = [], 0
    for n in metric.sizes:
        X = np.zeros((n, n))
        last = first + n * (n + 1) // 2
        column, row = np.tril_indices(n)
        X[row, column] = X[column, row] = x[first:last] * np.where(row == column, 1, np.sqrt(0.5))
        found.append(X)
        first = last
    return found


def project(metric: Metric, x: Array) -> Array:
    """X with the negative eigenvalues of every block, a solver's last digits, set to zero."""
    parts = []
    for X in blocks_of(metric, x):
        values, Q = np.linalg.eigh(X)
        X = (Q * np.maximum(values, 0)) @ Q.T
        column, row = np.tril_indices(len(X))
        parts.append(X[row, column] * np.where(row == column, 1, np.sqrt(2)))
    return np.concatenate(parts)


def _stack(regression: Regression, metric: Metric, strength: Strength) -> tuple[Array, Array]:
    """Rows of the data and of the prior."""
    (A, y), (B, c) = whitened(regression, metric), precision_root(metric, strength)
    return np.vstack([A, B]), np.r_[y, c]


def estimate_of(
    regression: Regression,
    metric: Metric,
    strength: Strength,
    x: Array,
    *,
    method: str,
    status: str,
    solver_seconds: float = 0.0,
    constraint: Constraint = "none",
) -> Estimate:
    """The estimate of x; it says which prior filled what the data cannot see."""
    scale = (
        "its scale left to the data"
        if np.isinf(strength.scale_uncertainty)
        else f"its scale known to {100 * strength.scale_uncertainty:g} %"
    )
    return make_estimate(
        regression,
        metric.L @ x,
        method=method,
        status=status,
        solver_seconds=solver_seconds,
        constraint=constraint,
        advice=(f"prior: {metric.prior}, uncertainty {100 * strength.uncertainty:.3g} %, {scale}",),
    )
