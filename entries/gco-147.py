"""GCO of the paper's MGCO147 with a learnt trace weight: all links in full."""

import testbench as tb
from testbench.model.structure import mgco147


def estimate(kinematics, structure, data, prior):
    """Conservative parameters, (n,)."""
    own = mgco147(kinematics.arm)
    return structure.parameters_of(own.C_theta_of(tb.gco(kinematics, own, data).pi))
