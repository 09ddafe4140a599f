"""Ridge regression of straight beams: shrunk to zero, how much by generalised cross-validation."""

import numpy as np

import testbench as tb
from testbench.model.structure import template56


def estimate(kinematics, structure, data, prior):
    """Parameters, (n,), columns scaled to norm one."""
    beams = template56(kinematics.arm)
    A, y = tb.reduce(kinematics, beams, data).rows
    scale = np.linalg.norm(A, axis=0)
    scale[scale < 1e-9 * scale.max()] = np.inf  # what no reading sees is zero
    U, s, Vt = np.linalg.svd(A / scale, full_matrices=False)
    z, rest = U.T @ y, y @ y - (U.T @ y) @ (U.T @ y)

    def score(ridge):
        left = ridge / (s**2 + ridge)
        return ((left * z) @ (left * z) + rest) / (len(y) - (1 - left).sum()) ** 2

    ridge = min(np.geomspace(1e-9, 1, 60) * s[0] ** 2, key=score)
    pi = Vt.T @ (s / (s**2 + ridge) * z) / scale
    return structure.entries(beams.matrix(pi))
