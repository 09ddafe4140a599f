"""Truncated SVD of straight beams: directions of which readings tell less than noise stay zero."""

import numpy as np

import testbench as tb
from testbench.model.structure import template56


def estimate(kinematics, structure, data, prior):
    """Parameters, (n,), columns scaled to norm one."""
    beams = template56(kinematics.arm)
    A, y = tb.reduce(kinematics, beams, data).weighted_equations
    scale = np.linalg.norm(A, axis=0)
    scale[scale < 1e-9 * scale.max()] = np.inf  # what no reading sees is zero
    U, s, Vt = np.linalg.svd(A / scale, full_matrices=False)
    z = U.T @ y
    kept = (np.abs(z) > 3) & (s > 1e-9 * s[0])  # noise has deviation 1
    return structure.parameters_of(beams.C_theta_of(Vt[kept].T @ (z[kept] / s[kept]) / scale))
