"""Least squares of straight beams; its free directions make it conservative where they can."""

import testbench as tb
from testbench.model.structure import template56


def estimate(kinematics, structure, data, prior):
    """Parameters, (n,)."""
    beams = template56(kinematics.arm)
    return structure.parameters_of(beams.C_theta_of(tb.completed_least_squares(kinematics, beams, data).pi))
