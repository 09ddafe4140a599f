"""Least squares of straight beams, negative eigenvalues of every block set to zero afterwards."""

from testbench.model.structure import template56
from testbench.studies.intervals import clipped


def estimate(kinematics, structure, data, prior):
    """Conservative compliances, (n_theta, n_theta)."""
    return clipped(kinematics, template56(kinematics.arm), data).C_theta
