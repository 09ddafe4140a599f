"""Least squares of links as straight beams, the paper's MLS56: 8 compliances a link."""

import testbench as tb
from testbench.model.structure import template56


def estimate(kinematics, structure, data, prior):
    """Of minimum norm where the readings leave directions free, (n,)."""
    beams = template56(kinematics.arm)
    return structure.parameters_of(beams.C_theta_of(tb.least_squares(kinematics, beams, data).pi))
