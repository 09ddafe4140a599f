"""GCO of the paper's MGCO56, without a trace weight: all links as straight beams."""

import testbench as tb
from testbench.model.structure import template56


def estimate(kinematics, structure, data, prior):
    """Conservative parameters, (n,)."""
    own = template56(kinematics.arm)
    return structure.parameters_of(own.C_theta_of(tb.paper_gco(kinematics, own, data).pi))
