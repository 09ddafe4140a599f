"""GCO with the log-determinant prior: Stein's divergence from what was expected.

D(X, s) = tr(X) / s - log det(X / s) - n is zero at X = s and grows without bound as X becomes singular:
every compliance stays positive definite. Near X = s it is |X / s - 1|^2 / 2, so that D / u^2 is the Gaussian
penalty of relative uncertainty u there. log det enters a conic program through the factor Z of
X = Z D^-1 Z^T: [[X, Z], [Z^T, diag Z]] >= 0 with Z lower triangular gives sum log Z_ii <= log det X.
"""

import numpy as np
from scipy import sparse

from testbench.identify import cone
from testbench.identify.estimate import Estimate
from testbench.identify.metric import Belief, Metric, whitened
from testbench.identify.prior import Strength
from testbench.identify.regression import Regression
from testbench.identify.regularised import conic_estimate, gco_with

ROOT2 = np.sqrt(2)


def gco_stein(regression: Regression, metric: Metric, strength: Strength) -> Estimate:
    """GCO with the log-determinant prior; the common scale is that of the Gaussian fit.

    The unknowns are x, residuals, the factors Z and the logarithms of their diagonals.
    """
    first = gco_with(regression, metric, strength)
    e = metric.expected
    scale = max(1e-6, float(np.linalg.solve(metric.L, first.pi) @ e / (e @ e)))
    A, y = whitened(regression, metric)
    R = np.asarray(np.linalg.qr(np.c_[A, y], mode="r"))
    n, weight = metric.structure.n, 1 / strength.uncertainty**2
    logs = sum(metric.sizes)
    fit = np.hstack([R[:n, :n] * scale, -np.eye(n), np.zeros((n, n + logs))])
    cost = np.r_[weight * e, np.zeros(2 * n), -weight * np.ones(logs)]
    problem = cone.Problem(
        cost=cost,
        blocks=(cone.free_block(0, len(cost)),),  # X lies in the larger matrices
        rows=(cone.Rows("zero", fit, R[:n, n]), *_log_det(metric.sizes, n)),
        quadratic=sparse.csc_matrix(sparse.diags_array(np.r_[np.zeros(n), np.ones(n), np.zeros(n + logs)])),
    )
    solution = cone.solve(problem)
    belief = Belief(metric, strength)
    return conic_estimate(regression, belief, solution, scale * solution.x[:n], "GCO with log-det prior")


def _log_det(sizes: tuple[int, ...], n: int) -> list[cone.Rows]:
    """Constraints that hold every block's logarithms below those of its determinant."""
    total = 3 * n + sum(sizes)
    found = []
    x, z, q = 0, 2 * n, 3 * n
    for size in sizes:
        found.append(_factor_rows(size, x, z, total))
        diagonal = z + np.cumsum([0, *range(size, 1, -1)])  # of Z, its lower triangle by column
        rows = sparse.lil_matrix((3 * size, total))
        rows[3 * np.arange(size), q + np.arange(size)] = -1
        rows[3 * np.arange(size) + 2, diagonal] = -1
        found.append(cone.Rows("exponential", rows.tocsc(), np.tile([0.0, 1.0, 0.0], size), each=3))
        x, z, q = x + cone.triangle(size), z + cone.triangle(size), q + size
    return found


def _factor_rows(size: int, x: int, z: int, total: int) -> cone.Rows:
    """[[X, Z], [Z^T, diag Z]] >= 0: rows of its upper triangle, by column, off-diagonals times sqrt 2."""
    rows = sparse.lil_matrix((cone.triangle(2 * size), total))
    upper = [(i, j) for j in range(size) for i in range(j + 1)]
    lower = [(i, j) for j in range(size) for i in range(j, size)]
    for k, (i, j) in enumerate(upper):
        rows[_place(i, j), x + k] = -1
    for k, (i, j) in enumerate(lower):
        rows[_place(i, size + j), z + k] = -ROOT2
        if i == j:
            rows[_place(size + i, size + i), z + k] = -1
    return cone.Rows("psd", rows.tocsc(), np.zeros(rows.shape[0]))


def _place(i: int, j: int) -> int:
    """Place of entry i <= j in an upper triangle stored by column."""
    return cone.triangle(j) + i
