"""Empirical Bayes, block by block: every link and joint has a scale and a scatter of its own, by EM."""

import numpy as np

import testbench as tb

STEPS = 200
FIRST, LEAST = 0.1, 1e-4  # scatter of an entry over its size, squared: expected, and at least [1]


def estimate(kinematics, structure, data, prior):
    """Posterior mean, (n,), and covariance, (n, n), by the sizes under which the readings are likeliest."""
    if prior is None:
        raise NotImplementedError("needs a prior")
    regression = tb.reduce(kinematics, structure, data)
    A, y = regression.weighted_equations
    d = np.sqrt(np.diag(prior.C_theta))
    size = (
        d[structure.rows] * d[structure.columns]
    )  # pi = size x, and of block b x ~ N(scale_b expected, scatter_b)
    expected, block = structure.parameters_of(prior.C_theta) / size, structure.block_of_row[structure.rows]
    blocks = np.arange(block.max() + 1)[:, None] == block
    H, g = size[:, None] * (A.T @ A) * size, size * (A.T @ y)
    total = y @ y + sum(term.n_equations / 3 * term.unexplained for term in regression.terms)
    scale = np.full(len(blocks), expected @ g / (expected @ H @ expected))
    scatter, noise = FIRST * scale**2, 1.0
    for _ in range(STEPS):
        mean = scale[block] * expected
        covariance = np.linalg.inv(H / noise + np.diag(1 / scatter[block]))
        x = mean + covariance @ ((g - H @ mean) / noise)
        # the sizes that suit x best; one number more is common to all blocks, and one scatter
        common = (scale / scatter).sum() / (1 / scatter).sum()
        scale = (blocks @ (expected * x) + common) / (blocks @ expected**2 + 1)
        off = np.diag(covariance) + (x - scale[block] * expected) ** 2
        scatter = (blocks @ off + FIRST * scale**2) / (blocks.sum(axis=1) + 1)
        scatter = np.maximum(scatter, LEAST * scale**2)
        left = total - 2 * g @ x + x @ H @ x + np.vdot(H, covariance)
        noise = max(1.0, left / regression.n_equations)
    return size * x, size[:, None] * covariance * size
