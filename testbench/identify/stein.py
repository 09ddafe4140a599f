"""GCO with the log-determinant prior: Stein's divergence from what was expected.

D(X, s) = tr(X) / s - log det(X / s) - n is zero at X = s and grows without bound as X becomes singular:
every compliance stays positive definite. Near X = s it is |X / s - 1|^2 / 2, so that D / u^2 is the Gaussian
penalty of relative uncertainty u there. log det enters a conic program through the factor Z of
X = Z D^-1 Z^T: [[X, Z], [Z^T, diag Z]] >= 0 with Z lower triangular gives sum log Z_ii <= log det X.
"""

import clarabel
import numpy as np
from scipy import sparse

from testbench.errors import Array
from testbench.identify.conic import solver_settings
from testbench.identify.estimate import Estimate
from testbench.identify.prior import Metric, whitened
from testbench.identify.regression import Regression
from testbench.identify.regularised import Strength, estimate_of, gco_with, project, status_of

ROOT2 = np.sqrt(2)


def gco_stein(regression: Regression, metric: Metric, strength: Strength) -> Estimate:
    """GCO with the log-determinant prior; the common scale is that of the Gaussian fit.

    Args:
        regression: The reduced dataset.
        metric: The structure in the metric of the prior.
        strength: How firmly it is believed.
    """
    first = gco_with(regression, metric, strength)
    e = metric.expected
    scale = max(1e-6, float(np.linalg.solve(metric.L, first.pi) @ e / (e @ e)))
    A, y = whitened(regression, metric)
    R = np.asarray(np.linalg.qr(np.c_[A, y], mode="r"))
    n, weight = metric.structure.n, 1 / strength.uncertainty**2
    sizes = metric.sizes
    lower, logs = sum(k * (k + 1) // 2 for k in sizes), sum(sizes)
    total = 2 * n + lower + logs  # x, residuals, Z, logarithms of its diagonal
    fit = np.hstack([R[:n, :n] * scale, -np.eye(n), np.zeros((n, lower + logs))])
    rows, offsets = [sparse.csc_matrix(fit)], [R[:n, n]]
    cones: list[object] = [clarabel.ZeroConeT(n)]
    for cone, row, offset in _log_det_cones(sizes, n, total):
        rows.append(row)
        offsets.append(offset)
        cones.append(cone)
    quadratic = sparse.diags_array(np.r_[np.zeros(n), np.ones(n), np.zeros(lower + logs)])
    cost = np.r_[weight * e, np.zeros(n + lower), -weight * np.ones(logs)]
    solution = clarabel.DefaultSolver(
        sparse.csc_matrix(quadratic),
        cost,
        sparse.csc_matrix(sparse.vstack(rows)),
        np.concatenate(offsets),
        cones,
        solver_settings(),
    ).solve()
    return estimate_of(
        regression,
        metric,
        strength,
        project(metric, scale * np.array(solution.x)[:n]),
        method="GCO with log-det prior",
        constraint="psd",
        status=status_of(solution),
        solver_seconds=solution.solve_time,
    )


def _log_det_cones(
    sizes: tuple[int, ...], n: int, total: int
) -> list[tuple[object, sparse.csc_matrix, Array]]:
    """Cones and rows that hold every block's logarithms below those of its determinant."""
    found = []
    x, z, q = 0, 2 * n, 2 * n + sum(k * (k + 1) // 2 for k in sizes)
    for size in sizes:
        found.append(_factor_rows(size, x, z, total))
        entries = [(i, j) for j in range(size) for i in range(j, size)]
        for k in range(size):
            row = sparse.lil_matrix((3, total))
            row[0, q + k] = -1
            row[2, z + entries.index((k, k))] = -1
            found.append((clarabel.ExponentialConeT(), row.tocsc(), np.array([0.0, 1.0, 0.0])))
        x, z, q = x + size * (size + 1) // 2, z + size * (size + 1) // 2, q + size
    return found


def _factor_rows(size: int, x: int, z: int, total: int) -> tuple[object, sparse.csc_matrix, Array]:
    """[[X, Z], [Z^T, diag Z]] >= 0: rows of its upper triangle, by column, off-diagonals times sqrt 2."""
    width = 2 * size
    row = sparse.lil_matrix((width * (width + 1) // 2, total))
    upper = [(i, j) for j in range(size) for i in range(j + 1)]
    lower = [(i, j) for j in range(size) for i in range(j, size)]
    for k, (i, j) in enumerate(upper):
        row[_place(i, j), x + k] = -1
    for k, (i, j) in enumerate(lower):
        row[_place(i, size + j), z + k] = -ROOT2
        if i == j:
            row[_place(size + i, size + i), z + k] = -1
    return clarabel.PSDTriangleConeT(width), row.tocsc(), np.zeros(row.shape[0])


def _place(i: int, j: int) -> int:
    """Place of entry i <= j in an upper triangle stored by column."""
    return j * (j + 1) // 2 + i
