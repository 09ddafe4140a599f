"""Joint stiffness only, with the prior of the joints; links are rigid."""

import testbench as tb
from testbench.model.structure import joints_only


def estimate(kinematics, structure, data, prior):
    """Parameters, (n,)."""
    if prior is None:
        raise NotImplementedError("needs a prior")
    joints = joints_only(kinematics.arm)
    return structure.parameters_of(
        joints.C_theta_of(tb.with_prior(tb.gco, prior)(kinematics, joints, data).pi)
    )
