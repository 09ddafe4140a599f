"""Gibbs sampling: how wrong the prior is, and how far readings scatter, are unknown too."""

import numpy as np

import testbench as tb

DRAWS, BURN = 300, 100


def estimate(kinematics, structure, data, prior):
    """Mean of the draws, (n,), and their covariance, (n, n)."""
    if prior is None:
        raise NotImplementedError("needs a prior")
    A, y = tb.reduce(kinematics, structure, data).weighted_equations
    expected = structure.parameters_of(prior.C_theta)
    d = np.sqrt(np.diag(prior.C_theta))
    size = d[structure.rows] * d[structure.columns]  # pi = size (s e + x)
    e, n, rng = expected / size, structure.n_parameters, np.random.default_rng(0)
    U, w, Vt = np.linalg.svd(A * size, full_matrices=False)
    z, spare, s = U.T @ y, max(len(y) - len(w), 1), 0.5
    noise, width, kept = 1.0, 0.1, []
    rest = max(y @ y - z @ z, 0.0)
    for k in range(DRAWS + BURN):
        precision = w**2 / noise + 1 / width
        mean = Vt @ (s * e) / width + w * z / noise
        free = rng.standard_normal(n) * np.sqrt(width)
        own = mean / precision + rng.standard_normal(len(w)) / np.sqrt(precision)
        x = s * e + free + Vt.T @ (own - Vt @ (s * e + free))
        width = ((x - s * e) @ (x - s * e) / 2 + 0.01) / rng.gamma(n / 2 + 1)
        noise = max(
            1.0, ((z - w * (Vt @ x)) @ (z - w * (Vt @ x)) + rest) / 2 / rng.gamma((len(w) + spare) / 2)
        )
        s = (e @ x) / (e @ e) + rng.standard_normal() * np.sqrt(width / (e @ e))
        if k >= BURN:
            kept.append(size * x)
    return np.mean(kept, axis=0), np.cov(np.transpose(kept))
