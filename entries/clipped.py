"""Least squares of straight beams, negative eigenvalues of every block set to zero afterwards."""

import numpy as np

import testbench as tb
from testbench.model.structure import template56


def estimate(kinematics, structure, data, prior):
    """Conservative compliances, (n_theta, n_theta)."""
    C = tb.least_squares(kinematics, template56(kinematics.arm), data).C_theta.copy()
    for block in structure.blocks:
        values, Q = np.linalg.eigh(C[np.ix_(block, block)])
        C[np.ix_(block, block)] = (Q * values.clip(0)) @ Q.T
    return C
