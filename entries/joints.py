"""Joint stiffness only: links are rigid, as in most calibrations."""

import testbench as tb
from testbench.model.structure import joints_only


def estimate(kinematics, structure, data, prior):
    """Least squares of the joints' compliances, as parameters of all links and joints, (n,)."""
    joints = joints_only(kinematics.arm)
    return structure.parameters_of(joints.C_theta_of(tb.least_squares(kinematics, joints, data).pi))
