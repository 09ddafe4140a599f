"""Parametric bootstrap of ridge regression to the scaled prior: readings drawn anew, fitted again."""

import numpy as np

import testbench as tb

UNCERTAINTY, DRAWS = 0.3, 200  # of an entry of the prior over its own size [1]


def estimate(kinematics, structure, data, prior):
    """Parameters, (n,), and their covariance, (n, n)."""
    if prior is None:
        raise NotImplementedError("needs a prior")
    A, y = tb.reduce(kinematics, structure, data).weighted_equations
    expected = structure.parameters_of(prior.C_theta)
    moved = A @ expected
    expected = expected * (moved @ y) / (moved @ moved)
    d = np.sqrt(np.diag(structure.C_theta_of(expected)))
    size = UNCERTAINTY * d[structure.rows] * d[structure.columns]
    U, s, Vt = np.linalg.svd(A * size, full_matrices=False)
    gain = size[:, None] * Vt.T * (s / (s**2 + 1)) @ U.T
    pi = expected + gain @ (y - A @ expected)
    rng = np.random.default_rng(0)
    # the truth differs from what is expected as the prior says, and readings scatter
    truths = expected + size * rng.standard_normal((DRAWS, len(size)))
    left = (truths - expected) @ A.T + rng.standard_normal((DRAWS, len(y)))
    return pi, np.cov((left @ gain.T + expected - truths).T)
