"""GCO of the paper's MGCO68 with a learnt trace weight: links 0, 2 and 3 in full and joints 2 to 6."""

import testbench as tb
from testbench.model.structure import mgco68


def estimate(kinematics, structure, data, prior):
    """Conservative parameters, (n,)."""
    own = mgco68(kinematics.arm)
    return structure.parameters_of(own.C_theta_of(tb.gco(kinematics, own, data).pi))
