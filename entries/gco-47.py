"""GCO of the paper's MGCO47 with a learnt trace weight: links 2 and 3 in full and joints 2 to 6."""

import testbench as tb
from testbench.model.structure import mgco47


def estimate(kinematics, structure, data, prior):
    """Conservative parameters, (n,)."""
    own = mgco47(kinematics.arm)
    return structure.parameters_of(own.C_theta_of(tb.gco(kinematics, own, data).pi))
